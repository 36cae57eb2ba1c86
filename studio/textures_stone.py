"""Textures of stone, ice, courts, rubber and marbles: sizes and seeds in, (H, W, 3) float linear reflectance out."""

import cv2
import numpy as np
from PIL import Image, ImageDraw, ImageFont
from textures import cloud, noise, srgb


def smooth(edge: float, soft: float, value: np.ndarray) -> np.ndarray:
    """0 below `edge`, 1 above, over `soft`."""
    x = np.clip((value - edge) / soft + 0.5, 0, 1)
    return x * x * (3 - 2 * x)


def mix(under: np.ndarray, over: np.ndarray, cover: np.ndarray) -> np.ndarray:
    """`over` laid on `under` where `cover` (H, W) is 1."""
    return under + (over - under) * cover[..., None]


# --- curling ---------------------------------------------------------------------------------------------------------


def granite(
    height: int, width: int, seed: int = 0, band: tuple[float, float] | None = None
) -> np.ndarray:
    """Blue-grey granite for a lathe (u around, v along the profile): pale and dark grains; `band` of v is left unpolished."""
    rng = np.random.default_rng(seed)
    shade = 0.9 + 0.06 * cloud(height, width, (60, 120), 3, rng)
    stone = srgb(118, 122, 125) * shade[..., None]
    for size, low, colour, strength in (
        (5, 0.55, (178, 178, 172), 0.75),
        (4, 0.75, (58, 60, 66), 0.8),
        (8, 1.1, (150, 148, 146), 0.6),
        (3, 1.5, (32, 34, 38), 0.8),
    ):
        stone = mix(
            stone,
            srgb(*colour),
            strength * smooth(low, 0.5, noise(height, width, (size, size * 1.8), rng)),
        )
    if band:
        v = 1 - (np.arange(height)[:, None] + 0.5) / height + 0 * stone[..., 0]
        worn = smooth(band[0], 0.01, v) * smooth(-band[1], 0.01, -v)
        stone = mix(stone, srgb(160, 162, 162), 0.55 * worn)
    return stone


def house(
    size: int, width: float, tee: tuple[float, float], seed: int = 0
) -> np.ndarray:
    """The ice of a curling sheet from above, `width` m square about (0, 0), the sheet along x, painted rings about `tee`.

    The paint lies under the ice: a little pale and soft. Sliding stones leave faint tracks, brooms and shoes scuff it.
    """
    rng = np.random.default_rng(seed)
    x, y = np.meshgrid(
        np.linspace(-0.5, 0.5, size) * width, np.linspace(0.5, -0.5, size) * width
    )
    wave = 0.0012 * cloud(size, size, (60, 60), 3, rng)  # seen through uneven ice
    x, y = x + wave, y + 0.0012 * cloud(size, size, (60, 60), 3, rng)
    radius = np.hypot(x - tee[0], y - tee[1])
    coat = 1 + 0.05 * cloud(size, size, (160, 160), 4, rng)[..., None]
    ice = srgb(196, 205, 209) * (
        1 + 0.012 * cloud(size, size, (size / 3, size / 3), 4, rng)[..., None]
    )
    soft = 0.007
    for outer, inner, colour in (
        (1.829, 1.219, (40, 92, 158)),
        (0.610, 0.152, (176, 44, 50)),
    ):
        ring = smooth(-outer, soft, -radius) * smooth(inner, soft, radius)
        ice = mix(ice, srgb(*colour) * coat, 0.86 * ring)
    line = srgb(66, 72, 84)
    for across, half in (
        (y - tee[1], 0.006),
        (x - tee[0], 0.006),
        (x - tee[0] - 1.829 - 0.006, 0.006),
    ):
        ice = mix(ice, line, 0.75 * smooth(-half, 0.004, -np.abs(across)))
    ice = mix(
        ice,
        srgb(74, 82, 96),
        0.62 * lettering(size, width, tee, 0.915, "LOCHSIDE CURLING CLUB"),
    )
    tracks = np.zeros((size, size), np.float32)
    for _ in range(46):  # long, gently curling paths of stones
        y0, bend, strength = (
            rng.uniform(-width, width) / 2,
            rng.normal(0, 0.02),
            rng.uniform(0.1, 0.55),
        )
        s = np.linspace(-width / 2, width / 2, 60)
        path = np.stack(
            [s, y0 + rng.normal(0, 0.03) * s + bend * (s + width / 2) ** 2], 1
        )
        for off in (-0.062, 0.062):
            pixels = ((path + [0, off]) * [1, -1] / width + 0.5) * size
            cv2.polylines(
                tracks,
                [np.round(pixels * 16).astype(np.int32)],
                False,
                strength,
                3,
                cv2.LINE_AA,
                4,
            )
    broken = np.clip(0.5 + 0.5 * cloud(size, size, (10, 40), 3, rng), 0, 1)
    ice = mix(
        ice, srgb(216, 222, 226), 0.22 * cv2.GaussianBlur(tracks, (0, 0), 1.2) * broken
    )
    dull = cloud(size, size, (9, 900), 4, rng, 0.8) + 0.5 * cloud(
        size, size, (140, 500), 3, rng
    )  # brushed along
    ice = ice * (1 + 0.022 * dull[..., None])
    scuffs = np.zeros((size, size), np.float32)
    for _ in range(130):
        at, a, length = rng.uniform(0, size, 2), rng.normal(0, 0.7), rng.exponential(26)
        end = at + length * np.array([np.cos(a), np.sin(a)])
        ends = [tuple(int(v * 16) for v in point) for point in (at, end)]
        cv2.line(
            scuffs,
            *ends,
            float(rng.uniform(0.1, 0.6)),
            int(rng.integers(1, 4)),
            cv2.LINE_AA,
            4,
        )
    ice = mix(
        ice, srgb(120, 132, 144), 0.35 * cv2.GaussianBlur(scuffs, (0, 0), 1.5) * broken
    )
    frost = smooth(1.3, 1.6, cloud(size, size, (size / 5, size / 5), 6, rng, 0.75))
    ice = mix(ice, srgb(214, 220, 224), 0.22 * frost)
    pebble = np.clip(noise(size, size, (2.2, 2.2), rng) - 0.4, 0, 2)
    ice = ice * (1 + 0.06 * (pebble - pebble.mean()))[..., None]
    crumbs = (
        cv2.GaussianBlur(
            (rng.random((size, size)) < 2e-4).astype(np.float32), (0, 0), 1.0
        )
        * 5
    )
    ice = np.clip(mix(ice, srgb(226, 230, 232), np.clip(crumbs, 0, 0.5)), 0, 0.9)
    return ice[::-1].copy()  # a rectangle shows row 0 at v = 0, its lower edge


def lettering(
    size: int, width: float, centre: tuple[float, float], radius: float, text: str
) -> np.ndarray:
    """(size, size) cover of a line of capitals round a circle, its middle at the top of the circle's left half."""
    tall, strip = 96, Image.new("L", (96 * len(text), 140), 0)
    ImageDraw.Draw(strip).text(
        (48 * len(text), 70),
        text,
        255,
        ImageFont.load_default(tall),
        "mm",
        stroke_width=3,
    )
    scale = 0.16 / tall  # m a texel
    x, y = np.meshgrid(
        np.linspace(-0.5, 0.5, size) * width, np.linspace(0.5, -0.5, size) * width
    )
    dx, dy = x - centre[0], y - centre[1]
    angle, reach = np.arctan2(dx, dy), np.hypot(dx, dy)  # clockwise from the top
    turned = (angle + np.radians(42) + np.pi) % (2 * np.pi) - np.pi
    column, row = (
        turned * radius / scale + strip.width / 2,
        70 - (reach - radius) / scale,
    )
    ink = cv2.remap(
        np.asarray(strip, np.float32) / 255,
        column.astype(np.float32),
        row.astype(np.float32),
        cv2.INTER_AREA,
        borderValue=0,
    )
    return cv2.GaussianBlur(ink, (0, 0), 1.2)


def pebbles(size: int, seed: int = 0) -> np.ndarray:
    """(size, size) height 0..1 of ice sprinkled with frozen droplets."""
    rng = np.random.default_rng(seed)
    drops = np.clip(noise(size, size, (2.5, 2.5), rng) - 0.3, 0, 2.5)
    height = drops + 0.5 * cloud(size, size, (40, 40), 3, rng)
    return (height - height.min()) / np.ptp(height)


# --- balls: longitude-latitude maps, row 0 is the pole z = +1 --------------------------------------------------------


def directions(width: int) -> np.ndarray:
    """(width / 2, width, 3): where each texel of a ball lies on the unit sphere, as Mitsuba maps it."""
    polar = (np.arange(width // 2)[:, None] + 0.5) / (width // 2) * np.pi
    around = (np.arange(width) + 0.5)[None] / width * 2 * np.pi
    return np.stack(
        [
            np.sin(polar) * np.cos(around),
            np.sin(polar) * np.sin(around),
            np.cos(polar) + 0 * around,
        ],
        -1,
    )


def marbled(
    points: np.ndarray, seed: int, bands: float = 1.2, warp: float = 0.9
) -> np.ndarray:
    """(..., 3) points -> (...) stripes bent by folded flow, smooth everywhere, some -1..1."""
    rng = np.random.default_rng(seed)
    q = points.astype(np.float64)
    for k in range(4):
        turn, phase = (
            rng.normal(0, 1, (3, 3)) * 1.5 * 1.45**k,
            rng.uniform(0, 2 * np.pi, 3),
        )
        q = q + warp / 1.5**k * 0.5 * np.sin(q @ turn.T + phase)
    axis = rng.normal(0, 1, 3)
    return np.sin(q @ (axis / np.linalg.norm(axis)) * np.pi * bands + rng.uniform(0, 6))


def swirl(
    width: int,
    base: np.ndarray,
    veins: list[tuple[np.ndarray, float]],
    seed: int = 0,
    **flow: float,
) -> np.ndarray:
    """A ball of `base` colour with swirls: each of `veins` is (colour, share of the surface)."""
    points = directions(width)
    skin = np.broadcast_to(base, points.shape) * (
        1 + 0.05 * marbled(points * 2, seed + 90)[..., None]
    )
    for k, (colour, share) in enumerate(veins):
        flowing = marbled(points, seed * 17 + k, **flow)
        edge = np.quantile(flowing, 1 - share)
        fade = 0.85 + 0.15 * marbled(points * 2.3, seed * 17 + k + 50)
        skin = mix(skin, colour, smooth(edge, 0.10, flowing) * fade)
    return skin


def dusty(
    skin: np.ndarray, seed: int = 0, amount: float = 0.25, dust: tuple = (150, 142, 130)
) -> np.ndarray:
    """A used ball: dirt in patches, small scuffs."""
    rng = np.random.default_rng(seed)
    height, width = skin.shape[:2]
    patch = smooth(0.3, 2.2, cloud(height, width, (height / 3, width / 5), 6, rng, 0.7))
    scuff = np.zeros((height, width), np.float32)
    for _ in range(90):
        at, a = rng.uniform(0, 1, 2) * [width, height], rng.uniform(0, np.pi)
        end = at + rng.exponential(0.02 * width) * np.array([np.cos(a), np.sin(a)])
        cv2.line(
            scuff,
            tuple(at.astype(int)),
            tuple(end.astype(int)),
            float(rng.uniform(0.2, 0.9)),
            2,
            cv2.LINE_AA,
        )
    return mix(
        skin,
        srgb(*dust),
        np.clip(amount * (patch + 0.8 * cv2.GaussianBlur(scuff, (0, 0), 1.3)), 0, 0.8),
    )


def striped(
    width: int, colour: np.ndarray, stripe: np.ndarray, half: float = 0.2
) -> np.ndarray:
    """A ball with a band round its middle, thin lines beside it, and the seam of its mould."""
    z, y = directions(width)[..., 2], directions(width)[..., 1]
    skin = np.broadcast_to(colour, (*z.shape, 3))
    skin = mix(skin, stripe, smooth(-half, 0.012, -np.abs(z)))
    skin = mix(skin, stripe, smooth(-0.02, 0.012, -np.abs(np.abs(z) - half - 0.09)))
    return skin * (1 - 0.3 * smooth(-0.008, 0.008, -np.abs(y)))[..., None]


def halves(width: int, one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """A ball of two colours that meet at a moulded seam."""
    z = directions(width)[..., 2] + 0.004 * marbled(directions(width) * 4, 3)
    skin = mix(np.broadcast_to(one, (*z.shape, 3)), other, smooth(0, 0.015, z))
    return skin * (1 - 0.35 * smooth(-0.012, 0.01, -np.abs(z)))[..., None]


def sponge(
    width: int, colour: np.ndarray, seed: int = 0
) -> tuple[np.ndarray, np.ndarray]:
    """Foam rubber, full of pores: its colour and its relief (0..1)."""
    rng = np.random.default_rng(seed)
    height = width // 2
    pores = sum(
        smooth(low, 0.5, noise(height, width, (s, s), rng))
        for s, low in ((6, 1.5), (3, 1.3), (10, 1.9))
    )
    pores = np.clip(pores, 0, 1)
    shade = 1 + 0.05 * cloud(height, width, (height / 4, height / 4), 5, rng)
    return colour * (shade * (1 - 0.55 * pores))[..., None], 1 - pores


def putty(
    width: int, colour: np.ndarray, seed: int = 0
) -> tuple[np.ndarray, np.ndarray]:
    """A ball rolled by hand from clay-like rubber: its colour and its relief (0..1) of dents and finger prints."""
    rng = np.random.default_rng(seed)
    points, height = directions(width), width // 2
    dents = cloud(height, width, (height / 5, height / 5), 4, rng, 0.55)
    prints = np.zeros(points.shape[:2])
    for _ in range(9):
        middle = rng.normal(0, 1, 3)
        middle /= np.linalg.norm(middle)
        away = np.linalg.norm(points - middle, axis=-1)
        ridges = np.sin(
            90 * np.linalg.norm((points - middle * 1.1) * [1, 1.2, 0.9], axis=-1)
        )
        prints += smooth(-0.28, 0.12, -away) * ridges
    shade = (
        1
        + 0.05 * cloud(height, width, (height / 3, height / 3), 5, rng, 0.7)
        + 0.03 * prints
    )
    relief = dents * 0.12 + 0.05 * prints
    return colour * shade[..., None], (relief - relief.min()) / np.ptp(relief)


# --- a yard ----------------------------------------------------------------------------------------------------------


def court(height: int, width: int, metres: float, seed: int = 0) -> np.ndarray:
    """Concrete with a worn coat of green paint and a white line across; `metres` wide; row 0 lies along a wall."""
    rng = np.random.default_rng(seed)
    m = width / metres  # texels per metre
    grain = 0.5 * noise(height, width, (1.3, 1.3), rng) + 0.5 * cloud(
        height, width, (5, 5), 3, rng, 0.8
    )
    broad = cloud(height, width, (0.5 * m, 0.5 * m), 6, rng, 0.6)
    concrete = srgb(158, 152, 142) * (1 + 0.09 * grain + 0.06 * broad)[..., None]
    concrete = mix(
        concrete,
        srgb(92, 88, 82),
        0.7 * smooth(1.9, 0.5, noise(height, width, (4, 4), rng)),
    )
    paint = (
        srgb(74, 112, 96)
        * (1 + 0.05 * grain + 0.07 * cloud(height, width, (0.8 * m, 0.8 * m), 4, rng))[
            ..., None
        ]
    )
    worn = smooth(
        -1.0,
        0.35,
        -(cloud(height, width, (0.25 * m, 0.25 * m), 7, rng, 0.72) + 0.18 * grain),
    )
    ground = mix(concrete, paint, 0.93 * worn)
    y, x = np.mgrid[:height, :width] / m
    line = smooth(
        -0.025, 0.004, -np.abs(y - 0.72 - 0.16 * (x - metres / 2) + 0.002 * broad)
    )
    kept = smooth(
        -0.9,
        0.5,
        -(cloud(height, width, (0.12 * m, 0.12 * m), 6, rng, 0.75) + 0.3 * grain),
    )
    ground = mix(
        ground, srgb(206, 202, 190) * (1 + 0.05 * grain)[..., None], 0.9 * line * kept
    )
    crack = np.abs(cloud(height, width, (0.9 * m, 0.9 * m), 7, rng, 0.62))
    ground = (
        ground
        * (1 - 0.55 * smooth(-0.012, 0.012, -crack) * smooth(0.2, 0.8, broad))[
            ..., None
        ]
    )
    stains = smooth(1.1, 0.5, cloud(height, width, (0.35 * m, 0.35 * m), 5, rng, 0.6))
    ground = ground * (1 - 0.22 * stains)[..., None]
    dirt = np.exp(-y / 0.05) * np.clip(
        0.75 + 0.45 * cloud(height, width, (0.04 * m, 0.15 * m), 6, rng, 0.7), 0, 1.3
    )
    ground = mix(
        ground, srgb(88, 78, 62) * (1 + 0.12 * grain)[..., None], np.clip(dirt, 0, 0.92)
    )
    grit = (rng.random((height, width)) < 6e-4).astype(np.float32)
    grit = cv2.GaussianBlur(grit, (0, 0), 0.9) * 6
    return np.clip(mix(ground, srgb(196, 188, 172), np.clip(grit, 0, 0.8)), 0.005, 0.85)


def limewash(size: int, metres: float, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """A brick wall under many coats of white: its colour and its relief (0..1); row 0 is the bottom, `metres` square."""
    rng = np.random.default_rng(seed)
    y, x = np.mgrid[:size, :size] * (metres / size)
    m = size / metres
    sag = 0.004 * cloud(size, size, (0.3 * m, 0.3 * m), 3, rng)
    x, y = x + sag, y + 0.003 * cloud(size, size, (0.2 * m, 0.2 * m), 4, rng)
    course = np.floor(y / 0.075)
    along = x / 0.225 + 0.5 * (course % 2)
    tone = rng.normal(0, 1, (100, 100))[
        (course % 100).astype(int), (np.floor(along) % 100).astype(int)
    ]
    joint = np.minimum(
        np.abs(y / 0.075 - np.round(y / 0.075)) * 0.075,
        np.abs(along - np.round(along)) * 0.225,
    )
    brick = smooth(0.007, 0.009, joint + 0.0012 * cloud(size, size, (12, 12), 3, rng))
    grain = cloud(size, size, (10, 10), 4, rng, 0.75)
    relief = (
        brick * (1 + 0.10 * tone)
        + 0.07 * grain
        + 0.06 * cloud(size, size, (0.08 * m, 0.08 * m), 4, rng)
    )
    lime = (
        srgb(206, 198, 182)
        * (1 + 0.035 * cloud(size, size, (0.4 * m, 0.4 * m), 6, rng, 0.65))[..., None]
    )
    lime = lime * (0.93 + 0.07 * brick + 0.012 * tone + 0.02 * grain)[..., None]
    bare = srgb(146, 104, 84) * (1 + 0.1 * tone + 0.08 * grain)[..., None]
    bare = mix(srgb(168, 158, 142) * (1 + 0.06 * grain)[..., None], bare, brick)
    flaked = smooth(
        1.75,
        0.12,
        cloud(size, size, (0.22 * m, 0.22 * m), 7, rng, 0.7)
        + 0.25 * tone * brick
        - 0.5 * (y - 0.2),
    )
    wall = mix(lime, bare, 0.9 * flaked)
    splash = np.clip(
        np.exp(-y / 0.07)
        * (0.75 + 0.3 * cloud(size, size, (0.05 * m, 0.12 * m), 5, rng)),
        0,
        1,
    )
    wall = mix(wall, srgb(112, 102, 84), 0.75 * splash)
    streak = smooth(
        1.2, 0.8, cloud(size, size, (1.2 * m, 0.03 * m), 4, rng, 0.7)
    ) * np.clip(y / 0.5, 0, 1)
    wall = wall * (1 - 0.13 * streak)[..., None]
    return np.clip(wall, 0.005, 0.85), (relief - relief.min()) / np.ptp(relief)


# --- a table and a cloth ---------------------------------------------------------------------------------------------


def linen(size: int, colour: np.ndarray, seed: int = 0) -> np.ndarray:
    """Coarse dark cloth: threads of uneven thickness, lint."""
    rng = np.random.default_rng(seed)
    y, x = np.mgrid[:size, :size]
    warp, weft = (
        noise(size, size, (size / 6, 3), rng),
        noise(size, size, (3, size / 6), rng),
    )
    weave = np.sin(x * 0.9 + 0.4 * weft) * np.sin(y * 0.9 + 0.4 * warp)
    return (
        colour
        * np.clip(1 + 0.10 * weave + 0.07 * warp + 0.07 * weft, 0.4, 1.7)[..., None]
    )


def used(board: np.ndarray, seed: int = 0, rings: int = 3) -> np.ndarray:
    """A board that has been lived with: scratches, dents, marks of cups, darker patches."""
    rng = np.random.default_rng(seed)
    height, width = board.shape[:2]
    marks, pale = (
        np.zeros((height, width), np.float32),
        np.zeros((height, width), np.float32),
    )
    for _ in range(150):
        at, a = rng.uniform(0, 1, 2) * [width, height], rng.normal(0, 0.7)
        end = at + rng.exponential(0.03 * width) * np.array([np.cos(a), np.sin(a)])
        layer = marks if rng.random() < 0.5 else pale
        cv2.line(
            layer,
            tuple(at.astype(int)),
            tuple(end.astype(int)),
            float(rng.uniform(0.1, 0.7)),
            1,
            cv2.LINE_AA,
        )
    for _ in range(rings):
        at = tuple((rng.uniform(0, 1, 2) * [width, height]).astype(int))
        cv2.ellipse(
            marks,
            at,
            (int(width * 0.05),) * 2,
            0,
            rng.uniform(0, 90),
            rng.uniform(200, 350),
            0.5,
            5,
            cv2.LINE_AA,
        )
    patch = smooth(
        0.4, 2.0, cloud(height, width, (height / 4, width / 4), 5, rng, 0.65)
    )
    board = (
        board
        * (1 - 0.35 * cv2.GaussianBlur(marks, (0, 0), 0.8) - 0.18 * patch)[..., None]
    )
    return mix(board, srgb(196, 168, 132), 0.3 * cv2.GaussianBlur(pale, (0, 0), 0.8))
