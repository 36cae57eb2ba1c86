"""Contact of objects with the ground: feet and floor lines.

Coordinates are image axes, px: the lowest point has the largest y.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.geometry.fitting import FIT, fit_outlines
from physgen.geometry.polygon import (
    Array,
    Disc,
    Outline,
    Region,
    bounds,
    cross,
    mass_properties,
)
from physgen.perceive.roles import Labels, Mask, PhotoObject

STEEP = 0.15
"""Largest slope of a level floor."""
AGREE = 0.12
"""Largest difference between the slope of a line and of an object on it."""


@dataclass(frozen=True)
class _FootLimits:
    """Limits of feet and of the lines through them; slopes, px."""

    # Steepest slope that friction can hold: cardboard on wood slips at 0.5 to 0.8.
    steepest: float = 0.75
    # Least width of a steep edge under an object on a slope, as a share of the object's
    # width.
    least_share: float = 0.5
    # px: the slope of a shorter edge is noise of its mask.
    short: float = 8.0
    # px by which a mask's straight edge bulges.
    bulge: float = 1.5
    # Columns in which a sloped edge is compared with the outline.
    columns: int = 64
    # Largest gap between outline and edge, over the object's height.
    gap: float = 0.03
    # Least share of a sloped edge that the object lies on.
    touching: float = 0.5
    # Largest slope of a floor through only two objects.
    two_tilt: float = 0.04


@dataclass(frozen=True)
class _CarrierLimits:
    """Limits of objects that carry others."""

    # Largest gap above a carrier, as a share of the object's height.
    gap: float = 0.06
    # px: least value of that gap.
    least_gap: float = 3
    # Largest distance of the centre of mass outside the carriers, as a share of the
    # object's width.
    overhang: float = 0.1
    # Number of parts of the object's height; the lowest one is its foot.
    parts: int = 8
    # Least share of a foot above its carrier.
    foot_share: float = 0.5


@dataclass(frozen=True)
class _SearchLimits:
    """Limits of the search for common lines."""

    # Feet with which all pairs are tried.
    feet: int = 400
    # Lines whose distances to all points are compared at once.
    chunk: int = 4096


FOOT, CARRIER, SEARCH = _FootLimits(), _CarrierLimits(), _SearchLimits()


@dataclass(frozen=True, eq=False)
class Foot:
    """The foot of an object: the edge on which it stands."""

    item: PhotoObject
    left: Array  # (2,) px, on its hull
    right: Array  # (2,) px
    # (K, 2) px: its lower side from left to right, never below the line `left` to
    # `right`.
    hull: Array

    @cached_property
    def slope(self) -> float:
        """Return the slope of the edge on which the object stands."""
        return float(
            (self.right[1] - self.left[1]) / max(self.right[0] - self.left[0], 1e-9)
        )

    @cached_property
    def lowest(self) -> Array:
        """Return the middle (2,) of the foot, px."""
        return np.asarray((self.left + self.right) / 2)


@dataclass(frozen=True)
class Line:
    """The line y = slope x + height, px."""

    slope: float
    height: float

    def y_at(self, x: float) -> float:
        """Return y at x."""
        return self.slope * x + self.height


def find_foot(item: PhotoObject) -> Foot:
    """Return the foot of an object on a floor under it."""
    center = mass_properties(item.outline).center
    hull = lower_hull(item.outline)
    if isinstance(item.outline, Disc):
        x = float(center[0])
        y = float(center[1]) + item.outline.radius
        half_width = 0.3 * item.outline.radius
        return Foot(
            item, np.array([x - half_width, y]), np.array([x + half_width, y]), hull
        )
    # The object stands on the hull's edge below its centre of mass, if that edge is
    # level.
    edge_before = np.searchsorted(hull[:, 0], center[0]) - 1
    k = int(np.clip(edge_before, 0, len(hull) - 2))
    left = hull[k]
    right = hull[k + 1]
    run = right[0] - left[0]
    if run >= 2 and abs(right[1] - left[1]) <= STEEP * run:
        return Foot(item, left, right, hull)
    # Otherwise it may stand on a straight part along a slope ...
    first, last = _straight_part(hull, k)
    run, rise = hull[last] - hull[first]
    is_long = run >= max(FOOT.short, FOOT.least_share * (hull[-1, 0] - hull[0, 0]))
    is_slope = is_long and abs(rise) <= FOOT.steepest * run
    if is_slope and _lies_along(item.outline, hull[first], hull[last]):
        return Foot(item, hull[first], hull[last], hull)
    # ... or on its lowest corner.
    x, y = hull[int(np.argmax(hull[:, 1]))]
    half_width = 0.1 * (hull[-1, 0] - hull[0, 0])
    return Foot(
        item, np.array([x - half_width, y]), np.array([x + half_width, y]), hull
    )


def _lies_along(outline: Region, start: Array, end: Array) -> bool:
    """Return whether most of an outline's lower side lies on a line between two points.

    A line through two feet that stand nearer and farther is no slope.
    """
    _, top, _, low = bounds(outline)
    x = np.linspace(start[0], end[0], FOOT.columns + 2)[1:-1]
    line = np.interp(x, [start[0], end[0]], [start[1], end[1]])
    distances = line - _find_lowest_border(outline, x)
    is_close = distances <= max(2 * FOOT.bulge, FOOT.gap * (low - top))
    return bool(is_close.mean() >= FOOT.touching)


def _find_lowest_border(outline: Region, x: Array) -> Array:
    """Return the largest y (n,) of an outline in columns `x` (n,)."""
    lowest = np.full(len(x), -np.inf)
    for ring in outline.rings:
        starts = ring.outer
        ends = np.roll(ring.outer, -1, axis=0)
        for (xa, ya), (xb, yb) in zip(starts, ends, strict=True):
            is_over = (x >= min(xa, xb)) & (x <= max(xa, xb))
            if xb != xa:
                share = (x - xa) / (xb - xa)
            else:
                share = np.zeros_like(x)
            y = ya + share * (yb - ya)
            lowest = np.where(is_over, np.maximum(lowest, y), lowest)
    return lowest


def _straight_part(hull: Array, k: int) -> tuple[int, int]:
    """Return the corners of the longest straight part of a hull `(K, 2)` with its k-th
    edge.
    """
    best = k, k + 1
    for i in range(k + 1):
        for j in range(k + 1, len(hull)):
            chord = hull[j] - hull[i]
            distances = np.abs(cross(chord, hull[i : j + 1] - hull[i])) / max(
                float(np.hypot(*chord)), 1e-9
            )
            longer = hull[j, 0] - hull[i, 0] > hull[best[1], 0] - hull[best[0], 0]
            if distances.max() <= FOOT.bulge and longer:
                best = i, j
    return best


def lower_hull(outline: Outline) -> Array:
    """Return the lower side `(K, 2)` of the convex hull, left to right, px.

    The method is Andrew's monotone chain.
    """
    if isinstance(outline, Disc):
        angle = np.linspace(np.pi, 0, 65)
        return np.asarray(
            outline.center
            + outline.radius * np.stack([np.cos(angle), np.sin(angle)], 1)
        )
    points = np.concatenate([ring.outer for ring in outline.rings])
    points = points[np.lexsort((-points[:, 1], points[:, 0]))]
    chain: list[Array] = []
    for point in points:
        while len(chain) > 1 and cross(chain[-1] - chain[-2], point - chain[-1]) >= 0:
            chain.pop()
        if not chain or point[0] > chain[-1][0]:
            chain.append(point)
    return np.array(chain if len(chain) > 1 else [points[0], points[0] + (1e-3, 0.0)])


@dataclass(frozen=True, eq=False)
class _Surroundings:
    """The pixels under an object."""

    # px: first and last column of the object.
    left: int
    right: int
    # (n,): columns of the object.
    columns: NDArray[np.intp]
    # (gap, n): ids under the object in each column.
    ids: Labels


def has_carriers(
    item: PhotoObject, labels: Labels, objects: Sequence[PhotoObject]
) -> bool:
    """Return whether other objects carry an object.

    Carriers are close below it on both sides of its centre of mass.
    """
    surroundings = _find_ids_below(item, labels)
    if surroundings is None:
        return False
    neighbour_ids = set(np.unique(surroundings.ids).tolist()) - {0, item.id}
    lowest = bounds(item.outline)[3]
    holders = []
    for t in objects:
        if t.id in neighbour_ids and bounds(t.outline)[3] > lowest:
            holders.append(t.id)
    support_columns = np.isin(surroundings.ids, holders).any(axis=0)
    if not support_columns.any():
        return False
    x = surroundings.columns[support_columns]
    slack = CARRIER.overhang * (surroundings.right - surroundings.left + 1)
    center = mass_properties(item.outline).center
    return bool(x.min() <= center[0] + slack and x.max() >= center[0] - slack)


def _find_ids_below(item: PhotoObject, labels: Labels) -> _Surroundings | None:
    """Return the ids close below an object, or None without pixels of the object."""
    mask = np.asarray(labels == item.id)
    # Rows and columns of the box take a fraction of the time of those of all pixels.
    left, top, width, height = cv2.boundingRect(mask.view(np.uint8))
    if not width:
        return None
    right = left + width - 1
    box = mask[top : top + height, left : left + width]
    occupied = np.flatnonzero(box.any(axis=0))
    bottom = top + height - 1 - box[::-1].argmax(axis=0)
    gap = int(max(CARRIER.least_gap, CARRIER.gap * height))
    rows_below = np.minimum(
        bottom[occupied] + np.arange(1, gap + 1)[:, None], labels.shape[0] - 1
    )
    ids = labels[rows_below, occupied + left]
    return _Surroundings(left, right, occupied + left, ids)


def close_gaps_below(
    labels: Labels, objects: Sequence[PhotoObject]
) -> dict[int, Outline]:
    """Return outlines, by id, of objects with a small gap above their carrier.

    Their feet are extended downwards to the carrier. Discs stay as they are.
    """
    closed_labels = labels.copy()
    closed_ids = set[int]()
    for item in objects:
        if item.cut or isinstance(item.outline, Disc):
            continue
        if has_carriers(item, labels, objects) and _close_gap(
            closed_labels, labels, item.id
        ):
            closed_ids.add(item.id)
    if not closed_ids:
        return {}
    outlines = fit_outlines(closed_labels, [t.id for t in objects])
    return {i: outline for i, outline in outlines.items() if i in closed_ids}


def _close_gap(closed_labels: Labels, labels: Labels, i: int) -> bool:
    """Extend the foot of object `i` down to its carrier in `closed_labels`.

    Returns whether there is a gap.
    """
    mask = labels == i
    columns = np.flatnonzero(mask.any(axis=0))
    ends = len(mask) - mask[::-1, columns].argmax(axis=0)
    low = int(ends.max())
    height = int(np.count_nonzero(mask.any(axis=1)))
    foot = ends > low - height / CARRIER.parts
    gap = _measure_gap(labels, columns[foot], low, height)
    if gap < FIT.touch:
        return False
    for x, end in zip(columns[foot], ends[foot], strict=True):
        part = closed_labels[end : low + gap, x]
        part[part == 0] = i
    return True


def _measure_gap(
    labels: Labels, columns: NDArray[np.intp], low: int, height: int
) -> int:
    """Return the number of rows between a foot and its carrier, or 0."""
    reach = max(int(CARRIER.least_gap), int(CARRIER.gap * height)) + 1
    carrier_mask: Mask = labels[low : low + reach, columns] > 0
    is_carrier = carrier_mask.mean(axis=1) >= CARRIER.foot_share
    return int(is_carrier.argmax())


def group_feet(feet: Sequence[Foot], tolerance: float) -> list[tuple[Line, list[Foot]]]:
    """Return feet on common lines, largest group first.

    A foot alone on its line stands on a level one.
    """
    remaining_feet = list(feet)
    groups: list[tuple[Line, list[Foot]]] = []
    while remaining_feet:
        points = np.array([f.lowest for f in remaining_feet])
        slopes = np.array([f.slope for f in remaining_feet])
        # The largest group is taken first; its feet are removed, and the search
        # repeats.
        lines = _largest_groups(points, slopes, tolerance)
        line, group = max(lines, key=lambda pair: _quality(pair[0], pair[1], points))
        groups.append((line, [remaining_feet[i] for i in group]))
        used_indices = set(group)
        remaining_feet = [
            f for i, f in enumerate(remaining_feet) if i not in used_indices
        ]
    return groups


@dataclass(frozen=True, eq=False)
class _Lines:
    """Lines through pairs of feet."""

    slopes: Array  # (M,)
    heights: Array  # (M,): y at x = 0, px

    @property
    def steepness(self) -> Array:
        """Return the absolute slopes (M,)."""
        return np.abs(self.slopes)


def _largest_groups(
    points: Array, slopes: Array, tolerance: float
) -> list[tuple[Line, list[int]]]:
    """Return lines through two points with the largest number of feet on them, and the
    feet.

    `points` is `(N, 2)`. If no line has two feet, each foot gets its own line.
    """
    lines = _draw_lines(points)
    membership = _find_members(lines, points, slopes, tolerance)
    counts = _count_members(lines, membership)
    if counts.max(initial=0) < 2:
        own_slopes = np.where(np.abs(slopes) > STEEP, slopes, 0.0).tolist()
        return [
            (Line(s, float(y - s * x)), [k])
            for k, (s, (x, y)) in enumerate(zip(own_slopes, points, strict=True))
        ]
    candidates = []
    for k in np.flatnonzero(counts == counts.max()).tolist():
        group = np.flatnonzero(membership[k])
        slope = lines.slopes[k]
        height = lines.heights[k]
        if len(group) > 2:
            x, y = points[group].T
            slope, height = np.polyfit(x, y, 1)
        candidates.append((Line(float(slope), float(height)), group.tolist()))
    return candidates


def _draw_lines(points: Array) -> _Lines:
    """Return lines through pairs of points `(N, 2)`.

    With very many feet, pairs of neighbours and pairs across the photo suffice.
    """
    order = np.argsort(points[:, 0], kind="stable")
    reach = SEARCH.feet // len(order) + 1
    i, j = np.triu_indices(len(order), 1)
    pair_mask = (j - i <= reach) | (i < reach)
    starts = points[order[i[pair_mask]]]
    run, rise = (points[order[j[pair_mask]]] - starts).T
    slopes = np.where(run > 1, rise / np.maximum(run, 1.0), 0.0)
    return _Lines(slopes, starts[:, 1] - slopes * starts[:, 0])


def _find_members(
    lines: _Lines, points: Array, slopes: Array, tolerance: float
) -> Mask:
    """Return (M, N) whether each foot is on each line."""
    membership = np.zeros((len(lines.slopes), len(points)), bool)
    # Chunks limit the memory of the comparison of all lines with all points.
    count = len(lines.slopes)
    for chunk in np.array_split(np.arange(count), count // SEARCH.chunk + 1):
        line_slopes = lines.slopes[chunk, None]
        distances = points[:, 1] - (
            line_slopes * points[:, 0] + lines.heights[chunk, None]
        )
        has_slope = (lines.steepness[chunk, None] <= STEEP) | (
            np.abs(slopes - line_slopes) <= AGREE
        )
        membership[chunk] = (np.abs(distances) <= tolerance) & has_slope
    return membership


def _count_members(lines: _Lines, membership: Mask) -> NDArray[np.intp]:
    """Return the number (M,) of feet on each line, 0 for lines of impossible slopes."""
    counts = np.asarray(membership.sum(axis=1))
    steepness = lines.steepness
    # Two points always define a line, so a slope needs a third foot.
    is_uncertain = (counts < 3) & (steepness > FOOT.two_tilt) & (steepness <= STEEP)
    counts[(steepness > FOOT.steepest) | is_uncertain] = 0
    return counts


def _quality(
    line: Line, group: Sequence[int], points: Array
) -> tuple[int, float, float]:
    """Return a sort key: many feet first, then a close fit, then the lower place."""
    x, y = points[list(group)].T
    rest = np.abs(y - (line.slope * x + line.height)).tolist()
    return len(group), -round(sum(rest) + 100 * abs(line.slope), 6), float(y.max())
