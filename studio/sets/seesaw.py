"""A plank over a split log on garden paving: a stone lies on one end, an iron ball falls on the other; overcast."""

import numpy as np
from lights import sky
from materials import matt, metal
from optics import T
from shapes import extrude, floor, lathe, moved, rounded_box, sphere, wall
from stage import Boundary, Camera, Mesh, Stage, Thing
from textures import srgb, wood
from textures_workshop import end_grain, foliage, paving, stone, worn

LONG, THICK, WIDE = 0.80, 0.034, 0.08  # m, the plank
PIN = 0.094  # m above the paving
BALL = 0.052  # m


def tilt() -> float:
    """Degrees by which the plank leans when its left end is on the ground."""
    lean = np.linspace(0, 0.5, 100001)
    drop = PIN - LONG / 2 * np.sin(lean) - THICK / 2 * np.cos(lean)
    return float(np.degrees(lean[np.argmin(np.abs(drop))]))


def blades(count: int, seed: int) -> Mesh:
    """Blades of grass behind the paving, thinner afar."""
    rng = np.random.default_rng(seed)
    y = 0.62 + 3.2 * rng.random(count) ** 1.6
    x = rng.uniform(-1, 1, count) * (0.75 + 0.2 * y)
    tall, width = rng.uniform(0.03, 0.075, count), rng.uniform(0.0025, 0.005, count)
    turn, bend = rng.uniform(0, np.pi, count), rng.normal(0, 0.02, (count, 2))
    foot = np.stack([x, y, np.zeros(count)], 1)
    side = np.stack([np.cos(turn), np.sin(turn), np.zeros(count)], 1) * width[:, None]
    tip = foot + np.stack([bend[:, 0], bend[:, 1], tall], 1)
    vertices = np.stack([foot - side, foot + side, tip], 1).reshape(-1, 3)
    uv = np.repeat(np.stack([rng.random(count), rng.random(count)], 1), 3, 0)
    green = foliage(64, 64, srgb(58, 82, 34), srgb(132, 150, 76), 3)
    bsdf = {"type": "twosided", "bsdf": matt(green)}
    return Mesh(vertices, None, uv, np.arange(3 * count).reshape(-1, 3), bsdf)


def stone_at(right: np.ndarray, away: np.ndarray, up: np.ndarray) -> np.ndarray:
    """A flat-footed round stone: where its skin lies in unit directions from its middle."""
    bulge = (
        1
        + 0.06 * np.cos(2.3 * right + 1.7 * up + 0.6)
        + 0.05 * np.sin(3.1 * up - 2 * right + 1.4 * away)
    )
    spot = np.stack([0.062 * right, 0.05 * away, 0.047 * up], -1) * bulge[..., None]
    spot[..., 2] = np.maximum(spot[..., 2], -0.034) + 0.034
    return spot


def pebble() -> tuple[Mesh, list]:
    """The stone and its section."""
    across, round_ = np.meshgrid(
        np.linspace(0, np.pi, 49), np.linspace(0, 2 * np.pi, 97), indexing="ij"
    )
    spot = stone_at(
        np.sin(across) * np.cos(round_), np.cos(across), np.sin(across) * np.sin(round_)
    )
    normals = np.cross(np.gradient(spot, axis=1), np.gradient(spot, axis=0)).reshape(
        -1, 3
    )
    normals[np.linalg.norm(normals, axis=1) < 1e-12] = [0, 1, 0]
    normals *= np.sign(np.sum(normals * (spot.reshape(-1, 3) - [0, 0, 0.03]), 1))[
        :, None
    ]
    i = (np.arange(48)[:, None] * 97 + np.arange(96)).ravel()
    faces = np.concatenate(
        [np.stack([i, i + 1, i + 98], 1), np.stack([i, i + 98, i + 97], 1)]
    )
    skin = matt(stone(512, 512, srgb(132, 128, 120), 6, 0.10, 0.15))
    uv = np.stack([round_ / np.pi, across / np.pi], -1).reshape(-1, 2)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    turn = np.linspace(0, 2 * np.pi, 33)[:-1]
    section = stone_at(np.cos(turn), 0 * turn, np.sin(turn))[:, [0, 2]]
    ends = np.flatnonzero(section[:, 1] < 1e-9)[[0, -1]]
    keep = [k for k in range(32) if section[k, 1] > 1e-9 or k in ends]
    return Mesh(spot.reshape(-1, 3), normals, uv, faces, skin), [
        tuple(section[k]) for k in keep
    ]


def stage() -> Stage:
    camera = Camera("side", height=1.0, centre=(0, 0.42), rise=(0, 0.3), aperture=0.04)
    lean = tilt()
    along, out = (
        np.array(v)
        for v in (
            (np.cos(np.radians(lean)), np.sin(np.radians(lean))),
            (-np.sin(np.radians(lean)), np.cos(np.radians(lean))),
        )
    )
    grey = worn(
        wood(512, 1536, srgb(112, 94, 74), srgb(178, 158, 130), 12, 7, 0.05),
        512,
        1536,
        4,
        0.05,
        0.4,
    )
    plank = rounded_box((LONG, WIDE, THICK), matt(grey), 0.0025, 0.8, (0.5, 0.4))
    shape, section = pebble()
    pin = np.array([0, PIN])
    iron = metal(
        rough=0.2, tint=worn(np.array([0.2, 0.195, 0.19]), 256, 512, 3, 0.12, 0.3)
    )
    things = [
        Thing(
            "plank",
            "wooden plank",
            [plank],
            {"box": (LONG, THICK)},
            (0, PIN),
            1350,
            0.6,
            0.15,
            -lean,
        ),
        Thing(
            "stone",
            "stone",
            [shape],
            {"polygon": section},
            tuple(pin - 0.315 * along + THICK / 2 * out),
            950,
            0.7,
            0.2,
            -lean,
        ),
        Thing(
            "ball",
            "iron ball",
            [sphere(BALL, iron)],
            {"circle": BALL},
            (0.325, 0.70),
            4200,
            0.4,
            0.2,
            solid="sphere",
            rolling=0.01,
            velocity=(-0.08, -0.3),
        ),
    ]
    radius = PIN * np.cos(np.radians(lean)) - THICK / 2
    arch = np.linspace(0, np.pi, 41)
    half = np.stack([np.cos(arch), np.sin(arch)], 1)
    bark = matt(stone(256, 512, srgb(92, 72, 54), 2, 0.25, 0.5))
    sawn = matt(end_grain(512, srgb(128, 88, 54), srgb(192, 160, 120), 11, 5))
    slabs = matt(paving(1024, 1024, srgb(150, 146, 134), 3, 3, 7))
    clay = matt(worn(srgb(172, 98, 66), 256, 512, 5, 0.08, 0.5))
    pot = lathe(
        [
            (0.001, 0),
            (0.075, 0),
            (0.105, 0.17),
            (0.118, 0.17),
            (0.118, 0.205),
            (0.1, 0.205),
            (0.09, 0.16),
            (0.001, 0.16),
        ],
        clay,
    )
    scenery = {
        "paving": floor(3.0, 2.7, slabs, (0.22, -0.75, 0)),
        "lawn": floor(
            30,
            12,
            matt(foliage(512, 512, srgb(62, 80, 38), srgb(104, 122, 62), 8)),
            (0, 6.65, -0.01),
        ),
        "grass": blades(14000, 2),
        "hedge": wall(
            16,
            4,
            matt(foliage(768, 2048, srgb(20, 32, 16), srgb(104, 128, 66), 4)),
            (0, 4.4, 1.9),
        ),
        "log": extrude(
            half * (radius - 0.006), 0.24, sawn, 0.001, 2 * radius, (0.5, 0)
        ),
        "bark": extrude(half * radius, 0.234, bark, 0.003, 0.2),
        "pot": moved(pot, T().translate([0.50, 1.5, 0])),
    }
    lights = {"sky": sky((1.25, 1.3, 1.36), (0.62, 0.64, 0.62), (0.10, 0.11, 0.06))}
    story = """A stone lies on the low end of a plank, and an iron ball comes down on the high one.
How high the stone flies is a matter of two masses, a height and the place of the pin."""
    return Stage(
        "seesaw",
        "An iron ball throws a stone",
        story,
        camera,
        things,
        scenery,
        lights,
        {
            "paving": Boundary([(-4, 0), (4, 0)], 0.6, 0.15),
            "log": Boundary(
                [tuple(p) for p in half[::4] * (radius - 0.008)],
                0.6,
                0.1,
                "a little below what is seen",
            ),
        },
        duration=1.65,
        softness=45,
        exposure=1.75,
        film=None,
        sections=lambda c: {
            "joints": {
                "pin": {
                    "objects": ["plank"],
                    "pivot": [float(v) for v in c.pixel(pin).round(2)],
                }
            },
            "render": {
                "slow": 1.5,
                "first_blur": True,
                "contact_shade": True,
                "smooth_outlines": True,
            },
            "variants": {
                "hollow-ball": {"objects.ball.mass": 900},
                "heavy-stone": {"objects.stone.mass": 3000},
                "thrown-down": {"objects.ball.velocity": c.shift((0, -2.2))},
            },
        },
    )
