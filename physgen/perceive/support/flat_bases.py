"""Flat bases under objects whose lower outline recedes from the camera."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
import shapely

from physgen.geometry.convex import outline_shape
from physgen.geometry.polygon import (
    Array,
    Disc,
    Region,
    Ring,
    bounds,
    mass_properties,
    polygon_moments,
)
from physgen.materials import kind
from physgen.perceive.support.ground_contact import Foot, Line


@dataclass(frozen=True)
class _BaseLimits:
    """Limits of flat bases under objects whose lower outline recedes from the camera.

    A camera that looks down sees the rear of a base higher in the picture than its
    front. The lowest corner of the outline is the nearest one, and the object would tip
    over it. Widths and heights are shares of the object's.
    """

    least_reach: float = 0.15
    """Least extent of a foot on both sides of the centre of mass; wider feet stay."""
    reach: float = 0.3
    """Least extent of an added base on both sides of the centre of mass."""
    largest_height: float = 0.45
    """Largest height of the lower outline above the ground; a higher outline has
    another support.
    """
    roundness: float = 0.85
    """Share of its smallest circle above which fruit may roll and gets no base."""
    piece_share: float = 0.95
    """Least share of its area in its largest piece: smaller pieces are stray pixels."""


BASE = _BaseLimits()


def needs_base(foot: Foot) -> bool:
    """Return whether an object on level ground would tip over its foot."""
    outline = foot.item.outline
    if isinstance(outline, Disc) or foot.item.cut:
        return False
    if kind(foot.item.label).form == "ball" and _is_nearly_round(outline):
        return False
    x0, _, x1, _ = bounds(outline)
    middle = float(mass_properties(outline).center[0])
    reach = BASE.least_reach * (x1 - x0)
    has_tipping_foot = foot.left[0] > middle - reach or foot.right[0] < middle + reach
    return bool(has_tipping_foot)


def _is_nearly_round(outline: Region) -> bool:
    points = np.concatenate([ring.outer for ring in outline.rings]).astype(np.float32)
    _, radius = cv2.minEnclosingCircle(points)
    area = mass_properties(outline).area
    return bool(area > BASE.roundness * np.pi * radius**2)


def add_base(foot: Foot, line: Line) -> Region | None:
    """Return the outline with a flat base on a line, under its centre of mass.

    Returns None if the lower outline is too high above the line or in several pieces.
    """
    if isinstance(foot.item.outline, Disc):
        return None
    outline = _largest_piece(foot.item.outline)
    if len(outline.rings) != 1:
        return None
    base = _draw_base(foot, line, outline)
    if base is None:
        return None
    union_shape = shapely.union(outline_shape(outline), base)
    if not isinstance(union_shape, shapely.Polygon):
        return None
    # Gaps between the outline and its base become part of the base.
    outer = np.asarray(union_shape.exterior.coords[:-1], np.float64)
    if not union_shape.exterior.is_ccw:
        outer = outer[::-1]
    return Region((Ring(outer, outline.rings[0].holes),))


def _cut_hull(hull: Array, left: float, right: float) -> tuple[Array, Array]:
    """Return columns and rows of a lower hull (K, 2) between two columns."""
    hull_x, hull_y = hull.T
    left = max(left, float(hull_x[0]))
    right = min(right, float(hull_x[-1]))
    inner_x = hull_x[(hull_x > left) & (hull_x < right)]
    xs = np.array([left, *inner_x, right])
    return xs, np.interp(xs, hull_x, hull_y)


def _draw_base(foot: Foot, line: Line, outline: Region) -> shapely.Geometry | None:
    """Return the area between the lower outline and a line, or None if it is too
    high.
    """
    x0, y0, x1, y1 = bounds(outline)
    middle = float(mass_properties(outline).center[0])
    reach = BASE.reach * (x1 - x0)
    left = min(middle - reach, float(foot.left[0]))
    right = max(middle + reach, float(foot.right[0]))
    # The base follows the lower outline at its top and the ground at its bottom.
    xs, ys = _cut_hull(foot.hull, left, right)
    left, right = float(xs[0]), float(xs[-1])
    ground = line.slope * xs + line.height
    if float((ground - ys).max()) > BASE.largest_height * (y1 - y0):
        return None
    # The base reaches 1 px into the outline, so that the union is one piece.
    upper = np.stack([xs, ys - 1.0], axis=1)
    lower = np.array([[right, line.y_at(right)], [left, line.y_at(left)]])
    return shapely.Polygon(np.concatenate([upper, lower])).buffer(0)


def _largest_piece(outline: Region) -> Region:
    """Return an outline without stray pieces beside its largest one."""
    areas = [abs(polygon_moments(ring.outer).area) for ring in outline.rings]
    largest = max(areas)
    if len(areas) == 1 or largest < BASE.piece_share * sum(areas):
        return outline
    return Region((outline.rings[areas.index(largest)],))
