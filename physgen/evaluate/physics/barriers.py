"""Rows of barriers: thin walls against fast balls, and a ball in a hollow."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from math import cos, sin

import numpy as np

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
from physgen.evaluate.physics.staging import FLOATING, box, circle, scene, segment

FAST = (2, 5, 10, 15, 20)
"""Speeds in radii per step of 1/960 s, one per draw."""
LEFT, MIDDLE, RIGHT = 20.0, 250.0, 480.0
"""Walls of the rooms, and the partition between their halves, px."""
ROOM_HEIGHT = 160.0
"""px."""
ROOM_TOPS = (20.0, 200.0)
"""px."""
ELASTICITIES = (1.0, 0.5)
"""Elasticities of the rooms."""


@dataclass(frozen=True)
class _HalfRoom:
    """Room for a ball in the picture."""

    left: float
    """px."""
    right: float
    """px."""
    top: float
    """px."""


def _thin_walls(draw: Draw) -> list[Case]:
    """Return the case of two rooms of two halves, with a fast ball in each half."""
    objects: dict[str, Document] = {}
    walls = {}
    halves = {}
    for k, (top, elasticity) in enumerate(zip(ROOM_TOPS, ELASTICITIES, strict=True)):
        surface = {"friction": 0.0, "elasticity": elasticity}
        walls[f"room-{k}"] = {"polyline": _room_corners(top), **surface}
        center = (250, top + 80)
        partition = box(center, (1.0, 170.0), motion="static", **surface)
        objects[f"partition-{k}"] = partition
        # Both balls fly towards the partition, each from its half.
        for side, name in ((-1, f"ball-{k}-left"), (1, f"ball-{k}-right")):
            objects[name] = _fast_ball(draw, side, top, surface)
        halves[f"ball-{k}-left"] = _HalfRoom(LEFT, MIDDLE, top)
        halves[f"ball-{k}-right"] = _HalfRoom(MIDDLE, RIGHT, top)
    # The ball moves several times the wall's thickness in a step of the engine: without
    # a test of its path, it would tunnel through the wall.
    document = scene((500, 380), 0.2, objects, walls, world=FLOATING)
    return [Case(document, partial(_escape_error, halves), rate=960)]


def _room_corners(top: float) -> list[list[float]]:
    bottom = top + ROOM_HEIGHT
    return [[LEFT, top], [RIGHT, top], [RIGHT, bottom], [LEFT, bottom], [LEFT, top]]


def _fast_ball(draw: Draw, side: int, top: float, surface: Document) -> Document:
    """Return a ball in the left (-1) or right (1) half, with a velocity towards the
    partition.
    """
    radius = draw.number(3, 6)
    angle = np.radians(draw.number(-70, 70, 1))
    speed = FAST[draw.index] * radius * 960
    center = (250 + side * draw.number(40, 180), top + draw.number(30, 130))
    velocity = [-side * speed * cos(angle), speed * sin(angle)]
    return circle(center, radius, mass=draw.mass(), velocity=velocity, **surface)


def _escape_error(halves: Mapping[str, _HalfRoom], run: Run) -> Errors:
    """Return 1 if a ball is ever outside its half of a room."""
    has_escaped = False
    for name, half in halves.items():
        track = run.track(name)
        is_level = (track.x > half.left) & (track.x < half.right)
        is_upright = (track.y > half.top) & (track.y < half.top + ROOM_HEIGHT)
        if not (is_level & is_upright).all():
            has_escaped = True
    return {"inside": float(has_escaped)}


@dataclass(frozen=True)
class _Hollow:
    """An outline like a U on the floor."""

    width: float
    """px between its walls."""
    depth: float
    """px from its rim to its floor."""
    thickness: float
    """px of walls and floor."""

    base = 320.0
    """px: the height of the ground."""

    @property
    def left(self) -> float:
        """Return the inner side of the left wall, px."""
        return 200 - self.width / 2

    @property
    def right(self) -> float:
        """Return the inner side of the right wall, px."""
        return 200 + self.width / 2

    @property
    def bottom(self) -> float:
        """Return the height of the inner floor, px."""
        return self.base - self.thickness

    def outline(self) -> list[list[float]]:
        """Return the corners, px."""
        rim = self.base - self.thickness - self.depth
        outer_left = self.left - self.thickness
        outer_right = self.right + self.thickness
        return [
            [outer_left, self.base],
            [outer_left, rim],
            [self.left, rim],
            [self.left, self.bottom],
            [self.right, self.bottom],
            [self.right, rim],
            [outer_right, rim],
            [outer_right, self.base],
        ]


def _hollow_outline(draw: Draw) -> list[Case]:
    """Return the case of a ball that falls into a fixed or loose U."""
    hollow = _Hollow(
        width=draw.number(70, 120, 0),
        depth=draw.number(60, 110, 0),
        thickness=draw.number(10, 20, 0),
    )
    radius = draw.number(12, 24)
    is_loose = draw.index % 2 == 0
    surface = {"friction": draw.number(0.3, 0.8), "elasticity": draw.number(0, 0.5)}
    # The ball must fall inside the hollow, which a convex hull of the outline would
    # close.
    offset = draw.number(-0.8, 0.8) * (hollow.width / 2 - radius)
    motion: Document
    if is_loose:
        motion = {"mass": 2000.0}
    else:
        motion = {"motion": "static"}
    objects: dict[str, Document] = {
        "hollow": {"shape": {"polygon": hollow.outline()}, **motion, **surface},
        "ball": circle(
            (200 + offset, draw.number(60, 100)),
            radius,
            mass=draw.number(20, 200, 0),
            **surface,
        ),
    }
    floor = segment((0, 320), (400, 320), **surface)
    document = scene((400, 360), 2.5, objects, {"floor": floor})
    measure = partial(_rest_error, hollow, radius)
    return [Case(document, measure)]


def _rest_error(hollow: _Hollow, radius: float, run: Run) -> Errors:
    """Return 1 unless the ball ends on the floor of the U, to half a pixel."""
    ball = run.track("ball")
    body = run.track("hollow")
    # A loose U may slide along the floor, and the ball with it.
    x, y = ball.positions[-1] - body.displacements[-1]
    low = hollow.left + radius - 0.5
    high = hollow.right - radius + 0.5
    is_between_walls = low < x < high
    is_at_floor = abs(y - (hollow.bottom - radius)) < 0.5
    is_upright = abs(body.angle[-1]) < 0.01
    return {"inside": float(not (is_between_walls and is_at_floor and is_upright))}


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
        (Measure("inside", 0, Unit.SWITCH),), _hollow_outline,
    ),
)  # fmt: skip
