"""Contact of objects with the ground: feet, floor lines, level feet and rectangles.

Coordinates are image axes, px: the lowest point has the largest y. A floor is a chain
of points on which every object stands as in the photo: on the edge of its convex hull
below its centre of mass, or, for a ball, on a level spot.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from functools import cached_property
from math import radians, sin

import cv2
import numpy as np
import shapely

from physgen.geometry.convex import outline_shape, overlap_depth
from physgen.geometry.fitting import FIT, fit_outlines
from physgen.geometry.polygon import (
    Array,
    Disc,
    Outline,
    Region,
    Ring,
    bounds,
    cross,
    mass_properties,
    polygon_moments,
)
from physgen.geometry.simplify import crossings
from physgen.materials import kind
from physgen.perceive.roles import Labels, PhotoObject
from physgen.perceive.support.equilibrium import contacts

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
    broad: float = 0.5
    # px: the slope of a shorter edge is noise of its mask.
    short: float = 8.0
    # px by which a mask's straight edge bulges.
    ragged: float = 1.5
    # Columns in which a sloped edge is compared with the outline.
    columns: int = 64
    # Largest gap between outline and edge, over the object's height.
    gap: float = 0.03
    # Least share of a sloped edge that the object lies on.
    touching: float = 0.5
    # px: largest distance of points from a line in their place.
    invisible: float = 0.06
    # Largest slope of a floor through only two objects.
    two_tilt: float = 0.04


@dataclass(frozen=True)
class _LevelLimits:
    """Limits of levelled feet and of their heights; px.

    The lowest border of a mask is ragged, and an object on two stray pixels rocks.
    Also, the front edge of an object is nearer to a camera that looks down slightly, so
    that it lies lower in the photo than the moving section through the object's middle.
    The foot is therefore lifted as the camera's usual tilt requires for an object as
    deep as it is wide.
    """

    # degrees: with 4 (`world.tilt`) the floor of a peer photo is missed by 3.3 px, with
    # 0 that of a bundled photo by 4.
    tilt: float = 2.0
    max_lift: float = 2.0
    # Largest distance of a round object from the common line, as a share of its radius.
    disc: float = 0.145
    # Largest rise of a level foot of a narrow object.
    askew: float = 2.5
    # Largest distance of a flat foot below the others' line for a lift to that line.
    nearer: float = 4.0
    # Height above a foot in which the border belongs to the foot.
    band: float = 2.0
    # Largest distance between feet on one straight line.
    alike: float = 1.5
    # Largest slope of a level foot; smaller slopes are errors of the mask.
    level: float = 0.08
    # Least slope of a sloped floor through three feet or more.
    sloped: float = 0.03
    # Least width of a flat foot as a share of the object's width.
    wide: float = 0.35


@dataclass(frozen=True)
class _BoxLimits:
    """Limits of outlines that become rectangles; px."""

    # Least IoU of outline and rectangle.
    covered: float = 0.97
    # Distance from a side within which the border belongs to that side.
    ragged: float = 1.5
    # Largest deviation of an upright rectangle, degrees.
    upright: float = 0.5
    # Largest rounding of a corner or bulge of a side; also at most 12 % of the shorter
    # side.
    rounded: float = 3.0
    # Largest overlap with a neighbour.
    overlap: float = 0.05


FOOT, LEVEL, BOX = _FootLimits(), _LevelLimits(), _BoxLimits()


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

    def at(self, x: float) -> float:
        """Return y at x."""
        return self.slope * x + self.height


def find_foot(item: PhotoObject) -> Foot:
    """Return the foot of an object on a floor under it."""
    center = mass_properties(item.outline).center
    hull = lower_hull(item.outline)
    if isinstance(item.outline, Disc):
        x, y = float(center[0]), float(center[1]) + item.outline.radius
        half_width = 0.3 * item.outline.radius
        return Foot(
            item, np.array([x - half_width, y]), np.array([x + half_width, y]), hull
        )
    # The object stands on the hull's edge below its centre of mass, if that edge is
    # level.
    k = int(np.clip(np.searchsorted(hull[:, 0], center[0]) - 1, 0, len(hull) - 2))
    left, right = hull[k], hull[k + 1]
    run = right[0] - left[0]
    if run >= 2 and abs(right[1] - left[1]) <= STEEP * run:
        return Foot(item, left, right, hull)
    # Otherwise it may stand on a straight part along a slope ...
    first, last = _straight_part(hull, k)
    run, rise = hull[last] - hull[first]
    is_long = run >= max(FOOT.short, FOOT.broad * (hull[-1, 0] - hull[0, 0]))
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
    lowest = np.full(len(x), -np.inf)
    for ring in outline.rings:
        first, second = ring.outer, np.roll(ring.outer, -1, axis=0)
        for (xa, ya), (xb, yb) in zip(first, second, strict=True):
            is_over = (x >= min(xa, xb)) & (x <= max(xa, xb))
            share = (x - xa) / (xb - xa) if xb != xa else np.zeros_like(x)
            y = ya + share * (yb - ya)
            lowest = np.where(is_over, np.maximum(lowest, y), lowest)
    near = line - lowest <= max(2 * FOOT.ragged, FOOT.gap * (low - top))
    return bool(near.mean() >= FOOT.touching)


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
            if distances.max() <= FOOT.ragged and longer:
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


def is_carried(
    item: PhotoObject, labels: Labels, objects: Sequence[PhotoObject]
) -> bool:
    """Return whether other objects carry an object.

    Carriers are close below it on both sides of its centre of mass.
    """
    rows, columns = np.nonzero(labels == item.id)
    if not len(rows):
        return False
    left, right = int(columns.min()), int(columns.max())
    bottom = np.full(right - left + 1, -1)
    np.maximum.at(bottom, columns - left, rows)
    occupied = np.flatnonzero(bottom >= 0)
    gap = int(max(3, 0.06 * (rows.max() - rows.min() + 1)))
    center = mass_properties(item.outline).center
    rows_below = np.minimum(
        bottom[occupied] + np.arange(1, gap + 1)[:, None], labels.shape[0] - 1
    )
    ids_below = labels[rows_below, occupied + left]
    neighbour_ids = set(np.unique(ids_below).tolist()) - {0, item.id}
    lowest = bounds(item.outline)[3]
    holders = [
        t.id for t in objects if t.id in neighbour_ids and bounds(t.outline)[3] > lowest
    ]
    support_columns = np.isin(ids_below, holders).any(axis=0)
    if not support_columns.any():
        return False
    x = occupied[support_columns] + left
    slack = 0.1 * (right - left + 1)
    return bool(x.min() <= center[0] + slack and x.max() >= center[0] - slack)


def close_gaps_below(
    labels: Labels, objects: Sequence[PhotoObject]
) -> dict[int, Outline]:
    """Return outlines, by id, of objects with a small gap above their carrier.

    Their feet are extended downwards to the carrier. Discs stay as they are.
    """
    closed_labels, feet = labels.copy(), set[int]()
    for item in objects:
        if (
            item.cut
            or isinstance(item.outline, Disc)
            or not is_carried(item, labels, objects)
        ):
            continue
        mask = labels == item.id
        columns = np.flatnonzero(mask.any(axis=0))
        ends = len(mask) - mask[::-1, columns].argmax(axis=0)
        low, height = int(ends.max()), np.count_nonzero(mask.any(axis=1))
        foot = ends > low - height / 8
        carrier_mask = (
            labels[low : low + max(3, int(0.06 * height)) + 1, columns[foot]] > 0
        )
        gap = int((carrier_mask.mean(axis=1) >= 0.5).argmax())
        if gap >= FIT.touch:
            feet.add(item.id)
            for x, end in zip(columns[foot], ends[foot], strict=True):
                part = closed_labels[end : low + gap, x]
                part[part == 0] = item.id
    if not feet:
        return {}
    return {
        i: outline
        for i, outline in fit_outlines(closed_labels, [t.id for t in objects]).items()
        if i in feet
    }


def group_feet(feet: Sequence[Foot], tolerance: float) -> list[tuple[Line, list[Foot]]]:
    """Return feet on common lines, largest group first.

    A foot alone on its line stands on a level one.
    """
    left = list(feet)
    groups: list[tuple[Line, list[Foot]]] = []
    while left:
        points, slopes = (
            np.array([f.lowest for f in left]),
            np.array([f.slope for f in left]),
        )
        # The largest group is taken first; its feet are removed, and the search
        # repeats.
        lines = _largest_groups(points, slopes, tolerance)
        line, group = max(lines, key=lambda found: _quality(found[0], found[1], points))
        groups.append((line, [left[i] for i in group]))
        used_indices = set(group)
        left = [f for i, f in enumerate(left) if i not in used_indices]
    return groups


def _largest_groups(
    points: Array, slopes: Array, tolerance: float
) -> list[tuple[Line, list[int]]]:
    """Return lines through two points with the largest number of feet on them, and the
    feet.

    `points` is `(N, 2)`. If no line has two feet, each foot gets its own line.
    """
    order = np.argsort(points[:, 0], kind="stable")
    # With very many feet, pairs of neighbours and pairs across the photo suffice.
    reach = 400 // len(order) + 1
    i, j = np.triu_indices(len(order), 1)
    pair_mask = (j - i <= reach) | (i < reach)
    first, run = (
        points[order[i[pair_mask]]],
        points[order[j[pair_mask]]] - points[order[i[pair_mask]]],
    )
    slope = np.where(run[:, 0] > 1, run[:, 1] / np.maximum(run[:, 0], 1.0), 0.0)
    height, steepness = first[:, 1] - slope * first[:, 0], np.abs(slope)
    membership = np.zeros((len(slope), len(points)), bool)
    # Chunks limit the memory of the comparison of all lines with all points.
    for chunk in np.array_split(np.arange(len(slope)), len(slope) // 4096 + 1):
        distances = points[:, 1] - (
            slope[chunk, None] * points[:, 0] + height[chunk, None]
        )
        has_slope = (steepness[chunk, None] <= STEEP) | (
            np.abs(slopes - slope[chunk, None]) <= AGREE
        )
        membership[chunk] = (np.abs(distances) <= tolerance) & has_slope
    count = membership.sum(axis=1)
    # Two points always define a line, so a slope needs a third foot.
    two_askew = (count < 3) & (steepness > FOOT.two_tilt) & (steepness <= STEEP)
    count[(steepness > FOOT.steepest) | two_askew] = 0
    if count.max(initial=0) < 2:
        own_slopes = np.where(np.abs(slopes) > STEEP, slopes, 0.0).tolist()
        return [
            (Line(s, float(y - s * x)), [k])
            for k, (s, (x, y)) in enumerate(zip(own_slopes, points, strict=True))
        ]
    candidates = []
    for k in np.flatnonzero(count == count.max()).tolist():
        group = np.flatnonzero(membership[k])
        x, y = points[group].T
        fit = np.polyfit(x, y, 1) if len(group) > 2 else (slope[k], height[k])
        candidates.append((Line(float(fit[0]), float(fit[1])), group.tolist()))
    return candidates


def _quality(
    line: Line, group: Sequence[int], points: Array
) -> tuple[int, float, float]:
    """Return a sort key: many feet first, then a close fit, then the lower place."""
    x, y = points[list(group)].T
    rest = np.abs(y - (line.slope * x + line.height)).tolist()
    return len(group), -round(sum(rest) + 100 * abs(line.slope), 6), float(y.max())


def rounded_down(x: float, y: float) -> tuple[float, float]:
    """Round to 0.01 px, y downwards, so that a wall does not enter the objects on
    it.
    """
    return round(x, 2), float(np.ceil(y * 100 - 1e-6) / 100)


def floor_points(
    line: Line, group: Sequence[Foot], ends: tuple[float, float]
) -> list[tuple[float, float]]:
    """Return a chain from x = `ends[0]` to `ends[1]` that carries every object of a
    group.

    The chain enters none of the objects.
    """
    chain = sorted((float(x), float(y)) for f in group for x, y in (f.left, f.right))
    # Add hull points below the chain until the chain enters no hull.
    for _ in range(8):
        xs, ys = (np.array([p[k] for p in chain]) for k in (0, 1))
        low = [
            (float(x), float(y))
            for f in group
            for x, y in f.hull
            if y > np.interp(x, xs, ys, -np.inf, -np.inf) + 1e-6
        ]
        inside = [p for p in low if xs[0] <= p[0] <= xs[-1]]
        if not inside:
            break
        chain = sorted({*chain, *inside})
    first, last = chain[0], chain[-1]
    start, end = min(ends[0], first[0] - 0.01), max(ends[1], last[0] + 0.01)
    chain = [
        (start, _clear_of_hulls(group, first, start, line.slope, -1)),
        *chain,
        (end, _clear_of_hulls(group, last, end, line.slope, 1)),
    ]
    rounded_chain = [rounded_down(x, y) for x, y in chain]
    return _without_straight_points(
        [
            p
            for i, p in enumerate(rounded_chain)
            if i == 0 or p[0] > rounded_chain[i - 1][0]
        ]
    )


def _clear_of_hulls(
    group: Sequence[Foot], start: tuple[float, float], x: float, slope: float, side: int
) -> float:
    """Return y at x of a line from `start` outwards that stays below every hull.

    The line has at least the given slope.
    """
    y = start[1] + slope * (x - start[0])
    for f in group:
        points = f.hull[(f.hull[:, 0] - start[0]) * side > 0.05]
        for px, py in points:
            if abs(px - start[0]) <= abs(x - start[0]):
                y = max(
                    y,
                    start[1]
                    + float(py - start[1]) / float(px - start[0]) * (x - start[0]),
                )
    return y


def _without_straight_points(
    chain: list[tuple[float, float]],
) -> list[tuple[float, float]]:
    """Return a chain without points on the line between their neighbours, to 0.005 px.

    If all points nearly lie on one line, only the two ends remain.
    """
    points = np.array(chain)
    (x0, y0), (x1, y1) = points[0], points[-1]
    distances = points[:, 1] - (
        y0 + (y1 - y0) * (points[:, 0] - x0) / max(x1 - x0, 1e-9)
    )
    if np.ptp(distances) <= FOOT.invisible:
        down = float(distances.max())
        return [
            (x, float(np.ceil((y + down) * 100 - 1e-6) / 100))
            for x, y in (chain[0], chain[-1])
        ]
    result = [chain[0]]
    for i in range(1, len(chain) - 1):
        (x0, y0), (x, y), (x1, y1) = result[-1], chain[i], chain[i + 1]
        if abs(y0 + (y1 - y0) * (x - x0) / (x1 - x0) - y) > 0.005:
            result.append(chain[i])
    return [*result, chain[-1]]


# Level feet.


def stands_flat(foot: Foot) -> bool:
    """Return whether an object stands on a level edge rather than a corner or a
    curve.
    """
    if isinstance(foot.item.outline, Disc):
        return False
    x0, _, x1, _ = bounds(foot.item.outline)
    low = foot.hull[foot.hull[:, 1] >= foot.hull[:, 1].max() - LEVEL.band]
    run = float(foot.right[0] - foot.left[0])
    level = abs(float(foot.right[1] - foot.left[1])) <= max(
        LEVEL.level * run, LEVEL.askew
    )
    return level and float(np.ptp(low[:, 0])) >= LEVEL.wide * (x1 - x0)


def _height(foot: Foot) -> float:
    """Return the y at which an object stands.

    A flat foot is lifted from its front edge to the section through the object's
    middle.
    """
    x0, y0, x1, y1 = bounds(foot.item.outline)
    lift = min(LEVEL.max_lift, 0.5 * sin(radians(LEVEL.tilt)) * min(x1 - x0, y1 - y0))
    return float(foot.hull[:, 1].max()) - lift * (
        stands_flat(foot) and not foot.item.top
    )


def free_discs(objects: Sequence[PhotoObject]) -> frozenset[int]:
    """Return the ids of round objects that touch no other object.

    If such a disc is off the common line, its mask is wrong.
    """
    discs = {item.id for item in objects if isinstance(item.outline, Disc)}
    return frozenset(discs - touching_objects(objects))


def split_group(
    line: Line, group: Sequence[Foot], free: Collection[int]
) -> list[tuple[Line, list[Foot]]]:
    """Return the feet of a group on one line, and each other foot by itself.

    The line is level unless most feet show its slope. One floor for all feet would be a
    chain of humps: a floor is flat, so the masks are wrong or some objects are nearer
    or farther. Objects `free` follow the line, as objects with flat feet do.
    """
    if abs(line.slope) > STEEP or _check_sloped_floor(line, group):
        return [(line, list(group))]
    level, sloped_feet = (
        _near_line(group, slope, free, LEVEL.alike)[1] for slope in (0.0, line.slope)
    )
    # A single additional object is no evidence of a slope.
    slope = line.slope if len(sloped_feet) >= len(level) + 2 else 0.0
    common_line, feet_on_line = _near_line(
        group, slope, free, LEVEL.askew, LEVEL.nearer
    )
    separate = [f for f in group if len(feet_on_line) < 2 or f not in feet_on_line]
    return [(common_line, feet_on_line)] * (len(feet_on_line) > 1) + [
        (Line(0.0, round(_height(f), 2)), [f]) for f in separate
    ]


def _check_sloped_floor(line: Line, group: Sequence[Foot]) -> bool:
    """Return whether a line belongs to a sloped floor."""
    return len(group) > 2 and abs(line.slope) >= LEVEL.sloped


def _near_line(
    group: Sequence[Foot],
    slope: float,
    free: Collection[int],
    within: float,
    lower: float | None = None,
) -> tuple[Line, list[Foot]]:
    """Return the line of a slope through most of a group, and the feet on it.

    Feet are on the line within `within` px. Feet that follow it may also be down to
    `lower` px below it.
    """
    intercepts = np.array(
        [_height(foot) - slope * float(foot.lowest[0]) for foot in group]
    )
    line = Line(slope, round(float(np.median(intercepts)), 2))
    follows = np.array([foot.item.id in free or stands_flat(foot) for foot in group])
    # A flat foot nearer to the camera is lower in the photo and can be lifted.
    radii = [
        f.item.outline.radius if isinstance(f.item.outline, Disc) else np.inf
        for f in group
    ]
    # A disc may move only as far as its pixels stay inside its circle.
    reach = np.minimum(LEVEL.disc * np.array(radii), 3.6)
    largest = np.where(follows, within if lower is None else lower, within)
    line_members = (intercepts - line.height >= -np.minimum(within, reach)) & (
        intercepts - line.height <= np.minimum(largest, reach)
    )
    ends = np.array(
        [
            [f.left[1] - line.at(f.left[0]), f.right[1] - line.at(f.right[0])]
            for f in group
        ]
    )
    line_members &= follows | (np.abs(ends).max(axis=1) <= LEVEL.alike)
    return line, [
        foot for foot, is_member in zip(group, line_members, strict=True) if is_member
    ]


def level_feet(
    line: Line, group: Sequence[Foot], free: Collection[int]
) -> dict[int, Outline]:
    """Return outlines, by id, with feet straight on the line of a group.

    This applies to objects with flat feet, or as steep as a slope; `free` discs are
    resized to reach the line.
    """
    result: dict[int, Outline] = {}
    for foot in group:
        outline, on_slope = foot.item.outline, abs(line.slope) > STEEP
        follows = (
            abs(foot.slope - line.slope) <= AGREE if on_slope else stands_flat(foot)
        )
        if (
            isinstance(outline, Disc)
            and foot.item.id in free
            and line.slope == 0
            and len(group) > 1
        ):
            x, y = outline.center
            r = (line.height - float(y) + outline.radius) / 2
            result[foot.item.id] = Disc(np.array([x, line.height - r]), r)
        if (
            isinstance(outline, Disc)
            or not follows
            or (_check_sloped_floor(line, group) and not on_slope)
        ):
            continue
        rise = abs(float(foot.right[1] - foot.left[1]))
        lift = line.at(float(foot.lowest[0])) - float(foot.hull[:, 1].max())
        band = LEVEL.band if on_slope else max(LEVEL.band, rise + 0.5, lift + 0.5)
        result[foot.item.id] = straighten_foot(outline, line, band)
    return result


def straighten_foot(outline: Region, line: Line, band: float = LEVEL.band) -> Region:
    """Return the outline cut off below a line, with its border close above moved onto
    the line.

    `band` is the height of that border, px. The outline is unchanged if its border
    would cross itself.
    """
    normal = np.array([-line.slope, 1.0]) / np.hypot(line.slope, 1.0)
    start = np.array([0.0, line.height])
    rings = []
    for ring in outline.rings:
        distances = (ring.outer - start) @ normal
        low = distances >= -band
        points = ring.outer - np.where(low, distances, 0.0)[:, None] * normal
        # Inside a straight run, points are redundant.
        inner = low & np.roll(low, 1) & np.roll(low, -1)
        if np.ptp(distances) > band and (~inner).sum() >= 3:
            rings.append(Ring(points[~inner], ring.holes))
    borders = [part for ring in rings for part in (ring.outer, *ring.holes)]
    # A thin neck would be pressed flat.
    if not rings or len(crossings([np.round(part, 2) for part in borders])):
        return outline
    return Region(tuple(rings))


def cradle(item: PhotoObject, center: Array, hull: Array) -> list[tuple[float, float]]:
    """Return a chain along the underside of an object: a nest that holds it.

    The chain extends to both sides of the centre of mass.
    """
    outline = item.outline
    if isinstance(outline, Disc):
        x, y, r = float(outline.center[0]), float(outline.center[1]), outline.radius
        a = np.radians(25.0)
        inner, side, depth = r * np.tan(a / 2), r * np.sin(a), r * np.cos(a)
        chain = [
            (x - side, y + depth),
            (x - inner, y + r),
            (x + inner, y + r),
            (x + side, y + depth),
        ]
    else:
        x0, _, x1, _ = bounds(outline)
        reach = 0.3 * (x1 - x0)
        ends = np.clip([center[0] - reach, center[0] + reach], hull[0, 0], hull[-1, 0])
        # The object rests on corners of its hull: without a corner on either side of
        # its centre it would tip.
        k = int(np.clip(np.searchsorted(hull[:, 0], center[0]), 1, len(hull) - 1))
        end_columns = [
            min(ends[0], hull[k - 1, 0] - 0.5),
            max(ends[1], hull[k, 0] + 0.5),
        ]
        ends = np.clip(end_columns, hull[0, 0], hull[-1, 0])
        inner = hull[(hull[:, 0] > ends[0]) & (hull[:, 0] < ends[1])]
        xs = [ends[0], *inner[:, 0], ends[1]]
        chain = [(float(px), float(np.interp(px, hull[:, 0], hull[:, 1]))) for px in xs]
    return [rounded_down(float(px), py) for px, py in chain]


# Flat bases.


@dataclass(frozen=True)
class _BaseLimits:
    """Limits of flat bases under objects whose lower outline recedes from the camera.

    A camera that looks down sees the rear of a base higher in the picture than its
    front. The lowest corner of the outline is the nearest one, and the object would tip
    over it. Widths and heights are shares of the object's.
    """

    narrow: float = 0.15
    """Least extent of a foot on both sides of the centre of mass; wider feet stay."""
    wide: float = 0.3
    """Least extent of an added base on both sides of the centre of mass."""
    high: float = 0.45
    """Largest height of the lower outline above the ground; a higher outline has
    another support.
    """
    round: float = 0.85
    """Share of its smallest circle above which fruit may roll and gets no base."""
    whole: float = 0.95
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
    reach = BASE.narrow * (x1 - x0)
    has_tipping_foot = foot.left[0] > middle - reach or foot.right[0] < middle + reach
    return bool(has_tipping_foot)


def _is_nearly_round(outline: Region) -> bool:
    points = np.concatenate([ring.outer for ring in outline.rings]).astype(np.float32)
    _, radius = cv2.minEnclosingCircle(points)
    area = mass_properties(outline).area
    return bool(area > BASE.round * np.pi * radius**2)


def add_base(foot: Foot, line: Line) -> Region | None:
    """Return the outline with a flat base on a line, under its centre of mass.

    Returns None if the lower outline is too high above the line or in several pieces.
    """
    outline = foot.item.outline
    if isinstance(outline, Disc):
        return None
    outline = _largest_piece(outline)
    if len(outline.rings) != 1:
        return None
    x0, y0, x1, y1 = bounds(outline)
    middle = float(mass_properties(outline).center[0])
    reach = BASE.wide * (x1 - x0)
    left = max(min(middle - reach, float(foot.left[0])), float(foot.hull[0, 0]))
    right = min(max(middle + reach, float(foot.right[0])), float(foot.hull[-1, 0]))
    inner = foot.hull[(foot.hull[:, 0] > left) & (foot.hull[:, 0] < right)]
    # The base follows the lower outline at its top and the ground at its bottom.
    xs = np.array([left, *inner[:, 0], right])
    ys = np.interp(xs, foot.hull[:, 0], foot.hull[:, 1])
    ground = line.slope * xs + line.height
    if float((ground - ys).max()) > BASE.high * (y1 - y0):
        return None
    # The base reaches 1 px into the outline, so that the union is one piece.
    upper = np.stack([xs, ys - 1.0], axis=1)
    lower = np.array([[right, line.at(right)], [left, line.at(left)]])
    base = shapely.Polygon(np.concatenate([upper, lower])).buffer(0)
    union_shape = shapely.union(outline_shape(outline), base)
    if not isinstance(union_shape, shapely.Polygon):
        return None
    # Gaps between the outline and its base become part of the base.
    outer = np.asarray(union_shape.exterior.coords[:-1], np.float64)
    if not union_shape.exterior.is_ccw:
        outer = outer[::-1]
    return Region((Ring(outer, outline.rings[0].holes),))


def _largest_piece(outline: Region) -> Region:
    """Return an outline without stray pieces beside its largest one."""
    areas = [abs(polygon_moments(ring.outer).area) for ring in outline.rings]
    largest = max(areas)
    if len(areas) == 1 or largest < BASE.whole * sum(areas):
        return outline
    return Region((outline.rings[areas.index(largest)],))


# Rectangles.


def fit_rectangles(objects: Sequence[PhotoObject]) -> dict[int, Outline]:
    """Return rectangles, by id, of rectangular objects that touch no other object.

    Touching objects share their borders: rectangles would leave gaps or overlap.
    """
    outlines = [item.outline for item in objects]
    touching = touching_objects(objects)
    result: dict[int, Outline] = {}
    boxes = np.array([bounds(outline) for outline in outlines]).reshape(-1, 4)
    for k, item in enumerate(objects):
        box = None if item.id in touching or item.cut else fit_rectangle(item.outline)
        if box is not None:
            x0, y0, x1, y1 = bounds(box)
            separation = (boxes[:, :2] > (x1, y1)).any(axis=1) | (
                boxes[:, 2:] < (x0, y0)
            ).any(axis=1)
            neighbours = [
                outlines[i] for i in np.flatnonzero(~separation).tolist() if i != k
            ]
            if all(overlap_depth(box, other) <= BOX.overlap for other in neighbours):
                result[item.id] = box
    return result


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
    angle = 0.0 if abs(deviation) <= BOX.upright else np.radians(deviation)
    turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    # Work in the rectangle's own axes.
    aligned_points = points @ turn.T
    low, high = _sides(aligned_points)
    if angle == 0.0:
        high[1] = bounds(outline)[3]
    width, height = high - low
    if min(width, height) <= 2 * BOX.ragged:
        return None
    side_distance = np.minimum(
        np.abs(aligned_points - low), np.abs(aligned_points - high)
    ).min(axis=1)
    corners = np.array([low, [high[0], low[1]], high, [low[0], high[1]]])
    sharp = np.hypot(
        *(corners[:, None] - _resample_ring_border(aligned_points)[None]).transpose(
            2, 0, 1
        )
    ).min(axis=1)
    # The border must follow the sides, with corners that are not too round.
    if max(side_distance.max(), sharp.max()) > min(BOX.rounded, 0.12 * min(size)):
        return None
    inside = np.clip(aligned_points, low, high)
    common_area, area = (
        abs(polygon_moments(inside).area),
        abs(polygon_moments(aligned_points).area),
    )
    if common_area / (area + width * height - common_area) < BOX.covered:
        return None
    return Region((Ring(corners @ turn),))


def _sides(own: Array) -> tuple[Array, Array]:
    """Return the lower and upper sides (2,) each, in the rectangle's own axes.

    Each side is at the median of the border along it.
    """
    border, margin = _resample_ring_border(own), 2 * BOX.ragged
    low, high = (
        np.where(is_side, border, np.nan)
        for is_side in (
            border < border.min(0) + margin,
            border > border.max(0) - margin,
        )
    )
    return np.nanmedian(low, axis=0), np.nanmedian(high, axis=0)


def _resample_ring_border(points: Array) -> Array:
    """Return the border of a ring with a point about every half px."""
    parts = []
    for a, b in zip(points, np.roll(points, -1, axis=0), strict=True):
        count = max(2, int(2 * np.hypot(*(b - a))))
        parts.append(a + (b - a) * np.linspace(0, 1, count)[:, None])
    return np.concatenate(parts)
