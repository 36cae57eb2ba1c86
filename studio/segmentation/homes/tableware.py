"""Things to eat and drink from, as random makers: a generator in, `Thing` out; lengths in metres."""

from __future__ import annotations

import numpy as np

from studio.segmentation.homes import prints
from studio.segmentation.homes.parts import Part, Thing, flat, standing
from studio.segmentation.homes.prints import Rng
from studio.segmentation.homes.solids import (
    Solid,
    extrude,
    hollow,
    lathe,
    rounded,
    sweep,
    turn,
)


def glaze(rng: Rng, printed: float = 0.45) -> np.ndarray:
    """A colour or a print for a glazed or painted thing."""
    return prints.pattern(rng) if rng.random() < printed else flat(rng)


def china(rng: Rng) -> str:
    return "glossy" if rng.random() < 0.7 else "satin"


def wall_line(rng: Rng, low: float, high: float, height: float) -> np.ndarray:
    """(P, 2) an outer wall from the foot (radius `low`) to the rim (`high`): steps,
    cones, barrels."""
    middle = rng.uniform(min(low, high), max(low, high) * 1.15)
    line = [[low, 0], [middle, height * rng.uniform(0.1, 0.6)], [high, height]]
    return rounded(line, int(rng.choice([0, 1, 3])))


def handle(rng: Rng, radius: float, low: float, high: float, thick: float) -> Solid:
    """An ear on the +x side of a wall of `radius`, between heights `low` and `high`."""
    reach, middle = rng.uniform(0.5, 0.85) * (high - low), (low + high) / 2
    if rng.random() < 0.5:
        line = [[-0.1 * reach, high], [reach, high], [reach, low], [-0.1 * reach, low]]
        path = rounded(line, int(rng.integers(1, 3)))
    else:
        angle = np.linspace(np.pi / 2 + 0.25, -np.pi / 2 - 0.25, 15)
        path = np.stack(
            [reach * np.cos(angle), middle + (high - low) / 2 * np.sin(angle)], 1
        )
        path[:, 1] += 0.1 * (high - low) * rng.uniform(-1, 1) * np.cos(angle)
    points = np.column_stack(
        [path[:, 0] + radius - 0.5 * thick, np.zeros(len(path)), path[:, 1]]
    )
    return sweep(
        points,
        thick,
        rng.uniform(0.5, 1.0),
        10,
        up=(0, 1, 0) if rng.random() < 0.3 else None,
    )


def mug(rng: Rng) -> Thing:
    """A mug or a cup with its handle."""
    cup = rng.random() < 0.4
    height = rng.uniform(0.05, 0.07) if cup else rng.uniform(0.08, 0.115)
    high = rng.uniform(0.036, 0.048)
    low = high * (rng.uniform(0.5, 0.75) if cup else rng.uniform(0.8, 1.0))
    line = wall_line(rng, low, high, height)
    wall = rng.uniform(0.002, 0.005)
    skin, finish = glaze(rng), china(rng)
    body = lathe(hollow(line, wall, 0.006))
    at = rng.uniform(0.15, 0.3) * height, rng.uniform(0.7, 0.9) * height
    radius = float(np.interp((at[0] + at[1]) / 2, line[:, 1], line[:, 0]))
    ear = handle(rng, radius, *at, rng.uniform(0.0035, 0.007))
    parts = [Part(body, finish, skin), Part(ear, finish, skin[:1, :1])]
    if rng.random() < 0.3:
        drink = lathe(
            [
                [0, height * 0.4],
                [radius * 0.97 - wall, height * 0.4],
                [
                    np.interp(height * 0.8, line[:, 1], line[:, 0]) - wall * 0.8,
                    height * 0.8,
                ],
                [0, height * 0.8],
            ]
        )
        parts.append(
            Part(
                drink,
                "glossy",
                prints.plain(
                    rng.choice([[48, 26, 12], [120, 70, 30], [230, 215, 190]])
                ),
            )
        )
    spin = turn("z", rng.uniform(0, 360))
    well = (low * 0.9 - wall, height - 0.006) if len(parts) == 2 else None
    return standing("mug", [part.moved(turn=spin) for part in parts], True, well=well)


def plate_line(radius: float, rise: float, foot: float) -> np.ndarray:
    return np.array([[foot * radius, 0], [radius * 0.7, rise * 0.25], [radius, rise]])


def plate(rng: Rng) -> Thing:
    radius = rng.uniform(0.06, 0.14)
    line = rounded(
        plate_line(radius, rng.uniform(0.008, 0.028), rng.uniform(0.45, 0.65)), 2
    )
    return standing(
        "plate",
        [Part(lathe(hollow(line, 0.004, 0.004), 56), china(rng), glaze(rng))],
        True,
        top=(radius * 0.8,) * 2,
    )


def bowl(rng: Rng) -> Thing:
    radius, height = rng.uniform(0.05, 0.13), rng.uniform(0.04, 0.09)
    line = rounded(
        [
            [radius * 0.45, 0],
            [radius * rng.uniform(0.55, 0.95), height * 0.3],
            [radius, height],
        ],
        3,
    )
    finish = rng.choice(["glossy", "satin", "steel"], p=[0.6, 0.3, 0.1])
    return standing(
        "bowl",
        [Part(lathe(hollow(line, 0.004, 0.006), 48), str(finish), glaze(rng))],
        True,
    )


def tumbler(rng: Rng) -> Thing:
    """A drinking glass or a plastic cup; half full sometimes."""
    height, high = rng.uniform(0.08, 0.16), rng.uniform(0.028, 0.042)
    low = high * rng.uniform(0.7, 1.0)
    line = [[low, 0], [(low + high) / 2, height / 2], [high, height]]
    clear = rng.random() < 0.7
    tint = prints.plain(255 - (255 - prints.colour(rng)) * rng.uniform(0.03, 0.35))
    parts = [
        Part(
            lathe(hollow(line, 0.002, 0.008)),
            "glass" if clear else "satin",
            tint if clear else glaze(rng),
        )
    ]
    full = clear and rng.random() < 0.5
    if full:
        level, tone = height * rng.uniform(0.3, 0.8), prints.plain(prints.colour(rng))
        edge = low + (high - low) * level / height - 0.003
        parts.append(
            Part(
                lathe([[0, 0.009], [low - 0.003, 0.009], [edge, level], [0, level]]),
                "glossy",
                tone,
            )
        )
    return standing(
        "tumbler", parts, True, well=None if full else (low - 0.004, height - 0.01)
    )


def bottle(rng: Rng) -> Thing:
    """Wine, oil, sauce, detergent: of clear or coloured glass or of plastic, with a label and a cap."""
    height, r = rng.uniform(0.14, 0.32), rng.uniform(0.024, 0.045)
    neck, shoulder = r * rng.uniform(0.28, 0.5), rng.uniform(0.5, 0.72)
    line = [
        [r * 0.94, 0],
        [r, 0.006],
        [r, height * shoulder],
        [neck, height * rng.uniform(shoulder + 0.08, 0.86)],
        [neck, height],
    ]
    line = rounded(line, int(rng.integers(0, 3)))
    clear = rng.random() < 0.4
    tint = prints.colour(rng)
    skin = (
        prints.plain(255 - (255 - tint) * rng.uniform(0.1, 0.9))
        if clear
        else prints.plain(tint)
    )
    parts = [
        Part(
            lathe(np.concatenate([[[0, 0]], line, [[0, height]]])),
            "glass" if clear else china(rng),
            skin,
        )
    ]
    low, high = (
        height * rng.uniform(0.1, 0.2),
        height * min(rng.uniform(0.4, 0.65), shoulder - 0.06),
    )
    if rng.random() < 0.85 and high > low:
        paper = prints.pattern(rng, 64, 160)
        band = lathe(
            [[0, low], [r + 0.0006, low], [r + 0.0006, high], [0, high]]
            if not clear
            else hollow([[r + 0.0006, low], [r + 0.0006, high]], 0.0005, 0.0002)
        )
        parts.append(Part(band, "satin", paper))
    if rng.random() < 0.8:
        cap = lathe(
            [
                [0, height - 0.012],
                [neck + 0.002, height - 0.012],
                [neck + 0.002, height + 0.008],
                [0, height + 0.008],
            ]
        )
        parts.append(Part(cap, str(rng.choice(["satin", "steel", "matt"])), flat(rng)))
    return standing("bottle", parts, True)


def jar(rng: Rng) -> Thing:
    """Of glass with something in it, or of tin or stoneware; with a lid."""
    r, height = rng.uniform(0.03, 0.05), rng.uniform(0.06, 0.16)
    line = rounded(
        [[r * 0.92, 0], [r, 0.005], [r, height * 0.86], [r * 0.8, height]], 2
    )
    clear = rng.random() < 0.5
    parts = [
        Part(
            lathe(hollow(line, 0.0025, 0.005)),
            "glass" if clear else china(rng),
            prints.plain([245, 249, 247]) if clear else glaze(rng, 0.6),
        )
    ]
    if clear:
        level = height * rng.uniform(0.3, 0.8)
        parts.append(
            Part(
                lathe([[0, 0.006], [r - 0.004, 0.006], [r - 0.004, level], [0, level]]),
                "satin",
                glaze(rng, 0.5),
            )
        )
    if rng.random() < 0.85:
        lid = lathe(
            rounded(
                [
                    [0, height - 0.012],
                    [r * 0.86, height - 0.012],
                    [r * 0.86, height + 0.005],
                    [0, height + 0.008],
                ],
                1,
            )
        )
        parts.append(Part(lid, str(rng.choice(["steel", "satin", "matt"])), flat(rng)))
    return standing("jar", parts, True)


def can(rng: Rng) -> Thing:
    r, height = rng.uniform(0.026, 0.05), rng.uniform(0.06, 0.14)
    tin = lathe(
        rounded(
            [
                [0, 0],
                [r * 0.94, 0],
                [r, 0.004],
                [r, height - 0.004],
                [r * 0.95, height],
                [r * 0.93, height - 0.003],
                [0, height - 0.003],
            ],
            1,
        )
    )
    paper = prints.pattern(rng, 64, 160)
    band = lathe(
        [
            [0, 0.007],
            [r + 0.0005, 0.007],
            [r + 0.0005, height - 0.007],
            [0, height - 0.007],
        ]
    )
    return standing(
        "can",
        [
            Part(tin, "steel", prints.plain([205, 205, 208])),
            Part(band, "satin" if rng.random() < 0.6 else "brushed", paper),
        ],
        True,
        top=(r, r),
    )


def totem(rng: Rng) -> Thing:
    """Something turned on a lathe by chance: a pawn, a pepper mill, a spool, a vase without a name."""
    height, count = rng.uniform(0.05, 0.25), int(rng.integers(4, 9))
    radius = rng.uniform(0.12, 0.4, count) * height * rng.uniform(0.4, 1.0)
    line = np.column_stack([radius, np.linspace(0, height, count)])
    line = rounded(line, int(rng.integers(0, 4)))
    profile = np.concatenate([[[0, 0]], line, [[0, height]]])
    return standing(
        "totem",
        [
            Part(
                lathe(profile),
                str(rng.choice(["matt", "satin", "glossy", "steel", "brushed"])),
                glaze(rng),
            )
        ],
        True,
    )


def cutlery(rng: Rng) -> Thing:
    """A spoon, a fork or a knife, lying along x; of steel, wood or plastic."""
    kind = str(rng.choice(["spoon", "fork", "knife"]))
    length, w = rng.uniform(0.13, 0.21), rng.uniform(0.004, 0.0065)
    n = 14
    x = np.linspace(-length / 2, length * 0.18, n)
    lift = 0.004 + 0.006 * np.sin(np.linspace(0, np.pi, n)) * rng.uniform(0.2, 1)
    stem = sweep(
        np.column_stack([x, 0 * x, lift]),
        w * np.interp(np.linspace(0, 1, n), [0, 0.4, 1], [1.3, 1.0, 0.6]),
        0.35,
        10,
        up=(0, 0, 1),
    )
    end, w2 = length / 2, w * rng.uniform(2.2, 3.4)
    if kind == "spoon":
        t = np.linspace(0, 2 * np.pi, 25)[:-1]
        outline = np.column_stack(
            [
                end - length * 0.17 + length * 0.17 * np.cos(t),
                w2 * np.sin(t) * (1 + 0.15 * np.cos(t)),
            ]
        )
        head = extrude(outline, 0.0016, 0.0006).bent(
            lambda p: _dish(p, end - length * 0.17, length * 0.17, w2)
        )
    elif kind == "fork":
        s, tine = w2 * 0.85, end - length * 0.13
        teeth = []
        for k in range(4):
            y = -s + 2 * s * (k + 0.5) / 4
            teeth += [
                [tine, y - s * 0.13],
                [end, y - s * 0.08],
                [end, y + s * 0.08],
                [tine, y + s * 0.13],
            ]
        outline = [
            [length * 0.16, -w * 0.5],
            [length * 0.24, -s],
            *teeth,
            [length * 0.24, s],
            [length * 0.16, w * 0.5],
        ]
        head = extrude(outline, 0.0016, 0.0).bent(
            lambda p: _dish(p, end - length * 0.17, length * 0.17, w2 * 3)
        )
    else:
        blade = rounded(
            [
                [length * 0.12, -w],
                [length * 0.2, -w * 1.5],
                [end - 0.02, -w * 1.6],
                [end, w * 0.6],
                [length * 0.12, w * 0.7],
            ],
            1,
            closed=True,
        )
        head = extrude(blade, 0.0018, 0.0006).moved([0, 0, 0.002])
    if rng.random() < 0.45:
        finish, skin = "satin", flat(rng)
    else:
        finish, skin = (
            str(rng.choice(["steel", "brushed"])),
            prints.plain(
                rng.choice([[215, 214, 212], [225, 200, 140]], p=[0.85, 0.15])
            ),
        )
    return standing(
        kind, [Part(stem, finish, skin), Part(head, finish, skin)], rod=length
    )


def _dish(points: np.ndarray, middle: float, half: float, wide: float) -> np.ndarray:
    """A flat head pressed into a bowl."""
    depth = np.clip(
        ((points[:, 0] - middle) / half) ** 2 + (points[:, 1] / wide) ** 2, 0, 1
    )
    return points + np.column_stack([0 * depth, 0 * depth, 0.007 * depth - 0.001])
