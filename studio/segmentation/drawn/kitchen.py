"""Other things of kitchen and table: pots, cutlery, candles, lamps, boards."""

from __future__ import annotations

import numpy as np

from .build import (
    GLAZED,
    MATT,
    STEEL,
    Kind,
    Model,
    about,
    any_finish,
    ball,
    curve,
    egg,
    loop,
    profile,
    rounded,
    shade,
    vec,
)
from .canvas import Finish
from .crockery import SATIN_METAL, decorated
from .hand import Hand
from .paint import finishable, plain, textured
from .parts import Box, Ellipsoid, Lathe, Paint, Part, Slab, Tube


def teapot(hand: Hand) -> Model:
    colour, finish = hand.colour(), hand.one_of([GLAZED, STEEL, any_finish(hand)])
    tall = hand.between(0.5, 0.85)
    paint = decorated(hand, colour)
    body = Lathe(
        profile(
            [
                (0, 0),
                (0.25, 0),
                (0.38, tall * 0.4),
                (0.2, tall * 0.85),
                (0.06, tall * 0.95),
                (0, tall * 0.95),
            ],
            2,
        ),
        paint,
        finish,
    )
    spout = Tube(
        curve(
            [
                (-0.3, tall * 0.25, 0),
                (-0.5, tall * 0.4, 0),
                (-0.52, tall * 0.8, 0),
                (-0.62, tall * 0.85, 0),
            ]
        ),
        np.linspace(0.09, 0.035, 20, dtype=np.float32),
        plain(colour),
        finish,
    )
    grip = curve(
        [
            (0.28, tall * 0.75, 0),
            (0.65, tall * 0.9, 0),
            (0.6, tall * 0.2, 0),
            (0.3, tall * 0.2, 0),
        ],
        24,
    )
    return Model(
        (
            body,
            spout,
            Tube(grip, np.full(24, 0.035, np.float32), plain(colour), finish),
            ball(vec(0, tall), 0.06, plain(hand.colour()), finish),
        )
    )


def pan(hand: Hand) -> Model:
    h = hand.between(0.12, 0.45)
    finish = hand.one_of([STEEL, SATIN_METAL, MATT])
    colour = hand.one_of(
        [hand.grey(0.02, 0.1), np.full(3, 0.5, np.float32), hand.bright()]
    )
    body = [(0, 0), (0.36, 0), (0.4, h), (0.39, h - 0.003), (0.36, 0.03), (0, 0.03)]
    long = hand.between(0.4, 0.8)
    handle = Tube(
        curve([(0.38, h * 0.85, 0), (0.6, h, 0), (0.4 + long, h * 1.1, 0)]),
        np.full(20, 0.035, np.float32),
        plain(hand.grey(0.02, 0.3)),
        SATIN_METAL,
    )
    return Model(
        (Lathe(profile(body), plain(colour), finish, plain(shade(colour, 0.8))), handle)
    )


def _flat(
    points: list[tuple[float, float]],
    thick: float,
    paint: Paint,
    finish: Finish,
    smooth: int = 2,
) -> Slab:
    return Slab(loop(points, smooth), thick, paint, finish=finish, puff=0.03)


def spoon(hand: Hand) -> Model:
    wooden = hand.chance(0.3)
    paint = (
        finishable(hand, hand.wood())
        if wooden
        else plain(
            hand.one_of(
                [np.full(3, 0.75, np.float32), hand.wood(), hand.bright()], [6, 1, 1]
            )
        )
    )
    finish = MATT if wooden else STEEL
    w, t, end = (
        hand.between(0.07, 0.14),
        hand.between(0.012, 0.028),
        hand.between(1, 2.2),
    )
    tall = hand.between(0.1, 0.17)
    grip = [
        (-t, 0.25),
        (t, 0.25),
        (t * end, 0.95),
        (t * end * 0.7, 1.0),
        (-t * end * 0.7, 1.0),
        (-t * end, 0.95),
    ]
    return Model((
        _flat(grip, 0.025, paint, finish),
        egg(vec(0, tall), (w, tall, 0.03), paint, finish),
        egg(vec(0, tall * 1.02, 0.02), (w * 0.8, tall * 0.8, 0.015), paint, Finish(finish.gloss, 25, finish.metal)),
    ))  # fmt: skip


def fork(hand: Hand) -> Model:
    paint, t, end = (
        plain(np.full(3, hand.between(0.5, 0.8), np.float32)),
        hand.between(0.014, 0.024),
        hand.between(1, 2.2),
    )
    count, w = hand.whole(3, 4), hand.between(0.06, 0.09)
    comb: list[tuple[float, float]] = []
    for k in range(count):
        x, half = w * (2 * k / (count - 1) - 1), w / count * 0.45
        comb += [
            (x - half, 0.2),
            (x - half * 0.6, 0.0),
            (x + half * 0.6, 0.0),
            (x + half, 0.2),
        ]
    body = [
        (t, 0.36),
        (t, 0.45),
        (t * end, 0.95),
        (0, 1.0),
        (-t * end, 0.95),
        (-t, 0.45),
        (-t, 0.36),
        (-w, 0.3),
    ]
    return Model(
        (Slab(loop([*comb, (w, 0.3), *body], 0), 0.02, paint, finish=STEEL, puff=0.02),)
    )


def knife(hand: Hand) -> Model:
    w, split = hand.between(0.025, 0.07), hand.between(0.5, 0.65)
    blade = [
        (-0.012, split),
        (-0.012, 0.05),
        (0.0, 0.0),
        (w, hand.between(0.08, 0.2)),
        (w, split),
    ]
    grip = [(-0.025, split), (0.03, split), (0.04, 0.97), (0.0, 1.0), (-0.03, 0.97)]
    own = hand.one_of([None, hand.grey(0.02, 0.2), hand.wood(), hand.bright()])
    metal = plain(np.full(3, 0.7, np.float32))
    handle = metal if own is None else finishable(hand, own)
    return Model(
        (
            _flat(blade, 0.015, metal, STEEL, 1),
            _flat(grip, 0.05, handle, STEEL if own is None else any_finish(hand), 1),
        )
    )


def candle(hand: Hand) -> Model:
    r, h, colour = (
        hand.between(0.05, 0.3),
        hand.between(0.5, 0.95),
        hand.one_of([hand.white(), hand.colour()]),
    )
    wax = Lathe(
        profile(
            [
                (0, 0),
                (r, 0),
                (r, h),
                (r * 0.9, h + 0.01),
                (r * 0.8, h - 0.02),
                (0, h - 0.03),
            ]
        ),
        plain(colour),
        Finish(0.15, 20),
        plain(shade(colour, 0.9)),
    )
    parts: list[Part] = [
        wax,
        Tube(
            curve([(0, h - 0.03, 0), (0, h + 0.03, 0), (0.01, h + 0.06, 0)], 5),
            np.full(5, 0.008, np.float32),
            plain(np.full(3, 0.02, np.float32)),
        ),
    ]
    if r < 0.12:
        holder = hand.colour()
        parts.append(
            Lathe(
                profile(
                    [
                        (0, 0),
                        (0.22, 0),
                        (0.24, 0.05),
                        (r + 0.03, 0.06),
                        (r + 0.03, 0.16),
                        (0, 0.16),
                    ]
                ),
                plain(holder),
                any_finish(hand),
            )
        )
    return Model(tuple(parts))


def lamp(hand: Hand) -> Model:
    cloth = hand.one_of([hand.white(), hand.colour()])
    low, high = hand.between(0.5, 0.62), 1.0
    wide, narrow = hand.between(0.28, 0.42), hand.between(0.15, 0.3)
    shade_ = [
        (wide, low),
        (narrow, high),
        (narrow - 0.01, high - 0.002),
        (narrow + 0.01, high - 0.1),
        (0.02, low + 0.1),
    ]
    foot = [
        (0, 0),
        (hand.between(0.15, 0.25), 0),
        (0.2, 0.03),
        (hand.between(0.03, 0.18), 0.15),
        (0.02, low * 0.7),
        (0.02, low + 0.15),
        (0, low + 0.15),
    ]
    return Model((
        Lathe(profile(foot, hand.whole(0, 2)), finishable(hand, hand.colour()), any_finish(hand)),
        Lathe(profile(shade_), finishable(hand, cloth), MATT, plain(shade(cloth, 1.2))),
    ))  # fmt: skip


def cutting_board(hand: Hand) -> Model:
    paint = textured(hand, hand.wood(), "wood", 0.4, 1)
    hole = [
        np.column_stack([0.05 * np.cos(t), 0.4 + 0.05 * np.sin(t)]).astype(np.float32)
        for t in [np.linspace(0, 6.28, 14, endpoint=False)]
    ]
    return Model(
        (
            Slab(
                rounded(hand.between(0.4, 0.8), 1.0, 0.06),
                0.04,
                paint,
                holes=hole if hand.chance(0.6) else [],
                finish=MATT,
                puff=0.015,
            ),
        )
    )


def salt_mill(hand: Hand) -> Model:
    colour = hand.one_of([hand.wood(), hand.colour(), np.full(3, 0.6, np.float32)])
    body = [
        (0, 0),
        (0.18, 0),
        (0.18, 0.1),
        (0.1, 0.45),
        (0.16, 0.62),
        (0.13, 0.7),
        (0.17, 0.8),
        (0.1, 0.95),
        (0.03, 0.96),
        (0.04, 1.0),
        (0, 1.0),
    ]
    return Model((Lathe(profile(body, 2), finishable(hand, colour), any_finish(hand)),))


def napkin_box(hand: Hand) -> Model:
    """A box of tissues with one pulled out."""
    h, colour = hand.between(0.3, 0.5), hand.colour()
    pattern = textured(
        hand, colour, hand.one_of(["floral", "dots", "plain", "stripes"]), 0.5, 1.5
    )
    tuft = [
        Ellipsoid(
            vec(0.05 * k, h + 0.12),
            (about("z", 20 * k) @ np.diag([0.1, 0.18, 0.04])).astype(np.float32),
            plain(hand.white()),
        )
        for k in (-1, 0, 1)
    ]
    return Model((Box(vec(0, h / 2), vec(0.5, h / 2, 0.27), pattern), *tuft))


KINDS = [
    Kind("teapot", teapot, 24),
    Kind("pan", pan, 34),
    Kind("spoon", spoon, 18, ("flat",)),
    Kind("fork", fork, 19, ("flat",)),
    Kind("knife", knife, 22, ("flat",)),
    Kind("candle", candle, 14),
    Kind("lamp", lamp, 38),
    Kind("cutting_board", cutting_board, 30, ("flat", "lean")),
    Kind("salt_mill", salt_mill, 15),
    Kind("napkin_box", napkin_box, 22),
]
