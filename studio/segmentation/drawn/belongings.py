"""What people carry, wear and keep: phones, spectacles, clocks, shoes, cameras, cushions, baskets."""

from __future__ import annotations

import numpy as np

from .build import (
    GLAZED,
    MATT,
    SATIN,
    STEEL,
    Kind,
    Model,
    about,
    ball,
    circle,
    curve,
    egg,
    loop,
    profile,
    rounded,
    vec,
)
from .canvas import Finish
from .hand import Array, Hand
from .paint import (
    Where,
    anywhere,
    band,
    disc,
    finishable,
    over,
    patch,
    plain,
    textured,
)
from .parts import Box, Lathe, Part, Slab, Surface, Tube


def phone(hand: Hand) -> Model:
    body = plain(hand.one_of([hand.grey(0.01, 0.05), hand.colour()]))
    w = hand.between(0.46, 0.54)
    screen = hand.one_of(
        [
            plain(vec(0.01, 0.01, 0.015)),
            plain(vec(0.01, 0.01, 0.015)),
            finishable(hand, hand.bright()),
        ]
    )
    face = over(body, patch(0, 0.5, w * 0.46, 0.44), screen)
    if hand.chance(0.4):
        icons = [
            patch(w * (x - 1.5) / 5, 0.2 + 0.13 * y, 0.03, 0.03)
            for x in range(4)
            for y in range(5)
        ]
        face = over(face, anywhere(icons), plain(hand.colour()))
    if hand.chance(0.3):
        face = over(
            body,
            anywhere([disc(-w * 0.3, 0.88, 0.05), disc(-w * 0.3, 0.74, 0.05)]),
            plain(vec(0.01, 0.01, 0.02)),
        )
    return Model(
        (
            Slab(
                rounded(w, 1.0, 0.07) + vec(0, 0.5)[:2],
                0.06,
                face,
                body,
                GLAZED,
                puff=0.015,
            ),
        )
    )


def remote(hand: Hand) -> Model:
    body, w = plain(hand.grey(0.01, 0.5)), hand.between(0.22, 0.34)
    spots = [
        disc(w * (x - 1) / 4, 0.15 + 0.09 * y, 0.025)
        for x in range(3)
        for y in range(8)
        if hand.chance(0.85)
    ]
    face = over(
        over(body, anywhere(spots), plain(hand.grey(0.2, 0.8))),
        disc(w * 0.2, 0.92, 0.03),
        plain(vec(0.6, 0.02, 0.02)),
    )
    return Model(
        (
            Slab(
                rounded(w, 1.0, 0.06) + vec(0, 0.5)[:2],
                0.1,
                face,
                finish=SATIN,
                puff=0.03,
            ),
        )
    )


def spectacles(hand: Hand) -> Model:
    frame, finish = (
        plain(
            hand.one_of(
                [hand.grey(0.01, 0.05), hand.wood() * 0.3, hand.colour()]
            ).astype(np.float32)
        ),
        GLAZED,
    )
    t, thick = (
        np.linspace(0, 2 * np.pi, 40),
        np.full(40, hand.between(0.015, 0.035), np.float32),
    )
    tall = hand.between(0.15, 0.22)
    parts: list[Part] = []
    for side in (-1, 1):
        x = np.sign(np.cos(t)) * np.abs(np.cos(t)) ** 0.7 * 0.22
        parts.append(
            Tube(
                np.column_stack(
                    [side * 0.28 + x, tall + tall * np.sin(t), 0 * t]
                ).astype(np.float32),
                thick,
                frame,
                finish,
            )
        )
        parts.append(
            Tube(
                curve(
                    [
                        (side * 0.5, tall * 1.4, 0),
                        (side * 0.52, tall * 1.4, -0.5),
                        (side * 0.48, tall * 0.7, -0.8),
                    ]
                ),
                np.full(20, 0.02, np.float32),
                frame,
                finish,
            )
        )
        if hand.chance(0.8):
            parts.append(
                Slab(
                    circle(side * 0.28, tall, 0.21, 24, tall / 0.21),
                    0.005,
                    plain(vec(0.5, 0.5, 0.5)),
                    finish=Finish(0.8, 150, 0.05, hand.between(0.3, 0.9)),
                )
            )
    return Model(
        (
            *parts,
            Tube(
                curve(
                    [(-0.07, tall * 1.3, 0), (0, tall * 1.5, 0), (0.07, tall * 1.3, 0)],
                    8,
                ),
                np.full(8, 0.02, np.float32),
                frame,
                finish,
            ),
        )
    )


def _clock_hand(along: Array, off: Array, long: float, wide: float) -> Where:
    def pattern(s: Surface) -> Array:
        u, v = s.u, s.v - 0.5
        beside, ahead = u * off[0] + v * off[1], u * along[0] + v * along[1]
        return ((np.abs(beside) < wide) & (np.abs(ahead - long / 2) < long / 2)).astype(
            np.float32
        )

    return pattern


def clock(hand: Hand) -> Model:
    """A table clock or an alarm clock: a dial with hands, on feet."""
    case, dial = (
        plain(hand.colour()),
        plain(hand.one_of([hand.white(), hand.grey(0.01, 0.05)])),
    )
    dark = plain(hand.one_of([vec(0.02, 0.02, 0.02), vec(0.6, 0.05, 0.05)]))
    marks = [
        disc(0.33 * float(np.sin(a)), 0.5 + 0.33 * float(np.cos(a)), 0.02)
        for a in np.linspace(0, 6.28, 12, endpoint=False)
    ]
    face = over(over(case, disc(0, 0.5, 0.4), dial), anywhere(marks), dark)
    hour, minute = hand.between(0, 6.28), hand.between(0, 6.28)
    for turn, long, wide in ((hour, 0.2, 0.02), (minute, 0.3, 0.013)):
        along, off = (
            np.array([np.sin(turn), np.cos(turn)], np.float32),
            np.array([np.cos(turn), -np.sin(turn)], np.float32),
        )
        face = over(face, _clock_hand(along, off, long, wide), dark)
    outline = (
        circle(0, 0.5, 0.47, 32)
        if hand.chance(0.7)
        else rounded(0.94, 0.94, 0.1) + vec(0, 0.5)[:2]
    )
    feet = [ball(vec(s * 0.3, 0.08), 0.07, case, GLAZED) for s in (-1, 1)]
    bells = (
        [
            ball(vec(s * 0.25, 0.98), 0.13, plain(vec(0.6, 0.5, 0.3)), STEEL)
            for s in (-1, 1)
        ]
        if hand.chance(0.4)
        else []
    )
    return Model(
        (
            Slab(outline, hand.between(0.15, 0.35), face, case, GLAZED, puff=0.03),
            *feet,
            *bells,
        )
    )


def shoe(hand: Hand) -> Model:
    upper, sole = (
        finishable(hand, hand.colour()),
        plain(hand.one_of([hand.white(), hand.grey()])),
    )
    w, ankle = hand.between(0.17, 0.21), hand.between(0.25, 0.5)
    half = [
        (-0.5, 0.6),
        (-0.3, 0.85),
        (0, 0.75),
        (0.25, 1),
        (0.45, 0.75),
        (0.53, 0.2),
    ]  # the sole seen from above
    foot = loop([(x, y * w) for x, y in half] + [(x, -y * w) for x, y in half[::-1]], 1)
    parts: list[Part] = [
        Slab(foot, 0.07, sole, finish=SATIN, centre=vec(0, 0.035), turn=about("x", -90), puff=0.02),
        egg(vec(-0.22, 0.15), (0.27, 0.16, w * 0.95), upper, SATIN), Lathe(profile([(0.2, 0.1), (0.18, ankle), (0.16, ankle), (0.14, 0.2), (0, 0.18)]), upper, SATIN, plain(vec(0.05, 0.04, 0.04)), vec(-0.27, 0)),
    ]  # fmt: skip
    lace = plain(hand.one_of([hand.white(), hand.colour()]))
    for k in range(hand.whole(0, 4)):
        x, y = -0.02 + 0.08 * k, 0.3 - 0.03 * k
        parts.append(
            Tube(
                curve([(x, y - 0.06, -0.1), (x, y, 0), (x, y - 0.06, 0.1)], 8),
                np.full(8, 0.017, np.float32),
                lace,
            )
        )
    return Model(tuple(parts))


def camera(hand: Hand) -> Model:
    dark, grip = (
        plain(hand.grey(0.01, 0.06)),
        textured(
            hand,
            hand.one_of([hand.grey(0.02, 0.1), hand.wood() * 0.4]).astype(np.float32),
            "carpet",
            0.5,
            2,
        ),
    )
    body = over(grip, band(0.5, 1.1), plain(hand.grey(0.03, 0.6)))
    lens = Lathe(
        profile(
            [(0, 0), (0.22, 0), (0.22, 0.25), (0.18, 0.26), (0.15, 0.2), (0, 0.18)]
        ),
        over(dark, band(0.4, 0.6), plain(hand.grey())),
        GLAZED,
        plain(vec(0.03, 0.02, 0.06)),
        vec(hand.between(-0.1, 0.1), 0.32, 0.15),
        vec(0, 0, 1),
    )
    return Model(
        (
            Box(vec(0, 0.32), vec(0.5, 0.32, 0.16), body, finish=SATIN),
            lens,
            Box(vec(0.02, 0.68), vec(0.14, 0.07, 0.1), dark, finish=SATIN),
            Lathe(
                profile([(0, 0), (0.06, 0), (0.06, 0.05), (0, 0.05)]),
                dark,
                STEEL,
                None,
                vec(0.35, 0.64),
            ),
        )
    )


def headphones(hand: Hand) -> Model:
    dark, t = plain(hand.colour()), np.linspace(0, np.pi, 30)
    bow = np.column_stack([0.4 * np.cos(t), 0.35 + 0.5 * np.sin(t), 0 * t]).astype(
        np.float32
    )
    shells = [
        egg(vec(s * 0.4, 0.3), (0.1, 0.2, 0.17), plain(hand.colour()), SATIN)
        for s in (-1, 1)
    ]
    return Model((Tube(bow, np.full(30, 0.035, np.float32), dark, SATIN), *shells))


def cushion(hand: Hand) -> Model:
    base = textured(
        hand,
        hand.colour(),
        hand.one_of(["weave", "tartan", "floral", "stripes", "carpet"]),
        0.5,
        1,
    )
    return Model(
        (
            Slab(
                loop(
                    [
                        (-0.5, 0),
                        (0.5, 0),
                        (0.47, 0.48),
                        (0.5, 0.95),
                        (-0.5, 0.95),
                        (-0.47, 0.48),
                    ],
                    1,
                ),
                0.22,
                base,
                puff=0.25,
            ),
        )
    )


def basket(hand: Hand) -> Model:
    weave = textured(hand, hand.wood(), "weave", 0.6, 2)
    h = hand.between(0.25, 0.5)
    body = Lathe(
        profile(
            [
                (0, 0),
                (0.35, 0),
                (0.48, h),
                (0.5, h + 0.03),
                (0.45, h),
                (0.34, 0.05),
                (0, 0.05),
            ]
        ),
        weave,
        MATT,
        weave,
    )
    if hand.chance(0.5):
        return Model((body,))
    t = np.linspace(0, np.pi, 24)
    return Model(
        (
            body,
            Tube(
                np.column_stack([0.46 * np.cos(t), h + 0.45 * np.sin(t), 0 * t]).astype(
                    np.float32
                ),
                np.full(24, 0.03, np.float32),
                weave,
            ),
        )
    )


KINDS = [
    Kind("phone", phone, 14, ("flat", "lean")),
    Kind("remote", remote, 17, ("flat",)),
    Kind("spectacles", spectacles, 15),
    Kind("clock", clock, 13),
    Kind("shoe", shoe, 26),
    Kind("camera", camera, 12),
    Kind("headphones", headphones, 19, ("stand", "flat")),
    Kind("cushion", cushion, 40, ("stand", "flat")),
    Kind("basket", basket, 28),
]
