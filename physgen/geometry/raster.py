"""Exact pixel coverage of an outline, and pictures of twice the resolution."""

from __future__ import annotations

from math import ceil, floor, pi, sin, sqrt

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.geometry.polygon import Array, Disc, Outline, bounds

Coverage = NDArray[np.float32]
Picture = NDArray[np.float32]

_SAGITTA = 1e-4
"""px that a chord may stand off its circle; the coverage is then true to about 1e-4."""


def coverage(outline: Outline, size: tuple[int, int]) -> Coverage:
    """Covered share of each pixel of a photo of `size` (W, H) px: `(H, W)` float32 in 0..1."""
    width, height = size
    canvas = np.zeros((height, width), dtype=np.float32)
    box, (x0, y0) = coverage_box(outline, (0, 0, width, height))
    canvas[y0 : y0 + box.shape[0], x0 : x0 + box.shape[1]] = box
    return canvas


def coverage_box(
    outline: Outline, window: tuple[int, int, int, int] | None = None
) -> tuple[Coverage, tuple[int, int]]:
    """The outline's own box of pixels: `(h, w)` float32 in 0..1 and its first pixel `(x0, y0)`.

    Only what lies in `window` (first and last pixel + 1 in x and y: x0, y0, x1, y1) is computed and held, however
    large the outline is; the box is then empty where they do not meet.
    """
    low_x, low_y, high_x, high_y = bounds(outline)
    x0, y0, x1, y1 = (
        floor(low_x + 0.5),
        floor(low_y + 0.5),
        ceil(high_x + 0.5),
        ceil(high_y + 0.5),
    )
    if window is not None:
        x0, x1 = (min(max(x, window[0]), window[2]) for x in (x0, x1))
        y0, y1 = (min(max(y, window[1]), window[3]) for y in (y0, y1))
    width, height = x1 - x0, y1 - y0
    if window is not None and (width <= 0 or height <= 0):
        return np.zeros((max(height, 0), max(width, 0)), np.float32), (x0, y0)
    corner = np.array([x0 - 0.5, y0 - 0.5])
    sums = np.zeros((max(height, 1), max(width, 1) + 1))
    borders = (
        [(_circle_points(outline), 1.0)]
        if isinstance(outline, Disc)
        else outline.borders
    )
    for points, sign in borders:
        _accumulate(sums, points - corner, sign)
    inside = np.cumsum(sums, axis=1)[:, :-1]
    return np.clip(inside, 0.0, 1.0).astype(np.float32), (x0, y0)


def _circle_points(disc: Disc) -> Array:
    """`(K, 2)` px: the polygon of the disc's own area whose chords stand off the circle by at most `_SAGITTA`."""
    radius = float(disc.radius)
    count = max(12, ceil(pi / sqrt(2 * _SAGITTA / max(radius, 1e-9))))
    step = 2 * pi / count
    angles = np.arange(count) * step
    outer = radius * sqrt(step / sin(step))
    points: Array = disc.center + outer * np.stack(
        [np.cos(angles), np.sin(angles)], axis=1
    )
    return points


def _accumulate(sums: Array, points: Array, sign: float) -> None:
    """Add one border, in box coordinates (pixel i covers [i, i + 1]), to the row-wise differences `sums`."""
    start, end = points, np.roll(points, -1, axis=0)
    turn = float((start[:, 0] * end[:, 1] - start[:, 1] * end[:, 0]).sum())
    if turn < 0:
        sign = -sign
    height, width = sums.shape
    start, end = _within(start, end, width - 1, height)
    for axis in (0, 1):
        start, end = _cut(start, end, axis)
    rise = (end[:, 1] - start[:, 1]) * sign
    middle = (start + end) / 2
    column = np.clip(np.floor(middle[:, 0]).astype(np.intp), 0, width - 2)
    row = np.clip(np.floor(middle[:, 1]).astype(np.intp), 0, height - 1)
    fraction = middle[:, 0] - column
    # the inside lies to the left of a segment that goes down (+y) on a ring that turns +x towards +y
    np.add.at(sums, (row, column), -rise * (1 - fraction))
    np.add.at(sums, (row, column + 1), -rise * fraction)


def _within(start: Array, end: Array, width: int, height: int) -> tuple[Array, Array]:
    """Segments `(K, 2)` as they count in a box: rows outside dropped.

    What is left or right of it moved to its side.
    """
    for axis, line in ((0, 0.0), (0, float(width)), (1, 0.0), (1, float(height))):
        a, b = start[:, axis], end[:, axis]
        crosses = (a < line) != (b < line)
        share = (line - a[crosses]) / (b[crosses] - a[crosses])
        middle = start[crosses] + share[:, None] * (end[crosses] - start[crosses])
        middle[:, axis] = line
        start = np.concatenate([start[~crosses], start[crosses], middle])
        end = np.concatenate([end[~crosses], middle, end[crosses]])
    y = (start[:, 1] + end[:, 1]) / 2
    inside = (y > 0) & (y < height)
    start, end = start[inside], end[inside]
    low, high = np.zeros(2), np.array([float(width), float(height)])
    return np.clip(start, low, high), np.clip(end, low, high)


def _cut(start: Array, end: Array, axis: int) -> tuple[Array, Array]:
    """Cut segments `(K, 2) -> (K, 2)` wherever their coordinate `axis` passes a whole number."""
    a, b = start[:, axis], end[:, axis]
    low, high = np.minimum(a, b), np.maximum(a, b)
    first = np.floor(low) + 1
    count = np.maximum(np.ceil(high) - first, 0).astype(np.intp)
    pieces = count + 1
    owner = np.repeat(np.arange(len(a)), pieces)
    rank = np.arange(len(owner)) - np.repeat(np.cumsum(pieces) - pieces, pieces)
    span = np.where(high > low, high - low, 1.0)

    def at(rank_of_cut: NDArray[np.intp]) -> Array:
        """Share of the way from the low end to the high end; cut 0 is the low end."""
        inner = (first[owner] + rank_of_cut - 1 - low[owner]) / span[owner]
        share = np.where(
            rank_of_cut == 0, 0.0, np.where(rank_of_cut == pieces[owner], 1.0, inner)
        )
        return share[:, None]

    rising = (b >= a)[owner][:, None]
    bottom = np.where(rising, start[owner], end[owner])
    top = np.where(rising, end[owner], start[owner])
    near = bottom + (top - bottom) * at(rank)
    far = bottom + (top - bottom) * at(rank + 1)
    return np.where(rising, near, far), np.where(rising, far, near)


_LOBES = [float(np.sinc(k) * np.sinc(k / 3)) for k in (2.5, 1.5, 0.5)]
HALFWAY = [np.float32(lobe / (2 * sum(_LOBES))) for lobe in _LOBES]
"""Weights of the pixels 2.5, 1.5 and 0.5 px away."""


def double_resolution(picture: Picture) -> Picture:
    """(2h - 1, 2w - 1[, C]) of a picture (h, w[, C])."""
    rows = _halved(picture, 0)
    return np.concatenate(
        [_halved(rows[k : k + 64], 1) for k in range(0, len(rows), 64)]
    )


def _halved(values: Picture, axis: int) -> Picture:
    """Samples at half steps along an axis, by Lanczos' kernel of three lobes; the ends are far from any light.

    Each is held between the least and the greatest of its four neighbours: no rings.
    """
    wide = (2, 2, 0, 0) if axis == 0 else (0, 0, 2, 2)
    padded = np.moveaxis(
        cv2.copyMakeBorder(values, *wide, cv2.BORDER_REPLICATE), axis, 0
    )
    gaps = len(padded) - 5
    p = [
        padded[k : k + gaps] for k in range(6)
    ]  # the three pixels before each gap, and the three behind it
    between = sum(
        (weight * (p[k] + p[5 - k]) for k, weight in enumerate(HALFWAY)), np.float32(0)
    )
    low = np.minimum(np.minimum(p[2], p[3]), np.minimum(p[1], p[4]))
    high = np.maximum(np.maximum(p[2], p[3]), np.maximum(p[1], p[4]))
    h, w = (side + gaps * (k == axis) for k, side in enumerate(values.shape[:2]))
    out = np.empty((h, w, *values.shape[2:]), np.float32)
    moved = np.moveaxis(out, axis, 0)
    moved[::2] = np.moveaxis(values, axis, 0)
    np.clip(between, low, high, out=moved[1::2])
    return out
