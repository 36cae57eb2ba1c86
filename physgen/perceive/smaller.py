"""A large photo and what is known of it -> the same at a size that a video can have."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np

from physgen.perceive.found import Found
from physgen.perceive.roles import Rgb
from physgen.photometry import decode, encode_u8

LONGEST_SIDE = 1600
"""px, unless told: more than most screens show of a clip, and perception takes seconds."""


def smaller(rgb: Rgb, side: int) -> Rgb:
    """The photo (H, W, 3) with its longer side at most `side` px; itself where it is no larger.

    Averaged over areas in linear light, as a camera of fewer pixels would have seen it.
    """
    height, width = rgb.shape[:2]
    scale = side / max(height, width)
    if scale >= 1:
        return rgb
    size = (max(1, round(width * scale)), max(1, round(height * scale)))
    light = (decode(np.arange(256, dtype=np.uint8)) * np.float32(65535) + np.float32(0.5)).astype(np.uint16)
    small = np.empty((size[1], size[0], 3), np.uint8)
    for c in range(3):  # one by one: the light of a large photo is twice its size
        mean = cv2.resize(cv2.LUT(cv2.extractChannel(rgb, c), light), size, interpolation=cv2.INTER_AREA)
        small[:, :, c] = encode_u8(mean.astype(np.float32) / np.float32(65535))
    return small


def fitted(found: Found, full: tuple[int, int], rgb: Rgb) -> Found:
    """Objects marked on the photo of `full` width and height, px, on the smaller `rgb`; others stay as they are."""
    size = (rgb.shape[1], rgb.shape[0])
    if size == full or found.labels.shape != full[::-1]:
        return found
    labels = cv2.resize(found.labels, size, interpolation=cv2.INTER_NEAREST_EXACT)
    return replace(found, labels=np.asarray(labels, np.uint16))
