"""Five rubber balls just let go before a whitewashed wall of a schoolyard; low evening sun from the left, hard shadows."""

import numpy as np
from lights import sky, sun
from materials import both, bumpy, matt, rubber, satin, texture
from optics import T
from shapes import floor, sphere, wall
from stage import Boundary, Camera, Mesh, Stage, Thing
from textures import srgb
from textures_stone import court, dusty, halves, limewash, putty, sponge, striped, swirl

DROP = 0.42  # m from the lowest points of all balls to the ground
WALL = 0.5  # m behind the balls
AZIMUTH, ELEVATION = (
    np.radians(31),
    np.radians(26),
)  # of the sun, from behind the camera to the left
SUN = np.array(
    [
        -np.sin(AZIMUTH) * np.cos(ELEVATION),
        -np.cos(AZIMUTH) * np.cos(ELEVATION),
        np.sin(ELEVATION),
    ]
)


def skins() -> list[dict]:
    """The five surfaces."""
    bouncy = [
        (srgb(226, 70, 48), 0.30),
        (srgb(246, 196, 44), 0.24),
        (srgb(40, 150, 92), 0.2),
        (srgb(238, 232, 214), 0.1),
    ]
    foam, pores = sponge(1024, srgb(232, 186, 58), 4)
    clay, dents = putty(1024, srgb(128, 124, 122), 6)
    return [
        satin(
            texture(
                dusty(swirl(1024, srgb(38, 84, 170), bouncy, 3, bands=1.5), 1, 0.12)
            ),
            0.09,
            1.52,
        ),
        satin(
            texture(dusty(striped(1024, srgb(186, 40, 38), srgb(226, 216, 194)), 2)),
            0.22,
            1.5,
        ),
        rubber(
            texture(
                dusty(halves(1024, srgb(222, 214, 196), srgb(44, 104, 168)), 3, 0.3)
            )
        ),
        bumpy(matt(texture(dusty(foam, 5, 0.15))), pores, 0.003),
        bumpy(satin(texture(clay), 0.45, 1.4), dents, 0.006),
    ]


# name, label, radius m, mass g, elasticity, x m, turn of the skin, drift m/s and spin degrees/s from the hand
BALLS = [
    ("super-ball", "super ball", 0.024, 58, 0.90, -0.288, (30, 20, 0), -0.009, 160),
    ("red-ball", "red rubber ball", 0.037, 95, 0.78, -0.170, (0, 28, 14), -0.018, 170),
    (
        "two-tone-ball",
        "blue and white rubber ball",
        0.031,
        110,
        0.64,
        -0.038,
        (15, -34, 0),
        0.033,
        -220,
    ),
    ("foam-ball", "foam rubber ball", 0.035, 30, 0.48, 0.092, (70, 0, 30), -0.022, 200),
    (
        "clay-ball",
        "clay-like rubber ball",
        0.028,
        150,
        0.25,
        0.212,
        (60, 40, 0),
        -0.018,
        140,
    ),
]


def leaves(spot: tuple[float, float], count: int, seed: int) -> Mesh:
    """Foliage out of the picture, whose shadow falls about `spot` (x, up) on the wall."""
    rng = np.random.default_rng(seed)
    middle = (
        np.array([spot[0], WALL, spot[1]])
        + SUN * 1.5
        + rng.normal(0, 1, (count, 1, 3)) * [0.16, 0.2, 0.08]
    )
    leaf = (
        np.array(
            [[-1, 0], [-0.3, 0.45], [0.5, 0.35], [1, 0], [0.5, -0.35], [-0.3, -0.45]]
        )
        * 0.028
    )
    axes = np.linalg.qr(rng.normal(0, 1, (count, 3, 3)))[0][:, :2] * rng.uniform(
        0.6, 1.3, (count, 1, 1)
    )
    vertices = (middle + np.einsum("kc,ncx->nkx", leaf, axes)).reshape(-1, 3)
    fan = np.array([[0, k, k + 1] for k in range(1, 5)])
    faces = (np.arange(count)[:, None, None] * 6 + fan).reshape(-1, 3)
    return Mesh(
        vertices,
        None,
        np.zeros((len(vertices), 2)),
        faces,
        both(matt(srgb(70, 96, 48))),
    )


def stage() -> Stage:
    camera = Camera(
        "side", height=0.76, centre=(0, 0.235), rise=(0.05, 0.36), aperture=0.022
    )
    things = []
    for skin, (name, label, radius, mass, elasticity, x, turn, drift, spin) in zip(
        skins(), BALLS, strict=True
    ):
        lie = (
            T()
            .rotate([0, 1, 0], turn[1])
            .rotate([1, 0, 0], turn[2])
            .rotate([0, 0, 1], turn[0])
        )
        ball, at = sphere(radius, skin, lie), (x, DROP + radius)
        more = {
            "solid": "sphere",
            "rolling": 0.01,
            "velocity": (drift, -0.3),
            "spin": spin,
        }
        things.append(
            Thing(
                name,
                label,
                [ball],
                {"circle": radius},
                at,
                mass,
                0.7,
                elasticity,
                **more,
            )
        )
    ground = matt(texture(court(2048, 2048, 3.2, 8)[::-1].copy()))
    paint, relief = limewash(2048, 2.4, 4)
    scenery = {
        "court": floor(3.2, 3.2, ground, (0, WALL - 1.6, 0)),
        "wall": wall(2.4, 2.4, bumpy(matt(paint), relief, 0.006), (0.1, WALL, 1.2)),
        "twig-1": leaves((-0.36, 0.60), 90, 1),
        "twig-2": leaves((0.34, 0.66), 60, 2),
    }
    lights = {
        "sun": sun(SUN, np.array([1.0, 0.84, 0.64]) * 4.4, 0.5),
        "sky": sky((0.26, 0.40, 0.62), (0.62, 0.66, 0.68), (0.16, 0.15, 0.13)),
    }

    def sections(c: Camera) -> dict:
        return {
            "render": {"sound": True},
            "variants": {
                "tossed": {
                    "objects.*.velocity": c.shift((0.25, 0.7)),
                    "objects.*.spin": -360,
                },
                "moon": {"world.gravity": c.shift((0, -1.62))},
                "rubber-mat": {"boundaries.ground.elasticity": 0.7},
                "all-super": {"objects.*.elasticity": 0.9},
            },
            "comments": {
                "world.combine": "the ground's own numbers are 1, so each ball's are what counts",
                "world.tilt": "8.5 at the balls, less towards the wall: its foot is seen at this",
                "variants.rubber-mat": "soft: every bounce is half as high",
            },
        }

    return Stage(
        "rubber-balls",
        "Five rubber balls bounce",
        "Five rubber balls, let go at once, here 42 cm up and already falling, each turning a little: side by side, and then each is itself.\n"
        "A ball comes back up to elasticity squared of the height: 34 cm for the super ball, 3 cm for the clay.",
        camera,
        things,
        scenery,
        lights,
        {"ground": Boundary([(-3, 0), (3, 0)], 1.0, 1.0)},
        duration=5.9,
        softness=0.5,
        sun=tuple(SUN),
        backdrop=0.5,
        exposure=0.88,
        world={"combine": "multiply", "tilt": 7.6},
        sections=sections,
        film={"frames": 12, "until": 0.91},
    )
