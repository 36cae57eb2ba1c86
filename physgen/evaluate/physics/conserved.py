"""Rows of conserved quantities in collisions: energy of an elastic gas, momentum and
angular momentum.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from math import cos, hypot, sin

import numpy as np

from physgen.evaluate.physics.impacts import place_along, vector
from physgen.evaluate.physics.scorecard import (
    Array,
    Case,
    Document,
    Draw,
    Errors,
    Measure,
    Row,
    Run,
    worst,
)
from physgen.evaluate.physics.staging import FLOATING, Point, box, circle, scene

WALL = 20.0
"""Distance of the walls from the picture's edges, px."""
ROOM = (400.0, 300.0)
"""Width and height between the walls, px."""
BALLS = 10
ELASTIC = {"friction": 0.0, "elasticity": 1.0}


def _gas(draw: Draw) -> list[Case]:
    """Return the case of elastic balls in a room."""
    width, height = ROOM
    right, bottom = WALL + width, WALL + height
    corners = [
        [WALL, WALL],
        [right, WALL],
        [right, bottom],
        [WALL, bottom],
        [WALL, WALL],
    ]
    objects = {}
    for k, (center, radius) in enumerate(_place_balls(draw), 1):
        velocity = list(vector(draw.angle(), draw.number(100, 250, 0)))
        objects[f"ball-{k}"] = circle(
            center, radius, mass=draw.mass(), velocity=velocity, **ELASTIC
        )
    walls = {"box": {"polyline": corners, **ELASTIC}}
    document = scene((440, 340), 20.0, objects, walls, world=FLOATING)
    measure = partial(_energy_error, tuple(objects))
    return [Case(document, measure, rate=24)]


def _place_balls(draw: Draw) -> list[tuple[Point, float]]:
    """Return centres and radii (px) of balls without contact to each other or
    a wall.
    """
    width, height = ROOM
    balls: list[tuple[Point, float]] = []
    while len(balls) < BALLS:
        radius = draw.number(8, 16)
        x = draw.number(38, 2 + width)
        y = draw.number(38, 2 + height)
        # A contact at the start would be a collision without an approach.
        clearances = [hypot(x - a, y - b) - other for (a, b), other in balls]
        if all(clearance > radius + 1 for clearance in clearances):
            balls.append(((x, y), radius))
    return balls


def _energy_error(names: Sequence[str], run: Run) -> Errors:
    """Return the largest change of kinetic energy over its first value; 1 if a ball
    escapes.
    """
    half_room = np.array(ROOM) / 2
    # Friction is 0, but spins also count: a wrong impulse could create them.
    kinetic = np.zeros(len(run.trajectory.times))
    for name in names:
        track = run.track(name)
        body = run.body(name)
        energy = body.mass * track.speed**2 + body.moment * track.spin**2
        kinetic = kinetic + energy / 2
        offsets = np.abs(track.positions - (WALL + half_room))
        if not (offsets < half_room).all():
            return {"energy": 1.0}
    changes = np.abs(kinetic / kinetic[0] - 1)
    return {"energy": worst(changes.tolist())}


def _polygon(draw: Draw, corners: int, radius: float) -> list[list[float]]:
    """Return corners of a convex polygon: uneven angles on a circle about the
    origin.
    """
    # Uneven steps around the circle give an irregular convex polygon.
    steps = np.array([draw.number(0.6, 1.4) for _ in range(corners)])
    angles = np.cumsum(steps) / steps.sum() * 2 * np.pi
    outline = []
    for angle in angles:
        x = round(radius * cos(angle), 3)
        y = round(radius * sin(angle), 3)
        outline.append([x, y])
    return outline


ELL = [
    [-24.0, -24.0],
    [24.0, -24.0],
    [24.0, -4.0],
    [-4.0, -4.0],
    [-4.0, 24.0],
    [-24.0, 24.0],
]
"""Corners of an L about its inner corner, px."""
MEETING_POINT = (220, 220)
"""Centre of the picture and of the struck body, px."""
NO_SPIN = 1e-3
"""Minimum change of spin in a hit, rad/s. Bodies with smaller changes have missed each
other.
"""


def _momenta(draw: Draw) -> list[Case]:
    """Return the case of two bodies in an off-centre collision."""
    surface = {"friction": draw.number(0.2, 0.8), "elasticity": draw.number(0.1, 1.0)}
    shapes = _draw_shapes(draw)
    first = draw.index % 4
    # Each draw pairs other shapes.
    second = (draw.index + 1 + draw.index // 4) % 4
    angle = draw.angle()
    speed = draw.number(150, 300, 0)
    keys = {"mass": draw.mass(), "velocity": list(vector(angle, speed)), **surface}
    offset = draw.sign() * draw.number(8, 16)
    # The thrown body passes the meeting point beside its centre, so that the hit turns
    # both bodies.
    start = place_along(MEETING_POINT, angle, -110, offset)
    objects = {
        "thrown": {
            **_move_shape(shapes[first], start),
            **keys,
            "spin": draw.number(-300, 300, 0),
        },
        "struck": {
            **_move_shape(shapes[second], MEETING_POINT),
            "mass": draw.mass(),
            "spin": draw.number(-300, 300, 0),
            **surface,
        },
    }
    document = scene((440, 440), 0.8, objects, world=FLOATING)
    measure = partial(_momenta_error, tuple(objects))
    return [Case(document, measure)]


def _draw_shapes(draw: Draw) -> list[Document]:
    """Return a box, a ball, a polygon and an L about the origin."""
    size = (draw.number(30, 60), draw.number(20, 40))
    return [
        box((0, 0), size, draw.number(0, 90, 0)),
        circle((0, 0), draw.number(14, 24)),
        {"shape": {"polygon": _polygon(draw, 5, 28)}},
        {"shape": {"polygon": ELL}},
    ]


def _move_shape(object: Document, center: Point) -> Document:
    """Return an object with its shape moved from the origin to a centre (px)."""
    [(kind, shape)] = object["shape"].items()
    if kind == "polygon":
        x, y = center
        corners = [[corner[0] + x, corner[1] + y] for corner in shape]
        return {"shape": {kind: corners}}
    return {"shape": {kind: {**shape, "center": list(center)}}}


def _cross(first: Array, second: Array) -> Array:
    """Return the cross products (T,) of vectors (T, 2)."""
    return np.asarray(first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0])


def _momenta_error(names: Sequence[str], run: Run) -> Errors:
    """Return the largest change of momentum or angular momentum over the sum of the
    bodies' first values.

    Angular momentum is about MEETING_POINT. A miss counts as 100 %.
    """
    momentum: Array = np.zeros(2)
    angular_momentum: Array = np.zeros(1)
    momentum_scale = angular_scale = 0.0
    spin_changes = []
    for name in names:
        track = run.track(name)
        body = run.body(name)
        own_momentum = body.mass * track.velocity
        # L = r x m v + I w, about one fixed point for both bodies.
        orbital = _cross(track.positions - MEETING_POINT, own_momentum)
        intrinsic = body.moment * track.spin
        momentum = momentum + own_momentum
        angular_momentum = angular_momentum + (orbital + intrinsic)
        # Momenta may cancel at the start: their sizes give the scale.
        momentum_scale += np.hypot(*own_momentum[0])
        angular_scale += abs(orbital[0]) + abs(intrinsic[0])
        spin_changes.append(abs(track.spin[-1] - track.spin[0]))
    if max(spin_changes) < NO_SPIN:
        return {"momenta": 1.0}
    momentum_change = np.hypot(*(momentum - momentum[0]).T).max()
    angular_change = np.abs(angular_momentum - angular_momentum[0]).max()
    return {
        "momenta": worst(
            [momentum_change / momentum_scale, angular_change / angular_scale]
        )
    }


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
