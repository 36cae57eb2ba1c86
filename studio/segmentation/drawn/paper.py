"""Things of paper and board: books, boxes, parcels, bags, pads."""

from __future__ import annotations

import numpy as np

from .build import (
    GLAZED,
    MATT,
    SATIN,
    Kind,
    Model,
    about,
    curve,
    egg,
    rounded,
    shade,
    vec,
)
from .hand import Hand
from .paint import (
    anywhere,
    band,
    finishable,
    over,
    patch,
    plain,
    printed,
    stamp,
    stripes,
    textured,
    words,
)
from .parts import Box, Paint, Part, Slab, Surface, Tube


def book(hand: Hand) -> Model:
    """Standing, its spine to the front: two covers, pages between them, a printed spine."""
    thick, deep = hand.between(0.06, 0.28), hand.between(0.55, 0.8)
    colour = hand.colour()
    cover, finish = finishable(hand, colour), hand.one_of([MATT, SATIN, GLAZED])
    ink = plain(
        hand.one_of(
            [hand.white(), hand.grey(0.02, 0.06), vec(0.6, 0.45, 0.15), hand.colour()]
        )
    )
    spine = (
        over(
            cover,
            anywhere(
                [
                    band(hand.between(-0.9, -0.7), -0.65),
                    band(0.7, hand.between(0.75, 0.9)),
                ]
            ),
            ink,
        )
        if hand.chance(0.5)
        else cover
    )
    upright = np.ascontiguousarray(np.rot90(words(hand, 1, hand.whole(5, 12)), 3))
    spine = over(
        spine,
        stamp(upright, 0, hand.between(-0.2, 0.2), 0.5, hand.between(0.3, 0.6)),
        ink,
    )
    face = printed(hand, cover)
    paper = hand.one_of([vec(0.75, 0.7, 0.55), vec(0.8, 0.78, 0.72)])
    leaves = over(
        plain(paper),
        stripes(vec(1, 0), hand.between(40, 90), 0.4),
        plain(shade(paper, 0.7)),
    )
    board, inset, half = 0.012, 0.015, thick / 2
    parts: list[Part] = [
        Box(
            vec(0, 0.5, -deep / 2),
            vec(half - board, 0.5 - inset, deep / 2 - inset),
            leaves,
            leaves,
            leaves,
            bevel=0,
        ),
        Box(
            vec(0, 0.5, -board / 2), vec(half, 0.5, board), spine, cover, cover, finish
        ),
    ]
    for side in (-1, 1):
        parts.append(
            Box(
                vec(side * (half - board / 2), 0.5, -deep / 2),
                vec(board, 0.5, deep / 2),
                cover,
                face,
                cover,
                finish,
                bevel=0,
            )
        )
    return Model(tuple(parts))


def _shrunk(paint: Paint, u: float, v: float, half_u: float, half_v: float) -> Paint:
    """A face's paint within a smaller rectangle of the face."""
    a, b = np.float32(half_u), np.float32(half_v)
    return lambda s: paint(Surface(s.own, (s.u - u) / a, (s.v - v) / b, s.texel))


def carton(hand: Hand) -> Model:
    """Cardboard box: plain, taped, with a label; or a packet with printed faces."""
    w, h, d = 0.5, hand.between(0.2, 0.6), hand.between(0.25, 0.5)
    if hand.chance(0.5):
        base = textured(
            hand, hand.wood(), hand.one_of(["plain", "grain", "carpet"]), 0.15, 1
        )
        tape = plain(
            hand.one_of([vec(0.5, 0.36, 0.18), hand.white(), hand.grey(0.1, 0.4)])
        )
        strip = hand.between(0.06, 0.16)
        top = over(
            base,
            lambda s: (np.abs(s.v) < 0.015).astype(np.float32),
            plain(vec(0.05, 0.03, 0.02)),
        )
        front = base
        if hand.chance(0.7):
            top = over(top, lambda s: (np.abs(s.v) < strip).astype(np.float32), tape)
        if hand.chance(0.5):
            label = printed(hand, plain(hand.white()))
            u, v, a, b = (
                hand.between(-0.5, 0.5),
                hand.between(-0.3, 0.3),
                hand.between(0.2, 0.4),
                hand.between(0.2, 0.5),
            )
            front = over(front, patch(u, v, a, b), _shrunk(label, u, v, a, b))
        elif hand.chance(0.5):
            front = printed(hand, front)
        return Model(
            (Box(vec(0, h), vec(w, h, d), front, base, top, MATT, bevel=0.02),)
        )
    colour = hand.colour()
    base = (
        plain(colour)
        if hand.chance(0.5)
        else textured(
            hand, colour, hand.one_of(["floral", "dots", "stripes", "plain"]), 0.4, 1.2
        )
    )
    return Model(
        (
            Box(
                vec(0, h),
                vec(w, h, d),
                printed(hand, base),
                printed(hand, base),
                base,
                hand.one_of([MATT, SATIN]),
                bevel=0.02,
            ),
        )
    )


def gift(hand: Hand) -> Model:
    h, d, ribbon = hand.between(0.2, 0.5), hand.between(0.3, 0.5), plain(hand.bright())
    base = textured(
        hand,
        hand.colour(),
        hand.one_of(["dots", "stripes", "floral", "plain"]),
        0.6,
        1.2,
    )
    cross: Paint = over(
        base,
        lambda s: (np.minimum(np.abs(s.u), np.abs(s.v)) < 0.1).astype(np.float32),
        ribbon,
    )
    side = over(base, lambda s: (np.abs(s.u) < 0.1).astype(np.float32), ribbon)
    bows = [
        egg(
            vec(k * 0.13, 2 * h + 0.07),
            (0.15, 0.07, 0.09),
            ribbon,
            SATIN,
            about("z", k * 25),
        )
        for k in (-1, 1)
    ]
    return Model((Box(vec(0, h), vec(0.5, h, d), side, side, cross, SATIN), *bows))


def paper_bag(hand: Hand) -> Model:
    base = printed(
        hand, textured(hand, hand.one_of([hand.wood(), hand.colour()]), "plain", 0.2)
    )
    grip = curve(
        [(-0.15, 0.95, 0.2), (-0.15, 1.25, 0.2), (0.15, 1.25, 0.2), (0.15, 0.95, 0.2)],
        20,
    )
    return Model(
        (
            Box(vec(0, 0.5), vec(0.36, 0.5, 0.2), base),
            Tube(grip, np.full(20, 0.014, np.float32), plain(hand.grey())),
        )
    )


def notebook(hand: Hand) -> Model:
    """Flat: a pad, card, envelope, photo or folder, which one could pick up."""
    paint = printed(hand, finishable(hand, hand.colour()))
    outline = rounded(hand.between(0.6, 0.85), 1.0, 0.04)
    return Model(
        (
            Slab(
                outline,
                hand.between(0.02, 0.08),
                paint,
                plain(hand.white()),
                hand.one_of([MATT, SATIN]),
            ),
        )
    )


KINDS = [
    Kind("book", book, 22, ("stand", "side", "side")),
    Kind("carton", carton, 28),
    Kind("gift", gift, 20),
    Kind("paper_bag", paper_bag, 25),
    Kind("notebook", notebook, 18, ("flat", "lean")),
]
