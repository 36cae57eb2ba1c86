"""Six cartons at the top of a plywood ramp in a warehouse, in low sun that falls through an open door at the left."""

import numpy as np
from lights import DAY, sky, sun
from materials import matt
from optics import T
from shapes import floor, moved, rounded_box, wall
from stage import Boundary, Camera, Stage, Thing
from textures import srgb, wood
from textures_workshop import brickwork, carton, kraft, plies, stone, worn

SLOPE = np.radians(28)
DOWN, OUT = (
    np.array([np.cos(SLOPE), -np.sin(SLOPE)]),
    np.array([np.sin(SLOPE), np.cos(SLOPE)]),
)
PALLET, SHEET, DEEP = (
    0.144,
    0.021,
    0.26,
)  # m: a pallet's height, the plywood, how deep the cartons are
HEAP = 6  # pallets below the ramp's top
CORNER = np.array([-0.85, HEAP * PALLET])  # where the sheet leans on the pallets
FOOT = np.array([CORNER[0] + CORNER[1] / np.tan(SLOPE), 0])
LONG = CORNER[1] / np.sin(SLOPE) + 0.06
TOP = FOOT - LONG * DOWN + SHEET * OUT  # upper end of the surface
CARTONS = [  # along the ramp from its top, above it, wide, tall (m), mass (g), marks
    ("carton-1", 0.06, 0.0, 0.36, 0.26, 5200, "FRAGILE"),
    ("carton-2", 0.43, 0.0, 0.32, 0.26, 3900, "THIS SIDE|UP"),
    ("carton-3", 0.77, 0.0, 0.30, 0.32, 4600, ""),
    ("carton-4", 0.20, 0.26, 0.38, 0.22, 2800, "GLASS"),
    ("carton-5", 0.26, 0.48, 0.26, 0.20, 1500, ""),
    ("carton-6", 0.80, 0.32, 0.24, 0.18, 1200, "KEEP DRY"),
]
PUSHED = (1.16016, -0.52734)  # m/s of carton-5 after the stick, down the ramp


def box(
    number: int,
    name: str,
    along: float,
    above: float,
    wide: float,
    tall: float,
    mass: float,
    marks: str,
) -> Thing:
    at = TOP + DOWN * (along + wide / 2) + OUT * (above + tall / 2)
    body = rounded_box(
        (wide, DEEP, tall),
        matt(kraft(384, 384, number)),
        0.004,
        0.5,
        (0.1 * number, 0),
        "y",
    )
    front = wall(
        wide - 0.005,
        tall - 0.005,
        matt(carton((wide, tall), number, marks)),
        (0, -DEEP / 2 - 0.0004, 0),
    )
    tape = moved(
        rounded_box((0.05, DEEP + 0.0006, 0.0006), matt(srgb(186, 148, 98)), 0.0002),
        T().translate([0, 0, tall / 2]),
    )
    return Thing(
        name,
        "cardboard box",
        [body, front, tape],
        {"box": (wide, tall)},
        tuple(at),
        mass,
        0.45,
        0.1,
        28,
        velocity=PUSHED if name == "carton-5" else None,
        extra={"static_friction": 1},
    )


def pallets() -> dict:
    found, rng = {}, np.random.default_rng(3)
    boards = [
        matt(
            wood(
                256,
                768,
                srgb(*(np.array((106, 92, 74)) + k * 8)),
                srgb(*(np.array((168, 148, 120)) + k * 8)),
                k,
                6,
            )
        )
        for k in range(3)
    ]
    for level in range(HEAP):
        off, up = (
            (rng.normal(0, 0.006) if level < HEAP - 1 else 0)
            - 0.004 * (level < HEAP - 1),
            level * PALLET,
        )

        def put(
            name: str,
            size: tuple[float, float, float],
            at: tuple[float, float, float],
            level: int = level,
            off: float = off,
            up: float = up,
        ) -> None:
            skin = boards[rng.integers(3)]
            part = rounded_box(size, skin, 0.0015, 0.5, tuple(rng.random(2)))
            found[f"pallet-{level}-{name}"] = moved(
                part, T().translate([CORNER[0] - 0.6 + off + at[0], at[1], up + at[2]])
            )

        for row, y in enumerate((-0.35, 0.0, 0.35)):
            put(f"skid-{row}", (1.2, 0.1, 0.022), (0, y, 0.011))
            for k, x in enumerate((-0.5275, 0, 0.5275)):
                put(f"block-{row}-{k}", (0.145, 0.1, 0.078), (x, y, 0.061))
        for k in range(7):
            put(f"deck-{k}", (0.12, 0.8, 0.044), (-0.54 + 0.18 * k, 0, 0.122))
    return found


def rack() -> dict:
    """Shelves full of goods at the back, out of focus."""
    found, rng = {}, np.random.default_rng(8)
    blue, orange = (
        matt(worn(srgb(44, 74, 120), 128, 128, 1)),
        matt(worn(srgb(196, 98, 36), 128, 128, 2)),
    )
    goods = [matt(kraft(128, 128, 40 + k)) for k in range(4)] + [
        matt(srgb(70, 84, 92)),
        matt(srgb(150, 152, 150)),
    ]
    for k, x in enumerate((-2.3, -0.75, 0.8, 2.35)):
        for y in (2.7, 3.6):
            found[f"upright-{k}-{y:.0f}"] = moved(
                rounded_box((0.09, 0.07, 4.0), blue, 0.004), T().translate([x, y, 2.0])
            )
    for level, up in enumerate((1.05, 2.05, 3.0)):
        found[f"beam-{level}"] = moved(
            rounded_box((5.0, 0.05, 0.11), orange, 0.004),
            T().translate([0, 2.68, up - 0.06]),
        )
        found[f"deck-{level}"] = moved(
            rounded_box((5.0, 0.9, 0.02), goods[5], 0.004),
            T().translate([0, 3.15, up - 0.01]),
        )
    for level, up in enumerate((0.0, 1.05, 2.05)):
        x = -2.6
        while x < 2.6:
            wide, tall = rng.uniform(0.3, 0.6), rng.uniform(0.28, 0.75)
            at = [x + wide / 2, 3.1 + rng.uniform(-0.1, 0.1), up + tall / 2]
            skin = goods[rng.choice(6, p=[0.2, 0.2, 0.2, 0.2, 0.1, 0.1])]
            found[f"goods-{level}-{len(found)}"] = moved(
                rounded_box((wide, 0.6, tall), skin, 0.006), T().translate(at)
            )
            x += wide + rng.choice([0.02, 0.04, 0.25])
    return found


def stage() -> Stage:
    camera = Camera(
        "side",
        height=2.7,
        centre=(0.24, 0.97),
        distance=6.0,
        rise=(0, 0.36),
        aperture=0.07,
    )
    veneer = matt(wood(768, 1536, srgb(184, 140, 92), srgb(220, 184, 138), 17, 4, 0.12))
    sheet = TOP + DOWN * LONG / 2 - OUT * SHEET / 2
    tilt = T().translate([sheet[0], 0, sheet[1]]).rotate([0, 1, 0], 28)
    dim = matt(srgb(120, 118, 112))
    side = T().translate([-4, 0, 0]).rotate([0, 1, 0], 90)

    def pier(y: tuple[float, float], z: tuple[float, float]) -> dict:
        """A piece of the wall at the left, around its door."""
        size = (
            T()
            .translate([-(z[0] + z[1]) / 2, (y[0] + y[1]) / 2, 0])
            .scale([(z[1] - z[0]) / 2, (y[1] - y[0]) / 2, 1])
        )
        return {
            "type": "rectangle",
            "to_world": side @ size,
            "bsdf": {"type": "twosided", "bsdf": dim},
        }

    concrete = matt(stone(1024, 1024, srgb(146, 142, 134), 12, 0.05, 0.05))
    bricks = matt(
        brickwork(768, 1024, 48, 28, srgb(150, 96, 74), srgb(150, 144, 134), 3)
    )
    scenery = {
        "floor": floor(9, 9, concrete, (0, 1.5, 0)),
        "line": floor(
            9,
            0.1,
            matt(worn(srgb(196, 160, 52), 32, 1024, 6, 0.1, 0.8)),
            (0, 1.9, 0.001),
        ),
        "bricks": wall(9, 6, bricks, (0, 4.6, 3)),
        "sheet": moved(
            rounded_box((LONG, 0.9, SHEET), veneer, 0.001, 1.9, (0.5, 0.3)), tilt
        ),
        "plies": moved(
            wall(
                LONG - 0.002,
                SHEET - 0.001,
                matt(plies(96, 1536, 9, 4)),
                (0, -0.4505, 0),
            ),
            tilt,
        ),
        "door-lintel": pier((-14, 7), (3.0, 9)),
        "door-near": pier((-14, -4.2), (0, 3.0)),
        "door-far": pier((-1.2, 7), (0, 3.0)),
        **pallets(),
        **rack(),
    }
    lights = {
        "sun": sun((-0.85, -0.45, 0.32), DAY * [1.0, 0.93, 0.80] * 5.2, 0.3),
        "sky": sky((0.40, 0.43, 0.47), (0.34, 0.35, 0.36), (0.16, 0.15, 0.13)),
    }
    story = """Six cartons rest on a plywood ramp. A stick pushes the top one, which takes two others along.
The ramp is a boundary like the floor. Cartons at rest hold by their static friction."""
    return Stage(
        "ramp",
        "A carton starts a slide",
        story,
        camera,
        [box(k, *carton_) for k, carton_ in enumerate(CARTONS, 1)],
        scenery,
        lights,
        {
            "ramp": Boundary(
                [
                    tuple(TOP - SHEET * OUT),
                    tuple(TOP),
                    tuple(TOP + DOWN * LONG),
                    tuple(FOOT),
                ],
                0.2,
                0.05,
                "plywood",
                static_friction=1.5,
            ),
            "floor": Boundary([tuple(FOOT), (6, 0)], 0.6, 0.1),
        },
        duration=2.6,
        world={"ramp": 0.12},
        softness=0.3,
        sun=(-0.85, -0.45, 0.32),
        exposure=1.8,
        diffuse=True,
        sections=lambda c: {
            "render": {
                "slow": 1.5,
                "hold": 12,
                "enter": "stick",
                "contact_shade": True,
                "smooth_outlines": True,
            },
            "variants": {
                "waxed": {
                    "boundaries.ramp.friction": 0.06,
                    "boundaries.ramp.static_friction": 0.06,
                },
                "heavy-on-top": {"objects.carton-5.mass": 15000},
                "without-the-lowest": {
                    "objects.carton-3": None,
                    "objects.carton-6": None,
                },
            },
            "comments": {
                "world.ramp": "the time in which the stick pushes",
                "variants.waxed": "all of them slide at once",
            },
        },
    )
