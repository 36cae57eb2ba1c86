"""Does nothing part faster than it came? Along the blow, seen from what was hit."""

from __future__ import annotations

import numpy as np

from physgen.evaluate.plausibility.blows import Part, blows
from physgen.evaluate.plausibility.evidence import Asked, Evidence
from physgen.evaluate.plausibility.motion import Motion
from physgen.evaluate.plausibility.tracks import Array

SURE = 2.5
"""Standard deviations that noise may account for."""
SPIN = 4
"""Frames before and after a blow that tell how fast a thing turns."""
UNSEEN = 0.1
"""Of its energy, at most, that a round thing that shows no angle is taken to get out of its spin."""
SLOW = 0.3
"""Of the speeds that a thing has at all: slower blows are measured by it."""


def energy(motion: Motion) -> Asked:
    """Each blow: parting over closing speed along the change of velocity, less what spin gave."""
    found = []
    for blow in blows(motion):
        if any(_spin_energy(motion, part) is None for part in blow.parts):
            continue
        told = max(_of_one(motion, part) for part in blow.parts if part.shown)
        if len(blow.parts) == 2:
            # who knows whether they touched each other, or each something without a track: the kinder reading counts
            told = min(told, _of_two(motion, *blow.parts))
        deviation, parting, closing = told
        names = " and ".join(motion.tracks.names[k] for k in blow.things)
        text = f"{names}: parts at {max(parting, 0):.0f} px/s, came at {max(closing, 0):.0f} px/s"
        found.append(Evidence(deviation, blow.frame, blow.things, text))
    return Asked.of(found, "no blow can be told from the frames around it")


def _of_one(motion: Motion, part: Part) -> tuple[float, float, float]:
    spin = _spin_energy(motion, part) or 0.0
    return _gain(part.arrives, part.leaves, part.error, spin, _usual(motion, part.thing))


def _of_two(motion: Motion, one: Part, other: Part) -> tuple[float, float, float]:
    spin = (_spin_energy(motion, one) or 0.0) + (_spin_energy(motion, other) or 0.0)
    error = float(np.hypot(one.error, other.error))
    usual = max(_usual(motion, one.thing), _usual(motion, other.thing))
    return _gain(one.arrives - other.arrives, one.leaves - other.leaves, error, spin, usual)


def _gain(
    arrives: Array, leaves: Array, error: float, spin: float, usual: float
) -> tuple[float, float, float]:
    """How much faster it parts, over closing; both speeds, px/s."""
    change = leaves - arrives
    size = float(np.hypot(*change))
    if size == 0:
        return 0.0, 0.0, 0.0
    closing, parting = float(-arrives @ change) / size, float(leaves @ change) / size
    allowed = np.sqrt(max(closing, 0.0) ** 2 + spin)
    return max(0.0, parting - allowed - SURE * error) / max(closing, SLOW * usual), parting, closing


def _usual(motion: Motion, thing: int) -> float:
    """px/s that it is fast at times."""
    steps = motion.steps[:, thing]
    lengths = np.hypot(steps[:, 0], steps[:, 1])
    lengths = lengths[np.isfinite(lengths)]
    return max(float(np.quantile(lengths, 0.9)), 1.0) / motion.tracks.step


def _spin_energy(motion: Motion, part: Part) -> float | None:
    """px²/s²: twice what turning slower gave, a unit of mass; None where that cannot be told.

    Of what is round, and shows no angle, a rolling ball's.
    """
    form = motion.tracks.forms[part.thing]
    if not part.shown:
        return 0.0
    first, last = part.before.last, part.after.first
    before = motion.spin(part.thing, max(part.before.first, first - SPIN), first)
    after = motion.spin(part.thing, last, min(part.after.last, last + SPIN))
    if before is None or after is None:
        return UNSEEN * float(part.arrives @ part.arrives) if form.round else None
    if not form.round and not (before.steady and after.steady):
        return None
    return float(max(0.0, form.gyration**2 * (before.rate**2 - after.rate**2)))
