"""Things of games: balls, marbles, coins, dominoes, dice, chessmen, blocks."""

from __future__ import annotations

import numpy as np

from .build import (
    GLAZED,
    Kind,
    Model,
    about,
    any_finish,
    ball,
    loop,
    profile,
    shade,
    vec,
)
from .canvas import Finish
from .hand import Array, Hand
from .paint import (
    Where,
    anywhere,
    caps,
    disc,
    finishable,
    numeral,
    over,
    patch,
    plain,
    stamp,
    stripes,
    textured,
)
from .parts import Box, Lathe, Paint, Slab, Surface

POOL = [
    (0.8, 0.6, 0.02),
    (0.02, 0.05, 0.4),
    (0.6, 0.01, 0.01),
    (0.1, 0.02, 0.2),
    (0.8, 0.2, 0.02),
    (0.01, 0.2, 0.06),
    (0.25, 0.01, 0.02),
    (0.01, 0.01, 0.01),
]


IVORY = np.array([0.8, 0.75, 0.62], np.float32)


def sphere(hand: Hand, paint: Paint, finish: Finish) -> Model:
    return Model((ball(vec(0, 0.5), 0.5, paint, finish),))


def billiard_ball(hand: Hand) -> Model:
    number = hand.whole(0, 15)
    if number == 0:
        return sphere(hand, plain(IVORY), Finish(0.9, 200, 0.04))
    colour = plain(np.array(POOL[(number - 1) % 8], np.float32))
    centre, axis = vec(0, 0.5), hand.direction()
    paint = colour
    if number > 8:
        paint = over(colour, caps(np.stack([axis, -axis]), 0.62, centre), plain(IVORY))
    side = np.cross(axis, hand.direction())
    side = (side / np.linalg.norm(side)).astype(np.float32)
    paint = over(paint, caps(np.stack([side, -side]), 0.9, centre), plain(IVORY))
    return sphere(
        hand,
        over(
            paint,
            _spot_text(str(number), side, axis, centre, 0.3),
            plain(np.full(3, 0.02, np.float32)),
        ),
        Finish(0.9, 200, 0.04),
    )


def _spot_text(
    text: str, middle: Array, up: Array, centre: Array, size: float
) -> Where:
    mask, across = numeral(text), np.cross(up, middle).astype(np.float32)
    flat = stamp(mask, 0, 0, size, size)

    def pattern(s: Surface) -> Array:
        p = (s.own - centre) * 2
        shown = flat(Surface(p, p @ across, p @ up, s.texel))
        return shown * (p @ middle > 0.5)

    return pattern


def toy_ball(hand: Hand) -> Model:
    """Plain, striped, spotted, with sectors, seams or panels: toy, tennis, basket, foot, bowling, wool."""
    centre, axis = vec(0, 0.5), hand.direction()
    colour, other = hand.colour(), plain(hand.colour())
    base: Paint = plain(colour)
    what = hand.one_of(
        ["plain", "stripe", "spots", "sectors", "seams", "panels", "texture", "wool"],
        [4, 2, 1.5, 2, 1.5, 1.5, 2, 1],
    )
    finish = any_finish(hand)
    if what == "stripe":
        base = over(
            base,
            lambda s: (np.abs((s.own - centre) @ axis) < 0.16).astype(np.float32),
            other,
        )
    elif what == "spots":
        base = over(
            base,
            caps(
                np.stack([hand.direction() for _ in range(16)]),
                hand.between(0.92, 0.98),
                centre,
            ),
            other,
        )
    elif what == "sectors":
        side = np.cross(axis, hand.direction())
        side = (side / np.linalg.norm(side)).astype(np.float32)
        third, count = np.cross(axis, side).astype(np.float32), hand.whole(2, 5)

        def angle(s: Surface) -> Array:
            return np.arctan2((s.own - centre) @ side, (s.own - centre) @ third)

        base = over(
            base, lambda s: (np.sin(angle(s) * count) > 0).astype(np.float32), other
        )
        base = over(
            base, caps(np.stack([axis, -axis]), 0.97, centre), plain(hand.colour())
        )
    elif what == "seams":
        b, dark = (
            hand.direction(),
            plain(np.full(3, hand.one_of([0.02, 0.7]), np.float32)),
        )
        bow = hand.between(-1.2, 1.2)

        def bend(s: Surface) -> Array:
            p = 2 * (s.own - centre)
            return p @ axis + bow * (p @ b) ** 2 - bow * 0.4

        base = over(base, lambda s: (np.abs(bend(s)) < 0.05).astype(np.float32), dark)
        base = over(
            base,
            lambda s: (np.abs((s.own - centre) @ b) < 0.025).astype(np.float32),
            dark,
        )
    elif what == "panels":
        golden = np.array(
            [
                [0, 1, 1.618],
                [0, 1, -1.618],
                [1, 1.618, 0],
                [-1, 1.618, 0],
                [1.618, 0, 1],
                [-1.618, 0, 1],
            ],
            np.float32,
        )
        directions = np.concatenate([golden, -golden]) / np.linalg.norm(golden[0])
        turn = about("x", hand.between(0, 90)) @ about("y", hand.between(0, 90))
        base = over(
            plain(hand.white()),
            caps((directions @ turn.T).astype(np.float32), 0.94, centre),
            plain(hand.one_of([hand.grey(0.01, 0.05), hand.bright()])),
        )
    elif what == "texture":
        base = textured(
            hand,
            colour,
            hand.one_of(["blotches", "marble", "stone", "wood", "carpet", "plain"]),
            hand.between(0.2, 0.7),
            hand.between(0.4, 1.5),
        )
    elif what == "wool":
        for _ in range(5):
            base = over(
                base,
                stripes(hand.direction(), hand.between(9, 16), 0.25),
                plain(shade(colour, hand.between(0.5, 1.4))),
            )
    return sphere(hand, base, finish)


def marble(hand: Hand) -> Model:
    return sphere(
        hand,
        textured(hand, hand.bright(), "marble", 0.7, 0.8),
        Finish(0.9, 180, 0.1, hand.between(0, 0.6)),
    )


def coin(hand: Hand) -> Model:
    metal = hand.one_of(
        [
            vec(0.75, 0.6, 0.25),
            vec(0.6, 0.3, 0.18),
            vec(0.65, 0.65, 0.63),
            vec(0.2, 0.15, 0.1),
        ]
    )
    relief = textured(
        hand,
        metal,
        hand.one_of(["blotches", "grain", "text"]),
        hand.between(0.2, 0.5),
        hand.between(1.2, 2.5),
    )

    def radial(s: Surface) -> Array:
        return np.hypot(s.own[:, 0], s.own[:, 2])

    face = over(relief, lambda s: (radial(s) > 0.43).astype(np.float32), plain(metal))
    face = over(
        face,
        lambda s: (np.abs(radial(s) - hand_ring) < 0.012).astype(np.float32),
        plain(shade(metal, 0.5)),
    )
    hand_ring = hand.between(0.36, 0.44)
    if hand.chance(0.2):
        face = over(
            face,
            lambda s: (radial(s) > 0.3).astype(np.float32),
            plain(vec(0.65, 0.65, 0.62)),
        )
    h = hand.between(0.05, 0.1)
    return Model(
        (
            Lathe(
                profile(
                    [(0, 0), (0.49, 0), (0.5, 0.01), (0.5, h - 0.01), (0.49, h), (0, h)]
                ),
                face,
                Finish(0.45, 25, 0.45),
            ),
        )
    )


def block(hand: Hand) -> Model:
    """A toy block: cube, bar, arch, cylinder, wedge; painted or of plain wood, with a letter or not."""
    colour, finish = (
        hand.one_of([hand.wood(), hand.bright(), hand.colour()]),
        any_finish(hand),
    )
    base = (
        textured(hand, colour, "wood", hand.between(0.1, 0.4), hand.between(0.5, 1.2))
        if hand.chance(0.5)
        else plain(colour)
    )
    shape = hand.one_of(["cube", "cube", "bar", "roof", "arch", "post"])
    if shape == "cube":
        face: Paint = base
        if hand.chance(0.4):
            frame, ink = plain(hand.colour()), plain(hand.colour())
            face = over(
                over(
                    base,
                    lambda s: (np.maximum(np.abs(s.u), np.abs(s.v)) > 0.8).astype(
                        np.float32
                    ),
                    frame,
                ),
                stamp(numeral(chr(hand.whole(65, 90))), 0, 0, 0.7, 0.7),
                ink,
            )
        return Model(
            (
                Box(
                    vec(0, 0.5),
                    vec(0.5, 0.5, 0.5),
                    face,
                    finish=finish,
                    bevel=hand.between(0.02, 0.12),
                ),
            )
        )
    if shape == "bar":
        h, d = hand.between(0.12, 0.4), hand.between(0.12, 0.35)
        return Model((Box(vec(0, h / 2), vec(0.5, h / 2, d / 2), base, finish=finish),))
    if shape == "roof":
        return Model(
            (
                Slab(
                    loop([(-0.5, 0), (0.5, 0), (0, hand.between(0.4, 0.7))]),
                    hand.between(0.3, 0.5),
                    base,
                    finish=finish,
                ),
            )
        )
    if shape == "arch":
        t = np.linspace(0, np.pi, 14)
        inner = [(float(0.27 * np.cos(a)), float(0.3 * np.sin(a))) for a in t]
        return Model(
            (
                Slab(
                    loop([(0.5, 0), (0.5, 0.5), (-0.5, 0.5), (-0.5, 0), *inner[::-1]]),
                    0.3,
                    base,
                    finish=finish,
                ),
            )
        )
    r = hand.between(0.15, 0.4)
    return Model((Lathe(profile([(0, 0), (r, 0), (r, 1), (0, 1)]), base, finish),))


PIPS = {
    1: [(0, 0)],
    2: [(-1, 1), (1, -1)],
    3: [(-1, 1), (0, 0), (1, -1)],
    4: [(-1, 1), (1, 1), (-1, -1), (1, -1)],
    5: [(-1, 1), (1, 1), (-1, -1), (1, -1), (0, 0)],
    6: [(-1, 1), (-1, 0), (-1, -1), (1, 1), (1, 0), (1, -1)],
    0: [],
}


def _pips(
    number: int, middle: float, spread_v: float, radius: float, stretch: float
) -> list[Where]:
    return [
        disc(0.5 * x, middle + spread_v * y, radius, stretch) for x, y in PIPS[number]
    ]


def domino(hand: Hand) -> Model:
    colour = hand.one_of(
        [hand.white(), hand.grey(0.01, 0.04), hand.wood(), hand.colour()], [3, 2, 2, 2]
    )
    dark = colour.mean() < 0.2
    ink = plain(
        hand.white()
        if dark
        else hand.grey(0.01, 0.05)
        if hand.chance(0.8)
        else hand.bright()
    )
    face: Paint = plain(colour)
    if hand.chance(0.75):
        pips = _pips(hand.whole(0, 6), 0.5, 0.28, 0.15, 2.0) + _pips(
            hand.whole(0, 6), -0.5, 0.28, 0.15, 2.0
        )
        face = over(face, anywhere([*pips, patch(0, 0, 0.8, 0.02)]), ink)
    return Model(
        (
            Box(
                vec(0, 0.5),
                vec(0.25, 0.5, hand.between(0.06, 0.11)),
                face,
                plain(colour),
                plain(colour),
                any_finish(hand),
                bevel=0.08,
            ),
        )
    )


def die(hand: Hand) -> Model:
    colour = hand.one_of([hand.white(), hand.bright()])
    faces = [
        over(
            plain(colour),
            anywhere(_pips(k, 0, 0.5, 0.17, 1.0)),
            plain(hand.grey(0.01, 0.04)),
        )
        for k in (hand.whole(1, 6), hand.whole(1, 6), hand.whole(1, 6))
    ]
    return Model(
        (
            Box(
                vec(0, 0.5),
                vec(0.5, 0.5, 0.5),
                faces[0],
                faces[1],
                faces[2],
                GLAZED,
                bevel=0.15,
            ),
        )
    )


def puzzle_cube(hand: Hand) -> Model:
    colours = np.stack(
        [
            vec(0.6, 0.02, 0.02),
            vec(0.8, 0.7, 0.03),
            vec(0.02, 0.1, 0.5),
            vec(0.02, 0.35, 0.08),
            vec(0.8, 0.25, 0.02),
            vec(0.8, 0.8, 0.8),
        ]
    )

    def face() -> Paint:
        grid = hand.rng.integers(0, 6, (3, 3))

        def paint(s: Surface) -> Array:
            x, y = (
                (s.u * 1.4999 + 1.5).clip(0, 2.99),
                (s.v * 1.4999 + 1.5).clip(0, 2.99),
            )
            seam = (np.abs(x % 1 - 0.5) > 0.44) | (np.abs(y % 1 - 0.5) > 0.44)
            return np.where(
                seam[:, None],
                np.float32(0.015),
                colours[grid[y.astype(int), x.astype(int)]],
            )

        return paint

    return Model(
        (
            Box(
                vec(0, 0.5),
                vec(0.5, 0.5, 0.5),
                face(),
                face(),
                face(),
                GLAZED,
                bevel=0.04,
            ),
        )
    )


def chess_piece(hand: Hand) -> Model:
    colour = hand.one_of([hand.white(), hand.grey(0.01, 0.04), hand.wood()])
    body = [
        (0, 0),
        (0.24, 0),
        (0.24, 0.06),
        (0.17, 0.12),
        (0.1, 0.25),
        (0.08, 0.55),
        (0.16, 0.6),
        (0.08, 0.64),
    ]
    head = (
        [(0.17, 0.75), (0.14, 0.9), (0, 0.94)]
        if hand.chance(0.6)
        else [(0.12, 0.66), (0.16, 0.95), (0, 0.95)]
    )
    return Model((Lathe(profile(body + head, 1), finishable(hand, colour), GLAZED),))


KINDS = [
    Kind("billiard_ball", billiard_ball, 6),
    Kind("toy_ball", toy_ball, 12),
    Kind("marble", marble, 3),
    Kind("coin", coin, 3),
    Kind("block", block, 5, ("stand", "stand", "lie")),
    Kind("domino", domino, 5, ("stand", "flat")),
    Kind("die", die, 3),
    Kind("puzzle_cube", puzzle_cube, 6),
    Kind("chess_piece", chess_piece, 8, ("stand", "stand", "lie")),
]
