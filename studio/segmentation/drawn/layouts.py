"""How things lie about: alone, few, many, racked, stacked, on shelves, heaped, in each other, leaning; or nothing at all."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from .build import MATT, about, vec
from .canvas import Pose
from .kinds import FLAT, HOLDERS, KINDS, LOOSE, NAMES, RACKED, STACKED, TALL
from .paint import plain, textured
from .parts import Box, Lathe, Paint, Part
from .placer import Placer
from .scene import Item


def alone(p: Placer) -> None:
    """One large thing, or two; at times cut by the photo's border."""
    size, hand = p.room.size, p.hand
    for _ in range(hand.one_of([1, 1, 2])):
        kind = p.kind(p.room.tilt < 0.3)
        px = size * hand.between(0.4, 0.95)
        x, y = size * hand.between(0.25, 0.75), size * hand.between(0.6, 0.95)
        if p.room.tilt > 1.1:
            y = size * hand.between(0.3, 0.7)
        if hand.chance(0.25):
            x = size * hand.one_of(
                [hand.between(-0.05, 0.15), hand.between(0.85, 1.05)]
            )
        p.put(kind, x, max(y, p.room.horizon + 6), px, yaw=_facing(p))


def _facing(p: Placer) -> float | None:
    """Most things show their front when seen from the side."""
    return p.hand.between(-55, 55) if p.room.tilt < 0.8 and p.hand.chance(0.7) else None


def scattered(p: Placer) -> None:
    """Few or many things, all sorts or a few sorts."""
    hand, size = p.hand, p.room.size
    count = hand.one_of(
        [hand.whole(2, 5), hand.whole(5, 12), hand.whole(12, 34)], [4, 4, 1.5]
    )
    kinds = [p.kind(p.room.tilt < 0.3) for _ in range(hand.one_of([1, 2, 4, 40]))]
    largest = size * hand.between(0.8, 1.3) / np.sqrt(count + 1)
    px_per_cm = largest / hand.between(14, 24)
    if len(kinds) <= 2:
        px_per_cm = largest / kinds[0].cm
    for _ in range(count):
        kind = hand.one_of(kinds)
        for _ in range(4):
            x, y = p.anywhere()
            if p.put(
                kind,
                x,
                y,
                p.length(kind, px_per_cm, largest * 1.5) * p.nearness(y),
                yaw=_facing(p),
                clear=hand.between(0.75, 1),
            ):
                break


def racked(p: Placer) -> None:
    """A grid, row or triangle of touching things of one kind."""
    hand, size = p.hand, p.room.size
    kind = KINDS[hand.one_of(RACKED)]
    rows, columns = hand.whole(1, 5), hand.whole(2, 6)
    triangle = hand.chance(0.4)
    if triangle:
        rows = columns = hand.whole(3, 5)
    gap = hand.one_of([1.0, 1.0, hand.between(1, 1.6)])
    px = size * hand.between(0.5, 1.0) / max(rows * 0.8, columns) / gap
    turn, yaw = (
        hand.one_of([0.0, hand.between(0, 90)]) if p.room.tilt > 0.3 else 0.0,
        hand.one_of([0.0, hand.between(-30, 30)]),
    )
    pose, shared = (
        hand.one_of(kind.poses),
        kind.make(hand) if hand.chance(0.3) else None,
    )
    x0, y0 = (
        size * hand.between(0.35, 0.65),
        max(size * hand.between(0.4, 0.8), p.room.horizon + 8),
    )
    s, hexed = float(np.sin(p.room.tilt)), hand.chance(0.6)
    width: float | None = None
    c, d = np.cos(np.radians(turn)), np.sin(np.radians(turn))
    for i in range(rows):
        for j in range(i + 1 if triangle else columns):
            step = px * gap if width is None else 2 * width * gap
            u = (
                j - i / 2 if triangle else j - (columns - 1) / 2 + 0.5 * (i % 2) * hexed
            ) * step
            v = (i - (rows - 1) / 2) * step * (0.866 if triangle or hexed else 1)
            if hand.chance(0.04):
                continue
            put = p.put(
                kind,
                x0 + u * c - v * d,
                y0 + (u * d + v * c) * s,
                px,
                pose=pose,
                yaw=yaw + turn,
                clear=None,
                model=shared,
            )
            width = width or (put[1] if put else None)


def stacked(p: Placer) -> None:
    """Towers and pyramids; books, boxes, blocks, plates, coins."""
    hand, size = p.hand, p.room.size
    for _ in range(hand.whole(1, 3)):
        name = hand.one_of(STACKED)
        kind, mixed = KINDS[name], hand.chance(0.25)
        pose = {
            "book": "side",
            "domino": hand.one_of(["lie", "flat"]),
            "notebook": "flat",
        }.get(name, "stand")
        px = size * hand.between(0.12, 0.42)
        x, y = (
            size * hand.between(0.2, 0.8),
            max(size * hand.between(0.65, 0.98), p.room.horizon + 8),
        )
        width, yaw = 1, hand.between(-40, 40)
        if name in (
            "block",
            "carton",
            "die",
            "can",
            "mug",
            "gift",
            "domino",
            "puzzle_cube",
        ):
            width = hand.one_of([1, 1, 2, 3, 4])
            px = min(px, size * 0.8 / width)
            yaw = yaw if width == 1 else 0.0
        height, straight = 0.0, hand.between(0, 12)
        for level in range(width if width > 1 else hand.whole(2, 9)):
            rise, step = 0.0, px
            for k in range(width - level if width > 1 else 1):
                chosen = KINDS[hand.one_of(STACKED)] if mixed and width == 1 else kind
                put = p.put(
                    chosen, x + (k - (width - level - 1) / 2) * step * 1.01 + hand.between(-0.04, 0.04) * px, y, px * (hand.between(0.8, 1.05) if width == 1 else 1),
                    pose={"book": "side", "notebook": "flat"}.get(chosen.name, pose if chosen is kind else "stand"), yaw=yaw + hand.between(-straight, straight), height=height, clear=None,
                )  # fmt: skip
                if put:
                    rise, step = max(rise, put[0]), max(2 * put[1], 4)
            height += rise
            if height > size * 0.75:
                break
    if hand.chance(0.5):
        few(p)


def few(p: Placer) -> None:
    """One to four more things beside what is there."""
    for _ in range(p.hand.whole(1, 4)):
        kind = p.kind(p.room.tilt < 0.3)
        x, y = p.anywhere()
        p.put(kind, x, y, p.room.size * p.hand.between(0.1, 0.32), yaw=_facing(p))


def shelved(p: Placer) -> None:
    """Rows on boards: books side by side, crockery, toys."""
    hand, size = p.hand, p.room.size
    wood = textured(
        hand,
        hand.one_of([hand.wood(), hand.white(), hand.colour()]),
        "wood",
        hand.between(0, 0.3),
    )
    camera, y = p.room.camera, hand.between(0.25, 0.45) * size
    gap = hand.between(0.26, 0.5) * size
    back = y / float(np.sin(p.room.tilt))
    while y < size * 1.1:
        thick, deep = hand.between(3, 12), hand.between(25, 60)
        rise = -(y - back * np.sin(p.room.tilt)) / np.cos(p.room.tilt)
        spot = camera @ np.array([size / 2, rise - thick / 2, back], np.float32)
        board = Box(vec(0, 0), vec(size, thick / 2, deep), wood, bevel=0)
        p.furniture([board], Pose(camera, spot.astype(np.float32), 1.0))
        _row(p, back, float(rise), gap * hand.between(0.5, 0.9))
        y += gap + thick
    if hand.chance(0.4):
        for x in (hand.between(-0.1, 0.1) * size, hand.between(0.85, 1.1) * size):
            spot = camera @ np.array([x, 0, back], np.float32)
            p.furniture(
                [Box(vec(0, 0), vec(4, 3 * size, 50), wood, bevel=0)],
                Pose(camera, spot.astype(np.float32), 1.0),
            )


def _row(p: Placer, back: float, rise: float, tall: float) -> None:
    hand, size = p.hand, p.room.size
    x, books = hand.between(-0.05, 0.3) * size, hand.chance(0.45)
    kinds = (
        [KINDS["book"]]
        if books
        else [p.kind(True) for _ in range(hand.one_of([1, 2, 20]))]
    )
    space = hand.one_of([0.0, hand.between(0, 12), hand.between(5, 50)])
    end = size * hand.between(0.5, 1.05)
    y = (back + hand.between(0, 12)) * float(np.sin(p.room.tilt))
    while x < end:
        kind = hand.one_of(kinds)
        px, before = tall * hand.between(0.65, 1), len(p.scene.items)
        lay = about("z", -hand.between(5, 20)) if books and hand.chance(0.08) else None
        put = p.put(
            kind,
            x,
            y,
            px,
            pose="stand" if books else None,
            yaw=hand.between(-4, 4) if books else _facing(p),
            height=rise,
            clear=None,
            lay=lay,
        )
        if put is None or len(p.scene.items) == before:  # nothing to move aside
            break
        half = put[1]
        item = p.scene.items[-1]
        moved = item.pose.at + np.array([half, 0, 0], np.float32)
        p.scene.items[-1] = Item(
            item.model, Pose(item.pose.turn, moved, item.pose.scale), name=item.name
        )
        x += 2 * half + space * hand.between(0.3, 1.2) + 0.5


def heaped(p: Placer) -> None:
    """A heap: things over things, of one sort or of all."""
    hand, size = p.hand, p.room.size
    flat = p.room.tilt > 0.7 and hand.chance(0.5)
    names = [
        hand.one_of(FLAT if flat else NAMES) for _ in range(hand.one_of([1, 3, 12]))
    ]
    count, spread = hand.whole(5, 22), size * hand.between(0.12, 0.35)
    px = size * hand.between(0.14, 0.4)
    x0, y0 = (
        size * hand.between(0.3, 0.7),
        max(size * hand.between(0.4, 0.8), p.room.horizon + 10),
    )
    below: list[tuple[float, float, float, float]] = []  # x, y, half-width, top
    slant = float(np.sin(p.room.tilt))
    for _ in range(count):
        x = x0 + spread * hand.rng.standard_normal()
        y = max(y0 + spread * slant * hand.rng.standard_normal(), p.room.horizon + 4)
        tumbled = not flat and hand.chance(0.4)
        tumble = about("x", hand.between(-180, 180)) @ about(
            "z", hand.between(-180, 180)
        )
        long = px * hand.between(0.5, 1.2)
        rests = [
            top
            for a, b, half, top in below
            if np.hypot(x - a, (y - b) / slant) < 0.6 * half + 0.25 * long
        ]
        height = 0.8 * max(
            rests, default=0.0
        )  # things sink into the gaps between those beneath
        kind = KINDS[hand.one_of(names)]
        put = p.put(
            kind, x, y, long, height=height, clear=None, lay=tumble if tumbled else None
        )
        if put:
            below.append((x, y, put[1], min(height + 0.6 * put[0], size / 3)))


def nested(p: Placer) -> None:
    """Pencils in a mug, flowers in a vase, fruit in a bowl, a spoon in a cup."""
    hand, size = p.hand, p.room.size
    for _ in range(hand.one_of([1, 1, 2])):
        name = hand.one_of(HOLDERS)
        holder, px = KINDS[name], size * hand.between(0.25, 0.6)
        x, y = (
            size * hand.between(0.2, 0.8),
            max(size * hand.between(0.65, 0.95), p.room.horizon + 10),
        )
        made = holder.make(hand)
        put = p.put(holder, x, y, px, pose="stand", clear=0.9, model=made)
        if put is None:
            continue
        tall, half = put
        if name in ("bowl", "basket"):
            for k in range(hand.whole(3, 9)):
                turn, out = hand.between(0, 6.28), half * hand.between(0, 0.6)
                p.put(
                    KINDS[hand.one_of(LOOSE)],
                    x + out * np.cos(turn),
                    y + out * np.sin(turn) * float(np.sin(p.room.tilt)),
                    half * hand.between(0.5, 0.8),
                    height=tall * (0.3 + 0.08 * k),
                    clear=None,
                )
        else:
            sort = hand.one_of(TALL)
            for _ in range(hand.whole(1, 6)):
                kind = KINDS[sort if hand.chance(0.5) else hand.one_of(TALL)]
                tip = (
                    about("z", 180)
                    if kind.name in ("spoon", "fork", "knife") and hand.chance(0.4)
                    else about("z", 0)
                )
                lay = (
                    about("y", hand.between(0, 360))
                    @ about("z", hand.between(4, 16))
                    @ tip
                )
                p.put(
                    kind,
                    x + half * hand.between(-0.12, 0.12),
                    y,
                    tall * hand.between(1.3, 1.9),
                    height=tall * 0.12,
                    clear=None,
                    lay=lay,
                    yaw=0,
                )
    if hand.chance(0.5):
        few(p)


def leaning(p: Placer) -> None:
    """Tools, books and boards that lean at a box, at each other or at the wall."""
    hand, size = p.hand, p.room.size
    prop, px = (
        KINDS[hand.one_of(["carton", "book", "can", "jar", "mug", "block", "vase"])],
        size * hand.between(0.2, 0.45),
    )
    x, y = (
        size * hand.between(0.3, 0.7),
        max(size * hand.between(0.65, 0.92), p.room.horizon + 12),
    )
    put = p.put(prop, x, y, px, pose="stand", yaw=hand.between(-20, 20))
    half = put[1] if put else px / 3
    for side in hand.one_of([[-1], [1], [-1, 1], [-1, 1, 1]]):
        kind = KINDS[
            hand.one_of(
                [*TALL, "hammer", "phone", "notebook", "cutting_board", "star", "book"]
            )
        ]
        tilt = hand.between(12, 40)
        long = px * hand.between(0.8, 1.6)
        lay = about("z", side * tilt) @ (
            about("z", 180) if hand.chance(0.3) else about("z", 0)
        )
        away = half + long * np.sin(np.radians(tilt)) * 0.5
        p.put(
            kind,
            x + side * away,
            y + hand.between(-3, 3),
            long,
            lay=lay,
            yaw=hand.between(-15, 15),
            clear=None,
        )
    if hand.chance(0.4):
        few(p)


def laid_table(p: Placer) -> None:
    """Places laid for a meal: plate, cutlery beside it, glass, cup, napkin."""
    hand, size = p.hand, p.room.size
    s, px = float(np.sin(p.room.tilt)), size * hand.between(0.3, 0.6)
    for k in range(hand.whole(1, 2)):
        x, y = (
            size * (hand.between(0.3, 0.7) + 0.8 * k),
            max(size * hand.between(0.5, 0.8), p.room.horizon + px * s / 2),
        )
        plate = KINDS["plate"]
        p.put(plate, x, y, px, clear=None)
        if hand.chance(0.4):
            p.put(
                KINDS[
                    hand.one_of(
                        [
                            "bowl",
                            "cup_and_saucer",
                            "bread",
                            "apple",
                            "napkin_box",
                            "fork",
                        ]
                    )
                ],
                x,
                y,
                px * hand.between(0.4, 0.65),
                height=4,
                clear=None,
            )
        for side, name in ((-0.62, "fork"), (0.62, "knife"), (0.78, "spoon")):
            if hand.chance(0.8):
                p.put(
                    KINDS[name],
                    x + side * px,
                    y,
                    px * hand.between(0.75, 0.95),
                    pose="flat",
                    yaw=hand.between(-6, 6),
                    clear=None,
                )
        for name in ("tumbler", "wine_glass", "mug", "candle", "salt_mill", "bottle"):
            if hand.chance(0.3):
                p.put(
                    KINDS[name],
                    x + hand.between(-0.9, 0.9) * px,
                    y - hand.between(0.6, 1.2) * px * max(s, 0.3),
                    px * hand.between(0.35, 0.6),
                    pose="stand",
                )


def in_a_row(p: Placer) -> None:
    """Dominoes, bottles, figures ... one behind or beside another, on a straight line or a bend."""
    hand, size = p.hand, p.room.size
    kind = KINDS[
        hand.one_of(
            [
                "domino",
                "domino",
                "domino",
                "book",
                "bottle",
                "mug",
                "vehicle",
                "animal",
                "figure",
                "candle",
                "can",
                "chess_piece",
                "duck",
                "block",
                "toy_ball",
                "carton",
            ]
        )
    ]
    count, px = hand.whole(3, 16), size * hand.between(0.12, 0.4)
    step = hand.between(0.25, 1.1) * px
    turn = hand.between(-25, 25) if p.room.tilt < 0.3 else hand.between(0, 180)
    bend, yaw, shared = (
        hand.between(-8, 8),
        hand.between(-80, 80),
        kind.make(hand) if hand.chance(0.5) else None,
    )
    x, y = (
        size * hand.between(-0.05, 0.35),
        max(size * hand.between(0.5, 0.95), p.room.horizon + 5),
    )
    fallen = (
        hand.whole(0, count) if kind.name == "domino" and hand.chance(0.3) else count
    )
    for k in range(count):
        lay = about("z", 0) if k < fallen else about("x", -hand.between(20, 75))
        p.put(
            kind,
            x,
            max(y, p.room.horizon + 4),
            px * p.nearness(y),
            pose="stand",
            yaw=yaw + bend * k,
            clear=None,
            model=shared,
            lay=lay,
        )
        x += step * float(np.cos(np.radians(turn)))
        y += step * float(np.sin(np.radians(turn)) * np.sin(p.room.tilt))
        turn += bend


def empty(p: Placer) -> None:
    """Nothing that could be moved."""


LAYOUTS: dict[str, tuple[Callable[[Placer], None], float, tuple[str, ...]]] = {
    "alone": (alone, 0.1, ("side", "oblique", "top")), "scattered": (scattered, 0.26, ("side", "oblique", "top")),
    "racked": (racked, 0.09, ("side", "oblique", "top")), "stacked": (stacked, 0.11, ("side", "side", "oblique")),
    "shelved": (shelved, 0.07, ("side",)), "heaped": (heaped, 0.08, ("oblique", "top")), "nested": (nested, 0.08, ("side", "oblique", "oblique")),
    "leaning": (leaning, 0.05, ("side", "oblique")), "laid_table": (laid_table, 0.04, ("oblique", "top")), "in_a_row": (in_a_row, 0.07, ("side", "side", "oblique")),
    "empty": (empty, 0.06, ("side", "oblique", "top")),
}  # fmt: skip
"""Each with its share of pictures and the views it suits."""


def furniture(p: Placer) -> None:
    """At times a cupboard, a stool's leg, a lamp's foot, a wall's ledge: solid, but not to be moved."""
    hand, size, camera = p.hand, p.room.size, p.room.camera
    if p.room.horizon <= 0 or not hand.chance(0.22):
        return
    colour = hand.one_of([hand.wood(), hand.white(), hand.grey()])
    front: Paint = textured(hand, colour, "wood", hand.between(0, 0.3), 0.01)
    w, h = size * hand.between(0.15, 0.5), size * hand.between(0.3, 1.2)
    x = size * hand.one_of(
        [hand.between(-0.1, 0.2), hand.between(0.8, 1.1), hand.between(0, 1)]
    )
    deep = hand.between(10, 60)
    spot = camera @ np.array([x, 0, p.room.wall], np.float32)
    parts: list[Part] = [Box(vec(0, h), vec(w, h, deep), front, bevel=0)]
    rows, columns = hand.whole(1, 4), hand.whole(1, 3)
    knob = plain(hand.grey())
    for i in range(columns):
        for j in range(rows):
            cx, cy = w * (2 * (i + 0.5) / columns - 1), 2 * h * (j + 0.5) / rows
            parts.append(
                Box(
                    vec(cx, cy, deep),
                    vec(w / columns - 4, h / rows - 4, 2),
                    front,
                    bevel=0.1,
                )
            )
            if hand.chance(0.8):
                parts.append(
                    Lathe(
                        np.array([[0, 0], [2, 0], [4, 4], [4, 6], [0, 7]], np.float32),
                        knob,
                        MATT,
                        None,
                        vec(cx, cy, deep + 2),
                        vec(0, 0, 1),
                    )
                )
    p.furniture(parts, Pose(camera, spot.astype(np.float32), 1.0))
