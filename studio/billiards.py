"""Photograph a billiards table from straight above: 15 racked balls, the cue ball, four rails; exact truth.

The camera is orthographic (a lens of unlimited length), so a ball is a circle to the last digit. World axes: metres,
+x right, +y up the picture, +z towards the camera, the cloth is z = 0.
"""

from pathlib import Path

import numpy as np
from darkroom import T, environment, flags, mesh, photograph, texture
from textures import billiard_ball, felt, srgb, wood

SIZE = 960, 640
PIXELS_PER_METER = 700.0
RADIUS = 0.0286  # a pool ball is 57.2 mm across (World Pool-Billiard Association, equipment rules)
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


def centres() -> dict[str, np.ndarray]:
    """Name -> (3,) centre; the rack is packed so that neighbours touch exactly."""
    apex, found = np.array([0.185, 0.0]), {"cue-ball": np.array([-0.36, -0.046, RADIUS])}
    slots = [(row, k) for row in range(5) for k in range(row + 1)]
    for number, (row, k) in zip(RACK, slots, strict=True):
        found[f"ball-{number}"] = np.array(
            [apex[0] + row * np.sqrt(3) * RADIUS, apex[1] + (row - 2 * k) * RADIUS, RADIUS]
        )
    return {name: found[name] for name in ["cue-ball", *(f"ball-{n}" for n in range(1, 16))]}


def ball(number: int, centre: np.ndarray) -> dict:
    """A glossy phenolic sphere, its number turned somewhere towards the camera."""
    rng = np.random.default_rng(100 + number)
    colour = srgb(*COLOURS[(number - 1) % 8]) if number not in (0, 8) else srgb(16, 15, 17)
    turn = (
        T()
        .translate(list(centre))
        .rotate([0, 0, 1], rng.uniform(0, 360))
        .rotate([0, 1, 0], -rng.uniform(38, 100))
        .rotate([1, 0, 0], rng.uniform(0, 360))
        .scale(RADIUS)
    )
    skin = {
        "type": "plastic",
        "int_ior": 1.56,
        "nonlinear": True,
        "diffuse_reflectance": texture(billiard_ball(number, colour, CREAM)),
    }
    return {"type": "sphere", "to_world": turn, "bsdf": skin}


def rail(
    start: np.ndarray,
    along: np.ndarray,
    outward: np.ndarray,
    profile: np.ndarray,
    length: float,
    bsdf: dict,
    offset: float,
) -> dict:
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
    faces = [[i, i + 1, n + i] for i in range(n - 1)] + [[i + 1, n + i + 1, n + i] for i in range(n - 1)]
    return mesh(np.array(v), normals, np.array(uv), np.array(faces), bsdf)


def table(cloth: np.ndarray) -> dict:
    """The bed, the cushions, the mahogany frame and its mother-of-pearl sights."""
    bed = {"type": "diffuse", "reflectance": texture(felt(1280, 1920, cloth, seed=3))}
    soft = {
        "type": "twosided",
        "bsdf": {"type": "diffuse", "reflectance": texture(felt(800, 1750, cloth * 1.02, seed=4))},
    }
    board = wood(1024, 2048, srgb(58, 22, 12), srgb(146, 76, 40), seed=11, rings=20, figure=0.03)
    lacquer = {
        "type": "twosided",
        "bsdf": {
            "type": "roughplastic",
            "alpha": 0.09,
            "int_ior": 1.5,
            "nonlinear": True,
            "diffuse_reflectance": texture(board),
        },
    }
    bulge = np.linspace(-0.5 * np.pi, 0.42 * np.pi, 9)
    nose = np.stack([0.004 - 0.004 * np.cos(bulge), NOSE + 0.004 * np.sin(bulge)], 1)
    slope = np.linspace(nose[-1], [CUSHION, 0.0425], 8)[1:]
    slope[:, 1] += 0.0016 * np.sin(np.linspace(0, np.pi, 8))[1:]
    cushion = np.concatenate([[[0.019, 0.0]], [[0.012, 0.022]], nose, slope])
    edge = np.linspace(0, np.pi / 2, 7)
    wooden = np.concatenate(
        [
            [[CUSHION, 0.035]],
            np.stack([CUSHION + 0.004 - 0.004 * np.cos(edge), 0.040 + 0.004 * np.sin(edge)], 1),
            np.linspace([CUSHION + 0.006, 0.044], [0.24, 0.044], 8),
        ]
    )
    world = {"bed": {"type": "rectangle", "to_world": T().scale([0.7, 0.7 * 640 / 960, 1]), "bsdf": bed}}
    sides = {"right": (1, 0), "top": (0, 1), "left": (-1, 0), "bottom": (0, -1)}
    for k, (name, outward) in enumerate(sides.items()):
        out = np.array(outward, float)
        half, length = HALF if out[0] else HALF[::-1]
        along = np.array([-out[1], out[0]])
        start = out * half - along * length
        world[f"cushion-{name}"] = rail(start, along, out, cushion, 2 * length, soft, 0.24 * k)
        world[f"rail-{name}"] = rail(start, along, out, wooden, 2 * length, lacquer, 0.24 * k)
    pearl = {
        "type": "roughplastic",
        "alpha": 0.08,
        "diffuse_reflectance": {"type": "rgb", "value": [0.66, 0.62, 0.54]},
    }
    sights = [
        (sx * HALF[0] * k / 4, sy * (HALF[1] + CUSHION + 0.021))
        for k in range(-3, 4)
        for sx in (1,)
        for sy in (-1, 1)
    ]
    sights += [(sx * (HALF[0] + CUSHION + 0.021), HALF[1] * k / 2) for k in (-1, 0, 1) for sx in (-1, 1)]
    for k, (x, y) in enumerate(sights):
        world[f"sight-{k}"] = {
            "type": "disk",
            "to_world": T().translate([x, y, 0.0442]).scale(0.0046),
            "bsdf": pearl,
        }
    return world


def room() -> np.ndarray:
    """(128, 256, 3) light from a dim room around the table; row 0 is straight up. A window on each long wall."""
    sky = np.full((128, 256, 3), 0.10) * np.array([1.0, 0.88, 0.74])
    sky[:34] = np.array([0.13, 0.12, 0.105])
    for column, width, colour in (
        (70, 16, (1.5, 1.8, 2.3)),
        (92, 16, (1.5, 1.8, 2.3)),
        (190, 26, (1.5, 1.0, 0.55)),
    ):
        sky[40:56, column : column + width] = colour
    return sky


def lights() -> dict:
    """A softbox of a lamp over the upper left, and the room."""
    aim = T().look_at(origin=list(LAMP), target=[0, 0, 0], up=[0, 1, 0])
    lamp = {
        "type": "rectangle",
        "to_world": aim @ T().scale([0.26, 0.15, 1]),
        "emitter": {"type": "area", "radiance": {"type": "rgb", "value": [42.0, 37.0, 30.5]}},
    }
    return {"lamp": lamp, "room": environment(room())}


def main() -> None:
    args = flags(__doc__, Path(__file__).parent.parent / "scenes/billiards/photo.png", 384)
    width, height = (round(side * args.scale) for side in SIZE)
    ppm = PIXELS_PER_METER * width / SIZE[0]

    def pixel(x: float, y: float) -> list[float]:
        return [round(x * ppm + (width - 1) / 2, 3), round((height - 1) / 2 - y * ppm, 3)]

    view = T().look_at(origin=[0, 0, 1.0], target=[0, 0, 0], up=[0, 1, 0]) @ T().scale(
        [width / 2 / ppm, width / 2 / ppm, 1]
    )
    camera = {"type": "orthographic", "to_world": view, "near_clip": 0.01, "far_clip": 10.0}
    camera["film"] = {
        "type": "hdrfilm",
        "width": width,
        "height": height,
        "rfilter": {"type": "gaussian", "stddev": 0.45},
    }
    world = {
        "type": "scene",
        "integrator": {"type": "path", "max_depth": 8, "rr_depth": 5},
        "camera": camera,
        **lights(),
        **table(srgb(30, 106, 74)),
    }
    places = centres()
    objects = {name: ball(int(name[5:]) if name != "cue-ball" else 0, at) for name, at in places.items()}

    # A ball meets the nose above its own middle, so its side passes a little under the nose:
    # that line is what a circle bounces on.
    give = RADIUS - np.sqrt(RADIUS**2 - (NOSE - RADIUS) ** 2)
    rails = {}
    for kind, half in (("nose", HALF), ("contact", (HALF[0] + give, HALF[1] + give))):
        (left, bottom), (right, top) = pixel(-half[0], -half[1]), pixel(half[0], half[1])
        rails[kind] = {"left": left, "top": top, "right": right, "bottom": bottom}
    truth = {
        "view": "top",
        "pixels_per_meter": ppm,
        "camera": "orthographic, straight down; pixel = [x * ppm + (width - 1) / 2, (height - 1) / 2 - y * ppm]",
        "rails": rails,
        "light": {
            "direction": [round(v, 4) for v in LAMP * [1, -1, 1] / np.linalg.norm(LAMP)],
            "from": "centre of the table to the lamp",
        },
        "objects": [
            {"name": name, "circle": {"center": pixel(*at[:2]), "radius": round(RADIUS * ppm, 3)}}
            for name, at in places.items()
        ],
    }
    photograph(world, objects, truth, out=args.out, spp=args.spp, exposure=1.35)


if __name__ == "__main__":
    main()
