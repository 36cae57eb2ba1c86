"""Exact pixel coverage of an outline, and pictures of twice the resolution."""

from __future__ import annotations

from math import ceil, floor, pi, sin, sqrt

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.arrays import F32
from physgen.geometry.polygon import Array, Disc, Outline, bounds

_SAGITTA = 1e-4
"""Distance of a chord from its circle, px; the coverage is then exact to about 1e-4."""


def coverage(outline: Outline, size: tuple[int, int]) -> F32:
    """Return the covered share of each pixel of a photo of `size` (W, H): `(H, W)`
    float32.
    """
    width, height = size
    canvas = np.zeros((height, width), dtype=np.float32)
    box, (x0, y0) = coverage_box(outline, (0, 0, width, height))
    canvas[y0 : y0 + box.shape[0], x0 : x0 + box.shape[1]] = box
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
        return np.zeros((max(height, 0), max(width, 0)), np.float32), (x0, y0)
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
    box = floor(left + 0.5), floor(top + 0.5), ceil(right + 0.5), ceil(bottom + 0.5)
    if window is None:
        return box
    x0, x1 = (min(max(x, window[0]), window[2]) for x in box[::2])
    y0, y1 = (min(max(y, window[1]), window[3]) for y in box[1::2])
    return x0, y0, x1, y1


def _circle_points(disc: Disc) -> Array:
    """Return the polygon `(K, 2)` px of the disc's own area, with chords at most
    `_SAGITTA` off the circle.
    """
    radius = float(disc.radius)
    count = max(12, ceil(pi / sqrt(2 * _SAGITTA / max(radius, 1e-9))))
    step = 2 * pi / count
    angles = np.arange(count) * step
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
    turn = float((start[:, 0] * end[:, 1] - start[:, 1] * end[:, 0]).sum())
    if turn < 0:
        sign = -sign
    height, width = sums.shape
    start, end = _window(start, end, width - 1, height)
    for axis in (0, 1):
        start, end = _cut(start, end, axis)
    rise = (end[:, 1] - start[:, 1]) * sign
    middle = (start + end) / 2
    column = np.clip(np.floor(middle[:, 0]).astype(np.intp), 0, width - 2)
    row = np.clip(np.floor(middle[:, 1]).astype(np.intp), 0, height - 1)
    fraction = middle[:, 0] - column
    # On a ring that turns +x towards +y, the inside is to the left of a downward
    # segment.
    np.add.at(sums, (row, column), -rise * (1 - fraction))
    np.add.at(sums, (row, column + 1), -rise * fraction)


def _window(start: Array, end: Array, width: int, height: int) -> tuple[Array, Array]:
    """Clip segments `(K, 2)` to a box.

    Rows outside are dropped; parts to the left or right move to the box's side.
    """
    lines = ((0, 0.0), (0, float(width)), (1, 0.0), (1, float(height)))
    # Split every segment at each side of the box, so that each piece is wholly inside
    # or outside.
    for axis, line in lines:
        a = start[:, axis]
        b = end[:, axis]
        crosses = (a < line) != (b < line)
        share = (line - a[crosses]) / (b[crosses] - a[crosses])
        vectors = end[crosses] - start[crosses]
        middle = start[crosses] + share[:, None] * vectors
        middle[:, axis] = line
        start = np.concatenate([start[~crosses], start[crosses], middle])
        end = np.concatenate([end[~crosses], middle, end[crosses]])
    # A piece above or below the box covers no row. One beside it still closes its rows,
    # and moves to the side.
    y = (start[:, 1] + end[:, 1]) / 2
    is_inside = (y > 0) & (y < height)
    lower_corner = np.zeros(2)
    upper_corner = np.array([float(width), float(height)])
    return np.clip(start[is_inside], lower_corner, upper_corner), np.clip(
        end[is_inside], lower_corner, upper_corner
    )


def _cut(start: Array, end: Array, axis: int) -> tuple[Array, Array]:
    """Cut segments `(K, 2)` at integers of one coordinate."""
    a = start[:, axis]
    b = end[:, axis]
    lower = np.minimum(a, b)
    upper = np.maximum(a, b)
    first = np.floor(lower) + 1
    count = np.maximum(np.ceil(upper) - first, 0).astype(np.intp)
    pieces = count + 1
    # List the pieces of all segments: the segment of each, and its rank within it.
    owner = np.repeat(np.arange(len(a)), pieces)
    rank = np.arange(len(owner)) - np.repeat(np.cumsum(pieces) - pieces, pieces)
    span = np.where(upper > lower, upper - lower, 1.0)

    def share_at(number: NDArray[np.intp]) -> Array:
        """Return the share of the way from the low end to the high end; cut 0 is the
        low end.
        """
        inner = (first[owner] + number - 1 - lower[owner]) / span[owner]
        share = np.where(number == pieces[owner], 1.0, inner)
        return np.where(number == 0, 0.0, share)[:, None]

    # Count every segment from its low end, so that opposite segments have equal cuts.
    is_rising = (b >= a)[owner][:, None]
    bottom = np.where(is_rising, start[owner], end[owner])
    top = np.where(is_rising, end[owner], start[owner])
    lower_side = bottom + (top - bottom) * share_at(rank)
    upper_side = bottom + (top - bottom) * share_at(rank + 1)
    return np.where(is_rising, lower_side, upper_side), np.where(
        is_rising, upper_side, lower_side
    )


_LOBES = [float(np.sinc(k) * np.sinc(k / 3)) for k in (2.5, 1.5, 0.5)]
HALFWAY = [np.float32(lobe / (2 * sum(_LOBES))) for lobe in _LOBES]
"""Weights of the pixels 2.5, 1.5 and 0.5 px away."""


def double_resolution(picture: F32) -> F32:
    """Return (2h - 1, 2w - 1[, C]) of a picture (h, w[, C])."""
    rows = _halve(picture, 0)
    # Bands of rows fit into the processor's cache.
    bands = [_halve(rows[k : k + 64], 1) for k in range(0, len(rows), 64)]
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
    halves: F32 = np.zeros(p[0].shape, np.float32)
    for k, weight in enumerate(HALFWAY):
        halves += weight * (p[k] + p[5 - k])
    lower_limits = np.minimum(np.minimum(p[2], p[3]), np.minimum(p[1], p[4]))
    upper_limits = np.maximum(np.maximum(p[2], p[3]), np.maximum(p[1], p[4]))
    shape = list(values.shape)
    shape[axis] += gaps
    result = np.empty(shape, np.float32)
    along_axis = np.moveaxis(result, axis, 0)
    along_axis[::2] = np.moveaxis(values, axis, 0)
    np.clip(halves, lower_limits, upper_limits, out=along_axis[1::2])
    return result
