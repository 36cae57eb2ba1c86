"""A red wooden toy car, a ramp and two blocks on a birch table, overcast daylight; a crowded shelf blurred behind."""

import numpy as np
from lights import BLUE, DAY, panel, sky
from materials import glossy, matt, rubber, satin
from optics import T
from shapes import extrude, lathe, moved, rod, rounded_box, wall
from stage import Boundary, Camera, Part, Stage, Thing, tidy
from textures import plaster, srgb, wood
from textures_home import digit, painted, rounded

WHEEL = 0.0175  # m, radius
AXLES = (-0.042, 0.040)
BLOCK = 0.046
CAR = -0.212  # m, where its middle stands
RAMP = ((-0.075, 0.0), (0.045, 0.034), (0.045, 0.0))
BODY = [
    (-6.3, 1.2),
    (-6.3, 1.2),
    (6.3, 1.2),
    (6.3, 1.2),
    (6.8, 2.4),
    (6.4, 3.7),
    (3.8, 4.1),
    (2.2, 6.3),
    (0, 6.7),
]
BODY += [(-2.6, 6.5), (-4.5, 4.5), (-6.4, 4.3), (-6.9, 2.6)]
WINDOWS = [
    [(-0.5, 4.2), (-0.5, 5.9), (1.6, 5.8), (2.9, 4.2)],
    [(-1.1, 4.2), (-1.1, 5.9), (-2.3, 5.8), (-3.7, 4.2)],
]


def wheels() -> list[Part]:
    """A pair on its axle: turned beech, a rubber tyre, five painted dots that show how it turns."""
    size, across = 256, np.arange(512) / 512
    v = (np.arange(size) / size)[
        :, None
    ]  # along the profile: the rim lies in the middle
    dots = (
        np.hypot((across * 5 % 1 - 0.5) * 0.16, np.minimum(v, 1 - v) - 0.26) < 0.045
    )[..., None]
    face = wood(size, 512, srgb(176, 132, 84), srgb(212, 172, 122), seed=4, rings=5)
    hub = satin(np.where(dots, srgb(170, 44, 36), face), 0.3)
    disc = lathe(
        [
            (0.0001, -0.0046),
            (0.0115, -0.0042),
            (0.013, -0.003),
            (0.013, 0.003),
            (0.0115, 0.0042),
            (0.0001, 0.0046),
        ],
        hub,
        "y",
    )
    bend = np.linspace(-np.pi / 2, np.pi / 2, 9)
    tread = np.stack([WHEEL - 0.0022 + 0.0022 * np.cos(bend), 0.0022 * np.sin(bend)], 1)
    tread[:, 1] += np.sign(np.round(bend, 6)) * 0.0018
    tyre = lathe(
        [(0.0128, -0.004), *tread, (0.0128, 0.004)], rubber(srgb(44, 43, 42)), "y"
    )
    pair = [
        moved(part, T().translate([0, y, 0]))
        for y in (-0.0242, 0.0242)
        for part in (disc, tyre)
    ]
    return [
        *pair,
        rod((0, -0.0295, 0), (0, 0.0295, 0), 0.0022, satin(srgb(150, 110, 70))),
    ]


def body() -> list[Part]:
    """The car's body about its middle on the table, facing right."""
    outline = rounded(np.array(BODY) * 0.01, 3)
    coat = satin(painted(700, 900, srgb(176, 46, 38), 2, 0.035), 0.16)
    parts: list[Part] = [extrude(outline, 0.038, coat, 0.003, 0.15, (0.6, 0.1))]
    pane, sticker = (
        glossy(srgb(212, 206, 188)),
        satin(digit("7", srgb(222, 216, 198), srgb(40, 40, 44)), 0.25),
    )
    for side in (-1, 1):
        for window in WINDOWS:
            glass = extrude(
                rounded(np.repeat(np.array(window) * 0.01, 2, 0), 2),
                0.0012,
                pane,
                0.0004,
            )
            parts.append(moved(glass, T().translate([0, side * 0.0192, 0])))
    angle = np.linspace(0, 2 * np.pi, 41)[:-1]
    disc = extrude(
        0.0098 * np.stack([np.cos(angle), np.sin(angle)], 1),
        0.0008,
        sticker,
        0.0003,
        0.02,
        (0.5, 0.5),
    )
    parts.append(moved(disc, T().translate([0, -0.0192, 0.0285])))
    lamp = lathe(
        [(0.0056, 0), (0.005, 0.003), (0.0001, 0.004)], glossy(srgb(214, 184, 96)), "x"
    )
    parts += [moved(lamp, T().translate([0.0645, y, 0.030])) for y in (-0.010, 0.010)]
    return parts


def clutter() -> dict[str, Part]:
    """Two shelves of boxes, books and jars, a metre behind the table."""
    rng = np.random.default_rng(12)
    tones = [
        (60, 88, 104),
        (178, 150, 104),
        (196, 190, 176),
        (150, 74, 54),
        (92, 108, 80),
        (204, 160, 76),
        (64, 60, 62),
        (140, 124, 150),
    ]
    things: dict[str, Part] = {
        "back": wall(
            3, 2, matt(plaster(256, 384, srgb(188, 186, 178), 1)), (0, 1.3, 0.2)
        )
    }
    plank = satin(srgb(188, 160, 122), 0.3)
    for row, low in enumerate((-0.31, 0.07, 0.45)):
        things[f"plank-{row}"] = moved(
            rounded_box((2.4, 0.28, 0.02), plank), T().translate([0, 1.12, low - 0.01])
        )
        x = -0.62
        while x < 0.62:
            wide, high, kind = (
                rng.uniform(0.02, 0.045),
                rng.uniform(0.15, 0.26),
                rng.random(),
            )
            tone = srgb(*tones[rng.integers(len(tones))])
            if kind < 0.16:
                wide, high = rng.uniform(0.08, 0.12), rng.uniform(0.10, 0.16)
                r = wide / 2
                pot = lathe(
                    [
                        (0.001, 0),
                        (r, 0),
                        (r, high * 0.8),
                        (r * 0.7, high),
                        (0.001, high),
                    ],
                    glossy(tone),
                )
                things[f"jar-{row}-{round(1000 * x)}"] = moved(
                    pot, T().translate([x + r, 1.10, low])
                )
            elif kind < 0.30:
                wide, high = rng.uniform(0.10, 0.18), rng.uniform(0.07, 0.14)
            if kind >= 0.16:
                box = rounded_box((wide, 0.17, high), satin(tone, 0.3), 0.002)
                things[f"box-{row}-{round(1000 * x)}"] = moved(
                    box, T().translate([x + wide / 2, 1.10, low + high / 2])
                )
            x += wide + (rng.uniform(0.02, 0.10) if rng.random() < 0.3 else 0.002)
    return things


def wheel_spin(speed: float, digits: int) -> int:
    """Spin of a wheel that rolls at `speed` m/s, degrees/s, rounded to `digits`."""
    return int(round(float(np.degrees(speed / WHEEL)), digits))


def stage() -> Stage:
    camera = Camera(
        "side", height=0.60, centre=(0.0, 0.20), rise=(0.05, 0.27), aperture=0.07
    )
    parts = body()
    drive = 1.6  # m/s, from the finger's push
    things = [
        Thing(
            "car",
            "toy car",
            parts,
            {"polygon": rounded(np.array(BODY) * 0.01, 1).tolist()},
            (CAR, 0),
            150,
            0.4,
            0.3,
            velocity=(drive, 0),
        )
    ]
    for name, x in zip(("rear-wheels", "front-wheels"), AXLES, strict=True):
        at = CAR + x, WHEEL
        note = (
            "A pair of wheels on their axle, pinned to the car (see joints)."
            if name == "rear-wheels"
            else ""
        )
        wheel = Thing(
            name,
            "wheel",
            wheels(),
            {"circle": WHEEL},
            at,
            18,
            0.8,
            0.3,
            solid="disc",
            rolling=0.004,
            velocity=(drive, 0),
            spin=wheel_spin(drive, -1),
            note=note,
            extra={"layer": 1},
        )
        things.append(wheel)
    for k, (tone, lean) in enumerate(
        [((60, 104, 140), -0.002), ((208, 160, 62), 0.002)]
    ):
        grain = painted(400, 400, srgb(*tone), 8 + k, 0.07)
        block = rounded_box(
            (BLOCK, BLOCK, BLOCK), satin(grain, 0.32), 0.0018, 0.09, (0.3 * k, 0.2)
        )
        at = 0.125 + lean, (k + 0.5) * BLOCK
        things.append(
            Thing(
                f"block-{k + 1}",
                "wooden block",
                [block],
                {"box": (BLOCK, BLOCK)},
                at,
                70,
                0.5,
                0.3,
            )
        )
    birch = satin(
        wood(
            1024,
            2048,
            srgb(186, 150, 108),
            srgb(218, 188, 146),
            seed=6,
            rings=24,
            figure=0.05,
        ),
        0.35,
    )
    beech = satin(
        wood(512, 512, srgb(150, 104, 64), srgb(196, 150, 104), seed=2, rings=6), 0.3
    )
    scenery = {
        "table": moved(
            rounded_box((2.6, 1.6, 0.03), birch, 0.002, 2.8, (0.5, 0.2)),
            T().translate([0, -0.3, -0.015]),
        ),
        "ramp": extrude(RAMP, 0.085, beech, 0.0007, 0.14),
    } | clutter()
    lights = {
        "window": panel((-1.3, -1.1, 1.5), (0, 0, 0), (1.5, 1.2), DAY * BLUE * 5.2),
        "room": sky(
            (0.75, 0.8, 0.86),
            (0.5, 0.5, 0.5),
            (0.22, 0.2, 0.18),
            [((-0.5, -1, 0.55), 20, BLUE * 1.6)],
        ),
    }

    def all_at(c: Camera, speed: float, digits: int = 0) -> dict:
        names = "car", "rear-wheels", "front-wheels"
        spin = wheel_spin(speed, digits)
        faster = {f"objects.{name}.velocity": c.shift((speed, 0)) for name in names}
        return faster | {f"objects.{name}.spin": spin for name in names[1:]}

    def sections(c: Camera) -> dict:
        pins = zip(("rear-wheels", "front-wheels"), AXLES, strict=True)
        pivot = {
            n: {"objects": [n, "car"], "pivot": tidy(c.pixel((CAR + x, WHEEL)))}
            for n, x in pins
        }
        return {
            "joints": {
                "rear-axle": pivot["rear-wheels"],
                "front-axle": pivot["front-wheels"],
            },
            "render": {
                "slow": 3,
                "hold": 12,
                "enter": "finger",
                "contact_shade": True,
                "smooth_outlines": True,
            },
            "variants": {
                "slow": all_at(c, 0.9375, -1) | {"world.duration": 1.2},
                "stunt": all_at(c, 2.8),
                "heavy-blocks": {
                    "objects.block-1.mass": 1100,
                    "objects.block-2.mass": 1100,
                },
                "free-road": {
                    "objects.block-1": None,
                    "objects.block-2": None,
                    "world.duration": 0.6,
                },
                "on-the-moon": {"world.gravity": c.shift((0, -1.62))},
            },
            "comments": {
                "world.ramp": "the time in which the finger pushes",
                "variants.slow": "stops on top of the ramp",
                "variants.heavy-blocks": "lead in place of wood: the car falls back",
            },
        }

    return Stage(
        "toy-car",
        "A toy car jumps onto a block",
        "A finger pushes a toy car to 1.6 m/s: it jumps off a ramp, knocks the upper block away and takes its place.\n"
        "Its wheels turn on pins. The video plays at a third of the true speed.",
        camera,
        things,
        scenery,
        lights,
        {
            "table": Boundary([(-2, 0), (2, 0)], 0.5, 0.3),
            "ramp": Boundary(list(RAMP), 0.5, 0.2, "The ramp is nailed down."),
        },
        duration=0.9,
        softness=17,
        exposure=1.25,
        world={"steps_per_second": 1920, "ramp": 0.1},
        sections=sections,
    )
