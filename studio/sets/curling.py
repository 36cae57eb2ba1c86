"""A curling house from straight above: a red stone comes in fast; cool lamps of an ice rink, mirrored softly by the ice."""

import numpy as np
from lights import panel, sky
from materials import bumpy, rubber, satin, texture
from shapes import floor, lathe
from stage import Camera, Mesh, Stage, Thing
from textures import srgb
from textures_stone import granite, house, pebbles

RADIUS, TALL = 0.14, 0.114  # m: 0.28 m across, 19.1 kg
TEE = (0.42, 0.12)
ICE = 4.4  # m
RED, YELLOW = srgb(178, 34, 36), srgb(238, 196, 44)
# name, colour, place, how the handle lies
STONES = [
    ("red-1", RED, (-1.22, -0.34), 20),
    ("yellow-1", YELLOW, (0.10, -0.25), -64),
    ("yellow-2", YELLOW, (0.86, -0.13), 38),
    ("red-2", RED, (0.30, 0.38), 128),
    ("yellow-3", YELLOW, (0.62, 0.86), -150),
    ("red-3", RED, (-0.62, 0.72), 80),
    ("yellow-4", YELLOW, (1.02, -1.02), 10),
]


def stone(colour: np.ndarray, seed: int) -> list[Mesh]:
    """Granite, polished but for its striking band, with a plastic cap and handle; bottom at z = 0."""
    knots = [
        (0, 4),
        (52, 4),
        (60, 0),
        (68, 0),
        (92, 6),
        (122, 22),
        (137, 42),
        (140, 57),
    ]
    knots += [(137, 72), (122, 93), (98, 107), (80, 111), (0, 113)]
    profile = np.array(knots, float)[::-1][::-1] / 1000
    run = np.concatenate([[0], np.cumsum(np.hypot(*np.diff(profile, axis=0).T))])
    band = run[6] / run[-1] - 0.005, run[8] / run[-1] + 0.005
    body = lathe(
        profile,
        satin(texture(granite(512, 2048, seed, band)), 0.07, 1.55),
        around=128,
        smooth=75,
    )
    rim = np.radians(np.linspace(0, 90, 7))
    cap = [
        (0.079, 0.110),
        *np.stack([0.074 + 0.005 * np.cos(rim), 0.112 + 0.005 * np.sin(rim)], 1),
        (0.050, 0.1185),
        (0, 0.119),
    ]
    plastic = satin(colour, 0.2)
    bolt = lathe(
        [(0.012, 0.118), (0.012, 0.121), (0.010, 0.1215), (0, 0.1215)],
        rubber(srgb(70, 70, 72)),
        around=32,
    )
    path = [
        (-52, 117),
        (-52, 128),
        (-46, 141),
        (-34, 149),
        (-10, 153),
        (20, 155),
        (48, 154),
        (64, 150),
        (68, 146),
    ]
    return [body, lathe(cap, plastic), bolt, handle(np.array(path) / 1000, plastic)]


def handle(path: np.ndarray, bsdf: dict) -> Mesh:
    """A bar of oval section bent along (x, z), closed at its ends."""
    fine = np.linspace(0, len(path) - 1, 41)
    middle = np.stack(
        [np.interp(fine, np.arange(len(path)), path[:, k]) for k in (0, 1)], 1
    )
    along = np.gradient(middle, axis=0)
    along /= np.hypot(*along.T)[:, None]
    turn = np.linspace(0, 2 * np.pi, 25)
    ends = np.minimum(np.arange(41), np.arange(41)[::-1])
    swell = np.sqrt(np.clip(1 - (1 - np.clip(ends / 3, 0.0, 1)) ** 2, 0.0, 1))
    out = (
        np.stack([-along[:, 1], 0 * fine, along[:, 0]], 1)[:, None]
        * np.sin(turn)[:, None]
        * 0.011
    )
    side = np.array([0, 0.0145, 0]) * np.cos(turn)[:, None]
    ring = (out + side) * swell[:, None, None]
    vertices = ring + np.stack([middle[:, 0], 0 * fine, middle[:, 1]], 1)[:, None]
    normals = out / 0.011**2 * 0.011 + side / 0.0145**2 * 0.011
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    i = (np.arange(40)[:, None] * 25 + np.arange(24)).ravel()
    faces = np.concatenate(
        [np.stack([i, i + 1, i + 26], 1), np.stack([i, i + 26, i + 25], 1)]
    )
    uv = np.zeros((41 * 25, 2))
    return Mesh(vertices.reshape(-1, 3), normals.reshape(-1, 3), uv, faces, bsdf)


def stage() -> Stage:
    camera = Camera(
        "top",
        height=3.0,
        centre=(0, 0),
        distance=6.0,
        rise=(0.1, -0.2),
        aperture=0.01,
        plane=TALL / 2,
    )
    things = []
    for k, (name, colour, at, degrees) in enumerate(STONES):
        going = (
            {
                "velocity": (2.1, 0),
                "spin": 40,
                "note": "the stone that is played, 2.1 m/s",
            }
            if not k
            else {}
        )
        label = f"{name.split('-')[0]} curling stone"
        parts = stone(colour, 10 + k)
        things.append(
            Thing(
                name,
                label,
                parts,
                {"circle": RADIUS},
                at,
                19100,
                0.1,
                0.8,
                degrees,
                solid="disc",
                **going,
            )
        )
    ice = bumpy(
        satin(texture(house(2048, ICE, TEE, 5)), 0.04, 1.31),
        pebbles(1024, 2),
        0.0006,
        (2, 2),
    )
    cool = np.array([0.93, 0.98, 1.0])
    lights = {
        f"lamp-{k}": panel((x, y, 7.5), (x, y, 0), (0.35, 2.4), cool * power, (0, 1, 0))
        for k, (x, y, power) in enumerate(
            [(-2.3, 1.9, 48), (2.5, 1.9, 20), (-2.3, -2.7, 18), (2.5, -2.7, 14)]
        )
    }
    lights["hall"] = sky(
        (0.20, 0.22, 0.25),
        (0.12, 0.13, 0.15),
        (0.3, 0.3, 0.3),
        [((-0.9, 0.3, 0.35), 12, (1.0, 1.0, 1.1))],
    )

    def sections(c: Camera) -> dict:
        return {
            "render": {"sound": True},
            "variants": {
                "tap": {"objects.red-1.velocity": c.shift((0.85, 0.0))},
                "peel": {
                    "objects.red-1.velocity": c.shift((3.4, 0.1)),
                    "objects.red-1.spin": 0,
                },
                "no-guard": {"objects.yellow-1": None},
                "ice-melted": {"world.table.friction": 4.0},
            },
            "comments": {
                "world.table": "sqrt(0.003 x 0.1), the ice's and the granite's friction, is 0.017 under a stone",
                "variants.tap": "just enough to nudge the yellow one on",
                "variants.ice-melted": "on the bare concrete below",
            },
        }

    return Stage(
        "curling",
        "The last red stone",
        "Red's last stone comes in fast, slowly turning, at the yellow stone nearest to it,\n"
        "and that one has a neighbour behind it: will both be gone? Aim it by objects.red-1.velocity;\n"
        "a broom would make world.table.friction smaller.",
        camera,
        things,
        {"ice": floor(ICE, ICE, ice)},
        lights,
        {},
        duration=4.2,
        softness=6,
        exposure=2.1,
        world={"table": {"friction": 0.003}},
        sections=sections,
        film={"frames": 14, "until": 1.8},
    )
