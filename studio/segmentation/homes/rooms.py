"""Random rooms: tables, shelves, niches and floors of any finish under any light."""

from __future__ import annotations

import numpy as np

from studio.segmentation.homes import prints
from studio.segmentation.homes.furniture import (
    Light,
    Room,
    board,
    curtain,
    frame,
    fronts,
    panel,
    rug,
    socket,
    wall,
)
from studio.segmentation.homes.parts import Part
from studio.segmentation.homes.placement import Support
from studio.segmentation.homes.prints import Rng

SETS = ("table", "table", "top", "top", "shelf", "floor", "niche", "counter")


def surface(rng: Rng) -> tuple[str, np.ndarray]:
    return str(rng.choice(["matt", "satin", "satin", "glossy"])), prints.surface_print(
        rng
    )


def lights(rng: Rng, elevation: tuple[float, float]) -> tuple[list[Light], np.ndarray]:
    """One to three lamps: a small hard or a wide soft one from above a side, and a glow all around."""
    found = []
    for k in range(int(rng.integers(1, 4))):
        a, up = rng.uniform(-np.pi, 0.35 * np.pi), rng.uniform(0.5, 1.4)
        far = rng.uniform(1.2, 3.0)
        at = far * np.array(
            [np.cos(a) * np.cos(up), np.sin(a) * np.cos(up) - 0.1, np.sin(up)]
        )
        side = rng.uniform(0.04, 0.25) if rng.random() < 0.5 else rng.uniform(0.4, 1.6)
        tint = np.array([1, rng.uniform(0.7, 1.05), rng.uniform(0.4, 1.2)])
        power = rng.uniform(0.5, 2.5) * (1.0 if k == 0 else 0.35)
        found.append(
            Light(tuple(at), (0, 0, 0), (side, side), tint * power * far**2 / side**2)
        )
    return found, np.array([1, 1, 1.0]) * rng.uniform(0.05, 0.5)


def room(rng: Rng) -> Room:
    """One of SETS."""
    name = str(rng.choice(SETS))
    wide = float(
        np.exp(rng.uniform(np.log(0.35), np.log(1.1)))
    )  # m of the support that the photo is about
    deep = wide * rng.uniform(0.4, 0.8)
    scenery: list[Part] = []
    supports: list[Support] = []
    finish, skin = surface(rng)
    metres = rng.uniform(0.25, 1.2)
    elevation = (4.0, 22.0) if rng.random() < 0.5 else (20.0, 55.0)
    back = deep / 2 + rng.uniform(0.0, 0.05)
    if name == "top":
        elevation = (66.0, 89.9)
        deep = wide * rng.uniform(0.6, 1.1)
        scenery.append(panel([-3, -3, 0], [6, 0, 0], [0, 6, 0], finish, skin, metres))
        supports.append(Support((0, 0, 0), (wide, deep)))
        if rng.random() < 0.4:
            scenery.append(
                rug(
                    rng,
                    *rng.normal(0, 0.1, 2),
                    wide * rng.uniform(0.4, 1),
                    deep * rng.uniform(0.4, 1),
                    0.0005,
                    prints.pattern(rng, 128, 128),
                    rng.uniform(-40, 40),
                )
            )
    elif name in ("table", "counter", "floor"):
        support = Support((0, 0, 0), (wide, deep), wall=name != "table")
        supports.append(support)
        if name == "table":
            length = wide * rng.uniform(1.0, 3.5)
            scenery.append(
                board(
                    [length, deep * rng.uniform(1.05, 1.6), 0.03],
                    [0, 0, -0.03],
                    finish,
                    skin,
                    metres,
                    grain=int(rng.integers(2)),
                )
            )
            scenery.append(
                panel(
                    [-4, -4, -0.72],
                    [8, 0, 0],
                    [0, 8, 0],
                    *surface(rng),
                    rng.uniform(0.4, 1.5),
                )
            )
            far = rng.uniform(deep / 2 + 0.1, 2.5)
            scenery.append(wall(far, *surface(rng), rng.uniform(0.4, 1.6), -0.72))
            for _ in range(int(rng.integers(0, 5))):  # furniture beyond, not objects
                size = rng.uniform([0.1, 0.1, 0.1], [0.8, 0.2, 1.2])
                scenery.append(
                    board(
                        size,
                        [
                            rng.uniform(-1.5, 1.5),
                            far - 0.12,
                            -0.72 + rng.uniform(0, 0.5),
                        ],
                        *surface(rng),
                    )
                )
        else:
            if name == "floor":
                scenery.append(
                    panel([-3, back - 6, 0], [6, 0, 0], [0, 6, 0], finish, skin, metres)
                )
                scenery.append(
                    board(
                        [6, 0.015, rng.uniform(0.04, 0.1)],
                        [0, back - 0.006, 0],
                        "satin",
                        prints.plain(prints.colour(rng)),
                    )
                )
                supports[0] = Support((0, -0.01, 0), (wide, deep - 0.02))
            else:
                y0 = back - deep - rng.uniform(0.02, 0.1)
                scenery.append(
                    board(
                        [4, back - y0, 0.035],
                        [0, (back + y0) / 2, -0.035],
                        finish,
                        skin,
                        metres,
                    )
                )
                scenery += fronts(
                    rng, 2.4, 0.7, y0 + 0.03, -0.045, prints.surface_print(rng)
                )
            scenery.append(wall(back, *surface(rng), rng.uniform(0.2, 1.2), -0.8))
            for _ in range(int(rng.integers(0, 3))):
                scenery += frame(
                    rng, rng.uniform(-0.7, 0.7), back, rng.uniform(0.35, 0.6)
                )
            if rng.random() < 0.3:
                scenery += socket(
                    rng.uniform(-0.3, 0.3) * wide, back, rng.uniform(0.12, 0.25)
                )
        if rng.random() < 0.3:
            scenery.append(
                rug(
                    rng,
                    0,
                    -0.03,
                    wide * rng.uniform(0.4, 0.9),
                    deep * rng.uniform(0.4, 0.8),
                    0.0006,
                    prints.pattern(rng, 128, 128),
                    rng.uniform(-20, 20),
                )
            )
        if rng.random() < 0.15:
            scenery.append(
                curtain(
                    rng,
                    rng.uniform(-0.8, 0.4),
                    back + (0.0 if name == "table" else -0.05),
                    0.5,
                    -0.5 if name == "table" else 0.0,
                    prints.surface_print(rng),
                )
            )
    else:  # shelf or niche: boards one above the other between sides
        elevation = (-6.0, 16.0)
        levels = int(rng.integers(2, 4)) if name == "shelf" else 1
        deep, clear = rng.uniform(0.16, 0.32), rng.uniform(0.2, 0.36)
        thick = rng.uniform(0.012, 0.035)
        total = wide * rng.uniform(1.05, 1.6)
        for k in range(levels + 1):
            scenery.append(
                board(
                    [total, deep, thick],
                    [0, 0, k * (clear + thick) - thick],
                    finish,
                    skin,
                    metres,
                )
            )
        for side in (-1, 1):
            scenery.append(
                board(
                    [thick, deep, (levels + 1) * (clear + thick)],
                    [side * (total + thick) / 2, 0, -thick],
                    finish,
                    skin,
                    metres,
                    grain=2,
                )
            )
        supports = [
            Support((0, 0, k * (clear + thick)), (wide, deep - 0.01), clear, True)
            for k in range(levels)
        ]
        scenery.append(wall(deep / 2, *surface(rng), rng.uniform(0.3, 1.2), -1))
        scenery.append(
            panel([-3, -3, -0.9], [6, 0, 0], [0, 3.5, 0], *surface(rng), 1.0)
        )
    lamps, ambient = lights(rng, elevation)
    return Room(
        name,
        scenery,
        supports,
        lamps,
        ambient,
        elevation,
        30.0 if name not in ("shelf", "niche") else 20.0,
    )
