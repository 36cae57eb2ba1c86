"""Rows of what hits leave unchanged: energy of an elastic gas, momentum and angular momentum."""

from __future__ import annotations

from math import cos, hypot, sin

import numpy as np

from physgen.evaluate.physics.impacts import FLOATING, toward
from physgen.evaluate.physics.scorecard import (
    Case,
    Document,
    Draw,
    Errors,
    Measure,
    Row,
    Run,
    worst,
)
from physgen.evaluate.physics.staging import Point, box, circle, scene


def _gas(draw: Draw) -> list[Case]:
    """Largest change of kinetic energy over its first value; 1 if a ball gets out."""
    width, height = 400.0, 300.0
    corners = [
        [20.0, 20.0],
        [20 + width, 20.0],
        [20 + width, 20 + height],
        [20.0, 20 + height],
        [20.0, 20.0],
    ]
    placed: list[tuple[float, float, float]] = []
    while len(placed) < 10:
        radius = draw.number(8, 16)
        x, y = draw.number(38, 2 + width), draw.number(38, 2 + height)
        if all(hypot(x - a, y - b) > radius + r + 1 for a, b, r in placed):
            placed.append((x, y, radius))
    objects = {}
    for k, (x, y, radius) in enumerate(placed, 1):
        velocity = list(toward((0, 0), draw.angle(), draw.number(100, 250, 0)))
        objects[f"ball-{k}"] = circle(
            (x, y),
            radius,
            mass=draw.mass(),
            velocity=velocity,
            friction=0.0,
            elasticity=1.0,
        )
    walls = {"box": {"polyline": corners, "friction": 0.0, "elasticity": 1.0}}

    def measure(run: Run) -> Errors:
        kinetic = np.zeros(len(run.trajectory.times))
        for name in objects:
            track, body = run.track(name), run.body(name)
            kinetic = (
                kinetic + (body.mass * track.speed**2 + body.moment * track.spin**2) / 2
            )
            aside = np.abs(track.at - (20 + width / 2, 20 + height / 2))
            if not (aside < (width / 2, height / 2)).all():
                return {"energy": 1.0}
        return {"energy": worst(np.abs(kinetic / kinetic[0] - 1).tolist())}

    return [
        Case(scene((440, 340), 20.0, objects, walls, world=FLOATING), measure, rate=24)
    ]


def _polygon(draw: Draw, corners: int, radius: float) -> list[list[float]]:
    """Corners on a circle about the origin, at uneven angles: convex."""
    steps = np.array([draw.number(0.6, 1.4) for _ in range(corners)])
    turned = np.cumsum(steps) / steps.sum() * 2 * np.pi
    return [[round(radius * cos(a), 3), round(radius * sin(a), 3)] for a in turned]


ELL = [
    [-24.0, -24.0],
    [24.0, -24.0],
    [24.0, -4.0],
    [-4.0, -4.0],
    [-4.0, 24.0],
    [-24.0, 24.0],
]
"""px: an L about its corner."""


def _momenta(draw: Draw) -> list[Case]:
    """Change of momentum over the first body's, and of angular momentum about the middle over what the bodies carry."""
    surface = {"friction": draw.number(0.2, 0.8), "elasticity": draw.number(0.1, 1.0)}
    shapes: list[Document] = [
        box((0, 0), (draw.number(30, 60), draw.number(20, 40)), draw.number(0, 90, 0)),
        circle((0, 0), draw.number(14, 24)),
        {"shape": {"polygon": _polygon(draw, 5, 28)}},
        {"shape": {"polygon": ELL}},
    ]  # fmt: skip
    first, second = (
        shapes[draw.index % 4],
        shapes[(draw.index + 1 + draw.index // 4) % 4],
    )
    angle, speed = draw.angle(), draw.number(150, 300, 0)
    keys = {
        "mass": draw.mass(),
        "velocity": list(toward((0, 0), angle, speed)),
        **surface,
    }
    objects = {
        "thrown": _moved(
            first, toward((220, 220), angle, -110, draw.sign() * draw.number(8, 16))
        )
        | keys
        | {"spin": draw.number(-300, 300, 0)},
        "struck": _moved(second, (220, 220))
        | {"mass": draw.mass(), "spin": draw.number(-300, 300, 0), **surface},
    }

    def measure(run: Run) -> Errors:
        momentum, turning, scales = np.zeros(2), np.zeros(1), np.zeros(2)
        spins = []
        for name in objects:
            track, body = run.track(name), run.body(name)
            p, arm = body.mass * track.velocity, track.at - (220.0, 220.0)
            own = arm[:, 0] * p[:, 1] - arm[:, 1] * p[:, 0], body.moment * track.spin
            momentum, turning = momentum + p, turning + sum(own)
            scales = scales + np.array(
                [np.hypot(*p[0]), abs(own[0][0]) + abs(own[1][0])]
            )
            spins.append(abs(track.spin[-1] - track.spin[0]))
        if max(spins) < 1e-3:
            return {"momenta": 1.0}  # they never met
        return {
            "momenta": worst(
                [
                    np.hypot(*(momentum - momentum[0]).T).max() / scales[0],
                    np.abs(turning - turning[0]).max() / scales[1],
                ]
            )
        }

    return [Case(scene((440, 440), 0.8, objects, world=FLOATING), measure)]


def _moved(object: Document, by: Point) -> Document:
    """A box, circle or polygon drawn about the origin, elsewhere."""
    [(kind, shape)] = object["shape"].items()
    if kind == "polygon":
        return {"shape": {kind: [[x + by[0], y + by[1]] for x, y in shape]}}
    return {"shape": {kind: {**shape, "center": list(by)}}}


ROWS = (
    Row(
        14, "gas", "elastic gas in a box, 20 s", "kinetic energy is constant",
        "ten balls of 8 to 16 px, 20 to 500 g, 100 to 250 px/s",
        "Largest change over the first value; a ball that gets out counts as 100 %.",
        (Measure("energy", 1e-3),), _gas,
    ),
    Row(
        23, "momenta", "two bodies, off-centre hit with friction", "momentum and angular momentum are kept",
        "boxes, balls, polygons and L shapes, both spinning; mu 0.2 to 0.8, e 0.1 to 1, any direction",
        "Change over what the bodies carry at t = 0; bodies that miss each other count as 100 %.",
        (Measure("momenta", 1e-6),), _momenta,
    ),
)  # fmt: skip
