"""A brass ball on a thread, let go towards a tower of offcuts on a workbench; daylight from a window at the left."""

import numpy as np
from lights import panel, sky
from materials import BRASS, STEEL, glossy, matt, metal, satin
from optics import T
from shapes import extrude, lathe, moved, ring, rod, rounded_box, sphere, wall
from stage import Boundary, Camera, Stage, Thing
from textures import srgb, wood
from textures_workshop import cork, pegboard, workbench, worn

PIN = np.array([0.02, 0.438])  # m, the eye screw
THREAD, RADIUS, RAISED = 0.32, 0.024, 60  # m, m, degrees
POST, BEAM, THICK = (0.028, 0.064), (0.125, 0.022), 0.034  # m
WOODS = [(206, 166, 116), (126, 84, 56), (190, 132, 96), (220, 186, 140)]


def ball() -> Thing:
    lean = np.radians(RAISED)
    to_pin = np.array([np.sin(lean), 0, np.cos(lean)])
    smudged = worn(np.array(BRASS), 256, 512, 8, 0.05, 0.22)
    brass = metal(rough=0.13, tint=smudged)
    eye = moved(
        ring(0.0035, 0.0009, metal(rough=0.2, tint=BRASS)),
        T().translate(list(to_pin * (RADIUS + 0.002))),
    )
    thread = rod(
        to_pin * (RADIUS + 0.005), to_pin * THREAD, 0.0011, matt(srgb(206, 192, 160))
    )
    at = PIN - THREAD * to_pin[[0, 2]]
    note = "solid brass; its thread weighs nothing"
    parts = [sphere(RADIUS, brass, T().rotate([1, 0, 0], 70)), eye, thread]
    return Thing(
        "ball",
        "brass ball",
        parts,
        {"circle": RADIUS},
        tuple(at),
        492,
        0.3,
        0.5,
        solid="sphere",
        note=note,
    )


def offcut(
    name: str, label: str, size: tuple[float, float], at: tuple[float, float], seed: int
) -> Thing:
    rng = np.random.default_rng(seed)
    tone = np.array(WOODS[seed % 4]) + rng.normal(0, 5, 3)
    grain = "x" if size[0] > size[1] else "z"
    skin = matt(wood(384, 384, srgb(*(tone * 0.7)), srgb(*tone), seed, 5, 0.05))
    body = rounded_box(
        (size[0], THICK, size[1]), skin, 0.0012, 0.09, tuple(rng.random(2)), grain
    )
    twist = T().rotate([0, 0, 1], rng.normal(0, 1.5))
    mass = round(0.62e6 * size[0] * size[1] * THICK)
    return Thing(name, label, [moved(body, twist)], {"box": size}, at, mass, 0.5, 0.25)


def tower() -> list[Thing]:
    things, rng, up = [], np.random.default_rng(5), 0.0
    middle = PIN[0] + RADIUS + 0.006 + BEAM[0] / 2
    for storey in range(3):
        for side, name in ((-1, "left"), (1, "right")):
            x = (
                middle
                + side * (BEAM[0] / 2 - POST[0] / 2 - 0.002)
                + rng.normal(0, 0.001)
            )
            at = (x, up + POST[1] / 2)
            things.append(
                offcut(
                    f"post-{storey + 1}-{name}", "wooden block", POST, at, len(things)
                )
            )
        up += POST[1]
        at = (middle + rng.normal(0, 0.001), up + BEAM[1] / 2)
        things.append(
            offcut(f"beam-{storey + 1}", "wooden plank", BEAM, at, len(things))
        )
        up += BEAM[1]
    peak = [(-0.034, 0), (0.034, 0), (0, 0.034)]
    roof = extrude(peak, THICK, matt(cork(512, 512, 3)), 0.001, 0.12)
    things.append(
        Thing(
            "roof", "cork roof", [roof], {"polygon": peak}, (middle, up), 13, 0.6, 0.4
        )
    )
    return things


def tools() -> dict:
    """On the board, out of focus: two hammers' worth of shapes is enough."""
    ash, steel = (
        matt(srgb(176, 132, 84)),
        metal(rough=0.25, tint=np.array(STEEL) * 0.62),
    )
    dark = satin(srgb(44, 44, 46), 0.3)
    back = 0.53
    found = {}

    def put(name: str, part: object, x: float, up: float, turn: float = 0.0) -> None:
        found[name] = moved(part, T().translate([x, back, up]).rotate([0, 1, 0], turn))

    put(
        "saw-blade",
        extrude(
            [(-0.17, -0.01), (0.17, -0.055), (0.17, 0.05), (-0.17, 0.03)],
            0.002,
            steel,
            0.0005,
        ),
        -0.06,
        0.34,
        -4,
    )
    put(
        "saw-handle",
        extrude(
            [(0.16, -0.065), (0.25, -0.05), (0.27, 0.05), (0.16, 0.06)],
            0.02,
            ash,
            0.006,
        ),
        -0.06,
        0.34,
        -4,
    )
    put("hammer-handle", rounded_box((0.026, 0.02, 0.26), ash, 0.008), -0.345, 0.18, 3)
    put("hammer-head", rounded_box((0.11, 0.028, 0.032), dark, 0.006), -0.34, 0.31, 3)
    for k, colour in enumerate(
        [(176, 44, 36), (214, 160, 40), (176, 44, 36), (36, 74, 120), (38, 40, 42)]
    ):
        x, tall = 0.235 + 0.034 * k, 0.095 - 0.008 * k
        put(
            f"driver-{k}",
            rounded_box((0.024, 0.024, tall), glossy(srgb(*colour)), 0.008),
            x,
            0.31,
        )
        put(
            f"shank-{k}",
            rod((0, 0, -tall / 2), (0, 0, -tall / 2 - 0.1 + 0.012 * k), 0.0035, steel),
            x,
            0.31,
        )
    for k in range(4):
        x, tall = -0.20 + 0.04 * k, 0.14 - 0.02 * k
        put(f"spanner-{k}", rounded_box((0.013, 0.006, tall), steel, 0.002), x, 0.16)
        put(f"spanner-ring-{k}", ring(0.012, 0.005, steel), x, 0.16 + tall / 2 + 0.01)
        put(
            f"spanner-jaw-{k}",
            rounded_box((0.028, 0.007, 0.024), steel, 0.004),
            x,
            0.16 - tall / 2,
        )
    return found


def stage() -> Stage:
    camera = Camera(
        "side", height=0.62, centre=(0, 0.22), rise=(0, 0.18), aperture=0.05
    )
    planks = wood(1024, 2048, srgb(122, 88, 58), srgb(184, 142, 100), 21, 18, 0.03)
    plank = wood(512, 1024, srgb(150, 116, 80), srgb(198, 160, 116), 9, 8, 0.04)
    oak = matt(workbench(1024, 2048, planks, 4))
    tin = lathe(
        [(0.001, 0), (0.054, 0), (0.054, 0.12), (0.001, 0.12)],
        satin(worn(srgb(196, 190, 176), 256, 512, 2), 0.3),
    )
    jar = lathe(
        [(0.001, 0), (0.036, 0), (0.04, 0.01), (0.04, 0.1)], glossy(srgb(112, 62, 30))
    )
    white, red = satin(srgb(206, 202, 190), 0.25), satin(srgb(170, 40, 32), 0.25)
    scenery = {
        "bench": moved(
            rounded_box((2.6, 0.85, 0.05), oak, 0.004, 1.3),
            T().translate([0, 0.145, -0.025]),
        ),
        "apron": wall(2.6, 0.4, matt(srgb(52, 40, 32)), (0, -0.2, -0.25)),
        "board": wall(
            2.6,
            1.3,
            matt(pegboard(1024, 2048, srgb(134, 146, 146), 20, 3)),
            (0, 0.56, 0.4),
        ),
        "shelf": moved(
            rounded_box((2.2, 0.6, 0.022), satin(plank, 0.4), 0.002, 0.6),
            T().translate([0, 0.25, PIN[1] + 0.037]),
        ),
        "screw": rod(
            (PIN[0], 0, PIN[1] + 0.008),
            (PIN[0], 0, PIN[1] + 0.03),
            0.0013,
            metal(rough=0.2, tint=STEEL),
        ),
        "eye": moved(
            ring(0.005, 0.0012, metal(rough=0.2, tint=STEEL)),
            T().translate([PIN[0], 0, PIN[1] + 0.004]),
        ),
        "tin-1": moved(tin, T().translate([-0.22, 0.12, PIN[1] + 0.048])),
        "tin-2": moved(tin, T().translate([-0.09, 0.2, PIN[1] + 0.048])),
        "jar": moved(jar, T().translate([0.17, 0.14, PIN[1] + 0.048])),
        "glue": moved(
            lathe([(0.001, 0), (0.026, 0), (0.026, 0.07), (0.009, 0.1)], white),
            T().translate([0.245, 0.3, 0]),
        ),
        "cap": moved(
            lathe([(0.009, 0.1), (0.009, 0.112), (0.003, 0.13), (0.0005, 0.13)], red),
            T().translate([0.245, 0.3, 0]),
        ),
        "pencil": rod(
            (-0.17, 0.07, 0.0036),
            (-0.02, 0.11, 0.0036),
            0.0036,
            satin(srgb(204, 150, 38), 0.2),
        ),
        "lead": rod(
            (-0.02, 0.11, 0.0036),
            (-0.012, 0.112, 0.0036),
            0.0022,
            matt(srgb(190, 152, 104)),
        ),
        **tools(),
    }
    lights = {
        "window": panel(
            (-1.6, -1.2, 0.9), (0, 0, 0.15), (0.9, 1.2), np.array([1, 0.97, 0.92]) * 24
        ),
        "room": sky(
            (0.42, 0.43, 0.45),
            (0.3, 0.29, 0.27),
            (0.15, 0.12, 0.09),
            [((0.8, -0.5, 0.3), 12, np.array([1.2, 0.9, 0.6]))],
        ),
    }
    story = """A brass ball on a thread has just been let go. It swings down into a tower of offcuts on the workbench.
The pin of its thread is the joint below: move it, or hang a heavier ball on it."""
    return Stage(
        "pendulum",
        "A brass ball swings into a tower",
        story,
        camera,
        [ball(), *tower()],
        scenery,
        lights,
        {"bench": Boundary([(-2, 0), (2, 0)], 0.5, 0.2)},
        duration=1.5,
        softness=13,
        backdrop=0.56,
        exposure=1.25,
        film={"frames": 14, "until": 1.2},
        sections=lambda c: {
            "joints": {
                "thread": {
                    "objects": ["ball"],
                    "pivot": [float(v) for v in c.pixel(PIN).round(2)],
                }
            },
            "render": {
                "frames": 75,
                "fps": 25,
                "hold": 8,
                "contact_shade": True,
                "smooth_outlines": True,
            },
            "variants": {
                "wooden-ball": {
                    "objects.ball.mass": 41,
                    "objects.ball.label": "wooden ball",
                },
                "with-a-shove": {"objects.ball.velocity": c.shift((1.2, -2.08))},
                "on-the-moon": {
                    "world.gravity": c.shift((0, -1.62)),
                    "world.duration": 2.4,
                    "render.frames": 72,
                },
            },
            "comments": {"render": "Half speed."},
        },
    )
