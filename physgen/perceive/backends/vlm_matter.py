"""Samples of what a model judges of one object -> the matter of all things like it, within what physics allows."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import exp, log, sqrt
from typing import Any

import numpy as np

from physgen.outline.outline import Disc
from physgen.perceive.backends.vlm_answers import plain, record
from physgen.perceive.extent import sides
from physgen.perceive.roles import Matter, Thing
from physgen.scene.model import Solid

UNSEEN = 0.6
"""Spread of the log of a mass that somebody judges by eye: what one sample is held for, and what more add to."""
SUREST = 0.9
"""How sure the best agreement is: who agrees with himself may still be wrong."""
SAME = 0.05
"""Difference in length up to which two that are alike are taken to be the same: masks are no truer."""
DENSEST = 23.0
"""g/cm³: osmium, of all that there is (CRC)."""
RANGES: Mapping[str, tuple[float, float, str]] = {
    "mass": (1e-3, 1e7, "g"),
    "size": (1e-3, 50.0, "m"),
    "friction": (0.0, 1.5, ""),
    "elasticity": (0.0, 1.0, ""),
    "rolling": (0.0, 0.3, ""),
}
"""What is believed, with units: a grain to a lorry; more friction than rubber on dry asphalt has nothing in a room."""
SCHEMA = record(
    reason={
        "type": "string",
        "minLength": 1,
        "description": "One sentence: what it is, and where mass and size come from",
    },
    material={"type": "string", "minLength": 1, "description": "In a word or two"},
    size={"type": "number", "exclusiveMinimum": 0, "description": "Metres: its longest side"},
    solid={"type": "string", "enum": [solid.value for solid in Solid]},
    mass={"type": "number", "exclusiveMinimum": 0, "description": "Grams"},
    friction={"type": "number", "description": "Coulomb's coefficient, 0 to 1.5"},
    elasticity={"type": "number", "description": "0 to 1"},
    rolling={"type": "number", "description": "Coefficient of rolling resistance, 0 to 0.3"},
)
"""Of an answer; the reason comes first, so that it is thought before numbers are said."""


def impossible(answer: Mapping[str, Any]) -> list[str]:
    """What contradicts itself: no matter is so dense that a cube of its longest side weighs that much."""
    size, mass = answer["size"], answer["mass"]
    most = DENSEST * (100 * size) ** 3
    if mass <= most:
        return []
    return [f"mass: a thing whose longest side is {size:g} m cannot weigh {mass:g} g"]


def matter(
    answers: Sequence[Mapping[str, Any]], things: Sequence[Thing], asked: Thing, model: str
) -> Mapping[int, Matter]:
    """Of each of `things`, which are alike; `answers` are samples about `asked`, one of them.

    The medians count. Those that are a little larger than the one asked about are heavier by the cube of that.
    """
    clamped = [_clamped(answer) for answer in answers]
    value = {name: _middle([one[name] for one, _ in clamped], name) for name in RANGES}
    masses = [one["mass"] for one, _ in clamped]
    nearest = min(range(len(answers)), key=lambda k: abs(log(masses[k] / value["mass"])))
    said, notes = answers[nearest], clamped[nearest][1]
    first = [plain(said["reason"], 240).rstrip(".")]
    if len(answers) > 1:
        first.append(f"the median of {len(answers)} answers from {min(masses):.3g} to {max(masses):.3g} g")
    if len(things) > 1:
        first.append(f"asked once for {len(things)} alike")
    first += [note for name, note in notes.items() if name in ("mass", "size")]
    material = plain(said["material"], 60)
    surface = [f"{material}, as {plain(model, 60)} judges"]
    surface += [note for name, note in notes.items() if name not in ("mass", "size")]
    result = {}
    for thing in things:
        larger = sides(thing.outline)[0] / sides(asked.outline)[0]
        larger = larger if abs(larger - 1) > SAME else 1.0
        result[thing.id] = Matter(
            mass=float(f"{value['mass'] * larger**3:.3g}"),
            friction=round(value["friction"], 3),
            elasticity=round(value["elasticity"], 3),
            rolling=float(f"{value['rolling']:.2g}"),
            # only circles have another moment than that of their area
            solid=Solid(said["solid"]) if isinstance(thing.outline, Disc) else Solid.PLATE,
            confidence=sureness(masses),
            reason="; ".join(first),
            surface="; ".join(surface),
            size=float(f"{value['size'] * larger:.3g}"),
            material=material,
        )
    return result


def sureness(masses: Sequence[float]) -> float:
    """0..1 from how far samples of a mass are from each other; one alone tells little.

    >>> sureness([170]), sureness([170, 170, 170]), sureness([100, 170, 300])
    (0.49, 0.64, 0.51)
    """
    logs = np.log(masses)
    scatter = float(((logs - logs.mean()) ** 2).sum())
    return round(SUREST * exp(-sqrt((scatter + UNSEEN**2) / len(logs))), 2)


def _clamped(answer: Mapping[str, Any]) -> tuple[dict[str, float], dict[str, str]]:
    """The numbers within their ranges, and a note for each that was not."""
    numbers, notes = {}, {}
    for name, (least, most, unit) in RANGES.items():
        said = float(answer[name])
        numbers[name] = min(max(said, least), most)
        if numbers[name] != said:
            unit = f" {unit}" if unit else ""
            notes[name] = f"{name} {said:g}{unit} was said and is out of range: {numbers[name]:g}{unit} taken"
    return numbers, notes


def _middle(values: Sequence[float], name: str) -> float:
    """The median; of masses and sizes that of their logarithms."""
    if name in ("mass", "size"):
        return float(np.exp(np.median(np.log(values))))
    return float(np.median(values))
