"""A leather ball on two books, a wooden elephant, three more books in a bookcase; a warm lamp, upper left."""

import numpy as np
from lights import WARM, bulb, sky
from materials import bumpy, glossy, matt, satin
from optics import T
from shapes import extrude, moved, rounded_box, sphere, wall
from stage import Boundary, Camera, Part, Stage, Thing
from textures import cloud, plaster, srgb, wood
from textures_home import book, leather_ball, painted, rounded, seascape, spine

BALL = 0.035  # m, radius
INSIDE = 0.28  # m from the middle to either side of the bookcase
LEAN = 9.0  # degrees
BODY = [
    (-2.9, 0),
    (-2.9, 0),
    (-3.0, 2.9),
    (-3.6, 3.3),
    (-4.2, 2.8),
    (-4.8, 1.7),
    (-5.8, 1.0),
    (-6.9, 1.1),
    (-7.0, 2.2),
]
BODY += [
    (-6.2, 2.4),
    (-5.7, 3.1),
    (-5.5, 4.4),
    (-5.3, 6.2),
    (-4.6, 7.5),
    (-3.4, 8.0),
    (-2.3, 7.5),
    (-1.3, 7.6),
]
BODY += [
    (0.8, 8.1),
    (3.2, 7.9),
    (4.8, 6.8),
    (5.2, 4.6),
    (4.6, 2.5),
    (4.4, 0),
    (4.4, 0),
    (2.1, 0),
    (2.1, 0),
    (2.0, 2.2),
]
BODY += [(1.4, 3.0), (0.1, 3.0), (-0.6, 2.2), (-0.7, 0), (-0.7, 0)]
EAR = [
    (-2.9, 7.1),
    (-1.2, 7.0),
    (-0.3, 5.8),
    (-0.5, 4.3),
    (-1.5, 3.6),
    (-2.4, 4.4),
    (-3.0, 5.8),
]


def elephant() -> list[Part]:
    """Sawn from a plank and painted, ears of bare walnut; facing left."""
    outline = rounded(np.array(BODY) * 0.01, 3)
    coat = satin(painted(700, 900, srgb(96, 120, 138), 5, 0.06), 0.3)
    walnut = satin(
        wood(300, 300, srgb(70, 44, 30), srgb(118, 78, 52), seed=8, rings=6), 0.3
    )
    parts: list[Part] = [extrude(outline, 0.034, coat, 0.003, 0.13, (0.6, 0.1))]
    ear = extrude(rounded(np.array(EAR) * 0.01, 3), 0.005, walnut, 0.0014, 0.06)
    for side in (-1, 1):
        parts.append(moved(ear, T().translate([0, side * 0.0193, 0])))
        parts.append(
            sphere(
                0.0032, glossy(srgb(24, 20, 20)), None, (-0.0415, side * 0.0158, 0.0595)
            )
        )
    return parts


def volume(
    number: int,
    size: tuple[float, float],
    colour: tuple,
    title: str,
    author: str,
    **rest: object,
) -> list[Part]:
    """A book of (thickness, height) m with a printed spine."""
    cream = srgb(222, 208, 176)
    tone = srgb(*colour)
    bands = [(a, b, srgb(*c)) for a, b, c in rest.get("bands", [])]
    ink = srgb(44, 40, 40) if rest.get("dark") else cream
    face = spine(size, tone, title, author, ink, bands, seed=20 + number, letter=0.40)
    shine = rest.get("shine")
    depth = 0.098 + 0.005 * (number % 3)
    return book(
        (size[0], depth, size[1]),
        face,
        tone,
        0.0004 if shine else 0.0026,
        shine,
        seed=number,
    )


def books() -> list[Thing]:
    """Two that lie at the left, two that stand, one that leans on the side of the bookcase."""
    cream, gold, red = (222, 208, 176), (190, 164, 104), (160, 60, 44)
    stripes = [(0.05, 0.06, gold), (0.10, 0.105, gold), (0.95, 0.96, gold)]
    lean = np.radians(LEAN)
    plan = [  # thickness and height, its middle, turn, mass, look
        (
            (0.030, 0.186),
            (-0.171, 0.015),
            -90,
            400,
            ((196, 172, 124), "Night Trains", "E. Sato"),
            {"dark": True, "shine": 0.3, "bands": [(0.72, 0.74, red), (0, 0.09, red)]},
        ),
        (
            (0.026, 0.170),
            (-0.174, 0.043),
            -90,
            330,
            ((52, 84, 76), "Small Islands", "R. Hale"),
            {"bands": [(0.03, 0.045, cream)]},
        ),
        (
            (0.025, 0.178),
            (0.128, 0.089),
            0,
            305,
            ((172, 62, 46), "THE TIN WHALE", "M. Orr"),
            {"bands": [(0.03, 0.045, cream)]},
        ),
        (
            (0.028, 0.206),
            (0.180, 0.103),
            0,
            415,
            ((52, 74, 84), "A History of Rain", "Lindqvist"),
            {"bands": stripes},
        ),
        (
            (0.025, 0.190),
            None,
            LEAN,
            360,
            ((96, 108, 66), "ON KEEPING BEES", "Hale"),
            {"bands": [(0.85, 0.86, cream)]},
        ),
    ]
    things = []
    for k, (size, at, turn, mass, look, rest) in enumerate(plan, 1):
        if at is None:
            across, up = (
                np.array([[np.cos(lean), np.sin(lean)], [np.sin(lean), np.cos(lean)]])
                @ size
                / 2
            )
            at = INSIDE - across, up
        note = "" if turn != LEAN else "It leans on the side of the bookcase."
        parts = volume(k, size, *look, **rest)
        things.append(
            Thing(
                f"book-{k}",
                "book",
                parts,
                {"box": size},
                at,
                mass,
                0.4,
                0.3,
                turn,
                note=note,
            )
        )
    return things


def stage() -> Stage:
    camera = Camera(
        "side",
        height=0.60,
        centre=(0, 0.23),
        rise=(0, 0.26),
        distance=5.0,
        aperture=0.035,
    )
    rng = np.random.default_rng(1)
    hide = satin(leather_ball([srgb(150, 50, 38), srgb(212, 190, 150)], 2), 0.32)
    hide = bumpy(hide, cloud(512, 1024, (7, 7), 3, rng, 0.8) * 0.15 + 0.5, 0.0006)
    pose = T().rotate([0, 1, 0], 35).rotate([1, 0, 0], 48)
    ball = Thing(
        "ball",
        "leather ball",
        [sphere(BALL, hide, pose)],
        {"circle": BALL},
        (-0.186, 0.056 + BALL),
        190,
        0.5,
        0.5,
        solid="sphere",
        rolling=0.004,
    )
    parts = elephant()
    toy = Thing(
        "elephant",
        "wooden elephant",
        parts,
        {"polygon": rounded(np.array(BODY) * 0.01, 1).tolist()},
        (0.018, 0),
        90,
        0.25,
        0.6,
    )
    oak = satin(
        wood(
            1024,
            2048,
            srgb(128, 86, 52),
            srgb(196, 150, 102),
            seed=11,
            rings=14,
            figure=0.04,
        ),
        0.28,
    )
    thick = 0.02
    side = rounded_box((thick, 0.25, 1.4), oak, 0.0015, 1.3, (0.2, 0.7), "z")
    scenery: dict[str, Part] = {
        "board": moved(
            rounded_box((0.66, 0.25, 0.022), oak, 0.0015, 0.72, (0.5, 0.3)),
            T().translate([0, 0.015, -0.011]),
        ),
        "left": moved(side, T().translate([-INSIDE - thick / 2, 0.015, 0.1])),
        "right": moved(side, T().translate([INSIDE + thick / 2, 0.015, 0.1])),
        "frame": rounded_box(
            (0.142, 0.012, 0.182), satin(srgb(52, 40, 34), 0.25), 0.001
        ),
        "back": wall(
            1.2, 1.2, matt(plaster(1536, 1536, srgb(126, 134, 118), 4)), (0, 0.14, 0.2)
        ),
    }
    hung = T().translate([-0.09, 0.1325, 0.365]).rotate([0, 1, 0], 0.8)
    scenery["frame"] = moved(scenery["frame"], hung)
    scenery["print"] = moved(
        wall(0.128, 0.168, matt(seascape(512, 390, 3)[::-1]), (0, -0.0062, 0)), hung
    )
    lights = {
        "lamp": bulb((-0.36, -0.88, 0.86), 0.036, WARM * 620),
        "room": sky(
            (0.16, 0.14, 0.12),
            (0.13, 0.12, 0.11),
            (0.07, 0.055, 0.045),
            [((0.8, -1, 0.5), 14, (0.5, 0.6, 0.75))],
        ),
    }

    def sections(c: Camera) -> dict:
        return {
            "forces": [{"object": "ball", "impulse": c.push((0.19 * 3.2, 0.19 * 0.8))}],
            "render": {
                "slow": 3,
                "hold": 12,
                "enter": "finger",
                "contact_shade": True,
                "smooth_outlines": True,
            },
            "variants": {
                "gentle": {
                    "forces[0].impulse": c.push((0.19 * 0.5, 0)),
                    "world.duration": 0.9,
                },
                "pushed": {
                    "forces[0].impulse": c.push((0.19 * 1.2, 0)),
                    "world.duration": 0.9,
                },
                "no-elephant": {"objects.elephant": None, "world.duration": 0.9},
                "bowling-ball": {
                    "objects.ball.mass": 1200,
                    "forces[0].impulse": c.push((1.2 * 1.2, 0)),
                    "world.duration": 0.9,
                },
            },
        }

    return Stage(
        "shelf",
        "A leather ball flies at books",
        "A finger flicks a leather ball off two books in a bookcase: it flies over a wooden elephant.\n"
        "Behind the elephant stand three more books, and they lean now.",
        camera,
        [ball, toy, *books()],
        scenery,
        lights,
        {
            "shelf": Boundary([(-INSIDE, 0), (INSIDE, 0)], 0.3, 0.65),
            "left-side": Boundary([(-INSIDE, 0), (-INSIDE, 0.8)], 0.4, 0.6),
            "right-side": Boundary([(INSIDE, 0), (INSIDE, 0.8)], 0.4, 0.6),
        },
        duration=0.76,
        softness=1.7,
        backdrop=0.14,
        exposure=1.75,
        sections=sections,
        film={"frames": 12, "until": 0.9},
        clips={"count": 50, "frames": 8, "until": 0.9, "edit": push},
    )


def push(camera: Camera, rng: np.random.Generator) -> list[str]:
    """A push of the ball for one clip: 0.4 to 3.5 m/s, level or upwards by up to 25 degrees."""
    speed, rise = rng.uniform(0.4, 3.5), np.radians(rng.uniform(0, 25))
    x, y = camera.push(0.19 * speed * np.array([np.cos(rise), np.sin(rise)]))
    return [f"forces[0].impulse=[{x}, {y}]"]
