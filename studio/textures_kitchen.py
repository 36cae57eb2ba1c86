"""Textures of kitchen and toys: cloth, tiles, fruit, glazes, printed packets, painted blocks; linear reflectance out."""

from collections.abc import Callable

import cv2
import numpy as np
from PIL import Image, ImageDraw, ImageFont
from textures import cloud, noise, srgb, wood

Rgb = tuple[int, int, int]


def linear(image: object) -> np.ndarray:
    """An sRGB picture 0..255 -> linear reflectance."""
    return srgb(*np.moveaxis(np.asarray(image, float)[..., :3], -1, 0)).transpose(
        1, 2, 0
    )


def printed(
    width: int,
    height: int,
    ground: Rgb,
    draw: Callable,
    seed: int = 0,
    wear: float = 1.0,
) -> np.ndarray:
    """Printed paper: `draw(ImageDraw, font by size)` on `ground`, then paper's unevenness and a little rubbing."""
    sheet = Image.new("RGB", (width, height), ground)
    draw(ImageDraw.Draw(sheet), ImageFont.load_default)
    rng = np.random.default_rng(seed)
    tone = 1 + wear * (
        0.03 * cloud(height, width, (height / 3, width / 3), 4, rng)
        + 0.02 * noise(height, width, (2, 2), rng)
    )
    rubbed = (
        np.clip(cloud(height, width, (height / 6, width / 6), 5, rng, 0.7) - 2.1, 0, 1)[
            ..., None
        ]
        * 0.5
        * wear
    )
    paper = np.clip(linear(sheet) * tone[..., None], 0, 0.9)
    return paper + (srgb(205, 196, 180) - paper) * rubbed


def gingham(
    size: int, check: float, colour: np.ndarray, white: np.ndarray, seed: int = 0
) -> np.ndarray:
    """Woven checks, `check` texels wide: threads of uneven strength, stains of long use, the trace of ironed folds."""
    rng = np.random.default_rng(seed)
    bend = (
        0.9 * noise(size, size, (size / 12, size / 12), rng),
        0.9 * noise(size, size, (size / 12, size / 12), rng),
    )
    y, x = np.mgrid[:size, :size].astype(np.float32)
    warp, weft = (
        np.clip(np.sin(np.pi * (v + b) / check) * check / 3 + 0.5, 0, 1)
        for v, b in ((x, bend[0]), (y, bend[1]))
    )
    share = (warp + weft)[..., None] / 2
    thread = (
        0.045 * noise(size, size, (90, 1), rng)
        + 0.045 * noise(size, size, (1, 90), rng)
        + 0.03 * noise(size, size, (1, 1), rng)
    )
    broad = 0.03 * cloud(size, size, (size / 4, size / 4), 4, rng)
    cloth = (white + (colour - white) * share) * (1 + thread + broad)[..., None]
    stain = np.clip(cloud(size, size, (size / 7, size / 7), 4, rng) - 2.2, 0, 0.5)[
        ..., None
    ]
    return np.clip(cloth * (1 - stain * np.array([0.25, 0.4, 0.6])), 0.01, 0.85)


def tiles(
    height: int,
    width: int,
    rows: int,
    columns: int,
    colour: np.ndarray,
    joint: np.ndarray,
    seed: int = 0,
) -> np.ndarray:
    """A tiled wall, every tile of another firing."""
    rng = np.random.default_rng(seed)
    y, x = np.mgrid[:height, :width]
    row, column = y * rows // height, x * columns // width
    tone = 1 + 0.045 * rng.standard_normal((rows, columns)).clip(-2, 2)
    tint = 1 + 0.02 * rng.standard_normal((rows, columns, 3))
    tile = colour * tone[row, column][..., None] * tint[row, column]
    tile = (
        tile
        * (
            1
            + 0.02
            * cloud(height, width, (height / rows / 2, width / columns / 2), 3, rng)
        )[..., None]
    )
    fy, fx = y * rows / height % 1, x * columns / width % 1
    gap = np.maximum(np.abs(fy - 0.5), np.abs(fx - 0.5))[..., None]
    share = np.clip((gap - 0.475) / 0.008, 0, 1)
    return np.clip(tile + (joint - tile) * share, 0, 0.9)


def orange_skin(seed: int = 0, size: int = 512) -> tuple[np.ndarray, np.ndarray]:
    """(colour (H, W, 3), height (H, W) in 0..1) of an orange, longitude-latitude; pores everywhere."""
    rng = np.random.default_rng(seed)
    stretch = 2.0
    pores = np.clip(noise(size, 2 * size, (5, 5 * stretch), rng) - 0.3, 0, 2) / 2
    blotch = cloud(size, 2 * size, (size / 4, size / 2), 5, rng)
    colour = (
        srgb(232, 138, 30)
        * (1 + 0.10 * blotch[..., None] * np.array([0.5, 1.0, 0.6]))
        * (1 - 0.22 * pores)[..., None]
    )
    scar = np.clip(
        cloud(size, 2 * size, (size / 8, size / 4), 5, rng, 0.7) - 2.3, 0, 0.6
    )[..., None]
    return np.clip(colour + (srgb(170, 120, 60) - colour) * scar, 0, 0.85), (
        1 - pores
    ).astype(np.float32)


def apple_skin(
    seed: int = 0,
    size: int = 512,
    red: Rgb = (150, 26, 24),
    ground: Rgb = (206, 178, 74),
) -> np.ndarray:
    """u around, row 0 at the stalk: red streaks over yellow, pale lenticels, yellow around the stalk."""
    rng = np.random.default_rng(seed)
    streak = cloud(size, 2 * size, (size, 14), 3, rng, 0.7) + 0.8 * noise(
        size, 2 * size, (size, size / 2), rng
    )
    v = np.linspace(1, 0, size)[:, None]
    share = np.clip(
        0.78
        + 0.13 * streak
        - 2.2 * np.clip(v - 0.82, 0, 1)
        - 1.8 * np.clip(0.16 - v, 0, 1),
        0,
        1,
    )[..., None]
    skin = srgb(*ground) + (srgb(*red) - srgb(*ground)) * share
    dots = np.clip(noise(size, 2 * size, (4, 8), rng) - 2.3, 0, 0.6)[..., None]
    return np.clip(skin + (srgb(226, 196, 120) - skin) * dots, 0, 0.85)


def speckled(
    height: int,
    width: int,
    colour: np.ndarray,
    speck: np.ndarray,
    seed: int = 0,
    amount: float = 1.0,
) -> np.ndarray:
    """Stoneware glaze, an egg: uneven coat and small dark flecks."""
    rng = np.random.default_rng(seed)
    coat = (
        colour
        * (1 + 0.035 * cloud(height, width, (height / 4, width / 4), 4, rng))[..., None]
    )
    fleck = np.clip(noise(height, width, (3, 3), rng) - 2.6, 0, 0.8) + np.clip(
        noise(height, width, (7, 7), rng) - 3.0, 0, 0.8
    )
    return np.clip(
        coat + (speck - coat) * np.clip(amount * fleck, 0, 1)[..., None], 0.01, 0.86
    )


def cork(height: int, width: int, seed: int = 0) -> np.ndarray:
    """Pressed bark: lenticels along v, dark pits."""
    rng = np.random.default_rng(seed)
    bark = (
        srgb(188, 146, 98)
        * (1 + 0.10 * cloud(height, width, (10, 10), 4, rng))[..., None]
    )
    pit = (
        np.clip(noise(height, width, (18, 5), rng) - 1.5, 0, 1)[..., None]
        + np.clip(noise(height, width, (5, 4), rng) - 2, 0, 1)[..., None]
    )
    return bark + (srgb(92, 58, 34) - bark) * np.clip(pit, 0, 0.9)


def block(
    colour: Rgb, seed: int, glyph: str = "", ink: Rgb = (60, 44, 34), size: int = 512
) -> np.ndarray:
    """One face of a toy block: bare beech, or paint rubbed off at edges and corners; with a printed letter or picture."""
    rng = np.random.default_rng(seed)
    bare = wood(
        size,
        size,
        srgb(168, 122, 78),
        srgb(214, 174, 126),
        seed=seed,
        rings=rng.uniform(4, 8),
        figure=0.06,
    )
    face = bare
    y, x = np.abs(np.mgrid[-1 : 1 : size * 1j, -1 : 1 : size * 1j])
    edge = np.maximum(x, y) + 0.25 * np.clip(x + y - 1.5, 0, 1)
    rub = cloud(size, size, (size / 5, size / 5), 6, rng, 0.72)
    if colour:
        grain = bare.mean(-1, keepdims=True) / bare.mean()
        paint = (
            srgb(*colour)
            * (0.78 + 0.22 * grain)
            * (1 + 0.04 * cloud(size, size, (size / 3, size / 3), 4, rng))[..., None]
        )
        worn = np.clip((edge - 0.955) * 22 + 0.9 * rub - 0.35, 0, 1) + np.clip(
            rub - 2.5, 0, 1
        )
        face = paint + (bare - paint) * np.clip(worn, 0, 1)[..., None]
    if glyph:
        plate = Image.new("L", (size, size), 0)
        ImageDraw.Draw(plate).text(
            (size / 2, size / 2),
            glyph,
            255,
            ImageFont.load_default(size * 0.62),
            anchor="mm",
            stroke_width=8,
        )
        ink_ = cv2.GaussianBlur(
            np.asarray(plate, np.float32) / 255, (0, 0), 1.2
        ) * np.clip(1.15 - 0.35 * np.clip(rub - 0.4, 0, 3), 0, 1)
        face = face + (srgb(*ink) - face) * (0.92 * ink_)[..., None]
    grime = np.clip((edge - 0.9) * 3, 0, 0.25) + np.clip(0.05 * rub, 0, 0.12)
    return np.clip(face * (1 - grime)[..., None], 0.008, 0.85)


def rubber_ball(size: int, seed: int = 0) -> np.ndarray:
    """Longitude-latitude map of a playground ball: red, a cream band between two blue lines, scuffed."""
    rng = np.random.default_rng(seed)
    z = np.sin((0.5 - (np.arange(size) + 0.5) / size) * np.pi)[:, None, None]
    soft = 1.5 / size
    skin = srgb(176, 52, 44) + 0 * np.zeros((size, 2 * size, 1))
    for reach, colour in ((0.34, srgb(52, 84, 128)), (0.24, srgb(212, 200, 172))):
        skin = skin + (colour - skin) * np.clip(
            0.5 + (reach - np.abs(z)) / soft / 2, 0, 1
        )
    scuff = (
        np.clip(cloud(size, 2 * size, (size / 5, size / 3), 6, rng, 0.75) - 1.5, 0, 1)[
            ..., None
        ]
        * 0.35
    )
    skin = (
        skin
        * (1 + 0.03 * cloud(size, 2 * size, (size / 4, size / 2), 4, rng))[..., None]
    )
    return np.clip(skin + (srgb(150, 132, 116) - skin) * scuff, 0.01, 0.85)
