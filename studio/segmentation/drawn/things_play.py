"""Things to play with: balls, blocks, dominoes, coins, toy vehicles, animals, figures, boxes and books in another file."""

from __future__ import annotations

import numpy as np

from .build import GLAZED, MATT, SATIN, STEEL, Kind, Model, about, any_finish, ball, circle, curve, egg, loop, profile, rounded, shade, vec
from .canvas import Finish
from .hand import Array, Hand
from .paint import anywhere, caps, disc, finishable, numeral, over, patch, plain, printed, ring, stamp, stripes, textured
from .parts import Box, Ellipsoid, Lathe, Paint, Part, Slab, Surface, Tube

POOL = [(0.8, 0.6, 0.02), (0.02, 0.05, 0.4), (0.6, 0.01, 0.01), (0.1, 0.02, 0.2), (0.8, 0.2, 0.02), (0.01, 0.2, 0.06), (0.25, 0.01, 0.02), (0.01, 0.01, 0.01)]
"""Reflectances of solid pool balls 1 to 8."""
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
    return sphere(hand, over(paint, _spot_text(str(number), side, axis, centre, 0.3), plain(np.full(3, 0.02, np.float32))), Finish(0.9, 200, 0.04))


def _spot_text(text: str, middle: Array, up: Array, centre: Array, size: float) -> "object":
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
    what = hand.one_of(["plain", "stripe", "spots", "sectors", "seams", "panels", "texture", "wool"], [4, 2, 1.5, 2, 1.5, 1.5, 2, 1])
    finish = any_finish(hand)
    if what == "stripe":
        base = over(base, lambda s: (np.abs((s.own - centre) @ axis) < 0.16).astype(np.float32), other)
    elif what == "spots":
        base = over(base, caps(np.stack([hand.direction() for _ in range(16)]), hand.between(0.92, 0.98), centre), other)
    elif what == "sectors":
        side = np.cross(axis, hand.direction())
        side = (side / np.linalg.norm(side)).astype(np.float32)
        third, count = np.cross(axis, side).astype(np.float32), hand.whole(2, 5)
        angle = lambda s: np.arctan2((s.own - centre) @ side, (s.own - centre) @ third)  # noqa: E731
        base = over(base, lambda s: (np.sin(angle(s) * count) > 0).astype(np.float32), other)
        base = over(base, caps(np.stack([axis, -axis]), 0.97, centre), plain(hand.colour()))
    elif what == "seams":
        b, dark = hand.direction(), plain(np.full(3, hand.one_of([0.02, 0.7]), np.float32))
        bend = lambda s: (s.own - centre) @ axis * 2 + hand_curve * ((s.own - centre) @ b * 2) ** 2 - hand_curve * 0.4  # noqa: E731
        hand_curve = hand.between(-1.2, 1.2)
        base = over(base, lambda s: (np.abs(bend(s)) < 0.05).astype(np.float32), dark)
        base = over(base, lambda s: (np.abs((s.own - centre) @ b) < 0.025).astype(np.float32), dark)
    elif what == "panels":
        golden = np.array([[0, 1, 1.618], [0, 1, -1.618], [1, 1.618, 0], [-1, 1.618, 0], [1.618, 0, 1], [-1.618, 0, 1]], np.float32)
        directions = np.concatenate([golden, -golden]) / np.linalg.norm(golden[0])
        turn = about("x", hand.between(0, 90)) @ about("y", hand.between(0, 90))
        base = over(plain(hand.white()), caps((directions @ turn.T).astype(np.float32), 0.94, centre), plain(hand.one_of([hand.grey(0.01, 0.05), hand.bright()])))
    elif what == "texture":
        base = textured(hand, colour, hand.one_of(["blotches", "marble", "stone", "wood", "carpet", "plain"]), hand.between(0.2, 0.7), hand.between(0.4, 1.5))
    elif what == "wool":
        for _ in range(5):
            base = over(base, stripes(hand.direction(), hand.between(9, 16), 0.25), plain(shade(colour, hand.between(0.5, 1.4))))
    return sphere(hand, base, finish)


def marble(hand: Hand) -> Model:
    return sphere(hand, textured(hand, hand.bright(), "marble", 0.7, 0.8), Finish(0.9, 180, 0.1, hand.between(0, 0.6)))


def coin(hand: Hand) -> Model:
    metal = hand.one_of([vec(0.75, 0.6, 0.25), vec(0.6, 0.3, 0.18), vec(0.65, 0.65, 0.63), vec(0.2, 0.15, 0.1)])
    relief = textured(hand, metal, hand.one_of(["blotches", "grain", "text"]), hand.between(0.2, 0.5), hand.between(1.2, 2.5))
    radial = lambda s: np.hypot(s.own[:, 0], s.own[:, 2])  # noqa: E731
    face = over(relief, lambda s: (radial(s) > 0.43).astype(np.float32), plain(metal))
    face = over(face, lambda s: (np.abs(radial(s) - hand_ring) < 0.012).astype(np.float32), plain(shade(metal, 0.5)))
    hand_ring = hand.between(0.36, 0.44)
    if hand.chance(0.2):
        face = over(face, lambda s: (radial(s) > 0.3).astype(np.float32), plain(vec(0.65, 0.65, 0.62)))
    h = hand.between(0.05, 0.1)
    return Model((Lathe(profile([(0, 0), (0.49, 0), (0.5, 0.01), (0.5, h - 0.01), (0.49, h), (0, h)]), face, Finish(0.45, 25, 0.45)),))


def block(hand: Hand) -> Model:
    """A toy block: cube, bar, arch, cylinder, wedge; painted or of plain wood, with a letter or not."""
    colour, finish = hand.one_of([hand.wood(), hand.bright(), hand.colour()]), any_finish(hand)
    base = textured(hand, colour, "wood", hand.between(0.1, 0.4), hand.between(0.5, 1.2)) if hand.chance(0.5) else plain(colour)
    shape = hand.one_of(["cube", "cube", "bar", "roof", "arch", "post"])
    if shape == "cube":
        face: Paint = base
        if hand.chance(0.4):
            frame, ink = plain(hand.colour()), plain(hand.colour())
            face = over(over(base, lambda s: (np.maximum(np.abs(s.u), np.abs(s.v)) > 0.8).astype(np.float32), frame), stamp(numeral(chr(hand.whole(65, 90))), 0, 0, 0.7, 0.7), ink)
        return Model((Box(vec(0, 0.5), vec(0.5, 0.5, 0.5), face, finish=finish, bevel=hand.between(0.02, 0.12)),))
    if shape == "bar":
        h, d = hand.between(0.12, 0.4), hand.between(0.12, 0.35)
        return Model((Box(vec(0, h / 2), vec(0.5, h / 2, d / 2), base, finish=finish),))
    if shape == "roof":
        return Model((Slab(loop([(-0.5, 0), (0.5, 0), (0, hand.between(0.4, 0.7))]), hand.between(0.3, 0.5), base, finish=finish),))
    if shape == "arch":
        t = np.linspace(0, np.pi, 14)
        inner = [(float(0.27 * np.cos(a)), float(0.3 * np.sin(a))) for a in t]
        return Model((Slab(loop([(0.5, 0), (0.5, 0.5), (-0.5, 0.5), (-0.5, 0), *inner[::-1]]), 0.3, base, finish=finish),))
    r = hand.between(0.15, 0.4)
    return Model((Lathe(profile([(0, 0), (r, 0), (r, 1), (0, 1)]), base, finish),))


PIPS = {1: [(0, 0)], 2: [(-1, 1), (1, -1)], 3: [(-1, 1), (0, 0), (1, -1)], 4: [(-1, 1), (1, 1), (-1, -1), (1, -1)], 5: [(-1, 1), (1, 1), (-1, -1), (1, -1), (0, 0)], 6: [(-1, 1), (-1, 0), (-1, -1), (1, 1), (1, 0), (1, -1)], 0: []}


def _pips(number: int, middle: float, spread_v: float, radius: float, stretch: float) -> list[object]:
    return [disc(0.5 * x, middle + spread_v * y, radius, stretch) for x, y in PIPS[number]]


def domino(hand: Hand) -> Model:
    colour = hand.one_of([hand.white(), hand.grey(0.01, 0.04), hand.wood(), hand.colour()], [3, 2, 2, 2])
    dark = colour.mean() < 0.2
    ink = plain(hand.white() if dark else hand.grey(0.01, 0.05) if hand.chance(0.8) else hand.bright())
    face: Paint = plain(colour)
    if hand.chance(0.75):
        pips = _pips(hand.whole(0, 6), 0.5, 0.28, 0.15, 2.0) + _pips(hand.whole(0, 6), -0.5, 0.28, 0.15, 2.0)
        face = over(face, anywhere([*pips, patch(0, 0, 0.8, 0.02)]), ink)  # type: ignore[list-item]
    return Model((Box(vec(0, 0.5), vec(0.25, 0.5, hand.between(0.06, 0.11)), face, plain(colour), plain(colour), any_finish(hand), bevel=0.08),))


def die(hand: Hand) -> Model:
    colour = hand.one_of([hand.white(), hand.bright()])
    faces = [over(plain(colour), anywhere(_pips(k, 0, 0.5, 0.17, 1.0)), plain(hand.grey(0.01, 0.04))) for k in (hand.whole(1, 6), hand.whole(1, 6), hand.whole(1, 6))]  # type: ignore[arg-type]
    return Model((Box(vec(0, 0.5), vec(0.5, 0.5, 0.5), faces[0], faces[1], faces[2], GLAZED, bevel=0.15),))


def puzzle_cube(hand: Hand) -> Model:
    colours = np.stack([vec(0.6, 0.02, 0.02), vec(0.8, 0.7, 0.03), vec(0.02, 0.1, 0.5), vec(0.02, 0.35, 0.08), vec(0.8, 0.25, 0.02), vec(0.8, 0.8, 0.8)])

    def face() -> Paint:
        grid = hand.rng.integers(0, 6, (3, 3))

        def paint(s: Surface) -> Array:
            x, y = (s.u * 1.4999 + 1.5).clip(0, 2.99), (s.v * 1.4999 + 1.5).clip(0, 2.99)
            seam = (np.abs(x % 1 - 0.5) > 0.44) | (np.abs(y % 1 - 0.5) > 0.44)
            return np.where(seam[:, None], np.float32(0.015), colours[grid[y.astype(int), x.astype(int)]])

        return paint

    return Model((Box(vec(0, 0.5), vec(0.5, 0.5, 0.5), face(), face(), face(), GLAZED, bevel=0.04),))


def _wheel(x: float, y: float, z: float, r: float, hub: Paint) -> Lathe:
    tyre = over(plain(np.full(3, 0.02, np.float32)), lambda s: (np.hypot(s.own[:, 0] - x, s.own[:, 1] - y) < 0.55 * r).astype(np.float32), hub)
    return Lathe(profile([(0, 0), (r * 0.9, 0), (r, 0.02), (r, 0.07), (r * 0.9, 0.09), (0, 0.09)]), tyre, SATIN, None, vec(x, y, z), vec(0, 0, 1))


def vehicle(hand: Hand) -> Model:
    """Car, van, truck or bus from the side: body, cabin, windows, wheels, lights."""
    body, roof = hand.bright() if hand.chance(0.7) else hand.colour(), hand.colour()
    finish, wide = hand.one_of([GLAZED, SATIN, MATT]), hand.between(0.34, 0.48)
    r, what = hand.between(0.09, 0.13), hand.one_of(["car", "car", "van", "truck", "bus"])
    dark, y = plain(hand.one_of([vec(0.02, 0.03, 0.05), vec(0.3, 0.4, 0.5), hand.colour()])), r * 0.7
    h = hand.between(0.16, 0.24)
    low = [(-0.5, y), (0.5, y), (0.5, y + h * 0.7), (0.44, y + h), (-0.48, y + h), (-0.5, y + h * 0.6)]
    top = y + h + hand.between(0.12, 0.2)
    if what == "car":
        a, b = hand.between(-0.42, -0.3), hand.between(0.12, 0.3)
        cabin = [(a, y + h - 0.01), (b + 0.1, y + h - 0.01), (b, top), (a + 0.1, top)]
    elif what == "truck":
        cabin = [(0.2, y + h - 0.01), (0.5, y + h - 0.01), (0.46, top + 0.08), (0.2, top + 0.08)]
    else:
        top += 0.1
        cabin = [(-0.5, y + h - 0.01), (0.5, y + h - 0.01), (0.44, top), (-0.48, top)]
    shell = plain(body)
    parts: list[Part] = [Slab(loop(low, 1), wide, over(shell, lambda s: (np.abs(s.v - y - h * 0.45) < 0.015).astype(np.float32), plain(shade(body, 0.5))), finish=finish, puff=0.03)]
    parts.append(Slab(loop(cabin, 1), wide * 0.9, plain(body if hand.chance(0.6) else roof), dark if what == "car" else None, finish, puff=0.03))
    left, right = cabin[0][0] + 0.08, cabin[1][0] - 0.1
    count = max(1, int((right - left) / 0.18))
    for k in range(count):
        x0 = left + (right - left) * k / count
        x1 = left + (right - left) * (k + 0.82) / count
        parts.append(Slab(loop([(x0, y + h + 0.015), (x1, y + h + 0.015), (x1 - 0.02, top - 0.03), (x0 + 0.02, top - 0.03)]), wide * 0.92, dark, finish=GLAZED))
    if what == "truck":
        load = hand.between(0.05, 0.35)
        parts.append(Box(vec(-0.16, y + h + load / 2), vec(0.33, load / 2, wide / 2), finishable(hand, hand.colour()), finish=finish))
    hub = plain(hand.one_of([vec(0.5, 0.5, 0.5), hand.bright(), vec(0.02, 0.02, 0.02)]))
    for x in (-0.3, hand.between(0.25, 0.33)):
        parts += [_wheel(x, r, wide / 2 - 0.05, r, hub), _wheel(x, r, -wide / 2 - 0.03, r, hub)]
    parts += [ball(vec(0.48, y + h * 0.6, z), 0.035, plain(vec(0.8, 0.75, 0.5)), GLAZED) for z in (-0.12, 0.12)]
    return Model(tuple(parts))


def animal(hand: Hand) -> Model:
    """A four-legged toy: pig, dog, cow, elephant, giraffe ..., plush or plastic."""
    colour, other = hand.one_of([hand.wood(), hand.colour(), hand.bright(), vec(0.8, 0.4, 0.4)]), hand.colour()
    coat: Paint = finishable(hand, colour)
    if hand.chance(0.35):
        coat = over(coat, caps(np.stack([hand.direction() for _ in range(9)]), 0.9, vec(0, 0.4)), plain(other))
    finish = hand.one_of([MATT, MATT, SATIN, GLAZED])
    long, fat, leg = hand.between(0.25, 0.4), hand.between(0.16, 0.27), hand.between(0.08, 0.35)
    y, neck = leg + fat * 0.8, hand.between(0.0, 0.35)
    head, hx, hy = hand.between(0.12, 0.2), long * 0.9, leg + fat * 0.8 + neck + fat * 0.4
    parts: list[Part] = [egg(vec(0, y), (long, fat, fat * 0.9), coat, finish), ball(vec(hx, hy), head, coat, finish)]
    parts.append(Tube(curve([(long * 0.6, y, 0), (hx, hy, 0)], 8), np.full(8, head * 0.75, np.float32), coat, finish))
    feet = plain(other) if hand.chance(0.4) else coat
    for x in (-long * 0.65, long * 0.6):
        for z in (-fat * 0.5, fat * 0.5):
            parts.append(Tube(curve([(x, y, z), (x * 1.05, 0.05, z)], 6), np.full(6, hand.between(0.05, 0.08), np.float32), coat, finish))
            parts.append(egg(vec(x * 1.05 + 0.02, 0.04, z), (0.08, 0.045, 0.07), feet, finish))
    snout = hand.between(0.04, head)
    parts.append(egg(vec(hx + head * 0.7, hy - head * 0.25), (snout + 0.04, head * 0.5, head * 0.5), plain(other) if hand.chance(0.5) else coat, finish))
    ear = hand.one_of([(0.05, 0.1, 0.03), (0.09, 0.09, 0.03), (0.04, 0.2, 0.03), (0.16, 0.2, 0.03)])
    for z in (-1, 1):
        parts.append(egg(vec(hx - head * 0.2, hy + head * 0.9, z * head * 0.7), ear, coat, finish, about("x", z * 25)))
        parts.append(ball(vec(hx + head * 0.65, hy + head * 0.35, z * head * 0.55), 0.028, plain(np.full(3, 0.01, np.float32)), GLAZED))
    tail = curve([(-long * 0.9, y, 0), (-long - 0.1, y + 0.1, 0.02), (-long - 0.15, y + hand.between(-0.2, 0.3), 0)], 12)
    parts.append(Tube(tail, np.full(12, 0.025, np.float32), coat, finish))
    return Model(tuple(parts))


def figure(hand: Hand) -> Model:
    """A doll, bear or little man: head, trunk, limbs, eyes."""
    skin, cloth, legs = hand.one_of([hand.wood(), hand.colour(), vec(0.7, 0.45, 0.33)]), hand.colour(), hand.colour()
    finish = hand.one_of([MATT, MATT, SATIN, GLAZED])
    bear = hand.chance(0.4)
    trunk = finishable(hand, skin if bear else cloth)
    face, trousers = plain(skin), trunk if bear else plain(legs)
    r, fat, y = hand.between(0.13, 0.2), hand.between(0.12, 0.2), hand.between(0.25, 0.4)
    parts: list[Part] = [egg(vec(0, y + 0.15), (fat, 0.22, fat * 0.8), trunk, finish), ball(vec(0, y + 0.3 + r), r, face, finish)]
    for side in (-1, 1):
        swing = hand.between(-0.05, 0.25)
        arm = curve([(side * fat * 0.8, y + 0.26, 0), (side * (fat + 0.1), y + 0.15 + swing * 0.3, 0.05), (side * (fat + 0.12), y + swing, 0.1)], 10)
        parts.append(Tube(arm, np.full(10, 0.05, np.float32), trunk, finish))
        parts.append(ball(arm[-1], 0.055, face, finish))
        parts.append(Tube(curve([(side * 0.08, y + 0.05, 0), (side * 0.09, 0.05, hand.between(0, 0.1))], 8), np.full(8, 0.065, np.float32), trousers, finish))
        parts.append(egg(vec(side * 0.09, 0.035, 0.06), (0.06, 0.04, 0.1), plain(hand.grey()), finish))
        parts.append(ball(vec(side * r * 0.38, y + 0.33 + r, r * 0.9), 0.022, plain(np.full(3, 0.01, np.float32)), GLAZED))
        if bear:
            parts.append(ball(vec(side * r * 0.75, y + 0.3 + r * 1.8), r * 0.36, face, finish))
    if not bear:
        hat = plain(hand.colour())
        parts.append(egg(vec(0, y + 0.34 + r * 1.25, -0.02), (r * 1.06, r * 0.8, r * 1.06), hat, finish))
        if hand.chance(0.4):
            parts.append(Lathe(profile([(0, 0), (r * 1.5, 0), (r * 1.5, 0.02), (r * 0.8, 0.04), (r * 0.7, 0.2), (0, 0.2)]), hat, finish, None, vec(0, y + 0.3 + r * 1.5)))
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
    parts: list[Part] = [Lathe(profile([(0, 0), (0.4, 0), (0.4, 0.08), (0, 0.08)]), plain(hand.colour()), SATIN)]
    for k in range(count):
        r, h = 0.38 - 0.2 * k / count, 0.7 / count
        parts.append(egg(vec(0, y + h / 2), (r, h * 0.62, r), plain(hand.bright()), SATIN))
        y += h
    return Model((*parts, ball(vec(0, y + 0.06), 0.1, plain(hand.bright()), SATIN)))


def robot(hand: Hand) -> Model:
    metal, finish = hand.colour(), hand.one_of([SATIN, STEEL, GLAZED])
    face = over(plain(metal), anywhere([disc(-0.4, 0.2, 0.18), disc(0.4, 0.2, 0.18), patch(0, -0.5, 0.5, 0.1)]), plain(hand.colour()))
    chest = printed(hand, plain(metal))
    limb, dark = plain(hand.colour()), plain(hand.grey())
    parts: list[Part] = [Box(vec(0, 0.85), vec(0.15, 0.13, 0.13), face, finish=finish), Box(vec(0, 0.48), vec(0.22, 0.22, 0.14), chest, plain(metal), plain(metal), finish)]
    for side in (-1, 1):
        parts += [Box(vec(side * 0.29, 0.48), vec(0.05, 0.2, 0.06), limb, finish=finish), Box(vec(side * 0.11, 0.15), vec(0.08, 0.15, 0.09), limb, finish=finish), Box(vec(side * 0.11, 0.03, 0.04), vec(0.1, 0.03, 0.14), dark, finish=finish)]
    return Model((*parts, Tube(curve([(0, 0.97, 0), (0, 1.1, 0)], 4), np.full(4, 0.015, np.float32), dark), ball(vec(0, 1.1), 0.04, plain(hand.bright()))))


def spinning_top(hand: Hand) -> Model:
    base = plain(hand.colour())
    for _ in range(3):
        low = hand.between(0.1, 0.7)
        base = over(base, lambda s, low=low: ((s.v > low) & (s.v < low + 0.1)).astype(np.float32), plain(hand.bright()))  # type: ignore[misc]
    return Model((Lathe(profile([(0, 0), (0.03, 0.02), (0.4, 0.35), (0.4, 0.42), (0.05, 0.55), (0.04, 0.9), (0, 0.92)], 1), base, GLAZED),))


def chess_piece(hand: Hand) -> Model:
    colour = hand.one_of([hand.white(), hand.grey(0.01, 0.04), hand.wood()])
    body = [(0, 0), (0.24, 0), (0.24, 0.06), (0.17, 0.12), (0.1, 0.25), (0.08, 0.55), (0.16, 0.6), (0.08, 0.64)]
    head = [(0.17, 0.75), (0.14, 0.9), (0, 0.94)] if hand.chance(0.6) else [(0.12, 0.66), (0.16, 0.95), (0, 0.95)]
    return Model((Lathe(profile(body + head, 1), finishable(hand, colour), GLAZED),))


def stone(hand: Hand) -> Model:
    colour = hand.one_of([hand.grey(), hand.wood(), hand.muted()])
    paint = textured(hand, colour, hand.one_of(["stone", "grain", "marble"]), hand.between(0.2, 0.6), hand.between(0.6, 2))
    a, b, c = hand.between(0.3, 0.5), hand.between(0.15, 0.35), hand.between(0.25, 0.45)
    turn = about("y", hand.between(0, 180))
    bumps = [Ellipsoid(vec(hand.between(-0.12, 0.12), b * hand.between(0.8, 1.1), hand.between(-0.1, 0.1)), (turn @ np.diag([a * 0.8, b * 0.9, c * 0.85])).astype(np.float32), paint) for _ in range(2)]
    return Model((egg(vec(0, b), (a, b, c), paint, MATT, turn), *bumps))


def ring_toy(hand: Hand) -> Model:
    """A ring one looks through: tape, bangle, washer, rubber ring, doughnut."""
    t = np.linspace(0, 2 * np.pi, 60)
    r = hand.between(0.06, 0.2)
    line = np.column_stack([(0.5 - r) * np.cos(t), np.full(60, r), (0.5 - r) * np.sin(t)]).astype(np.float32)
    paint = finishable(hand, hand.colour())
    if hand.chance(0.4):
        paint = over(paint, stripes(hand.direction(), 6, 0.4), plain(hand.colour()))
    return Model((Tube(line, np.full(60, r, np.float32), paint, any_finish(hand)),))


def tape(hand: Hand) -> Model:
    r, h, colour = hand.between(0.25, 0.42), hand.between(0.15, 0.5), hand.colour()
    inner = plain(hand.wood())
    return Model((Lathe(profile([(0.45, 0), (0.5, 0.01), (0.5, h), (r + 0.03, h), (r, h - 0.003), (r, 0)]), plain(colour), any_finish(hand), inner),))


def button(hand: Hand) -> Model:
    holes = [circle(x, y, 0.06, 10) for x, y in ((-0.11, -0.11), (0.11, -0.11), (0.11, 0.11), (-0.11, 0.11))]
    base = over(finishable(hand, hand.colour()), ring(0, 0, 0.38, 0.03), plain(hand.colour()))
    return Model((Slab(circle(0, 0, 0.5, 32), 0.1, base, holes=holes, finish=GLAZED, puff=0.05),))


def star(hand: Hand) -> Model:
    """Biscuits, stars, hearts, clouds, letters cut of wood, dough or plastic."""
    count, deep = hand.whole(4, 9), hand.between(0.45, 0.85)
    t = np.arange(2 * count) * np.pi / count + hand.between(0, 1)
    r = np.where(np.arange(2 * count) % 2, 0.5 * deep, 0.5)
    outline = loop([(float(a * np.cos(b)), float(a * np.sin(b))) for a, b in zip(r, t, strict=True)], hand.whole(0, 2))
    paint = finishable(hand, hand.one_of([hand.wood(), hand.colour()]))
    if hand.chance(0.3):
        paint = over(paint, anywhere([disc(hand.between(-0.3, 0.3), hand.between(-0.3, 0.3), 0.06) for _ in range(6)]), plain(hand.colour()))
    return Model((Slab(outline, hand.between(0.06, 0.25), paint, finish=any_finish(hand), puff=hand.between(0.02, 0.12)),))


def letter(hand: Hand) -> Model:
    shape = hand.one_of([
        [(0, 0), (0.2, 0), (0.2, 0.8), (0.6, 0.8), (0.6, 1), (0, 1)], [(0, 0), (0.7, 0), (0.7, 0.2), (0.2, 0.2), (0.2, 1), (0, 1)],
        [(0.25, 0), (0.45, 0), (0.45, 0.8), (0.7, 0.8), (0.7, 1), (0, 1), (0, 0.8), (0.25, 0.8)],
        [(0, 0), (0.6, 0), (0.6, 0.2), (0.2, 0.2), (0.2, 0.4), (0.5, 0.4), (0.5, 0.6), (0.2, 0.6), (0.2, 0.8), (0.6, 0.8), (0.6, 1), (0, 1)],
    ])  # fmt: skip
    return Model((Slab(loop([(x - 0.3, y) for x, y in shape]), hand.between(0.12, 0.3), plain(hand.bright()), finish=any_finish(hand)),))


def plush(hand: Hand) -> Model:
    """A soft lump with eyes: monster, cushion toy, chick."""
    coat = textured(hand, hand.colour(), "carpet", 0.5, 1.2)
    w, h = hand.between(0.3, 0.5), hand.between(0.35, 0.5)
    eyes = [ball(vec(s * w * 0.35, h * 1.25, w * 0.75), hand.between(0.04, 0.09), plain(hand.one_of([vec(0.02, 0.02, 0.02), vec(0.85, 0.85, 0.85)])), GLAZED) for s in (-1, 1)]
    limbs = [egg(vec(s * w * 0.9, h * y, 0.05), (0.12, 0.16, 0.12), coat, MATT, about("z", s * 40)) for s in (-1, 1) for y in (0.35, 1.0)]
    return Model((egg(vec(0, h), (w, h, w * 0.8), coat), *eyes, *limbs, egg(vec(0, h * 0.8, w * 0.7), (0.12, 0.08, 0.08), plain(hand.colour()))))


KINDS = [
    Kind("billiard_ball", billiard_ball, 6), Kind("toy_ball", toy_ball, 12), Kind("marble", marble, 3), Kind("coin", coin, 3),
    Kind("block", block, 5, ("stand", "stand", "lie")), Kind("domino", domino, 5, ("stand", "flat")), Kind("die", die, 3), Kind("puzzle_cube", puzzle_cube, 6),
    Kind("vehicle", vehicle, 14), Kind("animal", animal, 15), Kind("figure", figure, 15, ("stand", "stand", "flat")), Kind("duck", duck, 9),
    Kind("stacking_rings", stacking_rings, 18), Kind("robot", robot, 16), Kind("spinning_top", spinning_top, 7, ("lie",)),
    Kind("chess_piece", chess_piece, 8, ("stand", "stand", "lie")), Kind("stone", stone, 8), Kind("ring_toy", ring_toy, 9), Kind("tape", tape, 9),
    Kind("button", button, 3, ("flat",)), Kind("star", star, 8, ("flat", "lean")), Kind("letter", letter, 7, ("stand", "flat")), Kind("plush", plush, 20),
]  # fmt: skip
_ = rounded, STEEL
