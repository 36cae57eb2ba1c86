"""A cluttered kitchen table before a tiled wall, counter and shelf, morning light from a window at the left."""

from dataclasses import replace

import numpy as np
from lights import panel, sky
from materials import BRASS, STEEL, bumpy, glossy, matt, metal, satin, texture
from optics import T
from shapes import floor, lathe, moved, ring, rod, rounded_box, sphere, wall
from stage import Boundary, Camera, Mesh, Stage, Thing
from textures import srgb, wood
from textures_kitchen import (
    apple_skin,
    cork,
    gingham,
    orange_skin,
    printed,
    speckled,
    tiles,
)

CAMERA = Camera(
    "side",
    height=0.73,
    centre=(0.016, 0.222),
    distance=4.5,
    rise=(0, 0.42),
    aperture=0.045,
)
R = 0.0375  # m, an orange
X = 0.054  # m, the middle of the plates


def packet(size: tuple[float, float, float], bsdf: dict, edge: float = 0.0008) -> Mesh:
    """A box whose print is seen from the front and runs on round its sides."""
    box = rounded_box(size, bsdf, edge)
    return replace(box, uv=box.vertices[:, [0, 2]] / [size[0], -size[2]] + 0.5)


def section(profile: object) -> list:
    """A body of revolution's outline from its profile of (radius, height), bottom to top."""
    right = [tuple(p) for p in np.asarray(profile, float)]
    return right + [(-r, z) for r, z in reversed(right) if r > 1e-6]


def rest(outline: object) -> tuple[float, float]:
    """(degrees, height): how an outline about its middle lies at rest near the pose it has, and its origin's height then."""
    points = np.asarray(outline, float)
    x, y = points.T
    cross = x * np.roll(y, -1) - np.roll(x, -1) * y
    middle = (points + np.roll(points, -1, 0)).T @ cross / (3 * cross.sum())
    best = None
    for degrees in np.linspace(-25, 25, 1001):
        a = np.radians(-degrees)
        turned = points @ np.array([[np.cos(a), np.sin(a)], [-np.sin(a), np.cos(a)]])
        low = turned[:, 1].min()
        height = middle @ [np.sin(a), np.cos(a)] - low
        if best is None or height < best[0]:
            best = height, float(degrees), float(-low)
    return round(best[1], 2), best[2]


def fruit(
    name: str,
    label: str,
    at: tuple[float, float],
    seed: int,
    mass: float,
    **more: object,
) -> Thing:
    """An orange (a sphere with pores) or an apple (a sphere that dips at stalk and calyx)."""
    rng = np.random.default_rng(seed)
    turn = (
        T()
        .rotate([0, 0, 1], rng.uniform(0, 360))
        .rotate([1, 0, 0], rng.uniform(-60, 60))
    )
    if label == "orange":
        colour, relief = orange_skin(seed)
        parts = [sphere(R, bumpy(satin(texture(colour), 0.28), relief, 0.0022), turn)]
    else:
        lean = np.linspace(-np.pi / 2, np.pi / 2, 60)
        dip = 0.011 * np.exp(-(((np.pi / 2 - lean) / 0.30) ** 2)) - 0.005 * np.exp(
            -(((np.pi / 2 + lean) / 0.25) ** 2)
        )
        profile = np.stack([R * np.cos(lean), R * np.sin(lean) - dip], 1).clip(
            [0, -1], [1, 1]
        )
        turn = (
            T()
            .rotate([0, 1, 0], rng.uniform(-25, 25))
            .rotate([1, 0, 0], rng.uniform(10, 30))
            .rotate([0, 0, 1], seed * 50)
        )
        body = lathe(profile, satin(texture(apple_skin(seed)[::-1]), 0.16), smooth=60)
        stalk = rod(
            (0, 0, R - 0.012),
            (0.003, 0.002, R - 0.0005),
            0.0012,
            matt(srgb(84, 60, 36)),
        )
        parts = [moved(body, turn), moved(stalk, turn)]
    return Thing(
        name,
        label,
        parts,
        {"circle": R},
        at,
        mass,
        0.45,
        0.25,
        solid="sphere",
        rolling=0.01,
        **more,
    )


def pantry() -> list[Thing]:
    """Left half: a board that leans on a milk carton, a tin, a mug, a wooden spoon across the two."""
    lean = np.radians(9)
    board = rounded_box(
        (0.018, 0.16, 0.30),
        matt(wood(512, 1024, srgb(150, 106, 66), srgb(204, 162, 110), 21, 6)),
        0.004,
        0.3,
        grain="z",
    )
    foot = -0.277 - 0.25 * np.tan(
        lean
    )  # its lower right corner; its right face meets the carton's upper left edge
    across, along = (
        np.array([np.cos(lean), -np.sin(lean)]),
        np.array([np.sin(lean), np.cos(lean)]),
    )
    at = np.array([foot, 0]) - 0.009 * across + 0.15 * along
    milk = printed(420, 1500, (226, 226, 218), draw_milk, 1, 0.6)
    body = packet((0.07, 0.07, 0.196), satin(texture(milk), 0.2), 0.001)
    body = replace(
        body,
        vertices=body.vertices + [0, 0, 0.098],
        uv=body.uv * [1, 0.784] + [0, 0.216],
    )
    roof = [
        (-0.035, 0.196),
        (0.035, 0.196),
        (0.0012, 0.231),
        (0.0012, 0.25),
        (-0.0012, 0.25),
        (-0.0012, 0.231),
    ]
    v, uv, faces = [], [], []
    for (y0, z0), (y1, z1) in zip(roof[1:], roof[2:] + roof[:1], strict=True):
        i = len(v)
        v += [(-0.035, y0, z0), (0.035, y0, z0), (0.035, y1, z1), (-0.035, y1, z1)]
        uv += [(0, 1 - z0 * 4), (1, 1 - z0 * 4), (1, 1 - z1 * 4), (0, 1 - z1 * 4)]
        faces += [(i, i + 1, i + 2), (i, i + 2, i + 3)]
    for x in (-0.0349, 0.0349):
        i = len(v)
        v += [(x, y, z) for y, z in roof]
        uv += [(0.02, 1 - z * 4) for _, z in roof]
        faces += [
            (i, i + 1, i + 2),
            (i, i + 2, i + 5),
            (i + 2, i + 3, i + 4),
            (i + 2, i + 4, i + 5),
        ]
    paper = {"type": "twosided", "bsdf": satin(texture(milk), 0.2)}
    top = Mesh(np.array(v), None, np.array(uv), np.array(faces), paper)
    carton = [moved(part, T().translate([0, 0, -0.125])) for part in (body, top)]

    label = texture(printed(1600, 560, (176, 44, 34), draw_tomatoes, 2)[::-1])
    steel = metal(rough=0.22, tint=STEEL)
    wrap = lathe([(0.0365, 0.004), (0.0365, 0.096)], satin(label, 0.18))
    ends = lathe(
        [
            (0, 0.001),
            (0.034, 0.001),
            (0.0355, 0),
            (0.037, 0.001),
            (0.037, 0.004),
            (0.0365, 0.0045),
        ],
        steel,
    )
    lid = lathe(
        [
            (0.0365, 0.0955),
            (0.037, 0.096),
            (0.037, 0.099),
            (0.0362, 0.1),
            (0.035, 0.099),
            (0.034, 0.097),
            (0, 0.097),
        ],
        steel,
    )
    glaze = glossy(texture(speckled(256, 512, srgb(58, 92, 122), srgb(28, 44, 60), 5)))
    cup = [
        (0, 0.002),
        (0.028, 0.002),
        (0.029, 0),
        (0.033, 0),
        (0.0375, 0.006),
        (0.04, 0.016),
        (0.04, 0.096),
        (0.0395, 0.0992),
    ]
    inside = [
        (0.0383, 0.1),
        (0.037, 0.0992),
        (0.0362, 0.096),
        (0.0358, 0.012),
        (0.03, 0.006),
        (0, 0.005),
    ]
    handle = moved(
        ring(0.024, 0.0048, glaze, around=64), T().translate([0.0415, 0, 0.052])
    )
    mug = [
        moved(part, T().translate([0, 0, -0.05]))
        for part in (lathe(cup + inside, glaze, smooth=75), handle)
    ]
    arc = [
        (0.0415 + 0.0288 * np.cos(a), 0.002 + 0.0288 * np.sin(a))
        for a in np.radians(np.arange(-85, 90, 17))
    ]
    outline = [
        (-0.033, -0.05),
        (0.033, -0.05),
        (0.04, -0.034),
        *arc,
        (0.04, 0.0495),
        (-0.04, 0.0495),
        (-0.04, -0.034),
    ]

    x = np.linspace(0, 0.17, 90)
    head = np.exp(-(((x - 0.141) / 0.027) ** 4))
    thick = np.maximum(
        (0.0042 + 0.0012 * head)
        * np.sqrt(np.clip(np.minimum(x, 0.17 - x) / 0.005, 0.002, 1)),
        0.0002,
    )
    spoon = lathe(
        np.stack([thick, x], 1),
        matt(wood(256, 1024, srgb(158, 112, 70), srgb(206, 160, 108), 8, 4)),
        "x",
        smooth=89,
    )
    wide = 1.25 + 3.0 * np.interp(spoon.vertices[:, 0], x, head)
    lift = np.interp(spoon.vertices[:, 0], x, thick)
    bent = np.stack(
        [
            spoon.vertices[:, 0] - 0.085,
            spoon.vertices[:, 1] * wide,
            spoon.vertices[:, 2] + lift,
        ],
        1,
    )
    spoon = replace(spoon, vertices=bent, uv=spoon.uv[:, ::-1])
    edge = [(a - 0.085, 2 * b) for a, b in zip(x[::-6], thick[::-6], strict=True)]
    rows = [
        Thing(
            "board",
            "cutting board",
            [board],
            {"box": (0.018, 0.30)},
            tuple(at),
            620,
            0.5,
            0.2,
            degrees=9,
        ),
        Thing(
            "carton",
            "milk carton",
            carton,
            {"box": (0.07, 0.25)},
            (-0.242, 0.125),
            1060,
            0.45,
            0.15,
        ),
        Thing(
            "tin",
            "tin of tomatoes",
            [wrap, ends, lid],
            {"box": (0.074, 0.1)},
            (-0.170, 0.05),
            460,
            0.35,
            0.2,
        ),
        Thing("mug", "mug", mug, {"polygon": outline}, (-0.093, 0.05), 340, 0.4, 0.25),
        Thing(
            "spoon",
            "wooden spoon",
            [spoon],
            {"polygon": [(-0.083, 0), (0.083, 0), *edge]},
            (-0.12, 0.1),
            32,
            0.45,
            0.3,
        ),
    ]
    rows[2] = replace(
        rows[2],
        parts=[moved(part, T().translate([0, 0, -0.05])) for part in rows[2].parts],
    )
    return rows


def pile() -> list[Thing]:
    """The middle: four plates, a bowl on them, two fruits in it and an orange on top."""
    china = glossy(srgb(222, 218, 206))
    line = glossy(srgb(60, 92, 140))
    plate = [
        (0, 0.0015),
        (0.044, 0.0015),
        (0.046, 0),
        (0.049, 0),
        (0.051, 0.003),
        (0.058, 0.005),
        (0.0785, 0.0148),
        (0.08, 0.016),
    ]
    plate += [
        (0.0795, 0.0172),
        (0.078, 0.0175),
        (0.058, 0.0085),
        (0.05, 0.006),
        (0, 0.006),
    ]
    rim = [(0.0795, 0.0171), (0.0785, 0.0178), (0.0765, 0.0172)]
    stack = []
    for k in range(4):
        aside = T().translate([0.0004 * (-1) ** k, 0.001 * k, 0.0072 * k])
        stack += [
            moved(lathe(plate, china, smooth=60), aside),
            moved(lathe(rim, line), aside),
        ]
    top = 0.0216
    side = [
        (0.049, 0),
        (0.079, 0.0145),
        (0.0803, 0.016),
        (0.0803, top + 0.0165),
        (0.078, top + 0.0177),
        (0.058, top + 0.0085),
        (0.05, top + 0.006),
    ]
    plates = Thing(
        "plates",
        "stack of plates",
        stack,
        {"polygon": [*side, *[(-x, z) for x, z in reversed(side)]]},
        (X, 0),
        1180,
        0.35,
        0.1,
    )

    big, wall_ = 0.078, 0.0042  # inner radius and thickness of the bowl
    low = top + 0.006 + 0.0085  # height of its inner bottom above the table
    turns = np.radians(np.linspace(0, 82, 24))
    inner = np.stack([big * np.sin(turns), 0.0085 + big * (1 - np.cos(turns))], 1)
    outer = np.stack(
        [
            (big + wall_) * np.sin(turns),
            0.0085 - wall_ + (big + wall_) * (1 - np.cos(turns)),
        ],
        1,
    )
    foot = [(0.024, 0.001), (0.026, 0), (0.031, 0), (0.0325, 0.0025)]
    skin = outer[outer[:, 0] > 0.036]
    shell = [(0, 0.003), *foot, *skin, inner[-1] + [0.002, 0.002], *inner[::-1]]
    stone = glossy(
        texture(speckled(512, 1024, srgb(196, 190, 170), srgb(86, 66, 48), 3, 1.2))
    )
    walls = [
        *foot[1:],
        *skin[::3],
        outer[-1],
        inner[-1] + [0.002, 0.002],
        *inner[-2::-2],
    ]
    sides = [*walls, *[(-x, z) for x, z in walls[::-1] if x > 1e-6]]
    bowl = Thing(
        "bowl",
        "glazed bowl",
        [lathe(shell, stone, smooth=60)],
        {"polygon": sides},
        (X, top + 0.006),
        410,
        0.4,
        0.2,
        extra={"layer": 1},
        note="drawn over the fruit in it",
    )
    height = low + big - np.sqrt((big - R) ** 2 - R**2)
    return [
        plates,
        bowl,
        fruit("orange-1", "orange", (X - R, height), 1, 190),
        fruit("apple-1", "apple", (X + R, height), 2, 175),
        fruit(
            "orange-2",
            "orange",
            (X, height + R * np.sqrt(3)),
            3,
            190,
            note="on top of the pile; the push below sends it off to the left",
        ),
    ]


def tower() -> list[Thing]:
    """The right: jam with a cork on it, butter with matches, a salt shaker and an egg, a lemon."""
    jam = glossy(texture(speckled(256, 512, srgb(104, 18, 20), srgb(50, 8, 12), 9)))
    jar = lathe(
        [
            (0, 0.002),
            (0.026, 0.0),
            (0.0305, 0.0015),
            (0.033, 0.006),
            (0.033, 0.064),
            (0.031, 0.071),
            (0.0285, 0.0745),
        ],
        jam,
        smooth=70,
    )
    cap = lathe(
        [
            (0.0285, 0.0745),
            (0.0315, 0.0746),
            (0.0318, 0.076),
            (0.0318, 0.0885),
            (0.0312, 0.0905),
            (0.0295, 0.092),
            (0, 0.092),
        ],
        satin(srgb(186, 150, 70), 0.18),
        smooth=30,
    )
    tag = texture(printed(1600, 320, (222, 212, 186), draw_jam, 4)[::-1])
    paper = lathe([(0.0333, 0.016), (0.0333, 0.054)], matt(tag))
    shape = [
        (0.0305, 0),
        (0.033, 0.006),
        (0.033, 0.064),
        (0.0285, 0.0745),
        (0.0318, 0.0755),
        (0.0318, 0.0895),
        (0.0295, 0.092),
    ]
    lie = np.linspace(0, np.pi, 61)
    lemon_r = (
        0.0255 * np.sin(lie) ** 0.9
        + 0.0065
        * (np.exp(-((lie / 0.13) ** 2)) + np.exp(-(((np.pi - lie) / 0.13) ** 2)))
        * np.sin(lie) ** 0.3
    )
    lemon_x = -0.034 * np.cos(lie)
    rind, relief = orange_skin(7)
    rind = rind.mean(-1, keepdims=True) / rind.mean() * srgb(232, 194, 36)
    lemon = lathe(
        np.stack([lemon_r, lemon_x], 1),
        bumpy(satin(texture(rind), 0.25), relief, 0.0016),
        "x",
        smooth=80,
    )
    lemon_outline = [*zip(lemon_x, -lemon_r, strict=True)][::2] + [
        *zip(lemon_x[::-1], lemon_r[::-1], strict=True)
    ][2:-1:2]
    lemon_turn, lemon_z = rest(lemon_outline)

    butter = texture(printed(1040, 440, (216, 188, 96), draw_butter, 6))
    salt = [
        (0, 0.001),
        (0.016, 0.001),
        (0.0185, 0),
        (0.019, 0.003),
        (0.0165, 0.03),
        (0.0145, 0.052),
        (0.015, 0.056),
    ]
    dome = [
        (0.015, 0.056),
        (0.0155, 0.0565),
        (0.0155, 0.062),
        (0.0135, 0.069),
        (0.009, 0.0745),
        (0.004, 0.0768),
        (0, 0.0772),
    ]
    shaker = (
        lathe(salt, glossy(srgb(214, 214, 206)), smooth=50),
        lathe(dome, metal(rough=0.1, tint=STEEL), smooth=60),
    )
    egg_r, egg_x = (
        0.0215 * np.sin(lie) * (1 + 0.13 * np.cos(lie)),
        -0.0285 * np.cos(lie),
    )
    shell = lathe(
        np.stack([egg_r, egg_x], 1),
        satin(
            texture(
                speckled(256, 512, srgb(204, 158, 118), srgb(140, 92, 60), 12, 0.7)
            ),
            0.35,
        ),
        "x",
        smooth=80,
    )
    egg_outline = [*zip(egg_x, -egg_r, strict=True)][::2] + [
        *zip(egg_x[::-1], egg_r[::-1], strict=True)
    ][2:-1:2]
    egg_turn, egg_z = rest(egg_outline)
    matches = texture(printed(820, 232, (92, 50, 38), draw_matches, 7))
    bark = lathe(
        [
            (0, 0),
            (0.0105, 0),
            (0.0115, 0.001),
            (0.0115, 0.043),
            (0.0105, 0.044),
            (0, 0.044),
        ],
        matt(texture(cork(256, 512))),
    )
    return [
        Thing(
            "jar",
            "jar of jam",
            [jar, cap, paper],
            {"polygon": section(shape)},
            (0.1673, 0),
            430,
            0.35,
            0.25,
        ),
        Thing(
            "lemon",
            "lemon",
            [lemon],
            {"polygon": lemon_outline},
            (0.3046 - min(lemon_x) * np.cos(np.radians(lemon_turn)), lemon_z),
            115,
            0.5,
            0.25,
            degrees=lemon_turn,
        ),
        Thing(
            "butter",
            "pack of butter",
            [packet((0.104, 0.065, 0.044), satin(butter, 0.16), 0.0012)],
            {"box": (0.104, 0.044)},
            (0.2525, 0.022),
            254,
            0.45,
            0.05,
        ),
        Thing(
            "salt",
            "salt shaker",
            list(shaker),
            {"polygon": section(list(salt[2:-1:1]) + dome[2:])},
            (0.228, 0.059),
            96,
            0.4,
            0.3,
        ),
        Thing(
            "egg",
            "egg",
            [shell],
            {"polygon": egg_outline},
            (0.2825, 0.044 + egg_z),
            58,
            0.4,
            0.3,
            degrees=egg_turn,
        ),
        Thing(
            "matches",
            "matchbox",
            [packet((0.053, 0.036, 0.015), matt(matches), 0.0006)],
            {"box": (0.053, 0.015)},
            (0.2275, 0.0515),
            12,
            0.5,
            0.2,
        ),
        Thing(
            "cork",
            "cork",
            [moved(bark, T().translate([0, 0, -0.022]))],
            {"box": (0.023, 0.044)},
            (0.167, 0.114),
            5,
            0.6,
            0.45,
        ),
    ]


def draw_milk(d: object, font: object) -> None:
    d.rectangle((0, 0, 420, 330), (58, 104, 158))
    d.rectangle((0, 330, 420, 348), (226, 226, 218))
    d.rectangle((0, 348, 420, 362), (58, 104, 158))
    d.text((210, 560), "Milch", (46, 84, 140), font(150), anchor="mm", stroke_width=3)
    d.text((210, 690), "3,5 %  frisch", (70, 90, 120), font(48), anchor="mm")
    d.ellipse((-120, 1120, 300, 1700), (116, 152, 74))
    d.ellipse((140, 1180, 620, 1800), (96, 136, 62))
    d.ellipse((110, 960, 300, 1120), (240, 238, 230))
    d.ellipse((150, 985, 215, 1050), (64, 52, 48))
    d.text((210, 1430), "1 Liter", (236, 236, 226), font(64), anchor="mm")


def draw_tomatoes(d: object, font: object) -> None:
    d.rectangle((0, 0, 1600, 46), (222, 204, 150))
    d.rectangle((0, 514, 1600, 560), (222, 204, 150))
    for x in (400, 1200):
        d.ellipse((x - 250, 90, x + 250, 330), (232, 220, 186))
        d.text(
            (x, 205), "Pomodori", (150, 30, 26), font(88), anchor="mm", stroke_width=3
        )
        for k, c in ((-120, (206, 62, 40)), (0, (190, 44, 34)), (120, (210, 70, 44))):
            d.ellipse((x + k - 80, 350, x + k + 80, 500), c)
            d.polygon(
                [(x + k - 40, 362), (x + k, 345), (x + k + 40, 362), (x + k, 384)],
                (64, 104, 46),
            )


def draw_jam(d: object, font: object) -> None:
    for x in (400, 1200):
        d.rectangle((x - 330, 26, x + 330, 294), outline=(140, 40, 44), width=6)
        d.text((x, 130), "Kirsche", (96, 26, 34), font(120), anchor="mm")
        d.text((x, 236), "Juli", (90, 80, 80), font(60), anchor="mm")


def draw_butter(d: object, font: object) -> None:
    d.rectangle((0, 150, 1040, 300), (44, 84, 62))
    d.text(
        (520, 222), "BUTTER", (232, 214, 150), font(124), anchor="mm", stroke_width=3
    )
    d.text((520, 78), "Markenware", (120, 84, 30), font(62), anchor="mm")
    d.text((520, 366), "250 g", (120, 84, 30), font(62), anchor="mm")


def draw_matches(d: object, font: object) -> None:
    d.rectangle((0, 0, 820, 34), (196, 152, 40))
    d.rectangle((0, 198, 820, 232), (196, 152, 40))
    d.text((410, 116), "STERN", (206, 170, 90), font(110), anchor="mm", stroke_width=2)


def room() -> dict:
    """Table and cloth; behind: cabinets, worktop, tiles, a shelf; all soft."""
    cloth = texture(
        gingham(2048, 34, srgb(74, 104, 138), srgb(214, 208, 194), 4), (2, 1)
    )
    sage = srgb(126, 138, 116)
    oak = texture(wood(512, 2048, srgb(128, 90, 56), srgb(186, 142, 96), 14, 12))
    clay, cream, dark = srgb(150, 88, 60), srgb(206, 196, 172), srgb(52, 56, 58)
    wall_tiles = texture(
        tiles(1024, 2048, 16, 32, srgb(188, 194, 186), srgb(142, 138, 128), 6)
    )
    found = {
        "table": floor(3.2, 1.6, matt(cloth), (0, -0.3, 0)),
        "hem": wall(3.2, 0.3, matt(cloth), (0, 0.5, -0.15)),
        "tiles": wall(3.2, 1.6, glossy(wall_tiles), (0, 1.6, 0.9)),
        "cabinets": wall(3.2, 1.0, satin(sage, 0.3), (0, 1.0, -0.39)),
        "worktop": moved(
            rounded_box((3.2, 0.64, 0.034), satin(oak, 0.25), 0.004, 1.2),
            T().translate([0, 1.3, 0.127]),
        ),
        "shelf": moved(
            rounded_box((2.0, 0.22, 0.028), satin(oak, 0.3), 0.003, 1.0, (0.3, 0.5)),
            T().translate([0.25, 1.48, 0.47]),
        ),
        "floor": floor(6, 6, matt(srgb(120, 104, 88)), (0, 0, -0.78)),
    }
    for k, x in enumerate((-1.12, -0.67, -0.22, 0.23, 0.68, 1.13)):
        found[f"door-{k}"] = moved(
            rounded_box((0.43, 0.02, 0.36), satin(sage * 1.06, 0.3), 0.003),
            T().translate([x, 0.99, -0.09]),
        )
        found[f"knob-{k}"] = sphere(
            0.014, metal(rough=0.2, tint=BRASS), at=(x + 0.17, 0.965, 0.03)
        )
    # on the worktop and on the shelf
    pot = [
        (0, 0),
        (0.05, 0),
        (0.062, 0.1),
        (0.066, 0.1),
        (0.066, 0.118),
        (0.058, 0.118),
        (0, 0.11),
    ]
    bottle = [
        (0, 0),
        (0.036, 0),
        (0.037, 0.15),
        (0.03, 0.19),
        (0.014, 0.22),
        (0.014, 0.28),
        (0, 0.28),
    ]
    can = [
        (0, 0),
        (0.06, 0),
        (0.062, 0.005),
        (0.062, 0.15),
        (0.064, 0.152),
        (0.064, 0.17),
        (0.055, 0.176),
        (0.012, 0.178),
        (0.012, 0.195),
        (0, 0.196),
    ]
    kettle = [
        (0, 0),
        (0.09, 0),
        (0.098, 0.02),
        (0.092, 0.09),
        (0.06, 0.14),
        (0.03, 0.15),
        (0.012, 0.152),
        (0.014, 0.17),
        (0, 0.175),
    ]
    cup = [
        (0, 0),
        (0.03, 0),
        (0.042, 0.02),
        (0.044, 0.085),
        (0.041, 0.085),
        (0.038, 0.02),
        (0, 0.01),
    ]
    props = [
        (kettle, metal(rough=0.15, tint=STEEL), -0.30, 1.28, 0.144),
        (can, satin(cream, 0.2), -0.72, 1.40, 0.144),
        (can, satin(srgb(90, 116, 128), 0.2), -0.88, 1.42, 0.144),
        (bottle, glossy(srgb(50, 66, 34)), 0.12, 1.42, 0.144),
        (bottle, glossy(srgb(150, 110, 40)), 0.21, 1.45, 0.144),
        (pot, matt(clay), 0.62, 1.36, 0.144),
        (can, satin(srgb(170, 70, 50), 0.25), 0.92, 1.4, 0.144),
        (can, satin(cream * 0.9, 0.25), -0.52, 1.48, 0.484),
        (can, satin(srgb(196, 160, 90), 0.25), -0.36, 1.48, 0.484),
        (cup, glossy(cream), 0.0, 1.46, 0.484),
        (cup, glossy(srgb(80, 110, 140)), 0.12, 1.46, 0.484),
        (cup, glossy(srgb(180, 120, 80)), 0.26, 1.47, 0.484),
        (pot, matt(srgb(120, 126, 120)), 0.52, 1.48, 0.484),
        (bottle, glossy(dark), 0.8, 1.48, 0.484),
        (bottle, glossy(srgb(120, 60, 30)), 0.9, 1.5, 0.484),
    ]
    for k, (profile, bsdf, x, y, z) in enumerate(props):
        found[f"prop-{k}"] = moved(
            lathe(profile, {"type": "twosided", "bsdf": bsdf}, around=32),
            T().translate([x, y, z]),
        )
    rng = np.random.default_rng(2)
    for k in range(46):  # herbs in the pot
        spot = np.array([0.62, 1.36, 0.29]) + rng.normal(0, [0.05, 0.04, 0.035])
        leaf = {
            "type": "twosided",
            "bsdf": satin(srgb(*(np.array([70, 104, 48]) + rng.normal(0, 14, 3))), 0.3),
        }
        turn = (
            T()
            .translate(spot.tolist())
            .rotate(rng.normal(size=3).tolist(), rng.uniform(0, 360))
            .scale([0.022, 0.013, 1])
        )
        found[f"leaf-{k}"] = {"type": "disk", "to_world": turn, "bsdf": leaf}
    return found


def stage() -> Stage:
    window = {}
    for i, x in enumerate((-0.27, 0.27)):
        for j, z in enumerate((-0.32, 0.32)):  # four panes: what a glaze mirrors
            aim = np.array([-1.75, -0.75, 1.05])
            side = np.array([0.39, -0.92, 0.0])
            at = aim + x * side + [0, 0, z]
            window[f"pane-{i}{j}"] = panel(
                at,
                at + [0.92, 0.39, -0.42],
                (0.48, 0.58),
                np.array([1.0, 0.9, 0.76]) * 15,
            )
    window["room"] = sky(
        (0.42, 0.42, 0.42),
        (0.34, 0.33, 0.31),
        (0.2, 0.17, 0.14),
        [((0.9, -0.5, 0.35), 14, (0.7, 0.8, 1.0))],
    )
    return Stage(
        "kitchen",
        "The top orange is pushed off",
        "Breakfast on a kitchen table, and the fruit is piled too high.\n"
        "A wooden stick pushes the top orange off: over the mug, onto the spoon.",
        CAMERA,
        [*pantry(), *pile(), *tower()],
        room(),
        window,
        {"table": Boundary([(-3, 0), (3, 0)], 0.5, 0.15)},
        duration=0.72,
        softness=15,
        exposure=1.9,
        sections=sections,
        film={"frames": 12, "until": 1.2, "variant": "gentle-push"},
        wide=replace(CAMERA, size=(1920, 1080)),
    )


def sections(camera: Camera) -> dict:
    return {
        "forces": [{"object": "orange-2", "impulse": camera.push((-0.18, 0.07))}],
        "render": {
            "slow": 3,
            "hold": 12,
            "enter": "stick",
            "contact_shade": True,
            "smooth_outlines": True,
        },
        "variants": {
            "gentle-push": {
                "forces[0].impulse": camera.push((0.15, 0)),
                "world.duration": 0.9,
            },
            "to-the-right": {
                "forces[0].impulse": camera.push((0.28, 0)),
                "world.duration": 0.9,
            },
            "no-carton": {
                "objects.carton": None,
                "forces": [],
                "world.duration": 0.9,
            },
            "no-apple": {"objects.apple-1": None, "forces": []},
        },
        "comments": {
            "forces[0].impulse": "a push of 0.19 N s",
            "variants.gentle-push": "takes the cork along, and the salt shaker leans on the egg",
            "variants.to-the-right": "over the jar, the salt and the egg",
            "variants.no-carton": "the board has nothing to lean on",
            "variants.no-apple": "the pile has nothing to stand on",
        },
    }
