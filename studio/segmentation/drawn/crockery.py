"""What one drinks and eats from: cups, glasses, bottles, jars, bowls, plates, vases."""

from __future__ import annotations

import numpy as np

from .build import (
    GLASS,
    GLAZED,
    MATT,
    STEEL,
    Kind,
    Model,
    any_finish,
    curve,
    profile,
    vec,
    wrapped,
)
from .canvas import Finish
from .hand import Array, Hand
from .paint import (
    Where,
    band,
    caps,
    finishable,
    over,
    plain,
    printed,
    stripes,
    textured,
)
from .parts import Lathe, Paint, Part, Surface, Tube


def decorated(hand: Hand, colour: Array) -> Paint:
    """Paint of crockery: even, banded, spotted, printed."""
    base = finishable(hand, colour)
    what = hand.one_of(
        ["even", "bands", "print", "spots", "stripes"], [5, 3, 3, 1.2, 1]
    )
    if what == "bands":
        for _ in range(hand.whole(1, 3)):
            low = hand.between(0, 0.95)
            base = over(
                base, band(low, low + hand.between(0.02, 0.3)), plain(hand.colour())
            )
    elif what == "print":
        base = wrapped(printed(hand, base), hand.between(-0.3, 0.3))
    elif what == "spots":
        spots = np.stack([hand.direction() for _ in range(14)])
        base = over(
            base,
            caps(spots, hand.between(0.93, 0.985), vec(0, 0.5)),
            plain(hand.colour()),
        )
    elif what == "stripes":
        base = over(
            base,
            stripes(hand.direction(), hand.between(5, 14), hand.between(0.2, 0.6)),
            plain(hand.colour()),
        )
    return base


def _handle(
    hand: Hand,
    x: float,
    low: float,
    high: float,
    out: float,
    thick: float,
    paint: Paint,
    finish: Finish,
) -> Tube:
    bow = [
        (x - 0.03, high, 0),
        (x + out, high + hand.between(-0.04, 0.06), 0),
        (x + out * hand.between(0.8, 1.1), low, 0),
        (x - 0.03, low, 0),
    ]
    line = curve(bow, 24)
    return Tube(line, np.full(24, thick, np.float32), paint, finish)


def mug(hand: Hand) -> Model:
    r, h, wall = (
        hand.between(0.3, 0.48),
        hand.between(0.75, 1.0),
        hand.between(0.02, 0.05),
    )
    colour, finish = hand.colour(), hand.one_of([GLAZED, GLAZED, any_finish(hand)])
    top = r * hand.between(0.9, 1.25)
    belly = r * hand.between(0.9, 1.15)
    body = [(0, 0), (r * 0.85, 0), (r, 0.04), (belly, h * 0.5), (top, h)]
    drink = hand.one_of(
        [None, None, hand.wood() * 0.15, hand.wood() * 0.5, hand.white()]
    )
    level = h * hand.between(0.6, 0.92)
    floor = [
        (top - wall, h - 0.01),
        (belly - wall, h * 0.55),
        (belly - wall, level if drink is not None else 0.08),
        (0, level if drink is not None else 0.07),
    ]
    inner = plain(colour if hand.chance(0.5) else hand.white())
    if drink is not None:
        inner = over(
            inner,
            lambda s: (np.abs(s.own[:, 1] - level) < 0.015).astype(np.float32),
            plain(drink.astype(np.float32)),
        )
    paint = decorated(hand, colour)
    parts: list[Part] = [Lathe(profile(body + floor, 1), paint, finish, inner)]
    if hand.chance(0.85):
        middle = hand.between(0.35, 0.6) * h
        parts.append(
            _handle(
                hand,
                (belly + r) / 2,
                middle - 0.22 * h,
                middle + 0.28 * h,
                hand.between(0.2, 0.4),
                hand.between(0.03, 0.065),
                plain(colour),
                finish,
            )
        )
    return Model(tuple(parts))


def tumbler(hand: Hand) -> Model:
    r, top, h = hand.between(0.2, 0.36), hand.between(0.26, 0.42), 1.0
    tint = np.array([0.9, 0.93, 0.92], np.float32) * (
        1 if hand.chance(0.7) else hand.bright()
    )
    clear = Finish(0.9, 150, 0.08, hand.between(0.7, 0.92))
    level = hand.between(0.3, 0.85) if hand.chance(0.6) else 0.06
    body = [(0, 0), (r, 0), (r, 0.02), (top, h)]
    t = r + (top - r) * level - 0.03
    drink = hand.one_of([tint, hand.bright(), hand.wood()])
    wall = over(
        plain(tint), band(0.03, level * 0.8), plain((drink * 0.8).astype(np.float32))
    )
    return Model(
        (
            Lathe(
                profile(body + [(top - 0.02, h - 0.005), (t, level), (0, level)]),
                wall,
                clear,
                plain(tint),
            ),
        )
    )


def wine_glass(hand: Hand) -> Model:
    r, bowl = hand.between(0.16, 0.26), hand.between(0.42, 0.6)
    body = [
        (0, 0),
        (0.24, 0),
        (0.22, 0.02),
        (0.03, 0.06),
        (0.02, bowl - 0.08),
        (r * 0.8, bowl + 0.08),
        (r * 1.1, bowl + 0.2),
        (r * 0.85, 1.0),
    ]
    floor = [
        (r * 0.82, 0.99),
        (r * 1.05, bowl + 0.22),
        (r * 0.7, bowl + 0.08),
        (0, bowl + 0.02),
    ]
    tint = np.array([0.9, 0.92, 0.92], np.float32)
    wine = over(
        plain(tint),
        band(bowl + 0.03, bowl + hand.between(0.1, 0.28)),
        plain(hand.one_of([vec(0.25, 0.01, 0.03), vec(0.85, 0.7, 0.3), tint])),
    )
    return Model((Lathe(profile(body + floor, 2), wine, GLASS, plain(tint)),))


def bottle(hand: Hand) -> Model:
    r, neck, shoulder = (
        hand.between(0.11, 0.2),
        hand.between(0.03, 0.07),
        hand.between(0.5, 0.75),
    )
    colour = hand.one_of(
        [hand.green() * 0.5, hand.wood() * 0.4, np.full(3, 0.85), hand.colour()]
    ).astype(np.float32)
    glassy = hand.chance(0.55)
    body = [
        (0, 0),
        (r, 0),
        (r, 0.03),
        (r, shoulder),
        (r * hand.between(0.6, 1.0), shoulder + 0.08),
        (neck, shoulder + hand.between(0.1, 0.18)),
        (neck, 0.95),
        (neck * 1.2, 0.955),
        (neck * 1.2, 1.0),
        (0, 1.0),
    ]
    paint = plain(colour)
    if hand.chance(0.75):
        low = hand.between(0.1, 0.3) * shoulder
        paint = _label(hand, paint, low, hand.between(0.7, 0.95) * shoulder)
    if hand.chance(0.7):
        paint = over(paint, band(hand.between(0.86, 0.95), 1.01), plain(hand.colour()))
    finish = (
        Finish(0.9, 130, 0.1, hand.between(0.2, 0.75)) if glassy else any_finish(hand)
    )
    return Model((Lathe(profile(body, hand.whole(0, 2)), paint, finish),))


def _label(hand: Hand, base: Paint, low: float, high: float) -> Paint:
    label = wrapped(
        printed(hand, plain(hand.one_of([hand.white(), hand.colour()]))),
        hand.between(-0.4, 0.4),
    )
    half = hand.one_of([1.0, hand.between(0.3, 0.6)])

    def where(s: Surface) -> Array:
        return ((s.v > low) & (s.v < high) & (np.abs(s.u) < half)).astype(np.float32)

    return over(base, where, label)


def jar(hand: Hand) -> Model:
    r, h = hand.between(0.28, 0.45), hand.between(0.65, 1.0)
    clear = hand.chance(0.6)
    inside = textured(
        hand,
        hand.colour(),
        hand.one_of(["stone", "grain", "blotches", "plain"]),
        0.5,
        2,
    )
    paint = over(
        inside if clear else finishable(hand, hand.colour()),
        band(0.82, 2),
        plain(hand.colour()),
    )
    if hand.chance(0.6):
        paint = _label(hand, paint, 0.15, 0.65)
    body = [
        (0, 0),
        (r * 0.95, 0),
        (r, 0.05),
        (r, h * 0.7),
        (r * 0.8, h * 0.82),
        (r * 0.86, h * 0.83),
        (r * 0.86, h * 0.98),
        (r * 0.8, h),
        (0, h),
    ]
    return Model(
        (
            Lathe(
                profile(body),
                paint,
                Finish(0.8, 120, 0.05) if clear else any_finish(hand),
            ),
        )
    )


def can(hand: Hand) -> Model:
    r, h = hand.between(0.22, 0.45), hand.between(0.5, 1.0)
    ends = over(
        _label(hand, plain(hand.colour()), 0.08, 0.92),
        lambda s: ((s.v < 0.05) | (s.v > 0.955)).astype(np.float32),
        plain(np.full(3, 0.6, np.float32)),
    )
    body = [
        (0, 0),
        (r * 0.92, 0),
        (r, 0.04),
        (r, h - 0.05),
        (r * 0.93, h),
        (r * 0.9, h - 0.001),
        (r * 0.9, h - 0.03),
        (0, h - 0.03),
    ]
    return Model(
        (
            Lathe(
                profile(body),
                ends,
                hand.one_of([STEEL, SATIN_METAL, any_finish(hand)]),
                plain(np.full(3, 0.55, np.float32)),
            ),
        )
    )


SATIN_METAL = Finish(0.4, 25, 0.3)


def bowl(hand: Hand) -> Model:
    h, foot, wall = hand.between(0.25, 0.55), hand.between(0.15, 0.3), 0.025
    curve_out = hand.between(0.3, 0.5)
    body = [(0, 0), (foot, 0), (foot, 0.03), (curve_out, h * 0.35), (0.5, h)]
    floor = [
        (0.5 - wall, h - 0.005),
        (curve_out - wall, h * 0.4),
        (foot * 0.8, 0.07),
        (0, 0.06),
    ]
    colour = hand.colour()
    inner = finishable(hand, colour if hand.chance(0.5) else hand.colour())
    if hand.chance(0.3):
        level = h * hand.between(0.5, 0.8)
        body_in = [
            (0.5 - wall, h - 0.005),
            ((curve_out + 0.5) / 2 - wall, level),
            (0, level + hand.between(-0.01, 0.08)),
        ]
        floor = body_in
        inner = textured(
            hand, hand.colour(), hand.one_of(["stone", "blotches", "grain"]), 0.6, 2
        )
    finish = hand.one_of([GLAZED, GLAZED, STEEL, GLASS, MATT])
    return Model(
        (Lathe(profile(body + floor, 1), decorated(hand, colour), finish, inner),)
    )


def plate(hand: Hand) -> Model:
    h, well, foot = (
        hand.between(0.04, 0.12),
        hand.between(0.26, 0.4),
        hand.between(0.2, 0.3),
    )
    colour = hand.one_of([hand.white(), hand.white(), hand.colour()])
    body = [(0, 0), (foot, 0), (foot + 0.02, 0.012), (0.5, h)]
    floor = [
        (0.495, h + 0.001),
        (well, h * 0.55),
        (well * 0.92, h * 0.25 + 0.015),
        (0, h * 0.25 + 0.015),
    ]
    inner: Paint = finishable(hand, colour)
    for _ in range(hand.whole(0, 3)):
        at, wide, ink = (
            hand.between(0.05, 0.49),
            hand.between(0.005, 0.05),
            plain(hand.colour()),
        )
        inner = over(inner, _radial(at, wide), ink)
    if hand.chance(0.2):
        inner = over(
            inner,
            _radial(0, well * 0.7),
            textured(hand, hand.colour(), "floral", 0.8, 1.5),
        )
    return Model(
        (
            Lathe(
                profile(body + floor),
                plain(colour),
                hand.one_of([GLAZED, GLAZED, MATT, STEEL]),
                inner,
            ),
        )
    )


def _radial(at: float, wide: float) -> Where:
    return lambda s: (np.abs(np.hypot(s.own[:, 0], s.own[:, 2]) - at) < wide).astype(
        np.float32
    )


def cup_and_saucer(hand: Hand) -> Model:
    colour = hand.one_of([hand.white(), hand.colour()])
    r, h = hand.between(0.22, 0.3), hand.between(0.28, 0.45)
    body = [(0, 0.05), (r * 0.6, 0.05), (r * 0.95, 0.05 + h * 0.4), (r * 1.1, 0.05 + h)]
    level = 0.05 + h * hand.between(0.5, 0.9)
    floor = [(r * 1.06, 0.045 + h), (r * 0.95, level), (0, level)]
    saucer = [(0, 0), (0.25, 0), (0.5, 0.06), (0.49, 0.065), (0.25, 0.025), (0, 0.025)]
    drink = plain(
        hand.one_of([hand.wood() * 0.12, hand.wood() * 0.6]).astype(np.float32)
    )
    return Model((
        Lathe(profile(saucer), plain(colour), GLAZED, finishable(hand, colour)),
        Lathe(profile(body + floor, 1), decorated(hand, colour), GLAZED, drink),
        _handle(hand, r * 0.95, 0.12, 0.05 + h * 0.8, 0.16, 0.025, plain(colour), GLAZED),
    ))  # fmt: skip


def vase(hand: Hand) -> Model:
    points = (
        [(0.0, 0.0)]
        + [(hand.between(0.1, 0.34), y) for y in (0.0, 0.3, 0.55, 0.8)]
        + [(hand.between(0.08, 0.25), 1.0)]
    )
    neck = points[-1][0]
    body = profile([*points, (neck - 0.02, 0.995), (neck - 0.02, 0.8), (0, 0.78)], 2)
    return Model(
        (
            Lathe(
                body,
                decorated(hand, hand.colour()),
                any_finish(hand),
                plain(np.full(3, 0.05, np.float32)),
            ),
        )
    )


KINDS = [
    Kind("mug", mug, 10),
    Kind("tumbler", tumbler, 13, ("stand", "stand", "lie")),
    Kind("wine_glass", wine_glass, 20),
    Kind("bottle", bottle, 26, ("stand", "stand", "lie")),
    Kind("jar", jar, 13),
    Kind("can", can, 12, ("stand", "stand", "lie")),
    Kind("bowl", bowl, 15),
    Kind("plate", plate, 22),
    Kind("cup_and_saucer", cup_and_saucer, 15),
    Kind("vase", vase, 24),
]
