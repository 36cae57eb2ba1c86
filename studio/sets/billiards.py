"""Fifteen racked pool balls and the cue ball on green cloth, from straight above; a lamp over the upper left."""

import numpy as np
from lights import environment, panel
from materials import glossy, matt, satin, texture
from optics import T
from shapes import floor, sphere
from stage import Boundary, Camera, Mesh, Stage, Thing
from textures import billiard_ball, felt, srgb, wood

RADIUS = 0.0286  # m: a pool ball is 57.2 mm across (World Pool-Billiard Association, equipment rules)
NOSE = 0.0363  # height of the cushion's nose, 63.5 % of a ball (same rules)
HALF = 0.596, 0.368  # nose to nose: half of the playing area
CUSHION = 0.048  # from the nose to the wood
LAMP = np.array([-0.50, 0.74, 1.15])
CREAM = srgb(240, 232, 210)
COLOURS = [
    (240, 186, 28),
    (22, 48, 140),
    (200, 30, 28),
    (74, 32, 110),
    (226, 92, 20),
    (10, 92, 58),
    (112, 20, 28),
]
RACK = [
    1,
    11,
    5,
    2,
    8,
    10,
    9,
    7,
    14,
    4,
    6,
    15,
    13,
    3,
    12,
]  # from the apex, row by row; 8 in the middle of row three
CAMERA = Camera(
    "top",
    height=640 / 700,
    centre=(0, 0),
    distance=8.0,
    aperture=0.01,
    plane=RADIUS,
    size=(960, 640),
)


def ball(number: int, at: tuple[float, float], **more: object) -> Thing:
    """A glossy phenolic sphere, its number turned somewhere towards the camera; 0 is the cue ball."""
    rng = np.random.default_rng(100 + number)
    colour = (
        srgb(*COLOURS[(number - 1) % 8]) if number not in (0, 8) else srgb(16, 15, 17)
    )
    turn = (
        T()
        .rotate([0, 0, 1], rng.uniform(0, 360))
        .rotate([0, 1, 0], -rng.uniform(38, 100))
    )
    turn = turn.rotate([1, 0, 0], rng.uniform(0, 360))
    skin = sphere(
        RADIUS, glossy(texture(billiard_ball(number, colour, CREAM)), 1.56), turn
    )
    name = f"ball-{number}" if number else "cue-ball"
    return Thing(
        name,
        "billiard ball",
        [skin],
        {"circle": RADIUS},
        at,
        170,
        0.06,
        0.95,
        0,
        RADIUS,
        "sphere",
        0.01,
        **more,
    )


def balls() -> list[Thing]:
    """The rack is packed so that neighbours touch exactly."""
    slots = [(row, k) for row in range(5) for k in range(row + 1)]
    found = {
        number: (0.185 + row * np.sqrt(3) * RADIUS, (row - 2 * k) * RADIUS)
        for number, (row, k) in zip(RACK, slots, strict=True)
    }
    cue = ball(0, (-0.36, -0.046), velocity=(6.0, 0.508571))
    return [cue, *(ball(n, found[n]) for n in range(1, 16))]


def rail(
    start: np.ndarray,
    along: np.ndarray,
    outward: np.ndarray,
    profile: np.ndarray,
    length: float,
    bsdf: dict,
    offset: float,
) -> Mesh:
    """A bar along one side of the table, mitred at both ends: profile (P, 2) of distance behind the nose and height.

    `offset` says which strip of its texture it is cut from.
    """
    v, uv = [], []
    run = np.concatenate([[0], np.cumsum(np.hypot(*np.diff(profile, axis=0).T))])
    for end in (0, 1):
        for (back, height), s in zip(profile, run, strict=True):
            shift = -back if end == 0 else length + back
            v.append([*(start + shift * along + back * outward), height])
            uv.append([(shift + 0.25) / 1.75, s / 0.8 + offset])
    n = len(profile)
    tangent = np.gradient(profile, axis=0)
    lift = np.stack([-tangent[:, 1], tangent[:, 0]], 1)
    lift /= np.linalg.norm(lift, axis=1, keepdims=True)
    normals = np.tile(np.concatenate([lift[:, :1] * outward, lift[:, 1:]], 1), (2, 1))
    faces = [[i, i + 1, n + i] for i in range(n - 1)] + [
        [i + 1, n + i + 1, n + i] for i in range(n - 1)
    ]
    return Mesh(
        np.array(v),
        normals,
        np.array(uv),
        np.array(faces),
        {"type": "twosided", "bsdf": bsdf},
    )


def table(cloth: np.ndarray) -> dict:
    """The bed, the cushions, the mahogany frame and its mother-of-pearl sights."""
    soft = matt(felt(800, 1750, cloth * 1.02, seed=4))
    board = wood(
        1024, 2048, srgb(58, 22, 12), srgb(146, 76, 40), seed=11, rings=20, figure=0.03
    )
    lacquer = satin(texture(board), 0.09, 1.5)
    bulge = np.linspace(-0.5 * np.pi, 0.42 * np.pi, 9)
    nose = np.stack([0.004 - 0.004 * np.cos(bulge), NOSE + 0.004 * np.sin(bulge)], 1)
    slope = np.linspace(nose[-1], [CUSHION, 0.0425], 8)[1:]
    slope[:, 1] += 0.0016 * np.sin(np.linspace(0, np.pi, 8))[1:]
    cushion = np.concatenate([[[0.019, 0.0]], [[0.012, 0.022]], nose, slope])
    edge = np.linspace(0, np.pi / 2, 7)
    wooden = np.concatenate(
        [
            [[CUSHION, 0.035]],
            np.stack(
                [CUSHION + 0.004 - 0.004 * np.cos(edge), 0.040 + 0.004 * np.sin(edge)],
                1,
            ),
            np.linspace([CUSHION + 0.006, 0.044], [0.24, 0.044], 8),
        ]
    )
    found = {"bed": floor(1.4, 1.4 * 640 / 960, matt(felt(1280, 1920, cloth, seed=3)))}
    sides = {"right": (1, 0), "top": (0, 1), "left": (-1, 0), "bottom": (0, -1)}
    for k, (name, outward) in enumerate(sides.items()):
        out = np.array(outward, float)
        half, length = HALF if out[0] else HALF[::-1]
        along = np.array([-out[1], out[0]])
        start = out * half - along * length
        found[f"cushion-{name}"] = rail(
            start, along, out, cushion, 2 * length, soft, 0.24 * k
        )
        found[f"rail-{name}"] = rail(
            start, along, out, wooden, 2 * length, lacquer, 0.24 * k
        )
    pearl = satin((0.66, 0.62, 0.54), 0.08, 1.49)
    sights = [
        (HALF[0] * k / 4, sy * (HALF[1] + CUSHION + 0.021))
        for k in range(-3, 4)
        for sy in (-1, 1)
    ]
    sights += [
        (sx * (HALF[0] + CUSHION + 0.021), HALF[1] * k / 2)
        for k in (-1, 0, 1)
        for sx in (-1, 1)
    ]
    for k, (x, y) in enumerate(sights):
        found[f"sight-{k}"] = {
            "type": "disk",
            "to_world": T().translate([x, y, 0.0442]).scale(0.0046),
            "bsdf": pearl,
        }
    return found


def room() -> np.ndarray:
    """(128, 256, 3) light from a dim room around the table; row 0 is straight up. A window on each long wall."""
    light = np.full((128, 256, 3), 0.10) * np.array([1.0, 0.88, 0.74])
    light[:34] = np.array([0.13, 0.12, 0.105])
    for column, width, colour in (
        (70, 16, (1.5, 1.8, 2.3)),
        (92, 16, (1.5, 1.8, 2.3)),
        (190, 26, (1.5, 1.0, 0.55)),
    ):
        light[40:56, column : column + width] = colour
    return light


def stage() -> Stage:
    # A ball meets the nose above its own middle, so its side passes a little under the nose:
    # that line is what a circle bounces on.
    give = RADIUS - np.sqrt(RADIUS**2 - (NOSE - RADIUS) ** 2)
    x, y = HALF[0] + give, HALF[1] + give
    around = [(-x, y), (x, y), (x, -y), (-x, -y), (-x, y)]
    note = "where the balls' widest part meets the cushions"
    return Stage(
        "billiards",
        "The break",
        "A break on a table without pockets, seen from above.",
        CAMERA,
        balls(),
        table(srgb(30, 106, 74)),
        {
            "lamp": panel(LAMP, (0, 0, 0), (0.52, 0.30), (42.0, 37.0, 30.5), (0, 1, 0)),
            "room": environment(room()),
        },
        {"cushions": Boundary(around, 0.14, 0.6, note)},
        world={"table": {"friction": 0.67}},
        softness=8,
        exposure=1.35,
        vignette=0.1,
        duration=5.0,
        depth=8,
        sections=sections,
        film={"frames": 14, "until": 0.9},
    )


def sections(camera: Camera) -> dict:
    return {
        "render": {"sound": True},
        "variants": {
            "soft-break": {"objects.cue-ball.velocity": camera.shift((5.0, 0.422857))},
            "no-nine": {"objects.ball-9": None},
        },
        "comments": {
            "world.table": "cloth; with the balls' 0.06 the pair slides at sqrt(0.06 x 0.67) = 0.2",
            "world.pixels_per_meter": "a ball is 57.2 mm across",
            "objects.cue-ball.friction": "ball on ball: Mathavan and others, 0.03 to 0.08",
            "objects.cue-ball.velocity": "at the first ball of the rack; 6 m/s, a break",
            "boundaries.cushions.elasticity": "with the balls' 0.95: 0.75 of the speed comes back",
        },
    }
