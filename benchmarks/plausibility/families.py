"""A seed -> a random scene of a family, as physgen would be given it: what clips of ours look like."""

from __future__ import annotations

import json
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from physgen.compile.world import World

Rng = np.random.Generator
Data = dict[str, Any]
SIZE = 512


def world_of(family: str, rng: Rng) -> World:
    """Drawn, written as a scene file, and compiled as any other."""
    from physgen import pipeline

    data = {"physgen": 1, "size": [SIZE, SIZE], **FAMILIES[family](rng)}
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "scene.yaml"
        path.write_text(json.dumps(data))
        return pipeline.compile(pipeline.load(path), None).world


def _number(rng: Rng, low: float, high: float) -> float:
    return round(float(rng.uniform(low, high)), 3)


def _side(rng: Rng, seconds: float = 2.0) -> Data:
    return {
        "view": "side",
        "pixels_per_meter": _number(rng, 80, 300),
        "duration": seconds,
    }


def _mass(rng: Rng, area: float) -> float:
    """g: what the area says, within a factor of 3."""
    return round(0.2 * area * float(np.exp(rng.uniform(-1, 1) * np.log(3))), 2)


def _ball(
    rng: Rng,
    x: float,
    y: float,
    radius: float,
    velocity: tuple[float, float] = (0.0, 0.0),
) -> Data:
    return {
        "shape": {
            "circle": {"center": [round(x, 2), round(y, 2)], "radius": round(radius, 2)}
        },
        "mass": _mass(rng, 3.14 * radius**2),
        "solid": str(rng.choice(["sphere", "disc"])),
        "friction": _number(rng, 0.1, 0.7),
        "elasticity": _number(rng, 0.5, 0.95),
        "velocity": [round(velocity[0], 2), round(velocity[1], 2)],
        "spin": _number(rng, -200, 200),
    }


def _box(rng: Rng, x: float, y: float, w: float, h: float, angle: float = 0.0) -> Data:
    return {
        "shape": {
            "box": {
                "center": [round(x, 2), round(y, 2)],
                "size": [round(w, 2), round(h, 2)],
                "angle": angle,
            }
        },
        "mass": _mass(rng, w * h),
        "friction": _number(rng, 0.2, 0.7),
        "elasticity": _number(rng, 0.1, 0.5),
    }


def _wall(rng: Rng, *points: tuple[float, float]) -> Data:
    return {
        "polyline": [list(p) for p in points],
        "friction": _number(rng, 0.2, 0.8),
        "elasticity": _number(rng, 0.5, 0.95),
    }


def bouncing(rng: Rng) -> Data:
    """Balls and boxes thrown into a room."""
    bodies: Data = {}
    for k, x in enumerate(np.linspace(80, 430, int(rng.integers(2, 6)))):
        at = (float(x + rng.uniform(-15, 15)), _number(rng, 60, 260))
        if rng.random() < 0.75:
            speed = (_number(rng, -250, 250), _number(rng, -200, 100))
            bodies[f"ball-{k}"] = _ball(rng, *at, _number(rng, 9, 24), speed)
        else:
            box = _box(
                rng,
                *at,
                _number(rng, 20, 40),
                _number(rng, 15, 40),
                _number(rng, -40, 40),
            )
            bodies[f"box-{k}"] = box | {
                "velocity": [_number(rng, -200, 200), 0.0],
                "spin": _number(rng, -200, 200),
            }
    room = _wall(rng, (15, -300), (15, 490), (497, 490), (497, -300))
    return {"world": _side(rng), "objects": bodies, "boundaries": {"room": room}}


def meeting(rng: Rng) -> Data:
    """Balls thrown at each other, to meet in the air."""
    bodies: Data = {}
    world = _side(rng, 1.2)
    pull = 9.8 * world["pixels_per_meter"]
    for k in range(int(rng.integers(1, 3))):
        when, x, y = _number(rng, 0.3, 0.5), _number(rng, 180, 330), 120 + 150 * k
        for side in (-1, 1):
            speed = _number(rng, 150, 400)
            start = (x + side * (speed * when + 14), y - _number(rng, -12, 12))
            velocity = (-side * speed, -pull * when / 2)
            bodies[f"ball-{k}{'ab'[side > 0]}"] = _ball(
                rng, *start, _number(rng, 12, 22), velocity
            )
    return {"world": world, "objects": bodies}


def sliding(rng: Rng) -> Data:
    """Blocks that slide on tables, rolling balls, and some that fall off the edge."""
    bodies: Data = {}
    tables: Data = {}
    for k, y in enumerate((170.0, 330.0, 480.0)):
        edge = _number(rng, 300, 500)
        tables[f"table-{k}"] = {
            "segment": [[10, y], [edge if k < 2 else 700, y]],
            "friction": _number(rng, 0.1, 0.6),
        }
        for m in range(int(rng.integers(1, 3))):
            x, speed = 50 + 130.0 * m, _number(rng, 0, 450)
            if rng.random() < 0.5:
                bodies[f"block-{k}{m}"] = _box(rng, x, y - 12, 34, 24) | {
                    "velocity": [speed, 0]
                }
            else:
                bodies[f"ball-{k}{m}"] = _ball(rng, x, y - 14, 14, (speed, 0))
    return {"world": _side(rng, 1.6), "objects": bodies, "boundaries": tables}


def ramp(rng: Rng) -> Data:
    """Down a slope and off its end."""
    angle = np.radians(rng.uniform(12, 38))
    top, end = (40.0, 150.0), (300.0, 150.0 + 260 * float(np.tan(angle)))
    along = np.array([np.cos(angle), np.sin(angle)])
    up = np.array([np.sin(angle), -np.cos(angle)])
    bodies: Data = {}
    for k, far in enumerate((40.0, 110.0)):
        if rng.random() < 0.6:
            x, y = np.array(top) + far * along + 14 * up
            bodies[f"ball-{k}"] = _ball(rng, float(x), float(y), 14) | {"spin": 0}
        else:
            x, y = np.array(top) + far * along + 12 * up
            bodies[f"block-{k}"] = _box(
                rng, float(x), float(y), 36, 24, round(float(np.degrees(angle)), 4)
            )
    walls = {
        "slope": _wall(rng, top, end),
        "floor": _wall(rng, (-300, 490), (900, 490)),
    }
    return {"world": _side(rng), "objects": bodies, "boundaries": walls}


def stack(rng: Rng) -> Data:
    """A pile of boxes, hit by a ball."""
    size = _number(rng, 30, 44)
    bodies: Data = {}
    for row in range(3):
        for k in range(3 - row):
            x, y = 300 + (size + 2) * (k + row / 2), 480 - size * (row + 0.5)
            bodies[f"box-{row}{k}"] = _box(rng, x, y, size, size)
    bodies["ball"] = _ball(
        rng,
        60,
        _number(rng, 330, 450),
        16,
        (_number(rng, 250, 500), _number(rng, -150, 0)),
    )
    return {
        "world": _side(rng, 1.5),
        "objects": bodies,
        "boundaries": {"floor": _wall(rng, (-300, 480), (900, 480))},
    }


def dominoes(rng: Rng) -> Data:
    """A row, the first of which falls."""
    height, gap = _number(rng, 60, 100), _number(rng, 30, 48)
    bodies = {
        f"domino-{k}": _box(rng, 60 + gap * k, 450 - height / 2, 12, height)
        for k in range(8)
    }
    bodies["domino-0"] |= {"spin": _number(rng, 80, 200)}
    return {
        "world": _side(rng, 1.5),
        "objects": bodies,
        "boundaries": {"floor": _wall(rng, (-300, 450), (900, 450))},
    }


def pendulum(rng: Rng) -> Data:
    """A bob on a pin, and a ball that bounces beside it."""
    long, angle = _number(rng, 90, 160), np.radians(rng.uniform(20, 80))
    bob = _ball(
        rng, 150 + long * float(np.sin(angle)), 60 + long * float(np.cos(angle)), 16
    ) | {"spin": 0}
    ball = _ball(rng, 400, _number(rng, 100, 250), 15)
    return {
        "world": _side(rng),
        "objects": {"bob": bob, "ball": ball},
        "joints": {"pin": {"objects": ["bob"], "pivot": [150, 60]}},
        "boundaries": {"floor": _wall(rng, (-300, 480), (900, 480))},
    }


def table_top(rng: Rng) -> Data:
    """Discs on a table, some of them moving."""
    bodies: Data = {}
    for k in range(int(rng.integers(4, 9))):
        x, y = (
            90 + 110 * (k % 4) + rng.uniform(-20, 20),
            120 + 160 * (k // 4) + rng.uniform(-30, 30),
        )
        moves = k % 2 == 0
        speed = (
            (_number(rng, -350, 350), _number(rng, -350, 350)) if moves else (0.0, 0.0)
        )
        bodies[f"disc-{k}"] = _ball(rng, x, y, _number(rng, 14, 28), speed) | {
            "solid": "disc"
        }
    world = {
        "view": "top",
        "pixels_per_meter": 200,
        "table": {"friction": _number(rng, 0.005, 0.1)},
        "duration": 2.0,
    }
    return {"world": world, "objects": bodies}


def billiards(rng: Rng) -> Data:
    """A cue ball at some others, between cushions."""
    bodies: Data = {
        "cue": _ball(
            rng,
            70,
            256 + rng.uniform(-8, 8),
            13,
            (_number(rng, 500, 1100), _number(rng, -40, 40)),
        )
    }
    for k in range(int(rng.integers(2, 7))):
        row, column = divmod(k, 2)
        x, y = (
            250 + 60 * row + rng.uniform(-8, 8),
            230 + 56 * column + rng.uniform(-8, 8),
        )
        bodies[f"ball-{k}"] = _ball(rng, x, y, 13)
    for ball in bodies.values():
        ball |= {
            "solid": "sphere",
            "mass": 170,
            "spin": 0,
            "friction": 0.06,
            "rolling": 0.01,
            "elasticity": 0.93,
        }
    frame = _wall(rng, (20, 20), (492, 20), (492, 492), (20, 492), (20, 20))
    world = {
        "view": "top",
        "pixels_per_meter": 230,
        "table": {"friction": 0.6},
        "duration": 2.0,
    }
    return {"world": world, "objects": bodies, "boundaries": {"cushions": frame}}


FAMILIES: dict[str, Callable[[Rng], Data]] = {
    "bouncing": bouncing,
    "meeting": meeting,
    "sliding": sliding,
    "ramp": ramp,
    "stack": stack,
    "dominoes": dominoes,
    "pendulum": pendulum,
    "table top": table_top,
    "billiards": billiards,
}
