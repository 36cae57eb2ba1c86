"""Does nothing on a table speed up by itself? Seen from above, where friction only slows."""

from __future__ import annotations

import numpy as np

from physgen.evaluate.plausibility.evidence import Asked, Evidence
from physgen.evaluate.plausibility.motion import Motion
from physgen.evaluate.plausibility.stretches import Stretch
from physgen.scene.scene import View

FEWEST = 6
"""Frames."""
SURE = 2.5
"""Standard deviations that noise may account for."""
LASTS = 0.5
"""s after a blow, at most, in which spin gives back speed."""
FOLLOW = 2 / 7
"""Of the speed that a ball has lost in blows, its spin gives back: a follow shot (any billiards text)."""


def speeding(motion: Motion) -> Asked:
    """Each stretch that nothing touches: how much faster it ends than it began, over its speed."""
    if motion.tracks.view is View.SIDE:
        return Asked((), "seen from the side: what falls speeds up")
    found = []
    for k in range(len(motion.tracks.names)):
        if not motion.free(k) or k in motion.tracks.given.spun or not motion.moves[k]:
            continue
        for stretch in motion.stretches[k]:
            if stretch.count >= FEWEST and _alone(motion, k, stretch):
                evidence = _judged(motion, k, stretch, _came_at(motion, k, stretch))
                if evidence is not None:
                    found.append(evidence)
    return Asked.of(found, "nothing moves by itself for long enough")


def _alone(motion: Motion, thing: int, stretch: Stretch) -> bool:
    tracks = motion.tracks
    if motion.was_pushed(thing, tracks.times[stretch.first], tracks.times[stretch.last]):
        return False
    inner = slice(stretch.first + 1, stretch.last)
    gaps = [motion.clearance.to_walls(thing)[inner]]
    gaps += [motion.clearance.least(thing, k)[inner] for k in range(len(tracks.names)) if k != thing]
    return all(np.nanmin(gap, initial=np.inf) > 0.5 + 3 * motion.sigma[thing] for gap in gaps)


def _came_at(motion: Motion, thing: int, stretch: Stretch) -> float:
    """px/s that it ever went, where blows were not long before, else 0: spin may stem from the first of them."""
    first = max(0, stretch.first - int(np.ceil(LASTS / motion.tracks.step)))
    sudden = any(turn.sudden and first <= turn.frame < stretch.first for turn in motion.turns[thing])
    vague = any(not s.good and s.last >= first and s.last < stretch.first for s in motion.stretches[thing])
    if not (sudden or vague):
        return 0.0
    steps = motion.steps[: stretch.first, thing]
    return float(np.nanmax(np.hypot(steps[:, 0], steps[:, 1]), initial=0.0)) / motion.tracks.step


def _speed(motion: Motion, stretch: Stretch, frame: int) -> float:
    return float(np.hypot(*stretch.velocity(float(motion.tracks.times[frame]))))


def _judged(motion: Motion, thing: int, stretch: Stretch, came: float) -> Evidence | None:
    begin, end = (_speed(motion, stretch, frame) for frame in (stretch.first, stretch.last))
    seconds = (stretch.count - 1) * motion.tracks.step
    if max(begin, end) * seconds < max(2.0, 8 * float(motion.sigma[thing])):
        return None
    # few frames tell little of their own noise, too: Student's t grows about so
    error = stretch.acceleration_error * seconds * (1 + 4 / (stretch.count - 3))
    returned = FOLLOW * max(0.0, came - begin)
    gained = max(0.0, end - begin - returned - SURE * error)
    name = motion.tracks.names[thing]
    text = f"{name}: {begin:.0f} px/s at frame {stretch.first}, {end:.0f} px/s at frame {stretch.last}"
    usual = max(begin, 0.25 * end)
    return Evidence(gained / usual, stretch.last, (thing,), text)
