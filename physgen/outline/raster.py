"""Outline -> the exact share of every pixel that it covers, float32 in 0..1.

Green's theorem by pixel: every border segment, cut at the pixel grid, adds the area between itself and the pixels'
right side; a running sum along the row then fills the inside (the signed-area accumulation of font rasterisers).
"""

from __future__ import annotations

from math import ceil, floor, pi, sin, sqrt

import numpy as np
from numpy.typing import NDArray

from physgen.geometry import Array
from physgen.outline.outline import Disc, Outline, bounds

Coverage = NDArray[np.float32]

_SAGITTA = 1e-4
"""px that a chord may stand off its circle; the coverage is then true to about 1e-4."""


def coverage(outline: Outline, size: tuple[int, int]) -> Coverage:
    """Covered share of each pixel of a photo of `size` (W, H) px: `(H, W)` float32 in 0..1."""
    width, height = size
    canvas = np.zeros((height, width), dtype=np.float32)
    box, (x0, y0) = coverage_box(outline)
    left, top = max(x0, 0), max(y0, 0)
    right, bottom = min(x0 + box.shape[1], width), min(y0 + box.shape[0], height)
    if left < right and top < bottom:
        canvas[top:bottom, left:right] = box[top - y0 : bottom - y0, left - x0 : right - x0]
    return canvas


def coverage_box(outline: Outline) -> tuple[Coverage, tuple[int, int]]:
    """The outline's own box of pixels, wherever it lies: `(h, w)` float32 in 0..1 and its first pixel `(x0, y0)`."""
    low_x, low_y, high_x, high_y = bounds(outline)
    x0, y0 = floor(low_x + 0.5), floor(low_y + 0.5)
    width, height = ceil(high_x + 0.5) - x0, ceil(high_y + 0.5) - y0
    corner = np.array([x0 - 0.5, y0 - 0.5])
    sums = np.zeros((max(height, 1), max(width, 1) + 1))
    for points, sign in _borders(outline):
        _accumulate(sums, points - corner, sign)
    inside = np.cumsum(sums, axis=1)[:, :-1]
    return np.clip(inside, 0.0, 1.0).astype(np.float32), (x0, y0)


def circle_points(disc: Disc, sagitta: float) -> Array:
    """`(K, 2)` px: the polygon of the disc's own area whose chords stand off the circle by at most `sagitta` px."""
    radius = float(disc.radius)
    count = max(12, ceil(pi / sqrt(2 * max(sagitta, 1e-9) / max(radius, 1e-9))))
    step = 2 * pi / count
    angles = np.arange(count) * step
    outer = radius * sqrt(step / sin(step))
    points: Array = disc.center + outer * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    return points


def _borders(outline: Outline) -> list[tuple[Array, float]]:
    if isinstance(outline, Disc):
        return [(circle_points(outline, _SAGITTA), 1.0)]
    pairs: list[tuple[Array, float]] = []
    for ring in outline.rings:
        pairs.append((ring.outer, 1.0))
        pairs.extend((hole, -1.0) for hole in ring.holes)
    return pairs


def _accumulate(sums: Array, points: Array, sign: float) -> None:
    """Add one border, in box coordinates (pixel i covers [i, i + 1]), to the row-wise differences `sums`."""
    start, end = points, np.roll(points, -1, axis=0)
    turn = float((start[:, 0] * end[:, 1] - start[:, 1] * end[:, 0]).sum())
    if turn < 0:
        sign = -sign
    for axis in (0, 1):
        start, end = _cut(start, end, axis)
    height, width = sums.shape
    rise = (end[:, 1] - start[:, 1]) * sign
    middle = (start + end) / 2
    column = np.clip(np.floor(middle[:, 0]).astype(np.intp), 0, width - 2)
    row = np.clip(np.floor(middle[:, 1]).astype(np.intp), 0, height - 1)
    fraction = middle[:, 0] - column
    # the inside lies to the left of a segment that goes down (+y) on a ring that turns +x towards +y
    np.add.at(sums, (row, column), -rise * (1 - fraction))
    np.add.at(sums, (row, column + 1), -rise * fraction)


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
        share = np.where(rank_of_cut == 0, 0.0, np.where(rank_of_cut == pieces[owner], 1.0, inner))
        return share[:, None]

    rising = (b >= a)[owner][:, None]
    bottom = np.where(rising, start[owner], end[owner])
    top = np.where(rising, end[owner], start[owner])
    near = bottom + (top - bottom) * at(rank)
    far = bottom + (top - bottom) * at(rank + 1)
    return np.where(rising, near, far), np.where(rising, far, near)
