"""Procedural textures: sizes and seeds in, (H, W, 3) float linear reflectance out."""

import cv2
import numpy as np
from PIL import Image, ImageDraw, ImageFont


def srgb(*code: float) -> np.ndarray:
    """Linear reflectance of an sRGB colour given as 0..255."""
    value = np.array(code, float) / 255
    return np.where(value <= 0.04045, value / 12.92, ((value + 0.055) / 1.055) ** 2.4)


def noise(
    height: int, width: int, cell: tuple[float, float], rng: np.random.Generator
) -> np.ndarray:
    """(height, width) smooth noise of mean 0 and deviation 1; `cell` is the size (y, x) in texels of its lumps."""
    small = rng.standard_normal(
        (max(2, round(height / cell[0]) + 2), max(2, round(width / cell[1]) + 2))
    ).astype(np.float32)
    field = cv2.resize(small, (width, height), interpolation=cv2.INTER_CUBIC)
    return (field - field.mean()) / field.std()


def cloud(
    height: int,
    width: int,
    cell: tuple[float, float],
    octaves: int,
    rng: np.random.Generator,
    roughness: float = 0.5,
) -> np.ndarray:
    """(height, width) fractal noise, deviation 1: each octave half the size and `roughness` times the strength."""
    field = sum(
        roughness**k * noise(height, width, (cell[0] / 2**k, cell[1] / 2**k), rng)
        for k in range(octaves)
    )
    return field / field.std()


def felt(height: int, width: int, colour: np.ndarray, seed: int = 0) -> np.ndarray:
    """Napped wool cloth: fine fuzz, a trace of the weave, patches of wear, pale specks of lint and chalk."""
    rng = np.random.default_rng(seed)
    fuzz = (
        0.6 * noise(height, width, (1, 1), rng)
        + 0.6 * noise(height, width, (1.2, 4), rng)
        + 0.4 * noise(height, width, (5, 1.5), rng)
    )
    broad = cloud(height, width, (height / 3, width / 3), 5, rng, 0.6)
    nap = cloud(height, width, (12, 70), 3, rng)  # brushed along the table
    shade = 1 + 0.070 * fuzz + 0.030 * broad + 0.022 * nap
    cloth = colour * np.clip(shade, 0.5, 1.6)[..., None]
    lint = np.zeros((height, width), np.float32)
    for _ in range(260):
        x, y, a, length = (
            rng.uniform(0, width),
            rng.uniform(0, height),
            rng.uniform(0, np.pi),
            rng.exponential(3.0),
        )
        end = (int(x + length * np.cos(a)), int(y + length * np.sin(a)))
        cv2.line(
            lint, (int(x), int(y)), end, float(rng.uniform(0.05, 0.35)), 1, cv2.LINE_AA
        )
    chalk = (
        np.clip(
            cloud(height, width, (height / 4, width / 4), 6, rng, 0.7) - 1.2, 0, None
        )
        * 0.025
    )
    cover = np.clip(cv2.GaussianBlur(lint, (0, 0), 0.7) + chalk, 0, 0.6)[..., None]
    return cloth * (1 - cover) + cover * srgb(176, 190, 196)


def wood(
    height: int,
    width: int,
    dark: np.ndarray,
    light: np.ndarray,
    seed: int = 0,
    rings: float = 9.0,
    figure: float = 0.06,
) -> np.ndarray:
    """A plain-sawn board, grain along x: `rings` growth rings over its height, bent by `figure`, fibres and pores."""
    rng = np.random.default_rng(seed)
    y, x = np.mgrid[0 : 1 : height * 1j, 0 : 1 : width * 1j]
    bend = cloud(height, width, (height / 2, width / 2), 3, rng, 0.4)
    pith = np.hypot(
        (y - 0.62 + figure * bend) * 1.0, 0.16 * (x - 0.35)
    ) * rings + 0.05 * noise(height, width, (4, width / 8), rng)
    phase = pith % 1
    ring = (
        np.where(phase < 0.82, phase / 0.82, (1 - phase) / 0.18) ** 1.6
    )  # slow darkening to late wood, quick return
    fibre = cloud(height, width, (2.0, width / 8), 3, rng, 0.7)
    pores = np.clip(noise(height, width, (1.3, 26), rng) - 1.6, 0, 1.2) * (
        0.4 + 0.6 * (1 - ring)
    )
    tone = np.clip(
        0.62
        - 0.42 * ring
        + 0.13 * fibre
        + 0.10 * cloud(height, width, (height / 2, width / 3), 2, rng),
        0,
        1,
    )[..., None]
    return (dark + (light - dark) * tone) * (1 - 0.38 * np.clip(pores, 0, 1))[..., None]


def plaster(height: int, width: int, colour: np.ndarray, seed: int = 0) -> np.ndarray:
    """A painted wall: broad unevenness of the coat and the stipple of a roller."""
    rng = np.random.default_rng(seed)
    shade = (
        1
        + 0.035 * cloud(height, width, (height / 3, width / 3), 4, rng)
        + 0.03 * cloud(height, width, (10, 10), 3, rng, 0.8)
    )
    return colour * np.clip(shade, 0.6, 1.4)[..., None]


def ivory(height: int, width: int, colour: np.ndarray, seed: int = 0) -> np.ndarray:
    """Old bone: faint lengthwise streaks, a warm patch or two, the odd dark fleck."""
    rng = np.random.default_rng(seed)
    streak = cloud(height, width, (height / 2, 5), 3, rng, 0.6)
    warm = cloud(height, width, (height / 3, width / 2), 3, rng)[..., None]
    fleck = np.clip(noise(height, width, (10, 2), rng) - 2.7, 0, 1)[..., None]
    tint = colour * (1 + warm * np.array([0.008, 0.0, -0.03]))
    return np.clip(tint * (1 + 0.014 * streak[..., None]) * (1 - 0.25 * fleck), 0, 0.92)


def billiard_ball(
    number: int, colour: np.ndarray, cream: np.ndarray, width: int = 1024
) -> np.ndarray:
    """Longitude-latitude map of a pool ball: 1-8 solid, 9-15 a band, a number in two discs; 0 is plain.

    Row 0 is the pole z = +1, column 0 longitude 0; the discs sit at +x and -x with the number upright along +z.
    """
    latitude = (0.5 - (np.arange(width // 2) + 0.5) / (width // 2)) * np.pi
    longitude = (np.arange(width) + 0.5) / width * 2 * np.pi
    z = np.sin(latitude)[:, None] + 0 * longitude
    x, y = (
        np.cos(latitude)[:, None] * np.cos(longitude),
        np.cos(latitude)[:, None] * np.sin(longitude),
    )
    soft = 2.5 * np.pi / width

    def step(distance: np.ndarray) -> np.ndarray:
        return np.clip(0.5 + distance / soft, 0, 1)[..., None]

    if number == 0:
        return np.broadcast_to(cream, (*z.shape, 3)).copy()
    band = step(0.56 - np.abs(z)) if number > 8 else 1.0
    skin = cream + (colour - cream) * band + 0 * z[..., None]
    size = 256
    plate = Image.new("L", (size, size), 0)
    ImageDraw.Draw(plate).text(
        (size / 2, size / 2),
        str(number),
        255,
        ImageFont.load_default(150 if number < 10 else 128),
        anchor="mm",
        stroke_width=5,
    )
    if number in (6, 9):
        ImageDraw.Draw(plate).rectangle(
            (size * 0.36, size * 0.76, size * 0.64, size * 0.80), 255
        )
    glyph = np.asarray(plate, np.float32) / 255
    reach = 0.40  # sine of the disc's angular radius
    for side in (1, -1):
        column, row = (
            (side * y / reach * 0.62 + 0.5) * size,
            (-z / reach * 0.62 + 0.5) * size,
        )
        ink = cv2.remap(
            glyph,
            column.astype(np.float32),
            row.astype(np.float32),
            cv2.INTER_LINEAR,
            borderValue=0,
        )
        disc = step(reach - np.hypot(y, z)) * (side * x > 0)[..., None]
        ink = ink[..., None] * (side * x > 0)[..., None]
        skin = skin + (cream - skin) * disc
        skin = skin + (srgb(18, 17, 18) - skin) * ink
    return skin
