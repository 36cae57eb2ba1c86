"""Rows of sliding and rolling along smooth curves."""

from __future__ import annotations

from math import sqrt

import numpy as np

from physgen.evaluate.physics.scorecard import Case, Draw, Errors, Measure, Row, Run
from physgen.evaluate.physics.staging import GRAVITY, circle, scene, segment

SMOOTH = {"friction": 0.0, "elasticity": 0.0}


def _loop(draw: Draw) -> list[Case]:
    """Return the case of a puck in a loop. Errors: deviation of v²/2 + g h over v0²/2
    after two turns, and of the distance to the loop's middle.

    A puck without friction keeps its energy. It needs v0² > 5 g R at the bottom.
    """
    radius = draw.number(100, 140, 1)
    ball = draw.number(8, 14)
    whole, side = radius - ball, draw.sign()
    # At the top, gravity alone must not pull the puck off the loop: v² > g R there, and
    # energy gives v0² > 5 g R at the bottom.
    square = draw.number(5.5, 8) * GRAVITY * whole
    speed = sqrt(square)
    objects = {
        "puck": circle(
            (240, 200 + whole),
            ball,
            mass=draw.mass(),
            velocity=[side * speed, 0],
            **SMOOTH,
        )
    }
    arc = {"center": [240.0, 200.0], "radius": radius}
    loop = {"loop": {"arc": arc, **SMOOTH}}
    # Two turns at a middle speed of the loop.
    duration = 2 * 2 * np.pi * whole / sqrt(square - 2 * GRAVITY * whole)

    def measure(run: Run) -> Errors:
        track = run.track("puck")
        fallen = track.displacements[:, 1]
        energy = track.speed**2 / 2 - GRAVITY * fallen
        # The change of height counts from the bottom, where the puck starts.
        off = abs(energy[-1] / (square / 2) - 1)
        far = np.hypot(track.x - 240, track.y - 200)
        return {
            "energy": float(off),
            "radius": float(np.abs(far / whole - 1).max()),
        }

    return [Case(scene((480, 400), duration, objects, loop), measure)]


def _slide(draw: Draw) -> list[Case]:
    """Return the case of a slide of Bézier curves. Error: deviation of the speed at its
    end over sqrt(v0² + 2 g h).
    """
    ball = draw.number(8, 14)
    speed = draw.number(40, 120, 0)
    drop = draw.number(120, 200, 1)
    side = draw.sign()
    top = 120.0

    def place(x: float, y: float) -> list[float]:
        return [320 + side * x, y]

    curve = [
        place(-300, top),
        place(-240, top),
        place(-200, top + 0.2 * drop),
        place(-150, top + 0.5 * drop),
        place(-100, top + 0.8 * drop),
        place(-60, top + drop),
        place(0, top + drop),
        place(100, top + drop),
        place(200, top + drop),
        place(300, top + drop),
    ]
    objects = {
        "puck": circle(
            place(-290, top - ball), ball, mass=draw.mass(),
            velocity=[side * speed, 0], **SMOOTH,
        )
    }  # fmt: skip
    # Without friction the speed depends on the height alone, whatever the shape of the
    # slide.
    exact = sqrt(speed**2 + 2 * GRAVITY * drop)

    def measure(run: Run) -> Errors:
        track = run.track("puck")
        # On the level end of the slide, the speed stays.
        distance = side * (track.x - 320)
        is_level = (distance > 60) & (distance < 290)
        if not is_level.any():
            return {"speed": 1.0}
        deviation = np.abs(track.speed[is_level] / exact - 1)
        return {"speed": float(deviation.max())}

    walls = {
        "slide": {"bezier": curve, **SMOOTH},
        "stop": segment(place(312, top), place(312, top + drop + 10), **SMOOTH),
    }
    document = scene((640, 400), 300 / speed + 0.2, objects, walls)
    return [Case(document, measure)]


ROWS = (
    Row(
        60, "loop", "loop on an exact arc", "v²/2 + g h stays",
        "arcs of 100 to 140 px, pucks of 8 to 14 px at v² of 5.5 to 8 g R, in either direction",
        "Deviation of the energy after two turns: 0.1 %; largest one of the distance to the middle: 0.5 %.",
        (Measure("energy", 1e-3), Measure("radius", 5e-3)), _loop,
    ),
    Row(
        61, "chute", "slide of Bézier curves", "v² = v0² + 2 g h",
        "slides of 120 to 200 px, pucks of 8 to 14 px at 40 to 120 px/s, to either side",
        "Speed on the flat end over its closed form: 0.3 %.",
        (Measure("speed", 3e-3),), _slide,
    ),
)  # fmt: skip
