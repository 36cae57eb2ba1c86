"""Does an object at rest start to move by itself?"""

from __future__ import annotations

import numpy as np

from physgen.evaluate.plausibility.evidence import Answer, Evidence
from physgen.evaluate.plausibility.gravity import common
from physgen.evaluate.plausibility.motion import Motion
from physgen.evaluate.plausibility.tracks import Array, runs
from physgen.scene.scene import View

FEWEST, SHORTEST = 5, 0.15
"""Frames and s of rest."""
SURE = 3.0
"""Standard deviations that noise may account for."""
LATEST = 15
"""Frames that a slow beginning may be hidden in noise."""
AFTER = 6
"""Frames in which it must have come away."""


def starts(motion: Motion) -> Answer:
    """Each time that something at rest comes to move, and everything that rests and stays."""
    found = []
    for k in range(len(motion.tracks.names)):
        if motion.free(k):
            found += _of(motion, k)
    return Answer.of(found, "nothing rests")


def _of(motion: Motion, body: int) -> list[Evidence]:
    tracks = motion.tracks
    name = tracks.names[body]
    found, rested = [], False
    for first, last in runs(tracks.seen[:, body]):
        for begin, end in _rests(motion, body, first, last):
            rested = True
            if end < last - 2:
                evidence = _onset(motion, body, begin, end, last)
                if evidence is not None:
                    found.append(evidence)
    if rested and not found:
        found.append(Evidence(0.0, 0, (body,), f"{name}: rests, and stays"))
    return found


def _rests(motion: Motion, body: int, first: int, last: int) -> list[tuple[int, int]]:
    """First frame and last + 1 of each rest."""
    path = motion.tracks.places[first:last, body]
    still = 4 * float(motion.sigma[body]) + 0.1
    fewest = max(FEWEST, int(np.ceil(_shortest(motion, still) / motion.tracks.step)))
    found, begin = [], 0
    while begin + fewest <= len(path):
        end = begin + fewest
        if _wide(path[begin:end]) > still:
            begin += 1
            continue
        middle = np.median(path[begin:end], axis=0)
        while end < len(path) and np.hypot(*(path[end] - middle)) <= still:
            end += 1
            middle = np.median(path[begin:end], axis=0)
        found.append((first + begin, first + end))
        begin = end
    return found


def _shortest(motion: Motion, still: float) -> float:
    """s: what turns back in the air is as still as that for a while."""
    pulled = common(motion)
    if pulled is None:
        return SHORTEST
    return max(SHORTEST, 1.5 * 2 * float(np.sqrt(2 * still / max(np.hypot(*pulled), 1e-9))))


def _drift(motion: Motion, body: int, begin: int, end: int) -> float:
    """px a frame: how fast it may creep in its rest, for all that noise lets one tell."""
    path = motion.tracks.places[begin:end, body]
    ticks = np.arange(len(path)) - (len(path) - 1) / 2
    spread = float(ticks @ ticks)
    return float(np.hypot(*(ticks @ path)) / spread + SURE * motion.sigma[body] / np.sqrt(spread))


def _wide(path: Array) -> float:
    return float(np.hypot(*(path - np.median(path, axis=0)).T).max())


def _onset(motion: Motion, body: int, begin: int, end: int, last: int) -> Evidence | None:
    """`end` is the first frame that is away; None where it does not really come away."""
    tracks = motion.tracks
    sigma, name = float(motion.sigma[body]), tracks.names[body]
    home = np.median(tracks.places[begin:end, body], axis=0)
    stop = min(end + AFTER, last)
    way = tracks.places[end:stop, body] - home
    gone = float(np.hypot(*way[-1]))
    least = max(8 * sigma, 2.0) + _drift(motion, body, begin, end) * (stop - 1 - (begin + end - 1) / 2)
    if gone < least:
        return None
    # it rests for as long as no one can tell: slow beginnings lie in the last frames of the rest
    if motion.was_pushed(body, tracks.times[end - 3], tracks.times[end]):
        return Evidence(0.0, end, (body,), f"{name}: is pushed")
    # slow ones take long to come out of the noise: whoever set them moving was there before
    slow = int(np.ceil((4 * sigma + 0.1) / max(gone / (stop - end), 1e-9)))
    mover = _set_moving(motion, body, end - min(slow, LATEST), end)
    if mover is not None:
        return Evidence(0.0, end, (body,), f"{name}: is set moving by {tracks.names[mover]}")
    if tracks.view is View.SIDE and not tracks.flat and _let_go(way, tracks.step, 4 * sigma + 0.1):
        return Evidence(0.0, end, (body,), f"{name}: lets go, and goes down")
    size = max(2.0, 0.1 * tracks.forms[body].reach)
    text = f"{name}: rests to frame {end - 1}, then goes {gone:.0f} px in {stop - end} frames, and nothing touches it"
    return Evidence((gone - least) / size, end, (body,), text)


def _let_go(way: Array, step: float, still: float) -> bool:
    """Whether it goes down, faster and faster from nothing: what gravity does, on a slope too."""
    s = (np.arange(len(way)) + 1) * step
    if way[-1, 1] < max(still, 0.1 * abs(way[-1, 0])):
        return False
    # how much of the last place would be there halfway: a quarter from rest under a steady pull, half after a blow
    half = float(np.interp(s[-1] / 2, s, np.hypot(way[:, 0], way[:, 1])))
    return half - still < 0.42 * float(np.hypot(*way[-1]))


def _set_moving(motion: Motion, body: int, early: int, frame: int) -> int | None:
    """Something near that moves then, or that touches something that does, and so on."""
    first, last = max(early - 3, 0), min(frame + 1, len(motion.tracks.times) - 1)
    asked, seen = [body], {body}
    while asked:
        one = asked.pop()
        for other in motion.near(one, first, last):
            if other in seen:
                continue
            if _moving(motion, other, first, last):
                return other
            seen.add(other)
            asked.append(other)
    return None


def _moving(motion: Motion, body: int, first: int, last: int) -> bool:
    path = motion.tracks.places[max(first - 1, 0) : last + 1, body]
    path = path[np.isfinite(path).all(axis=1)]
    return len(path) > 1 and bool(np.hypot(*(path[-1] - path[0])) > max(4 * motion.sigma[body], 0.2))
