"""Straight edges of the section in the plane of motion, and floors extended along them.

Image axes, px. An edge has the solid on its right as one goes along it from `start` to `end` (y points down), so that a
floor's goes from left to right. The height of a floor is the objects': they stand exactly on it. Depth only decides
where a floor begins and ends.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import atan2, degrees, hypot

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.geometry.polygon import Array, bounds
from physgen.perceive.roles import F32, PhotoObject, Wall
from physgen.perceive.support.ground_contact import rounded_down
from physgen.perceive.support.motion_plane import Section
from physgen.perceive.support.supports import free_parts


@dataclass(frozen=True)
class _EdgeLimits:
    """Which borders are straight edges; px, or shares of the photo's longer side ("of the photo")."""

    shortest: float = 0.04  # of the photo: a shorter edge is a detail
    bent: float = 0.005  # of the photo, by which a contour may leave its chord and be straight
    rough: float = 1.5  # RMS by which a contour may leave the line fitted to it
    seen: float = 0.4  # share of an edge that must not be hidden by objects
    flat: float = 0.85  # length of the mean of unit normals of one plane: all within about 30 degrees
    strip: tuple[int, ...] = (2, 4, 6)  # from an edge, where normals and depth are read on its solid side
    across: float = 0.5  # part of a normal away from the solid, from which the surface runs back into it
    deepest: int = 24  # that it is followed
    turn: float = 5.0  # degrees between pieces of one edge
    level: float = 1.5  # degrees up to which an edge is level or upright
    step: float = 2.0  # between pieces of one edge, and the rise of a level one
    corner: float = 0.02  # of the photo: nearer ends of edges meet


@dataclass(frozen=True)
class _FloorLimits:
    """How a floor is extended; px, or shares of the photo's longer side ("of the photo")."""

    same: float = 0.02  # of the photo, by which an edge may be off its floor
    turn: float = 8.0  # degrees by which it may be turned
    under: tuple[int, ...] = (5, 8)  # below a floor, where solid matter is looked for
    nothing: float = 0.03  # of the photo: a floor ends where as much of nothing is seen under it
    backed: float = 0.5  # share of a floor at objects that must be solid for its ends to be looked for
    foot: float = 3.0  # in which an object stands on a floor


EDGE, FLOOR = _EdgeLimits(), _FloorLimits()


@dataclass(frozen=True, eq=False)
class Edge:
    """One straight edge."""

    start: Array
    """(2,) px."""
    end: Array
    """(2,) px."""
    seen: float
    """0..1: the share of it that is."""
    plane: float
    """0..1: how alike the normals on its solid side are."""
    facing: Array
    """(3,) unit: their mean."""

    @property
    def length(self) -> float:
        """px."""
        return float(hypot(*(self.end - self.start)))

    @property
    def along(self) -> Array:
        """(2,) unit."""
        return np.asarray((self.end - self.start) / max(self.length, 1e-9))

    @property
    def out(self) -> Array:
        """(2,) unit: away from the solid."""
        return np.array([self.along[1], -self.along[0]])

    @property
    def angle(self) -> float:
        """degrees, -180..180: 0 a floor, 90 the left side of a solid."""
        return degrees(atan2(self.along[1], self.along[0]))


def section_edges(section: Section, normals: F32) -> list[Edge]:
    """Straight parts of the border of the solid that are seen and with a plane on their solid side."""
    size = max(section.solid.shape)
    contours, _ = cv2.findContours(section.solid.astype(np.uint8), cv2.RETR_LIST, cv2.CHAIN_APPROX_NONE)
    found = []
    for contour in contours:
        if len(contour) >= EDGE.shortest * size:
            found += _straight_edges(contour[:, 0, :].astype(np.float64), section, normals, size)
    found = _squared(_merged(found, section))
    return _cornered([edge for edge in found if edge.length >= EDGE.shortest * size], EDGE.corner * size)


def _straight_edges(points: Array, section: Section, normals: F32, size: int) -> list[Edge]:
    """Edges of one contour `(N, 2)`."""
    height, width = section.solid.shape
    corners = cv2.approxPolyDP(points.astype(np.int32), EDGE.bent * size, True)[:, 0, :]
    order = np.flatnonzero((points[:, None] == corners[None]).all(-1).any(1))
    columns, rows = points.T.astype(int)
    border = (columns < 2) | (rows < 2) | (columns > width - 3) | (rows > height - 3)
    seen = section.known[rows, columns] & ~border
    result = []
    for first, last in zip(order, np.roll(order, -1), strict=True):
        run = np.arange(first, last + 1 if last > first else last + 1 + len(points)) % len(points)
        chord = points[last] - points[first]
        if hypot(*chord) < 0.5 * EDGE.shortest * size:
            continue
        trim = min(len(run) // 5, 6)
        inner = run[trim : len(run) - trim]
        used = inner[seen[inner]]
        if len(used) < max(6, EDGE.seen * len(inner)):
            continue
        middle = points[used].mean(0)
        along = np.linalg.svd(points[used] - middle, full_matrices=False)[2][0]
        along = np.asarray(along if along @ chord >= 0 else -along)
        off = (points[used] - middle) @ np.array([-along[1], along[0]])
        if np.sqrt((off**2).mean()) > EDGE.rough:
            continue
        ends = [middle + along * ((points[k] - middle) @ along) for k in (first, last)]
        edge = Edge(ends[0], ends[1], len(used) / len(inner), 0.0, np.zeros(3))
        if (judged := _plane(_oriented(edge, section), section, normals)) is not None:
            result.append(judged)
    return result


def _oriented(edge: Edge, section: Section) -> Edge:
    """The solid to its right, and half a pixel out: a contour runs through the middles of the outermost pixels."""
    right, left = (section.solid[_sampled(edge, section.solid.shape, k * 3.0)].mean() for k in (-1, 1))
    if left > right:
        edge = replace(edge, start=edge.end, end=edge.start)
    return replace(edge, start=edge.start + 0.5 * edge.out, end=edge.end + 0.5 * edge.out)


def _sampled(edge: Edge, shape: tuple[int, ...], out: float) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Rows and columns along an edge, `out` px away from the solid."""
    count = max(int(edge.length), 2)
    points = edge.start + np.linspace(0.1, 0.9, count)[:, None] * (edge.end - edge.start) + out * edge.out
    columns, rows = np.rint(points).astype(np.int64).T
    return np.clip(rows, 0, shape[0] - 1), np.clip(columns, 0, shape[1] - 1)


def _plane(edge: Edge, section: Section, normals: F32) -> Edge | None:
    """The edge where its solid side is a plane, and not nearer than all objects."""
    lengths, facings = [], []
    for way in EDGE.strip:
        at = _sampled(edge, section.solid.shape, -way)
        use = section.known[at] & section.solid[at]
        if use.sum() < 5 or np.median(section.depth[at][use]) < section.nearest:
            continue
        mean = normals[at][use].mean(0)
        lengths.append(float(np.linalg.norm(mean)))
        facings.append(mean / max(lengths[-1], 1e-9))
    if not lengths or max(lengths) < EDGE.flat:
        return None
    best = int(np.argmax(lengths))
    return _into_plane(replace(edge, plane=lengths[best], facing=facings[best].astype(np.float64)), section)


def _into_plane(edge: Edge, section: Section) -> Edge:
    """The edge of a surface that passes through the plane, where it does so: solid matter begins a little behind."""
    if edge.facing[:2] @ edge.out < EDGE.across:
        return edge
    ways = np.arange(0, EDGE.deepest)
    profile = np.full(len(ways), np.inf)
    for k, way in enumerate(ways.tolist()):
        at = _sampled(edge, section.solid.shape, -way)
        if (use := section.known[at]).sum() >= 5:
            profile[k] = np.median(section.depth[at][use])
    before = np.flatnonzero(profile <= section.plane)
    if not len(before) or before[0] == 0 or not np.isfinite(profile[before[0] - 1]):
        return edge
    k = int(before[0])
    share = (profile[k - 1] - section.plane) / max(profile[k - 1] - profile[k], 1e-9)
    inwards = -(k - 1 + float(share)) * edge.out
    return _lengthened(replace(edge, start=edge.start + inwards, end=edge.end + inwards), section)


def _lengthened(edge: Edge, section: Section) -> Edge:
    """As far as it goes on in the plane: nearer than where it was found, more of it is seen."""
    height, width = section.solid.shape
    ends = []
    for point, way in ((edge.start, -edge.along), (edge.end, edge.along)):
        steps = point - 1.5 * edge.out + np.arange(1, EDGE.deepest)[:, None] * way
        columns, rows = np.rint(steps).astype(int).T
        inside = (columns >= 0) & (rows >= 0) & (columns < width) & (rows < height)
        columns, rows = np.clip(columns, 0, width - 1), np.clip(rows, 0, height - 1)
        on = inside & section.solid[rows, columns] & section.known[rows, columns]
        ends.append(point + way * (len(on) if on.all() else int(np.argmin(on))))
    return replace(edge, start=ends[0], end=ends[1])


def _merged(found: list[Edge], section: Section) -> list[Edge]:
    """Pieces of one line joined, where only objects are between them."""
    left = sorted(found, key=lambda e: -e.length)
    result: list[Edge] = []
    while left:
        edge, left = left[0], left[1:]
        k = 0
        while k < len(left):
            if (joined := _joined(edge, left[k], section)) is not None:
                edge = joined
                del left[k]
                k = 0
            else:
                k += 1
        result.append(edge)
    return result


def _joined(a: Edge, b: Edge, section: Section) -> Edge | None:
    turn = abs((a.angle - b.angle + 180) % 360 - 180)
    if turn > EDGE.turn or max(abs((p - a.start) @ a.out) for p in (b.start, b.end)) > 2 * EDGE.step:
        return None
    ahead, behind = float((b.start - a.end) @ a.along), float((a.start - b.end) @ a.along)
    gap = max(ahead, behind)
    if gap > 0:
        ends = (a.end, b.start) if ahead > 0 else (b.end, a.start)
        between = replace(a, start=ends[0], end=ends[1])
        at = _sampled(between, section.solid.shape, 0.0)
        if gap > EDGE.shortest * max(section.solid.shape) and section.known[at].mean() > 0.5:
            return None
    whole = a.length + b.length
    ways = [float((p - a.start) @ a.along) for p in (a.start, a.end, b.start, b.end)]
    offset = ((b.start + b.end) / 2 - a.start) @ a.out * b.length / whole
    start, end = (a.start + offset * a.out + way * a.along for way in (min(ways), max(ways)))
    seen = (a.seen * a.length + b.seen * b.length) / whole
    return replace(a, start=start, end=end, seen=seen, plane=min(a.plane, b.plane))


def _squared(found: list[Edge]) -> list[Edge]:
    """Level and upright where they nearly are."""
    result = []
    for edge in found:
        for axis in (0, 1):  # 0 upright, 1 level
            rise = abs(float(edge.end[axis] - edge.start[axis]))
            slope = degrees(atan2(rise, abs(float(edge.end[1 - axis] - edge.start[1 - axis]))))
            if slope <= EDGE.level or (rise <= EDGE.step and slope <= 3 * EDGE.level):
                start, end = edge.start.copy(), edge.end.copy()
                start[axis] = end[axis] = 0.5 * (edge.start[axis] + edge.end[axis])
                edge = replace(edge, start=start, end=end)
        result.append(edge)
    return result


def _cornered(found: list[Edge], reach: float) -> list[Edge]:
    """Edges that nearly meet are extended to where they cross."""
    result = list(found)
    for i, a in enumerate(result):
        for j, b in enumerate(result):
            if i == j or hypot(*(a.end - b.start)) > reach or abs(a.along @ b.out) < 0.3:
                continue
            a, b = result[i], result[j]
            way = float((b.start - a.end) @ b.out) / float(a.along @ b.out)
            corner = a.end + way * a.along
            if max(hypot(*(corner - a.end)), hypot(*(corner - b.start))) <= 1.5 * reach:
                result[i], result[j] = replace(a, end=corner), replace(b, start=corner)
    return result


def extend_floors(
    floors: Sequence[Wall], found: Sequence[Edge], section: Section, objects: Sequence[PhotoObject]
) -> tuple[list[Wall], list[Edge]]:
    """Floors from end to end, and the edges that belong to none of them."""
    near = FLOOR.same * max(section.solid.shape)
    left = list(found)
    result = []
    for wall in floors:
        own = [edge for edge in left if _is_floor_edge(edge, wall, near)]
        left = [edge for edge in left if all(edge is not one for one in own)]
        result.append(_extended(wall, own, section, objects))
    return result, left


def _is_floor_edge(edge: Edge, wall: Wall, near: float) -> bool:
    """Whether an edge is a piece of a floor, or continues it."""
    if edge.out[1] > -0.5:
        return False
    points = np.array(wall.points)
    way = points[-1] - points[0]
    if abs(edge.angle - degrees(atan2(way[1], way[0]))) > FLOOR.turn:
        return False
    x0, x1 = edge.start[0], edge.end[0]
    lower, upper = max(x0, points[0, 0]), min(x1, points[-1, 0])
    if upper - lower < 0.5 * min(x1 - x0, points[-1, 0] - points[0, 0]) and upper - lower < -near:
        return False
    xs = np.linspace(lower, upper, 9)
    at = np.interp(xs, (x0, x1), (edge.start[1], edge.end[1]))
    return float(np.abs(at - np.interp(xs, points[:, 0], points[:, 1])).mean()) <= near


def _extended(wall: Wall, own: Sequence[Edge], section: Section, objects: Sequence[PhotoObject]) -> Wall:
    points = np.array(wall.points)
    inner = _standing_range(points, objects)
    if inner is None:
        return wall
    first, last = float(points[0, 0]), float(points[-1, 0])
    start, end = first, last
    for edge in own:
        start, end = min(start, float(edge.start[0])), max(end, float(edge.end[0]))
    start, end = _solid_range(points, (start, end), inner, section)
    near = 2 * FLOOR.nothing * max(section.solid.shape)
    for edge in own:  # an edge that was found is there, and its ends are finer than samples under it
        left, right = float(edge.start[0]), float(edge.end[0])
        start = left if left < start or (left <= inner[0] and left - start < near) else start
        end = right if right > end or (right >= inner[1] and end - right < near) else end
    if abs(start - first) < 1 and abs(end - last) < 1:
        return wall
    kept = points[(points[:, 0] > start) & (points[:, 0] < end)]
    chain = [_point_at(points, start), *((float(x), float(y)) for x, y in kept), _point_at(points, end)]
    parts = free_parts(chain, [t.outline for t in objects])
    middle = 0.5 * (inner[0] + inner[1])
    part = min(parts, key=lambda p: max(p[0][0] - middle, middle - p[-1][0], 0.0), default=None)
    if part is None or part[0][0] > inner[0] + 1 or part[-1][0] < inner[1] - 1:
        return wall
    reason = wall.reason + "; its ends are from depth"
    return replace(wall, points=tuple(part), source="depth and lowest points", reason=reason)


def _point_at(points: Array, x: float) -> tuple[float, float]:
    """The point of a chain at x; beyond its ends it continues straight."""
    if points[0, 0] <= x <= points[-1, 0]:
        return rounded_down(x, float(np.interp(x, points[:, 0], points[:, 1])))
    a, b = (points[0], points[1]) if x < points[0, 0] else (points[-2], points[-1])
    return rounded_down(x, float(a[1] + (b[1] - a[1]) * (x - a[0]) / max(b[0] - a[0], 1e-9)))


def _standing_range(points: Array, objects: Sequence[PhotoObject]) -> tuple[float, float] | None:
    """From where to where objects stand on a chain of points."""
    spans = []
    for item in objects:
        x0, _, x1, y1 = bounds(item.outline)
        lowest = float(np.interp([x0, 0.5 * (x0 + x1), x1], points[:, 0], points[:, 1]).max())
        if x1 > points[0, 0] and x0 < points[-1, 0] and abs(lowest - y1) <= FLOOR.foot:
            spans.append((max(x0, float(points[0, 0])), min(x1, float(points[-1, 0]))))
    return (min(s[0] for s in spans), max(s[1] for s in spans)) if spans else None


def _solid_range(
    points: Array, wish: tuple[float, float], inner: tuple[float, float], section: Section
) -> tuple[float, float]:
    """The ends of a floor: where nothing solid is seen under it any more."""
    height, width = section.solid.shape
    columns = np.arange(max(0, int(np.ceil(wish[0]))), min(width, int(wish[1]) + 1))
    if not len(columns):
        return wish
    at = np.array([_point_at(points, float(x))[1] for x in columns[[0, -1]]])
    level = np.interp(columns, points[:, 0], points[:, 1])
    level[columns < points[0, 0]], level[columns > points[-1, 0]] = at[0], at[1]
    empty, solid = np.ones(len(columns), bool), np.ones(len(columns), bool)
    for down in FLOOR.under:
        rows = np.clip(np.rint(level).astype(int) + down, 0, height - 1)
        known = section.known[rows, columns]
        empty &= known & ~section.solid[rows, columns]
        solid &= section.solid[rows, columns] | ~known
    margin = FLOOR.nothing * max(section.solid.shape)
    beside = (columns >= inner[0] - margin) & (columns <= inner[1] + margin)
    if not beside.any() or solid[beside].mean() < FLOOR.backed:
        return wish
    left = _first_empty(columns[::-1], empty[::-1], inner[0], wish[0], margin)
    return left, _first_empty(columns, empty, inner[1], wish[1], margin)


def _first_empty(
    columns: NDArray[np.int64], empty: NDArray[np.bool_], inner: float, wish: float, least: float
) -> float:
    """Going outwards from `inner`, the column where at least `least` px of nothing begin; `wish` where none do."""
    outwards = 1 if columns[-1] >= columns[0] else -1
    run = 0
    for x, nothing in zip(columns.tolist(), empty.tolist(), strict=True):
        if (x - inner) * outwards <= 0:
            continue
        run = run + 1 if nothing else 0
        if run >= least:
            return float(x - outwards * run)
    return wish
