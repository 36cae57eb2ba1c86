"""Patterns of small texture: a random generator in, (H, W, 3) float32 linear reflectance out."""

from __future__ import annotations

import colorsys

import cv2
import numpy as np

Rng = np.random.Generator

WORDS = [
    "TEA",
    "OATS",
    "COFFEE",
    "rice",
    "Nuts",
    "Soap",
    "HONEY",
    "Flora",
    "PASTA",
    "Kiwi",
    "salt",
    "Mint",
    "Notes",
    "ATLAS",
    "Garden",
    "Poems",
    "Maps",
    "HISTORY",
    "Night",
    "River",
    "cooking",
    "Winter",
    "MUSIC",
    "Stars",
    "The",
    "Sea",
    "OLIVE",
    "BASIL",
    "Cocoa",
    "JAM",
    "Bio",
    "NEW",
    "Fresh",
    "100",
    "500g",
    "75cl",
    "No.",
    "5",
    "Vol.2",
]
FONTS = (
    cv2.FONT_HERSHEY_SIMPLEX,
    cv2.FONT_HERSHEY_DUPLEX,
    cv2.FONT_HERSHEY_TRIPLEX,
    cv2.FONT_HERSHEY_SCRIPT_COMPLEX,
)


def linear(code: object) -> np.ndarray:
    """sRGB 0..255 -> linear 0..1, float32."""
    value = np.asarray(code, np.float32) / 255
    return np.where(
        value <= 0.04045, value / 12.92, ((value + 0.055) / 1.055) ** 2.4
    ).astype(np.float32)


def colour(rng: Rng) -> np.ndarray:
    """(3,) sRGB 0..255, of any hue."""
    pick = rng.random()
    if pick < 0.25:  # whites, greys, blacks with a tinge
        return np.clip(rng.uniform(15, 250) + rng.normal(0, 6, 3), 8, 250)
    saturation = rng.uniform(0.1, 0.5) if pick < 0.6 else rng.uniform(0.5, 0.95)
    return (
        np.array(colorsys.hsv_to_rgb(rng.random(), saturation, rng.uniform(0.2, 1.0)))
        * 255
    )


def plain(code: object) -> np.ndarray:
    """One colour (sRGB 0..255)."""
    return np.broadcast_to(linear(code), (2, 2, 3)).copy()


def noise(shape: tuple[int, int], cell: object, rng: Rng) -> np.ndarray:
    """(H, W) smooth noise of deviation about 1; `cell` px (y, x) or one number is the size of its lumps."""
    cy, cx = np.broadcast_to(np.asarray(cell, float), 2)
    small = rng.standard_normal(
        (int(shape[0] / cy) + 3, int(shape[1] / cx) + 3)
    ).astype(np.float32)
    return cv2.resize(small, (shape[1], shape[0]), interpolation=cv2.INTER_CUBIC)


def _canvas(height: int, width: int, code: np.ndarray) -> np.ndarray:
    return np.broadcast_to(np.asarray(code, np.float32), (height, width, 3)).copy()


def write(
    image: np.ndarray,
    text: str,
    at: tuple[float, float],
    height: float,
    code: np.ndarray,
    font: int,
) -> None:
    """Letters `height` px tall centred `at` (x, y), at most as wide as the image."""
    scale = height / 22
    (wide, _), _ = cv2.getTextSize(text, font, scale, 1)
    scale *= min(1, 0.9 * image.shape[1] / max(wide, 1))
    thick = max(1, round(scale * 2))
    (wide, tall), _ = cv2.getTextSize(text, font, scale, thick)
    place = (int(at[0] - wide / 2), int(at[1] + tall / 2))
    stencil = np.zeros(image.shape[:2], np.uint8)
    cv2.putText(stencil, text, place, font, scale, 255, thick, cv2.LINE_AA)
    image += (np.asarray(code, np.float32) - image) * (
        stencil[..., None] / np.float32(255)
    )


def pattern(rng: Rng, height: int = 96, width: int = 96) -> np.ndarray:
    """Stripes, dots, checks, zigzags, blobs, rings, letters: whatever may be printed on a thing."""
    a, b, c = (colour(rng) for _ in range(3))
    image = _canvas(height, width, a)
    y, x = np.mgrid[:height, :width].astype(np.float32)
    kind, pitch, lean = (
        rng.integers(8),
        rng.uniform(6, 40),
        rng.choice([0, 0, np.pi / 2, rng.uniform(0, np.pi)]),
    )
    wave = (x * np.cos(lean) + y * np.sin(lean)) / pitch
    if kind == 0:
        image[(wave % 1) < rng.uniform(0.15, 0.6)] = b
    elif kind == 1:
        u, v = x / pitch % 1 - 0.5, y / pitch % 1 - 0.5
        image[np.hypot(u, v) < rng.uniform(0.15, 0.42)] = b
    elif kind == 2:
        image[((x // pitch + y // pitch) % 2) > 0] = b
    elif kind == 3:
        image[((y + np.abs(x % pitch - pitch / 2)) / pitch % 1) < 0.45] = b
    elif kind == 4:
        lumps = noise((height, width), pitch, rng)
        image[lumps > rng.uniform(-0.3, 0.6)] = b
        image[lumps > 1.0] = c
    elif kind == 5:
        for _ in range(rng.integers(2, 9)):
            spot, size = (
                rng.uniform(0, [width, height]).astype(int),
                int(rng.uniform(4, width / 3)),
            )
            filled = -1 if rng.random() < 0.5 else int(rng.integers(1, 5))
            code = (b if rng.random() < 0.5 else c).tolist()
            if rng.random() < 0.5:
                cv2.circle(image, spot.tolist(), size, code, filled, cv2.LINE_AA)
            else:
                cv2.rectangle(
                    image,
                    spot.tolist(),
                    (spot + [size, size // 2]).tolist(),
                    code,
                    filled,
                )
    elif kind == 6:
        image[int(height * 0.3) : int(height * 0.7)] = b
        write(
            image,
            _babble(rng),
            (width / 2, height / 2),
            rng.uniform(12, 30),
            c,
            FONTS[rng.integers(3)],
        )
    else:
        image += (b - a) * np.clip(wave / (max(height, width) / pitch), 0, 1)[..., None]
    return linear(
        np.clip(
            image + noise((height, width), 2, rng)[..., None] * rng.uniform(0, 6),
            0,
            255,
        )
    )


def _babble(rng: Rng) -> str:
    return "".join(
        rng.choice(list("ABEGHKLMNOPRSTXZaegknost0123456789"), rng.integers(1, 6))
    )


def surface_print(rng: Rng, size: int = 256) -> np.ndarray:
    """A table's, floor's or wall's finish: grain, planks, tiles, weave, speckles, or a print."""
    a = colour(rng)
    if rng.random() < 0.5:  # woods
        a = (
            np.array(
                colorsys.hsv_to_rgb(
                    rng.uniform(0.04, 0.12),
                    rng.uniform(0.15, 0.7),
                    rng.uniform(0.2, 0.95),
                )
            )
            * 255
        )
        grain = noise(
            (size, size), (rng.uniform(1.5, 5), size / rng.uniform(2, 6)), rng
        )
        broad = noise((size, size), (rng.uniform(8, 40), size / 2), rng)
        image = (
            a
            * (1 + rng.uniform(0.02, 0.13) * grain + rng.uniform(0.0, 0.14) * broad)[
                ..., None
            ]
        )
        if rng.random() < 0.5:
            boards = int(rng.integers(2, 9))
            row = np.arange(size) * boards // size
            image *= rng.uniform(0.8, 1.15, boards)[row][:, None, None]
            image[np.diff(row, prepend=-1) > 0] *= 0.45
        return linear(np.clip(image, 0, 255))
    b = colour(rng)
    y, x = np.mgrid[:size, :size].astype(np.float32)
    kind = rng.integers(6)
    if kind == 0:
        image = (
            _canvas(size, size, a)
            * (1 + rng.uniform(0, 0.06) * noise((size, size), size / 6, rng))[..., None]
        )
    elif kind == 1:
        pitch = size / rng.integers(2, 9)
        image = (
            _canvas(size, size, a)
            * (1 + 0.05 * noise((size, size), pitch, rng))[..., None]
        )
        gap = np.minimum(x % pitch, y % (pitch * rng.choice([1, 0.5]))) < rng.uniform(
            1.5, 5
        )
        image[gap] = b
    elif kind == 2:
        speck = noise((size, size), rng.uniform(1, 5), rng)
        image = np.where((speck > rng.uniform(0.5, 1.5))[..., None], b, a)
    elif kind == 3:
        fibre = noise((size, size), (1.2, 6), rng) + noise((size, size), (6, 1.2), rng)
        image = a * (1 + rng.uniform(0.03, 0.1) * fibre)[..., None]
    elif kind == 4:
        veins = np.abs(
            noise((size, size), size / 5, rng)
            + 0.4 * noise((size, size), size / 16, rng)
        )
        image = a + (b - a) * np.clip(1 - veins * rng.uniform(3, 12), 0, 1)[
            ..., None
        ] * rng.uniform(0.2, 0.9)
    else:
        return cv2.resize(
            pattern(rng, 128, 128), (size, size), interpolation=cv2.INTER_LINEAR
        )
    return linear(np.clip(image + noise((size, size), 1, rng)[..., None] * 2, 0, 255))


def cover(rng: Rng, height: int = 120, width: int = 84) -> np.ndarray:
    """A book's front cover or a box's face."""
    image = pattern(rng, height, width)
    if rng.random() < 0.6:
        code = colour(rng)
        flat = np.ascontiguousarray(image)
        write(
            flat,
            _babble(rng),
            (width / 2, height * rng.uniform(0.15, 0.8)),
            rng.uniform(10, 24),
            linear(code),
            FONTS[1],
        )
        return flat
    return image


def spine(rng: Rng, base: np.ndarray, height: int = 120, width: int = 24) -> np.ndarray:
    """A book's back in the linear colour `base`: its title along it, bands across."""
    image = np.broadcast_to(base, (height, width, 3)).astype(np.float32).copy()
    ink = np.ones(3) * 0.8 if base.mean() < 0.3 else np.ones(3) * 0.04
    if rng.random() < 0.5:
        for spot in rng.uniform(0.05, 0.95, 2):
            image[int(spot * height) : int(spot * height) + 5] = ink * rng.uniform(
                0.3, 1
            )
    lying = np.ascontiguousarray(image.transpose(1, 0, 2))
    text = f"{rng.choice(WORDS)} {rng.choice(WORDS)}"
    write(
        lying,
        text,
        (height / 2, width / 2),
        width * rng.uniform(0.4, 0.7),
        ink,
        FONTS[rng.integers(3)],
    )
    return lying.transpose(1, 0, 2)[::-1].copy()


def net(cells: list[np.ndarray], size: int = 96) -> np.ndarray:
    """Six faces (front, right, top, back, left, bottom) as `solids.box` unfolds them: (2 size, 3 size, 3)."""
    small = [
        cv2.resize(cell, (size, size), interpolation=cv2.INTER_AREA) for cell in cells
    ]
    return np.concatenate(
        [np.concatenate(small[:3], 1), np.concatenate(small[3:], 1)], 0
    )
