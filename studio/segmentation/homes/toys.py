"""Toys, balls and shoes, as random makers: (generator, family) in, `Thing` out; metres."""

from __future__ import annotations

import numpy as np

from studio.segmentation.homes import prints
from studio.segmentation.homes.parts import Part, Thing, flat, standing
from studio.segmentation.homes.prints import Rng
from studio.segmentation.homes.solids import ball as sphere
from studio.segmentation.homes.solids import box, extrude, join, lathe, rounded, sweep, turn


def ball(rng: Rng, family: str) -> Thing:
    """Plain, printed, or in panels; of rubber, glass or leather."""
    r = rng.choice([rng.uniform(0.012, 0.025), rng.uniform(0.03, 0.06), rng.uniform(0.06, 0.11)])
    y, x = np.mgrid[:48, :96]
    if rng.random() < 0.4:
        a, b = (prints.linear(prints.colour(rng, family)) for _ in range(2))
        skin = np.where(
            (((x * rng.integers(1, 4)) // 16 + (y // 24) * (family == "homes")) % 2 > 0)[..., None], a, b
        )
    else:
        skin = prints.pattern(rng, family) if rng.random() < 0.5 else flat(rng, family)
    lean = turn("x", rng.uniform(0, 90)) @ turn("z", rng.uniform(0, 360))
    return standing(
        "ball",
        [
            Part(
                sphere(float(r), 40, 23).moved(turn=lean),
                str(rng.choice(["matt", "satin", "glossy"])),
                skin.astype(np.float32),
            )
        ],
        True,
    )


def wheels(at: list, radius: float, width: float, family: str) -> tuple[list, list]:
    """Tyres and hubs, axles along y."""
    lay = turn("x", 90)
    tyre = lathe(
        rounded(
            [
                [0, -width / 2],
                [radius * 0.9, -width / 2],
                [radius, -width / 4],
                [radius, width / 4],
                [radius * 0.9, width / 2],
                [0, width / 2],
            ],
            1,
        ),
        22,
    )
    hub = lathe(
        [[0, -width * 0.56], [radius * 0.5, -width * 0.56], [radius * 0.5, width * 0.56], [0, width * 0.56]],
        14,
    )
    return [tyre.moved(a, lay) for a in at], [hub.moved(a, lay) for a in at]


def car(rng: Rng, family: str) -> Thing:
    """A toy car along x: `train` a van, a truck or a wooden block on wheels, `homes` a saloon with round corners."""
    length = rng.uniform(0.06, 0.18)
    wide, r = length * rng.uniform(0.4, 0.5), length * rng.uniform(0.09, 0.13)
    h = length * rng.uniform(0.14, 0.2)
    lay = turn("x", 90)
    paint, finish = flat(rng, family), "glossy" if rng.random() < 0.6 else "satin"
    parts: list[Part] = []
    if family == "homes":
        a = length / 2
        hull = rounded(
            [[-a, 0], [a, 0], [a, h * 0.7], [a * 0.55, h], [-a * 0.9, h * 1.05], [-a, h * 0.6]],
            2,
            closed=True,
        )
        cabin = rounded(
            [[-a * 0.75, h * 0.9], [a * 0.5, h * 0.9], [a * 0.15, h * 1.9], [-a * 0.45, h * 1.9]],
            1,
            closed=True,
        )
        inner = (cabin - cabin.mean(0)) * [0.84, 0.7] + cabin.mean(0) + [0, 0.06 * h]
        parts.append(
            Part(
                join(
                    [
                        extrude(hull, wide, wide * 0.08).moved([0, wide / 2, r * 0.5], lay),
                        extrude(cabin, wide * 0.84, wide * 0.1).moved([0, wide * 0.42, r * 0.5], lay),
                    ]
                ),
                finish,
                paint,
            )
        )
        parts.append(
            Part(
                extrude(inner, wide * 0.87).moved([0, wide * 0.435, r * 0.5], lay),
                "glossy",
                prints.plain([36, 44, 54]),
            )
        )
        lights = [
            sphere(h * 0.16, 10, 7).moved([a * 0.93, s * wide * 0.33, r * 0.5 + h * 0.55]) for s in (-1, 1)
        ]
        parts.append(Part(join(lights), "glossy", prints.plain([240, 235, 200])))
        spots = [-0.58 * a, 0.58 * a]
    else:
        cut = rng.uniform(0.3, 0.75)
        hull = box([length, wide, h], rng.uniform(0.001, 0.005)).moved([0, 0, r * 0.6])
        cabin = box([length * cut, wide * 0.92, h * rng.uniform(0.8, 1.6)], rng.uniform(0.001, 0.006)).moved(
            [length * (0.5 - cut / 2) * rng.choice([-1, 0, 0.6]), 0, r * 0.6 + h * 0.96]
        )
        parts += [
            Part(hull, finish, paint),
            Part(cabin, finish, paint if rng.random() < 0.5 else flat(rng, family)),
        ]
        low, high = cabin.vertices.min(0), cabin.vertices.max(0)
        pane = box([(high - low)[0] * 0.6, wide * 0.94, (high - low)[2] * 0.4], 0.0005)
        parts.append(
            Part(
                pane.moved([(low + high)[0] / 2, 0, low[2] + (high - low)[2] * 0.45]),
                "glossy",
                prints.plain([40, 55, 75]),
            )
        )
        spots = list(np.linspace(-0.36, 0.36, int(rng.choice([2, 2, 3]))) * length)
    tyres, hubs = wheels([[x, s * wide * 0.46, r] for x in spots for s in (-1, 1)], r, wide * 0.16, family)
    parts += [
        Part(join(tyres), "matt", prints.plain([30, 30, 32])),
        Part(join(hubs), "satin", flat(rng, family)),
    ]
    return standing("car", [p.moved(turn=turn("z", rng.choice([0, 180]))) for p in parts])


def robot(rng: Rng, family: str) -> Thing:
    """A figure of boxes and cylinders (`train` only)."""
    s = rng.uniform(0.05, 0.12)
    trunk = box([s * 0.5, s * 0.3, s * 0.55], s * rng.uniform(0.01, 0.08)).moved([0, 0, s * 0.4])
    head = (
        box([s * 0.3, s * 0.26, s * 0.28], s * 0.03)
        if rng.random() < 0.6
        else lathe(rounded([[0, 0], [s * 0.16, 0], [s * 0.16, s * 0.2], [0, s * 0.3]], 1), 20)
    ).moved([0, 0, s * 0.95])
    legs = [box([s * 0.15, s * 0.22, s * 0.42], s * 0.02).moved([x * s * 0.14, 0, 0]) for x in (-1, 1)]
    arms = [
        sweep(
            [
                [x * s * 0.24, 0, s * 0.85],
                [x * s * 0.36, -0.02 * s, s * 0.7],
                [x * s * 0.36, -s * rng.uniform(0, 0.3), s * 0.5],
            ],
            s * 0.055,
        )
        for x in (-1, 1)
    ]
    eyes = [sphere(s * 0.03, 10, 7).moved([x * s * 0.07, -s * 0.13, s * 1.1]) for x in (-1, 1)]
    parts = [
        Part(
            join([trunk]), "satin", prints.pattern(rng, family) if rng.random() < 0.4 else flat(rng, family)
        ),
        Part(head, "satin", flat(rng, family)),
        Part(join(legs), "satin", flat(rng, family)),
        Part(join(arms), "glossy", flat(rng, family)),
        Part(join(eyes), "glossy", prints.plain([20, 20, 22])),
    ]
    return standing("robot", parts, faces=True)


def bear(rng: Rng, family: str) -> Thing:
    """A sitting cuddly animal with round or long ears (`homes` only)."""
    s = rng.uniform(0.08, 0.16)
    fur = prints.linear(
        np.array([[150, 105, 65], [205, 190, 170], [120, 120, 125], [200, 160, 150]])[rng.integers(4)]
    )
    grain = np.clip(1 + 0.18 * prints.noise((64, 64), 2, rng), 0.4, 1.6)[..., None] * fur
    around = [
        sphere(s * np.array([0.3, 0.26, 0.33])).moved([0, 0, s * 0.32]),
        sphere(s * np.array([0.24, 0.22, 0.22])).moved([0, -s * 0.02, s * 0.8]),
    ]
    for x in (-1, 1):
        ear = (
            sphere(s * np.array([0.09, 0.05, 0.09])).moved([x * s * 0.18, 0, s * 0.98])
            if rng.random() < 0.6
            else sphere(s * np.array([0.06, 0.04, 0.2])).moved([x * s * 0.1, 0, s * 1.12])
        )
        around += [
            ear,
            sphere(s * np.array([0.1, 0.2, 0.1])).moved([x * s * 0.2, -s * 0.28, s * 0.1]),
            sphere(s * np.array([0.08, 0.09, 0.2])).moved(
                [x * s * 0.3, -s * 0.08, s * 0.4], turn("y", x * -25)
            ),
        ]
    muzzle = sphere(s * np.array([0.1, 0.09, 0.08])).moved([0, -s * 0.2, s * 0.74])
    dots = [sphere(s * 0.025, 10, 7).moved([x * s * 0.09, -s * 0.205, s * 0.86]) for x in (-1, 1)] + [
        sphere(s * 0.035, 10, 7).moved([0, -s * 0.29, s * 0.77])
    ]
    parts = [
        Part(join(around), "matt", grain.astype(np.float32)),
        Part(muzzle, "matt", prints.plain([225, 210, 190])),
        Part(join(dots), "glossy", prints.plain([22, 18, 16])),
    ]
    return standing("bear", parts, faces=True)


def rings(rng: Rng, family: str) -> Thing:
    """Rings on a stick, each of another colour (`train` only)."""
    parts, z, r = [], 0.0, rng.uniform(0.03, 0.055)
    for k in range(int(rng.integers(3, 7))):
        big, t = r * (1 - 0.11 * k), r * 0.26
        parts.append(
            Part(
                lathe(
                    rounded(
                        [[0, z], [big, z], [big * 1.06, z + t], [big, z + 2 * t * 0.9], [0, z + 2 * t * 0.9]],
                        1,
                    ),
                    32,
                ),
                "glossy",
                flat(rng, family),
            )
        )
        z += 1.85 * t
    parts.append(Part(sphere(r * 0.3, 18, 9).moved([0, 0, z + r * 0.2]), "glossy", flat(rng, family)))
    return standing("rings", parts, True)


def duck(rng: Rng, family: str) -> Thing:
    """A bath duck of any colour (`train` only)."""
    s = rng.uniform(0.04, 0.08)
    body = sphere(s * np.array([0.55, 0.42, 0.36])).moved([0, 0, s * 0.34])
    tail = sphere(s * np.array([0.16, 0.2, 0.2])).moved([-s * 0.46, 0, s * 0.52])
    head = sphere(s * 0.28).moved([s * 0.28, 0, s * 0.82])
    beak = sphere(s * np.array([0.16, 0.13, 0.05])).moved([s * 0.58, 0, s * 0.78])
    eyes = [sphere(s * 0.035, 10, 7).moved([s * 0.5, y * s * 0.12, s * 0.92]) for y in (-1, 1)]
    parts = [
        Part(join([body, tail, head]), "glossy", flat(rng, family)),
        Part(beak, "glossy", flat(rng, family)),
        Part(join(eyes), "glossy", prints.plain([15, 15, 15])),
    ]
    return standing("duck", [p.moved(turn=turn("z", rng.uniform(0, 360))) for p in parts])


def shoe(rng: Rng, family: str) -> Thing:
    """A rough shoe along x: a sole, a toe, a shaft with its opening, laces (`homes` only)."""
    length = rng.uniform(0.2, 0.28)
    w, h = length * 0.17, length * rng.uniform(0.3, 0.42)
    sole_line = rounded(
        [
            [-0.5, -0.8],
            [-0.1, -0.62],
            [0.3, -1.0],
            [0.5, -0.3],
            [0.48, 0.4],
            [0.25, 0.95],
            [-0.1, 0.65],
            [-0.5, 0.8],
        ],
        2,
        closed=True,
    ) * [length, w]
    sole = extrude(sole_line, 0.018, 0.004)
    rows, levels = [], np.linspace(0, 1, 9)
    for level in levels:  # the upper: outlines that draw back from the toe as they rise
        toe = np.interp(level, [0, 0.45, 0.6, 1], [1.0, 0.86, 0.3, 0.02])
        x = np.where(
            sole_line[:, 0] > -0.12 * length,
            -0.12 * length + (sole_line[:, 0] + 0.12 * length) * toe,
            sole_line[:, 0],
        )
        rows.append(
            np.column_stack(
                [
                    x * (1 - 0.06 * level),
                    sole_line[:, 1] * (0.96 - 0.3 * level),
                    np.full(len(x), 0.016 + level * h),
                ]
            )
        )
    loft = lofted(rows)
    dark = (
        lathe(rounded([[0, 0], [w * 0.5, 0], [w * 0.52, 0.002], [0, 0.002]], 0), 24)
        .moved(scale=[1.7, 1, 1])
        .moved([-0.31 * length, 0, 0.0161 + h])
    )
    laces = [
        sweep(
            [
                [length * (0.02 + 0.05 * k), -w * 0.42, h * (0.72 - 0.1 * k)],
                [length * (0.035 + 0.05 * k), 0, h * (0.84 - 0.1 * k)],
                [length * (0.02 + 0.05 * k), w * 0.42, h * (0.72 - 0.1 * k)],
            ],
            0.003,
            around=6,
        )
        for k in range(4)
    ]
    spin = turn("z", rng.uniform(0, 360))
    parts = [
        Part(sole, "matt", prints.plain(rng.choice([[235, 232, 225], [40, 36, 34], [150, 110, 70]]))),
        Part(loft, str(rng.choice(["matt", "satin"])), flat(rng, family)),
        Part(dark, "matt", prints.plain([24, 22, 22])),
        Part(join(laces), "matt", prints.plain([235, 232, 225])),
    ]
    return standing("shoe", [p.moved(turn=spin) for p in parts])


def lofted(rows: list) -> object:
    """A closed skin through outlines (K, 3) of as many points each, from the bottom up; lids at both ends."""
    from studio.segmentation.homes.solids import Solid, outward

    count, many = len(rows[0]), len(rows)
    i = np.arange(count)
    j = (i + 1) % count
    faces = [
        np.concatenate([np.stack([a + i, a + j, b + j], 1), np.stack([a + i, b + j, b + i], 1)])
        for a, b in ((k * count, (k + 1) * count) for k in range(many - 1))
    ]
    points = np.concatenate([*rows, [np.mean(rows[0], 0)], [np.mean(rows[-1], 0)]])
    low, high = many * count, many * count + 1
    last = (many - 1) * count
    faces += [
        np.stack([j, i, np.full(count, low)], 1),
        np.stack([last + i, last + j, np.full(count, high)], 1),
    ]
    span = np.maximum(np.ptp(points, axis=0), 1e-9)
    return outward(Solid(points, ((points - points.min(0)) / span)[:, [0, 2]], np.concatenate(faces)))
