"""Rectangles in place of the outlines of rectangular objects."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from physgen.geometry.convex import overlap_depth
from physgen.geometry.polygon import (
    Array,
    Disc,
    Outline,
    Region,
    Ring,
    bounds,
    polygon_moments,
)
from physgen.perceive.roles import PhotoObject
from physgen.perceive.support.equilibrium import contacts


@dataclass(frozen=True)
class _BoxLimits:
    """Limits of outlines that become rectangles; px."""

    # Least IoU of outline and rectangle.
    least_iou: float = 0.97
    # Distance from a side within which the border belongs to that side.
    side_margin: float = 1.5
    # Largest deviation of an upright rectangle, degrees.
    upright: float = 0.5
    # Largest rounding of a corner or bulge of a side.
    rounding: float = 3.0
    # The same as a share of the shorter side.
    rounding_share: float = 0.12
    # Largest overlap with a neighbour.
    overlap: float = 0.05


BOX = _BoxLimits()


def fit_rectangles(objects: Sequence[PhotoObject]) -> dict[int, Outline]:
    """Return rectangles, by id, of rectangular objects that touch no other object.

    Touching objects share their borders: rectangles would leave gaps or overlap.
    """
    outlines = [item.outline for item in objects]
    touching = touching_objects(objects)
    result: dict[int, Outline] = {}
    boxes = np.array(list(map(bounds, outlines))).reshape(-1, 4)
    for k, item in enumerate(objects):
        if item.id in touching or item.cut:
            continue
        rectangle = fit_rectangle(item.outline)
        if rectangle is None:
            continue
        neighbours = []
        for i in _find_overlaps(boxes, rectangle):
            if i != k:
                neighbours.append(outlines[i])
        if all(overlap_depth(rectangle, other) <= BOX.overlap for other in neighbours):
            result[item.id] = rectangle
    return result


def _find_overlaps(boxes: Array, rectangle: Region) -> list[int]:
    """Return the indices of the boxes (N, 4) that overlap the box of a rectangle."""
    x0, y0, x1, y1 = bounds(rectangle)
    is_after = (boxes[:, :2] > (x1, y1)).any(axis=1)
    is_before = (boxes[:, 2:] < (x0, y0)).any(axis=1)
    return list(map(int, np.flatnonzero(~(is_after | is_before))))


def touching_objects(objects: Sequence[PhotoObject]) -> set[int]:
    """Return the ids of objects that touch others."""
    pairs = contacts([item.outline for item in objects], [])
    return {objects[k].id for contact in pairs for k in (contact.body, contact.other)}


def fit_rectangle(outline: Outline) -> Region | None:
    """Return the rectangle with the outline's area and lowest corner, or None.

    None means that the outline is not a rectangle.
    """
    if isinstance(outline, Disc) or len(outline.rings) != 1 or outline.rings[0].holes:
        return None
    points = outline.rings[0].outer
    (_, size, degrees) = cv2.minAreaRect(points.astype(np.float32))
    deviation = (degrees + 45) % 90 - 45
    if abs(deviation) <= BOX.upright:
        angle = 0.0
    else:
        angle = np.radians(deviation)
    turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    # Work in the rectangle's own axes.
    aligned_points = points @ turn.T
    low, high = _sides(aligned_points)
    if angle == 0.0:
        high[1] = bounds(outline)[3]
    width, height = high - low
    if min(width, height) <= 2 * BOX.side_margin:
        return None
    corners = np.array([low, [high[0], low[1]], high, [low[0], high[1]]])
    # The border must follow the sides, with corners that are not too round.
    largest_deviation = min(BOX.rounding, BOX.rounding_share * min(size))
    if _measure_deviation(aligned_points, corners) > largest_deviation:
        return None
    if _measure_iou(aligned_points, low, high) < BOX.least_iou:
        return None
    return Region((Ring(corners @ turn),))


def _measure_deviation(points: Array, corners: Array) -> float:
    """Return the largest distance of points (N, 2) from the sides of a rectangle, and
    of its corners (4, 2) from the border of the points.
    """
    low = corners[0]
    high = corners[2]
    side_distances = np.minimum(np.abs(points - low), np.abs(points - high)).min(axis=1)
    steps = corners[:, None] - _resample_ring_border(points)[None]
    corner_distances = np.hypot(*steps.transpose(2, 0, 1)).min(axis=1)
    return max(float(side_distances.max()), float(corner_distances.max()))


def _measure_iou(points: Array, low: Array, high: Array) -> float:
    """Return the IoU of a polygon (N, 2) and a rectangle with two corners (2,)."""
    width, height = high - low
    common_area = abs(polygon_moments(np.clip(points, low, high)).area)
    area = abs(polygon_moments(points).area)
    return float(common_area / (area + width * height - common_area))


def _sides(points: Array) -> tuple[Array, Array]:
    """Return the lower and upper sides (2,) each, in the rectangle's own axes.

    Each side is at the median of the border along it.
    """
    border = _resample_ring_border(points)
    margin = 2 * BOX.side_margin
    low = np.where(border < border.min(0) + margin, border, np.nan)
    high = np.where(border > border.max(0) - margin, border, np.nan)
    return np.nanmedian(low, axis=0), np.nanmedian(high, axis=0)


def _resample_ring_border(points: Array) -> Array:
    """Return the border of a ring with a point about every half px."""
    parts = []
    for a, b in zip(points, np.roll(points, -1, axis=0), strict=True):
        count = max(2, int(2 * np.hypot(*(b - a))))
        parts.append(a + (b - a) * np.linspace(0, 1, count)[:, None])
    return np.concatenate(parts)
