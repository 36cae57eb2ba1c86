"""Toys, balls and shoes, as random makers: a generator in, `Thing` out; metres."""

from __future__ import annotations

import numpy as np

from studio.segmentation.homes import prints
from studio.segmentation.homes.parts import Part, Thing, flat, standing
from studio.segmentation.homes.prints import Rng
from studio.segmentation.homes.solids import ball as sphere
from studio.segmentation.homes.solids import box, join, lathe, rounded, sweep, turn


def ball(rng: Rng) -> Thing:
    """Plain, printed, or in panels; of rubber, glass or leather."""
    r = rng.choice(
        [rng.uniform(0.012, 0.025), rng.uniform(0.03, 0.06), rng.uniform(0.06, 0.11)]
    )
    y, x = np.mgrid[:48, :96]
    if rng.random() < 0.4:
        a, b = (prints.linear(prints.colour(rng)) for _ in range(2))
        skin = np.where(
            (((x * rng.integers(1, 4)) // 16 + (y // 24) * False) % 2 > 0)[..., None],
            a,
            b,
        )
    else:
        skin = prints.pattern(rng) if rng.random() < 0.5 else flat(rng)
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


def wheels(at: list, radius: float, width: float) -> tuple[list, list]:
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
        [
            [0, -width * 0.56],
            [radius * 0.5, -width * 0.56],
            [radius * 0.5, width * 0.56],
            [0, width * 0.56],
        ],
        14,
    )
    return [tyre.moved(a, lay) for a in at], [hub.moved(a, lay) for a in at]


def car(rng: Rng) -> Thing:
    """A toy car along x: a van, a truck or a wooden block on wheels."""
    length = rng.uniform(0.06, 0.18)
    wide, r = length * rng.uniform(0.4, 0.5), length * rng.uniform(0.09, 0.13)
    h = length * rng.uniform(0.14, 0.2)
    paint, finish = flat(rng), "glossy" if rng.random() < 0.6 else "satin"
    parts: list[Part] = []
    cut = rng.uniform(0.3, 0.75)
    hull = box([length, wide, h], rng.uniform(0.001, 0.005)).moved([0, 0, r * 0.6])
    cabin = box(
        [length * cut, wide * 0.92, h * rng.uniform(0.8, 1.6)],
        rng.uniform(0.001, 0.006),
    ).moved(
        [length * (0.5 - cut / 2) * rng.choice([-1, 0, 0.6]), 0, r * 0.6 + h * 0.96]
    )
    parts += [
        Part(hull, finish, paint),
        Part(cabin, finish, paint if rng.random() < 0.5 else flat(rng)),
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
    tyres, hubs = wheels(
        [[x, s * wide * 0.46, r] for x in spots for s in (-1, 1)], r, wide * 0.16
    )
    parts += [
        Part(join(tyres), "matt", prints.plain([30, 30, 32])),
        Part(join(hubs), "satin", flat(rng)),
    ]
    return standing(
        "car", [p.moved(turn=turn("z", rng.choice([0, 180]))) for p in parts]
    )


def robot(rng: Rng) -> Thing:
    """A figure of boxes and cylinders."""
    s = rng.uniform(0.05, 0.12)
    trunk = box([s * 0.5, s * 0.3, s * 0.55], s * rng.uniform(0.01, 0.08)).moved(
        [0, 0, s * 0.4]
    )
    head = (
        box([s * 0.3, s * 0.26, s * 0.28], s * 0.03)
        if rng.random() < 0.6
        else lathe(
            rounded([[0, 0], [s * 0.16, 0], [s * 0.16, s * 0.2], [0, s * 0.3]], 1), 20
        )
    ).moved([0, 0, s * 0.95])
    legs = [
        box([s * 0.15, s * 0.22, s * 0.42], s * 0.02).moved([x * s * 0.14, 0, 0])
        for x in (-1, 1)
    ]
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
    eyes = [
        sphere(s * 0.03, 10, 7).moved([x * s * 0.07, -s * 0.13, s * 1.1])
        for x in (-1, 1)
    ]
    parts = [
        Part(
            join([trunk]),
            "satin",
            prints.pattern(rng) if rng.random() < 0.4 else flat(rng),
        ),
        Part(head, "satin", flat(rng)),
        Part(join(legs), "satin", flat(rng)),
        Part(join(arms), "glossy", flat(rng)),
        Part(join(eyes), "glossy", prints.plain([20, 20, 22])),
    ]
    return standing("robot", parts, faces=True)


def rings(rng: Rng) -> Thing:
    """Rings on a stick, each of another colour."""
    parts, z, r = [], 0.0, rng.uniform(0.03, 0.055)
    for k in range(int(rng.integers(3, 7))):
        big, t = r * (1 - 0.11 * k), r * 0.26
        parts.append(
            Part(
                lathe(
                    rounded(
                        [
                            [0, z],
                            [big, z],
                            [big * 1.06, z + t],
                            [big, z + 2 * t * 0.9],
                            [0, z + 2 * t * 0.9],
                        ],
                        1,
                    ),
                    32,
                ),
                "glossy",
                flat(rng),
            )
        )
        z += 1.85 * t
    parts.append(
        Part(sphere(r * 0.3, 18, 9).moved([0, 0, z + r * 0.2]), "glossy", flat(rng))
    )
    return standing("rings", parts, True)


def duck(rng: Rng) -> Thing:
    """A bath duck of any colour."""
    s = rng.uniform(0.04, 0.08)
    body = sphere(s * np.array([0.55, 0.42, 0.36])).moved([0, 0, s * 0.34])
    tail = sphere(s * np.array([0.16, 0.2, 0.2])).moved([-s * 0.46, 0, s * 0.52])
    head = sphere(s * 0.28).moved([s * 0.28, 0, s * 0.82])
    beak = sphere(s * np.array([0.16, 0.13, 0.05])).moved([s * 0.58, 0, s * 0.78])
    eyes = [
        sphere(s * 0.035, 10, 7).moved([s * 0.5, y * s * 0.12, s * 0.92])
        for y in (-1, 1)
    ]
    parts = [
        Part(join([body, tail, head]), "glossy", flat(rng)),
        Part(beak, "glossy", flat(rng)),
        Part(join(eyes), "glossy", prints.plain([15, 15, 15])),
    ]
    return standing(
        "duck", [p.moved(turn=turn("z", rng.uniform(0, 360))) for p in parts]
    )
