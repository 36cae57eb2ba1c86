"""Noise that brings the fine texture of a fill to the strength of its surroundings.

Means and joined copies of patches are smoother than the photo. The missing strength is
measured apart for bands of fine detail, near each pixel, and is added as noise. Edges
hardly count, because squares far above the median are limited.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache

import cv2
import numpy as np

from physgen.maps import F32
from physgen.perceive.roles import Mask


@dataclass(frozen=True)
class _Tuning:
    """Sizes and limits, chosen on the tuning half of `benchmarks/fills.py`; px."""

    # Standard deviations of the blurs between the bands.
    blurs: tuple[float, ...] = (0.7, 1.4, 2.8)
    # Distance from the hole's border at which detail is measured: nearer pixels belong
    # to a seam, or to the blurred rim of an object.
    gap: int = 3
    # Distance from the hole's border up to which its surroundings are measured.
    reach: int = 16
    # Limit of squares over their median around the hole.
    limit: float = 1.5
    # Side of the blocks in which squares are averaged.
    block: int = 4
    # Standard deviations of the blurs of these means, and their weights: the wide blur
    # counts only far from the surroundings.
    local_blurs: tuple[tuple[float, float], ...] = ((10.0, 1.0), (40.0, 1e-3))
    # Weight of the surroundings below which their strength is unknown.
    least_weight: float = 1e-6
    # Levels below white at which noise begins to be cut off.
    headroom: float = 40.0
    # Least number of measured pixels in the hole and around it.
    fewest: int = 50
    # Side of the tile of noise.
    tile: int = 256


TUNING = _Tuning()


def match_grain(filled: F32, photo: F32, hole: Mask) -> F32:
    """Return `filled` (H, W, 3) with noise in the `hole` (H, W), so that its detail is
    as strong as that of the `photo` (H, W, 3) around the hole.
    """
    if not hole.any() or hole.all():
        return filled
    left, top, width, height = cv2.boundingRect(hole.view(np.uint8))
    margin = TUNING.reach + round(4 * TUNING.blurs[-1])
    box = np.s_[
        max(0, top - margin) : top + height + margin,
        max(0, left - margin) : left + width + margin,
    ]
    noise = _missing_noise(filled[box], photo[box], hole[box])
    if noise is None:
        return filled
    result = filled.copy()
    result[box] += noise[..., None]
    return result


def _missing_noise(filled: F32, photo: F32, hole: Mask) -> F32 | None:
    """Return the noise (H, W) that `filled` lacks in the `hole`; None if too little is
    visible.
    """
    outside = cv2.distanceTransform((~hole).view(np.uint8), cv2.DIST_L2, 5)
    inside = cv2.distanceTransform(hole.view(np.uint8), cv2.DIST_L2, 5)
    surroundings = (outside > TUNING.gap) & (outside <= TUNING.reach)
    inner_hole = inside > TUNING.gap
    if min(surroundings.sum(), inner_hole.sum()) < TUNING.fewest:
        return None
    composite = np.where(hole[..., None], filled, photo)
    result = np.zeros(hole.shape, np.float32)
    for band, tile in zip(_bands(composite), _noise_bands(), strict=True):
        squares = band**2
        limit = TUNING.limit * float(np.median(squares[surroundings]))
        if limit <= 0:
            continue
        squares = np.minimum(squares, limit)
        strength = _local_means(squares, surroundings)
        own_strength = _local_means(squares, inner_hole)
        amplitude = np.sqrt(np.maximum(strength - own_strength, 0))
        result += amplitude * _repeat_tile(tile, hole.shape)
    fade = np.minimum(inside / TUNING.gap, 1)
    # Noise of a saturated sky is cut off.
    headroom = np.clip((255 - filled.mean(axis=2)) / TUNING.headroom, 0, 1)
    return np.asarray(result * fade * headroom, np.float32)


def _bands(picture: F32) -> Iterator[F32]:
    """Yield the bands of fine detail (H, W) of a picture (H, W, 3), finest first."""
    grey = np.asarray(picture.mean(axis=2), np.float32)
    finer = grey
    for sigma in TUNING.blurs:
        coarser = np.asarray(cv2.GaussianBlur(grey, (0, 0), sigma), np.float32)
        yield finer - coarser
        finer = coarser


@cache
def _noise_bands() -> tuple[F32, ...]:
    """Return bands (tile, tile) of white noise, each with a mean square of 1."""
    side = TUNING.tile
    values = np.random.default_rng(0).standard_normal((side, side))
    margin = round(4 * TUNING.blurs[-1])
    # The tile continues at its borders.
    padded = np.pad(values.astype(np.float32), margin, mode="wrap")
    bands = []
    for band in _bands(padded[..., None]):
        inner_band = band[margin:-margin, margin:-margin]
        bands.append(inner_band / np.sqrt((inner_band**2).mean()))
    return tuple(bands)


def _repeat_tile(tile: F32, shape: tuple[int, ...]) -> F32:
    """Return a repeated tile of `shape` (H, W)."""
    counts = [-(-side // TUNING.tile) for side in shape]
    return np.tile(tile, counts)[: shape[0], : shape[1]]


def _local_means(values: F32, mask: Mask) -> F32:
    """Return local means (H, W) of `values` (H, W) in `mask` (H, W), in blocks."""
    weight = mask.astype(np.float32)
    size = weight.shape[1], weight.shape[0]
    small_size = -(-size[0] // TUNING.block), -(-size[1] // TUNING.block)
    blocks = [
        cv2.resize(part, small_size, interpolation=cv2.INTER_AREA)
        for part in (values * weight, weight)
    ]
    sums, weights = (
        sum(
            gain * cv2.GaussianBlur(part, (0, 0), sigma / TUNING.block)
            for sigma, gain in TUNING.local_blurs
        )
        for part in blocks
    )
    means = np.asarray(sums / np.maximum(weights, TUNING.least_weight), np.float32)
    return np.asarray(cv2.resize(means, size, interpolation=cv2.INTER_LINEAR))
