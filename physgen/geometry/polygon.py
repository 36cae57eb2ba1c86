"""Frames of reference, polygons, and outlines of discs and regions with their area, centre of mass and moments.

Image axes: origin at the top-left pixel's centre, +x right, +y down; a positive angle turns +x towards +y.
Pixel (column i, row j) covers [i - 0.5, i + 0.5] x [j - 0.5, j + 0.5]. Lengths are px.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import hypot, pi
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


class MassProperties(NamedTuple):
    """Area px², centre of mass (2,) px, and the polar second moment px⁴ of a uniform plate of density 1 about it."""

    area: float
    center: Array
    second: float


def polygon_moments(points: Array) -> MassProperties:
    """Signed moments of a simple polygon `(K, 2)`; area and second moment are positive when it turns +x towards +y.

    Green's theorem; any mechanics text.

    >>> m = polygon_moments(np.array([[0.0, 0.0], [4.0, 0.0], [4.0, 2.0], [0.0, 2.0]]))
    >>> m.area, m.center.tolist(), round(m.second, 9)
    (8.0, [2.0, 1.0], 13.333333333)
    """
    origin = points.mean(axis=0)
    a = points - origin
    b = np.roll(a, -1, axis=0)
    c = cross(a, b)
    area = float(c.sum() / 2)
    if area == 0.0:
        return MassProperties(0.0, origin, 0.0)
    centroid = ((a + b) * c[:, None]).sum(axis=0) / (6 * area)
    about_origin = float(
        (c * ((a * a).sum(1) + (a * b).sum(1) + (b * b).sum(1))).sum() / 12
    )
    return MassProperties(
        area, centroid + origin, about_origin - area * float(centroid @ centroid)
    )


@dataclass(frozen=True, eq=False)
class Ring:
    """One piece: the border `(K, 2)` float64 px and the borders of its holes, each `(K, 2)` float64 px.

    Fitted rings turn +x towards +y and their holes the other way; measures do not rely on it.
    """

    outer: Array
    holes: tuple[Array, ...] = ()


@dataclass(frozen=True, eq=False)
class Disc:
    """A circle: center `(2,)` float64 px, radius px."""

    center: Array
    radius: float


@dataclass(frozen=True, eq=False)
class Region:
    """One or more pieces that move as one body."""

    rings: tuple[Ring, ...]

    @property
    def borders(self) -> list[tuple[Array, float]]:
        """Of every piece its border and 1, then each hole's and -1: signs with which areas add up."""
        return [
            (points, sign)
            for ring in self.rings
            for points, sign in (
                (ring.outer, 1.0),
                *((hole, -1.0) for hole in ring.holes),
            )
        ]


Outline = Disc | Region


def mass_properties(outline: Outline) -> MassProperties:
    """Exact area, centre of mass and second moment; holes subtract, pieces add (parallel axis theorem).

    >>> round(mass_properties(Disc(np.zeros(2), 2.0)).second, 6)
    25.132741
    """
    if isinstance(outline, Disc):
        radius = float(outline.radius)
        return MassProperties(
            pi * radius**2,
            np.array(outline.center, dtype=np.float64),
            pi * radius**4 / 2,
        )
    parts = []
    for points, sign in outline.borders:
        moments = polygon_moments(points)
        turn = sign if moments.area >= 0 else -sign
        parts.append((turn * moments.area, moments.center, turn * moments.second))
    area = sum(part[0] for part in parts)
    if not area > 0:
        raise ValueError("the outline has no area")
    # about the first centroid: far from the origin, sums about (0, 0) would lose digits
    origin = parts[0][1]
    center = (
        origin
        + sum((part[0] * (part[1] - origin) for part in parts), np.zeros(2)) / area
    )
    second = sum(part[2] + part[0] * hypot(*(part[1] - center)) ** 2 for part in parts)
    return MassProperties(float(area), center, float(second))


def mean_distance(outline: Outline, center: Array) -> float:
    """Mean distance of the outline's area from a point, px: what a table's friction takes hold of when it spins.

    Each edge adds the integral of r² dr dphi over the triangle that it makes with the point; signs subtract holes.

    >>> round(mean_distance(Disc(np.zeros(2), 3.0), np.zeros(2)), 6)
    2.0
    """
    if isinstance(outline, Disc):
        return 2 * outline.radius / 3
    total = area = 0.0
    for points, sign in outline.borders:
        a = points - center
        b = np.roll(a, -1, axis=0)
        along = b - a
        length = np.maximum(np.hypot(*along.T), 1e-12)
        twice = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
        height = np.maximum(np.abs(twice) / length, 1e-12)
        start, end = ((p * along).sum(axis=1) / length / height for p in (a, b))
        part = np.abs(height**3 / 6 * (_sec_cubed(end) - _sec_cubed(start))) * np.sign(
            twice
        )
        turn = sign * np.sign(twice.sum())
        total += turn * float(part.sum())
        area += turn * float(twice.sum()) / 2
    return total / area


def _sec_cubed(tangent: Array) -> Array:
    """Twice the integral of 1/cos³ up to the angle of that tangent."""
    secant = np.hypot(1, tangent)
    return np.asarray(secant * tangent + np.arcsinh(tangent))


def bounds(outline: Outline) -> tuple[float, float, float, float]:
    """Smallest box `(x0, y0, x1, y1)` px that holds the outline."""
    if isinstance(outline, Disc):
        low, high = outline.center - outline.radius, outline.center + outline.radius
    else:
        points = np.concatenate([ring.outer for ring in outline.rings])
        low, high = points.min(axis=0), points.max(axis=0)
    return float(low[0]), float(low[1]), float(high[0]), float(high[1])


def translated_outline(outline: Outline, by: Array) -> Outline:
    """The outline at another place."""
    if isinstance(outline, Disc):
        return Disc(outline.center + by, outline.radius)
    return Region(
        tuple(Ring(r.outer + by, tuple(h + by for h in r.holes)) for r in outline.rings)
    )
