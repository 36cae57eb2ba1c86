"""Things with handles: pencils, screwdrivers, hammers, scissors, keys."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

import numpy as np

from .build import (
    GLAZED,
    SATIN,
    STEEL,
    Kind,
    Model,
    about,
    circle,
    curve,
    loop,
    profile,
    vec,
)
from .canvas import Finish
from .hand import Array, Hand
from .paint import (
    band,
    finishable,
    over,
    plain,
    stripes,
    textured,
)
from .parts import Box, Lathe, Paint, Part, Slab, Tube


def _shaft(
    points: list[tuple[float, float]], paint: Paint, finish: Finish, smooth: int = 0
) -> Lathe:
    return Lathe(profile(points, smooth), paint, finish)


def pencil(hand: Hand) -> Model:
    r, colour = hand.between(0.02, 0.035), hand.one_of([hand.bright(), hand.colour()])
    tip = hand.one_of([hand.grey(0.01, 0.03), colour])
    paint = over(plain(colour), band(0.9, 0.97), plain(vec(0.6, 0.4, 0.2)))
    paint = over(
        over(paint, band(0.97, 1.1), plain(tip)),
        band(0.06, 0.1),
        plain(vec(0.6, 0.6, 0.55)),
    )
    paint = over(
        paint, band(-1, 0.06), plain(hand.one_of([colour, vec(0.7, 0.3, 0.3)]))
    )
    return Model(
        (_shaft([(0, 0), (r, 0), (r, 0.9), (r * 0.25, 0.99), (0, 1)], paint, SATIN),)
    )


def pen(hand: Hand) -> Model:
    r, colour = hand.between(0.025, 0.05), hand.colour()
    cap = hand.between(0.5, 0.75)
    paint = over(
        over(plain(colour), band(cap, 2), plain(hand.colour())),
        band(-1, 0.08),
        plain(hand.grey()),
    )
    clip = Box(
        vec(0, 0.82, r * 1.2),
        vec(0.01, 0.12, 0.008),
        plain(vec(0.6, 0.6, 0.6)),
        finish=STEEL,
    )
    return Model(
        (
            _shaft(
                [
                    (0, 0),
                    (r * 0.3, 0),
                    (r, 0.14),
                    (r, 0.6),
                    (r * 1.1, cap),
                    (r * 1.1, 0.97),
                    (r, 1),
                    (0, 1),
                ],
                paint,
                GLAZED,
            ),
            clip,
        )
    )


def screwdriver(hand: Hand) -> Model:
    colour, split = hand.bright(), hand.between(0.38, 0.5)
    grip = over(plain(colour), stripes(vec(1, 0), 30, 0.3), plain(hand.grey(0.01, 0.1)))
    handle = _shaft(
        [
            (0, 0),
            (0.06, 0),
            (0.075, 0.05),
            (0.06, split * 0.6),
            (0.07, split * 0.9),
            (0.03, split),
            (0, split),
        ],
        grip,
        SATIN,
        1,
    )
    return Model(
        (
            handle,
            _shaft(
                [
                    (0, split),
                    (0.017, split),
                    (0.017, 0.94),
                    (0.028, 0.96),
                    (0.012, 1),
                    (0, 1),
                ],
                plain(vec(0.6, 0.6, 0.6)),
                STEEL,
            ),
        )
    )


def brush(hand: Hand) -> Model:
    """Paint brush or toothbrush or hairbrush."""
    colour, grip = hand.one_of([hand.wood(), hand.colour()]), hand.between(0.02, 0.04)
    w = hand.between(0.03, 0.12)
    hair = textured(
        hand,
        hand.one_of([hand.wood() * 0.5, hand.white(), hand.colour()]).astype(
            np.float32
        ),
        "wood",
        0.5,
        1,
    )
    handle = loop(
        [
            (-grip * 0.6, 0),
            (grip * 0.6, 0),
            (grip, 0.4),
            (w, 0.62),
            (-w, 0.62),
            (-grip, 0.4),
        ],
        1,
    )
    return Model((
        Slab(handle, 0.045, finishable(hand, colour), finish=SATIN, puff=0.02),
        Box(vec(0, 0.69), vec(w * 1.03, 0.07, 0.03), plain(vec(0.6, 0.58, 0.5)), finish=STEEL),
        Slab(loop([(-w, 0.76), (w, 0.76), (w * hand.between(0.6, 1.1), 0.98), (0, 1), (-w * hand.between(0.6, 1.1), 0.98)]), 0.05, hair, puff=0.02),
    ))  # fmt: skip


def hammer(hand: Hand) -> Model:
    handle = over(
        textured(hand, hand.wood(), "wood", 0.3),
        band(0, hand.between(0, 0.5)),
        plain(hand.colour()),
    )
    head, y = plain(hand.grey(0.05, 0.5)), 0.92
    parts: list[Part] = [
        Tube(
            curve([(0, 0, 0), (0, 0.5, 0), (0, 0.98, 0)]),
            np.linspace(0.04, 0.028, 20, dtype=np.float32),
            handle,
            SATIN,
        )
    ]
    parts.append(
        Lathe(
            profile(
                [
                    (0, 0),
                    (0.065, 0),
                    (0.065, 0.06),
                    (0.045, 0.08),
                    (0.045, 0.22),
                    (0, 0.22),
                ]
            ),
            head,
            STEEL,
            None,
            vec(-0.2, y),
            vec(1, 0, 0),
        )
    )
    claw = [
        (0.02, y - 0.05),
        (0.02, y + 0.05),
        (0.14, y + 0.05),
        (0.24, y - 0.08),
        (0.12, y - 0.01),
    ]
    return Model((*parts, Slab(loop(claw, 1), 0.09, head, finish=STEEL, puff=0.02)))


def wrench(hand: Hand) -> Model:
    neck = [(0.035, 0.75), (0.04, 0.15), (-0.04, 0.15), (-0.035, 0.75)]
    body = loop(
        [
            *neck,
            (-0.1, 0.8),
            (-0.13, 0.9),
            (-0.07, 1.0),
            (-0.045, 0.9),
            (0.045, 0.9),
            (0.07, 1.0),
            (0.13, 0.9),
            (0.1, 0.8),
        ]
    )
    eye = Slab(
        circle(0, 0.1, 0.1, 24),
        0.06,
        plain(vec(0.55, 0.55, 0.55)),
        holes=[circle(0, 0.1, 0.06, 12)],
        finish=STEEL,
        puff=0.02,
    )
    return Model(
        (Slab(body, 0.05, plain(vec(0.55, 0.55, 0.55)), finish=STEEL, puff=0.02), eye)
    )


def _turned(turn: Array, pivot: Array, point: Sequence[float] | Array) -> Array:
    return pivot + turn @ (np.asarray(point, np.float32) - pivot)


def _pair(
    hand: Hand,
    blade: list[tuple[float, float]],
    pivot: float,
    open_: float,
    grip: Paint,
    metal: Paint,
    rings: float,
) -> Model:
    """Two mirrored arms turned about a pivot: scissors, pliers, tongs."""
    parts: list[Part] = []
    thick = hand.between(0.02, 0.035)
    for side in (-1, 1):
        place = partial(_turned, about("z", side * open_), vec(0, pivot))
        arm = loop([(side * x, y) for x, y in blade], 1)
        flat = np.stack([place((x, y, 0)) for x, y in arm])
        parts.append(
            Slab(
                flat[:, :2],
                0.03,
                metal,
                finish=STEEL,
                centre=vec(0, 0, side * 0.012),
                puff=0.015,
            )
        )
        if rings > 0:
            t = np.linspace(0, 2 * np.pi, 30)
            eye = [
                place(
                    (
                        -side * (rings * 0.75 + rings * np.cos(a)),
                        0.16 + 1.5 * rings * np.sin(a),
                        0,
                    )
                )
                for a in t
            ]
            parts.append(
                Tube(
                    np.stack(eye).astype(np.float32),
                    np.full(30, thick, np.float32),
                    grip,
                    SATIN,
                )
            )
            bar = [
                place((0, pivot, 0)),
                place((-side * rings * 0.4, 0.16 + rings * 1.3, 0)),
            ]
            parts.append(
                Tube(
                    np.stack(bar).astype(np.float32),
                    np.full(2, thick * 0.9, np.float32),
                    grip,
                    SATIN,
                )
            )
        else:
            bow = [
                place(p)
                for p in curve(
                    [
                        (0, pivot, 0),
                        (-side * 0.1, pivot - 0.2, 0),
                        (-side * 0.09, 0, 0),
                    ],
                    14,
                )
            ]
            parts.append(
                Tube(
                    np.stack(bow).astype(np.float32),
                    np.full(14, 0.035, np.float32),
                    grip,
                    SATIN,
                )
            )
    return Model(
        (
            *parts,
            Lathe(
                profile([(0, 0), (0.03, 0), (0.03, 0.07), (0, 0.07)]),
                metal,
                STEEL,
                None,
                vec(0, pivot, -0.035),
                vec(0, 0, 1),
            ),
        )
    )


def scissors(hand: Hand) -> Model:
    pivot = hand.between(0.4, 0.55)
    blade = [
        (-0.03, pivot - 0.08),
        (0.03, pivot - 0.06),
        (0.045, pivot + 0.1),
        (0.0, 1.0),
        (-0.02, pivot + 0.1),
    ]
    return _pair(
        hand,
        blade,
        pivot,
        hand.between(1, 24),
        plain(hand.colour()),
        plain(vec(0.65, 0.65, 0.66)),
        hand.between(0.07, 0.1),
    )


def pliers(hand: Hand) -> Model:
    pivot = hand.between(0.62, 0.7)
    blade = [
        (-0.06, pivot - 0.06),
        (0.05, pivot - 0.06),
        (0.07, pivot + 0.05),
        (0.03, 1.0),
        (0.0, 1.0),
    ]
    return _pair(
        hand,
        blade,
        pivot,
        hand.between(1, 14),
        plain(hand.bright()),
        plain(hand.grey(0.05, 0.5)),
        0,
    )


def key(hand: Hand) -> Model:
    metal = plain(
        hand.one_of([vec(0.6, 0.6, 0.6), vec(0.65, 0.5, 0.2), vec(0.2, 0.15, 0.1)])
    )
    teeth = [
        (0.04, y + dy) if k % 2 else (0.04 + hand.between(0.02, 0.08), y + dy)
        for k, y in enumerate(np.linspace(0.05, 0.45, 7).tolist())
        for dy in (0.0, 0.03)
    ]
    shaft = loop([(-0.04, 0.65), (-0.04, 0.02), (0, 0), *teeth, (0.04, 0.65)])
    head = Slab(
        circle(0, 0.8, 0.2, 20),
        0.04,
        metal,
        holes=[circle(0, 0.88, 0.05, 10)],
        finish=STEEL,
        puff=0.02,
    )
    parts: list[Part] = [Slab(shaft, 0.035, metal, finish=STEEL, puff=0.01), head]
    if hand.chance(0.5):
        t = np.linspace(0, 6.28, 24)
        parts.append(
            Tube(
                np.column_stack(
                    [0.17 * np.cos(t), 1.0 + 0.17 * np.sin(t), 0 * t]
                ).astype(np.float32),
                np.full(24, 0.015, np.float32),
                plain(vec(0.6, 0.6, 0.6)),
                STEEL,
            )
        )
    return Model(tuple(parts))


def bulb(hand: Hand) -> Model:
    paint = over(plain(vec(0.85, 0.83, 0.75)), band(-1, 0.3), plain(vec(0.5, 0.5, 0.5)))
    return Model(
        (
            _shaft(
                [
                    (0, 0),
                    (0.13, 0.02),
                    (0.16, 0.3),
                    (0.32, 0.65),
                    (0.28, 0.88),
                    (0.12, 0.99),
                    (0, 1),
                ],
                paint,
                GLAZED,
                2,
            ),
        )
    )


KINDS = [
    Kind("pencil", pencil, 17, ("flat", "lean")),
    Kind("pen", pen, 14, ("flat", "lean")),
    Kind("screwdriver", screwdriver, 20, ("flat", "lean")),
    Kind("brush", brush, 20, ("flat", "lean")),
    Kind("hammer", hammer, 30, ("flat", "lean")),
    Kind("wrench", wrench, 20, ("flat", "lean")),
    Kind("scissors", scissors, 18, ("flat",)),
    Kind("pliers", pliers, 18, ("flat", "lean")),
    Kind("key", key, 6, ("flat",)),
    Kind("bulb", bulb, 10, ("lie",)),
]
