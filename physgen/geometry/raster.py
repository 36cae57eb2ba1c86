"""Exact pixel coverage of an outline, and pictures of twice the resolution."""

from __future__ import annotations

from dataclasses import dataclass
from math import ceil, floor, pi, sin, sqrt

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.arrays import F32
from physgen.geometry.polygon import Array, Disc, Outline, bounds, cross

_SAGITTA = 1e-4
"""Distance of a chord from its circle, px; the coverage is then exact to about 1e-4."""


def coverage(outline: Outline, size: tuple[int, int]) -> F32:
    """Return the covered share of each pixel of a photo of `size` (W, H): `(H, W)`
    float32.
    """
    width, height = size
    canvas = np.zeros((height, width), dtype=np.float32)
    box, (x0, y0) = coverage_box(outline, (0, 0, width, height))
    rows = slice(y0, y0 + box.shape[0])
    columns = slice(x0, x0 + box.shape[1])
    canvas[rows, columns] = box
    return canvas


def coverage_box(
    outline: Outline, window: tuple[int, int, int, int] | None = None
) -> tuple[F32, tuple[int, int]]:
    """Return the coverage 0..1 on the outline's own box, `(h, w)`, and its first pixel.

    Only pixels in `window` (x0, y0, x1, y1: first and last + 1) are computed, however
    large the outline is; without common pixels the box is empty.
    """
    x0, y0, x1, y1 = _pixel_box(outline, window)
    width = x1 - x0
    height = y1 - y0
    if window is not None and (width <= 0 or height <= 0):
        empty_shape = (max(height, 0), max(width, 0))
        return np.zeros(empty_shape, np.float32), (x0, y0)
    # Each border segment adds its signed area to the row that it crosses, as
    # differences along the row. Their running sum is the coverage (signed-area
    # accumulation).
    corner = np.array([x0 - 0.5, y0 - 0.5])
    sums = np.zeros((max(height, 1), max(width, 1) + 1))
    if isinstance(outline, Disc):
        borders = [(_circle_points(outline), 1.0)]
    else:
        borders = outline.borders
    for points, sign in borders:
        _accumulate(sums, points - corner, sign)
    inside = np.cumsum(sums, axis=1)[:, :-1]
    return np.clip(inside, 0.0, 1.0).astype(np.float32), (x0, y0)


def _pixel_box(
    outline: Outline, window: tuple[int, int, int, int] | None
) -> tuple[int, int, int, int]:
    """Return the box of an outline's pixels: x0, y0, x1, y1, clipped to a window."""
    left, top, right, bottom = bounds(outline)
    box = (
        floor(left + 0.5),
        floor(top + 0.5),
        ceil(right + 0.5),
        ceil(bottom + 0.5),
    )
    if window is None:
        return box
    first_column, first_row, last_column, last_row = window

    def clip_column(x: int) -> int:
        return min(max(x, first_column), last_column)

    def clip_row(y: int) -> int:
        return min(max(y, first_row), last_row)

    x0, y0, x1, y1 = box
    return clip_column(x0), clip_row(y0), clip_column(x1), clip_row(y1)


def _circle_points(disc: Disc) -> Array:
    """Return the polygon `(K, 2)` px of the disc's own area, with chords at most
    `_SAGITTA` off the circle.
    """
    radius = float(disc.radius)
    # The sagitta of a chord is its squared length over eight radii.
    count = max(12, ceil(pi / sqrt(2 * _SAGITTA / max(radius, 1e-9))))
    step = 2 * pi / count
    angles = np.arange(count) * step
    # A slightly larger polygon has exactly the disc's area.
    outer_radius = radius * sqrt(step / sin(step))
    directions = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    points: Array = disc.center + outer_radius * directions
    return points


def _accumulate(sums: Array, points: Array, sign: float) -> None:
    """Add one border, in box coordinates, to the row-wise differences `sums`.

    In box coordinates pixel i covers [i, i + 1].
    """
    start = points
    end = np.roll(points, -1, axis=0)
    # The direction of the border decides which side is inside.
    twice_area = float(cross(start, end).sum())
    if twice_area < 0:
        sign = -sign
    height, width = sums.shape
    start, end = _window(start, end, width - 1, height)
    for axis in (0, 1):
        start, end = _cut(start, end, axis)
    # After both cuts, each segment lies within a single pixel.
    rise = (end[:, 1] - start[:, 1]) * sign
    middle = (start + end) / 2
    x = middle[:, 0]
    y = middle[:, 1]
    column = np.clip(np.floor(x).astype(np.intp), 0, width - 2)
    row = np.clip(np.floor(y).astype(np.intp), 0, height - 1)
    fraction = x - column
    # On a ring that turns +x towards +y, the inside is to the left of a downward
    # segment.
    np.add.at(sums, (row, column), -rise * (1 - fraction))
    np.add.at(sums, (row, column + 1), -rise * fraction)


def _window(start: Array, end: Array, width: int, height: int) -> tuple[Array, Array]:
    """Clip segments `(K, 2)` to a box.

    Rows outside are dropped; parts to the left or right move to the box's side.
    """
    lower_corner = np.zeros(2)
    upper_corner = np.array([float(width), float(height)])
    lines = []
    for axis in (0, 1):
        lines.append((axis, lower_corner[axis]))
        lines.append((axis, upper_corner[axis]))
    # Split every segment at each side of the box, so that each piece is wholly inside
    # or outside.
    for axis, line in lines:
        start, end = _split(start, end, axis, line)
    # A piece above or below the box covers no row. One beside it still closes its rows,
    # and moves to the side.
    y = (start[:, 1] + end[:, 1]) / 2
    is_inside = (y > 0) & (y < height)
    clipped_start = np.clip(start[is_inside], lower_corner, upper_corner)
    clipped_end = np.clip(end[is_inside], lower_corner, upper_corner)
    return clipped_start, clipped_end


def _split(start: Array, end: Array, axis: int, line: float) -> tuple[Array, Array]:
    """Split segments `(K, 2)` at a line; `axis` is the coordinate that equals `line`."""
    a = start[:, axis]
    b = end[:, axis]
    crosses = (a < line) != (b < line)
    share = (line - a[crosses]) / (b[crosses] - a[crosses])
    near_end = start[crosses]
    far_end = end[crosses]
    middle = near_end + share[:, None] * (far_end - near_end)
    middle[:, axis] = line
    pieces_start = np.concatenate([start[~crosses], near_end, middle])
    pieces_end = np.concatenate([end[~crosses], middle, far_end])
    return pieces_start, pieces_end


def _cut(start: Array, end: Array, axis: int) -> tuple[Array, Array]:
    """Cut segments `(K, 2)` at integers of one coordinate."""
    a = start[:, axis]
    b = end[:, axis]
    cuts = _integer_cuts(np.minimum(a, b), np.maximum(a, b))
    owner = cuts.owner
    # Count every segment from its low end, so that opposite segments have equal cuts.
    is_rising = (b >= a)[owner][:, None]
    bottom = np.where(is_rising, start[owner], end[owner])
    top = np.where(is_rising, end[owner], start[owner])
    vector = top - bottom
    lower_side = bottom + vector * cuts.lower_share[:, None]
    upper_side = bottom + vector * cuts.upper_share[:, None]
    piece_start = np.where(is_rising, lower_side, upper_side)
    piece_end = np.where(is_rising, upper_side, lower_side)
    return piece_start, piece_end


@dataclass(frozen=True, eq=False)
class _Cuts:
    """The pieces of all segments after cuts at integers."""

    # (n,): segment of each piece.
    owner: NDArray[np.intp]
    # (n,): both ends of each piece, as shares of the way from the segment's low end to
    # its high end.
    lower_share: Array
    upper_share: Array


def _integer_cuts(lower: Array, upper: Array) -> _Cuts:
    """Cut intervals from `lower` to `upper` `(K,)` at the integers inside them."""
    first = np.floor(lower) + 1
    count = np.maximum(np.ceil(upper) - first, 0).astype(np.intp)
    pieces = count + 1
    owner = np.repeat(np.arange(len(lower)), pieces)
    # The rank of each piece within its segment.
    first_piece = np.cumsum(pieces) - pieces
    rank = np.arange(len(owner)) - first_piece[owner]
    span = np.where(upper > lower, upper - lower, 1.0)

    def share_at(number: NDArray[np.intp]) -> Array:
        """Return the share of the way to cut `number`; cut 0 is the low end."""
        inner = (first[owner] + number - 1 - lower[owner]) / span[owner]
        share = np.where(number == pieces[owner], 1.0, inner)
        return np.where(number == 0, 0.0, share)

    return _Cuts(owner, share_at(rank), share_at(rank + 1))


_LOBES = [float(np.sinc(k) * np.sinc(k / 3)) for k in (2.5, 1.5, 0.5)]
HALFWAY = [np.float32(lobe / (2 * sum(_LOBES))) for lobe in _LOBES]
"""Weights of the pixels 2.5, 1.5 and 0.5 px away."""
BAND = 64
"""Rows that are sampled at once."""


def double_resolution(picture: F32) -> F32:
    """Return (2h - 1, 2w - 1[, C]) of a picture (h, w[, C])."""
    rows = _halve(picture, 0)
    # Bands of rows fit into the processor's cache.
    bands = []
    for first in range(0, len(rows), BAND):
        bands.append(_halve(rows[first : first + BAND], 1))
    return np.concatenate(bands)


def _halve(values: F32, axis: int) -> F32:
    """Sample at half steps along an axis, by Lanczos' kernel of three lobes.

    Each value is limited to the range of its four neighbours, against ringing.
    """
    if axis == 0:
        margin = (2, 2, 0, 0)
    else:
        margin = (0, 0, 2, 2)
    padded_values = cv2.copyMakeBorder(values, *margin, cv2.BORDER_REPLICATE)
    padded_values = np.moveaxis(padded_values, axis, 0)
    gaps = len(padded_values) - 5
    # The three pixels before each gap, and the three behind it.
    p = [padded_values[k : k + gaps] for k in range(6)]
    # The kernel is symmetric: both pixels at one distance have the same weight.
    halves: F32 = np.zeros(p[0].shape, np.float32)
    for k, weight in enumerate(HALFWAY):
        halves += weight * (p[k] + p[5 - k])
    lower_limits = np.minimum(p[2], p[3])
    upper_limits = np.maximum(p[2], p[3])
    for farther in (p[1], p[4]):
        lower_limits = np.minimum(lower_limits, farther)
        upper_limits = np.maximum(upper_limits, farther)
    shape = list(values.shape)
    shape[axis] += gaps
    result = np.empty(shape, np.float32)
    along_axis = np.moveaxis(result, axis, 0)
    along_axis[::2] = np.moveaxis(values, axis, 0)
    np.clip(halves, lower_limits, upper_limits, out=along_axis[1::2])
    return result
