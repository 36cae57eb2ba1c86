"""Random rooms of the validation family: a kitchen counter, a laid table, a bookcase, a window sill, a desk, a
sideboard, a floor with a rug. Finishes, sets and light are not those of `rooms`; textures are the studio's own."""

from __future__ import annotations

import numpy as np

from studio import textures
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
    window,
)
from studio.segmentation.homes.parts import Part
from studio.segmentation.homes.placement import Support
from studio.segmentation.homes.prints import Rng
from studio.segmentation.homes.solids import box
from studio.textures import srgb

KITCHEN = [
    "mug",
    "plate",
    "bowl",
    "tumbler",
    "bottle",
    "jar",
    "can",
    "cutlery",
    "pan",
    "teapot",
    "apple",
    "citrus",
    "pear",
    "banana",
    "carton",
]
LAID = [
    "plate",
    "plate",
    "cutlery",
    "cutlery",
    "wineglass",
    "tumbler",
    "mug",
    "bowl",
    "candle",
    "bouquet",
    "bottle",
    "citrus",
    "apple",
    "banana",
]
SHELF = ["book", "book", "book", "vase", "plant", "clock", "bear", "candle", "carton", "ball", "car", "bowl"]
DESK = [
    "book",
    "book",
    "pencil",
    "pencil",
    "brush",
    "phone",
    "scissors",
    "key",
    "mug",
    "lamp",
    "clock",
    "plant",
    "remote",
    "jar",
    "apple",
]
PLAY = ["bear", "car", "car", "ball", "ball", "shoe", "shoe", "book", "carton", "banana"]
KINDS = {
    "kitchen": KITCHEN,
    "dining": LAID,
    "bookcase": SHELF,
    "sill": ["plant", "plant", "vase", "bouquet", "candle", "mug", "bear", "book", "pear"],
    "desk": DESK,
    "sideboard": [
        "lamp",
        "vase",
        "bouquet",
        "book",
        "candle",
        "bowl",
        "remote",
        "key",
        "clock",
        "plant",
        "phone",
    ],
    "play": PLAY,
}
WOODS = (
    ((82, 48, 26), (146, 98, 58)),
    ((150, 106, 66), (206, 166, 118)),
    ((196, 164, 124), (230, 208, 176)),
    ((58, 36, 24), (96, 62, 40)),
)


def timber(rng: Rng, size: int = 512) -> np.ndarray:
    dark, light = WOODS[rng.integers(len(WOODS))]
    return textures.wood(
        size, size, srgb(*dark), srgb(*light), int(rng.integers(1 << 30)), rng.uniform(5, 12)
    ).astype(np.float32)


def painted(rng: Rng, size: int = 256) -> np.ndarray:
    """A wall's paint or paper: pale mostly."""
    tone = np.array(
        [
            [236, 232, 222],
            [222, 214, 198],
            [196, 206, 204],
            [172, 184, 172],
            [205, 178, 160],
            [128, 142, 150],
            [92, 106, 98],
        ][rng.integers(7)],
        float,
    )
    image = (
        np.broadcast_to(prints.linear(tone), (size, size, 3))
        * (1 + 0.025 * prints.noise((size, size), 30, rng) + 0.02 * prints.noise((size, size), 2, rng))[
            ..., None
        ]
    )
    if rng.random() < 0.2:
        paper = np.broadcast_to(tone.astype(np.float32), (size, size, 3)).copy()
        for x in range(0, size, 64):
            for y in range(0, size, 64):
                prints.flower(paper, np.array([x + 16 + 32 * (y // 64 % 2), y + 32]), 12, tone * 0.8, rng)
        image = prints.linear(np.clip(paper, 0, 255))
    return np.clip(image, 0, 1).astype(np.float32)


def tiling(rng: Rng, size: int = 256) -> np.ndarray:
    """Wall tiles in running bond or squares, glazed unevenly; one repeat holds 4 rows."""
    tone = np.array(
        [[238, 238, 232], [210, 222, 220], [150, 176, 178], [224, 206, 170], [70, 92, 98]][rng.integers(5)],
        float,
    )
    image, h = np.empty((size, size, 3), np.float32), size // 4
    w = h if rng.random() < 0.4 else 2 * h
    grout = prints.linear([196, 192, 184])
    for j in range(4):
        shift = (w // 2) * (j % 2) if w > h else 0
        for i in range(-1, size // w + 1):
            x = i * w + shift
            image[j * h : (j + 1) * h, max(0, x) : max(0, x + w)] = prints.linear(
                np.clip(tone + rng.normal(0, 4, 3), 0, 255)
            )
            if 0 <= x < size:
                image[j * h : (j + 1) * h, x : x + 3] = grout
        image[j * h : j * h + 3] = grout
    return image


def stone(rng: Rng, size: int = 384) -> np.ndarray:
    """A kitchen's worktop: granite, or marble with veins."""
    if rng.random() < 0.5:
        base = np.array([[58, 60, 64], [190, 186, 178], [120, 104, 92]][rng.integers(3)])
        grain = 0.25 * prints.noise((size, size), 2.2, rng) + 0.2 * prints.noise((size, size), 6, rng)
        return np.clip(prints.linear(base) * (1 + grain)[..., None], 0, 1).astype(np.float32)
    vein = np.abs(prints.noise((size, size), 90, rng) + 0.5 * prints.noise((size, size), 24, rng))
    return (prints.linear([232, 230, 226]) * (1 - 0.55 * np.clip(1 - 7 * vein, 0, 1))[..., None]).astype(
        np.float32
    )


def cloth(rng: Rng, size: int = 320) -> np.ndarray:
    """A table cloth's or rug's print with a border."""
    image = np.ascontiguousarray(np.tile(prints.homes_pattern(rng, size // 2, size // 2), (2, 2, 1)))
    edge = prints.linear(prints.colour(rng, "homes"))
    for start, wide in ((0, 8), (14, 3)):
        for k in range(4):
            np.rot90(image, k)[start : start + wide] = edge
    return image


def daylight(rng: Rng, kind: str) -> tuple[list[Light], np.ndarray]:
    """A tall window to one side, a lamp overhead in the evening, or the sun through the window."""
    side = rng.choice([-1, 1])
    sky = np.array([0.92, 0.97, 1.05])
    if kind == "sill":
        return [Light((side * 0.4, -0.2, 2.6), (0, 0, 0), (1.5, 1.5), 3.0 * sky)], 0.6 * sky
    pick = rng.random()
    pane = Light(
        (side * rng.uniform(1.5, 2.4), rng.uniform(-1.6, 0.1), rng.uniform(0.7, 1.5)),
        (0, 0, 0.1),
        (1.1, 1.5),
        rng.uniform(4, 7) * sky,
    )
    if pick < 0.5:
        return [pane], rng.uniform(0.25, 0.5) * np.array([1.0, 0.97, 0.92])
    if pick < 0.75:
        warm = np.array([1.0, 0.78, 0.5])
        return [
            Light((rng.uniform(-0.5, 0.5), rng.uniform(-0.8, -0.1), 1.7), (0, 0, 0), (0.3, 0.3), 60 * warm),
            Light((side * 2, -1, 1.2), (0, 0, 0), (1, 1), 0.6 * sky),
        ], 0.15 * warm
    sun = Light(
        (side * 3.2, rng.uniform(-3, -1), rng.uniform(2.2, 4)),
        (0, 0, 0),
        (0.16, 0.16),
        2600 * np.array([1, 0.93, 0.8]),
    )
    return [sun, Light(pane.at, pane.target, pane.size, pane.radiance * 0.6)], 0.4 * sky


def dwelling(rng: Rng, kind: str) -> Room:
    """A room of KINDS."""
    wide = {
        "kitchen": 0.85,
        "dining": 0.8,
        "bookcase": 0.8,
        "sill": 0.75,
        "desk": 0.85,
        "sideboard": 0.95,
        "play": 1.1,
    }[kind] * rng.uniform(0.8, 1.15)
    deep = wide * 0.55
    back = deep / 2
    scenery: list[Part] = []
    supports = [Support((0, 0, 0), (wide, deep), 1.0, True)]
    elevation, azimuth = (12.0, 32.0), 24.0
    if kind == "kitchen":
        scenery.append(
            board(
                [4, deep + 0.06, 0.04],
                [0, -0.03, -0.04],
                "glossy",
                stone(rng) if rng.random() < 0.6 else timber(rng),
                0.7,
            )
        )
        scenery += fronts(
            rng,
            2.4,
            0.72,
            back - deep - 0.03,
            -0.05,
            timber(rng) if rng.random() < 0.4 else prints.plain(prints.colour(rng, "homes")),
            "homes",
        )
        scenery += [
            wall(back, "glossy", tiling(rng), rng.uniform(0.35, 0.6), -0.9),
            *socket(rng.uniform(-0.3, 0.3), back, 0.22),
        ]
        if rng.random() < 0.5:
            scenery.append(
                board([4, 0.33, 0.03], [0, back - 0.165, 0.52], "satin", prints.plain([230, 228, 220]))
            )
    elif kind == "dining":
        deep = wide * 0.8
        supports = [Support((0, 0, 0), (wide, deep))]
        elevation = (30.0, 88.0)
        scenery.append(board([wide * 1.7, deep * 1.5, 0.03], [0, 0, -0.03], "satin", timber(rng), 0.9))
        if rng.random() < 0.7:
            scenery.append(
                rug(
                    rng, 0, 0, wide * rng.uniform(0.8, 1.5), deep * rng.uniform(0.75, 1.3), 0.0008, cloth(rng)
                )
            )
        scenery += [
            panel([-4, -4, -0.74], [8, 0, 0], [0, 8, 0], "satin", timber(rng), 1.6),
            wall(2.0, "matt", painted(rng), 1.2, -0.74),
        ]
        scenery += frame(rng, rng.uniform(-0.6, 0.6), 2.0, 0.6, "homes")
    elif kind == "bookcase":
        elevation, azimuth = (-2.0, 12.0), 22.0
        deep, clear, thick = 0.26, rng.uniform(0.29, 0.36), 0.022
        skin = timber(rng) if rng.random() < 0.6 else prints.plain([228, 226, 220])
        for k in range(3):
            scenery.append(
                board([wide * 1.2, deep, thick], [0, 0, k * (clear + thick) - thick], "satin", skin, 0.8)
            )
        for side in (-1, 1):
            scenery.append(
                board(
                    [thick, deep, 3 * (clear + thick)],
                    [side * (wide * 1.2 + thick) / 2, 0, -thick - 0.3],
                    "satin",
                    skin,
                    0.8,
                    grain=2,
                )
            )
        scenery += [
            panel([-wide * 0.6, deep / 2, -0.4], [wide * 1.2, 0, 0], [0, 0, 1.5], "satin", skin, 0.8),
            wall(deep / 2 + 0.01, "matt", painted(rng), 1.0, -1),
        ]
        supports = [Support((0, 0, k * (clear + thick)), (wide, deep - 0.02), clear, True) for k in range(2)]
    elif kind == "sill":
        deep, back = 0.24, 0.12
        elevation = (6.0, 22.0)
        supports = [Support((0, -0.02, 0), (wide, deep - 0.06), 0.8)]
        scenery.append(
            board(
                [2.2, deep, 0.035],
                [0, 0, -0.035],
                "satin",
                stone(rng) if rng.random() < 0.3 else prints.plain([232, 230, 224]),
            )
        )
        scenery.append(panel([-3, back - 0.3, -1], [6, 0, 0], [0, 0, 0.96], "matt", painted(rng), 1.0))
        scenery += window(rng, 0, back + 0.03, 1.5, 0.05, 1.3)
        view = np.clip(prints.homes_pattern(rng, 64, 64) * 0.4 + prints.linear([200, 215, 228]), 0, 1)
        scenery.append(
            Part(panel([-2.5, back + 0.9, -0.6], [5, 0, 0], [0, 0, 3], "matt", view).solid, "outdoors", view)
        )
        if rng.random() < 0.7:
            scenery.append(
                curtain(
                    rng,
                    rng.choice([-0.95, 0.4]),
                    back - 0.09,
                    0.4,
                    0.01,
                    prints.plain(prints.colour(rng, "homes")),
                )
            )
    elif kind == "desk":
        elevation = (18.0, 60.0)
        scenery.append(
            board([1.5, 0.75, 0.028], [0, 0.75 / 2 - 0.75 + back, -0.028], "satin", timber(rng), 0.9)
        )
        scenery += [
            wall(back, "matt", painted(rng), 1.0, -0.74),
            panel([-3, back - 4, -0.74], [6, 0, 0], [0, 4, 0], "satin", timber(rng), 1.4),
        ]
        if rng.random() < 0.6:
            scenery.append(
                rug(
                    rng,
                    0,
                    -0.08,
                    0.6,
                    0.35,
                    0.0012,
                    prints.plain(prints.colour(rng, "homes")),
                    rng.uniform(-4, 4),
                )
            )
        scenery += frame(rng, rng.uniform(-0.4, 0.4), back, 0.55, "homes")
    elif kind == "sideboard":
        elevation = (6.0, 24.0)
        skin = timber(rng)
        scenery.append(board([1.7, deep, 0.025], [0, 0, -0.025], "satin", skin, 0.9))
        scenery += fronts(rng, 1.66, 0.5, -deep / 2 + 0.03, -0.03, skin, "homes")
        scenery += [
            wall(back, "matt", painted(rng), 1.0, -0.8),
            panel([-3, back - 4, -0.8], [6, 0, 0], [0, 4, 0], "satin", timber(rng), 1.4),
        ]
        for x in (-0.35, 0.3):
            scenery += frame(rng, x + rng.normal(0, 0.06), back, rng.uniform(0.5, 0.65), "homes")
    else:
        elevation = (28.0, 70.0)
        supports = [Support((0, -0.02, 0.006), (wide, deep * 1.2))]
        scenery += [panel([-3, back - 5, 0], [6, 0, 0], [0, 5.5, 0], "satin", timber(rng), 1.0)]
        rim = cloth(rng)
        scenery.append(Part(box([wide * 1.5, deep * 1.9, 0.006], 0.002), "matt", rim[:2, :2]))
        scenery.append(rug(rng, 0, 0, wide * 1.48, deep * 1.88, 0.00605, rim))
        far = back + 0.5
        scenery += [
            wall(far, "matt", painted(rng), 1.0),
            board([6, 0.015, 0.09], [0, far - 0.0075, 0], "satin", prints.plain([236, 234, 228])),
        ]
        scenery += fronts(rng, 1.2, 0.5, far - 0.03, 0.55, timber(rng), "homes") if rng.random() < 0.5 else []
    lamps, ambient = daylight(rng, kind)
    return Room(kind, scenery, supports, lamps, ambient, elevation, azimuth)
