"""A tennis ball flies at a brick wall in a yard, an old one lies there; bright sun, hard shadows, all matt."""

import numpy as np
from lights import sky, sun
from materials import matt
from optics import T
from shapes import floor, lathe, moved, rounded_box, sphere, wall
from stage import Boundary, Camera, Mesh, Part, Stage, Thing
from textures import plaster, srgb
from textures_home import concrete, join, mirrored, tennis_ball

BALL = 0.0335  # m, radius
WALL = 0.235  # m, where the wall's face is
NEAR = -0.075  # m along y, the wall's end
LONG, HALF, HIGH, JOINT = 0.215, 0.1025, 0.065, 0.010  # m, a brick


def bricks() -> dict[str, Part]:
    """The wall: its face towards the ball and its end towards us, brick by brick, mortar set back between."""
    rng = np.random.default_rng(7)
    tones = [
        (150, 88, 66),
        (166, 102, 76),
        (132, 78, 62),
        (172, 118, 88),
        (116, 76, 66),
    ]
    clay = [
        matt(mirrored(concrete(384, 384, srgb(*tone), k)))
        for k, tone in enumerate(tones)
    ]
    piles: list[list[Mesh]] = [[] for _ in tones]
    for row in range(15):
        z = row * (HIGH + JOINT) + HIGH / 2 + 0.002
        y, first = NEAR, True
        while y < 1.75:
            long = HALF if first and row % 2 else LONG
            for leaf in range(
                3 if first else 1
            ):  # the end shows three leaves, the face one
                size = np.array([HALF, long, HIGH]) - rng.uniform(0, 0.003, 3)
                kind = rng.integers(len(tones))
                brick = rounded_box(
                    tuple(size), clay[kind], 0.004, 0.5, tuple(rng.random(2)), "y"
                )
                slip = rng.normal(0, 0.0006, 3)
                at = T().translate(
                    [
                        WALL + HALF / 2 + leaf * (HALF + JOINT) + 0.001 + abs(slip[0]),
                        y + long / 2 + slip[1],
                        z + slip[2],
                    ]
                )
                piles[kind].append(
                    moved(brick, at.rotate([1, 0, 0], rng.normal(0, 0.25)))
                )
            y, first = y + long + JOINT, False
    found: dict[str, Part] = {f"bricks-{k}": join(pile) for k, pile in enumerate(piles)}
    mortar = matt(concrete(512, 512, srgb(178, 168, 152), 20))
    bed = rounded_box((0.4, 1.9, 1.2), mortar, 0.004, 0.5, (0, 0), "y")
    found["mortar"] = moved(
        bed, T().translate([WALL + 0.2 + 0.006, NEAR + 0.95 + 0.007, 0.55])
    )
    return found


def yard() -> dict[str, Part]:
    """Slabs with sandy joints, a rendered wall behind, a terracotta pot with a bush, and a tree out of sight."""
    rng = np.random.default_rng(3)
    stone = [
        matt(mirrored(concrete(512, 512, srgb(*tone), 30 + k)))
        for k, tone in enumerate([(166, 156, 140), (154, 147, 136), (174, 162, 142)])
    ]
    found: dict[str, Part] = {
        "sand": floor(6, 6, matt(srgb(112, 100, 82)), (0, 1, -0.006))
    }
    side = 0.40
    for i in range(-3, 3):
        for j in range(-2, 5):
            size = (side - 0.008, side - 0.008, 0.04)
            slab = rounded_box(
                size, stone[rng.integers(3)], 0.004, 0.7, tuple(rng.random(2))
            )
            at = T().translate([i * side + 0.11, j * side + 0.07, -0.02])
            found[f"slab-{i}-{j}"] = moved(
                slab, at.rotate([0, 0, 1], rng.normal(0, 0.2))
            )
    found["render"] = wall(
        5, 3, matt(plaster(1024, 1536, srgb(200, 178, 142), 6)), (0, 1.75, 1.2)
    )
    pot = [
        (0, 0),
        (0.085, 0),
        (0.115, 0.17),
        (0.128, 0.17),
        (0.130, 0.205),
        (0.112, 0.208),
        (0.108, 0.18),
        (0, 0.178),
    ]
    found["pot"] = moved(
        lathe(pot, matt(concrete(256, 512, srgb(164, 98, 68), 50))),
        T().translate([-0.25, 1.35, 0]),
    )
    greens = [
        matt(srgb(*tone)) for tone in ((72, 100, 52), (98, 126, 64), (54, 80, 46))
    ]

    def leaf(at: np.ndarray, size: float, kind: int) -> dict:
        turn = (
            T()
            .translate(at.tolist())
            .rotate(rng.normal(size=3).tolist(), rng.uniform(0, 360))
            .scale([size, size * 0.45, 1])
        )
        return {
            "type": "disk",
            "to_world": turn,
            "bsdf": {"type": "twosided", "bsdf": greens[kind]},
        }

    for k in range(150):
        spot = rng.normal(size=3)
        spot *= (
            np.array([0.17, 0.15, 0.15]) * rng.uniform(0.4, 1) / np.linalg.norm(spot)
        )
        found[f"leaf-{k}"] = leaf(
            np.add(spot, [-0.25, 1.35, 0.33]), rng.uniform(0.025, 0.045), k % 3
        )
    for k in range(70):  # a bough that throws its shadow on the rendered wall
        found[f"bough-{k}"] = leaf(
            np.array([-1.15, 0.55, 2.0]) + rng.normal(0, [0.30, 0.12, 0.22]),
            rng.uniform(0.04, 0.08),
            k % 3,
        )
    return found


def stage() -> Stage:
    camera = Camera(
        "side", height=0.70, centre=(0, 0.285), rise=(-0.26, 0.24), aperture=0.045
    )
    turn = T().rotate([0, 0, 1], 25).rotate([1, 0, 0], 35)
    fresh = sphere(BALL, matt(tennis_ball(1, 0.25)), turn)
    old = sphere(
        BALL,
        matt(tennis_ball(5, 0.95)),
        T().rotate([1, 0, 0], 100).rotate([0, 0, 1], 130),
    )
    hollow = {
        "solid": "sphere",
        "rolling": 0.03,
    }  # round in its shadow; of a shell, 2/3 m r², it has 2/5
    things = [
        Thing(
            "ball",
            "tennis ball",
            [fresh],
            {"circle": BALL},
            (-0.17, 0.335),
            58,
            0.6,
            0.8,
            velocity=(2.2, 1.2),
            spin=-500,
            note="Hit flat, it flies at 2.5 m/s and turns a little.",
            **hollow,
        ),
        Thing(
            "old-ball",
            "tennis ball",
            [old],
            {"circle": BALL},
            (-0.235, BALL),
            56,
            0.6,
            0.6,
            note="It has lost its bounce.",
            **hollow,
        ),
    ]
    lights = {
        "sun": sun((-0.62, -0.55, 0.72), np.array([1.0, 0.91, 0.78]) * 5.2, 0.3),
        "sky": sky((0.22, 0.33, 0.54), (0.38, 0.42, 0.46), (0.20, 0.18, 0.15)),
    }

    def sections(c: Camera) -> dict:
        return {
            "render": {"slow": 2},
            "variants": {
                "smash": {
                    "objects.ball.velocity": c.shift((6, 0.4)),
                    "world.duration": 0.3,
                },
                "topspin": {"objects.ball.spin": 6000},
                "beach-ball": {
                    "objects.ball.mass": 6,
                    "fields": {"air": {"wind": [0, 0], "drag": 2e-4}},
                },
                "bare-yard": {"objects.old-ball": None},
            },
        }

    return Stage(
        "wall-ball",
        "A tennis ball comes back from a wall",
        "A tennis ball flies at a brick wall, comes back, and drops where an old ball lies.\n"
        "In slow motion, one second in two. Let it spin (topspin) and the wall sends it up instead.",
        camera,
        things,
        bricks() | yard(),
        lights,
        {
            "wall": Boundary([(WALL, 0), (WALL, 2)], 0.6, 0.75),
            "ground": Boundary([(-3, 0), (WALL, 0)], 0.6, 0.5),
        },
        duration=2.1,
        diffuse=True,
        softness=0.3,
        sun=(-0.62, -0.55, 0.72),
        exposure=0.85,
        sections=sections,
    )
