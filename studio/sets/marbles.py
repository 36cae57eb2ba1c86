"""Six marbles let go in a wooden trough seen end-on, on an old table before a dark cloth; soft light of a window at left."""

import numpy as np
from lights import panel, sky
from materials import both, glass, glossy, matt, satin, texture
from optics import T
from shapes import extrude, floor, moved, rounded_box, sphere
from stage import Boundary, Camera, Mesh, Part, Stage, Thing
from textures import srgb, wood
from textures_stone import linen, swirl, used

RADIUS = 0.008  # m, a common marble
HOLLOW = 0.078  # m: radius of the hollow, to the middles of its 46 facets
BASE = 0.014  # m of wood below it
STEP = 2 * np.arcsin(
    RADIUS / (HOLLOW - RADIUS)
)  # rad from one marble to the next that it touches
FACET = STEP / 4  # so each marble stands on the middle of a facet
FACETS = 46
DEEP = 0.022  # m, along the line of sight


def trough() -> list[tuple[float, float]]:
    """Its section, (x, up) m above the table: two feet, leaning sides, rounded shoulders, the hollow."""
    bend = (np.arange(FACETS + 1) - FACETS / 2) * FACET
    reach = HOLLOW / np.cos(FACET / 2)
    hollow = np.stack([reach * np.sin(bend), BASE + HOLLOW - reach * np.cos(bend)], 1)
    lip = hollow[0, 1]
    round_ = np.radians(np.linspace(0, 84, 5))
    shoulder = np.stack(
        [0.0845 + 0.006 * np.sin(round_), lip - 0.006 + 0.006 * np.cos(round_)], 1
    )
    right = [*shoulder, (0.0970, 0.0030), (0.0945, 0), (0.058, 0), (0.054, 0.003)]
    left = [(-x, up) for x, up in reversed(right)]
    return [tuple(map(float, point)) for point in [*hollow, *right, *left]]


def cat_eye(tint: tuple, vanes: list[tuple], seed: int) -> list[Part]:
    """A glass marble with twisted vanes of colour inside."""
    rng = np.random.default_rng(seed)
    along, across = np.meshgrid(
        np.linspace(-1, 1, 33), np.linspace(-1, 1, 11), indexing="ij"
    )
    lean = (
        T()
        .rotate([0, 1, 0], float(rng.uniform(20, 60)))
        .rotate([1, 0, 0], float(rng.uniform(-40, 40)))
    )
    frame = np.array(lean.matrix)[:3, :3]
    parts: list[Part] = [sphere(RADIUS, glass(tint))]
    i = (np.arange(32)[:, None] * 11 + np.arange(10)).ravel()
    faces = np.concatenate(
        [np.stack([i, i + 1, i + 12], 1), np.stack([i, i + 12, i + 11], 1)]
    )
    for k, colour in enumerate(vanes):
        turn = np.pi * k / len(vanes) + 1.1 * along + 0.25 * across**2
        wide = 0.66 * np.sqrt(np.clip(1 - along**2, 0, 1)) * across
        points = (
            np.stack(
                [wide * np.cos(turn), wide * np.sin(turn), 0.80 * along], -1
            ).reshape(-1, 3)
            * RADIUS
        )
        parts.append(
            Mesh(
                points @ frame.T,
                None,
                np.zeros((len(points), 2)),
                faces,
                both(matt(srgb(*colour))),
            )
        )
    return parts


def opaque(base: tuple, veins: list[tuple], seed: int) -> list[Part]:
    """A ceramic marble with swirls."""
    rng = np.random.default_rng(seed)
    turn = (
        T()
        .rotate([0, 0, 1], float(rng.uniform(0, 360)))
        .rotate([1, 0, 0], float(rng.uniform(40, 140)))
    )
    skin = swirl(
        512,
        srgb(*base),
        [(srgb(*colour), share) for colour, share in veins],
        seed,
        bands=1.1,
        warp=1.0,
    )
    return [sphere(RADIUS, glossy(texture(skin)), turn)]


def drape(
    width: float, height: float, at: tuple[float, float, float], bsdf: dict, seed: int
) -> Mesh:
    """A cloth that hangs in soft folds."""
    rng = np.random.default_rng(seed)
    x, z = np.meshgrid(
        np.linspace(-0.5, 0.5, 161) * width, np.linspace(-0.5, 0.5, 41) * height
    )
    y = 0 * x
    for wave, deep in ((0.31, 0.020), (0.17, 0.014), (0.11, 0.006), (0.07, 0.003)):
        y += deep * np.sin(
            2 * np.pi * (x + 0.12 * z * rng.normal()) / wave
            + rng.uniform(0, 6)
            + 0.8 * np.sin(3 * z)
        )
    dz, dx = np.gradient(y, z[:, 0], x[0])
    normals = np.stack([dx, -1 + 0 * x, dz], -1)
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    i = (np.arange(40)[:, None] * 161 + np.arange(160)).ravel()
    faces = np.concatenate(
        [np.stack([i, i + 1, i + 162], 1), np.stack([i, i + 162, i + 161], 1)]
    )
    points = np.stack([x, y, z], -1).reshape(-1, 3) + at
    return Mesh(
        points,
        normals.reshape(-1, 3),
        np.stack([x, z], -1).reshape(-1, 2) / 0.35,
        faces,
        both(bsdf),
    )


# name, label, parts
MARBLES = [
    (
        "red",
        "red and white marble",
        lambda: opaque(
            (226, 218, 200), [((178, 34, 30), 0.34), ((222, 120, 40), 0.12)], 2
        ),
    ),
    (
        "cat-eye",
        "glass marble, a blue cat's eye",
        lambda: cat_eye((0.97, 0.99, 0.98), [(34, 82, 176), (228, 226, 216)], 3),
    ),
    (
        "yellow",
        "yellow and green marble",
        lambda: opaque(
            (226, 178, 52), [((44, 112, 62), 0.3), ((240, 226, 190), 0.12)], 5
        ),
    ),
    (
        "blue",
        "blue marble",
        lambda: opaque(
            (36, 70, 140), [((206, 216, 220), 0.26), ((84, 160, 196), 0.2)], 7
        ),
    ),
    (
        "green-glass",
        "green glass marble",
        lambda: cat_eye((0.62, 0.92, 0.72), [(236, 196, 60), (212, 88, 36)], 9),
    ),
    (
        "brown",
        "brown and cream marble",
        lambda: opaque(
            (104, 58, 36), [((222, 198, 156), 0.32), ((44, 30, 28), 0.2)], 11
        ),
    ),
]


def stage() -> Stage:
    camera = Camera(
        "side", height=0.236, centre=(0, 0.048), rise=(0.0, 0.23), aperture=0.042
    )
    section = trough()
    x, up = np.array(section).T
    area = abs(np.sum(x * np.roll(up, -1) - np.roll(x, -1) * up)) / 2
    cherry = wood(
        1024,
        1024,
        srgb(112, 62, 36),
        srgb(190, 128, 82),
        seed=21,
        rings=15,
        figure=0.05,
    )
    body = extrude(
        section,
        DEEP,
        satin(texture(used(cherry, 3, 0)), 0.28),
        0.0012,
        0.26,
        (0.5, 0.31),
    )
    things = [
        Thing(
            "trough",
            "wooden trough",
            [body],
            {"polygon": section},
            (0, 0),
            round(area * DEEP * 6.2e5),
            0.8,
            0.3,
        )
    ]
    for k, (name, label, make) in enumerate(MARBLES):
        turn = (1.5 + 4 * k - FACETS / 2) * FACET
        at = (
            (HOLLOW - RADIUS) * np.sin(turn),
            BASE + HOLLOW - (HOLLOW - RADIUS) * np.cos(turn),
        )
        more = {"solid": "sphere", "rolling": 0.002}
        things.append(
            Thing(name, label, make(), {"circle": RADIUS}, at, 5.4, 0.03, 0.75, **more)
        )
    oak = wood(
        1024, 2048, srgb(62, 40, 26), srgb(122, 84, 54), seed=8, rings=14, figure=0.03
    )
    scenery = {
        "table": floor(1.5, 1.3, satin(texture(used(oak, 5)), 0.24), (0.02, -0.38, 0)),
        "cloth": drape(
            2.4, 1.2, (0, 0.52, 0.3), matt(texture(linen(512, srgb(46, 56, 64), 1))), 4
        ),
    }
    for k, (name, turn, high, wide, colour) in enumerate(
        [
            ("green", 8, 0.026, 0.15, (58, 78, 62)),
            ("red", -5, 0.022, 0.135, (128, 52, 42)),
        ]
    ):
        lay = T().translate([0.115, 0.185, 0.026 * k]).rotate([0, 0, 1], turn)
        cover = [
            rounded_box((wide, 0.10, 0.003), matt(srgb(*colour)), 0.001),
            rounded_box((wide, 0.10, 0.003), matt(srgb(*colour)), 0.001),
        ]
        pages = rounded_box(
            (wide - 0.006, 0.094, high - 0.006), matt(srgb(168, 150, 118)), 0.001
        )
        for i, (part, up_) in enumerate(
            [(cover[0], 0.0015), (cover[1], high - 0.0015), (pages, high / 2)]
        ):
            scenery[f"book-{name}-{i}"] = moved(part, lay @ T().translate([0, 0, up_]))
    lights = {}
    for k, (along, up_) in enumerate(
        [(-0.17, -0.2), (0.17, -0.2), (-0.17, 0.2), (0.17, 0.2)]
    ):  # four panes
        at = np.array([-1.05 + 0.4 * along, -0.48 - 0.9 * along, 0.60 + up_])
        lights[f"pane-{k}"] = panel(
            at,
            at + np.array([0.9, 0.4, -0.34]),
            (0.30, 0.36),
            np.array([0.94, 0.98, 1.0]) * 30,
        )
    lights["room"] = sky(
        (0.34, 0.34, 0.36),
        (0.27, 0.25, 0.23),
        (0.1, 0.09, 0.07),
        [((0.9, -0.5, 0.35), 14, (0.9, 0.75, 0.55))],
    )

    def sections(c: Camera) -> dict:
        return {
            "render": {
                "frames": 108,
                "fps": 30,
                "hold": 8,
                "contact_shade": True,
                "smooth_outlines": True,
            },
            "variants": {
                "pushed": {
                    "forces": [{"object": "trough", "impulse": c.push((0.085, 0))}]
                },
                "rough": {"objects.*.friction": 0.6},
                "one-against-four": {
                    "objects.yellow": None,
                    "objects.red.velocity": c.shift((0.3, -0.9)),
                },
                "steel": {"objects.*.mass": 16, "objects.trough.mass": 60},
            },
            "comments": {
                "variants.pushed": "the trough slides along the table and stops, its marbles do not",
                "variants.rough": "marbles that touch would turn against each other: now they stop each other",
                "variants.steel": "heavy marbles in a trough of balsa",
            },
        }

    return Stage(
        "marbles",
        "Six marbles in a trough",
        "Six marbles, all touching, let go at one side of a wooden trough: they run down together and up the other side,\n"
        "to and fro in 0.7 s, shown at two thirds of the true speed. Polished, they slip where they touch each other.\n"
        "The trough only stands on the table: it is an object like the marbles, and its outline is hollow.",
        camera,
        things,
        scenery,
        lights,
        {"table": Boundary([(-2, 0), (2, 0)], 0.3, 0.3)},
        duration=2.4,
        softness=16,
        exposure=1.8,
        depth=10,
        sections=sections,
    )
