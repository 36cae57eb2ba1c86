"""Contact of objects with the ground: feet, common floor lines, level feet and rectangles.

Image axes, px: the lowest point has the largest y. A floor is a chain of points, so that every object stands on it as
it is in the photo: on the edge of its convex hull that its centre of mass is above, a ball on a level spot.
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

STEEP = 0.15  # slope above which a line is no level floor
AGREE = 0.12  # between the slope of a line and that of what lies on it


@dataclass(frozen=True)
class _FootLimits:
    """Feet and the lines through them; slopes, px."""

    steepest: float = 0.75  # slope that friction may still hold: cardboard on wood slips at 0.5 to 0.8
    broad: float = (
        0.5  # share of its width that a steep edge under an object on a slope has
    )
    short: float = 8.0  # px: the slope of a shorter edge is the raggedness of its mask
    ragged: float = 1.5  # px by which a mask's straight edge bulges
    columns: int = 64  # at which a sloped edge is compared with the outline
    gap: float = 0.03  # of an object's height: it lies on the edge
    touching: float = 0.5  # share of the edge that it lies on, at least
    invisible: float = 0.06  # px by which points are off a line that replaces them
    two_tilt: float = 0.04  # slope of a floor through two objects only, at most


@dataclass(frozen=True)
class _LevelLimits:
    """Which feet are made level, and at what height; px.

    A mask's lowest border is ragged, and an object on two stray pixels rocks. Its front edge, too, is nearer to a
    camera that looks down a little, and so lower in the photo than the section through its middle that moves: the foot
    is lifted as the camera's usual tilt requires for an object as deep as it is wide.
    """

    # degrees: with 4 (`world.tilt`) a peer photo's floor is missed by 3.3 px, with 0 ours by 4
    tilt: float = 2.0
    max_lift: float = 2.0
    disc: float = 0.145  # share of its radius by which a round object may be off the line that others share
    askew: float = 2.5  # by which the foot of a narrow object may rise and be level
    nearer: float = 4.0  # by which a flat foot may be lower than those of most and be lifted to their line
    band: float = 2.0  # above a foot, in which the border is the foot's
    alike: float = 1.5  # between feet up to which they stand on one straight line
    level: float = 0.08  # slope of a foot up to which it is level, and its slope an error of the mask
    # slope of a line through three feet or more from which it is no level floor seen askew
    sloped: float = 0.03
    wide: float = 0.35  # share of its width that a flat foot has


@dataclass(frozen=True)
class _BoxLimits:
    """Which outlines are rectangles; px."""

    covered: float = 0.97  # intersection over union of outline and rectangle
    ragged: float = 1.5  # about a side, in which the border is that side's
    upright: float = 0.5  # degrees off upright
    # and 12 % of the shorter side at most, by which a corner is rounded or a side bulges
    rounded: float = 3.0
    overlap: float = 0.05  # with a neighbour


FOOT, LEVEL, BOX = _FootLimits(), _LevelLimits(), _BoxLimits()


@dataclass(frozen=True, eq=False)
class Foot:
    """Where an object stands."""

    item: PhotoObject
    left: Array  # (2,) px, on its hull
    right: Array  # (2,) px
    hull: Array  # (K, 2) px: its lower side, left to right, none of it under the line `left` to `right`

    @cached_property
    def slope(self) -> float:
        """Of the edge that it stands on."""
        return float(
            (self.right[1] - self.left[1]) / max(self.right[0] - self.left[0], 1e-9)
        )

    @cached_property
    def lowest(self) -> Array:
        """(2,) px: the middle of where it stands."""
        return np.asarray((self.left + self.right) / 2)


@dataclass(frozen=True)
class Line:
    """y = slope x + height, px."""

    slope: float
    height: float

    def at(self, x: float) -> float:
        """y at x."""
        return self.slope * x + self.height


def find_foot(item: PhotoObject) -> Foot:
    """Where an object would stand on a floor under it."""
    center = mass_properties(item.outline).center
    hull = lower_hull(item.outline)
    if isinstance(item.outline, Disc):
        x, y = float(center[0]), float(center[1]) + item.outline.radius
        aside = 0.3 * item.outline.radius
        return Foot(item, np.array([x - aside, y]), np.array([x + aside, y]), hull)
    k = int(np.clip(np.searchsorted(hull[:, 0], center[0]) - 1, 0, len(hull) - 2))
    left, right = hull[k], hull[k + 1]
    run = right[0] - left[0]
    if run >= 2 and abs(right[1] - left[1]) <= STEEP * run:
        return Foot(item, left, right, hull)
    first, last = _straight_part(hull, k)
    run, rise = hull[last] - hull[first]
    is_long = run >= max(FOOT.short, FOOT.broad * (hull[-1, 0] - hull[0, 0]))
    is_slope = is_long and abs(rise) <= FOOT.steepest * run
    if is_slope and _lies_along(item.outline, hull[first], hull[last]):
        return Foot(item, hull[first], hull[last], hull)
    x, y = hull[int(np.argmax(hull[:, 1]))]
    aside = 0.1 * (hull[-1, 0] - hull[0, 0])
    return Foot(item, np.array([x - aside, y]), np.array([x + aside, y]), hull)


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
    """First and last corner of the longest straight part of a hull `(K, 2)` that holds its k-th edge."""
    best = k, k + 1
    for i in range(k + 1):
        for j in range(k + 1, len(hull)):
            along = hull[j] - hull[i]
            off = np.abs(cross(along, hull[i : j + 1] - hull[i])) / max(
                float(np.hypot(*along)), 1e-9
            )
            longer = hull[j, 0] - hull[i, 0] > hull[best[1], 0] - hull[best[0], 0]
            if off.max() <= FOOT.ragged and longer:
                best = i, j
    return best


def lower_hull(outline: Outline) -> Array:
    """`(K, 2)` px: the lower side of its convex hull, left to right (Andrew's monotone chain)."""
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
    """Whether other objects under it hold it: some on either side of its centre of mass, close below."""
    rows, columns = np.nonzero(labels == item.id)
    if not len(rows):
        return False
    left, right = int(columns.min()), int(columns.max())
    bottom = np.full(right - left + 1, -1)
    np.maximum.at(bottom, columns - left, rows)
    here = np.flatnonzero(bottom >= 0)
    gap = int(max(3, 0.06 * (rows.max() - rows.min() + 1)))
    center = mass_properties(item.outline).center
    rows_below = np.minimum(
        bottom[here] + np.arange(1, gap + 1)[:, None], labels.shape[0] - 1
    )
    below = labels[rows_below, here + left]
    seen = set(np.unique(below).tolist()) - {0, item.id}
    lowest = bounds(item.outline)[3]
    holders = [t.id for t in objects if t.id in seen and bounds(t.outline)[3] > lowest]
    held = np.isin(below, holders).any(axis=0)
    if not held.any():
        return False
    x = here[held] + left
    slack = 0.1 * (right - left + 1)
    return bool(x.min() <= center[0] + slack and x.max() >= center[0] - slack)


def close_gaps_below(
    labels: Labels, objects: Sequence[PhotoObject]
) -> dict[int, Outline]:
    """Outlines, by id, of what ends just above its carrier and is no disc: it gets a foot there."""
    closed, feet = labels.copy(), set[int]()
    for item in objects:
        if (
            item.cut
            or isinstance(item.outline, Disc)
            or not is_carried(item, labels, objects)
        ):
            continue
        own = labels == item.id
        columns = np.flatnonzero(own.any(axis=0))
        ends = len(own) - own[::-1, columns].argmax(axis=0)
        low, height = int(ends.max()), np.count_nonzero(own.any(axis=1))
        foot = ends > low - height / 8
        below = labels[low : low + max(3, int(0.06 * height)) + 1, columns[foot]] > 0
        gap = int((below.mean(axis=1) >= 0.5).argmax())
        if gap >= FIT.touch:
            feet.add(item.id)
            for x, end in zip(columns[foot], ends[foot], strict=True):
                part = closed[end : low + gap, x]
                part[part == 0] = item.id
    if not feet:
        return {}
    return {
        i: outline
        for i, outline in fit_outlines(closed, [t.id for t in objects]).items()
        if i in feet
    }


def group_feet(feet: Sequence[Foot], tolerance: float) -> list[tuple[Line, list[Foot]]]:
    """Feet on common lines, largest group first; a foot that shares its line with none stands on a level one."""
    left = list(feet)
    groups: list[tuple[Line, list[Foot]]] = []
    while left:
        points, slopes = (
            np.array([f.lowest for f in left]),
            np.array([f.slope for f in left]),
        )
        lines = _largest_groups(points, slopes, tolerance)
        line, group = max(lines, key=lambda found: _quality(found[0], found[1], points))
        groups.append((line, [left[i] for i in group]))
        taken = set(group)
        left = [f for i, f in enumerate(left) if i not in taken]
    return groups


def _largest_groups(
    points: Array, slopes: Array, tolerance: float
) -> list[tuple[Line, list[int]]]:
    """Lines through pairs of the points `(N, 2)` with the most feet on them, and those; else each foot's own line."""
    order = np.argsort(points[:, 0], kind="stable")
    # of very many, neighbours and those across the photo are enough to find a line
    reach = 400 // len(order) + 1
    i, j = np.triu_indices(len(order), 1)
    kept = (j - i <= reach) | (i < reach)
    first, run = points[order[i[kept]]], points[order[j[kept]]] - points[order[i[kept]]]
    slope = np.where(run[:, 0] > 1, run[:, 1] / np.maximum(run[:, 0], 1.0), 0.0)
    height, steep = first[:, 1] - slope * first[:, 0], np.abs(slope)
    on = np.zeros((len(slope), len(points)), bool)
    for some in np.array_split(np.arange(len(slope)), len(slope) // 4096 + 1):
        off = points[:, 1] - (slope[some, None] * points[:, 0] + height[some, None])
        alike = (steep[some, None] <= STEEP) | (
            np.abs(slopes - slope[some, None]) <= AGREE
        )
        on[some] = (np.abs(off) <= tolerance) & alike
    count = on.sum(axis=1)
    two_askew = (count < 3) & (steep > FOOT.two_tilt) & (steep <= STEEP)
    count[(steep > FOOT.steepest) | two_askew] = 0
    if count.max(initial=0) < 2:
        own = np.where(np.abs(slopes) > STEEP, slopes, 0.0).tolist()
        return [
            (Line(s, float(y - s * x)), [k])
            for k, (s, (x, y)) in enumerate(zip(own, points, strict=True))
        ]
    found = []
    for k in np.flatnonzero(count == count.max()).tolist():
        group = np.flatnonzero(on[k])
        x, y = points[group].T
        fit = np.polyfit(x, y, 1) if len(group) > 2 else (slope[k], height[k])
        found.append((Line(float(fit[0]), float(fit[1])), group.tolist()))
    return found


def _quality(
    line: Line, group: Sequence[int], points: Array
) -> tuple[int, float, float]:
    """Many feet first, then a close fit, then the lower place."""
    x, y = points[list(group)].T
    rest = np.abs(y - (line.slope * x + line.height)).tolist()
    return len(group), -round(sum(rest) + 100 * abs(line.slope), 6), float(y.max())


def rounded_down(x: float, y: float) -> tuple[float, float]:
    """To 0.01 px, y down the photo, so that a wall does not enter what stands on it."""
    return round(x, 2), float(np.ceil(y * 100 - 1e-6) / 100)


def floor_points(
    line: Line, group: Sequence[Foot], ends: tuple[float, float]
) -> list[tuple[float, float]]:
    """A chain of points from x = `ends[0]` to `ends[1]` on which every object of a group stands, entering none."""
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
    start, end = min(ends[0], first[0] - 0.01), max(ends[1], last[0] + 0.01)
    chain = [
        (start, _clear_of_hulls(group, first, start, line.slope, -1)),
        *chain,
        (end, _clear_of_hulls(group, last, end, line.slope, 1)),
    ]
    rounded = [rounded_down(x, y) for x, y in chain]
    return _without_straight_points(
        [p for i, p in enumerate(rounded) if i == 0 or p[0] > rounded[i - 1][0]]
    )


def _clear_of_hulls(
    group: Sequence[Foot], start: tuple[float, float], x: float, slope: float, side: int
) -> float:
    """y at x of a line from `start` outwards, of at least the slope that keeps it under every hull on that side."""
    y = start[1] + slope * (x - start[0])
    for f in group:
        beyond = f.hull[(f.hull[:, 0] - start[0]) * side > 0.05]
        for px, py in beyond:
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
    """Without the points on the line between their neighbours, to 0.005 px; two where all nearly lie on one line."""
    points = np.array(chain)
    (x0, y0), (x1, y1) = points[0], points[-1]
    off = points[:, 1] - (y0 + (y1 - y0) * (points[:, 0] - x0) / max(x1 - x0, 1e-9))
    if np.ptp(off) <= FOOT.invisible:
        down = float(off.max())
        return [
            (x, float(np.ceil((y + down) * 100 - 1e-6) / 100))
            for x, y in (chain[0], chain[-1])
        ]
    kept = [chain[0]]
    for i in range(1, len(chain) - 1):
        (x0, y0), (x, y), (x1, y1) = kept[-1], chain[i], chain[i + 1]
        if abs(y0 + (y1 - y0) * (x - x0) / (x1 - x0) - y) > 0.005:
            kept.append(chain[i])
    return [*kept, chain[-1]]


# level feet


def stands_flat(foot: Foot) -> bool:
    """Whether an object stands on a level edge, not on a corner or a curve."""
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
    """y at which an object stands: a flat foot as its section through its middle, higher than its front edge."""
    x0, y0, x1, y1 = bounds(foot.item.outline)
    lift = min(LEVEL.max_lift, 0.5 * sin(radians(LEVEL.tilt)) * min(x1 - x0, y1 - y0))
    return float(foot.hull[:, 1].max()) - lift * (
        stands_flat(foot) and not foot.item.top
    )


def free_discs(objects: Sequence[PhotoObject]) -> frozenset[int]:
    """Ids of round objects that touch no other object: their masks, not they, are off the line that others share."""
    discs = {item.id for item in objects if isinstance(item.outline, Disc)}
    return frozenset(discs - touching_objects(objects))


def split_group(
    line: Line, group: Sequence[Foot], free: Collection[int]
) -> list[tuple[Line, list[Foot]]]:
    """The feet of a group that stand on one line, level unless most show its slope; each other foot by itself.

    One floor for all of them would be a chain of humps: as the floor is flat, the masks are wrong, or those objects
    stand nearer or farther. Objects `free` follow the line, as those with flat feet do.
    """
    if abs(line.slope) > STEEP or _askew(line, group):
        return [(line, list(group))]
    level, tilted = (
        _near_line(group, slope, free, LEVEL.alike)[1] for slope in (0.0, line.slope)
    )
    # one object alone shows no slope
    slope = line.slope if len(tilted) >= len(level) + 2 else 0.0
    stood, kept = _near_line(group, slope, free, LEVEL.askew, LEVEL.nearer)
    alone = [f for f in group if len(kept) < 2 or f not in kept]
    return [(stood, kept)] * (len(kept) > 1) + [
        (Line(0.0, round(_height(f), 2)), [f]) for f in alone
    ]


def _askew(line: Line, group: Sequence[Foot]) -> bool:
    """Whether it is a sloped floor's."""
    return len(group) > 2 and abs(line.slope) >= LEVEL.sloped


def _near_line(
    group: Sequence[Foot],
    slope: float,
    free: Collection[int],
    within: float,
    lower: float | None = None,
) -> tuple[Line, list[Foot]]:
    """The line of a slope through most of a group, and those within `within` px of it, or that follow it and down to
    `lower`."""
    off = np.array([_height(foot) - slope * float(foot.lowest[0]) for foot in group])
    line = Line(slope, round(float(np.median(off)), 2))
    follows = np.array([foot.item.id in free or stands_flat(foot) for foot in group])
    # a flat foot nearer to the camera is lower, and can be lifted
    radii = [
        f.item.outline.radius if isinstance(f.item.outline, Disc) else np.inf
        for f in group
    ]
    reach = np.minimum(
        LEVEL.disc * np.array(radii), 3.6
    )  # else its pixels leave its circle
    most = np.where(follows, within if lower is None else lower, within)
    near = (off - line.height >= -np.minimum(within, reach)) & (
        off - line.height <= np.minimum(most, reach)
    )
    ends = np.array(
        [
            [f.left[1] - line.at(f.left[0]), f.right[1] - line.at(f.right[0])]
            for f in group
        ]
    )
    near &= follows | (np.abs(ends).max(axis=1) <= LEVEL.alike)
    return line, [foot for foot, here in zip(group, near, strict=True) if here]


def level_feet(
    line: Line, group: Sequence[Foot], free: Collection[int]
) -> dict[int, Outline]:
    """Outlines with feet straight on the line of a group, by id, of those that stand flat, or as steep as it; `free`
    ones are resized down to it."""
    result: dict[int, Outline] = {}
    for foot in group:
        outline, steep = foot.item.outline, abs(line.slope) > STEEP
        follows = abs(foot.slope - line.slope) <= AGREE if steep else stands_flat(foot)
        if (
            isinstance(outline, Disc)
            and foot.item.id in free
            and line.slope == 0
            and len(group) > 1
        ):
            x, y = outline.center
            r = (line.height - float(y) + outline.radius) / 2  # its top stays
            result[foot.item.id] = Disc(np.array([x, line.height - r]), r)
        if (
            isinstance(outline, Disc)
            or not follows
            or (_askew(line, group) and not steep)
        ):
            continue
        rise = abs(float(foot.right[1] - foot.left[1]))
        lift = line.at(float(foot.lowest[0])) - float(foot.hull[:, 1].max())
        up = LEVEL.band if steep else max(LEVEL.band, rise + 0.5, lift + 0.5)
        result[foot.item.id] = straighten_foot(outline, line, up)
    return result


def straighten_foot(outline: Region, line: Line, band: float = LEVEL.band) -> Region:
    """The outline with none of it below the line, and its border within `band` px above it on it.

    Unchanged where its border would cross itself.
    """
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
    if not rings or len(
        crossings([np.round(part, 2) for part in borders])
    ):  # a thin neck is pressed flat
        return outline
    return Region(tuple(rings))


def cradle(item: PhotoObject, center: Array, hull: Array) -> list[tuple[float, float]]:
    """A chain that follows the underside of an object to both sides of its centre of mass: a nest that it lies in."""
    outline = item.outline
    if isinstance(outline, Disc):
        x, y, r = float(outline.center[0]), float(outline.center[1]), outline.radius
        a = np.radians(25.0)
        inner, side, up = r * np.tan(a / 2), r * np.sin(a), r * np.cos(a)
        chain = [
            (x - side, y + up),
            (x - inner, y + r),
            (x + inner, y + r),
            (x + side, y + up),
        ]
    else:
        x0, _, x1, _ = bounds(outline)
        reach = 0.3 * (x1 - x0)
        ends = np.clip([center[0] - reach, center[0] + reach], hull[0, 0], hull[-1, 0])
        # it lies on corners of its hull: without one on either side of its centre it would tip
        k = int(np.clip(np.searchsorted(hull[:, 0], center[0]), 1, len(hull) - 1))
        wide = [min(ends[0], hull[k - 1, 0] - 0.5), max(ends[1], hull[k, 0] + 0.5)]
        ends = np.clip(wide, hull[0, 0], hull[-1, 0])
        inner = hull[(hull[:, 0] > ends[0]) & (hull[:, 0] < ends[1])]
        xs = [ends[0], *inner[:, 0], ends[1]]
        chain = [(float(px), float(np.interp(px, hull[:, 0], hull[:, 1]))) for px in xs]
    return [rounded_down(float(px), py) for px, py in chain]


# flat bases


@dataclass(frozen=True)
class _BaseLimits:
    """Flat bases under objects whose lower outline recedes from the camera.

    A camera that looks down sees the rear of a base higher in the picture than its
    front: the lowest corner of the outline is the nearest one, and the object would tip
    over it. Widths and heights are shares of the object's.
    """

    narrow: float = 0.15
    """On both sides of the centre of mass: a foot that reaches so far stays as it is."""
    wide: float = 0.3
    """On both sides of the centre of mass: the least width of a base that is added."""
    high: float = 0.45
    """Height of the lower outline above the ground: higher ones stand on something."""
    round: float = 0.85
    """Share of its smallest circle from which fruit may roll, and gets no base."""
    whole: float = 0.95
    """Share of its area in its largest piece: smaller pieces are stray pixels."""


BASE = _BaseLimits()


def needs_base(foot: Foot) -> bool:
    """Return whether an object that stands on level ground would tip over its foot."""
    outline = foot.item.outline
    if isinstance(outline, Disc) or foot.item.cut:
        return False
    if kind(foot.item.label).form == "ball" and _is_nearly_round(outline):
        return False
    x0, _, x1, _ = bounds(outline)
    middle = float(mass_properties(outline).center[0])
    reach = BASE.narrow * (x1 - x0)
    is_narrow = foot.left[0] > middle - reach or foot.right[0] < middle + reach
    return bool(is_narrow)


def _is_nearly_round(outline: Region) -> bool:
    points = np.concatenate([ring.outer for ring in outline.rings]).astype(np.float32)
    _, radius = cv2.minEnclosingCircle(points)
    area = mass_properties(outline).area
    return bool(area > BASE.round * np.pi * radius**2)


def add_base(foot: Foot, line: Line) -> Region | None:
    """Return the outline with a flat base on a line, under its centre of mass.

    None if the lower outline is too high above the line, or consists of several pieces.
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
    xs = np.array([left, *inner[:, 0], right])
    ys = np.interp(xs, foot.hull[:, 0], foot.hull[:, 1])
    ground = line.slope * xs + line.height
    if float((ground - ys).max()) > BASE.high * (y1 - y0):
        return None
    upper = np.stack([xs, ys - 1.0], axis=1)  # 1 px into the outline, so that they join
    lower = np.array([[right, line.at(right)], [left, line.at(left)]])
    base = shapely.Polygon(np.concatenate([upper, lower])).buffer(0)
    joined = shapely.union(outline_shape(outline), base)
    if not isinstance(joined, shapely.Polygon):
        return None
    # gaps between the outline and its base are part of the base
    outer = np.asarray(joined.exterior.coords[:-1], np.float64)
    if not joined.exterior.is_ccw:
        outer = outer[::-1]
    return Region((Ring(outer, outline.rings[0].holes),))


def _largest_piece(outline: Region) -> Region:
    """Return an outline without stray pieces beside its largest one."""
    areas = [abs(polygon_moments(ring.outer).area) for ring in outline.rings]
    largest = max(areas)
    if len(areas) == 1 or largest < BASE.whole * sum(areas):
        return outline
    return Region((outline.rings[areas.index(largest)],))


# rectangles


def fit_rectangles(objects: Sequence[PhotoObject]) -> dict[int, Outline]:
    """Rectangles of four corners, by id, for objects that are rectangular and touch no other object.

    Objects that touch share their borders: a rectangle would leave gaps or overlap.
    """
    outlines = [item.outline for item in objects]
    touching = touching_objects(objects)
    result: dict[int, Outline] = {}
    boxes = np.array([bounds(outline) for outline in outlines]).reshape(-1, 4)
    for k, item in enumerate(objects):
        box = None if item.id in touching or item.cut else fit_rectangle(item.outline)
        if box is not None:
            x0, y0, x1, y1 = bounds(box)
            apart = (boxes[:, :2] > (x1, y1)).any(axis=1) | (
                boxes[:, 2:] < (x0, y0)
            ).any(axis=1)
            near = [outlines[i] for i in np.flatnonzero(~apart).tolist() if i != k]
            if all(overlap_depth(box, other) <= BOX.overlap for other in near):
                result[item.id] = box
    return result


def touching_objects(objects: Sequence[PhotoObject]) -> set[int]:
    """Ids of objects that touch others."""
    found = contacts([item.outline for item in objects], [])
    return {objects[k].id for contact in found for k in (contact.body, contact.other)}


def fit_rectangle(outline: Outline) -> Region | None:
    """The rectangle of the outline's area, with the height of its lowest corner; None where it is no rectangle."""
    if isinstance(outline, Disc) or len(outline.rings) != 1 or outline.rings[0].holes:
        return None
    points = outline.rings[0].outer
    (_, size, degrees) = cv2.minAreaRect(points.astype(np.float32))
    off = (degrees + 45) % 90 - 45
    angle = 0.0 if abs(off) <= BOX.upright else np.radians(off)
    turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    own = points @ turn.T
    low, high = _sides(own)
    if angle == 0.0:
        high[1] = bounds(outline)[3]
    width, height = high - low
    if min(width, height) <= 2 * BOX.ragged:
        return None
    away = np.minimum(np.abs(own - low), np.abs(own - high)).min(axis=1)
    corners = np.array([low, [high[0], low[1]], high, [low[0], high[1]]])
    sharp = np.hypot(*(corners[:, None] - _dense(own)[None]).transpose(2, 0, 1)).min(
        axis=1
    )
    if max(away.max(), sharp.max()) > min(BOX.rounded, 0.12 * min(size)):
        return None
    inside = np.clip(own, low, high)
    shared, area = abs(polygon_moments(inside).area), abs(polygon_moments(own).area)
    if shared / (area + width * height - shared) < BOX.covered:
        return None
    return Region((Ring(corners @ turn),))


def _sides(own: Array) -> tuple[Array, Array]:
    """`(2,)` each: the sides in the rectangle's own axes, at the median of the border along each."""
    dense, margin = _dense(own), 2 * BOX.ragged
    low, high = (
        np.where(near, dense, np.nan)
        for near in (dense < dense.min(0) + margin, dense > dense.max(0) - margin)
    )
    return np.nanmedian(low, axis=0), np.nanmedian(high, axis=0)


def _dense(points: Array) -> Array:
    """The border of a ring, a point every half px or so."""
    parts = []
    for a, b in zip(points, np.roll(points, -1, axis=0), strict=True):
        count = max(2, int(2 * np.hypot(*(b - a))))
        parts.append(a + (b - a) * np.linspace(0, 1, count)[:, None])
    return np.concatenate(parts)
