"""Both sides of a straight line through a hole.

A line through a hole is certain, but copies beside it may still show the other side: a
piece of a bench above the edge of the bench. Such pieces are filled smoothly from their
own side, without grain.
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

    # Least excess of a colour's difference from its own side over that from the other
    # side, as a share of the difference of both sides.
    excess: float = 0.3
    # Least longer side and mean width of a wrong piece: smaller ones are specks.
    least_length: float = 12.0
    least_width: float = 1.5
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
    painted_offsets: tuple[float, float]
    """Least and largest offset of the painted strip, px."""
    largest_offset: float
    """Largest offset of the searched pixels, px."""
    scale: float
    """px of the photo per px of the reduced photo."""


def mend_sides(filled: F32, hole: Mask, sides: LineSides) -> None:
    """Fill pieces of `hole` (H, W) that show the wrong side of a line, in place.

    `filled` (H, W, 3) is the photo with a fill.
    """
    rows, columns = sides.pixels
    distance = np.abs(sides.offsets)
    # The line itself shows neither side.
    ground_pixels = distance > sides.half_line
    wrong_pixels = ground_pixels & has_other_colours(
        filled[rows, columns], sides.offsets, sides.colours
    )
    if not wrong_pixels.any():
        return
    margin = max(1, round(TUNING.margin * sides.scale))
    edge_pixels = sides.offsets > sides.painted_offsets[0] - margin
    edge_pixels &= sides.offsets < sides.painted_offsets[1] + margin
    wrong_mask = _select_pieces(
        _draw_mask(sides, wrong_pixels, hole.shape),
        _draw_mask(sides, edge_pixels, hole.shape),
        _draw_mask(sides, distance > sides.largest_offset - 1, hole.shape),
        sides.scale,
    )
    if not wrong_mask.any():
        return
    ground_mask = _draw_mask(sides, ground_pixels, hole.shape)
    mended_mask = dilate(wrong_mask, margin) & hole & ground_mask
    box = _find_box(mended_mask)
    part = harmonic_fill(filled[box], mended_mask[box])
    filled[mended_mask] = part[mended_mask[box]]


def _draw_mask(sides: LineSides, selection: Mask, shape: tuple[int, ...]) -> Mask:
    """Return the mask (H, W) of selected pixels (n,) beside a line."""
    mask = np.zeros(shape, np.bool_)
    rows, columns = sides.pixels
    mask[rows[selection], columns[selection]] = True
    return mask


def has_other_colours(values: F32, offsets: F32, colours: tuple[F32, F32]) -> Mask:
    """Return whether colours (n, 3) are those of the other side of a line, (n,).

    `offsets` (n,) are those of the pixels; `colours` those of both sides.
    """
    contrast = float(np.linalg.norm(colours[0] - colours[1]))
    distances = [np.linalg.norm(values - colour, axis=1) for colour in colours]
    excess = np.where(offsets < 0, 1, -1) * (distances[0] - distances[1])
    return np.asarray(excess > TUNING.excess * contrast)


def _find_box(mask: Mask) -> tuple[slice, slice]:
    """Return the rows and columns of a mask (H, W) with a margin of 1 px."""
    left, top, width, height = cv2.boundingRect(mask.view(np.uint8))
    return np.s_[
        max(top - 1, 0) : top + height + 1, max(left - 1, 0) : left + width + 1
    ]


def _select_pieces(mask: Mask, strip: Mask, border: Mask, scale: float) -> Mask:
    """Return the connected pieces (H, W) of a mask that the `strip` of a line has cut.

    Specks are left out, and pieces that reach the `border` of the searched pixels: they
    may be other structures.
    """
    count, ids, stats, _ = cv2.connectedComponentsWithStats(
        mask.astype(np.uint8), connectivity=8
    )
    longer_side = np.maximum(stats[:, cv2.CC_STAT_WIDTH], stats[:, cv2.CC_STAT_HEIGHT])
    least_length = TUNING.least_length * scale
    is_piece = longer_side >= least_length
    least_area = least_length * TUNING.least_width * scale
    is_piece &= stats[:, cv2.CC_STAT_AREA] >= least_area
    has_contact = np.zeros(count, np.bool_)
    has_contact[np.unique(ids[strip])] = True
    is_piece &= has_contact
    is_piece[np.unique(ids[border])] = False
    # Id 0 is the rest of the picture.
    is_piece[0] = False
    return np.asarray(is_piece[ids])
