"""Nine ivory dominoes in a row on a walnut table, before a blue-grey wall; a window at the left."""

import numpy as np
from lights import panel, sky
from materials import matt, satin, texture
from optics import T
from shapes import floor, moved, rounded_box, wall
from stage import Boundary, Camera, Stage, Thing
from textures import ivory, plaster, srgb, wood

BOX = (
    0.0075,
    0.024,
    0.048,
)  # m: a European domino standing on end: across, depth, height
COUNT, SPACING, FIRST = 9, 0.0232, -0.1
CAMERA = Camera(
    "side",
    height=540 / 3125,
    centre=(0, 0.04224),
    distance=4.0,
    rise=(0, 4 * np.tan(np.radians(4.6))),
    aperture=0.024,
    size=(960, 540),
)


def domino(index: int) -> Thing:
    """Set up by hand: a little off the line, a little turned; each from another piece of bone."""
    rng = np.random.default_rng(40 + index)
    yaw, aside = rng.normal(0, 0.35), rng.normal(0, 0.00025)
    rng = np.random.default_rng(70 + index)
    colour = srgb(
        *(np.array([238, 230, 208]) + rng.normal(0, 3) + rng.normal(0, [0, 0.4, 2.5]))
    )
    bone = satin(texture(ivory(512, 512, colour, seed=index)), 0.09, 1.54)
    box = rounded_box(BOX, bone, 0.0009, 0.05, (0.13, 0.29), grain="z")
    at = round(FIRST + index * SPACING + aside, 5), BOX[2] / 2
    part = moved(box, T().rotate([0, 0, 1], yaw))
    return Thing(
        f"domino-{index + 1}",
        "domino",
        [part],
        {"box": (BOX[0], BOX[2])},
        at,
        14,
        0.35,
        0.2,
    )


def stage() -> Stage:
    board = wood(
        2048, 3072, srgb(74, 44, 27), srgb(164, 110, 70), seed=5, rings=24, figure=0.02
    )
    scenery = {
        "table": floor(
            5.4, 1.04, satin(texture(board, (3, 3), 90), 0.32, 1.4), (0, -0.2, 0)
        ),
        "wall": wall(
            4, 2, matt(plaster(512, 1024, srgb(112, 130, 138), 8)), (0, 0.85, 0.2)
        ),
        "curtain": moved(  # keeps window light off part of the wall
            {
                "type": "rectangle",
                "bsdf": {"type": "twosided", "bsdf": matt((0.1, 0.1, 0.1))},
            },
            T()
            .translate([-0.62, 0.36, 0.50])
            .rotate([0, 1, 0], 25)
            .rotate([1, 0, 0], 90)
            .scale([0.25, 0.3, 1]),
        ),
    }
    lights = {
        "window": panel(
            (-1.5, -0.8, 0.85), (0, 0, 0.03), (0.72, 0.92), (29, 26.2, 22.4)
        ),
        "room": sky((0.412, 0.399, 0.386), (0.255, 0.247, 0.239), (0.14, 0.12, 0.1)),
    }
    return Stage(
        "dominoes",
        "Nine dominoes fall",
        "A row of dominoes, slowed down two and a half times.",
        CAMERA,
        [domino(k) for k in range(COUNT)],
        scenery,
        lights,
        {"table": Boundary([(-0.28144, 0), (0.29456, 0)], 0.5, 0.2)},
        duration=1.0,
        softness=12,
        exposure=1.3,
        vignette=0.1,
        sections=sections,
        film={"frames": 14, "until": 0.7},
    )


def sections(camera: Camera) -> dict:
    first = domino(0)
    return {
        "forces": [
            {
                "object": "domino-1",
                "force": camera.push((0.01472, 0)),
                "at": [
                    round(v) for v in camera.pixel((first.at[0] - BOX[0] / 2, 0.0446))
                ],
                "start": 0.05,
                "duration": 0.12,
            }
        ],
        "render": {"slow": 2.5, "sound": True},
        "variants": {"gap": {"objects.domino-5": None}},
        "comments": {
            "world.pixels_per_meter": "a domino is 48 mm high, so gravity is 30,625 px/s²",
            "objects.domino-1.mass": "g",
            "forces": "a finger presses near the top until it tips, g·px/s²",
        },
    }
