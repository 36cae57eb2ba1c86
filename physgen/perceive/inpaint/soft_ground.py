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
    texture_blur: float = 8.0
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
    shading = blur_known_pixels(photo, known, TUNING.texture_blur)
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
    # Levels are shading of their own: a blur would move their steps to the texture.
    levels = _continue_levels(border, hole)
    fill_result = harmonic_fill(border - levels, hole, TUNING.error)
    composite = np.where(hole[..., None], fill_result, photo - levels)
    smooth_shading = cv2.GaussianBlur(composite, (0, 0), TUNING.shading)
    return np.asarray(smooth_shading + levels, np.float32)


def _continue_levels(shading: F32, hole: Mask) -> F32:
    """Return levels (H, W, 3) of rows that differ as on both sides of the `hole` (H,
    W).

    A soft horizon, e.g. the bend of a backdrop, is on both sides of an object, and a
    fill that is smooth in all directions would lose it. Each piece of the hole has a
    level per row; beside the pieces, the levels change softly along the rows.
    """
    steps = np.diff(shading, axis=0, prepend=shading[:1])
    known_mask = ~hole
    known_mask[1:] &= known_mask[:-1]
    columns = np.arange(hole.shape[1])
    weighted_levels = np.zeros_like(shading)
    total_weight = np.zeros(hole.shape[1], np.float32)
    for (rows, span), piece in hole_pieces(hole):
        profile = np.zeros((len(hole), shading.shape[2]), np.float32)
        profile[rows] = _shared_steps(steps, known_mask, (rows, span), piece)
        distance = np.maximum(span.start - columns, columns - span.stop + 1)
        closeness = 1 / (1 + np.maximum(distance, 0) / TUNING.shading) ** 4
        weight = np.float32(np.count_nonzero(piece)) * closeness.astype(np.float32)
        weighted_levels += np.cumsum(profile, axis=0)[:, None] * weight[:, None]
        total_weight += weight
    least_weight = np.float32(1e-6)
    levels = weighted_levels / np.maximum(total_weight, least_weight)[:, None]
    return np.asarray(levels, np.float32)


def _shared_steps(
    steps: F32, known_mask: Mask, part: tuple[slice, slice], piece: Mask
) -> F32:
    """Return the steps (h, 3) from row to row that both sides of a piece share.

    `steps` (H, W, 3) are those of the photo, and `piece` (h, w) is in the box `part`.
    Of two steps with one sign, the smaller one is shared.
    """
    shared_steps = np.zeros((len(piece), steps.shape[2]), np.float32)
    for index, row in enumerate(piece):
        inside = part[1].start + np.flatnonzero(row)
        if not len(inside):
            continue
        y = part[0].start + index
        left = slice(max(inside[0] - TUNING.ring, 0), inside[0])
        right = slice(inside[-1] + 1, inside[-1] + 1 + TUNING.ring)
        first = _mean_step(steps[y, left], known_mask[y, left])
        second = _mean_step(steps[y, right], known_mask[y, right])
        size = np.minimum(np.abs(first), np.abs(second))
        has_same_sign = np.sign(first) == np.sign(second)
        shared_steps[index] = np.where(has_same_sign, np.sign(first) * size, 0)
    return shared_steps


def _mean_step(steps: F32, known_mask: Mask) -> F32:
    """Return the mean (3,) of the known steps (n, 3); 0 without any."""
    if not known_mask.any():
        return np.zeros(steps.shape[1], np.float32)
    return np.asarray(steps[known_mask].mean(axis=0), np.float32)
