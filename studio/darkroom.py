"""Linear light <-> 8-bit sRGB pictures: exposure, denoising, a film's shoulder, files on disk. No Mitsuba here."""

from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray
from PIL import Image

KNEE = 0.55  # of white: below it a photo is proportional to light


def falloff(height: int, width: int, vignette: float) -> np.ndarray:
    """(H, W, 1): what the lens lets through, 1 in the middle, 1 - vignette in the corners."""
    y, x = np.mgrid[:height, :width]
    middle = (height - 1) / 2, (width - 1) / 2
    radius2 = ((x - middle[1]) ** 2 + (y - middle[0]) ** 2) / (
        (width / 2) ** 2 + (height / 2) ** 2
    )
    return (1 - vignette * radius2)[..., None]


def develop(light: np.ndarray, exposure: float, vignette: float) -> NDArray[np.uint8]:
    """(H, W, 3) uint8 sRGB: exposure, vignette, a film-like shoulder, the sRGB curve.

    Below KNEE the shoulder is the identity, so mid-tones stay proportional to light; above it, light is rolled off
    smoothly (first derivative continuous) towards 1. Rounding is dithered to keep walls free of bands.
    """
    height, width = light.shape[:2]
    value = np.maximum(light, 0) * exposure * falloff(height, width, vignette)
    over = np.maximum(value - KNEE, 0)
    value = np.where(value < KNEE, value, KNEE + (1 - KNEE) * over / (over + 1 - KNEE))
    dither = np.random.default_rng(0).uniform(
        -0.5, 0.5, (height, width, 1)
    )  # the same for photo and plates
    return np.clip(np.round(encode(value) * 255 + dither), 0, 255).astype(np.uint8)


def undevelop(photo: np.ndarray, exposure: float, vignette: float) -> np.ndarray:
    """(H, W, 3) linear light of a photo that `develop` made; near white it is only roughly known."""
    value = decode(photo / 255.0)
    over = np.maximum(value - KNEE, 0) / (1 - KNEE)
    value = np.where(
        value < KNEE, value, KNEE + (1 - KNEE) * over / np.maximum(1 - over, 0.02)
    )
    return value / exposure / falloff(*photo.shape[:2], vignette)


def encode(value: np.ndarray) -> np.ndarray:
    """Linear light 0..1 -> sRGB 0..1 (IEC 61966-2-1)."""
    return np.where(
        value <= 0.0031308,
        12.92 * value,
        1.055 * np.maximum(value, 1e-9) ** (1 / 2.4) - 0.055,
    )


def decode(value: np.ndarray) -> np.ndarray:
    """SRGB 0..1 -> linear light 0..1."""
    return np.where(value <= 0.04045, value / 12.92, ((value + 0.055) / 1.055) ** 2.4)


def denoise(
    light: np.ndarray, albedo: np.ndarray | None, normals: np.ndarray
) -> np.ndarray:
    """(H, W, 3) linear light without the noise of its samples (Intel Open Image Denoise, guided by albedo and normals)."""
    from pyoidn import denoise as clean

    def plain(values: np.ndarray) -> np.ndarray:
        return np.ascontiguousarray(values, np.float32)

    guides = {"normal": plain(normals)} | (
        {} if albedo is None else {"albedo": plain(np.clip(albedo, 0, 1))}
    )
    if albedo is None:
        guides = {"albedo": np.ones_like(plain(light)), **guides}
    return np.asarray(clean(plain(light), **guides, hdr=True))


def png(path: Path, values: np.ndarray) -> None:
    """8 or 16 bits, grey or RGB, as small as PNG gets."""
    flipped = values[..., ::-1] if values.ndim == 3 else values
    cv2.imwrite(str(path), flipped, [cv2.IMWRITE_PNG_COMPRESSION, 9])


def webp(path: Path, rgb: np.ndarray, quality: int | None = None) -> None:
    """(H, W, 3) uint8; lossless without `quality`."""
    kind = (
        {"lossless": True, "quality": 100} if quality is None else {"quality": quality}
    )
    Image.fromarray(rgb).save(path, "WEBP", method=6, exact=True, **kind)
