"""Things of a desk, a shelf and a workshop, as random makers: a generator in, `Thing` out; metres."""

from __future__ import annotations

import numpy as np

from studio.segmentation.homes import prints
from studio.segmentation.homes.parts import Part, Thing, flat, standing
from studio.segmentation.homes.prints import Rng
from studio.segmentation.homes.solids import (
    ball,
    box,
    extrude,
    join,
    lathe,
    rounded,
    sweep,
    turn,
)


def book(rng: Rng) -> Thing:
    """Standing upright with its back to the viewer; (width, depth, height) = thickness, page width, height."""
    thick, deep, tall = (
        rng.uniform(0.008, 0.05),
        rng.uniform(0.1, 0.19),
        rng.uniform(0.15, 0.28),
    )
    face = prints.cover(rng)
    base = face[2:6, 2:6].mean((0, 1))
    back = prints.spine(rng, base)
    rim = np.broadcast_to(base, (8, 8, 3)).astype(np.float32)
    skin = prints.net([back, face, rim, rim, face[::-1, ::-1], rim])
    inset = min(0.003, thick * 0.15)
    board = min(0.0025, thick * 0.15)
    sides = [
        box([board, deep, tall], 0.0006).moved([s * (thick - board) / 2, 0, 0])
        for s in (-1, 1)
    ]
    spine = box([thick, board * 1.3, tall], 0.001).moved([0, -(deep - board) / 2, 0])
    pages = box(
        [thick - 1.6 * board, deep - 2 * inset, tall - 2 * inset], 0.0005
    ).moved([0, 0, inset])
    paper = prints.plain(
        rng.choice([[238, 230, 212], [246, 244, 238], [222, 205, 170]])
    )
    lines = np.repeat(paper, 32, 1) * rng.uniform(0.8, 1.0, (1, 64, 1)).astype(
        np.float32
    )
    finish = str(rng.choice(["satin", "matt", "glossy"]))
    return standing(
        "book",
        [Part(join([*sides, spine]), finish, skin), Part(pages, "matt", lines)],
        leans=True,
    )


def carton(rng: Rng) -> Thing:
    """A box: cereal, tea, a parcel, a tin with edges."""
    size = rng.uniform([0.04, 0.03, 0.04], [0.2, 0.12, 0.26])
    faces = [prints.cover(rng), prints.cover(rng)]
    base = np.broadcast_to(faces[0][:3, :3].mean((0, 1)), (8, 8, 3)).astype(np.float32)
    if rng.random() < 0.25:
        kraft = prints.plain(np.array([188, 150, 108]) + rng.normal(0, 8, 3))
        skin = prints.net([kraft] * 6)
    else:
        other = faces[1] if rng.random() < 0.5 else base
        skin = prints.net([faces[0], other, base, faces[0], other, base])
    return standing(
        "carton",
        [Part(box(size, 0.0012), str(rng.choice(["satin", "matt"])), skin)],
        faces=True,
        top=tuple(size[:2]),
        leans=size[1] < 0.06,
    )


def block(rng: Rng) -> Thing:
    """A toy block: cube, brick, arch, wedge or cylinder."""
    a = rng.uniform(0.025, 0.06)
    wood = np.array([205, 165, 115]) + rng.normal(0, 14, 3)
    skin = prints.plain(wood) if rng.random() < 0.3 else flat(rng)
    kind = rng.integers(5)
    top: tuple[float, float] | None = (a, a)
    if kind == 0:
        body = box([a, a, a], 0.002)
        glyph = np.broadcast_to(skin[:1, :1], (48, 48, 3)).copy()
        prints.write(
            glyph,
            chr(65 + rng.integers(26)),
            (24, 24),
            26,
            prints.linear(prints.colour(rng)),
            prints.FONTS[1],
        )
        skin = prints.net([glyph] * 6, 48)
    elif kind == 1:
        body, top = box([a * 2, a, a * rng.uniform(0.5, 1)], 0.002), (2 * a, a)
    elif kind == 2:
        t = np.linspace(0, np.pi, 13)
        arch = [
            [-a, 0],
            *np.column_stack([-0.55 * a * np.cos(t), 0.55 * a * np.sin(t)]),
            [a, 0],
            [a, a],
            [-a, a],
        ]
        body, top = (
            extrude(arch, a * 0.8, 0.0015).moved(turn=turn("x", 90)),
            (2 * a, 0.8 * a),
        )
    elif kind == 3:
        body, top = (
            extrude(
                [[-a, 0], [a, 0], [a if rng.random() < 0.5 else 0, a]], a, 0.0015
            ).moved(turn=turn("x", 90)),
            None,
        )
    else:
        body = lathe(rounded([[0, 0], [a / 2, 0], [a / 2, a * 1.5], [0, a * 1.5]], 0))
    return standing(
        "block",
        [Part(body, str(rng.choice(["satin", "matt", "glossy"])), skin)],
        top=top,
    )


def candle(rng: Rng) -> Thing:
    r, h = rng.uniform(0.01, 0.04), rng.uniform(0.04, 0.2)
    wax = lathe(
        rounded([[0, 0], [r, 0], [r, h], [r * 0.8, h + 0.001], [0, h - 0.004]], 1), 30
    )
    wick = sweep(
        [[0, 0, h - 0.006], [0.001, 0, h + 0.006], [0.003, 0, h + 0.012]],
        0.0009,
        around=6,
    )
    parts = [
        Part(wax, "satin", flat(rng)),
        Part(wick, "matt", prints.plain([40, 34, 30])),
    ]
    if r < 0.02 or rng.random() < 0.3:
        dish = lathe(
            rounded(
                [
                    [0, -0.02],
                    [r * 2.2, -0.02],
                    [r * 2.3, -0.012],
                    [r * 1.2, -0.014],
                    [r * 1.25, 0.004],
                    [0, 0.003],
                ],
                1,
            ),
            30,
        )
        parts.append(Part(dish, str(rng.choice(["brushed", "glossy"])), flat(rng)))
    return standing("candle", parts, True)


def pencil(rng: Rng) -> Thing:
    """A pencil or a pen, lying along x."""
    length, r = rng.uniform(0.1, 0.18), rng.uniform(0.0032, 0.006)
    around = 6 if rng.random() < 0.5 else 16
    body = lathe([[0, 0], [r, 0], [r, length * 0.88], [0, length * 0.88]], around)
    tip = lathe(
        [
            [0, length * 0.88],
            [r * 0.98, length * 0.88],
            [r * 0.25, length],
            [0, length],
        ],
        around,
    )
    lay = turn("y", 90)
    parts = [
        Part(body, "satin", flat(rng)),
        Part(tip, "matt", prints.plain([214, 178, 130])),
    ]
    return standing("pencil", [p.moved(turn=lay) for p in parts], rod=length)


def driver(rng: Rng) -> Thing:
    """A screwdriver, lying along x."""
    length, r = rng.uniform(0.14, 0.24), rng.uniform(0.009, 0.015)
    grip = lathe(
        rounded(
            [
                [0, 0],
                [r, 0.004],
                [r, length * 0.2],
                [r * 0.8, length * 0.3],
                [r, length * 0.42],
                [0, length * 0.44],
            ],
            1,
        ),
        10,
    )
    shaft = lathe(
        [[0, length * 0.4], [0.003, length * 0.4], [0.003, length], [0, length]], 12
    )
    parts = [
        Part(grip, "glossy", flat(rng)),
        Part(shaft, "steel", prints.plain([200, 200, 205])),
    ]
    return standing("driver", [p.moved(turn=turn("y", 90)) for p in parts], rod=length)


def hammer(rng: Rng) -> Thing:
    length = rng.uniform(0.18, 0.28)
    shaft = sweep(
        [[-length / 2, 0, 0], [0, 0, 0], [length / 2, 0, 0]],
        [0.011, 0.009, 0.009],
        0.7,
        14,
    )
    head = lathe(
        rounded(
            [
                [0, -0.05],
                [0.012, -0.05],
                [0.013, -0.02],
                [0.009, 0],
                [0.011, 0.03],
                [0.003, 0.055],
                [0, 0.055],
            ],
            1,
        ),
        20,
    )
    parts = [
        Part(shaft, "satin", flat(rng)),
        Part(
            head.moved([length / 2 - 0.012, 0, 0], turn("x", 90)),
            "brushed",
            prints.plain([120, 120, 125]),
        ),
    ]
    return standing("hammer", parts)


def _corners(w: float, h: float, r: float) -> np.ndarray:
    """(K, 2) a rectangle with round corners about the origin."""
    t = np.linspace(0, np.pi / 2, 6)
    quarter = np.column_stack([np.cos(t), np.sin(t)]) * r
    spots = [(1, 1), (-1, 1), (-1, -1), (1, -1)]
    return np.concatenate(
        [
            quarter @ turn("z", 90 * k)[:2, :2].T
            + [s[0] * (w / 2 - r), s[1] * (h / 2 - r)]
            for k, s in enumerate(spots)
        ]
    )


def dice(rng: Rng) -> Thing:
    a = rng.uniform(0.014, 0.035)
    tone, ink = prints.linear(prints.colour(rng)), prints.linear(prints.colour(rng))
    cells = []
    for k in (1, 3, 5, 6, 4, 2):
        cell = np.broadcast_to(tone, (48, 48, 3)).copy()
        spots = {
            1: [(24, 24)],
            2: [(12, 12), (36, 36)],
            3: [(12, 12), (24, 24), (36, 36)],
            4: [(12, 12), (36, 12), (12, 36), (36, 36)],
            5: [(12, 12), (36, 12), (24, 24), (12, 36), (36, 36)],
            6: [(12, 10), (12, 24), (12, 38), (36, 10), (36, 24), (36, 38)],
        }[k]
        for spot in spots:
            prints.cv2.circle(cell, spot, 5, ink.tolist(), -1)
        cells.append(cell)
    return standing(
        "dice",
        [Part(box([a, a, a], a * 0.12), "glossy", prints.net(cells, 48))],
        top=(a, a),
    )


def gadget(rng: Rng) -> Thing:
    """Something boxy of several bodies by chance: a radio, a punch, a toy robot's trunk."""
    w, d, h = rng.uniform(0.03, 0.14), rng.uniform(0.03, 0.09), rng.uniform(0.03, 0.12)
    parts = [
        Part(
            box([w, d, h], rng.uniform(0.002, 0.012)),
            str(rng.choice(["matt", "satin", "glossy"])),
            flat(rng),
        )
    ]
    for _ in range(rng.integers(1, 5)):
        a = rng.uniform(0.15, 0.6) * min(w, d)
        at = (
            [rng.uniform(-0.4, 0.4) * w, rng.uniform(-0.4, 0.4) * d, h - 0.003]
            if rng.random() < 0.5
            else [rng.uniform(-0.4, 0.4) * w, -d / 2, h * rng.uniform(0.3, 0.7)]
        )
        knob = (
            ball(a / 2, 16, 9)
            if rng.random() < 0.3
            else lathe([[0, -a / 3], [a / 2, -a / 3], [a / 2, a / 3], [0, a / 3]], 18)
            if rng.random() < 0.6
            else box([a, a * 0.7, a * rng.uniform(0.3, 2)], 0.002)
        )
        spin = turn("x", 90) if at[1] == -d / 2 else np.eye(3)
        parts.append(
            Part(
                knob.moved(at, spin),
                str(rng.choice(["matt", "satin", "steel"])),
                flat(rng),
            )
        )
    return standing("gadget", parts, faces=True)
