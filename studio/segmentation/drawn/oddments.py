"""Small plain shapes: stones, rings, rolls of tape, buttons, biscuits and stars, letters."""

from __future__ import annotations

import numpy as np

from .build import (
    GLAZED,
    MATT,
    Kind,
    Model,
    about,
    any_finish,
    circle,
    egg,
    loop,
    profile,
    vec,
)
from .hand import Hand
from .paint import (
    anywhere,
    disc,
    finishable,
    over,
    plain,
    ring,
    stripes,
    textured,
)
from .parts import Ellipsoid, Lathe, Slab, Tube


def stone(hand: Hand) -> Model:
    colour = hand.one_of([hand.grey(), hand.wood(), hand.muted()])
    paint = textured(
        hand,
        colour,
        hand.one_of(["stone", "grain", "marble"]),
        hand.between(0.2, 0.6),
        hand.between(0.6, 2),
    )
    a, b, c = hand.between(0.3, 0.5), hand.between(0.15, 0.35), hand.between(0.25, 0.45)
    turn = about("y", hand.between(0, 180))
    bumps = [
        Ellipsoid(
            vec(
                hand.between(-0.12, 0.12),
                b * hand.between(0.8, 1.1),
                hand.between(-0.1, 0.1),
            ),
            (turn @ np.diag([a * 0.8, b * 0.9, c * 0.85])).astype(np.float32),
            paint,
        )
        for _ in range(2)
    ]
    return Model((egg(vec(0, b), (a, b, c), paint, MATT, turn), *bumps))


def ring_toy(hand: Hand) -> Model:
    """A ring one looks through: tape, bangle, washer, rubber ring, doughnut."""
    t = np.linspace(0, 2 * np.pi, 60)
    r = hand.between(0.06, 0.2)
    line = np.column_stack(
        [(0.5 - r) * np.cos(t), np.full(60, r), (0.5 - r) * np.sin(t)]
    ).astype(np.float32)
    paint = finishable(hand, hand.colour())
    if hand.chance(0.4):
        paint = over(paint, stripes(hand.direction(), 6, 0.4), plain(hand.colour()))
    return Model((Tube(line, np.full(60, r, np.float32), paint, any_finish(hand)),))


def tape(hand: Hand) -> Model:
    r, h, colour = hand.between(0.25, 0.42), hand.between(0.15, 0.5), hand.colour()
    inner = plain(hand.wood())
    return Model(
        (
            Lathe(
                profile(
                    [
                        (0.45, 0),
                        (0.5, 0.01),
                        (0.5, h),
                        (r + 0.03, h),
                        (r, h - 0.003),
                        (r, 0),
                    ]
                ),
                plain(colour),
                any_finish(hand),
                inner,
            ),
        )
    )


def button(hand: Hand) -> Model:
    holes = [
        circle(x, y, 0.06, 10)
        for x, y in ((-0.11, -0.11), (0.11, -0.11), (0.11, 0.11), (-0.11, 0.11))
    ]
    base = over(
        finishable(hand, hand.colour()), ring(0, 0, 0.38, 0.03), plain(hand.colour())
    )
    return Model(
        (Slab(circle(0, 0, 0.5, 32), 0.1, base, holes=holes, finish=GLAZED, puff=0.05),)
    )


def star(hand: Hand) -> Model:
    """Biscuits, stars, hearts, clouds, letters cut of wood, dough or plastic."""
    count, deep = hand.whole(4, 9), hand.between(0.45, 0.85)
    t = np.arange(2 * count) * np.pi / count + hand.between(0, 1)
    r = np.where(np.arange(2 * count) % 2, 0.5 * deep, 0.5)
    outline = loop(
        [
            (float(a * np.cos(b)), float(a * np.sin(b)))
            for a, b in zip(r, t, strict=True)
        ],
        hand.whole(0, 2),
    )
    paint = finishable(hand, hand.one_of([hand.wood(), hand.colour()]))
    if hand.chance(0.3):
        paint = over(
            paint,
            anywhere(
                [
                    disc(hand.between(-0.3, 0.3), hand.between(-0.3, 0.3), 0.06)
                    for _ in range(6)
                ]
            ),
            plain(hand.colour()),
        )
    return Model(
        (
            Slab(
                outline,
                hand.between(0.06, 0.25),
                paint,
                finish=any_finish(hand),
                puff=hand.between(0.02, 0.12),
            ),
        )
    )


def letter(hand: Hand) -> Model:
    shape = hand.one_of([
        [(0, 0), (0.2, 0), (0.2, 0.8), (0.6, 0.8), (0.6, 1), (0, 1)], [(0, 0), (0.7, 0), (0.7, 0.2), (0.2, 0.2), (0.2, 1), (0, 1)],
        [(0.25, 0), (0.45, 0), (0.45, 0.8), (0.7, 0.8), (0.7, 1), (0, 1), (0, 0.8), (0.25, 0.8)],
        [(0, 0), (0.6, 0), (0.6, 0.2), (0.2, 0.2), (0.2, 0.4), (0.5, 0.4), (0.5, 0.6), (0.2, 0.6), (0.2, 0.8), (0.6, 0.8), (0.6, 1), (0, 1)],
    ])  # fmt: skip
    return Model(
        (
            Slab(
                loop([(x - 0.3, y) for x, y in shape]),
                hand.between(0.12, 0.3),
                plain(hand.bright()),
                finish=any_finish(hand),
            ),
        )
    )


KINDS = [
    Kind("stone", stone, 8),
    Kind("ring_toy", ring_toy, 9),
    Kind("tape", tape, 9),
    Kind("button", button, 3, ("flat",)),
    Kind("star", star, 8, ("flat", "lean")),
    Kind("letter", letter, 7, ("stand", "flat")),
]
