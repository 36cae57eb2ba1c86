"""Contact of objects with the ground: feet, common floor lines, level feet and rectangles."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from math import radians, sin

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.geometry.convex import overlap_depth
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
from physgen.perceive.roles import Labels, PhotoObject
from physgen.perceive.support.equilibrium import contacts

# ----------------------------------------------------------------------
# Outlines that are rectangles but for the raggedness of their masks -> true rectangles, where contact allows
# it.

COVERED = 0.97
"""Intersection over union of outline and rectangle, from which one stands for the other."""
RAGGED = 1.5
"""px about a side within which the border is that side's."""
UPRIGHT = 0.5
"""degrees off upright within which a box is upright."""
ROUND = 3.0
"""px, and 12 % of the shorter side at most, by which a corner is rounded off or a side bulges."""
SUNK = 0.05
"""px that a box may overlap a neighbour."""


def fit_rectangles(things: Sequence[PhotoObject]) -> dict[int, Outline]:
    """Rectangles of four corners, by id, for what is one and touches no other thing.

    What touches others shares its borders with them: a box would leave gaps or overlap.
    """
    outlines = [thing.outline for thing in things]
    touching = {k for contact in contacts(outlines, []) for k in (contact.thing, contact.other)}
    result: dict[int, Outline] = {}
    boxes = np.array([bounds(outline) for outline in outlines]).reshape(-1, 4)
    for k, thing in enumerate(things):
        box = None if k in touching or thing.cut else fit_rectangle(thing.outline)
        if box is not None:
            x0, y0, x1, y1 = bounds(box)
            apart = (boxes[:, :2] > (x1, y1)).any(axis=1) | (boxes[:, 2:] < (x0, y0)).any(axis=1)
            near = [outlines[i] for i in np.flatnonzero(~apart).tolist() if i != k]
            if all(overlap_depth(box, other) <= SUNK for other in near):
                result[thing.id] = box
    return result


def fit_rectangle(outline: Outline) -> Region | None:
    """The rectangle that an outline is, of its area and with its lowest corner's height; None where it is none."""
    if isinstance(outline, Disc) or len(outline.rings) != 1 or outline.rings[0].holes:
        return None
    points = outline.rings[0].outer
    (_, size, degrees) = cv2.minAreaRect(points.astype(np.float32))
    off = (degrees + 45) % 90 - 45
    angle = 0.0 if abs(off) <= UPRIGHT else np.radians(off)
    turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    own = points @ turn.T
    low, high = _sides(own)
    if angle == 0.0:
        high[1] = bounds(outline)[3]
    width, height = high - low
    if min(width, height) <= 2 * RAGGED:
        return None
    away = np.minimum(np.abs(own - low), np.abs(own - high)).min(axis=1)
    corners = np.array([low, [high[0], low[1]], high, [low[0], high[1]]])
    sharp = np.hypot(*(corners[:, None] - _dense(own)[None]).transpose(2, 0, 1)).min(axis=1)
    if max(away.max(), sharp.max()) > min(ROUND, 0.12 * min(size)):
        return None
    inside = np.clip(own, low, high)
    shared, area = abs(polygon_moments(inside).area), abs(polygon_moments(own).area)
    if shared / (area + width * height - shared) < COVERED:
        return None
    return Region((Ring(corners @ turn),))


def _sides(own: Array) -> tuple[Array, Array]:
    """`(2,)` each: where the sides lie in the rectangle's own axes, by the mean of the border along each."""
    dense = _dense(own)
    low, high = dense.min(axis=0), dense.max(axis=0)
    for axis in (0, 1):
        first, last = low[axis], high[axis]
        other = dense[:, 1 - axis]
        within = (other > np.min(other) + 2 * RAGGED) & (other < np.max(other) - 2 * RAGGED)
        ends = dense[:, axis] < first + 2 * RAGGED, dense[:, axis] > last - 2 * RAGGED
        sides = [dense[within & end, axis] for end in ends]
        if all(map(len, sides)):
            low[axis], high[axis] = (float(side.mean()) for side in sides)
    return low, high


def _dense(points: Array) -> Array:
    """The border of a ring, a point every half px or so."""
    after = np.roll(points, -1, axis=0)
    parts = []
    for a, b in zip(points, after, strict=True):
        count = max(2, int(2 * np.hypot(*(b - a))))
        parts.append(a + (b - a) * np.linspace(0, 1, count)[:, None])
    return np.concatenate(parts)


# ----------------------------------------------------------------------
# Outlines -> what each thing rests on: other things, or a floor laid under it that touches its shape.
#
# Image axes, px: the lowest point has the largest y. A floor is a chain of points, so that every thing stands
# on it as it
# is in the photo: on the edge of its convex hull that its centre of mass is above, a ball on a level spot.

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
AGREE = 0.12
"""Between the slope of a line and that of what lies on it."""
MOST_TILT = 0.04
"""Slope of a floor that only two things tell."""


@dataclass(frozen=True, eq=False)
class Foot:
    """Where a thing stands."""

    thing: PhotoObject
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


def find_foot(thing: PhotoObject) -> Foot:
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


def is_carried(thing: PhotoObject, labels: Labels, things: Sequence[PhotoObject]) -> bool:
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


def group_feet(feet: Sequence[Foot], tolerance: float) -> list[tuple[Line, list[Foot]]]:
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


def floor_points(line: Line, group: Sequence[Foot], ends: tuple[float, float]) -> list[tuple[float, float]]:
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
    line: Line, group: Sequence[Foot], others: Sequence[PhotoObject], wish: tuple[float, float]
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


# ----------------------------------------------------------------------
# Things that stand upright on a common line -> their outlines with level feet on it, as they would stand.
#
# A mask's lowest border is ragged, and a thing on two stray pixels rocks. Its front edge, too, is nearer to a
# camera that
# looks down a little, and so lower in the photo than the section through its middle that moves: the foot is
# lifted by as
# much as the scene's default tilt says for a thing as deep as it is wide.

TILT = 2.0
"""degrees. Chosen on the studio's and the peers' photos: with the 4 of `world.tilt` one peer's floor is missed by
3.3 px, with none the studio's by up to 4."""
MOST_LIFT = 2.0
"""px."""
ASKEW = 2.5
"""px by which the foot of a narrow thing may rise and be level."""
NEARER = 4.0
"""px by which a flat foot may be lower than those of most and be lifted to their line."""
BAND = 2.0
"""px over a foot within which the border is the foot's."""
ALIKE = 1.5
"""px between feet up to which they stand on one straight line."""
EVEN = 0.05
"""px between feet at one height."""
LEVEL = 0.08
"""Slope of a foot up to which it is level, and its slope an error of the mask."""
SLOPED = 0.03
"""Slope of a line through three feet or more from which it is no level floor seen askew."""
WIDE = 0.35
"""Of a thing's width: what a foot has that it stands on flat."""


def foot_lift(outline: Outline) -> float:
    """px by which the section through its middle stands higher in the photo than its front edge; 0 for round things."""
    if isinstance(outline, Disc):
        return 0.0
    x0, y0, x1, y1 = bounds(outline)
    return min(MOST_LIFT, 0.5 * sin(radians(TILT)) * min(x1 - x0, y1 - y0))


def stands_flat(foot: Foot) -> bool:
    """Whether a thing stands on a level edge, not on a corner or a curve."""
    if isinstance(foot.thing.outline, Disc):
        return False
    x0, _, x1, _ = bounds(foot.thing.outline)
    low = foot.hull[foot.hull[:, 1] >= foot.hull[:, 1].max() - BAND]
    run = float(foot.right[0] - foot.left[0])
    level = abs(float(foot.right[1] - foot.left[1])) <= max(LEVEL * run, ASKEW)
    return level and float(np.ptp(low[:, 0])) >= WIDE * (x1 - x0)


def split_group(line: Line, group: Sequence[Foot]) -> list[tuple[Line, list[Foot]]]:
    """A group of three or more on a level line without what stands higher or lower than most, which stands alone.

    One floor for all of them would be a chain of humps: as the floor is flat, the masks are wrong, or those things
    stand nearer or farther.
    """
    if len(group) < 3 or abs(line.slope) >= SLOPED:
        return [(line, list(group))]
    level, tilted = (_alike(group, slope, ALIKE)[1] for slope in (0.0, line.slope))
    # one thing alone tells no slope
    stood, kept = _alike(group, line.slope if len(tilted) >= len(level) + 2 else 0.0, ASKEW, NEARER)
    if len(kept) < 2 or len(kept) == len(group):
        return [(line, list(group))]
    return [(stood, kept), *((Line(0.0, float(f.lowest[1])), [f]) for f in group if f not in kept)]


def _alike(
    group: Sequence[Foot], slope: float, within: float, lower: float | None = None
) -> tuple[Line, list[Foot]]:
    """The line of a slope through most of a group, and those that stand `within` px of it, or flat and `lower`."""
    off = np.array([_height(foot) - slope * float(foot.lowest[0]) for foot in group])
    line = Line(slope, float(np.median(off)))
    # a flat foot nearer to the camera is lower, and can be lifted; what is round stands where it is
    most = np.array([lower if lower is not None and stands_flat(foot) else within for foot in group])
    near = (off - line.height >= -within) & (off - line.height <= most)
    # what is not flat cannot be made to follow the line
    ends = np.array(
        [[foot.left[1] - line.at(foot.left[0]), foot.right[1] - line.at(foot.right[0])] for foot in group]
    )
    near &= np.array([stands_flat(foot) for foot in group]) | (np.abs(ends).max(axis=1) <= ALIKE)
    return line, [foot for foot, here in zip(group, near, strict=True) if here]


def _height(foot: Foot) -> float:
    """y at which a thing stands."""
    return float(foot.hull[:, 1].max()) - (foot_lift(foot.thing.outline) if stands_flat(foot) else 0.0)


def level_feet(line: Line, group: Sequence[Foot]) -> dict[int, Outline]:
    """Outlines with straight feet, by id, of those in a group that stand flat: on one line where they nearly do."""
    result: dict[int, Outline] = {}
    if abs(line.slope) > STEEP:
        for foot in group:
            outline = foot.thing.outline
            if isinstance(outline, Region) and abs(foot.slope - line.slope) <= AGREE:
                result[foot.thing.id] = straighten_foot(outline, line)
        return result
    feet = [foot for foot in group if stands_flat(foot)]
    if not feet or (len(group) > 2 and abs(line.slope) >= SLOPED):
        return {}
    heights = np.array([_height(foot) for foot in feet])
    slope = 0.0
    if len(group) > 2:
        rest = heights - line.slope * np.array([foot.lowest[0] for foot in feet])
        if np.ptp(heights) > 2 * ALIKE and np.ptp(rest) < np.ptp(heights):
            slope, heights = line.slope, rest
        low, high = np.array([heights.min(), heights.max()]) - np.median(heights)
        if low >= -ASKEW and high <= NEARER:
            heights = np.full(len(feet), np.median(heights))
    for k in range(len(feet)):
        near = np.abs(heights - heights[k]) <= ALIKE
        if near.sum() > 1 and np.ptp(heights) <= 2 * ALIKE:
            heights = np.where(near, np.median(heights[near]), heights)
    for foot, height in zip(feet, heights.tolist(), strict=True):
        assert isinstance(foot.thing.outline, Region)
        stood = Line(slope, round(height, 2))
        low = float(foot.hull[:, 1].max())
        up = max(
            BAND, abs(float(foot.right[1] - foot.left[1])) + 0.5, stood.at(float(foot.lowest[0])) - low + 0.5
        )
        result[foot.thing.id] = straighten_foot(foot.thing.outline, stood, up)
    return result


def levelled_line(line: Line, group: Sequence[Foot]) -> Line:
    """The line of a group, level where all of it stands at one height."""
    heights = [float(y) for foot in group for y in (foot.left[1], foot.right[1])]
    if max(heights) - min(heights) > EVEN:
        return line
    return Line(0.0, max(heights))


def straighten_foot(outline: Region, line: Line, band: float = BAND) -> Region:
    """Nothing of it below the line, its border within `band` px above it on it; as it was where that would cross."""
    normal = np.array([-line.slope, 1.0]) / np.hypot(line.slope, 1.0)
    start = np.array([0.0, line.height])
    rings = []
    for ring in outline.rings:
        off = (ring.outer - start) @ normal
        low = off >= -band
        points = ring.outer - np.where(low, off, 0.0)[:, None] * normal
        inner = low & np.roll(low, 1) & np.roll(low, -1)
        if np.ptp(off) > band and (~inner).sum() >= 3:
            rings.append(Ring(points[~inner], ring.holes))
    borders = [part for ring in rings for part in (ring.outer, *ring.holes)]
    if not rings or len(crossings([np.round(part, 2) for part in borders])):  # a thin neck is pressed flat
        return outline
    return Region(tuple(rings))


def cradle(thing: PhotoObject, center: Array, hull: Array, reach: float = 0.3) -> list[tuple[float, float]]:
    """A chain that follows the underside of a thing to both sides of its centre of mass: a nest that it lies in."""
    outline = thing.outline
    if isinstance(outline, Disc):
        x, y, r = float(outline.center[0]), float(outline.center[1]), outline.radius
        a = np.radians(25.0)
        inner, side, up = r * np.tan(a / 2), r * np.sin(a), r * np.cos(a)
        chain = [(x - side, y + up), (x - inner, y + r), (x + inner, y + r), (x + side, y + up)]
    else:
        x0, _, x1, _ = bounds(outline)
        ends = np.clip(
            [center[0] - reach * (x1 - x0), center[0] + reach * (x1 - x0)], hull[0, 0], hull[-1, 0]
        )
        # it lies on corners of its hull: without one on either side of its centre it would tip
        k = int(np.clip(np.searchsorted(hull[:, 0], center[0]), 1, len(hull) - 1))
        ends = np.clip(
            [min(ends[0], hull[k - 1, 0] - 0.5), max(ends[1], hull[k, 0] + 0.5)], hull[0, 0], hull[-1, 0]
        )
        inner = hull[(hull[:, 0] > ends[0]) & (hull[:, 0] < ends[1])]
        xs = [ends[0], *inner[:, 0], ends[1]]
        chain = [(float(px), float(np.interp(px, hull[:, 0], hull[:, 1]))) for px in xs]
    return [(round(float(px), 2), float(np.ceil(py * 100 - 1e-6) / 100)) for px, py in chain]
