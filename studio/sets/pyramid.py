"""Ten worn toy blocks in a pyramid on a child's table, a rubber ball in the air; window at the left, the room soft behind."""

from dataclasses import replace

import numpy as np
from lights import panel, sky
from materials import matt, texture
from optics import T
from shapes import floor, lathe, moved, rounded_box, sphere, wall
from stage import Boundary, Camera, Mesh, Stage, Thing
from textures import plaster, srgb, wood
from textures_kitchen import block, rubber_ball

SIDE, PITCH = 0.04, 0.0425  # m: a block, and from block to block
CAMERA = Camera(
    "side", height=0.275, centre=(-0.012, 0.095), rise=(0.012, 0.24), aperture=0.03
)
RED, OCHRE, BLUE, GREEN, CREAM = (
    (172, 62, 48),
    (212, 160, 62),
    (64, 102, 140),
    (102, 132, 84),
    (214, 202, 174),
)
BLOCKS = [  # paint (none: bare beech), letter, its ink; bottom row first
    (BLUE, "", ()), ((), "B", RED), (GREEN, "", ()), ((), "7", BLUE),
    (OCHRE, "K", (92, 58, 40)), (CREAM, "", ()), (RED, "", ()),
    ((), "A", (60, 104, 76)), (BLUE, "3", CREAM),
    (RED, "M", CREAM),
]  # fmt: skip


def toy_block(number: int, at: tuple[float, float]) -> Thing:
    """Every face carries the same print."""
    paint, letter, ink = BLOCKS[number]
    rng = np.random.default_rng(60 + number)
    box = rounded_box(
        (SIDE, SIDE, SIDE),
        matt(texture(block(paint, number, letter, ink or (0, 0, 0)))),
        0.0019,
    )
    faces = np.split(box.vertices / SIDE, 6)  # +x, -x, +y, ...
    uv = [
        np.stack(
            [f[:, 0 if k > 1 else 1], f[:, 1 if k > 3 else 2] * (1 if k > 3 else -1)], 1
        )
        for k, f in enumerate(faces)
    ]
    turn = T().rotate([0, 0, 1], rng.normal(0, 1.1))
    part = moved(replace(box, uv=np.concatenate(uv) * 0.985 + 0.5), turn)
    return Thing(
        f"block-{number + 1}",
        "wooden block",
        [part],
        {"box": (SIDE, SIDE)},
        at,
        45,
        0.5,
        0.2,
    )


def things() -> list[Thing]:
    rng = np.random.default_rng(4)
    found = []
    for row in range(4):
        for k in range(4 - row):
            x = (k - (3 - row) / 2) * PITCH + rng.uniform(-0.0006, 0.0006)
            found.append(toy_block(len(found), (round(x, 5), (row + 0.5) * SIDE)))
    ball = sphere(
        0.02,
        matt(texture(rubber_ball(512))),
        T().rotate([0, 1, 0], 28).rotate([1, 0, 0], 14).rotate([0, 0, 1], 60),
    )
    note = "a small rubber ball, thrown at the third row: 2.6 m/s"
    return [
        *found,
        Thing(
            "ball",
            "rubber ball",
            [ball],
            {"circle": 0.02},
            (-0.118, 0.118),
            37,
            0.7,
            0.8,
            solid="sphere",
            rolling=0.01,
            velocity=(2.6, 0.1),
            note=note,
        ),
    ]


def crate(
    size: tuple[float, float, float], colour: object, at: tuple[float, float, float]
) -> Mesh:
    return moved(rounded_box(size, matt(colour), 0.004), T().translate(list(at)))


def room() -> dict:
    """The table; behind it a bookcase with picture books, boxes and toys, a wall, a lamp."""
    board = texture(
        wood(
            1024,
            2048,
            srgb(150, 110, 72),
            srgb(206, 166, 118),
            seed=3,
            rings=22,
            figure=0.03,
        ),
        (2.4, 1),
    )
    white = srgb(206, 202, 192)
    found = {
        "table": floor(3.6, 1.3, matt(board), (0.62, -0.17, 0)),
        "edge": wall(3.0, 0.03, matt(srgb(150, 112, 76)), (0, 0.48, -0.015)),
        "wall": wall(
            6, 4, matt(plaster(512, 1024, srgb(176, 192, 190), 4)), (0, 2.25, 0.6)
        ),
        "floor": floor(8, 8, matt(srgb(150, 124, 96)), (0, 1, -0.55)),
        "back": crate((1.30, 0.02, 1.5), white * 0.9, (0.60, 2.2, 0.2)),
    }
    for k, z in enumerate((-0.26, 0.045, 0.36)):
        found[f"shelf-{k}"] = crate((1.30, 0.30, 0.022), white, (0.60, 2.05, z))
    for k, x in enumerate((-0.05, 0.60, 1.25)):
        found[f"side-{k}"] = crate((0.022, 0.30, 1.5), white, (x, 2.05, 0.2))
    rng = np.random.default_rng(12)
    books = [
        RED,
        OCHRE,
        BLUE,
        GREEN,
        CREAM,
        (186, 108, 84),
        (92, 120, 132),
        (150, 140, 96),
    ]
    for shelf, start, end in (
        (-0.249, -0.02, 0.32),
        (0.056, 0.14, 0.56),
        (0.056, 0.98, 1.22),
        (-0.249, 0.64, 1.0),
    ):
        x = start
        while x < end:
            thick, high = rng.uniform(0.012, 0.036), rng.uniform(0.15, 0.235)
            tone = srgb(*(np.array(books[rng.integers(8)]) + rng.normal(0, 8, 3)))
            found[f"book-{len(found)}"] = crate(
                (thick * 0.94, 0.17, high), tone, (x + thick / 2, 2.0, shelf + high / 2)
            )
            x += thick
    found["box"] = crate((0.20, 0.2, 0.17), srgb(*OCHRE) * 0.9, (0.46, 2.02, -0.164))
    found["toy-ball"] = sphere(0.052, matt(srgb(150, 132, 92)), at=(0.045, 1.98, 0.108))
    for k, (radius, tone) in enumerate(
        ((0.07, RED), (0.06, OCHRE), (0.05, GREEN), (0.04, BLUE))
    ):  # stacking rings
        ring = lathe(
            [
                (0, 0),
                (radius, 0.004),
                (radius + 0.006, 0.018),
                (radius, 0.032),
                (0, 0.036),
            ],
            matt(srgb(*tone)),
            around=40,
        )
        found[f"ring-{k}"] = moved(ring, T().translate([0.77, 1.97, 0.056 + 0.036 * k]))
    fur = matt(srgb(150, 108, 70))
    bear = [
        (0.075, 0, 0.07),
        (0.055, 0, 0.175),
        (0.02, -0.045, 0.222),
        (0.02, 0.045, 0.222),
        (0.028, -0.075, 0.1),
        (0.028, 0.075, 0.1),
        (0.024, 0, 0.165),
    ]
    for k, (radius, x, z) in enumerate(bear):  # sits on a box left of the bookcase
        found[f"bear-{k}"] = sphere(
            radius,
            fur if k < 6 else matt(srgb(206, 176, 136)),
            at=(-0.36 + x, 1.9 - 0.045 * (k == 6), 0.0 + z),
        )
    found["chest"] = crate((0.56, 0.36, 0.5), srgb(118, 138, 150), (-0.40, 1.95, -0.25))
    return found


def stage() -> Stage:
    lights = {
        "window": panel(
            (-1.5, -0.95, 0.95),
            (0, 0, 0.05),
            (0.8, 1.1),
            np.array([1, 0.95, 0.87]) * 13,
        ),
        "far-window": panel(
            (-2.4, 1.2, 0.9), (0.2, 2.2, 0.1), (1.0, 1.3), np.array([1, 0.96, 0.9]) * 6
        ),
        "room": sky((0.55, 0.55, 0.56), (0.40, 0.39, 0.37), (0.22, 0.19, 0.16)),
    }
    return Stage(
        "pyramid",
        "A rubber ball meets ten blocks",
        "Ten old toy blocks, piled with care, and a rubber ball already in the air.\n"
        "It knocks one block off the third row; slowed down three times. Thrown harder, it takes the row and what stands on it.",
        CAMERA,
        things(),
        room(),
        lights,
        {"table": Boundary([(-2, 0), (2, 0)], 0.5, 0.25)},
        duration=0.6,
        softness=13,
        exposure=1.3,
        diffuse=True,
        sections=sections,
        film={"frames": 14, "until": 0.6, "variant": "throw"},
        wide=replace(CAMERA, size=(1920, 1080)),
    )


def sections(camera: Camera) -> dict:
    return {
        "render": {
            "slow": 3,
            "first_blur": True,
            "contact_shade": True,
            "smooth_outlines": True,
        },
        "variants": {
            "throw": {"objects.ball.velocity": camera.shift((3.8, 0.1))},
            "hard-throw": {"objects.ball.velocity": camera.shift((4.8, 0.15))},
            "iron-ball": {
                "objects.ball.mass": 260,
                "objects.ball.velocity": camera.shift((3.2, -1)),
            },
            "no-corner": {"objects.block-1": None, "objects.ball": None},
        },
        "comments": {
            "variants.throw": "the third row goes, and the block on it",
            "variants.hard-throw": "they fly out of the picture",
            "variants.iron-ball": "seven times as heavy, and lower",
            "variants.no-corner": "no ball, and the lower left block pulled away",
        },
    }
