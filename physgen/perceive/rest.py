"""Outlines -> what each thing rests on: other things, or a floor laid under it that touches its shape.

Image axes, px: the lowest point has the largest y. A floor is a chain of points, so that every thing stands on it as it
is in the photo: on the edge of its convex hull that its centre of mass is above, a ball on a level spot.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from physgen.geometry import Array, cross
from physgen.outline.outline import Disc, Outline, bounds, mass_properties
from physgen.perceive.roles import Labels, Thing

STEEP = 0.15
"""Slope above which a line is no level floor."""
STEEPEST = 0.75
"""Slope of an edge that friction may still hold a thing on: cardboard on wood slips at 0.5 to 0.8."""
BROAD = 0.5
"""Of its width: what a steep edge under a thing has that it lies on a slope, not askew."""
SHORT = 8.0
"""px: an edge shorter than this is steep by the raggedness of its mask, and level as far as anyone can tell."""
NEARLY = 0.06
"""px by which points are off a line that stands for them: no eye sees the gap."""
RAGGED = 1.5
"""px by which a mask's straight edge bulges."""
AGREE = 0.12
"""Between the slope of a line and that of what lies on it."""
MOST_TILT = 0.04
"""Slope of a floor that only two things tell."""


@dataclass(frozen=True, eq=False)
class Foot:
    """Where a thing stands."""

    thing: Thing
    left: Array
    """(2,) px, on its hull."""
    right: Array
    """(2,) px."""
    hull: Array
    """(K, 2) px: its lower side, left to right, none of it under the line `left` to `right`."""

    @cached_property
    def slope(self) -> float:
        """Of the edge that it stands on."""
        return float((self.right[1] - self.left[1]) / max(self.right[0] - self.left[0], 1e-9))

    @cached_property
    def lowest(self) -> Array:
        """(2,) px: the middle of where it stands."""
        return np.asarray((self.left + self.right) / 2)


def foot(thing: Thing) -> Foot:
    """Where a thing stands, were there a floor under it."""
    center = mass_properties(thing.outline).center
    hull = lower_hull(thing.outline)
    if isinstance(thing.outline, Disc):
        x, y = float(center[0]), float(center[1]) + thing.outline.radius
        aside = 0.3 * thing.outline.radius
        return Foot(thing, np.array([x - aside, y]), np.array([x + aside, y]), hull)
    k = int(np.clip(np.searchsorted(hull[:, 0], center[0]) - 1, 0, len(hull) - 2))
    left, right = hull[k], hull[k + 1]
    run = right[0] - left[0]
    if run >= 2 and abs(right[1] - left[1]) <= STEEP * run:
        return Foot(thing, left, right, hull)
    first, last = _straight(hull, k)
    run, rise = hull[last] - hull[first]
    if run >= max(SHORT, BROAD * (hull[-1, 0] - hull[0, 0])) and abs(rise) <= STEEPEST * run:
        return Foot(thing, hull[first], hull[last], hull)
    x, y = hull[int(np.argmax(hull[:, 1]))]
    aside = 0.1 * (hull[-1, 0] - hull[0, 0])
    return Foot(thing, np.array([x - aside, y]), np.array([x + aside, y]), hull)


def _straight(hull: Array, k: int) -> tuple[int, int]:
    """The longest part of a hull `(K, 2)`, first and last corner, that holds its k-th edge and is straight."""
    best = k, k + 1
    for i in range(k + 1):
        for j in range(k + 1, len(hull)):
            along = hull[j] - hull[i]
            off = np.abs(cross(along, hull[i : j + 1] - hull[i])) / max(float(np.hypot(*along)), 1e-9)
            if off.max() <= RAGGED and hull[j, 0] - hull[i, 0] > hull[best[1], 0] - hull[best[0], 0]:
                best = i, j
    return best


def lower_hull(outline: Outline) -> Array:
    """`(K, 2)` px: the lower side of its convex hull, left to right (Andrew's monotone chain)."""
    if isinstance(outline, Disc):
        angle = np.linspace(np.pi, 0, 65)
        return np.asarray(outline.center + outline.radius * np.stack([np.cos(angle), np.sin(angle)], 1))
    points = np.concatenate([ring.outer for ring in outline.rings])
    points = points[np.lexsort((-points[:, 1], points[:, 0]))]
    chain: list[Array] = []
    for point in points:
        while len(chain) > 1 and cross(chain[-1] - chain[-2], point - chain[-1]) >= 0:
            chain.pop()
        if not chain or point[0] > chain[-1][0]:
            chain.append(point)
    return np.array(chain if len(chain) > 1 else [points[0], points[0] + (1e-3, 0.0)])


def carried(thing: Thing, labels: Labels, things: Sequence[Thing]) -> bool:
    """Whether other things under it hold it: some on either side of its centre of mass, close below."""
    rows, columns = np.nonzero(labels == thing.id)
    if not len(rows):
        return False
    left, right = int(columns.min()), int(columns.max())
    bottom = np.full(right - left + 1, -1)
    np.maximum.at(bottom, columns - left, rows)
    here = np.flatnonzero(bottom >= 0)
    gap = int(max(3, 0.06 * (rows.max() - rows.min() + 1)))
    center = mass_properties(thing.outline).center
    rows_below = np.minimum(bottom[here] + np.arange(1, gap + 1)[:, None], labels.shape[0] - 1)
    below = labels[rows_below, here + left]
    seen = set(np.unique(below).tolist()) - {0, thing.id}
    lowest = bounds(thing.outline)[3]
    holders = [t.id for t in things if t.id in seen and bounds(t.outline)[3] > lowest]
    held = np.isin(below, holders).any(axis=0)
    if not held.any():
        return False
    x = here[held] + left
    slack = 0.1 * (right - left + 1)
    return bool(x.min() <= center[0] + slack and x.max() >= center[0] - slack)


@dataclass(frozen=True)
class Line:
    """y = slope x + height, px."""

    slope: float
    height: float

    def at(self, x: float) -> float:
        """y at x."""
        return self.slope * x + self.height


def clusters(feet: Sequence[Foot], tolerance: float) -> list[tuple[Line, list[Foot]]]:
    """Feet on common lines, largest group first; what shares its line with nothing stands alone on a level one."""
    left = list(feet)
    groups: list[tuple[Line, list[Foot]]] = []
    while left:
        points, slopes = np.array([f.lowest for f in left]), np.array([f.slope for f in left])
        pairs = _largest(points, slopes, _pairs(points), tolerance)
        lines = [_line(points, slopes, pair, tolerance) for pair in pairs]
        line, group = max(lines, key=lambda found: _worth(found[0], found[1], points))
        groups.append((line, [left[i] for i in group]))
        taken = set(group)
        left = [f for i, f in enumerate(left) if i not in taken]
    return groups


def _pairs(points: Array) -> NDArray[np.int64]:
    """`(P, 2)`: each of the points `(N, 2)` with itself, then two and two."""
    ordered = np.argsort(points[:, 0], kind="stable")
    count = len(ordered)
    # of very many, neighbours and those across the photo are enough to find a line
    near = 400 // max(count, 1) + 1
    i, j = np.triu_indices(count, 1)
    kept = (j - i <= near) | (i < near)
    alone = np.arange(count)
    return np.concatenate([np.stack([alone, alone], 1), np.stack([ordered[i[kept]], ordered[j[kept]]], 1)])


def _largest(points: Array, slopes: Array, pairs: NDArray[np.int64], tolerance: float) -> NDArray[np.int64]:
    """Those pairs, in their order, whose lines take most feet: as many as `_line` says."""
    (x0, y0), (x1, y1) = points[pairs[:, 0]].T, points[pairs[:, 1]].T
    apart = np.abs(x1 - x0) > 1
    slope = np.where(apart, (y1 - y0) / np.where(apart, x1 - x0, 1.0), 0.0)
    steep = np.abs(slope)
    count = np.zeros(len(pairs), np.int64)
    for start in range(0, len(pairs), 4096):
        some = slice(start, start + 4096)
        height = (y0 - slope * x0)[some, None]
        near = np.abs(points[:, 1] - (slope[some, None] * points[:, 0] + height)) <= tolerance
        near &= (steep[some, None] <= STEEP) | (np.abs(slopes - slope[some, None]) <= AGREE)
        count[some] = near.sum(axis=1)
    alone = (count < 2) | (steep > STEEPEST) | ((count < 3) & (steep > MOST_TILT) & (steep <= STEEP))
    count[alone] = 1
    return np.asarray(pairs[count == count.max()])


def _line(points: Array, slopes: Array, pair: NDArray[np.int64], tolerance: float) -> tuple[Line, list[int]]:
    """Through the lowest points of two feet, and the places of all that it takes."""
    first, second = pair.tolist()
    (x0, y0), (x1, y1) = points[first], points[second]
    slope = float((y1 - y0) / (x1 - x0)) if abs(x1 - x0) > 1 else 0.0
    line = Line(slope, float(y0 - slope * x0))
    near = np.abs(points[:, 1] - (line.slope * points[:, 0] + line.height)) <= tolerance
    if abs(slope) > STEEP:
        near &= np.abs(slopes - slope) <= AGREE
    group = np.flatnonzero(near)
    if len(group) < 2 or abs(slope) > STEEPEST or (len(group) < 3 and MOST_TILT < abs(slope) <= STEEP):
        own = float(slopes[first]) if abs(slopes[first]) > STEEP else 0.0
        return Line(own, float(y0 - own * x0)), [first]
    if len(group) > 2:
        fitted, height = np.polyfit(points[group, 0], points[group, 1], 1)
        line = Line(float(fitted), float(height))
    return line, group.tolist()


def _worth(line: Line, group: Sequence[int], points: Array) -> tuple[int, float, float]:
    """Many feet first, then a close fit, then the lower place."""
    x, y = points[list(group)].T
    rest = np.abs(y - (line.slope * x + line.height)).tolist()
    return len(group), -round(sum(rest) + 100 * abs(line.slope), 6), float(y.max())


def floor(line: Line, group: Sequence[Foot], ends: tuple[float, float]) -> list[tuple[float, float]]:
    """A chain of points from x = `ends[0]` to `ends[1]` on which every thing of a cluster stands, entering none.

    y is rounded down the photo to 0.01 px.
    """
    chain = sorted((float(x), float(y)) for f in group for x, y in (f.left, f.right))
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
    start = min(ends[0], first[0] - 0.01), 0.0
    end = max(ends[1], last[0] + 0.01), 0.0
    start = start[0], _clear(group, first, start[0], line.slope, -1)
    end = end[0], _clear(group, last, end[0], line.slope, 1)
    chain = [start, *chain, end]
    rounded = [(round(x, 2), float(np.ceil(y * 100 - 1e-6) / 100)) for x, y in chain]
    return _straightened([p for i, p in enumerate(rounded) if i == 0 or p[0] > rounded[i - 1][0]])


def _clear(group: Sequence[Foot], start: tuple[float, float], x: float, slope: float, side: int) -> float:
    """y at x of a line from `start` outwards, of at least the slope that keeps it under every hull on that side."""
    y = start[1] + slope * (x - start[0])
    for f in group:
        beyond = f.hull[(f.hull[:, 0] - start[0]) * side > 0.05]
        for px, py in beyond:
            if abs(px - start[0]) <= abs(x - start[0]):
                y = max(y, start[1] + float(py - start[1]) / float(px - start[0]) * (x - start[0]))
    return y


def _straightened(chain: list[tuple[float, float]]) -> list[tuple[float, float]]:
    """Without the points that lie on the line between their neighbours, to 0.005 px; two where all nearly do."""
    points = np.array(chain)
    (x0, y0), (x1, y1) = points[0], points[-1]
    off = points[:, 1] - (y0 + (y1 - y0) * (points[:, 0] - x0) / max(x1 - x0, 1e-9))
    if np.ptp(off) <= NEARLY:
        down = float(off.max())
        return [(x, float(np.ceil((y + down) * 100 - 1e-6) / 100)) for x, y in (chain[0], chain[-1])]
    kept = [chain[0]]
    for i in range(1, len(chain) - 1):
        (x0, y0), (x, y), (x1, y1) = kept[-1], chain[i], chain[i + 1]
        if abs(y0 + (y1 - y0) * (x - x0) / (x1 - x0) - y) > 0.005:
            kept.append(chain[i])
    return [*kept, chain[-1]]


def free_ends(
    line: Line, group: Sequence[Foot], others: Sequence[Thing], wish: tuple[float, float]
) -> tuple[float, float]:
    """The ends that a floor may have without running into things that do not stand on it."""
    start, end = wish
    inner = min(float(f.left[0]) for f in group), max(float(f.right[0]) for f in group)
    for other in others:
        x0, y0, x1, y1 = bounds(other.outline)
        heights = line.at(x0), line.at(x1)
        if y1 <= min(heights) or y0 >= max(heights):
            continue
        if x1 <= inner[0]:
            start = max(start, x1 + 0.5)
        elif x0 >= inner[1]:
            end = min(end, x0 - 0.5)
    return min(start, inner[0]), max(end, inner[1])
