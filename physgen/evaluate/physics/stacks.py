"""Rows of boxes that stand, fall over and knock each other down."""

from __future__ import annotations

from math import asin, atan2, cos, sin, sqrt

import numpy as np
from numpy.typing import NDArray

from physgen.evaluate.physics.events import crossings
from physgen.evaluate.physics.scorecard import (
    Case,
    Draw,
    Errors,
    Measure,
    Row,
    Run,
    Unit,
    worst,
)
from physgen.evaluate.physics.staging import GRAVITY, box, scene, segment

Array = NDArray[np.float64]

TAKEN = {
    "left-corner": (("box-1-1", "box-1-2"), "box-2-1"),
    "right-corner": (("box-1-5", "box-1-6"), "box-2-5"),
    "left-under-top": (("box-5-1",), "box-6-1"),
    "right-under-top": (("box-5-2",), "box-6-1"),
    "lifted": ((), "box-6-1"),
}
"""A draw each: what is taken away from the pyramid, and what must fall then. The last lifts the top by 5 px instead."""


def _pyramid(draw: Draw) -> list[Case]:
    """Largest displacement of any box in 5 s; and 1 where the box that lost its support does not fall."""
    size = (draw.number(30, 44, 0), draw.number(18, 32, 0))
    apart = size[0] + draw.number(4, 8, 0)
    surface = {"friction": draw.number(0.4, 0.8), "elasticity": draw.number(0, 0.4)}
    objects = {}
    for level in range(1, 7):
        for k in range(1, 8 - level):
            at = (220 + (k - (8 - level) / 2) * apart, 260 - (level - 0.5) * size[1])
            objects[f"box-{level}-{k}"] = box(
                at, size, mass=draw.number(60, 180, 0), **surface
            )
    floor = {"floor": segment((0, 260), (440, 260), **surface)}

    def still(run: Run) -> Errors:
        return {
            "at rest": worst(
                [np.hypot(*run.track(name).moved.T).max() for name in objects]
            )
        }

    label, (taken, falls) = list(TAKEN.items())[draw.index]
    changed = {name: object for name, object in objects.items() if name not in taken}
    if not taken:
        x, y = changed[falls]["shape"]["box"]["center"]
        changed[falls] = {
            **changed[falls],
            "shape": {"box": {"center": [x, y - 5.0], "size": list(size)}},
        }

    def fallen(run: Run) -> Errors:
        way = float(run.track(falls).moved[-1, 1])
        return {"falls": float(not (way > 5 if taken else abs(way - 5) < 0.5))}

    return [
        Case(scene((440, 280), 5.0, objects, floor), still, rate=60),
        Case(scene((440, 280), 1.0, changed, floor), fallen, label, rate=60),
    ]


def _dominoes(draw: Draw) -> list[Case]:
    """Speed of the wave under 4 g over that under g, against 2.

    A domino starts as it has turned by 3 degrees; the wave's speed is taken between the fourth and the eighth of ten.
    The first one leans beyond its balance and falls from rest, so that gravity alone sets the time.
    """
    height, thick = draw.number(56, 80, 0), draw.number(5, 7, 0)
    apart = round(height * draw.number(0.45, 0.6))
    surface = {"friction": draw.number(0.3, 0.5), "elasticity": draw.number(0, 0.2)}
    mass, ground = draw.number(10, 60, 0), 160.0
    lean = (
        atan2(thick, height) + asin((apart - thick) / height)
    ) / 2  # between balance and touching the second
    objects = {}
    for k in range(1, 11):
        x = 40.0 + k * apart
        at = (x, ground - height / 2)
        if k == 1:  # stands on its lower right corner, where it would stand upright too
            at = (
                x + thick / 2 - thick / 2 * cos(lean) + height / 2 * sin(lean),
                ground - thick / 2 * sin(lean) - height / 2 * cos(lean),
            )
        turned = float(np.degrees(lean)) if k == 1 else 0.0
        objects[f"domino-{k}"] = box(at, (thick, height), turned, mass=mass, **surface)

    def time(run: Run, k: int) -> float:
        track = run.track(f"domino-{k}")
        passed = crossings(track.times, track.angle - np.radians(3), track.spin)
        return float(passed[0]) if len(passed) else np.inf

    def measure(plain: Run, heavy: Run) -> Errors:
        lasted = [time(run, 8) - time(run, 4) for run in (plain, heavy)]
        return {"ratio": abs(lasted[0] / lasted[1] / 2 - 1)}

    # the wave runs at over 0.8 sqrt(g L)
    duration = 0.5 + 13 * apart / sqrt(GRAVITY * height)
    width = 100 + 11 * int(apart)
    text = scene(
        (width, 200), duration, objects, {"floor": segment((0, ground), (width, ground), **surface)},
        world={"gravity": [0, GRAVITY]}, variants={"four-g": {"world.gravity": [0, 4 * GRAVITY]}},
    )  # fmt: skip
    return [Case(text, measure, variants=(None, "four-g"), rate=480)]


def _weights(draw: Draw) -> list[Case]:
    """Mean force between a box and the one below over the weight above, from contact impulses in the second half."""
    count, size = 4, (draw.number(60, 90, 0), draw.number(24, 36, 0))
    surface = {"friction": draw.number(0.3, 0.8), "elasticity": draw.number(0, 0.4)}
    masses = [draw.mass() for _ in range(count)]
    objects = {
        f"box-{k}": box((130, 200 - (k - 0.5) * size[1]), size, mass=mass, **surface)
        for k, mass in enumerate(masses, 1)
    }

    def measure(run: Run) -> Errors:
        errors = []
        for k in range(1, count + 1):
            below = "floor" if k == 1 else f"box-{k - 1}"
            force = -run.impulse(f"box-{k}", below, 0.5, 1.0)[1] / 0.5
            errors.append(abs(force / (sum(masses[k - 1 :]) * GRAVITY) - 1))
        return {"force": worst(errors)}

    floor = {"floor": segment((0, 200), (260, 200), **surface)}
    return [Case(scene((260, 230), 1.0, objects, floor), measure)]


def _falling_over(draw: Draw) -> list[Case]:
    """Deviation of the spin, over the last one that counts; displacement of the middle aside, over the height."""
    size = (draw.number(10, 24), draw.number(80, 130))
    lean, side = (
        draw.number(5, 20) + float(np.degrees(atan2(size[0], size[1]))),
        draw.sign(),
    )
    mass, half = draw.mass(), np.array(size) / 2

    def height(angle: Array) -> Array:
        return np.asarray(half[1] * np.cos(angle) + half[0] * np.sin(angle))

    start = np.radians(lean)
    objects = {
        "plank": box(
            (180, 160 - float(height(start))),
            size,
            side * lean,
            mass=mass,
            friction=0.0,
            elasticity=0.0,
        )
    }

    def measure(run: Run) -> Errors:
        track, body = run.track("plank"), run.body("plank")
        angle = start + side * track.angle
        falling = angle < np.radians(80)
        falling &= np.arange(len(angle)) < (
            np.argmin(falling) or len(angle)
        )  # up to the first time
        lever = half[0] * np.cos(angle) - half[1] * np.sin(angle)
        drop = np.maximum(height(np.array(start)) - height(angle), 0)
        exact = np.sqrt(2 * GRAVITY * drop / (body.moment / body.mass + lever**2))
        off = np.abs(side * track.spin - exact)[falling].max() / exact[falling][-1]
        aside = np.abs(track.moved[falling, 0]).max() / size[1]
        return {"spin": worst([off, aside, float(angle[falling][-1] < 1.0)])}

    floor = {"floor": segment((0, 160), (360, 160), friction=0.0, elasticity=0.0)}
    return [Case(scene((360, 190), 0.9, objects, floor), measure, rate=480)]


ROWS = (
    Row(
        16, "pyramid", "pyramid of 21 boxes at rest, 5 s", "nothing moves, and not by sleeping: what loses its support "
        "falls",
        "boxes of 30 to 44 x 18 to 32 px, 4 to 8 px apart, 60 to 180 g each, mu 0.4 to 0.8; then without two corner "
        "boxes (left, right), without either box under the top, and with the top lifted by 5 px, a draw each",
        "Largest displacement of any box. Falls: by over 5 px in 1 s; the lifted one by 5 px, to half a pixel.",
        (Measure("at rest", 0.5, Unit.PX), Measure("falls", 0, Unit.SWITCH)), _pyramid,
    ),
    Row(
        17, "dominoes", "domino wave under 4 g", "its speed doubles: v = sqrt(g L) G(d/L)",
        "ten dominoes of 56 to 80 x 5 to 7 px, 0.45 to 0.6 heights apart, mu 0.3 to 0.5, e to 0.2",
        "Ratio of the times from the fourth to the eighth, over 2. Source: dimensional analysis.",
        (Measure("ratio", 1e-2),), _dominoes,
    ),
    Row(
        39, "falling-over", "plank falling over on a frictionless floor",
        "w² = 2 g (y0 - y)/(I/m + (dy/da)²), the middle falls straight down",
        "planks of 10 to 24 x 80 to 130 px, 5 to 20 degrees beyond balance, to either side",
        "Deviation of the spin up to 80 degrees, over its last value; displacement aside over the length. Energy of a "
        "body that glides on its corner; smooth motion, so 0.3 %.",
        (Measure("spin", 3e-3),), _falling_over,
    ),
    Row(
        40, "weights", "forces inside a stack at rest", "each level carries the weight above it",
        "four boxes of 60 to 90 x 24 to 36 px, 20 to 500 g each",
        "Contact impulses of half a second over weight times time, each level by itself; 0.3 %: what is at rest is in "
        "balance, so only what moves unseen can spoil it.",
        (Measure("force", 3e-3),), _weights,
    ),
)  # fmt: skip
