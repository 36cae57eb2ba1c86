"""Straight edges of the section in the plane of motion, and floors extended along them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import atan2, degrees, hypot

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.geometry.polygon import Array, bounds
from physgen.perceive.roles import PhotoObject, Wall
from physgen.perceive.support.motion_plane import Section
from physgen.perceive.support.supports import free_parts

# ----------------------------------------------------------------------
# What is solid in a plane, and the normals there -> straight edges of it: level, upright and sloped.
#
# Image axes, px. An edge has the solid on its right as one goes along it from `start` to `end` (y points
# down), so that
# a floor's goes from left to right.

F32 = NDArray[np.float32]

SHORTEST = 0.04
"""Of the photo's longer side: what is shorter is a detail."""
BENT = 0.005
"""Of the same, by which a contour may leave its chord and be straight."""
ROUGH = 1.5
"""px, root mean square, by which a contour may leave the line fitted to it."""
SEEN = 0.4
"""Of an edge, that must be seen and not be hidden by things."""
FLAT = 0.85
"""Length of the mean of unit normals from which they are a plane's: all within about 30 degrees."""
STRIP = (2, 4, 6)
"""px from an edge at which normals and depth are read on its solid side."""
ACROSS = 0.5
"""Part of a normal that is in the photo's plane and away from the solid, from which the surface runs back into it."""
DEEPEST = 24
"""px that it is followed."""
TURN = 5.0
"""degrees between pieces of one edge."""
LEVEL = 1.5
"""degrees up to which an edge is level or upright."""
STEP = 2.0
"""px up to which pieces of one edge lie beside each other, and an edge that rises so little is level."""
CORNER = 0.02
"""Of the photo's longer side: ends of edges that are nearer to each other meet."""


@dataclass(frozen=True, eq=False)
class Edge:
    """One straight edge."""

    start: Array
    """(2,) px."""
    end: Array
    """(2,) px."""
    seen: float
    """0..1: how much of it is."""
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
        """degrees, -180..180: 0 a floor, 90 the left side of what is to the left of nothing."""
        return degrees(atan2(self.along[1], self.along[0]))


def section_edges(section: Section, normals: F32) -> list[Edge]:
    """Straight parts of the border of what is solid that are seen and whose solid side is a plane."""
    size = max(section.solid.shape)
    contours, _ = cv2.findContours(section.solid.astype(np.uint8), cv2.RETR_LIST, cv2.CHAIN_APPROX_NONE)
    found = []
    for contour in contours:
        if len(contour) >= SHORTEST * size:
            found += _straight(contour[:, 0, :].astype(np.float64), section, normals, size)
    found = _squared(_merged(found, section))
    return _cornered([edge for edge in found if edge.length >= SHORTEST * size], CORNER * size)


def _straight(points: Array, section: Section, normals: F32, size: int) -> list[Edge]:
    """Edges of one contour `(N, 2)`."""
    height, width = section.solid.shape
    corners = cv2.approxPolyDP(points.astype(np.int32), BENT * size, True)[:, 0, :]
    order = np.flatnonzero((points[:, None] == corners[None]).all(-1).any(1))
    columns, rows = points.T.astype(int)
    border = (columns < 2) | (rows < 2) | (columns > width - 3) | (rows > height - 3)
    seen = section.known[rows, columns] & ~border
    result = []
    for first, last in zip(order, np.roll(order, -1), strict=True):
        run = np.arange(first, last + 1 if last > first else last + 1 + len(points)) % len(points)
        chord = points[last] - points[first]
        if hypot(*chord) < 0.5 * SHORTEST * size:
            continue
        trim = min(len(run) // 5, 6)
        inner = run[trim : len(run) - trim]
        used = inner[seen[inner]]
        if len(used) < max(6, SEEN * len(inner)):
            continue
        middle, along = _line(points[used], chord)
        off = (points[used] - middle) @ np.array([-along[1], along[0]])
        if np.sqrt((off**2).mean()) > ROUGH:
            continue
        ends = [middle + along * ((points[k] - middle) @ along) for k in (first, last)]
        edge = Edge(ends[0], ends[1], len(used) / len(inner), 0.0, np.zeros(3))
        edge = _outwards(edge, section)
        if (judged := _plane(edge, section, normals)) is not None:
            result.append(judged)
    return result


def _line(points: Array, towards: Array) -> tuple[Array, Array]:
    """Middle and direction of the line nearest to points `(N, 2)`, least squares across it."""
    middle = points.mean(0)
    along = np.linalg.svd(points - middle, full_matrices=False)[2][0]
    return middle, np.asarray(along if along @ towards >= 0 else -along)


def _outwards(edge: Edge, section: Section) -> Edge:
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
    """The edge, judged by what is on its solid side: a plane, among the things and not before them all."""
    lengths, facings = [], []
    for way in STRIP:
        at = _sampled(edge, section.solid.shape, -way)
        use = section.known[at] & section.solid[at]
        if use.sum() < 5 or np.median(section.depth[at][use]) < section.nearest:
            continue
        mean = normals[at][use].mean(0)
        lengths.append(float(np.linalg.norm(mean)))
        facings.append(mean / max(lengths[-1], 1e-9))
    if not lengths or max(lengths) < FLAT:
        return None
    best = int(np.argmax(lengths))
    return _into_plane(replace(edge, plane=lengths[best], facing=facings[best].astype(np.float64)), section)


def _into_plane(edge: Edge, section: Section) -> Edge:
    """The edge of a surface that passes through the plane, where it does so: what is solid begins a little behind."""
    if edge.facing[:2] @ edge.out < ACROSS:
        return edge
    ways = np.arange(0, DEEPEST)
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
        steps = point - 1.5 * edge.out + np.arange(1, DEEPEST)[:, None] * way
        columns, rows = np.rint(steps).astype(int).T
        inside = (columns >= 0) & (rows >= 0) & (columns < width) & (rows < height)
        columns, rows = np.clip(columns, 0, width - 1), np.clip(rows, 0, height - 1)
        on = inside & section.solid[rows, columns] & section.known[rows, columns]
        ends.append(point + way * (len(on) if on.all() else int(np.argmin(on))))
    return replace(edge, start=ends[0], end=ends[1])


def _merged(found: list[Edge], section: Section) -> list[Edge]:
    """Pieces of one line made one, where only things are between them."""
    left = sorted(found, key=lambda e: -e.length)
    result: list[Edge] = []
    while left:
        edge, left = left[0], left[1:]
        grown = True
        while grown:
            grown = False
            for k, other in enumerate(left):
                joined = _joined(edge, other, section)
                if joined is not None:
                    edge, grown = joined, True
                    del left[k]
                    break
        result.append(edge)
    return result


def _joined(a: Edge, b: Edge, section: Section) -> Edge | None:
    turn = abs((a.angle - b.angle + 180) % 360 - 180)
    if turn > TURN or max(abs((p - a.start) @ a.out) for p in (b.start, b.end)) > 2 * STEP:
        return None
    ends = sorted((float((p - a.start) @ a.along), i) for i, p in enumerate((a.start, a.end, b.start, b.end)))
    points = (a.start, a.end, b.start, b.end)
    gap = max(float((b.start - a.end) @ a.along), float((a.start - b.end) @ a.along))
    if gap > 0:
        between = (
            replace(a, start=a.end, end=b.start)
            if (b.start - a.end) @ a.along > 0
            else replace(a, start=b.end, end=a.start)
        )
        at = _sampled(between, section.solid.shape, 0.0)
        if gap > SHORTEST * max(section.solid.shape) and section.known[at].mean() > 0.5:
            return None
    whole = a.length + b.length
    line = replace(a, start=points[ends[0][1]], end=points[ends[-1][1]])
    offset = ((b.start + b.end) / 2 - a.start) @ a.out * b.length / whole
    ways = [float((p - a.start) @ a.along) for p in (line.start, line.end)]
    start, end = (a.start + offset * a.out + way * a.along for way in ways)
    seen = (a.seen * a.length + b.seen * b.length) / whole
    return replace(a, start=start, end=end, seen=seen, plane=min(a.plane, b.plane))


def _squared(found: list[Edge]) -> list[Edge]:
    """Level and upright where they nearly are."""
    result = []
    for edge in found:
        for axis in (0, 1):  # 0 upright, 1 level
            rise = abs(float(edge.end[axis] - edge.start[axis]))
            slope = degrees(atan2(rise, abs(float(edge.end[1 - axis] - edge.start[1 - axis]))))
            if slope <= LEVEL or (rise <= STEP and slope <= 3 * LEVEL):
                start, end = edge.start.copy(), edge.end.copy()
                start[axis] = end[axis] = 0.5 * (edge.start[axis] + edge.end[axis])
                edge = replace(edge, start=start, end=end)
        result.append(edge)
    return result


def _cornered(found: list[Edge], reach: float) -> list[Edge]:
    """Edges that nearly meet go on to where they cross."""
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


# ----------------------------------------------------------------------
# Floors that things stand on, and edges that depth and normals show -> floors as far as they are seen, and
# the rest.
#
# The height is the things': they stand exactly on it. Depth only tells where a floor begins and ends.

SAME = 0.02
"""Of the photo's longer side, by which an edge may be off the floor that it is."""
REACH_TURN = 8.0
"""degrees by which it may be turned."""
UNDER = (5, 8)
"""px under a floor at which it is asked whether anything is there."""
NOTHING = 0.03
"""Of the photo's longer side: as long must nothing be seen under a floor that it ends there."""
BACKED = 0.5
"""Of a floor under and beside things, that depth must show solid to be asked where it ends."""
FOOT = 3.0
"""px within which a thing stands on a floor."""


def extend_floors(
    floors: Sequence[Wall], found: Sequence[Edge], section: Section, things: Sequence[PhotoObject]
) -> tuple[list[Wall], list[Edge]]:
    """Floors from end to end, and the edges that are none of them."""
    near = SAME * max(section.solid.shape)
    left = list(found)
    result = []
    for wall in floors:
        own = [edge for edge in left if _is(edge, wall, near)]
        left = [edge for edge in left if all(edge is not one for one in own)]
        result.append(_ended(wall, own, section, things))
    return result, left


def _is(edge: Edge, wall: Wall, near: float) -> bool:
    """Whether an edge is a piece of a floor, or goes on from it."""
    if edge.out[1] > -0.5:
        return False
    points = np.array(wall.points)
    way = points[-1] - points[0]
    if abs(edge.angle - degrees(atan2(way[1], way[0]))) > REACH_TURN:
        return False
    x0, x1 = edge.start[0], edge.end[0]
    lower, upper = max(x0, points[0, 0]), min(x1, points[-1, 0])
    if upper - lower < 0.5 * min(x1 - x0, points[-1, 0] - points[0, 0]) and upper - lower < -near:
        return False
    xs = np.linspace(lower, upper, 9)
    at = np.interp(xs, (x0, x1), (edge.start[1], edge.end[1]))
    return float(np.abs(at - np.interp(xs, points[:, 0], points[:, 1])).mean()) <= near


def _ended(wall: Wall, own: Sequence[Edge], section: Section, things: Sequence[PhotoObject]) -> Wall:
    points = np.array(wall.points)
    inner = _feet(points, things)
    if inner is None:
        return wall
    first, last = float(points[0, 0]), float(points[-1, 0])
    start, end = first, last
    for edge in own:
        start, end = min(start, float(edge.start[0])), max(end, float(edge.end[0]))
    start, end = _seen(points, (start, end), inner, section)
    near = 2 * NOTHING * max(section.solid.shape)
    for edge in own:  # what was found there is there, and its ends are finer than what is sampled under it
        left, right = float(edge.start[0]), float(edge.end[0])
        start = left if left < start or (left <= inner[0] and left - start < near) else start
        end = right if right > end or (right >= inner[1] and end - right < near) else end
    if abs(start - first) < 1 and abs(end - last) < 1:
        return wall
    kept = points[(points[:, 0] > start) & (points[:, 0] < end)]
    ends = [_on(points, x) for x in (start, end)]
    chain = [ends[0], *((float(x), float(y)) for x, y in kept), ends[1]]
    parts = free_parts(chain, [t.outline for t in things])
    middle = 0.5 * (inner[0] + inner[1])
    part = min(parts, key=lambda p: max(p[0][0] - middle, middle - p[-1][0], 0.0), default=None)
    if part is None or part[0][0] > inner[0] + 1 or part[-1][0] < inner[1] - 1:
        return wall
    return replace(
        wall,
        points=tuple(part),
        source="depth and lowest points",
        reason=wall.reason + "; depth tells its ends",
    )


def _on(points: np.ndarray, x: float) -> tuple[float, float]:
    """The point of a chain at x; beyond its ends it goes on as it ended."""
    if points[0, 0] <= x <= points[-1, 0]:
        y = float(np.interp(x, points[:, 0], points[:, 1]))
    else:
        a, b = (points[0], points[1]) if x < points[0, 0] else (points[-2], points[-1])
        y = float(a[1] + (b[1] - a[1]) * (x - a[0]) / max(b[0] - a[0], 1e-9))
    return round(x, 2), float(np.ceil(y * 100 - 1e-6) / 100)


def _feet(points: np.ndarray, things: Sequence[PhotoObject]) -> tuple[float, float] | None:
    """From where to where things stand on a chain of points."""
    spans = []
    for thing in things:
        x0, _, x1, y1 = bounds(thing.outline)
        lowest = float(np.interp([x0, 0.5 * (x0 + x1), x1], points[:, 0], points[:, 1]).max())
        if x1 > points[0, 0] and x0 < points[-1, 0] and abs(lowest - y1) <= FOOT:
            spans.append((max(x0, float(points[0, 0])), min(x1, float(points[-1, 0]))))
    return (min(s[0] for s in spans), max(s[1] for s in spans)) if spans else None


def _seen(
    points: np.ndarray, wish: tuple[float, float], inner: tuple[float, float], section: Section
) -> tuple[float, float]:
    """The ends of a floor: where nothing is seen under it any more."""
    height, width = section.solid.shape
    columns = np.arange(max(0, int(np.ceil(wish[0]))), min(width, int(wish[1]) + 1))
    if not len(columns):
        return wish
    at = np.array([_on(points, float(x))[1] for x in columns[[0, -1]]])
    level = np.interp(columns, points[:, 0], points[:, 1])
    level[columns < points[0, 0]], level[columns > points[-1, 0]] = at[0], at[1]
    empty, solid = np.ones(len(columns), bool), np.ones(len(columns), bool)
    for down in UNDER:
        rows = np.clip(np.rint(level).astype(int) + down, 0, height - 1)
        known = section.known[rows, columns]
        empty &= known & ~section.solid[rows, columns]
        solid &= section.solid[rows, columns] | ~known
    margin = NOTHING * max(section.solid.shape)
    beside = (columns >= inner[0] - margin) & (columns <= inner[1] + margin)
    if not beside.any() or solid[beside].mean() < BACKED:
        return wish
    return _first(columns[::-1], empty[::-1], inner[0], wish[0], margin), _first(
        columns, empty, inner[1], wish[1], margin
    )


def _first(columns: np.ndarray, empty: np.ndarray, inner: float, wish: float, least: float) -> float:
    """Going outwards from `inner`, the column from which on nothing is there for `least` px; `wish` where none."""
    outwards = 1 if columns[-1] >= columns[0] else -1
    run = 0
    for x, nothing in zip(columns.tolist(), empty.tolist(), strict=True):
        if (x - inner) * outwards <= 0:
            continue
        run = run + 1 if nothing else 0
        if run >= least:
            return float(x - outwards * run)
    return wish
