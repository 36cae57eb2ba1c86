"""Linear light -> an 8-bit photo as cheap and good cameras take them: exposure, blur, noise, tone, JPEG."""

from __future__ import annotations

from functools import lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray

from .hand import Array, Hand

CURVE = (np.arange(4096) / 4095.0).astype(np.float32) ** np.float32(1 / 2.2)
"""Display value of each of 4096 steps of linear light."""


@lru_cache(maxsize=2)
def _noise(soft: bool) -> Array:
    """(512, 512, 3) of deviation about 1, the same always; pictures take windows of it."""
    values = np.random.default_rng(7).standard_normal((512, 512, 3), np.float32)
    return cv2.GaussianBlur(values, (0, 0), 0.7) * 2 if soft else values


def _grain(hand: Hand, size: int) -> Array:
    values = _noise(hand.chance(0.4))
    if size > 512:
        return hand.rng.standard_normal((size, size, 3), np.float32)
    y, x = hand.whole(0, 512 - size), hand.whole(0, 512 - size)
    return values[y : y + size, x : x + size] * hand.one_of([-1, 1])


def develop(hand: Hand, light: Array) -> NDArray[np.uint8]:
    """(H, W, 3) linear -> (H, W, 3) sRGB."""
    size = light.shape[0]
    y, x = np.mgrid[-1 : 1 : size * 1j, -1 : 1 : size * 1j].astype(np.float32)
    turn, slope = hand.between(0, 6.283), hand.between(0, 0.45) * hand.whole(0, 1)
    fall = 1 + slope * (x * np.float32(np.cos(turn)) + y * np.float32(np.sin(turn)))
    if hand.chance(0.35):
        fall = fall * (1 - hand.between(0.1, 0.5) * (x * x + y * y) / 2)
    if hand.chance(0.12):
        cx, cy, wide = hand.between(-1, 1), hand.between(-1, 1), hand.between(0.1, 0.8)
        fall = fall * (0.35 + np.exp(-((x - cx) ** 2 + (y - cy) ** 2) / wide))
    light = light * fall[..., None]
    bright = float(np.percentile(light[::4, ::4], 92)) + 1e-4
    light = light * np.float32(
        hand.one_of(
            [hand.between(0.5, 0.95), hand.between(0.14, 0.4), hand.between(0.9, 1.5)],
            [7, 1.5, 1.2],
        )
        / max(bright, 0.12)
    )
    if hand.chance(0.4):
        light = cv2.GaussianBlur(light, (0, 0), hand.between(0.3, 1.1))
    light = light * (1 + 0.05 * hand.rng.standard_normal(3).astype(np.float32))
    if hand.chance(0.6):
        strength = hand.between(0.004, 0.03)
        light = light + _grain(hand, size) * np.float32(strength) * np.sqrt(
            np.maximum(light, 0.01)
        )
    knee = np.maximum(light - 0.7, 0)
    light = np.where(light > 0.7, 0.7 + 0.3 * knee / (knee + 0.3), np.maximum(light, 0))
    value = CURVE[np.minimum(light * 4095, 4095).astype(np.uint16)]
    if hand.chance(0.4):
        value = (
            value + hand.between(-0.5, 0.6) * value * (1 - value) * (value - 0.5) * 2
        )  # contrast
    if hand.chance(0.12):
        low = hand.between(0.05, 0.35)
        value = low + value * hand.between(0.35, 0.95 - low)
    grey = cv2.transform(value, np.full((1, 3), 1 / 3, np.float32))[..., None]
    colourful = hand.one_of([1.0, hand.between(0.5, 1.3), 0.0], [5, 4, 0.4])
    value = grey + (value - grey) * np.float32(colourful)
    photo = np.clip(value * 255 + 0.5, 0, 255).astype(np.uint8)
    if hand.chance(0.1):
        small = cv2.resize(photo, None, fx=0.55, fy=0.55, interpolation=cv2.INTER_AREA)
        photo = cv2.resize(small, (size, size), interpolation=cv2.INTER_CUBIC)
    if hand.chance(0.15):
        soft = cv2.GaussianBlur(photo, (0, 0), 1.2)
        photo = cv2.addWeighted(photo, 1.6, soft, -0.6, 0)
    if hand.chance(0.55):
        _, code = cv2.imencode(
            ".jpg", photo[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, hand.whole(30, 95)]
        )
        photo = np.ascontiguousarray(cv2.imdecode(code, cv2.IMREAD_COLOR)[..., ::-1])
    return photo
