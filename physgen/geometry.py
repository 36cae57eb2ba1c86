"""Frames of reference and polygons; numpy only.

Image axes: origin at the top-left pixel's centre, +x right, +y down; a positive angle turns +x towards +y.
Pixel (column i, row j) covers [i - 0.5, i + 0.5] x [j - 0.5, j + 0.5].
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class Pose(NamedTuple):
    """Where a body's centre of mass is (px) and how far the body has turned since t = 0 (rad)."""

    x: float
    y: float
    angle: float

    def apply(self, points: Array) -> Array:
        """Body frame (about the centre of mass) -> photo, `(..., 2)` px."""
        return points @ rotation(self.angle).T + (self.x, self.y)

    def invert(self, points: Array) -> Array:
        """Photo -> body frame, `(..., 2)` px."""
        return (points - (self.x, self.y)) @ rotation(self.angle)


def rotation(angle: float) -> Array:
    """(2, 2) matrix that turns +x towards +y by `angle` rad.

    >>> (rotation(np.pi / 2) @ [1.0, 0.0]).round(12).tolist()
    [0.0, 1.0]
    """
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s], [s, c]])


def cross(a: Array, b: Array) -> Array:
    """Scalar cross product of `(..., 2)` vectors, positive when `b` is turned from `a` towards +y.

    >>> float(cross(np.array([1.0, 0.0]), np.array([0.0, 1.0])))
    1.0
    """
    return np.asarray(a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0])


class Moments(NamedTuple):
    """Area px², centroid (2,) px, and second moment px⁴ about the centroid (the polar one, of a plate of density 1)."""

    area: float
    centroid: Array
    second: float


def polygon_moments(points: Array) -> Moments:
    """Signed moments of a simple polygon `(K, 2)`; area and second moment are positive when it turns +x towards +y.

    Green's theorem; any mechanics text.

    >>> m = polygon_moments(np.array([[0.0, 0.0], [4.0, 0.0], [4.0, 2.0], [0.0, 2.0]]))
    >>> m.area, m.centroid.tolist(), round(m.second, 9)
    (8.0, [2.0, 1.0], 13.333333333)
    """
    origin = points.mean(axis=0)
    a = points - origin
    b = np.roll(a, -1, axis=0)
    c = cross(a, b)
    area = float(c.sum() / 2)
    if area == 0.0:
        return Moments(0.0, origin, 0.0)
    centroid = ((a + b) * c[:, None]).sum(axis=0) / (6 * area)
    about_origin = float((c * ((a * a).sum(1) + (a * b).sum(1) + (b * b).sum(1))).sum() / 12)
    return Moments(area, centroid + origin, about_origin - area * float(centroid @ centroid))
