"""Toys: vehicles, animals, dolls, ducks, robots, tops, soft monsters."""

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
    curve,
    egg,
    loop,
    profile,
    shade,
    vec,
)
from .hand import Hand
from .paint import (
    anywhere,
    band,
    caps,
    disc,
    finishable,
    over,
    patch,
    plain,
    printed,
    textured,
)
from .parts import Box, Lathe, Paint, Part, Slab, Tube


def _wheel(x: float, y: float, z: float, r: float, hub: Paint) -> Lathe:
    tyre = over(
        plain(np.full(3, 0.02, np.float32)),
        lambda s: (np.hypot(s.own[:, 0] - x, s.own[:, 1] - y) < 0.55 * r).astype(
            np.float32
        ),
        hub,
    )
    return Lathe(
        profile(
            [(0, 0), (r * 0.9, 0), (r, 0.02), (r, 0.07), (r * 0.9, 0.09), (0, 0.09)]
        ),
        tyre,
        SATIN,
        None,
        vec(x, y, z),
        vec(0, 0, 1),
    )


def vehicle(hand: Hand) -> Model:
    """Car, van, truck or bus from the side: body, cabin, windows, wheels, lights."""
    body, roof = hand.bright() if hand.chance(0.7) else hand.colour(), hand.colour()
    finish, wide = hand.one_of([GLAZED, SATIN, MATT]), hand.between(0.34, 0.48)
    r, what = (
        hand.between(0.09, 0.13),
        hand.one_of(["car", "car", "van", "truck", "bus"]),
    )
    dark, y = (
        plain(hand.one_of([vec(0.02, 0.03, 0.05), vec(0.3, 0.4, 0.5), hand.colour()])),
        r * 0.7,
    )
    h = hand.between(0.16, 0.24)
    low = [
        (-0.5, y),
        (0.5, y),
        (0.5, y + h * 0.7),
        (0.44, y + h),
        (-0.48, y + h),
        (-0.5, y + h * 0.6),
    ]
    top = y + h + hand.between(0.12, 0.2)
    if what == "car":
        a, b = hand.between(-0.42, -0.3), hand.between(0.12, 0.3)
        cabin = [(a, y + h - 0.01), (b + 0.1, y + h - 0.01), (b, top), (a + 0.1, top)]
    elif what == "truck":
        cabin = [
            (0.2, y + h - 0.01),
            (0.5, y + h - 0.01),
            (0.46, top + 0.08),
            (0.2, top + 0.08),
        ]
    else:
        top += 0.1
        cabin = [(-0.5, y + h - 0.01), (0.5, y + h - 0.01), (0.44, top), (-0.48, top)]
    shell = plain(body)
    parts: list[Part] = [
        Slab(
            loop(low, 1),
            wide,
            over(
                shell,
                lambda s: (np.abs(s.v - y - h * 0.45) < 0.015).astype(np.float32),
                plain(shade(body, 0.5)),
            ),
            finish=finish,
            puff=0.03,
        )
    ]
    parts.append(
        Slab(
            loop(cabin, 1),
            wide * 0.9,
            plain(body if hand.chance(0.6) else roof),
            dark if what == "car" else None,
            finish,
            puff=0.03,
        )
    )
    left, right = cabin[0][0] + 0.08, cabin[1][0] - 0.1
    count = max(1, int((right - left) / 0.18))
    for k in range(count):
        x0 = left + (right - left) * k / count
        x1 = left + (right - left) * (k + 0.82) / count
        parts.append(
            Slab(
                loop(
                    [
                        (x0, y + h + 0.015),
                        (x1, y + h + 0.015),
                        (x1 - 0.02, top - 0.03),
                        (x0 + 0.02, top - 0.03),
                    ]
                ),
                wide * 0.92,
                dark,
                finish=GLAZED,
            )
        )
    if what == "truck":
        load = hand.between(0.05, 0.35)
        parts.append(
            Box(
                vec(-0.16, y + h + load / 2),
                vec(0.33, load / 2, wide / 2),
                finishable(hand, hand.colour()),
                finish=finish,
            )
        )
    hub = plain(hand.one_of([vec(0.5, 0.5, 0.5), hand.bright(), vec(0.02, 0.02, 0.02)]))
    for x in (-0.3, hand.between(0.25, 0.33)):
        parts += [
            _wheel(x, r, wide / 2 - 0.05, r, hub),
            _wheel(x, r, -wide / 2 - 0.03, r, hub),
        ]
    parts += [
        ball(vec(0.48, y + h * 0.6, z), 0.035, plain(vec(0.8, 0.75, 0.5)), GLAZED)
        for z in (-0.12, 0.12)
    ]
    return Model(tuple(parts))


def animal(hand: Hand) -> Model:
    """A four-legged toy: pig, dog, cow, elephant, giraffe ..., plush or plastic."""
    colour, other = (
        hand.one_of([hand.wood(), hand.colour(), hand.bright(), vec(0.8, 0.4, 0.4)]),
        hand.colour(),
    )
    coat: Paint = finishable(hand, colour)
    if hand.chance(0.35):
        coat = over(
            coat,
            caps(np.stack([hand.direction() for _ in range(9)]), 0.9, vec(0, 0.4)),
            plain(other),
        )
    finish = hand.one_of([MATT, MATT, SATIN, GLAZED])
    long, fat, leg = (
        hand.between(0.25, 0.4),
        hand.between(0.16, 0.27),
        hand.between(0.08, 0.35),
    )
    y, neck = leg + fat * 0.8, hand.between(0.0, 0.35)
    head, hx, hy = (
        hand.between(0.12, 0.2),
        long * 0.9,
        leg + fat * 0.8 + neck + fat * 0.4,
    )
    parts: list[Part] = [
        egg(vec(0, y), (long, fat, fat * 0.9), coat, finish),
        ball(vec(hx, hy), head, coat, finish),
    ]
    parts.append(
        Tube(
            curve([(long * 0.6, y, 0), (hx, hy, 0)], 8),
            np.full(8, head * 0.75, np.float32),
            coat,
            finish,
        )
    )
    feet = plain(other) if hand.chance(0.4) else coat
    for x in (-long * 0.65, long * 0.6):
        for z in (-fat * 0.5, fat * 0.5):
            parts.append(
                Tube(
                    curve([(x, y, z), (x * 1.05, 0.05, z)], 6),
                    np.full(6, hand.between(0.05, 0.08), np.float32),
                    coat,
                    finish,
                )
            )
            parts.append(
                egg(vec(x * 1.05 + 0.02, 0.04, z), (0.08, 0.045, 0.07), feet, finish)
            )
    snout = hand.between(0.04, head)
    parts.append(
        egg(
            vec(hx + head * 0.7, hy - head * 0.25),
            (snout + 0.04, head * 0.5, head * 0.5),
            plain(other) if hand.chance(0.5) else coat,
            finish,
        )
    )
    ear = hand.one_of(
        [(0.05, 0.1, 0.03), (0.09, 0.09, 0.03), (0.04, 0.2, 0.03), (0.16, 0.2, 0.03)]
    )
    for z in (-1, 1):
        parts.append(
            egg(
                vec(hx - head * 0.2, hy + head * 0.9, z * head * 0.7),
                ear,
                coat,
                finish,
                about("x", z * 25),
            )
        )
        parts.append(
            ball(
                vec(hx + head * 0.65, hy + head * 0.35, z * head * 0.55),
                0.028,
                plain(np.full(3, 0.01, np.float32)),
                GLAZED,
            )
        )
    tail = curve(
        [
            (-long * 0.9, y, 0),
            (-long - 0.1, y + 0.1, 0.02),
            (-long - 0.15, y + hand.between(-0.2, 0.3), 0),
        ],
        12,
    )
    parts.append(Tube(tail, np.full(12, 0.025, np.float32), coat, finish))
    return Model(tuple(parts))


def figure(hand: Hand) -> Model:
    """A doll, bear or little man: head, trunk, limbs, eyes."""
    skin, cloth, legs = (
        hand.one_of([hand.wood(), hand.colour(), vec(0.7, 0.45, 0.33)]),
        hand.colour(),
        hand.colour(),
    )
    finish = hand.one_of([MATT, MATT, SATIN, GLAZED])
    bear = hand.chance(0.4)
    trunk = finishable(hand, skin if bear else cloth)
    face, trousers = plain(skin), trunk if bear else plain(legs)
    r, fat, y = (
        hand.between(0.13, 0.2),
        hand.between(0.12, 0.2),
        hand.between(0.25, 0.4),
    )
    parts: list[Part] = [
        egg(vec(0, y + 0.15), (fat, 0.22, fat * 0.8), trunk, finish),
        ball(vec(0, y + 0.3 + r), r, face, finish),
    ]
    for side in (-1, 1):
        swing = hand.between(-0.05, 0.25)
        arm = curve(
            [
                (side * fat * 0.8, y + 0.26, 0),
                (side * (fat + 0.1), y + 0.15 + swing * 0.3, 0.05),
                (side * (fat + 0.12), y + swing, 0.1),
            ],
            10,
        )
        parts.append(Tube(arm, np.full(10, 0.05, np.float32), trunk, finish))
        parts.append(ball(arm[-1], 0.055, face, finish))
        parts.append(
            Tube(
                curve(
                    [
                        (side * 0.08, y + 0.05, 0),
                        (side * 0.09, 0.05, hand.between(0, 0.1)),
                    ],
                    8,
                ),
                np.full(8, 0.065, np.float32),
                trousers,
                finish,
            )
        )
        parts.append(
            egg(
                vec(side * 0.09, 0.035, 0.06),
                (0.06, 0.04, 0.1),
                plain(hand.grey()),
                finish,
            )
        )
        parts.append(
            ball(
                vec(side * r * 0.38, y + 0.33 + r, r * 0.9),
                0.022,
                plain(np.full(3, 0.01, np.float32)),
                GLAZED,
            )
        )
        if bear:
            parts.append(
                ball(vec(side * r * 0.75, y + 0.3 + r * 1.8), r * 0.36, face, finish)
            )
    if not bear:
        hat = plain(hand.colour())
        parts.append(
            egg(
                vec(0, y + 0.34 + r * 1.25, -0.02),
                (r * 1.06, r * 0.8, r * 1.06),
                hat,
                finish,
            )
        )
        if hand.chance(0.4):
            parts.append(
                Lathe(
                    profile(
                        [
                            (0, 0),
                            (r * 1.5, 0),
                            (r * 1.5, 0.02),
                            (r * 0.8, 0.04),
                            (r * 0.7, 0.2),
                            (0, 0.2),
                        ]
                    ),
                    hat,
                    finish,
                    None,
                    vec(0, y + 0.3 + r * 1.5),
                )
            )
    return Model(tuple(parts))


def duck(hand: Hand) -> Model:
    colour = hand.one_of([vec(0.85, 0.6, 0.03), hand.bright()])
    skin, bill = plain(colour), plain(vec(0.8, 0.2, 0.02))
    return Model((
        egg(vec(0, 0.25), (0.42, 0.25, 0.3), skin, GLAZED), ball(vec(0.2, 0.62), 0.22, skin, GLAZED),
        egg(vec(-0.38, 0.36), (0.16, 0.08, 0.14), skin, GLAZED, about("z", -35)), egg(vec(0.44, 0.58), (0.12, 0.035, 0.1), bill, GLAZED),
        ball(vec(0.34, 0.7, 0.14), 0.035, plain(vec(0.01, 0.01, 0.01)), GLAZED), ball(vec(0.34, 0.7, -0.14), 0.035, plain(vec(0.01, 0.01, 0.01)), GLAZED),
    ))  # fmt: skip


def stacking_rings(hand: Hand) -> Model:
    count, y = hand.whole(3, 6), 0.08
    parts: list[Part] = [
        Lathe(
            profile([(0, 0), (0.4, 0), (0.4, 0.08), (0, 0.08)]),
            plain(hand.colour()),
            SATIN,
        )
    ]
    for k in range(count):
        r, h = 0.38 - 0.2 * k / count, 0.7 / count
        parts.append(
            egg(vec(0, y + h / 2), (r, h * 0.62, r), plain(hand.bright()), SATIN)
        )
        y += h
    return Model((*parts, ball(vec(0, y + 0.06), 0.1, plain(hand.bright()), SATIN)))


def robot(hand: Hand) -> Model:
    metal, finish = hand.colour(), hand.one_of([SATIN, STEEL, GLAZED])
    face = over(
        plain(metal),
        anywhere(
            [disc(-0.4, 0.2, 0.18), disc(0.4, 0.2, 0.18), patch(0, -0.5, 0.5, 0.1)]
        ),
        plain(hand.colour()),
    )
    chest = printed(hand, plain(metal))
    limb, dark = plain(hand.colour()), plain(hand.grey())
    parts: list[Part] = [
        Box(vec(0, 0.85), vec(0.15, 0.13, 0.13), face, finish=finish),
        Box(
            vec(0, 0.48),
            vec(0.22, 0.22, 0.14),
            chest,
            plain(metal),
            plain(metal),
            finish,
        ),
    ]
    for side in (-1, 1):
        parts += [
            Box(vec(side * 0.29, 0.48), vec(0.05, 0.2, 0.06), limb, finish=finish),
            Box(vec(side * 0.11, 0.15), vec(0.08, 0.15, 0.09), limb, finish=finish),
            Box(
                vec(side * 0.11, 0.03, 0.04), vec(0.1, 0.03, 0.14), dark, finish=finish
            ),
        ]
    return Model(
        (
            *parts,
            Tube(
                curve([(0, 0.97, 0), (0, 1.1, 0)], 4),
                np.full(4, 0.015, np.float32),
                dark,
            ),
            ball(vec(0, 1.1), 0.04, plain(hand.bright())),
        )
    )


def spinning_top(hand: Hand) -> Model:
    base = plain(hand.colour())
    for _ in range(3):
        low = hand.between(0.1, 0.7)
        base = over(
            base,
            band(low, low + 0.1),
            plain(hand.bright()),
        )
    return Model(
        (
            Lathe(
                profile(
                    [
                        (0, 0),
                        (0.03, 0.02),
                        (0.4, 0.35),
                        (0.4, 0.42),
                        (0.05, 0.55),
                        (0.04, 0.9),
                        (0, 0.92),
                    ],
                    1,
                ),
                base,
                GLAZED,
            ),
        )
    )


def plush(hand: Hand) -> Model:
    """A soft lump with eyes: monster, cushion toy, chick."""
    coat = textured(hand, hand.colour(), "carpet", 0.5, 1.2)
    w, h = hand.between(0.3, 0.5), hand.between(0.35, 0.5)
    eyes = [
        ball(
            vec(s * w * 0.35, h * 1.25, w * 0.75),
            hand.between(0.04, 0.09),
            plain(hand.one_of([vec(0.02, 0.02, 0.02), vec(0.85, 0.85, 0.85)])),
            GLAZED,
        )
        for s in (-1, 1)
    ]
    limbs = [
        egg(
            vec(s * w * 0.9, h * y, 0.05),
            (0.12, 0.16, 0.12),
            coat,
            MATT,
            about("z", s * 40),
        )
        for s in (-1, 1)
        for y in (0.35, 1.0)
    ]
    return Model(
        (
            egg(vec(0, h), (w, h, w * 0.8), coat),
            *eyes,
            *limbs,
            egg(vec(0, h * 0.8, w * 0.7), (0.12, 0.08, 0.08), plain(hand.colour())),
        )
    )


KINDS = [
    Kind("vehicle", vehicle, 14),
    Kind("animal", animal, 15),
    Kind("figure", figure, 15, ("stand", "stand", "flat")),
    Kind("duck", duck, 9),
    Kind("stacking_rings", stacking_rings, 18),
    Kind("robot", robot, 16),
    Kind("spinning_top", spinning_top, 7, ("lie",)),
    Kind("plush", plush, 20),
]
