"""Rows of what holds bodies in: thin walls that fast balls hit, and a hollow that a ball falls into."""

from __future__ import annotations

from math import cos, sin

import numpy as np

from physgen.evaluate.physics.impacts import FLOATING
from physgen.evaluate.physics.scorecard import (
    Case,
    Document,
    Draw,
    Errors,
    Measure,
    Row,
    Run,
    Unit,
)
from physgen.evaluate.physics.staging import box, circle, scene, segment

FAST = (2, 5, 10, 15, 20)
"""Radii a step of 1/960 s, a draw each."""


def _thin_walls(draw: Draw) -> list[Case]:
    """1 if a ball is ever outside its half of the room."""
    objects: dict[str, Document] = {}
    walls = {}
    for k, e in enumerate((1.0, 0.5)):
        top = 20.0 + 180 * k
        bounce = {"friction": 0.0, "elasticity": e}
        corners = [
            [20.0, top],
            [480.0, top],
            [480.0, top + 160],
            [20.0, top + 160],
            [20.0, top],
        ]
        walls[f"room-{k}"] = {"polyline": corners, **bounce}
        objects[f"partition-{k}"] = box(
            (250, top + 80), (1.0, 170.0), motion="static", **bounce
        )
        for side in (-1, 1):
            radius, angle = draw.number(3, 6), np.radians(draw.number(-70, 70, 1))
            speed = FAST[draw.index] * radius * 960
            at = (250 + side * draw.number(40, 180), top + draw.number(30, 130))
            objects[f"ball-{k}-{'left' if side < 0 else 'right'}"] = circle(
                at, radius, mass=draw.mass(), velocity=[-side * speed * cos(angle), speed * sin(angle)], **bounce
            )  # fmt: skip

    def measure(run: Run) -> Errors:
        out = False
        for name in objects:
            if not name.startswith("ball"):
                continue
            track, top = run.track(name), 20 + 180 * int(name.split("-")[1])
            low, high = (20, 250) if name.endswith("left") else (250, 480)
            inside = (
                (track.x > low)
                & (track.x < high)
                & (track.y > top)
                & (track.y < top + 160)
            )
            out |= not bool(inside.all())
        return {"inside": float(out)}

    return [
        Case(scene((500, 380), 0.2, objects, walls, world=FLOATING), measure, rate=960)
    ]


def _hollow(draw: Draw) -> list[Case]:
    """1 unless the ball ends inside the U, on its floor, to half a pixel."""
    inner, depth, thick = (
        draw.number(70, 120, 0),
        draw.number(60, 110, 0),
        draw.number(10, 20, 0),
    )
    radius = draw.number(12, 24)
    loose = draw.index % 2 == 0
    left, right, base = 200 - inner / 2, 200 + inner / 2, 320.0
    rim, bottom = base - thick - depth, base - thick
    outline = [
        [left - thick, base], [left - thick, rim], [left, rim], [left, bottom],
        [right, bottom], [right, rim], [right + thick, rim], [right + thick, base],
    ]  # fmt: skip
    surface = {"friction": draw.number(0.3, 0.8), "elasticity": draw.number(0, 0.5)}
    aside = draw.number(-0.8, 0.8) * (inner / 2 - radius)
    objects: dict[str, Document] = {
        "hollow": {
            "shape": {"polygon": outline},
            **({"mass": 2000.0} if loose else {"motion": "static"}),
            **surface,
        },
        "ball": circle(
            (200 + aside, draw.number(60, 100)),
            radius,
            mass=draw.number(20, 200, 0),
            **surface,
        ),
    }

    def measure(run: Run) -> Errors:
        ball, hollow = run.track("ball"), run.track("hollow")
        x, y = ball.at[-1] - hollow.moved[-1]
        inside = (
            left + radius - 0.5 < x < right - radius + 0.5
            and abs(y - (bottom - radius)) < 0.5
        )
        return {"inside": float(not (inside and abs(hollow.angle[-1]) < 0.01))}

    return [
        Case(
            scene(
                (400, 360),
                2.5,
                objects,
                {"floor": segment((0, 320), (400, 320), **surface)},
            ),
            measure,
        )
    ]


ROWS = (
    Row(
        24, "thin-walls", "fast small balls at thin walls", "none gets through",
        "2, 5, 10, 15, 20 radii a step at 960 steps a second; radii 3 to 6 px; segments, corners and a box of 1 px; "
        "e 1 and 0.5",
        "At 960 samples a second, every ball is in its half of the room.",
        (Measure("inside", 0, Unit.SWITCH),), _thin_walls,
    ),
    Row(
        25, "hollow", "concave outline (a U), ball dropped in", "rests inside, on the floor of the U",
        "70 to 120 px wide, 60 to 110 deep, fixed or loose; balls of 12 to 24 px dropped anywhere between the walls",
        "After 2.5 s the ball is between the walls, and its height is that of the floor to 0.5 px.",
        (Measure("inside", 0, Unit.SWITCH),), _hollow,
    ),
)  # fmt: skip
