"""A large photo and what is known of it -> the same at a size that a video can have."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np

from physgen.perceive.roles import Rgb
from physgen.perceive.scene import Found

LONGEST_SIDE = 1600
"""px, unless told: more than most screens show of a clip, and perception takes seconds."""


def smaller(rgb: Rgb, side: int) -> Rgb:
    """The photo (H, W, 3) with its longer side at most `side` px, averaged over areas; itself where it is no larger."""
    height, width = rgb.shape[:2]
    scale = side / max(height, width)
    if scale >= 1:
        return rgb
    size = (max(1, round(width * scale)), max(1, round(height * scale)))
    return np.asarray(cv2.resize(rgb, size, interpolation=cv2.INTER_AREA), np.uint8)


def fitted(found: Found, full: Rgb, rgb: Rgb) -> Found:
    """Objects marked on the photo `full`, on the smaller `rgb`; those marked at its size already stay as they are."""
    if rgb is full or found.labels.shape != full.shape[:2]:
        return found
    size = (rgb.shape[1], rgb.shape[0])
    labels = cv2.resize(found.labels, size, interpolation=cv2.INTER_NEAREST)
    return replace(found, labels=np.asarray(labels, np.uint16))
