"""White cups, saucers, a jug, a sugar bowl and an egg on a white table before a white wall; overcast light from the left."""

import numpy as np
from lights import panel, sky
from materials import glossy, matt, satin, texture
from optics import T
from shapes import floor, lathe, moved, ring, rounded_box, wall
from stage import Boundary, Camera, Stage, Thing
from textures import plaster, srgb
from textures_kitchen import speckled

CAMERA = Camera(
    "side",
    height=0.40,
    centre=(0.013, 0.118),
    distance=4.0,
    rise=(0, 0.33),
    aperture=0.03,
)
CUP = 0.058  # m: height of a cup


def china(seed: int, tone: tuple[float, float, float] = (224, 222, 215)) -> dict:
    """White glaze: each piece a little warmer or cooler, a few pinholes."""
    rng = np.random.default_rng(seed)
    colour = np.array(tone) + rng.normal(0, 2.0) + rng.normal(0, [0.8, 0.3, 1.2])
    return glossy(
        texture(speckled(256, 512, srgb(*colour), srgb(150, 138, 120), seed, 0.35))
    )


def cup(
    name: str,
    at: tuple[float, float],
    seed: int,
    side: int,
    label: str = "cup",
    **more: object,
) -> Thing:
    """An espresso cup, 70 mm wide, its handle on the right (1) or the left (-1); closed by its rim in outline."""
    skin = china(seed)
    outer = [
        (0.0215, 0.001),
        (0.022, 0),
        (0.0242, 0),
        (0.025, 0.0015),
        (0.0252, 0.004),
        (0.0295, 0.010),
        (0.0325, 0.020),
        (0.0342, 0.036),
        (0.0349, CUP - 0.001),
    ]
    inner = [
        (0.0343, CUP),
        (0.0332, CUP - 0.0008),
        (0.0318, 0.036),
        (0.030, 0.020),
        (0.024, 0.009),
        (0, 0.006),
    ]
    body = lathe([(0, 0.0015), *outer, *inner], skin, smooth=65)
    loop = moved(
        ring(0.0145, 0.0036, skin, around=64), T().translate([side * 0.0375, 0, 0.035])
    )
    arc = [
        (side * (0.0375 + 0.0181 * np.cos(a)), 0.035 + 0.0181 * np.sin(a))
        for a in np.radians(np.arange(-75, 80, 15))
    ]
    right = [*outer[2:7], *(arc if side > 0 else []), outer[8], (0.0343, CUP)]
    left = [*outer[2:7], *(arc if side < 0 else []), outer[8], (0.0343, CUP)]
    mirror = [(x if x < 0 else -x, z) for x, z in left[::-1]]
    return Thing(
        name,
        label,
        [body, loop],
        {"polygon": [*right, *mirror]},
        at,
        165,
        0.35,
        0.25,
        **more,
    )


def saucer(name: str, at: tuple[float, float], seed: int) -> Thing:
    """116 mm wide; its foot's ring is wider than a cup, so that it lies on one like a lid."""
    under = [
        (0.0362, 0.0012),
        (0.0366, 0),
        (0.0392, 0),
        (0.0398, 0.002),
        (0.048, 0.0075),
        (0.0572, 0.0143),
        (0.058, 0.0152),
    ]
    over = [
        (0.0575, 0.0163),
        (0.0565, 0.0162),
        (0.045, 0.0098),
        (0.034, 0.0068),
        (0.028, 0.0062),
        (0.0272, 0.0052),
        (0, 0.0052),
    ]
    plate = lathe([(0, 0.0012), *under, *over], china(seed), smooth=60)
    right = [*under[:4], under[5], under[6], over[0], over[1], over[3], over[5]]
    return Thing(
        name,
        "saucer",
        [plate],
        {"polygon": [*right, *[(-x, z) for x, z in right[::-1]]]},
        at,
        145,
        0.35,
        0.2,
    )


def tower(x: float) -> list[Thing]:
    """A cup, a saucer on it as a lid, a cup on the saucer."""
    lid = CUP - 0.0012
    note = "the stick pushes above its handle"
    return [
        cup("cup-1", (x, 0), 1, 1),
        saucer("saucer", (x, lid), 2),
        cup("cup-2", (x, lid + 0.0052), 3, -1, note=note),
    ]


def sugar(x: float) -> list[Thing]:
    bowl = [
        (0.029, 0.001),
        (0.0295, 0),
        (0.032, 0),
        (0.033, 0.003),
        (0.041, 0.014),
        (0.0445, 0.028),
        (0.0435, 0.044),
        (0.0375, 0.056),
        (0.036, 0.060),
    ]
    top = [(0.0352, 0.061), (0.033, 0.0605), (0.032, 0.057), (0, 0.055)]
    dome = [
        (0.0335, 0.0004),
        (0.0365, 0),
        (0.0372, 0.001),
        (0.0365, 0.003),
        (0.030, 0.0085),
        (0.018, 0.0135),
        (0.0075, 0.016),
        (0.0062, 0.0185),
    ]
    knob = [
        (0.0085, 0.0215),
        (0.0103, 0.026),
        (0.0085, 0.0305),
        (0.004, 0.0325),
        (0, 0.033),
    ]
    body = lathe([(0, 0.0015), *bowl, *top], china(5), smooth=60)
    lid = lathe([(0, 0.0004), *dome, *knob], china(6), smooth=60)
    outline = [*bowl[2:], top[0]]
    cover = [dome[1], dome[2], *dome[4:], *knob[1:4]]
    return [
        Thing(
            "sugar-bowl",
            "sugar bowl",
            [body],
            {"polygon": [*outline, *[(-r, z) for r, z in outline[::-1]]]},
            (x, 0),
            330,
            0.35,
            0.2,
        ),
        Thing(
            "lid",
            "lid",
            [lid],
            {"polygon": [*cover, *[(-r, z) for r, z in cover[::-1]]]},
            (x, 0.061),
            72,
            0.35,
            0.25,
        ),
    ]


def jug(x: float) -> Thing:
    """A milk jug, its handle on the left."""
    outer = [
        (0.0325, 0.001),
        (0.033, 0),
        (0.036, 0),
        (0.0375, 0.003),
        (0.0425, 0.02),
        (0.044, 0.045),
        (0.0405, 0.075),
        (0.0335, 0.1),
        (0.031, 0.118),
        (0.0325, 0.134),
        (0.0365, 0.146),
    ]
    inner = [
        (0.036, 0.1475),
        (0.0345, 0.147),
        (0.030, 0.134),
        (0.0285, 0.118),
        (0.031, 0.1),
        (0.038, 0.075),
        (0.040, 0.03),
        (0, 0.006),
    ]
    skin = china(7)
    loop = moved(
        ring(0.031, 0.0048, skin, around=64), T().translate([-0.0395, 0, 0.084])
    )
    arc = [
        (-0.0395 - 0.0358 * np.cos(a), 0.084 + 0.0358 * np.sin(a))
        for a in np.radians(np.arange(-75, 80, 15))
    ]
    right = [*outer[2:], inner[0]]
    left = [
        (-r, z)
        for r, z in [*outer[2:6], *[(-a, b) for a, b in arc], *outer[8:], inner[0]]
    ]
    return Thing(
        "jug",
        "milk jug",
        [lathe([(0, 0.0015), *outer, *inner], skin, smooth=60), loop],
        {"polygon": [*right, *left[::-1]]},
        (x, 0),
        390,
        0.35,
        0.2,
    )


def egg(x: float) -> Thing:
    """It lies as an egg does: on its belly, the blunt end a little lower."""
    lie = np.linspace(0, np.pi, 73)
    r, along = 0.0215 * np.sin(lie) * (1 + 0.10 * np.cos(lie)), -0.0285 * np.cos(lie)
    shell = satin(
        texture(speckled(256, 512, srgb(232, 228, 220), srgb(196, 180, 160), 9, 0.4)),
        0.4,
    )
    points = np.array(
        [*zip(along, -r, strict=True)][::3]
        + [*zip(along[::-1], r[::-1], strict=True)][3:-1:3]
    )
    cross = (
        points[:, 0] * np.roll(points[:, 1], -1)
        - np.roll(points[:, 0], -1) * points[:, 1]
    )
    middle = (points + np.roll(points, -1, 0)).T @ cross / (3 * cross.sum())
    turns = np.radians(np.linspace(-20, 20, 801))
    lift = [
        (middle @ [np.sin(-a), np.cos(a)], (points @ [np.sin(-a), np.cos(a)]).min())
        for a in turns
    ]
    best = int(np.argmin([m - low for m, low in lift]))
    part = lathe(np.stack([r, along], 1), shell, "x", smooth=80)
    return Thing(
        "egg",
        "egg",
        [part],
        {"polygon": points.tolist()},
        (x, -lift[best][1]),
        58,
        0.4,
        0.3,
        degrees=round(float(np.degrees(turns[best])), 3),
    )


def room() -> dict:
    """A white table, a white wall with a panelled wainscot: all that sets the things off is shade."""
    paint = matt(plaster(512, 1024, srgb(214, 213, 208), 5))
    lacquer = satin(texture(plaster(1024, 2048, srgb(218, 216, 210), 8), (2, 1)), 0.22)
    found = {
        "table": floor(4.0, 1.5, lacquer, (0, -0.2, 0)),
        "edge": wall(4.0, 0.04, satin(srgb(212, 210, 204), 0.3), (0, 0.55, -0.02)),
        "wall": wall(6, 3, paint, (0, 1.0, 0.6)),
        "floor": floor(6, 6, matt(srgb(170, 164, 154)), (0, 0, -0.74)),
        "rail": moved(
            rounded_box((5, 0.03, 0.035), paint, 0.006, 0.6),
            T().translate([0, 0.99, 0.345]),
        ),
    }
    for k, x in enumerate(
        (-0.86, -0.30, 0.26, 0.82)
    ):  # mouldings of the wainscot's fields
        for j, (dx, dz, width, height) in enumerate(
            (
                (0, 0.27, 0.46, 0.016),
                (-0.222, 0.0, 0.016, 0.55),
                (0.222, 0.0, 0.016, 0.55),
            )
        ):
            found[f"moulding-{k}-{j}"] = moved(
                rounded_box((width, 0.016, height), paint, 0.005, 0.5),
                T().translate([x + dx, 0.992, dz]),
            )
    return found


def stage() -> Stage:
    overcast = np.array([0.93, 0.97, 1.0])
    lights = {
        f"pane-{k}": panel(
            (-1.5, -0.75 + 0.62 * k, 0.85),
            (0, -0.1 + 0.3 * k, 0.05),
            (0.56, 1.0),
            overcast * 8,
        )
        for k in range(2)
    }
    lights["room"] = sky(
        (0.62, 0.63, 0.64),
        (0.50, 0.50, 0.49),
        (0.34, 0.32, 0.30),
        [((0.95, -0.4, 0.2), 10, (0.3, 0.32, 0.34))],
    )
    return Stage(
        "cups",
        "A cup nearly falls off its saucer",
        "White on white: cups, a saucer, a milk jug, sugar and an egg in the light of an overcast sky.\n"
        "A stick pushes the upper cup at its rim: the cup tips, nearly falls, and rocks back onto its saucer.",
        CAMERA,
        [jug(-0.0996), *tower(-0.0005), *sugar(0.1003), egg(0.1723)],
        room(),
        lights,
        {"table": Boundary([(-2, 0), (2, 0)], 0.4, 0.2)},
        duration=0.8,
        softness=20,
        exposure=1.55,
        sections=sections,
    )


def sections(camera: Camera) -> dict:
    edge = [round(v, 1) for v in camera.pixel((-0.035, CUP + 0.05805))]
    rim = [round(v, 1) for v in camera.pixel((-0.035, CUP + 0.052))]
    handle = [round(v, 1) for v in camera.pixel((-0.035, CUP + 0.03695))]
    return {
        "forces": [
            {"object": "cup-2", "impulse": camera.push((0.0796875, 0)), "at": edge}
        ],
        "render": {
            "slow": 3,
            "hold": 12,
            "enter": "stick",
            "contact_shade": True,
            "smooth_outlines": True,
        },
        "variants": {
            "gentle": {
                "forces[0].impulse": camera.push((0.095, 0)),
                "forces[0].at": handle,
            },
            "push": {
                "forces[0].impulse": camera.push((0.15625, 0)),
                "forces[0].at": handle,
            },
            "flick": {
                "forces[0].impulse": camera.push((0.227, 0)),
                "forces[0].at": rim,
            },
            "slippery": {"objects.*.friction": 0.04},
        },
        "comments": {
            "forces[0].impulse": "0.08 N s",
            "variants.gentle": "at its handle: the cup slides and stays on its saucer",
            "variants.push": "harder at its handle: the cup slides off its saucer and leans on the lid of the sugar bowl",
            "variants.flick": "a flick near its rim: the cup tumbles over the sugar bowl and takes the lid along",
        },
    }
