"""Do two that meet push each other, as their masses allow? Where nothing else can have pushed."""

from __future__ import annotations

import numpy as np

from physgen.evaluate.plausibility.blows import Blow, Part, blows
from physgen.evaluate.plausibility.evidence import Asked, Evidence
from physgen.evaluate.plausibility.motion import Motion
from physgen.evaluate.plausibility.questions.gravity import common
from physgen.evaluate.plausibility.stretches import Stretch
from physgen.evaluate.plausibility.tracks import Array
from physgen.scene.scene import View

SURE = 2.5
"""Standard deviations that noise may account for."""
KNOWN, GUESSED = 1.05, 12.0
"""Factors by which a ratio of masses may be off: as weighed, and as areas are."""
TRIES = 121


def momentum(motion: Motion) -> Asked:
    """Each meeting of two that are free, seen from above or in flight; what is missing over what was given."""
    pulled = common(motion)
    found = []
    for blow in blows(motion):
        if len(blow.parts) == 2 and _free(motion, blow, pulled):
            found.append(_judged(motion, blow))
    return Asked.of(found, "no two free things meet by themselves")


def _free(motion: Motion, blow: Blow, pulled: Array | None) -> bool:
    side = motion.tracks.view is View.SIDE and not motion.tracks.flat
    if side and pulled is None:
        return False
    for part in blow.parts:
        if not motion.moves[part.thing] or part.before is part.after:
            return False
        if part.after.first - part.before.last > 1:  # what lies between may have been another blow
            return False
        if motion.near_wall(part.thing, part.before.last, part.after.first):
            return False
        if side and not all(_in_flight(s, pulled) for s in (part.before, part.after)):
            return False
    return True


def _in_flight(stretch: Stretch, pulled: Array | None) -> bool:
    assert pulled is not None
    size, error = float(np.hypot(*pulled)), stretch.acceleration_error
    return bool(error < 0.2 * size and np.hypot(*(stretch.acceleration - pulled)) < 0.2 * size + 2 * error)


def _judged(motion: Motion, blow: Blow) -> Evidence:
    one, other = blow.parts
    tracks = motion.tracks
    ratio = float(tracks.masses[other.thing] / tracks.masses[one.thing])
    off = KNOWN if tracks.weighed else GUESSED
    best, chosen = np.inf, ratio
    for factor in np.geomspace(1 / off, off, TRIES):
        missing = _missing(one, other, ratio * float(factor))
        if missing < best:
            best, chosen = missing, ratio * float(factor)
    pulled = _pulled(motion, one, other)
    names = f"{tracks.names[one.thing]} and {tracks.names[other.thing]}"
    changes = (
        f"{tracks.names[one.thing]} changes by {np.hypot(*one.change):.0f} px/s, "
        f"{tracks.names[other.thing]} by {np.hypot(*other.change):.0f} px/s"
    )
    if pulled > best:
        return Evidence(
            pulled, blow.frame, blow.things, f"{names}: draw each other nearer as they meet; {changes}"
        )
    masses = "as weighed" if tracks.weighed else f"at masses of 1 to {chosen:.3g}"
    text = f"{names}: {best:.0%} of the momentum that passes is missing, {masses}; {changes}"
    return Evidence(best, blow.frame, blow.things, text)


def _missing(one: Part, other: Part, ratio: float) -> float:
    """What both momenta change by, which is nothing in nature, over what passes between them."""
    total = float(np.hypot(*(one.change + ratio * other.change)))
    error = SURE * float(np.hypot(one.error, ratio * other.error))
    passes = float(np.hypot(*one.change) + ratio * np.hypot(*other.change))
    return max(0.0, total - error) / passes


def _pulled(motion: Motion, one: Part, other: Part) -> float:
    """By which part of its change a round thing was drawn to the other."""
    if not all(motion.tracks.forms[part.thing].round for part in (one, other)):
        return 0.0
    apart = one.place - other.place
    size = float(np.hypot(*apart))
    if size == 0:
        return 0.0
    worst = 0.0
    for part, sign in ((one, 1.0), (other, -1.0)):
        change = float(np.hypot(*part.change))
        if change > 0:
            away = sign * float(part.change @ apart) / size
            worst = max(worst, (-away - SURE * part.error) / change)
    return worst
