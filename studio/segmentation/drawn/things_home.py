"""Things of desk, workshop, hall and garden: books, boxes, tools, clothes, gadgets, fruit, plants."""

from __future__ import annotations

import numpy as np

from .build import GLAZED, MATT, SATIN, STEEL, Kind, Model, about, any_finish, ball, circle, curve, egg, loop, profile, rounded, shade, vec
from .canvas import Finish
from .hand import Array, Hand
from .paint import anywhere, band, caps, disc, finishable, over, patch, plain, printed, stamp, stripes, textured, words
from .parts import Box, Ellipsoid, Lathe, Paint, Part, Slab, Surface, Tube

# Paper ---------------------------------------------------------------------------------------------------


def book(hand: Hand) -> Model:
    """Standing, its spine to the front: two covers, pages between them, a printed spine."""
    thick, deep = hand.between(0.06, 0.28), hand.between(0.55, 0.8)
    colour = hand.colour()
    cover, finish = finishable(hand, colour), hand.one_of([MATT, SATIN, GLAZED])
    ink = plain(hand.one_of([hand.white(), hand.grey(0.02, 0.06), vec(0.6, 0.45, 0.15), hand.colour()]))
    spine = over(cover, anywhere([band(hand.between(-0.9, -0.7), -0.65), band(0.7, hand.between(0.75, 0.9))]), ink) if hand.chance(0.5) else cover
    upright = np.ascontiguousarray(np.rot90(words(hand, 1, hand.whole(5, 12)), 3))
    spine = over(spine, stamp(upright, 0, hand.between(-0.2, 0.2), 0.5, hand.between(0.3, 0.6)), ink)
    face = printed(hand, cover)
    paper = hand.one_of([vec(0.75, 0.7, 0.55), vec(0.8, 0.78, 0.72)])
    leaves = over(plain(paper), stripes(vec(1, 0), hand.between(40, 90), 0.4), plain(shade(paper, 0.7)))
    board, inset, half = 0.012, 0.015, thick / 2
    parts: list[Part] = [
        Box(vec(0, 0.5, -deep / 2), vec(half - board, 0.5 - inset, deep / 2 - inset), leaves, leaves, leaves, bevel=0),
        Box(vec(0, 0.5, -board / 2), vec(half, 0.5, board), spine, cover, cover, finish),
    ]
    for side in (-1, 1):
        parts.append(Box(vec(side * (half - board / 2), 0.5, -deep / 2), vec(board, 0.5, deep / 2), cover, face, cover, finish, bevel=0))
    return Model(tuple(parts))


def paperback(hand: Hand) -> Model:
    """Lying, seen from above or in a heap."""
    return book(hand)


def carton(hand: Hand) -> Model:
    """Cardboard box: plain, taped, with a label; or a packet with printed faces."""
    w, h, d = 0.5, hand.between(0.2, 0.6), hand.between(0.25, 0.5)
    if hand.chance(0.5):
        base = textured(hand, hand.wood(), hand.one_of(["plain", "grain", "carpet"]), 0.15, 1)
        tape = plain(hand.one_of([vec(0.5, 0.36, 0.18), hand.white(), hand.grey(0.1, 0.4)]))
        strip = hand.between(0.06, 0.16)
        top = over(base, lambda s: (np.abs(s.v) < 0.015).astype(np.float32), plain(vec(0.05, 0.03, 0.02)))
        front = base
        if hand.chance(0.7):
            top = over(top, lambda s: (np.abs(s.v) < strip).astype(np.float32), tape)
        if hand.chance(0.5):
            label = printed(hand, plain(hand.white()))
            u, v, a, b = hand.between(-0.5, 0.5), hand.between(-0.3, 0.3), hand.between(0.2, 0.4), hand.between(0.2, 0.5)
            inner = lambda s: label(Surface(s.own, (s.u - u) / np.float32(a), (s.v - v) / np.float32(b), s.texel))  # noqa: E731
            front = over(front, patch(u, v, a, b), inner)
        elif hand.chance(0.5):
            front = printed(hand, front)
        return Model((Box(vec(0, h), vec(w, h, d), front, base, top, MATT, bevel=0.02),))
    colour = hand.colour()
    base = plain(colour) if hand.chance(0.5) else textured(hand, colour, hand.one_of(["floral", "dots", "stripes", "plain"]), 0.4, 1.2)
    return Model((Box(vec(0, h), vec(w, h, d), printed(hand, base), printed(hand, base), base, hand.one_of([MATT, SATIN]), bevel=0.02),))


def gift(hand: Hand) -> Model:
    h, d, ribbon = hand.between(0.2, 0.5), hand.between(0.3, 0.5), plain(hand.bright())
    base = textured(hand, hand.colour(), hand.one_of(["dots", "stripes", "floral", "plain"]), 0.6, 1.2)
    cross: Paint = over(base, lambda s: (np.minimum(np.abs(s.u), np.abs(s.v)) < 0.1).astype(np.float32), ribbon)
    side = over(base, lambda s: (np.abs(s.u) < 0.1).astype(np.float32), ribbon)
    bows = [egg(vec(k * 0.13, 2 * h + 0.07), (0.15, 0.07, 0.09), ribbon, SATIN, about("z", k * 25)) for k in (-1, 1)]
    return Model((Box(vec(0, h), vec(0.5, h, d), side, side, cross, SATIN), *bows))


def paper_bag(hand: Hand) -> Model:
    base = printed(hand, textured(hand, hand.one_of([hand.wood(), hand.colour()]), "plain", 0.2))
    grip = curve([(-0.15, 0.95, 0.2), (-0.15, 1.25, 0.2), (0.15, 1.25, 0.2), (0.15, 0.95, 0.2)], 20)
    return Model((Box(vec(0, 0.5), vec(0.36, 0.5, 0.2), base), Tube(grip, np.full(20, 0.014, np.float32), plain(hand.grey()))))


def notebook(hand: Hand) -> Model:
    """Flat: a pad, card, envelope, photo or folder, which one could pick up."""
    paint = printed(hand, finishable(hand, hand.colour()))
    outline = rounded(hand.between(0.6, 0.85), 1.0, 0.04)
    return Model((Slab(outline, hand.between(0.02, 0.08), paint, plain(hand.white()), hand.one_of([MATT, SATIN])),))


# Tools and gadgets ---------------------------------------------------------------------------------------


def _shaft(points: list[tuple[float, float]], paint: Paint, finish: Finish, smooth: int = 0) -> Lathe:
    return Lathe(profile(points, smooth), paint, finish)


def pencil(hand: Hand) -> Model:
    r, colour = hand.between(0.02, 0.035), hand.one_of([hand.bright(), hand.colour()])
    tip = hand.one_of([hand.grey(0.01, 0.03), colour])
    paint = over(plain(colour), band(0.9, 0.97), plain(vec(0.6, 0.4, 0.2)))
    paint = over(over(paint, band(0.97, 1.1), plain(tip)), band(0.06, 0.1), plain(vec(0.6, 0.6, 0.55)))
    paint = over(paint, band(-1, 0.06), plain(hand.one_of([colour, vec(0.7, 0.3, 0.3)])))
    return Model((_shaft([(0, 0), (r, 0), (r, 0.9), (r * 0.25, 0.99), (0, 1)], paint, SATIN),))


def pen(hand: Hand) -> Model:
    r, colour = hand.between(0.025, 0.05), hand.colour()
    cap = hand.between(0.5, 0.75)
    paint = over(over(plain(colour), band(cap, 2), plain(hand.colour())), band(-1, 0.08), plain(hand.grey()))
    clip = Box(vec(0, 0.82, r * 1.2), vec(0.01, 0.12, 0.008), plain(vec(0.6, 0.6, 0.6)), finish=STEEL)
    return Model((_shaft([(0, 0), (r * 0.3, 0), (r, 0.14), (r, 0.6), (r * 1.1, cap), (r * 1.1, 0.97), (r, 1), (0, 1)], paint, GLAZED), clip))


def screwdriver(hand: Hand) -> Model:
    colour, split = hand.bright(), hand.between(0.38, 0.5)
    grip = over(plain(colour), stripes(vec(1, 0), 30, 0.3), plain(hand.grey(0.01, 0.1)))
    handle = _shaft([(0, 0), (0.06, 0), (0.075, 0.05), (0.06, split * 0.6), (0.07, split * 0.9), (0.03, split), (0, split)], grip, SATIN, 1)
    return Model((handle, _shaft([(0, split), (0.017, split), (0.017, 0.94), (0.028, 0.96), (0.012, 1), (0, 1)], plain(vec(0.6, 0.6, 0.6)), STEEL)))


def brush(hand: Hand) -> Model:
    """Paint brush or toothbrush or hairbrush."""
    colour, grip = hand.one_of([hand.wood(), hand.colour()]), hand.between(0.02, 0.04)
    w = hand.between(0.03, 0.12)
    hair = textured(hand, hand.one_of([hand.wood() * 0.5, hand.white(), hand.colour()]).astype(np.float32), "wood", 0.5, 1)
    handle = loop([(-grip * 0.6, 0), (grip * 0.6, 0), (grip, 0.4), (w, 0.62), (-w, 0.62), (-grip, 0.4)], 1)
    return Model((
        Slab(handle, 0.045, finishable(hand, colour), finish=SATIN, puff=0.02),
        Box(vec(0, 0.69), vec(w * 1.03, 0.07, 0.03), plain(vec(0.6, 0.58, 0.5)), finish=STEEL),
        Slab(loop([(-w, 0.76), (w, 0.76), (w * hand.between(0.6, 1.1), 0.98), (0, 1), (-w * hand.between(0.6, 1.1), 0.98)]), 0.05, hair, puff=0.02),
    ))  # fmt: skip


def hammer(hand: Hand) -> Model:
    handle = over(textured(hand, hand.wood(), "wood", 0.3), band(0, hand.between(0, 0.5)), plain(hand.colour()))
    head, y = plain(hand.grey(0.05, 0.5)), 0.92
    parts: list[Part] = [Tube(curve([(0, 0, 0), (0, 0.5, 0), (0, 0.98, 0)]), np.linspace(0.04, 0.028, 20, dtype=np.float32), handle, SATIN)]
    parts.append(Lathe(profile([(0, 0), (0.065, 0), (0.065, 0.06), (0.045, 0.08), (0.045, 0.22), (0, 0.22)]), head, STEEL, None, vec(-0.2, y), vec(1, 0, 0)))
    claw = [(0.02, y - 0.05), (0.02, y + 0.05), (0.14, y + 0.05), (0.24, y - 0.08), (0.12, y - 0.01)]
    return Model((*parts, Slab(loop(claw, 1), 0.09, head, finish=STEEL, puff=0.02)))


def wrench(hand: Hand) -> Model:
    t = np.linspace(0.6, 2 * np.pi - 0.6, 16) + np.pi / 2
    jaw = [(float(0.12 * np.cos(a)), float(0.9 + 0.11 * np.sin(a))) for a in t]
    neck = [(0.035, 0.75), (0.04, 0.15), (-0.04, 0.15), (-0.035, 0.75)]
    left, right = [p for p in jaw if p[0] < 0], [p for p in jaw if p[0] >= 0]
    outline = [*left[::1], *[(-0.045, 0.93), (-0.045, 0.88), (0.045, 0.88), (0.045, 0.93)][:0], *right]
    del outline
    body = loop([*neck[:2], *neck[2:], (-0.1, 0.8), (-0.13, 0.9), (-0.07, 1.0), (-0.045, 0.9), (0.045, 0.9), (0.07, 1.0), (0.13, 0.9), (0.1, 0.8)])
    eye = Slab(circle(0, 0.1, 0.1, 24), 0.06, plain(vec(0.55, 0.55, 0.55)), holes=[circle(0, 0.1, 0.06, 12)], finish=STEEL, puff=0.02)
    return Model((Slab(body, 0.05, plain(vec(0.55, 0.55, 0.55)), finish=STEEL, puff=0.02), eye))


def _pair(hand: Hand, blade: list[tuple[float, float]], pivot: float, open_: float, grip: Paint, metal: Paint, rings: float) -> Model:
    """Two mirrored arms turned about a pivot: scissors, pliers, tongs."""
    parts: list[Part] = []
    thick = hand.between(0.02, 0.035)
    for side in (-1, 1):
        turn = about("z", side * open_)
        place = lambda p, turn=turn: vec(0, pivot) + turn @ (np.asarray(p, np.float32) - vec(0, pivot))  # type: ignore[misc]  # noqa: E731
        arm = loop([(side * x, y) for x, y in blade], 1)
        flat = np.stack([place((x, y, 0)) for x, y in arm])
        parts.append(Slab(flat[:, :2], 0.03, metal, finish=STEEL, centre=vec(0, 0, side * 0.012), puff=0.015))
        if rings > 0:
            t = np.linspace(0, 2 * np.pi, 30)
            eye = [place((-side * (rings * 0.75 + rings * np.cos(a)), 0.16 + 1.5 * rings * np.sin(a), 0)) for a in t]
            parts.append(Tube(np.stack(eye).astype(np.float32), np.full(30, thick, np.float32), grip, SATIN))
            bar = [place((0, pivot, 0)), place((-side * rings * 0.4, 0.16 + rings * 1.3, 0))]
            parts.append(Tube(np.stack(bar).astype(np.float32), np.full(2, thick * 0.9, np.float32), grip, SATIN))
        else:
            bow = [place(p) for p in curve([(0, pivot, 0), (-side * 0.1, pivot - 0.2, 0), (-side * 0.09, 0, 0)], 14)]
            parts.append(Tube(np.stack(bow).astype(np.float32), np.full(14, 0.035, np.float32), grip, SATIN))
    return Model((*parts, Lathe(profile([(0, 0), (0.03, 0), (0.03, 0.07), (0, 0.07)]), metal, STEEL, None, vec(0, pivot, -0.035), vec(0, 0, 1))))


def scissors(hand: Hand) -> Model:
    pivot = hand.between(0.4, 0.55)
    blade = [(-0.03, pivot - 0.08), (0.03, pivot - 0.06), (0.045, pivot + 0.1), (0.0, 1.0), (-0.02, pivot + 0.1)]
    return _pair(hand, blade, pivot, hand.between(1, 24), plain(hand.colour()), plain(vec(0.65, 0.65, 0.66)), hand.between(0.07, 0.1))


def pliers(hand: Hand) -> Model:
    pivot = hand.between(0.62, 0.7)
    blade = [(-0.06, pivot - 0.06), (0.05, pivot - 0.06), (0.07, pivot + 0.05), (0.03, 1.0), (0.0, 1.0)]
    return _pair(hand, blade, pivot, hand.between(1, 14), plain(hand.bright()), plain(hand.grey(0.05, 0.5)), 0)


def key(hand: Hand) -> Model:
    metal = plain(hand.one_of([vec(0.6, 0.6, 0.6), vec(0.65, 0.5, 0.2), vec(0.2, 0.15, 0.1)]))
    teeth = [(0.04, y + dy) if k % 2 else (0.04 + hand.between(0.02, 0.08), y + dy) for k, y in enumerate(np.linspace(0.05, 0.45, 7).tolist()) for dy in (0.0, 0.03)]
    shaft = loop([(-0.04, 0.65), (-0.04, 0.02), (0, 0), *teeth, (0.04, 0.65)])
    head = Slab(circle(0, 0.8, 0.2, 20), 0.04, metal, holes=[circle(0, 0.88, 0.05, 10)], finish=STEEL, puff=0.02)
    parts: list[Part] = [Slab(shaft, 0.035, metal, finish=STEEL, puff=0.01), head]
    if hand.chance(0.5):
        t = np.linspace(0, 6.28, 24)
        parts.append(Tube(np.column_stack([0.17 * np.cos(t), 1.0 + 0.17 * np.sin(t), 0 * t]).astype(np.float32), np.full(24, 0.015, np.float32), plain(vec(0.6, 0.6, 0.6)), STEEL))
    return Model(tuple(parts))


def phone(hand: Hand) -> Model:
    body = plain(hand.one_of([hand.grey(0.01, 0.05), hand.colour()]))
    w = hand.between(0.46, 0.54)
    screen = hand.one_of([plain(vec(0.01, 0.01, 0.015)), plain(vec(0.01, 0.01, 0.015)), finishable(hand, hand.bright())])
    face = over(body, patch(0, 0.5, w * 0.46, 0.44), screen)
    if hand.chance(0.4):
        icons = [patch(w * (x - 1.5) / 5, 0.2 + 0.13 * y, 0.03, 0.03) for x in range(4) for y in range(5)]
        face = over(face, anywhere(icons), plain(hand.colour()))
    if hand.chance(0.3):
        face = over(body, anywhere([disc(-w * 0.3, 0.88, 0.05), disc(-w * 0.3, 0.74, 0.05)]), plain(vec(0.01, 0.01, 0.02)))
    return Model((Slab(rounded(w, 1.0, 0.07) + vec(0, 0.5)[:2], 0.06, face, body, GLAZED, puff=0.015),))


def remote(hand: Hand) -> Model:
    body, w = plain(hand.grey(0.01, 0.5)), hand.between(0.22, 0.34)
    spots = [disc(w * (x - 1) / 4, 0.15 + 0.09 * y, 0.025) for x in range(3) for y in range(8) if hand.chance(0.85)]
    face = over(over(body, anywhere(spots), plain(hand.grey(0.2, 0.8))), disc(w * 0.2, 0.92, 0.03), plain(vec(0.6, 0.02, 0.02)))
    return Model((Slab(rounded(w, 1.0, 0.06) + vec(0, 0.5)[:2], 0.1, face, finish=SATIN, puff=0.03),))


def spectacles(hand: Hand) -> Model:
    frame, finish = plain(hand.one_of([hand.grey(0.01, 0.05), hand.wood() * 0.3, hand.colour()]).astype(np.float32)), GLAZED
    t, thick = np.linspace(0, 2 * np.pi, 40), np.full(40, hand.between(0.015, 0.035), np.float32)
    tall = hand.between(0.15, 0.22)
    parts: list[Part] = []
    for side in (-1, 1):
        x = np.sign(np.cos(t)) * np.abs(np.cos(t)) ** 0.7 * 0.22
        parts.append(Tube(np.column_stack([side * 0.28 + x, tall + tall * np.sin(t), 0 * t]).astype(np.float32), thick, frame, finish))
        parts.append(Tube(curve([(side * 0.5, tall * 1.4, 0), (side * 0.52, tall * 1.4, -0.5), (side * 0.48, tall * 0.7, -0.8)]), np.full(20, 0.02, np.float32), frame, finish))
        if hand.chance(0.8):
            parts.append(Slab(circle(side * 0.28, tall, 0.21, 24, tall / 0.21), 0.005, plain(vec(0.5, 0.5, 0.5)), finish=Finish(0.8, 150, 0.05, hand.between(0.3, 0.9))))
    return Model((*parts, Tube(curve([(-0.07, tall * 1.3, 0), (0, tall * 1.5, 0), (0.07, tall * 1.3, 0)], 8), np.full(8, 0.02, np.float32), frame, finish)))


def clock(hand: Hand) -> Model:
    """A table clock or an alarm clock: a dial with hands, on feet."""
    case, dial = plain(hand.colour()), plain(hand.one_of([hand.white(), hand.grey(0.01, 0.05)]))
    dark = plain(hand.one_of([vec(0.02, 0.02, 0.02), vec(0.6, 0.05, 0.05)]))
    marks = [disc(0.33 * float(np.sin(a)), 0.5 + 0.33 * float(np.cos(a)), 0.02) for a in np.linspace(0, 6.28, 12, endpoint=False)]
    face = over(over(case, disc(0, 0.5, 0.4), dial), anywhere(marks), dark)
    hour, minute = hand.between(0, 6.28), hand.between(0, 6.28)
    for turn, long, wide in ((hour, 0.2, 0.02), (minute, 0.3, 0.013)):
        along, off = np.array([np.sin(turn), np.cos(turn)], np.float32), np.array([np.cos(turn), -np.sin(turn)], np.float32)
        line = lambda s, a=along, o=off, n=long, w=wide: ((np.abs(s.u * o[0] + (s.v - 0.5) * o[1]) < w) & (np.abs((s.u * a[0] + (s.v - 0.5) * a[1]) - n / 2) < n / 2)).astype(np.float32)  # type: ignore[misc]  # noqa: E731
        face = over(face, line, dark)
    outline = circle(0, 0.5, 0.47, 32) if hand.chance(0.7) else rounded(0.94, 0.94, 0.1) + vec(0, 0.5)[:2]
    feet = [ball(vec(s * 0.3, 0.08), 0.07, case, GLAZED) for s in (-1, 1)]
    bells = [ball(vec(s * 0.25, 0.98), 0.13, plain(vec(0.6, 0.5, 0.3)), STEEL) for s in (-1, 1)] if hand.chance(0.4) else []
    return Model((Slab(outline, hand.between(0.15, 0.35), face, case, GLAZED, puff=0.03), *feet, *bells))


def shoe(hand: Hand) -> Model:
    upper, sole = finishable(hand, hand.colour()), plain(hand.one_of([hand.white(), hand.grey()]))
    w, ankle = hand.between(0.17, 0.21), hand.between(0.25, 0.5)
    foot = loop([(-0.5, 0), (0.4, 0), (0.52, 0.05), (0.4, 0.06), (-0.5, 0.06)], 1)
    parts: list[Part] = [
        Slab(foot, 2 * w, sole, finish=SATIN, puff=0.02), egg(vec(0.18, 0.12), (0.33, 0.13, w), upper, SATIN),
        egg(vec(-0.22, 0.15), (0.27, 0.16, w * 0.95), upper, SATIN), Lathe(profile([(0.2, 0.1), (0.18, ankle), (0.16, ankle), (0.14, 0.2), (0, 0.18)]), upper, SATIN, plain(vec(0.05, 0.04, 0.04)), vec(-0.27, 0)),
    ]  # fmt: skip
    lace = plain(hand.one_of([hand.white(), hand.colour()]))
    for k in range(hand.whole(0, 4)):
        x, y = -0.02 + 0.08 * k, 0.3 - 0.03 * k
        parts.append(Tube(curve([(x, y - 0.06, -0.1), (x, y, 0), (x, y - 0.06, 0.1)], 8), np.full(8, 0.017, np.float32), lace))
    return Model(tuple(parts))


def camera(hand: Hand) -> Model:
    dark, grip = plain(hand.grey(0.01, 0.06)), textured(hand, hand.one_of([hand.grey(0.02, 0.1), hand.wood() * 0.4]).astype(np.float32), "carpet", 0.5, 2)
    body = over(grip, band(0.5, 1.1), plain(hand.grey(0.03, 0.6)))
    lens = Lathe(profile([(0, 0), (0.22, 0), (0.22, 0.25), (0.18, 0.26), (0.15, 0.2), (0, 0.18)]), over(dark, band(0.4, 0.6), plain(hand.grey())), GLAZED, plain(vec(0.03, 0.02, 0.06)), vec(hand.between(-0.1, 0.1), 0.32, 0.15), vec(0, 0, 1))
    return Model((Box(vec(0, 0.32), vec(0.5, 0.32, 0.16), body, finish=SATIN), lens, Box(vec(0.02, 0.68), vec(0.14, 0.07, 0.1), dark, finish=SATIN), Lathe(profile([(0, 0), (0.06, 0), (0.06, 0.05), (0, 0.05)]), dark, STEEL, None, vec(0.35, 0.64))))


def headphones(hand: Hand) -> Model:
    dark, t = plain(hand.colour()), np.linspace(0, np.pi, 30)
    bow = np.column_stack([0.4 * np.cos(t), 0.35 + 0.5 * np.sin(t), 0 * t]).astype(np.float32)
    shells = [egg(vec(s * 0.4, 0.3), (0.1, 0.2, 0.17), plain(hand.colour()), SATIN) for s in (-1, 1)]
    return Model((Tube(bow, np.full(30, 0.035, np.float32), dark, SATIN), *shells))


def bulb(hand: Hand) -> Model:
    paint = over(plain(vec(0.85, 0.83, 0.75)), band(-1, 0.3), plain(vec(0.5, 0.5, 0.5)))
    return Model((_shaft([(0, 0), (0.13, 0.02), (0.16, 0.3), (0.32, 0.65), (0.28, 0.88), (0.12, 0.99), (0, 1)], paint, GLAZED, 2),))


def cushion(hand: Hand) -> Model:
    base = textured(hand, hand.colour(), hand.one_of(["weave", "tartan", "floral", "stripes", "carpet"]), 0.5, 1)
    return Model((Slab(loop([(-0.5, 0), (0.5, 0), (0.47, 0.48), (0.5, 0.95), (-0.5, 0.95), (-0.47, 0.48)], 1), 0.22, base, puff=0.25),))


# Nature --------------------------------------------------------------------------------------------------


def apple(hand: Hand) -> Model:
    colour = hand.one_of([vec(0.55, 0.02, 0.02), vec(0.35, 0.45, 0.05), vec(0.75, 0.5, 0.06), vec(0.5, 0.1, 0.04)])
    skin = textured(hand, colour, hand.one_of(["blotches", "grain", "plain"]), hand.between(0.1, 0.6), 0.7)
    body = Lathe(profile([(0, 0.05), (0.15, 0), (0.38, 0.2), (0.5, 0.55), (0.35, 0.88), (0.12, 0.9), (0.0, 0.8)], 3), skin, Finish(0.3, 30))
    stem = Tube(curve([(0, 0.78, 0), (0.01, 0.95, 0), (hand.between(-0.1, 0.1), 1.05, 0)], 8), np.full(8, 0.02, np.float32), plain(vec(0.12, 0.07, 0.03)))
    leaf = [egg(vec(0.14, 1.0), (0.13, 0.02, 0.06), plain(hand.green()), SATIN, about("z", 25))] if hand.chance(0.3) else []
    return Model((body, stem, *leaf))


def pear(hand: Hand) -> Model:
    skin = textured(hand, hand.one_of([vec(0.5, 0.5, 0.08), vec(0.55, 0.4, 0.1), vec(0.4, 0.2, 0.08)]), "stone", 0.25, 1)
    body = Lathe(profile([(0, 0), (0.25, 0.0), (0.4, 0.3), (0.3, 0.6), (0.16, 0.75), (0.12, 0.92), (0, 0.95)], 3), skin, SATIN)
    return Model((body, Tube(curve([(0, 0.9, 0), (0.02, 1.0, 0), (0.07, 1.1, 0)], 6), np.full(6, 0.02, np.float32), plain(vec(0.1, 0.06, 0.03)))))


def citrus(hand: Hand) -> Model:
    skin = textured(hand, hand.one_of([vec(0.85, 0.3, 0.01), vec(0.85, 0.65, 0.03), vec(0.35, 0.5, 0.04), vec(0.7, 0.1, 0.03)]), "carpet", 0.15, 1.5)
    if hand.chance(0.5):
        return Model((Lathe(profile([(0, 0), (0.08, 0.03), (0.33, 0.3), (0.34, 0.65), (0.1, 0.95), (0, 1)], 3), skin, SATIN),))
    spot = over(skin, caps(np.stack([vec(0, 1)]), 0.985, vec(0, 0.46)), plain(vec(0.15, 0.25, 0.05)))
    return Model((egg(vec(0, 0.46), (0.5, 0.46, 0.5), spot, SATIN),))


def banana(hand: Hand) -> Model:
    skin = textured(hand, hand.one_of([vec(0.85, 0.62, 0.05), vec(0.6, 0.55, 0.08)]), "blotches", 0.15, 0.7)
    skin = over(skin, lambda s: ((s.v < 0.04) | (s.v > 0.95)).astype(np.float32), plain(vec(0.08, 0.05, 0.02)))
    parts: list[Part] = []
    for k in range(hand.one_of([1, 1, 2, 3])):
        line = curve([(-0.5, 0.32, 0), (-0.3, 0.05 + 0.02 * k, 0.12 * k), (0.2, 0.05, 0.16 * k), (0.5, 0.3, 0.2 * k)], 24)
        thick = 0.1 * np.sin(np.linspace(0.25, np.pi - 0.15, 24)) ** 0.5
        parts.append(Tube(line, thick.astype(np.float32), skin, SATIN))
    return Model(tuple(parts))


def carrot(hand: Hand) -> Model:
    skin = over(plain(vec(0.8, 0.22, 0.02)), stripes(vec(0, 1), 9, 0.1), plain(vec(0.5, 0.12, 0.01)))
    leaves = [Tube(curve([(0, 0.68, 0), (hand.between(-0.1, 0.1), 0.85, hand.between(-0.1, 0.1)), (hand.between(-0.2, 0.2), 1.05, hand.between(-0.2, 0.2))], 8), np.full(8, 0.02, np.float32), plain(hand.green())) for _ in range(5)]
    return Model((_shaft([(0, 0), (0.03, 0.1), (0.1, 0.6), (0.08, 0.7), (0, 0.71)], skin, SATIN, 1), *leaves))


def tomato(hand: Hand) -> Model:
    colour = hand.one_of([vec(0.65, 0.04, 0.02), vec(0.7, 0.25, 0.02), vec(0.25, 0.02, 0.15)])
    calyx = [egg(vec(0.12 * np.cos(a), 0.8, 0.12 * np.sin(a)), (0.14, 0.02, 0.04), plain(vec(0.08, 0.2, 0.04)), MATT, about("y", -float(np.degrees(a)))) for a in np.linspace(0, 6.28, 5, endpoint=False).tolist()]
    return Model((egg(vec(0, 0.4), (0.5, 0.4, 0.5), plain(colour), GLAZED), *calyx))


def grapes(hand: Hand) -> Model:
    colour, parts = hand.one_of([vec(0.15, 0.02, 0.12), vec(0.4, 0.5, 0.12)]), []
    for k in range(26):
        x, z = hand.between(-0.5, 0.5), hand.between(-0.25, 0.25)
        parts.append(ball(vec(x * (1 - 0.4 * (k % 3) / 2), 0.11 + 0.13 * (k % 3), z * (1 - 0.5 * (k % 3) / 2)), 0.11, plain(shade(colour, hand.between(0.7, 1.3))), Finish(0.4, 40)))
    return Model((*parts, Tube(curve([(0.3, 0.35, 0), (0.5, 0.45, 0), (0.62, 0.42, 0)], 8), np.full(8, 0.025, np.float32), plain(vec(0.15, 0.12, 0.04)))))


def egg_of_hen(hand: Hand) -> Model:
    return Model((_shaft([(0, 0), (0.22, 0.04), (0.36, 0.4), (0.22, 0.85), (0, 1)], finishable(hand, hand.one_of([hand.white(), vec(0.6, 0.35, 0.2)])), SATIN, 3),))


def mushroom(hand: Hand) -> Model:
    cap = over(plain(hand.one_of([vec(0.6, 0.02, 0.02), hand.wood(), hand.white()])), caps(np.stack([hand.direction() for _ in range(10)]), 0.97, vec(0, 0.5)), plain(hand.white()))
    return Model((_shaft([(0, 0), (0.16, 0), (0.12, 0.3), (0.13, 0.6), (0, 0.6)], plain(hand.white()), MATT, 1), _shaft([(0.1, 0.5), (0.45, 0.5), (0.4, 0.72), (0.2, 0.92), (0, 0.95)], cap, SATIN, 1)))


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
    return Ellipsoid((base + along).astype(np.float32), np.column_stack([along, side, thin]).astype(np.float32), paint, SATIN)


def potted_plant(hand: Hand) -> Model:
    tall = hand.between(0.2, 0.45)
    r = hand.between(0.15, 0.26)
    pot = hand.one_of([vec(0.45, 0.17, 0.08), hand.white(), hand.colour()])
    body = [(0, 0), (r * 0.75, 0), (r, tall * 0.8), (r * 1.12, tall * 0.8), (r * 1.12, tall), (r, tall - 0.002), (r * 0.9, tall - 0.04), (0, tall - 0.04)]
    parts: list[Part] = [Lathe(profile(body), finishable(hand, pot), hand.one_of([MATT, MATT, GLAZED]), plain(vec(0.04, 0.025, 0.015)))]
    green, what = hand.green(), hand.one_of(["leaves", "blades", "cactus", "bush", "flowers"])
    if what == "cactus":
        prick = over(plain(green), stripes(vec(1, 0), 14, 0.25), plain(shade(green, 1.7)))
        parts.append(Lathe(profile([(r * 0.4, tall - 0.04), (r * 0.6, tall + 0.2), (r * 0.55, 0.9), (0, 1)], 2), prick))
        return Model(tuple(parts))
    for _ in range(hand.whole(9, 24)):
        turn, rise = hand.between(0, 6.28), hand.between(0.15, 1.0)
        out = hand.between(0.1, 0.4)
        tip = vec(out * np.cos(turn), tall + rise * (1 - tall), out * np.sin(turn))
        paint = plain(shade(green, hand.between(0.6, 1.4)))
        if what == "bush":
            parts.append(ball(vec(tip[0] * 0.8, tip[1] * 0.9, tip[2] * 0.8), hand.between(0.05, 0.1), textured(hand, green, "stone", 0.7, 3)))
        else:
            base = vec(0, tall - 0.03) if what == "blades" else vec(tip[0] * 0.4, tall + rise * (1 - tall) * 0.6, tip[2] * 0.4)
            parts.append(_leaf(base, tip, 0.025 if what == "blades" else hand.between(0.05, 0.1), paint))
            if what != "blades":
                parts.append(Tube(np.stack([vec(0, tall - 0.04), base]), np.full(2, 0.01, np.float32), paint))
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
        axes = np.column_stack([out * size, side * size * 0.5, np.cross(out, side) * size * 0.12])
        parts.append(Ellipsoid((at + out * size * 1.1).astype(np.float32), axes.astype(np.float32), petal))
    parts.append(ball(at + face @ vec(0, 0, 0.1 * size), size * 0.5, plain(hand.one_of([vec(0.7, 0.5, 0.03), vec(0.1, 0.05, 0.02)]))))
    return list(parts)


def flower(hand: Hand) -> Model:
    bend = hand.between(-0.2, 0.2)
    stem = curve([(0, 0, 0), (bend * 0.3, 0.5, 0), (bend, 0.85, 0)], 16)
    green = plain(hand.green())
    leaves = [_leaf(stem[6], stem[6] + vec(s * 0.2, 0.15, hand.between(-0.1, 0.1)), 0.04, green) for s in (-1, 1)]
    return Model((Tube(stem, np.full(16, 0.016, np.float32), green), *leaves, *_blossom(hand, stem[-1], hand.between(0.09, 0.15), hand.bright())))


def leaf(hand: Hand) -> Model:
    colour = hand.one_of([hand.green(), hand.wood(), vec(0.5, 0.1, 0.03)])
    outline = loop([(0, 0), (hand.between(0.15, 0.4), 0.35), (hand.between(0.1, 0.3), 0.7), (0, 1), (-hand.between(0.1, 0.3), 0.7), (-hand.between(0.15, 0.4), 0.35)], 2)
    vein = over(textured(hand, colour, "grain", 0.3), lambda s: (np.abs(s.u) < 0.012).astype(np.float32), plain(shade(colour, 1.5)))
    return Model((Slab(outline, 0.015, vein, puff=0.05), Tube(curve([(0, 0.05, 0), (0, -0.1, 0), (0.05, -0.2, 0)], 6), np.full(6, 0.015, np.float32), plain(shade(colour, 0.6)))))


def basket(hand: Hand) -> Model:
    weave = textured(hand, hand.wood(), "weave", 0.6, 2)
    h = hand.between(0.25, 0.5)
    body = Lathe(profile([(0, 0), (0.35, 0), (0.48, h), (0.5, h + 0.03), (0.45, h), (0.34, 0.05), (0, 0.05)]), weave, MATT, weave)
    if hand.chance(0.5):
        return Model((body,))
    t = np.linspace(0, np.pi, 24)
    return Model((body, Tube(np.column_stack([0.46 * np.cos(t), h + 0.45 * np.sin(t), 0 * t]).astype(np.float32), np.full(24, 0.03, np.float32), weave)))


KINDS = [
    Kind("book", book, 22, ("stand", "side", "side")), Kind("carton", carton, 28), Kind("gift", gift, 20), Kind("paper_bag", paper_bag, 25),
    Kind("notebook", notebook, 18, ("flat", "lean")), Kind("pencil", pencil, 17, ("flat", "lean")), Kind("pen", pen, 14, ("flat", "lean")),
    Kind("screwdriver", screwdriver, 20, ("flat", "lean")), Kind("brush", brush, 20, ("flat", "lean")), Kind("hammer", hammer, 30, ("flat", "lean")),
    Kind("wrench", wrench, 20, ("flat", "lean")), Kind("scissors", scissors, 18, ("flat",)), Kind("pliers", pliers, 18, ("flat", "lean")),
    Kind("key", key, 6, ("flat",)), Kind("phone", phone, 14, ("flat", "lean")), Kind("remote", remote, 17, ("flat",)),
    Kind("spectacles", spectacles, 15), Kind("clock", clock, 13), Kind("shoe", shoe, 26), Kind("camera", camera, 12), Kind("headphones", headphones, 19, ("stand", "flat")),
    Kind("bulb", bulb, 10, ("lie",)), Kind("cushion", cushion, 40, ("stand", "flat")), Kind("apple", apple, 8), Kind("pear", pear, 9), Kind("citrus", citrus, 8, ("lie", "stand")),
    Kind("banana", banana, 18), Kind("carrot", carrot, 18, ("flat",)), Kind("tomato", tomato, 7), Kind("grapes", grapes, 14), Kind("egg", egg_of_hen, 6, ("lie", "stand")),
    Kind("mushroom", mushroom, 7), Kind("bread", bread, 26), Kind("potted_plant", potted_plant, 28), Kind("flower", flower, 25, ("flat", "lean")),
    Kind("leaf", leaf, 9, ("flat",)), Kind("basket", basket, 28),
]  # fmt: skip
