"""Grain of filled pixels, copied from the known picture."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.maps import F32
from physgen.perceive.roles import Mask

Places = NDArray[np.int64]
"""(n, 2): rows and columns."""


@dataclass(frozen=True)
class _Tuning:
    """Sizes and limits of grain."""

    # px: standard deviation of the blur between grain and colour.
    blur: float = 2.0
    # px: side of blocks with one source of grain.
    block: int = 16
    # Largest strength of grain over that around the hole; more is an edge.
    largest_strength: float = 4.0
    # px around the hole from which grain is measured.
    margin: int = 10
    # Least and largest factor of the fill's grain.
    gain: tuple[float, float] = (
        0.8,
        1.6,
    )


TUNING = _Tuning()


def add_grain(guess: F32, picture: F32, hole: Mask, field: NDArray[np.int64]) -> F32:
    """Return `guess` (H, W, 3) with the grain of `picture` at the sources in `field`.

    A mean of votes is smooth, and smooth patches match smooth sources. Therefore the
    fine part of each block is copied from a single source, which keeps its spectrum,
    and scaled to the strength around the hole.
    """
    picture_grain = _fine_part(picture, hole)
    ring = cv2.dilate(hole.astype(np.uint8), square(TUNING.margin)) > 0
    ring_strength = _grain_strength(picture_grain[ring & ~hole])
    y, x = np.nonzero(hole)
    fill_grain, block_grain = (
        picture_grain[rows, columns]
        for rows, columns in (field[y, x].T, _in_blocks(field, hole).T)
    )
    strongest = np.maximum(np.abs(fill_grain), np.abs(block_grain)).max(axis=1)
    is_grain = strongest < TUNING.largest_strength * ring_strength
    fill_grain = np.where(is_grain[:, None], block_grain, fill_grain)
    inside = _grain_strength(fill_grain)
    if ring_strength > 0 and inside > 0:
        fill_grain *= np.float32(np.clip(ring_strength / inside, *TUNING.gain))
    has_grain = (is_grain | _coherent(field)[y, x])[:, None]
    smooth_guess = cv2.GaussianBlur(guess, (0, 0), TUNING.blur)[y, x]
    result = guess.copy()
    result[y, x] = np.where(has_grain, smooth_guess + fill_grain, guess[y, x])
    return result


def _fine_part(picture: F32, hole: Mask) -> F32:
    """Return the known picture (H, W, 3) minus its blur."""
    known_weights = np.where(hole, np.float32(0), np.float32(1))
    share = np.maximum(
        cv2.GaussianBlur(known_weights, (0, 0), TUNING.blur), np.float32(1e-3)
    )
    smooth_picture = (
        cv2.GaussianBlur(picture * known_weights[:, :, None], (0, 0), TUNING.blur)
        / share[:, :, None]
    )
    return np.asarray(picture - smooth_picture, np.float32)


def _coherent(field: NDArray[np.int64]) -> Mask:
    """Return the pixels (H, W) whose neighbours have neighbouring sources.

    An edge copied from many sources is not a line.
    """
    shifts = field.astype(np.float32) - np.moveaxis(
        np.indices(field.shape[:2], np.float32), 0, -1
    )
    return np.asarray(
        (cv2.dilate(shifts, square(2)) - cv2.erode(shifts, square(2))).max(axis=2) <= 2
    )


def _in_blocks(field: NDArray[np.int64], hole: Mask) -> Places:
    """Return the sources of the hole's pixels, with one shift per block if it is known.

    A shift per pixel would show patterns.
    """
    hole_pixels, side, last = (
        np.argwhere(hole),
        TUNING.block,
        np.array(hole.shape) - 1,
    )
    middle = np.minimum(hole_pixels // side * side + side // 2, last)
    block_sources = hole_pixels + field[middle[:, 0], middle[:, 1]] - middle
    clipped_sources = np.clip(block_sources, 0, last)
    valid = (clipped_sources == block_sources).all(axis=1) & ~hole[
        clipped_sources[:, 0], clipped_sources[:, 1]
    ]
    return np.where(
        valid[:, None], block_sources, field[hole_pixels[:, 0], hole_pixels[:, 1]]
    )


def _grain_strength(fine: F32) -> float:
    """Return the strength of grain (n, 3) in levels.

    It is the root of a median, so that an edge does not count as grain.
    """
    return float(np.median((fine**2).mean(axis=1)) ** 0.5) if len(fine) else 0.0


def square(radius: int) -> NDArray[np.uint8]:
    """Return a kernel of 1 that reaches `radius` px in all directions."""
    return np.ones((2 * radius + 1, 2 * radius + 1), np.uint8)
