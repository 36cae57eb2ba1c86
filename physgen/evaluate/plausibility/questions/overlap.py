"""Does nothing go through another thing? How deep outlines lie over each other, in frames and between them."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from physgen.evaluate.plausibility.evidence import Asked, Evidence
from physgen.evaluate.plausibility.motion import Motion
from physgen.evaluate.plausibility.tracks import Array, runs

LONGEST = 0.5
"""s of a gap in a track that can be bridged."""
SHIFTED = 0.4
"""px, root mean square: centroids of what is just about to be hidden are off by some."""
SIDES = (6, 4, 3)
"""Frames on each side of it that the bridge stands on, at most: fewer, where something was hit there."""
PARTS = 4
"""Moments looked at between two frames."""


def overlap(motion: Motion) -> Asked:
    """Each pair that comes near; depth beyond the one of the first frames, in parts of the smaller core."""
    tracks = motion.tracks
    found = []
    for one in range(len(tracks.names)):
        for other in range(one):
            if (other, one) in tracks.given.joined or (one, other) in tracks.given.joined:
                continue
            evidence = _pair(motion, other, one)
            if evidence is not None:
                found.append(evidence)
    return Asked.of(found, "no two things with outlines come near each other")


def _pair(motion: Motion, one: int, other: int) -> Evidence | None:
    tracks = motion.tracks
    a, b = tracks.forms[one], tracks.forms[other]
    gap = motion.clearance.most(one, other)
    known = np.isfinite(gap)
    if not known.any():
        return None
    if min(a.thin, b.thin) <= 0:
        return None
    hidden, at_hidden = _hidden(motion, one, other)
    if hidden <= 0 and np.nanmin(motion.clearance.least(one, other)) > motion.margin(
        one, other, 0, len(gap) - 1
    ):
        return None
    start = max(0.0, -float(gap[known][:2].min()))
    depth, frame = float(-gap[known].min()), int(np.flatnonzero(known)[np.argmin(gap[known])])
    between, at = _between(motion, one, other)
    if between > depth:
        depth, frame = between, at
    if hidden > depth:
        depth, frame = hidden, at_hidden
    noise = 3 * float(np.hypot(motion.sigma[one], motion.sigma[other]))
    beyond = max(0.0, depth - 1.2 * start - noise - 1.0)
    names = f"{tracks.names[one]} and {tracks.names[other]}"
    size = min(a.thin, b.thin)
    if beyond == 0:
        return Evidence(0.0, frame, (one, other), f"{names}: come near, and stay apart")
    text = f"{names}: {depth:.1f} px deep in each other at frame {frame}" + (
        f", {start:.1f} px at the start" if start > 0.5 else ""
    )
    return Evidence(beyond / size, frame, (one, other), text)


def _between(motion: Motion, one: int, other: int) -> tuple[float, int]:
    """The deepest between frames in which neither turns suddenly, of discs about both places; and the frame before."""
    tracks = motion.tracks
    cores = [tracks.forms[thing].core for thing in (one, other)]
    if min(cores) <= 0:
        return 0.0, 0
    reach = sum(cores)
    away: Array = tracks.places[:, one] - tracks.places[:, other]
    turning = np.zeros(len(away) - 1, bool)
    for thing in (one, other):
        ends = [s.last for s in motion.stretches[thing]]
        turning[[e for e in ends if e < len(turning)]] = True
    depth, frame = 0.0, 0
    for k in range(1, PARTS):
        part = k / PARTS
        far = np.hypot(*((1 - part) * away[:-1] + part * away[1:]).T)
        deep = np.where(turning | ~np.isfinite(far), 0.0, reach - far)
        if deep.max(initial=0.0) > depth:
            frame = int(np.argmax(deep))
            depth = float(deep[frame])
    return depth, frame


def _hidden(motion: Motion, one: int, other: int) -> tuple[float, int]:
    """The deepest while one hides the other: its way goes on smoothly behind it, as nothing that was hit does."""
    tracks = motion.tracks
    cores = [tracks.forms[thing].core for thing in (one, other)]
    if min(cores) <= 0:
        return 0.0, 0
    reach = sum(cores)
    ways = [_bridged(motion, thing) for thing in (one, other)]
    away = ways[0] - ways[1]
    far = np.hypot(away[:, 0], away[:, 1])
    gone = ~(tracks.seen[:, one] & tracks.seen[:, other]) & np.isfinite(far)
    if not gone.any():
        return 0.0, 0
    deep = np.where(gone, reach - far, 0.0)
    frame = int(np.argmax(deep))
    return float(deep[frame]), frame


def _bridged(motion: Motion, thing: int) -> Array:
    """(T, 2): places, and in short gaps those of the parabola through the frames around it, if there is one."""
    tracks = motion.tracks
    path = tracks.places[:, thing].copy()
    known = runs(tracks.seen[:, thing])
    for (first, end), (begin, last) in pairwise(known):
        if (begin - end + 1) * tracks.step > LONGEST:
            continue
        for side in SIDES:
            rows = np.concatenate(
                [np.arange(max(first, end - side), end), np.arange(begin, min(last, begin + side))]
            )
            s = tracks.times[rows] - tracks.times[end]
            columns = np.stack([np.ones(len(s)), s, s * s / 2], axis=1)
            terms = np.linalg.pinv(columns) @ tracks.places[rows, thing]
            left = tracks.places[rows, thing] - columns @ terms
            if len(rows) > 4 and np.sqrt((left**2).mean()) <= 2.5 * motion.sigma[thing] + SHIFTED:
                gap = tracks.times[end:begin] - tracks.times[end]
                path[end:begin] = np.stack([np.ones(len(gap)), gap, gap * gap / 2], axis=1) @ terms
                break
    return path
