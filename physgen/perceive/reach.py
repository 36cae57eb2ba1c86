"""Floors that things stand on, and edges that depth and normals show -> floors as far as they are seen, and the rest.

The height is the things': they stand exactly on it. Depth only tells where a floor begins and ends.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from math import atan2, degrees

import numpy as np

from physgen.outline.outline import bounds
from physgen.perceive.motion_plane import Section
from physgen.perceive.roles import Thing, Wall
from physgen.perceive.sections import Edge
from physgen.perceive.upheld import free_parts

SAME = 0.02
"""Of the photo's longer side, by which an edge may be off the floor that it is."""
TURN = 8.0
"""degrees by which it may be turned."""
UNDER = (5, 8)
"""px under a floor at which it is asked whether anything is there."""
NOTHING = 0.03
"""Of the photo's longer side: as long must nothing be seen under a floor that it ends there."""
BACKED = 0.5
"""Of a floor under and beside things, that depth must show solid to be asked where it ends."""
FOOT = 3.0
"""px within which a thing stands on a floor."""


def reaching(
    floors: Sequence[Wall], found: Sequence[Edge], section: Section, things: Sequence[Thing]
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
    if abs(edge.angle - degrees(atan2(way[1], way[0]))) > TURN:
        return False
    x0, x1 = edge.start[0], edge.end[0]
    lower, upper = max(x0, points[0, 0]), min(x1, points[-1, 0])
    if upper - lower < 0.5 * min(x1 - x0, points[-1, 0] - points[0, 0]) and upper - lower < -near:
        return False
    xs = np.linspace(lower, upper, 9)
    at = np.interp(xs, (x0, x1), (edge.start[1], edge.end[1]))
    return float(np.abs(at - np.interp(xs, points[:, 0], points[:, 1])).mean()) <= near


def _ended(wall: Wall, own: Sequence[Edge], section: Section, things: Sequence[Thing]) -> Wall:
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


def _feet(points: np.ndarray, things: Sequence[Thing]) -> tuple[float, float] | None:
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
