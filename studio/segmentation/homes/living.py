"""Fruit, plants, flowers, as random makers: a generator in, `Thing` out; metres."""

from __future__ import annotations

import numpy as np

from studio.segmentation.homes import prints
from studio.segmentation.homes.parts import Part, Thing, flat, standing
from studio.segmentation.homes.prints import Rng
from studio.segmentation.homes.solids import (
    Solid,
    ball,
    extrude,
    hollow,
    join,
    lathe,
    rounded,
    sweep,
    turn,
)


def skin(rng: Rng, codes: list, spots: float = 0.05) -> np.ndarray:
    """A mottled peel between two or three sRGB colours."""
    a, b, *_rest = (prints.linear(np.array(c) + rng.normal(0, 8, 3)) for c in codes)
    share = np.clip(0.5 + 0.5 * prints.noise((48, 64), 16, rng), 0, 1)[..., None]
    image = a + (b - a) * share
    fine = prints.noise((48, 64), 1.5, rng)
    return np.clip(image * (1 + spots * fine)[..., None], 0.003, 1).astype(np.float32)


def apple(rng: Rng) -> Thing:
    r = rng.uniform(0.03, 0.043)
    line = (
        rounded(
            [
                [0, 0.2],
                [0.25, 0.02],
                [0.62, 0.0],
                [1.0, 0.75],
                [0.95, 1.45],
                [0.5, 1.75],
                [0.2, 1.62],
                [0, 1.4],
            ],
            3,
        )
        * r
    )
    stem = sweep(
        [[0, 0, 1.4 * r], [0.05 * r, 0, 1.7 * r], [0.2 * r, 0, 2.05 * r]],
        0.0016,
        around=7,
    )
    tones = [
        [[170, 30, 35], [205, 90, 60]],
        [[120, 160, 50], [160, 185, 80]],
        [[215, 175, 70], [200, 70, 50]],
    ]
    parts = [
        Part(lathe(line, 36), "satin", skin(rng, tones[rng.integers(3)])),
        Part(stem, "matt", prints.plain([80, 58, 36])),
    ]
    return standing("apple", parts, True)


def orange(rng: Rng) -> Thing:
    """Any citrus, lemons with their tips too."""
    r = rng.uniform(0.03, 0.045)
    tones = [
        [[235, 130, 25], [240, 150, 40]],
        [[240, 210, 50], [230, 190, 40]],
        [[110, 150, 50], [130, 170, 60]],
    ]
    body = ball([r, r, r * rng.uniform(0.92, 1.0)])
    if rng.random() < 0.5:
        line = (
            rounded(
                [[0, 0], [0.18, 0.1], [0.75, 0.6], [0.78, 1.5], [0.2, 2.2], [0, 2.35]],
                2,
            )
            * r
        )
        body = (
            lathe(line, 28)
            .moved(turn=turn("y", 90))
            .moved(turn=turn("z", rng.uniform(0, 360)))
        )
    return standing(
        "citrus",
        [Part(body, "satin", skin(rng, tones[rng.integers(len(tones))], 0.1))],
        True,
    )


def leaf(length: float, width: float, droop: float, rng: Rng, lobes: int = 0) -> Solid:
    """A closed thin blade from the origin along +x that droops; droop 0 is straight up, 1.5 hangs."""
    t = np.linspace(0, 1, 11)
    half = (
        width
        * np.sin(np.pi * t ** rng.uniform(0.7, 1.2))
        * (1 + 0.25 * np.sin(t * np.pi * lobes) ** 2)
        + 0.0008
    )
    x = np.concatenate([t, t[::-1]]) * length
    y = np.concatenate([-half, half[::-1]])
    blade = extrude(np.column_stack([x, y]), 0.0007)

    def law(p: np.ndarray) -> np.ndarray:
        s = p[:, 0] / length
        angle = np.pi / 2 - droop * s - 0.3
        fold = np.abs(p[:, 1]) * 0.35
        return np.column_stack(
            [
                s * length * np.cos(angle),
                p[:, 1],
                s * length * np.sin(angle) + fold + p[:, 2],
            ]
        )

    return blade.bent(law)


def pot(rng: Rng, radius: float, height: float) -> list[Part]:
    """A flower pot about z with its soil."""
    line = [
        [radius * rng.uniform(0.6, 0.85), 0],
        [radius, height * 0.8],
        [radius, height],
    ]
    if rng.random() < 0.5:
        line = [
            [radius * 0.7, 0],
            [radius * 0.9, height * 0.75],
            [radius, height * 0.75],
            [radius, height],
        ]
    clay = (
        prints.plain([178, 98, 64])
        if rng.random() < 0.35
        else prints.pattern(rng)
        if rng.random() < 0.4
        else flat(rng)
    )
    soil = lathe(
        [
            [0, height * 0.75],
            [radius * 0.86, height * 0.75],
            [radius * 0.9, height * 0.86],
            [0, height * 0.9],
        ],
        24,
    )
    return [
        Part(
            lathe(hollow(np.array(line), 0.004, 0.006)),
            str(rng.choice(["matt", "glossy", "satin"])),
            clay,
        ),
        Part(soil, "matt", prints.plain([52, 38, 28])),
    ]


def green(rng: Rng) -> np.ndarray:
    return skin(
        rng,
        [
            [rng.uniform(40, 110), rng.uniform(95, 150), rng.uniform(40, 80)],
            [rng.uniform(60, 140), rng.uniform(120, 170), rng.uniform(50, 100)],
        ],
    )


def plant(rng: Rng) -> Thing:
    """A potted plant: a rosette, a shrub of balls or a cactus."""
    r, h = rng.uniform(0.035, 0.075), rng.uniform(0.05, 0.11)
    parts, leaves = pot(rng, r, h), []
    stems: list[Solid] = []
    if rng.random() < 0.3:  # a cactus
        tall = rng.uniform(0.05, 0.13)
        leaves.append(
            lathe(
                rounded([[0, 0], [r * 0.5, 0], [r * 0.55, tall * 0.6], [0, tall]], 2),
                int(rng.choice([9, 12, 28])),
            ).moved([0, 0, h * 0.8])
        )
        if rng.random() < 0.5:
            leaves.append(
                sweep(
                    rounded(
                        [
                            [0, 0, h + tall * 0.3],
                            [r * 0.8, 0, h + tall * 0.35],
                            [r * 0.85, 0, h + tall * 0.8],
                        ],
                        2,
                    ),
                    r * 0.22,
                )
            )
    elif rng.random() < 0.35:  # a clipped bush
        for _ in range(rng.integers(3, 9)):
            a = rng.uniform(0.3, 0.7) * r
            leaves.append(
                ball(a, 12, 7).moved(rng.normal(0, 0.4 * r, 3) + [0, 0, h + r * 0.7])
            )
        stems.append(
            sweep([[0, 0, h * 0.8], [0, 0, h + r * 0.4], [0, 0, h + r * 0.8]], 0.004)
        )
    else:
        count, long = int(rng.integers(6, 20)), rng.uniform(0.06, 0.2)
        for k in range(count):
            blade = leaf(
                long * rng.uniform(0.6, 1),
                rng.uniform(0.008, 0.03),
                rng.uniform(0.2, 1.9),
                rng,
            )
            leaves.append(blade.moved([0, 0, h * 0.86], turn("z", 137.5 * k)))
    tone = green(rng)
    parts.append(Part(join(leaves), "satin", tone))
    if stems:
        parts.append(Part(join(stems), "satin", prints.plain([90, 120, 60])))
    thing = standing("plant", parts, True)
    return Thing("plant", thing.parts, np.asarray(thing.foot) * 0.8, thing.height)


def mushroom(rng: Rng) -> Thing:
    r = rng.uniform(0.02, 0.05)
    stem = lathe(rounded([[0, 0], [r * 0.4, 0], [r * 0.3, r], [0, r]], 1), 24)
    cap = lathe(
        rounded([[0, r * 0.9], [r, r * 0.8], [r * 0.9, r * 1.4], [0, r * 1.8]], 2), 32
    )
    return standing(
        "mushroom",
        [
            Part(stem, "matt", prints.plain([230, 220, 200])),
            Part(cap, "satin", prints.pattern(rng)),
        ],
        True,
    )
