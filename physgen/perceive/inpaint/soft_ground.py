"""Ground whose light and colour change softly: shading apart from texture.

On a table with a soft glare, or on folds of cloth, copies of patches join grounds of
different brightness, and their seams show as steps or flat bands. There the shading is
interpolated across the hole, and only the texture, the photo without its shading, is
copied.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from physgen.maps import F32
from physgen.perceive.inpaint.poisson import (
    blur_known_pixels,
    dilate,
    harmonic_fill,
    hole_pieces,
)
from physgen.perceive.roles import Mask


@dataclass(frozen=True)
class _Tuning:
    """Limits of soft grounds, px of the reduced photo.

    Fifteen photos of objects fall into two groups: up to 1.4 levels per px on tables,
    paper and cloth, and from 2.0 beside walls, horizons and edges of tables.
    """

    # Standard deviation of the blur against texture before slopes are measured.
    smooth: float = 8.0
    # Standard deviation of the blur that separates shading from texture: veins of
    # marble and soft horizons are texture.
    shading: float = 40.0
    # Width of the ground around a piece of the hole.
    ring: int = 24
    # Largest slope of the shading, levels per px, ...
    slope: float = 1.6
    # ... of this share of the ground, in percent.
    share: float = 95.0
    # Standard deviation of the blur of colours at the border of the hole.
    border: float = 3.0
    # Levels: error of the interpolated shading.
    error: float = 0.1


TUNING = _Tuning()
SOBEL = 8.0
"""Sum of the weights of one side of OpenCV's Sobel filter, times 2 px."""


def find_soft_pieces(photo: F32, hole: Mask) -> Mask:
    """Return the pieces of `hole` (H, W) whose surroundings are softly shaded."""
    known = (~hole)[..., None].astype(np.float32)
    shading = blur_known_pixels(photo, known, TUNING.smooth)
    slopes = [
        cv2.Sobel(shading, cv2.CV_32F, *axes) / SOBEL for axes in ((1, 0), (0, 1))
    ]
    slope = np.hypot(*slopes).max(axis=2)
    # Slopes next to the hole are uncertain.
    known_mask = ~dilate(hole, 2)
    soft_mask = np.zeros_like(hole)
    for part, piece in hole_pieces(hole):
        window = tuple(
            slice(max(0, side.start - TUNING.ring), side.stop + TUNING.ring)
            for side in part
        )
        inner = np.zeros(hole[window].shape, np.bool_)
        corner = [
            side.start - edge.start for side, edge in zip(part, window, strict=True)
        ]
        inner[
            corner[0] : corner[0] + piece.shape[0],
            corner[1] : corner[1] + piece.shape[1],
        ] = piece
        ring = dilate(inner, TUNING.ring) & known_mask[window]
        if (
            ring.any()
            and np.percentile(slope[window][ring], TUNING.share) < TUNING.slope
        ):
            soft_mask[window] |= inner
    return soft_mask


def interpolate_shading(photo: F32, hole: Mask) -> F32:
    """Return the shading (H, W, 3) of a photo (H, W, 3), interpolated in `hole` (H,
    W).
    """
    # Colours at the border of the hole are means, so that texture leaves no streaks.
    known = (~hole)[..., None].astype(np.float32)
    border = blur_known_pixels(photo, known, TUNING.border)
    fill_result = harmonic_fill(border, hole, TUNING.error)
    composite = np.where(hole[..., None], fill_result, photo)
    return np.asarray(cv2.GaussianBlur(composite, (0, 0), TUNING.shading), np.float32)
