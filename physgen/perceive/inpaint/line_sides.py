"""Both sides of a straight line through a hole.

A line through a hole is certain, but copies beside it may still show the other side: a
piece of a bench above the edge of the bench. Such pieces are filled from their own side.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from physgen.arrays import F32, Mask
from physgen.perceive.inpaint.copy_offsets import I64
from physgen.perceive.inpaint.poisson import dilate, harmonic_fill


@dataclass(frozen=True)
class _Tuning:
    """Sizes are px of the reduced photo; chosen by eye."""

    # Distance over which the difference of a piece's colours from those of its own side
    # exceeds that from the other side, over the difference of both sides.
    excess: float = 0.3
    # Least width and height of a wrong piece: smaller ones are specks of the ground.
    width: float = 12.0
    height: float = 1.5
    # Margin around a wrong piece, which is blended into its surroundings, and largest
    # distance of the piece from the strip of the line, which has cut off the piece.
    margin: float = 2.0


TUNING = _Tuning()


@dataclass(frozen=True, eq=False)
class LineSides:
    """Pixels beside a line, and the colours of the ground on both of its sides."""

    pixels: tuple[I64, I64]
    """Rows and columns (n,) of the photo."""
    offsets: F32
    """(n,) px from the line."""
    colours: tuple[F32, F32]
    """(3,) of the side with negative offsets, and of the other one."""
    half_line: float
    """Half the width of the line, px."""
    strip_range: tuple[float, float]
    """Least and largest offset of the painted strip, px."""
    scale: float
    """px of the photo per px of the reduced photo."""


def mend_sides(filled: F32, hole: Mask, sides: LineSides) -> None:
    """Fill pieces of `hole` (H, W) that show the wrong side of a line, in place.

    `filled` (H, W, 3) is the photo with a fill.
    """
    rows, columns = sides.pixels
    # The line itself and its other side are right.
    is_ground = np.abs(sides.offsets) > sides.half_line
    is_wrong = _shows_other_side(filled[rows, columns], sides) & is_ground
    margin = max(1, round(TUNING.margin * sides.scale))
    is_cut = sides.offsets > sides.strip_range[0] - margin
    is_cut &= sides.offsets < sides.strip_range[1] + margin
    wrong_mask, cut_mask, ground_mask = np.zeros((3, *hole.shape), np.bool_)
    wrong_mask[rows[is_wrong], columns[is_wrong]] = True
    cut_mask[rows[is_cut], columns[is_cut]] = True
    wrong_mask = _cut_pieces(wrong_mask & hole, cut_mask, sides.scale)
    if not wrong_mask.any():
        return
    ground_mask[rows[is_ground], columns[is_ground]] = True
    mended_mask = dilate(wrong_mask, margin) & hole & ground_mask
    box = _box_around(mended_mask)
    part = harmonic_fill(filled[box], mended_mask[box])
    filled[mended_mask] = part[mended_mask[box]]


def _shows_other_side(values: F32, sides: LineSides) -> Mask:
    """Return whether colours (n, 3) are those of the other side of the line, (n,)."""
    contrast = float(np.linalg.norm(sides.colours[0] - sides.colours[1]))
    distances = [np.linalg.norm(values - colour, axis=1) for colour in sides.colours]
    excess = np.where(sides.offsets < 0, 1, -1) * (distances[0] - distances[1])
    return np.asarray(excess > TUNING.excess * contrast)


def _box_around(mask: Mask) -> tuple[slice, slice]:
    """Return the rows and columns of a mask (H, W) with a margin of 1 px."""
    left, top, width, height = cv2.boundingRect(mask.view(np.uint8))
    return np.s_[
        max(top - 1, 0) : top + height + 1, max(left - 1, 0) : left + width + 1
    ]


def _cut_pieces(mask: Mask, strip: Mask, scale: float) -> Mask:
    """Return the connected pieces (H, W) of a mask that are no specks and touch the
    `strip` (H, W) of a line.
    """
    count, ids, stats, _ = cv2.connectedComponentsWithStats(
        mask.astype(np.uint8), connectivity=8
    )
    is_large = np.zeros(count, np.bool_)
    longer_side = np.maximum(
        stats[1:, cv2.CC_STAT_WIDTH], stats[1:, cv2.CC_STAT_HEIGHT]
    )
    area = stats[1:, cv2.CC_STAT_AREA]
    least_length = TUNING.width * scale
    is_large[1:] = longer_side >= least_length
    is_large[1:] &= area >= least_length * TUNING.height * scale
    is_cut = np.zeros(count, np.bool_)
    is_cut[np.unique(ids[strip])] = True
    return np.asarray((is_large & is_cut)[ids])
