"""Frames of reference, polygons, and outlines with area, centre of mass and moments.

Image axes: the origin is the centre of the top-left pixel, +x right, +y down; a
positive angle turns +x towards +y. Pixel (column i, row j) covers [i - 0.5, i + 0.5] x
[j - 0.5, j + 0.5]. Lengths are px.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import hypot, pi
from typing import NamedTuple

import numpy as np

from physgen.arrays import F64

Array = F64


class Pose(NamedTuple):
    """Position of a body's centre of mass, px, and its rotation since t = 0, rad."""

    x: float
    y: float
    angle: float

    def apply(self, points: Array) -> Array:
        """Convert points of the body frame (about the centre of mass) to the photo,
        `(..., 2)` px.
        """
        return points @ rotation(self.angle).T + (self.x, self.y)


def rotation(angle: float) -> Array:
    """Return the matrix (2, 2) of a rotation by `angle` rad from +x towards +y.

    >>> (rotation(np.pi / 2) @ [1.0, 0.0]).round(12).tolist()
    [0.0, 1.0]
    """
    c = np.cos(angle)
    s = np.sin(angle)
    return np.array([[c, -s], [s, c]])


def cross(a: Array, b: Array) -> Array:
    """Return the scalar cross product of `(..., 2)` vectors, positive when `b` is turned from `a` towards +y.

    >>> float(cross(np.array([1.0, 0.0]), np.array([0.0, 1.0])))
    1.0
    """
    falling = a[..., 0] * b[..., 1]
    rising = a[..., 1] * b[..., 0]
    return np.asarray(falling - rising)


class MassProperties(NamedTuple):
    """Area px², centre of mass (2,) px and polar second moment px⁴ of a uniform plate.

    The density is 1, and the moment is about the centre of mass.
    """

    area: float
    center: Array
    second: float


def polygon_moments(points: Array) -> MassProperties:
    """Return signed moments of a simple polygon `(K, 2)`; positive when it turns +x towards +y.

    Green's theorem; any mechanics text.

    >>> m = polygon_moments(np.array([[0.0, 0.0], [4.0, 0.0], [4.0, 2.0], [0.0, 2.0]]))
    >>> m.area, m.center.tolist(), round(m.second, 9)
    (8.0, [2.0, 1.0], 13.333333333)
    """
    # Moments about a near point keep their digits, however far the photo's origin
    # is.
    origin = points.mean(axis=0)
    a = points - origin
    b = np.roll(a, -1, axis=0)
    twice_areas = cross(a, b)
    area = float(twice_areas.sum() / 2)
    if area == 0.0:
        return MassProperties(0.0, origin, 0.0)
    weighted_corners = (a + b) * twice_areas[:, None]
    centroid = weighted_corners.sum(axis=0) / (6 * area)
    squares = (a * a).sum(1)
    squares += (a * b).sum(1)
    squares += (b * b).sum(1)
    about_origin = float((twice_areas * squares).sum() / 12)
    # The parallel axis theorem moves the second moment to the centre of mass.
    second = about_origin - area * float(centroid @ centroid)
    return MassProperties(area, centroid + origin, second)


@dataclass(frozen=True, eq=False)
class Ring:
    """One piece: its border `(K, 2)` float64 px, and the borders of its holes.

    Fitted rings turn +x towards +y and their holes the other way; measures do not
    depend on it.
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
        """Return every border with its sign in sums of areas: 1 for pieces, -1 for
        holes.
        """
        borders = []
        for ring in self.rings:
            borders.append((ring.outer, 1.0))
            borders += [(hole, -1.0) for hole in ring.holes]
        return borders


Outline = Disc | Region


def mass_properties(outline: Outline) -> MassProperties:
    """Return exact area, centre of mass and second moment; holes subtract, pieces add (parallel axis theorem).

    >>> round(mass_properties(Disc(np.zeros(2), 2.0)).second, 6)
    25.132741
    """
    if isinstance(outline, Disc):
        radius = float(outline.radius)
        center = np.array(outline.center, dtype=np.float64)
        return MassProperties(pi * radius**2, center, pi * radius**4 / 2)
    parts = []
    for points, sign in outline.borders:
        moments = polygon_moments(points)
        if moments.area >= 0:
            turn = sign
        else:
            turn = -sign
        area = turn * moments.area
        second = turn * moments.second
        parts.append(MassProperties(area, moments.center, second))
    area = sum(part.area for part in parts)
    if not area > 0:
        raise ValueError("the outline has no area")
    # Sums are about the first centroid: far from the origin, sums about (0, 0) would
    # lose digits.
    origin = parts[0].center
    moment = np.zeros(2)
    for part in parts:
        moment = moment + part.area * (part.center - origin)
    center = origin + moment / area
    second = 0.0
    for part in parts:
        distance = hypot(*(part.center - center))
        second += part.second + part.area * distance**2
    return MassProperties(float(area), center, float(second))


def mean_distance(outline: Outline, center: Array) -> float:
    """Return the mean distance of the outline's area from a point, px.

    It is the lever of a table's friction on a spinning body. Each edge adds the
    integral of r² dr dphi over its triangle with the point; signs subtract holes.

    >>> round(mean_distance(Disc(np.zeros(2), 3.0), np.zeros(2)), 6)
    2.0
    """
    if isinstance(outline, Disc):
        return 2 * outline.radius / 3
    total = area = 0.0
    for points, sign in outline.borders:
        start = points - center
        end = np.roll(start, -1, axis=0)
        twice_areas = cross(start, end)
        integral = _distance_integral(start, end, twice_areas)
        part = np.abs(integral) * np.sign(twice_areas)
        turn = sign * np.sign(twice_areas.sum())
        total += turn * float(part.sum())
        area += turn * float(twice_areas.sum()) / 2
    return total / area


def _distance_integral(start: Array, end: Array, twice_areas: Array) -> Array:
    """Return the integral `(K,)` of r² dr dphi over triangles of edges with the origin."""
    edge = end - start
    length = np.maximum(np.hypot(*edge.T), 1e-12)
    height = np.maximum(np.abs(twice_areas) / length, 1e-12)
    # Tangents of the angles of both ends, measured at the point from the height.
    from_start = (start * edge).sum(axis=1) / length / height
    from_end = (end * edge).sum(axis=1) / length / height
    angle_part = _sec_cubed(from_end) - _sec_cubed(from_start)
    return np.asarray(height**3 / 6 * angle_part)


def _sec_cubed(tangent: Array) -> Array:
    """Return twice the integral of 1/cos³ up to the angle of that tangent."""
    secant = np.hypot(1, tangent)
    return np.asarray(secant * tangent + np.arcsinh(tangent))


def bounds(outline: Outline) -> tuple[float, float, float, float]:
    """Return the smallest box `(x0, y0, x1, y1)` px around the outline."""
    if isinstance(outline, Disc):
        low = outline.center - outline.radius
        high = outline.center + outline.radius
    else:
        points = np.concatenate([ring.outer for ring in outline.rings])
        low = points.min(axis=0)
        high = points.max(axis=0)
    x0, y0 = low.tolist()
    x1, y1 = high.tolist()
    return float(x0), float(y0), float(x1), float(y1)


def translated_outline(outline: Outline, offset: Array) -> Outline:
    """Return the outline at another place."""
    if isinstance(outline, Disc):
        return Disc(outline.center + offset, outline.radius)
    rings = []
    for ring in outline.rings:
        holes = tuple(hole + offset for hole in ring.holes)
        rings.append(Ring(ring.outer + offset, holes))
    return Region(tuple(rings))
