"""Does nothing on a table speed up by itself? Seen from above, where friction only slows."""

from __future__ import annotations

import numpy as np

from physgen.evaluate.plausibility.evidence import Asked, Evidence
from physgen.evaluate.plausibility.motion import Motion
from physgen.evaluate.plausibility.stretches import Stretch
from physgen.scene.model import View

FEWEST = 6
"""Frames."""
SURE = 2.5
"""Standard deviations that noise may account for."""
FOLLOW = 2 / 7
"""Of the speed that a ball has lost in a blow, its spin gives back: a follow shot (any billiards text)."""


def speeding(motion: Motion) -> Asked:
    """Each stretch that nothing touches: how much faster it ends than it began, over its speed."""
    if motion.tracks.view is View.SIDE:
        return Asked((), "seen from the side: what falls speeds up")
    found = []
    for k in range(len(motion.tracks.names)):
        if not motion.free(k) or k in motion.tracks.given.spun or not motion.moves[k]:
            continue
        fastest = 0.0
        for stretch in motion.stretches[k]:
            if stretch.count >= FEWEST and _alone(motion, k, stretch):
                evidence = _judged(motion, k, stretch, fastest)
                if evidence is not None:
                    found.append(evidence)
            if stretch.good:
                fastest = max(fastest, _speed(motion, stretch, stretch.first))
    return Asked.of(found, "nothing moves by itself for long enough")


def _alone(motion: Motion, thing: int, stretch: Stretch) -> bool:
    tracks = motion.tracks
    first, last = stretch.first + 1, stretch.last - 1
    pushed = motion.was_pushed(thing, tracks.times[stretch.first], tracks.times[stretch.last])
    return not pushed and not motion.near(thing, first, last) and not motion.near_wall(thing, first, last)


def _speed(motion: Motion, stretch: Stretch, frame: int) -> float:
    return float(np.hypot(*stretch.velocity(float(motion.tracks.times[frame]))))


def _judged(motion: Motion, thing: int, stretch: Stretch, fastest: float) -> Evidence | None:
    begin, end = (_speed(motion, stretch, frame) for frame in (stretch.first, stretch.last))
    seconds = (stretch.count - 1) * motion.tracks.step
    if max(begin, end) * seconds < max(2.0, 8 * float(motion.sigma[thing])):
        return None
    error = stretch.acceleration_error * seconds
    returned = FOLLOW * max(0.0, fastest - begin)
    gained = max(0.0, end - begin - returned - SURE * error)
    name = motion.tracks.names[thing]
    text = f"{name}: {begin:.0f} px/s at frame {stretch.first}, {end:.0f} px/s at frame {stretch.last}"
    usual = max(begin, fastest, 0.25 * end)
    return Evidence(gained / usual, stretch.last, (thing,), text)
