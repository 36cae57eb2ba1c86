"""Points -> outline: a disc or a region of rings, and its area, centre of mass and second moment.

The centre computed here is the one that shape, pixels and motion share. All lengths px, image axes.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import hypot, pi

import numpy as np

from physgen.geometry import Array, polygon_moments


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


Outline = Disc | Region


@dataclass(frozen=True, eq=False)
class MassProperties:
    """Area px², center of mass `(2,)` px, and the polar second moment px⁴ of a uniform plate about it."""

    area: float
    center: Array
    second: float


def mass_properties(outline: Outline) -> MassProperties:
    """Exact area, centre of mass and second moment; holes subtract, pieces add (parallel axis theorem).

    >>> round(mass_properties(Disc(np.zeros(2), 2.0)).second, 6)
    25.132741
    """
    if isinstance(outline, Disc):
        radius = float(outline.radius)
        return MassProperties(pi * radius**2, np.array(outline.center, dtype=np.float64), pi * radius**4 / 2)
    parts = []
    for ring in outline.rings:
        for points, sign in ((ring.outer, 1.0), *((hole, -1.0) for hole in ring.holes)):
            moments = polygon_moments(points)
            turn = sign if moments.area >= 0 else -sign
            parts.append((turn * moments.area, moments.centroid, turn * moments.second))
    area = sum(part[0] for part in parts)
    if not area > 0:
        raise ValueError("the outline has no area")
    # about the first centroid: far from the origin, sums about (0, 0) would lose digits
    origin = parts[0][1]
    center = origin + sum((part[0] * (part[1] - origin) for part in parts), np.zeros(2)) / area
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
    for ring in outline.rings:
        for points, sign in ((ring.outer, 1.0), *((hole, -1.0) for hole in ring.holes)):
            a = points - center
            b = np.roll(a, -1, axis=0)
            along = b - a
            length = np.maximum(np.hypot(*along.T), 1e-12)
            twice = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
            height = np.maximum(np.abs(twice) / length, 1e-12)
            start, end = ((p * along).sum(axis=1) / length / height for p in (a, b))
            part = np.abs(height**3 / 6 * (_sec_cubed(end) - _sec_cubed(start))) * np.sign(twice)
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
