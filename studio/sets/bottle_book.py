"""A dark green glazed bottle and a brown book on a walnut table in a dark room, one lamp at the right: low-key."""

import numpy as np
from lights import WARM, panel, sky
from materials import glossy, matt, satin
from optics import T
from shapes import lathe, moved, rounded_box, wall
from stage import Boundary, Camera, Stage, Thing
from textures import cloud, plaster, srgb, wood
from textures_home import book, spine

BOOK = (0.036, 0.214)  # m, thickness and height
BOTTLE = [
    (0, 0),
    (3.1, 0),
    (3.4, 0.3),
    (3.5, 1.2),
    (3.6, 6.0),
    (3.6, 12.6),
    (3.4, 14.0),
    (2.8, 15.4),
    (1.9, 16.6),
]
BOTTLE += [
    (1.45, 17.8),
    (1.3, 19.4),
    (1.25, 22.4),
    (1.3, 22.9),
    (1.75, 23.1),
    (1.8, 23.7),
    (1.6, 24.0),
    (1.0, 24.0),
]
BOTTLE += [(0.95, 23.0)]
AT = (-0.112, 0.034)  # m, where the book and the bottle stand


def bottle() -> tuple[dict, np.ndarray]:
    """A thrown bottle with a dark glaze, bare clay at its foot; its outline, m."""
    profile = np.array(BOTTLE) * 0.01
    rng = np.random.default_rng(5)
    run = cloud(768, 768, (160, 60), 5, rng, 0.6)
    v = np.linspace(0, 1, 768)[:, None]
    glaze = (
        srgb(34, 62, 48)
        * np.clip(1 + 0.28 * run, 0.4, 2)[..., None]
        * (0.8 + 0.5 * v[..., None])
    )
    clay = (
        srgb(126, 92, 66)
        * np.clip(1 + 0.08 * cloud(768, 768, (6, 40), 3, rng), 0.5, 1.5)[..., None]
    )
    foot = np.clip((0.140 + 0.010 * cloud(1, 768, (1, 90), 3, rng) - v) / 0.004, 0, 1)[
        ..., None
    ]
    half = profile[1:-1]
    outline = np.concatenate([half, (half * [-1, 1])[::-1]])
    return lathe(profile, glossy(glaze + (clay - glaze) * foot), "z", 128, 50), outline


def stage() -> Stage:
    camera = Camera(
        "side",
        height=0.44,
        centre=(0.01, 0.168),
        rise=(0, 0.2),
        distance=4.5,
        aperture=0.03,
    )
    tone, gold = srgb(74, 52, 42), srgb(150, 116, 66)
    face = spine(
        BOOK,
        tone,
        "WINTER WALKS",
        "Aldous Finch",
        srgb(172, 138, 84),
        [
            (0.05, 0.056, gold),
            (0.11, 0.114, gold),
            (0.88, 0.884, gold),
            (0.95, 0.956, gold),
        ],
        3,
        0.16,
        1000,
        0.36,
    )
    volume = book((BOOK[0], 0.13, BOOK[1]), face, tone, 0.0034, None, 4)
    vessel, outline = bottle()
    things = [
        Thing(
            "book",
            "book",
            volume,
            {"box": BOOK},
            (AT[0], BOOK[1] / 2),
            700,
            0.5,
            0.15,
            note="It stands on its short edge, its spine to us.",
        ),
        Thing(
            "bottle",
            "glazed bottle",
            [vessel],
            {"polygon": outline.tolist()},
            (AT[1], 0),
            1250,
            0.35,
            0.25,
            note="Filled: it holds the book.",
        ),
    ]
    walnut = satin(
        wood(
            1024,
            2048,
            srgb(58, 38, 26),
            srgb(110, 76, 50),
            seed=9,
            rings=12,
            figure=0.05,
        ),
        0.3,
    )
    shade = plaster(768, 1024, srgb(84, 64, 52), 8)
    scenery = {
        "table": moved(
            rounded_box((2.4, 0.9, 0.04), walnut, 0.003, 1.1, (0.3, 0.6)),
            T().translate([0, 0.12, -0.02]),
        ),
        "wall": wall(3, 2, matt(shade), (0, 0.95, 0.3)),
    }
    lights = {
        "lamp": panel((0.85, -0.62, 0.62), (0, 0, 0.1), (0.16, 0.2), WARM * 46),
        "room": sky(
            (0.012, 0.014, 0.018), (0.012, 0.013, 0.015), (0.006, 0.005, 0.004)
        ),
    }

    def sections(c: Camera) -> dict:
        corner = [
            round(float(v), 1) for v in c.pixel((AT[0] - BOOK[0] / 2, BOOK[1] - 0.006))
        ]
        push = {
            "object": "book",
            "force": c.push((0.78, 0)),
            "at": corner,
            "start": 0.2,
            "duration": 0.25,
        }
        return {
            "forces": [push],
            "comments": {
                "forces": "A finger presses at the top of the book's back until it tips."
            },
            "variants": {
                "too-gentle": {"forces[0].force": c.push((0.65, 0))},
                "empty-bottle": {"objects.bottle.mass": 520},
                "slap": {"forces[0].force": c.push((3, 0)), "forces[0].duration": 0.1},
                "no-bottle": {"objects.bottle": None},
            },
        }

    return Stage(
        "bottle-book",
        "A book falls against a bottle",
        "A finger pushes at the top of a standing book. It falls, and the bottle holds it.\n"
        "Empty, the bottle falls, too (empty-bottle); pushed too gently, the book only rocks back.",
        camera,
        things,
        scenery,
        lights,
        {"table": Boundary([(-2, 0), (2, 0)], 0.5, 0.2)},
        duration=2.3,
        softness=4.5,
        backdrop=0.95,
        exposure=4.2,
        vignette=0.12,
        sections=sections,
    )
