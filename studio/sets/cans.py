"""Six tins in a pyramid on a trestle at a fair by night, under warm bulbs; a ball comes flying."""

import numpy as np
from lights import WARM, bulb, sky
from materials import matt, metal, satin, texture
from optics import T
from shapes import floor, lathe, moved, rod, rounded_box, sphere
from stage import Boundary, Camera, Stage, Thing
from textures import srgb, wood
from textures_workshop import fairground, stitched, tin_label, workbench, worn

RADIUS, TALL = 0.0375, 0.11  # m, a tin
BALL = 0.0365  # m
KINDS = [  # title, below, ground, ink, fruit
    ("TOMATOES", "PEELED & WHOLE", (196, 170, 60), (128, 26, 22), (190, 44, 32)),
    ("PEAS", "GARDEN FRESH", (64, 104, 60), (24, 56, 34), (120, 160, 60)),
    ("PEACHES", "IN LIGHT SYRUP", (48, 86, 132), (24, 40, 84), (220, 140, 60)),
    ("BEANS", "IN TOMATO SAUCE", (176, 52, 38), (96, 22, 20), (214, 150, 92)),
]


def tin(name: str, at: tuple[float, float], seed: int, row: int) -> Thing:
    rng = np.random.default_rng(seed)
    title, below, *colours = KINDS[seed % 4]
    paper = satin(tin_label(title, below, *(srgb(*c) for c in colours), seed), 0.22)
    bare = metal(
        rough=0.17, tint=worn(np.array([0.62, 0.61, 0.58]), 128, 512, seed, 0.08, 0.3)
    )
    rim, half, body = RADIUS, TALL / 2, RADIUS - 0.0013
    profile = [
        (0.0005, -half + 0.004),
        (rim - 0.003, -half + 0.004),
        (rim - 0.0025, -half),
        (rim, -half + 0.0006),
    ]
    profile += [
        (rim, -half + 0.003),
        (body, -half + 0.005),
        (body, half - 0.005),
        (rim, half - 0.003),
    ]
    profile += [
        (rim, half - 0.0006),
        (rim - 0.0025, half),
        (rim - 0.003, half - 0.004),
        (0.0005, half - 0.004),
    ]
    label = [(body + 0.0003, -half + 0.0085), (body + 0.0003, half - 0.0085)]
    turn = T().rotate([0, 0, 1], rng.normal(0, 16))
    parts = [moved(lathe(p, b), turn) for p, b in ((profile, bare), (label, paper))]
    # the middle row comes off lively, and the upper tin slides off it
    friction, elasticity = [(0.35, 0.3), (0.35, 0.5), (0.1, 0.3)][row]
    box = {"box": (2 * RADIUS, TALL)}
    return Thing(name, "tin can", parts, box, at, 62, friction, elasticity)


def stage() -> Stage:
    camera = Camera(
        "side",
        height=0.72,
        centre=(0, 0.235),
        distance=3.2,
        rise=(0.03, 0.2),
        aperture=0.035,
    )
    rng = np.random.default_rng(2)
    things = []
    for row in range(3):
        for k in range(3 - row):
            x = (
                0.03
                + (k - (2 - row) / 2) * (2 * RADIUS + 0.003)
                + rng.normal(0, 0.0008)
            )
            things.append(
                tin(f"tin-{len(things) + 1}", (x, (row + 0.5) * TALL), len(things), row)
            )
    hide = satin(stitched(512, 2), 0.4)
    flying = T().rotate([1, 0, 0], 35) @ T().rotate([0, 0, 1], 70)
    things.append(
        Thing(
            "ball", "leather ball", [sphere(BALL, hide, flying)], {"circle": BALL}, (-0.29, 0.21), 145, 0.45, 0.4,
            solid="sphere", velocity=(5.1, -0.73125), spin=500, note="thrown at 5 m/s, with a little spin",
        )
    )  # fmt: skip
    boards = wood(512, 2048, srgb(112, 66, 44), srgb(170, 112, 76), 31, 9, 0.03)
    top = matt(workbench(512, 2048, boards, 9))
    stripes = np.where(
        np.arange(1024)[None, :, None] // 64 % 2, srgb(168, 34, 30), srgb(206, 194, 168)
    )
    cloth = matt(
        np.broadcast_to(stripes, (64, 1024, 3))
        * (0.9 + 0.1 * np.sin(np.arange(1024) / 1024 * 190))[None, :, None]
    )
    glow = {"type": "area", "radiance": texture(fairground(512, 1024, 7))}
    far = T().translate([0, 7, 0.1]).rotate([1, 0, 0], 90).scale([2.2, 1.1, 1])
    scenery = {
        "trestle": moved(
            rounded_box((2.4, 0.44, 0.035), top, 0.003, 1.2, (0, 0.3)),
            T().translate([0, 0.02, -0.0175]),
        ),
        "cloth": moved(
            rounded_box((2.4, 0.004, 0.5), cloth, 0.001, 1.5),
            T().translate([0, -0.19, -0.285]),
        ),
        "ground": floor(14, 9, matt(srgb(74, 68, 60)), (0, 3, -0.8)),
        "post": rod(
            (0.52, 0.62, -0.8), (0.52, 0.62, 2.5), 0.03, matt(srgb(90, 70, 52))
        ),
    }
    lamps = [(-0.55, -0.62, 0.80), (0.02, -0.66, 0.88), (0.60, -0.58, 0.82)]
    lights = {
        "fair": {"type": "rectangle", "to_world": far, "emitter": glow},
        "night": sky(
            (0.010, 0.012, 0.02),
            (0.022, 0.02, 0.024),
            (0.012, 0.009, 0.007),
            [
                ((0.9, -0.5, 0.25), 9, (0.9, 0.35, 0.12)),
                ((-1, -0.2, 0.2), 7, (0.15, 0.3, 0.9)),
            ],
        ),
        **{f"bulb-{k}": bulb(at, 0.028, WARM * 230) for k, at in enumerate(lamps)},
    }
    story = """Three throws a ticket: a leather ball flies at six tins on a trestle, at a fair by night.
It takes the middle row away, one tin faster than the other, and the upper tin drops a row.
Take a tin away, fill the lowest with sand, or throw harder."""
    return Stage(
        "cans",
        "Six tins at a fair",
        story,
        camera,
        things,
        scenery,
        lights,
        {"trestle": Boundary([(-1.2, 0), (1.2, 0)], 0.4, 0.2)},
        duration=0.5,
        softness=20,
        exposure=1.9,
        sections=lambda c: {
            "render": {
                "slow": 5,
                "first_blur": True,
                "contact_shade": True,
                "smooth_outlines": True,
            },
            "variants": {
                "full-of-sand": {f"objects.tin-{k}.mass": 700 for k in (1, 2, 3)},
                "fast-ball": {"objects.ball.velocity": c.shift((9, -2.2))},
                "low-throw": {"objects.ball.velocity": c.shift((5.4, -2.4))},
                "high-throw": {"objects.ball.velocity": c.shift((4.8, 0.9))},
            },
        },
    )
