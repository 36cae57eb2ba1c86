"""Fruit, plants, flowers, as random makers: (generator, family) in, `Thing` out; metres."""

from __future__ import annotations

import numpy as np

from studio.segmentation.homes import prints
from studio.segmentation.homes.parts import Part, Thing, flat, standing
from studio.segmentation.homes.prints import Rng
from studio.segmentation.homes.solids import Solid, ball, extrude, hollow, join, lathe, rounded, sweep, turn


def skin(rng: Rng, codes: list, spots: float = 0.05) -> np.ndarray:
    """A mottled peel between two or three sRGB colours."""
    a, b, *_rest = (prints.linear(np.array(c) + rng.normal(0, 8, 3)) for c in codes)
    share = np.clip(0.5 + 0.5 * prints.noise((48, 64), 16, rng), 0, 1)[..., None]
    image = a + (b - a) * share
    fine = prints.noise((48, 64), 1.5, rng)
    return np.clip(image * (1 + spots * fine)[..., None], 0.003, 1).astype(np.float32)


def apple(rng: Rng, family: str) -> Thing:
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
    stem = sweep([[0, 0, 1.4 * r], [0.05 * r, 0, 1.7 * r], [0.2 * r, 0, 2.05 * r]], 0.0016, around=7)
    tones = [
        [[170, 30, 35], [205, 90, 60]],
        [[120, 160, 50], [160, 185, 80]],
        [[215, 175, 70], [200, 70, 50]],
    ]
    parts = [
        Part(lathe(line, 36), "satin", skin(rng, tones[rng.integers(3)])),
        Part(stem, "matt", prints.plain([80, 58, 36])),
    ]
    if family == "homes" and rng.random() < 0.3:
        parts.append(
            Part(leaf(0.03, 0.014, 0.3, rng).moved([0, 0, 1.8 * r]), "satin", prints.plain([80, 120, 50]))
        )
    return standing("apple", parts, True)


def orange(rng: Rng, family: str) -> Thing:
    """An orange; in `train` any citrus, lemons with their tips too."""
    r = rng.uniform(0.03, 0.045)
    tones = (
        [[[235, 130, 25], [240, 150, 40]]]
        if family == "homes"
        else [
            [[235, 130, 25], [240, 150, 40]],
            [[240, 210, 50], [230, 190, 40]],
            [[110, 150, 50], [130, 170, 60]],
        ]
    )
    body = ball([r, r, r * rng.uniform(0.92, 1.0)])
    if family == "train" and rng.random() < 0.5:
        line = rounded([[0, 0], [0.18, 0.1], [0.75, 0.6], [0.78, 1.5], [0.2, 2.2], [0, 2.35]], 2) * r
        body = lathe(line, 28).moved(turn=turn("y", 90)).moved(turn=turn("z", rng.uniform(0, 360)))
    return standing("citrus", [Part(body, "satin", skin(rng, tones[rng.integers(len(tones))], 0.1))], True)


def pear(rng: Rng, family: str) -> Thing:
    r = rng.uniform(0.03, 0.04)
    line = (
        rounded(
            [[0, 0.12], [0.3, 0], [1.0, 0.5], [1.0, 1.2], [0.5, 2.0], [0.42, 2.5], [0.15, 2.65], [0, 2.55]], 3
        )
        * r
    )
    stem = sweep([[0, 0, 2.5 * r], [0.08 * r, 0, 2.9 * r], [0.25 * r, 0, 3.3 * r]], 0.0018, around=7)
    lean = turn("z", rng.uniform(0, 360)) @ turn("y", rng.choice([0.0, 0.0, 75.0]))
    parts = [
        Part(lathe(line, 32), "satin", skin(rng, [[170, 170, 60], [190, 150, 70]], 0.1)),
        Part(stem, "matt", prints.plain([70, 50, 30])),
    ]
    return standing("pear", [p.moved(turn=lean) for p in parts])


def banana(rng: Rng, family: str) -> Thing:
    """One, or a hand of two or three; lying."""
    fingers, tips = [], []
    for k in range(int(rng.choice([1, 1, 2, 3]))):
        t = np.linspace(-0.75, 0.75, 15)
        bend = rng.uniform(0.09, 0.12)
        path = np.column_stack([bend * np.sin(t), bend * (1 - np.cos(t)), 0 * t])
        thick = 0.017 * np.clip(1.15 - (np.abs(t) / 0.78) ** 4, 0.28, 1)
        spin = turn("z", 14 * k)
        fingers.append(sweep(path, thick, 0.92, 7, up=(0, 0, 1)).moved([0, 0.03 * k, 0.004 * k], spin))
        tips.append(
            sweep(
                [path[-1], path[-1] + [0.009, 0.012, 0], path[-1] + [0.016, 0.026, 0]], 0.0045, around=7
            ).moved([0, 0.03 * k, 0.004 * k], spin)
        )
    spin = turn("z", rng.uniform(0, 360))
    parts = [
        Part(join(fingers), "satin", skin(rng, [[235, 205, 70], [220, 180, 60]], 0.06)),
        Part(join(tips), "matt", prints.plain([120, 110, 50])),
    ]
    return standing("banana", [p.moved(turn=spin) for p in parts])


def leaf(length: float, width: float, droop: float, rng: Rng, lobes: int = 0) -> Solid:
    """A closed thin blade from the origin along +x that droops; droop 0 is straight up, 1.5 hangs."""
    t = np.linspace(0, 1, 11)
    half = (
        width * np.sin(np.pi * t ** rng.uniform(0.7, 1.2)) * (1 + 0.25 * np.sin(t * np.pi * lobes) ** 2)
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
            [s * length * np.cos(angle), p[:, 1], s * length * np.sin(angle) + fold + p[:, 2]]
        )

    return blade.bent(law)


def pot(rng: Rng, family: str, radius: float, height: float) -> list[Part]:
    """A flower pot about z with its soil."""
    line = [[radius * rng.uniform(0.6, 0.85), 0], [radius, height * 0.8], [radius, height]]
    if family == "train" and rng.random() < 0.5:
        line = [[radius * 0.7, 0], [radius * 0.9, height * 0.75], [radius, height * 0.75], [radius, height]]
    clay = (
        prints.plain([178, 98, 64])
        if rng.random() < 0.35
        else prints.pattern(rng, family)
        if rng.random() < 0.4
        else flat(rng, family)
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
        Part(lathe(hollow(np.array(line), 0.004, 0.006)), str(rng.choice(["matt", "glossy", "satin"])), clay),
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


def plant(rng: Rng, family: str) -> Thing:
    """A potted plant: `train` rosettes, shrubs of balls and cacti; `homes` stems with leaves, ferns, tongues."""
    r, h = rng.uniform(0.035, 0.075), rng.uniform(0.05, 0.11)
    parts, leaves = pot(rng, family, r, h), []
    stems: list[Solid] = []
    if family == "train" and rng.random() < 0.3:  # a cactus
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
    elif family == "train" and rng.random() < 0.35:  # a clipped bush
        for _ in range(rng.integers(3, 9)):
            a = rng.uniform(0.3, 0.7) * r
            leaves.append(ball(a, 12, 7).moved(rng.normal(0, 0.4 * r, 3) + [0, 0, h + r * 0.7]))
        stems.append(sweep([[0, 0, h * 0.8], [0, 0, h + r * 0.4], [0, 0, h + r * 0.8]], 0.004))
    elif family == "train":
        count, long = int(rng.integers(6, 20)), rng.uniform(0.06, 0.2)
        for k in range(count):
            blade = leaf(long * rng.uniform(0.6, 1), rng.uniform(0.008, 0.03), rng.uniform(0.2, 1.9), rng)
            leaves.append(blade.moved([0, 0, h * 0.86], turn("z", 137.5 * k)))
    elif rng.random() < 0.3:  # tongues
        for k in range(int(rng.integers(5, 11))):
            blade = leaf(rng.uniform(0.14, 0.3), rng.uniform(0.014, 0.022), rng.uniform(-0.25, 0.3), rng)
            leaves.append(
                blade.moved(
                    [rng.normal(0, r * 0.25), rng.normal(0, r * 0.25), h * 0.85], turn("z", 137.5 * k)
                )
            )
    else:
        for k in range(int(rng.integers(5, 12))):
            way, high = turn("z", 137.5 * k + rng.uniform(-20, 20)), rng.uniform(0.06, 0.2)
            out = rng.uniform(0.2, 0.9) * high
            path = rounded([[0, 0, h * 0.8], [out * 0.2, 0, h + high * 0.6], [out, 0, h + high]], 2)
            stems.append(sweep(path, 0.0018, around=6).moved(turn=way))
            for m in range(int(rng.integers(1, 4))):
                spot = path[-1 - 3 * m] if 3 * m < len(path) else path[-1]
                blade = leaf(
                    rng.uniform(0.05, 0.1),
                    rng.uniform(0.02, 0.036),
                    rng.uniform(1.0, 2.2),
                    rng,
                    int(rng.integers(0, 4)),
                )
                leaves.append(blade.moved(turn=turn("z", rng.uniform(-70, 70))).moved(spot).moved(turn=way))
    tone = green(rng)
    parts.append(Part(join(leaves), "satin", tone))
    if stems:
        parts.append(Part(join(stems), "satin", prints.plain([90, 120, 60])))
    thing = standing("plant", parts, True)
    return Thing("plant", thing.parts, np.asarray(thing.foot) * 0.8, thing.height)


def bouquet(rng: Rng, family: str) -> Thing:
    """Flowers with petals in a vase or a glass: one thing."""
    height, r = rng.uniform(0.09, 0.18), rng.uniform(0.028, 0.045)
    line = rounded([[r * 0.7, 0], [r, height * 0.3], [r * 0.6, height * 0.75], [r * 0.7, height]], 2)
    clear = rng.random() < 0.3
    parts = [
        Part(
            lathe(hollow(line, 0.003, 0.006)),
            "glass" if clear else "glossy",
            prints.plain([240, 247, 245]) if clear else prints.pattern(rng, family),
        )
    ]
    stems, petals, hearts, leaves = [], [], [], []
    for k in range(int(rng.integers(2, 8))):
        way = turn("z", 137.5 * k)
        out, high = rng.uniform(0.0, 0.08), height + rng.uniform(0.04, 0.16)
        path = rounded([[0, 0, 0.012], [r * 0.35, 0, height], [r * 0.4 + out, 0, high]], 2)
        stems.append(sweep(path, 0.0019, around=6).moved(turn=way))
        size, count, open_ = rng.uniform(0.014, 0.034), int(rng.integers(5, 14)), rng.uniform(0.1, 1.2)
        for m in range(count):
            blade = leaf(size, size * 0.36, 0.4, rng).moved(turn=turn("y", 57 * open_))
            petals.append(blade.moved(turn=turn("z", 360 * m / count)).moved(path[-1]).moved(turn=way))
        hearts.append(ball(size * 0.25, 12, 7).moved(path[-1] + [0, 0, size * 0.1]).moved(turn=way))
        if rng.random() < 0.6:
            leaves.append(leaf(0.06, 0.012, 1.0, rng).moved(path[len(path) * 2 // 3]).moved(turn=way))
    parts += [
        Part(join(stems + leaves), "satin", green(rng)),
        Part(join(petals), "satin", flat(rng, family)),
        Part(join(hearts), "matt", prints.plain([215, 165, 50])),
    ]
    thing = standing("bouquet", parts, True)
    return Thing("bouquet", thing.parts, np.asarray(thing.foot) * 0.7, thing.height)


def mushroom(rng: Rng, family: str) -> Thing:
    r = rng.uniform(0.02, 0.05)
    stem = lathe(rounded([[0, 0], [r * 0.4, 0], [r * 0.3, r], [0, r]], 1), 24)
    cap = lathe(rounded([[0, r * 0.9], [r, r * 0.8], [r * 0.9, r * 1.4], [0, r * 1.8]], 2), 32)
    return standing(
        "mushroom",
        [Part(stem, "matt", prints.plain([230, 220, 200])), Part(cap, "satin", prints.pattern(rng, family))],
        True,
    )
