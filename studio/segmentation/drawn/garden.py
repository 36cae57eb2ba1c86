"""What grows: fruit, vegetables, flowers, plants in pots, leaves, eggs and bread."""

from __future__ import annotations

import numpy as np

from .build import (
    GLAZED,
    MATT,
    SATIN,
    Kind,
    Model,
    about,
    ball,
    curve,
    egg,
    loop,
    profile,
    shade,
    vec,
)
from .canvas import Finish
from .hand import Array, Hand
from .paint import (
    caps,
    finishable,
    over,
    plain,
    stripes,
    textured,
)
from .parts import Ellipsoid, Lathe, Paint, Part, Slab, Tube


def _shaft(
    points: list[tuple[float, float]], paint: Paint, finish: Finish, smooth: int = 0
) -> Lathe:
    return Lathe(profile(points, smooth), paint, finish)


def apple(hand: Hand) -> Model:
    colour = hand.one_of(
        [
            vec(0.55, 0.02, 0.02),
            vec(0.35, 0.45, 0.05),
            vec(0.75, 0.5, 0.06),
            vec(0.5, 0.1, 0.04),
        ]
    )
    skin = textured(
        hand,
        colour,
        hand.one_of(["blotches", "grain", "plain"]),
        hand.between(0.1, 0.6),
        0.7,
    )
    body = Lathe(
        profile(
            [
                (0, 0.05),
                (0.15, 0),
                (0.38, 0.2),
                (0.5, 0.55),
                (0.35, 0.88),
                (0.12, 0.9),
                (0.0, 0.8),
            ],
            3,
        ),
        skin,
        Finish(0.3, 30),
    )
    stem = Tube(
        curve([(0, 0.78, 0), (0.01, 0.95, 0), (hand.between(-0.1, 0.1), 1.05, 0)], 8),
        np.full(8, 0.02, np.float32),
        plain(vec(0.12, 0.07, 0.03)),
    )
    leaf = (
        [
            egg(
                vec(0.14, 1.0),
                (0.13, 0.02, 0.06),
                plain(hand.green()),
                SATIN,
                about("z", 25),
            )
        ]
        if hand.chance(0.3)
        else []
    )
    return Model((body, stem, *leaf))


def pear(hand: Hand) -> Model:
    skin = textured(
        hand,
        hand.one_of([vec(0.5, 0.5, 0.08), vec(0.55, 0.4, 0.1), vec(0.4, 0.2, 0.08)]),
        "stone",
        0.25,
        1,
    )
    body = Lathe(
        profile(
            [
                (0, 0),
                (0.25, 0.0),
                (0.4, 0.3),
                (0.3, 0.6),
                (0.16, 0.75),
                (0.12, 0.92),
                (0, 0.95),
            ],
            3,
        ),
        skin,
        SATIN,
    )
    return Model(
        (
            body,
            Tube(
                curve([(0, 0.9, 0), (0.02, 1.0, 0), (0.07, 1.1, 0)], 6),
                np.full(6, 0.02, np.float32),
                plain(vec(0.1, 0.06, 0.03)),
            ),
        )
    )


def citrus(hand: Hand) -> Model:
    skin = textured(
        hand,
        hand.one_of(
            [
                vec(0.85, 0.3, 0.01),
                vec(0.85, 0.65, 0.03),
                vec(0.35, 0.5, 0.04),
                vec(0.7, 0.1, 0.03),
            ]
        ),
        "carpet",
        0.15,
        1.5,
    )
    if hand.chance(0.5):
        return Model(
            (
                Lathe(
                    profile(
                        [
                            (0, 0),
                            (0.08, 0.03),
                            (0.33, 0.3),
                            (0.34, 0.65),
                            (0.1, 0.95),
                            (0, 1),
                        ],
                        3,
                    ),
                    skin,
                    SATIN,
                ),
            )
        )
    spot = over(
        skin,
        caps(np.stack([vec(0, 1)]), 0.985, vec(0, 0.46)),
        plain(vec(0.15, 0.25, 0.05)),
    )
    return Model((egg(vec(0, 0.46), (0.5, 0.46, 0.5), spot, SATIN),))


def banana(hand: Hand) -> Model:
    skin = textured(
        hand,
        hand.one_of([vec(0.85, 0.62, 0.05), vec(0.6, 0.55, 0.08)]),
        "blotches",
        0.15,
        0.7,
    )
    skin = over(
        skin,
        lambda s: ((s.v < 0.04) | (s.v > 0.95)).astype(np.float32),
        plain(vec(0.08, 0.05, 0.02)),
    )
    parts: list[Part] = []
    for k in range(hand.one_of([1, 1, 2, 3])):
        line = curve(
            [
                (-0.5, 0.32, 0),
                (-0.3, 0.05 + 0.02 * k, 0.12 * k),
                (0.2, 0.05, 0.16 * k),
                (0.5, 0.3, 0.2 * k),
            ],
            24,
        )
        thick = 0.1 * np.sin(np.linspace(0.25, np.pi - 0.15, 24)) ** 0.5
        parts.append(Tube(line, thick.astype(np.float32), skin, SATIN))
    return Model(tuple(parts))


def carrot(hand: Hand) -> Model:
    skin = over(
        plain(vec(0.8, 0.22, 0.02)),
        stripes(vec(0, 1), 9, 0.1),
        plain(vec(0.5, 0.12, 0.01)),
    )
    leaves = [
        Tube(
            curve(
                [
                    (0, 0.68, 0),
                    (hand.between(-0.1, 0.1), 0.85, hand.between(-0.1, 0.1)),
                    (hand.between(-0.2, 0.2), 1.05, hand.between(-0.2, 0.2)),
                ],
                8,
            ),
            np.full(8, 0.02, np.float32),
            plain(hand.green()),
        )
        for _ in range(5)
    ]
    return Model(
        (
            _shaft(
                [(0, 0), (0.03, 0.1), (0.1, 0.6), (0.08, 0.7), (0, 0.71)],
                skin,
                SATIN,
                1,
            ),
            *leaves,
        )
    )


def tomato(hand: Hand) -> Model:
    colour = hand.one_of(
        [vec(0.65, 0.04, 0.02), vec(0.7, 0.25, 0.02), vec(0.25, 0.02, 0.15)]
    )
    calyx = [
        egg(
            vec(0.12 * np.cos(a), 0.8, 0.12 * np.sin(a)),
            (0.14, 0.02, 0.04),
            plain(vec(0.08, 0.2, 0.04)),
            MATT,
            about("y", -float(np.degrees(a))),
        )
        for a in np.linspace(0, 6.28, 5, endpoint=False).tolist()
    ]
    return Model((egg(vec(0, 0.4), (0.5, 0.4, 0.5), plain(colour), GLAZED), *calyx))


def grapes(hand: Hand) -> Model:
    colour, parts = hand.one_of([vec(0.15, 0.02, 0.12), vec(0.4, 0.5, 0.12)]), []
    for k in range(26):
        x, z = hand.between(-0.5, 0.5), hand.between(-0.25, 0.25)
        parts.append(
            ball(
                vec(
                    x * (1 - 0.4 * (k % 3) / 2),
                    0.11 + 0.13 * (k % 3),
                    z * (1 - 0.5 * (k % 3) / 2),
                ),
                0.11,
                plain(shade(colour, hand.between(0.7, 1.3))),
                Finish(0.4, 40),
            )
        )
    return Model(
        (
            *parts,
            Tube(
                curve([(0.3, 0.35, 0), (0.5, 0.45, 0), (0.62, 0.42, 0)], 8),
                np.full(8, 0.025, np.float32),
                plain(vec(0.15, 0.12, 0.04)),
            ),
        )
    )


def egg_of_hen(hand: Hand) -> Model:
    return Model(
        (
            _shaft(
                [(0, 0), (0.22, 0.04), (0.36, 0.4), (0.22, 0.85), (0, 1)],
                finishable(hand, hand.one_of([hand.white(), vec(0.6, 0.35, 0.2)])),
                SATIN,
                3,
            ),
        )
    )


def mushroom(hand: Hand) -> Model:
    cap = over(
        plain(hand.one_of([vec(0.6, 0.02, 0.02), hand.wood(), hand.white()])),
        caps(np.stack([hand.direction() for _ in range(10)]), 0.97, vec(0, 0.5)),
        plain(hand.white()),
    )
    return Model(
        (
            _shaft(
                [(0, 0), (0.16, 0), (0.12, 0.3), (0.13, 0.6), (0, 0.6)],
                plain(hand.white()),
                MATT,
                1,
            ),
            _shaft(
                [(0.1, 0.5), (0.45, 0.5), (0.4, 0.72), (0.2, 0.92), (0, 0.95)],
                cap,
                SATIN,
                1,
            ),
        )
    )


def bread(hand: Hand) -> Model:
    crust = textured(hand, vec(0.55, 0.28, 0.1), "blotches", 0.5, 0.6)
    cuts = over(crust, stripes(vec(1, 0.2), 4, 0.15), plain(vec(0.75, 0.55, 0.3)))
    return Model((egg(vec(0, 0.22), (0.5, 0.22, hand.between(0.2, 0.4)), cuts),))


def _leaf(base: Array, tip: Array, wide: float, paint: Paint) -> Ellipsoid:
    along = (tip - base) / 2
    side = np.cross(along, [0.2, 1, 0.3])
    side = side / max(float(np.linalg.norm(side)), 1e-6) * wide
    thin = np.cross(along, side)
    thin = thin / max(float(np.linalg.norm(thin)), 1e-6) * 0.012
    return Ellipsoid(
        (base + along).astype(np.float32),
        np.column_stack([along, side, thin]).astype(np.float32),
        paint,
        SATIN,
    )


def potted_plant(hand: Hand) -> Model:
    tall = hand.between(0.2, 0.45)
    r = hand.between(0.15, 0.26)
    pot = hand.one_of([vec(0.45, 0.17, 0.08), hand.white(), hand.colour()])
    body = [
        (0, 0),
        (r * 0.75, 0),
        (r, tall * 0.8),
        (r * 1.12, tall * 0.8),
        (r * 1.12, tall),
        (r, tall - 0.002),
        (r * 0.9, tall - 0.04),
        (0, tall - 0.04),
    ]
    parts: list[Part] = [
        Lathe(
            profile(body),
            finishable(hand, pot),
            hand.one_of([MATT, MATT, GLAZED]),
            plain(vec(0.04, 0.025, 0.015)),
        )
    ]
    green, what = (
        hand.green(),
        hand.one_of(["leaves", "blades", "cactus", "bush", "flowers"]),
    )
    if what == "cactus":
        prick = over(
            plain(green), stripes(vec(1, 0), 14, 0.25), plain(shade(green, 1.7))
        )
        parts.append(
            Lathe(
                profile(
                    [
                        (r * 0.4, tall - 0.04),
                        (r * 0.6, tall + 0.2),
                        (r * 0.55, 0.9),
                        (0, 1),
                    ],
                    2,
                ),
                prick,
            )
        )
        return Model(tuple(parts))
    for _ in range(hand.whole(9, 24)):
        turn, rise = hand.between(0, 6.28), hand.between(0.15, 1.0)
        out = hand.between(0.1, 0.4)
        tip = vec(out * np.cos(turn), tall + rise * (1 - tall), out * np.sin(turn))
        paint = plain(shade(green, hand.between(0.6, 1.4)))
        if what == "bush":
            parts.append(
                ball(
                    vec(tip[0] * 0.8, tip[1] * 0.9, tip[2] * 0.8),
                    hand.between(0.05, 0.1),
                    textured(hand, green, "stone", 0.7, 3),
                )
            )
        else:
            base = (
                vec(0, tall - 0.03)
                if what == "blades"
                else vec(tip[0] * 0.4, tall + rise * (1 - tall) * 0.6, tip[2] * 0.4)
            )
            parts.append(
                _leaf(
                    base,
                    tip,
                    0.025 if what == "blades" else hand.between(0.05, 0.1),
                    paint,
                )
            )
            if what != "blades":
                parts.append(
                    Tube(
                        np.stack([vec(0, tall - 0.04), base]),
                        np.full(2, 0.01, np.float32),
                        paint,
                    )
                )
        if what == "flowers" and hand.chance(0.4):
            parts += _blossom(hand, tip, hand.between(0.05, 0.1), hand.bright())
    return Model(tuple(parts))


def _blossom(hand: Hand, at: Array, size: float, colour: Array) -> list[Part]:
    count, parts = hand.whole(5, 9), []
    face = about("x", hand.between(20, 90)) @ about("z", hand.between(-30, 30))
    petal = plain(colour)
    for k in range(count):
        turn = 2 * np.pi * k / count
        out = face @ vec(np.cos(turn), np.sin(turn))
        side = face @ vec(-np.sin(turn), np.cos(turn))
        axes = np.column_stack(
            [out * size, side * size * 0.5, np.cross(out, side) * size * 0.12]
        )
        parts.append(
            Ellipsoid(
                (at + out * size * 1.1).astype(np.float32),
                axes.astype(np.float32),
                petal,
            )
        )
    parts.append(
        ball(
            at + face @ vec(0, 0, 0.1 * size),
            size * 0.5,
            plain(hand.one_of([vec(0.7, 0.5, 0.03), vec(0.1, 0.05, 0.02)])),
        )
    )
    return list(parts)


def flower(hand: Hand) -> Model:
    bend = hand.between(-0.2, 0.2)
    stem = curve([(0, 0, 0), (bend * 0.3, 0.5, 0), (bend, 0.85, 0)], 16)
    green = plain(hand.green())
    leaves = [
        _leaf(
            stem[6], stem[6] + vec(s * 0.2, 0.15, hand.between(-0.1, 0.1)), 0.04, green
        )
        for s in (-1, 1)
    ]
    return Model(
        (
            Tube(stem, np.full(16, 0.016, np.float32), green),
            *leaves,
            *_blossom(hand, stem[-1], hand.between(0.09, 0.15), hand.bright()),
        )
    )


def leaf(hand: Hand) -> Model:
    colour = hand.one_of([hand.green(), hand.wood(), vec(0.5, 0.1, 0.03)])
    outline = loop(
        [
            (0, 0),
            (hand.between(0.15, 0.4), 0.35),
            (hand.between(0.1, 0.3), 0.7),
            (0, 1),
            (-hand.between(0.1, 0.3), 0.7),
            (-hand.between(0.15, 0.4), 0.35),
        ],
        2,
    )
    vein = over(
        textured(hand, colour, "grain", 0.3),
        lambda s: (np.abs(s.u) < 0.012).astype(np.float32),
        plain(shade(colour, 1.5)),
    )
    return Model(
        (
            Slab(outline, 0.015, vein, puff=0.05),
            Tube(
                curve([(0, 0.05, 0), (0, -0.1, 0), (0.05, -0.2, 0)], 6),
                np.full(6, 0.015, np.float32),
                plain(shade(colour, 0.6)),
            ),
        )
    )


KINDS = [
    Kind("apple", apple, 8),
    Kind("pear", pear, 9),
    Kind("citrus", citrus, 8, ("lie", "stand")),
    Kind("banana", banana, 18),
    Kind("carrot", carrot, 18, ("flat",)),
    Kind("tomato", tomato, 7),
    Kind("grapes", grapes, 14),
    Kind("egg", egg_of_hen, 6, ("lie", "stand")),
    Kind("mushroom", mushroom, 7),
    Kind("bread", bread, 26),
    Kind("potted_plant", potted_plant, 28),
    Kind("flower", flower, 25, ("flat", "lean")),
    Kind("leaf", leaf, 9, ("flat",)),
]
