"""Mask -> the circle that fits it best, and its intersection over union with the mask.

What lies beyond the photo is unknown: there the circle is neither right nor wrong.
"""

from __future__ import annotations

from math import pi, sqrt

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.geometry import Array
from physgen.outline.outline import Disc

_GRID = 160
"""Larger masks are searched on a grid of about this many samples a side; the score is always taken at full size."""


def fit_circle(mask: NDArray[np.bool_], border: Array) -> tuple[Disc, float]:
    """The disc of highest IoU with a mask `(H, W)`, and that IoU; `border` `(n, 2)` px is the mask's contour.

    Starts from the circle of the mask's own area, and from a robust least-squares circle that a neighbour hiding a part
    of the mask does not pull; the better is refined by a pattern search.
    """
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    low = np.array([columns[0], rows[0]], dtype=np.float64)
    box = mask[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
    stride = max(1, max(box.shape) // _GRID)
    score = _Score(mask, stride)

    area = float(box.sum())
    j, i = np.nonzero(box)
    center = low + np.array([i.mean(), j.mean()])
    starts = [np.array([*center, sqrt(area / pi)]), robust_circle(border)]
    best = max(starts, key=score.iou)
    value = score.iou(best)
    if value > 0.7:
        step = max(0.04 * best[2], 0.5)
        while step > 0.02 * stride:
            trials = [best + step * move for move in _MOVES]
            values = [score.iou(trial) for trial in trials]
            k = int(np.argmax(values))
            if values[k] > value + 1e-9:
                best, value = trials[k], values[k]
            else:
                step /= 2
    if stride > 1:
        # the grid knows the circle to a share of its spacing only; a start may be better at full size
        full = _Score(mask, 1)
        best = max((best, *starts), key=full.iou)
        value = full.iou(best)
    return Disc(best[:2].copy(), float(best[2])), value


def robust_circle(points: Array) -> Array:
    """`(3,)` px: x, y, radius of the circle through most of the points: least squares (Kasa 1976), Tukey weights."""
    weight: Array = np.ones(len(points))
    circle = np.array([*points.mean(axis=0), 1.0])
    middle = points.mean(axis=0)
    p = points - middle
    for _ in range(12):
        design = np.column_stack([2 * p, np.ones(len(p))]) * weight[:, None]
        (x, y, c), *_rest = np.linalg.lstsq(design, (p * p).sum(axis=1) * weight, rcond=None)
        radius = sqrt(max(c + x * x + y * y, 1e-6))
        circle = np.array([x + middle[0], y + middle[1], radius])
        off = np.hypot(p[:, 0] - x, p[:, 1] - y) - radius
        scale = max(1.4826 * float(np.median(np.abs(off))), 0.25)
        weight = np.sqrt(np.clip(1 - (off / (4.7 * scale)) ** 2, 0, None)) + 1e-6
    return circle


_MOVES = np.array(
    [(x, y, 0) for x in (-1, 0, 1) for y in (-1, 0, 1) if x or y] + [(0, 0, 1), (0, 0, -1)], np.float64
)
"""Pattern search: the neighbours of x, y on a grid, and a larger and a smaller radius."""


class _Score:
    """IoU of circles with one mask, on every `stride`-th pixel of the mask's surroundings within the photo."""

    def __init__(self, mask: NDArray[np.bool_], stride: int) -> None:
        height, width = mask.shape
        rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
        margin = max(rows[-1] - rows[0], columns[-1] - columns[0]) // 2 + 2
        top, bottom = max(rows[0] - margin, 0), min(rows[-1] + margin + 1, height)
        left, right = max(columns[0] - margin, 0), min(columns[-1] + margin + 1, width)
        part = np.asarray(mask[top:bottom, left:right], dtype=np.float32)
        if stride > 1:
            half = cv2.resize(part, None, fx=1 / stride, fy=1 / stride, interpolation=cv2.INTER_AREA)
            part = np.asarray(half, dtype=np.float32)
        self._mask = part
        self._area = float(part.sum())
        # centre of the first sample, and the samples' true spacing after rounding to whole samples
        self._dx, self._dy = (right - left) / part.shape[1], (bottom - top) / part.shape[0]
        self._x = left - 0.5 + (np.arange(part.shape[1], dtype=np.float32) + 0.5) * self._dx
        self._y = top - 0.5 + (np.arange(part.shape[0], dtype=np.float32) + 0.5) * self._dy

    def iou(self, circle: Array) -> float:
        x, y, radius = circle
        if radius <= 0:
            return 0.0
        off = np.sqrt((self._x[None, :] - x) ** 2 + (self._y[:, None] - y) ** 2)
        inside = np.clip((radius - off) / max(self._dx, self._dy) + 0.5, 0.0, 1.0)
        shared = float(np.minimum(inside, self._mask).sum())
        return shared / max(self._area + float(inside.sum()) - shared, 1e-9)
