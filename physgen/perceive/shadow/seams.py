"""Seams, cracks and gaps between boards, which are narrower than shade."""

from __future__ import annotations

import cv2
import numpy as np

from physgen.maps import F32
from physgen.perceive.roles import Mask

SEAM = 0.12
"""Width of the widest seam as a share of an object's size; by eye on a jar and a robot
on boards.
"""


def without_seams(depth: F32, own_mask: Mask, size: float) -> F32:
    """Return depths (h, w, n) of shade without narrow lines away from an object.

    `own_mask` (h, w) is the object, `size` its size, px. A strip along the object is
    kept: it is contact shade, or a glow.
    """
    side = 2 * round(SEAM * size / 2) + 1
    kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (side, side))
    is_own = own_mask[..., None]
    # The object counts as deep shade, and then as bright light, so that strips beside
    # it are as wide as the object.
    shade = np.where(is_own, depth.max(initial=0), depth).astype(np.float32)
    opening = cv2.morphologyEx(shade, cv2.MORPH_OPEN, kernel).reshape(depth.shape)
    light = np.where(is_own, depth.min(initial=0), opening).astype(np.float32)
    closing = cv2.morphologyEx(light, cv2.MORPH_CLOSE, kernel).reshape(depth.shape)
    return np.where(is_own, depth, closing).astype(np.float32)
