"""From linear light to what a pocket camera stores: exposure, white balance, tone, blur, noise, JPEG. No Mitsuba."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from studio.darkroom import encode
from studio.segmentation.homes.prints import Rng


def finish(light: np.ndarray, rng: Rng) -> NDArray[np.uint8]:
    """(H, W, 3) linear light -> uint8 sRGB; exposed for the middle, with coarse errors."""
    light = np.nan_to_num(np.maximum(light, 0), posinf=1e4)
    grey = light.mean(-1)
    key = 0.5 * np.exp(np.log(grey + 1e-3).mean()) + 0.5 * np.median(grey)
    bright = np.percentile(grey, 97)
    value = (
        light
        * min(0.2 / max(key, 1e-4), 1.5 / max(bright, 1e-4))
        * np.exp(rng.normal(0, 0.35))
    )
    balance = np.exp(
        rng.normal(0, 0.09, 3) + np.array([1, 0, -1]) * rng.normal(0, 0.07)
    )
    cast = (value.reshape(-1, 3).mean(0) + 1e-6) / value.mean()
    value = value * balance / cast ** rng.uniform(0.4, 0.9)
    height, width = value.shape[:2]
    y, x = np.mgrid[-1 : 1 : height * 1j, -1 : 1 : width * 1j]
    value = value * (1 - rng.uniform(0, 0.3) * (x**2 + y**2) / 2)[..., None]
    if rng.random() < 0.6:
        value = cv2.GaussianBlur(value, (0, 0), rng.uniform(0.25, 0.9))
    noise = rng.uniform(0, 0.02) * np.sqrt(np.maximum(value, 0) + 0.02)
    value = value + noise[...] * rng.standard_normal(value.shape)
    knee = 0.6
    over = np.maximum(value - knee, 0)
    value = np.clip(
        np.where(value < knee, value, knee + (1 - knee) * over / (over + 1 - knee)),
        0,
        1,
    )
    shown = encode(value)
    contrast = rng.uniform(0, 0.6)
    shown = shown + contrast * (shown * shown * (3 - 2 * shown) - shown)
    photo = np.round(np.clip(shown, 0, 1) * 255).astype(np.uint8)
    if rng.random() < 0.7:
        _, packed = cv2.imencode(
            ".jpg",
            photo[..., ::-1],
            [cv2.IMWRITE_JPEG_QUALITY, int(rng.integers(55, 96))],
        )
        photo = cv2.imdecode(packed, cv2.IMREAD_COLOR)[..., ::-1]
    return np.ascontiguousarray(photo)
