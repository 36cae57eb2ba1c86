"""Distances between bodies, outlines and walls at t = 0."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from physgen.compile.world import Body, Wall
from physgen.geometry.convex import hull
from physgen.geometry.polygon import Disc, Outline, Region, Ring, cross

Array = NDArray[np.float64]


class Intervals:
    """Intervals of a line, found by where they lie."""

    def __init__(self, low: Array, high: Array) -> None:
        self._order = np.argsort(low, kind="stable")
        self._low = low[self._order]
        self._reach = np.maximum.accumulate(high[self._order])  # of all up to here

    def meeting(self, low: float, high: float) -> NDArray[np.intp]:
        """Indices of those that meet the interval from `low` to `high`, and of some that do not."""
        first = np.searchsorted(self._reach, low, "left")
        return self._order[first : np.searchsorted(self._low, high, "right")]


class WallSegments:
    """The segments of all walls, found by where they lie."""

    def __init__(self, walls: Sequence[Wall]) -> None:
        chains = [(k, chain) for k, wall in enumerate(walls) for chain in wall.chains]
        none = np.zeros((0, 2))
        self.start = np.concatenate([none, *(chain[:-1] for _, chain in chains)])
        self.end = np.concatenate([none, *(chain[1:] for _, chain in chains)])
        self.wall = np.repeat([k for k, _ in chains], [len(chain) - 1 for _, chain in chains]).astype(np.intp)
        self._low, self._high = np.minimum(self.start, self.end), np.maximum(self.start, self.end)
        self._spans = Intervals(self._low[:, 0], self._high[:, 0])

    def across(self, body: Body, by: Array | None = None) -> dict[int, float]:
        """Index of every wall that a body, moved by `by` (2,) px, reaches across, and how far, px."""
        points = _extremes(body) + body.center + (0.0 if by is None else by)
        (left, top), (right, bottom) = points.min(axis=0).tolist(), points.max(axis=0).tolist()
        near = self._spans.meeting(left, right)
        near = near[(self._low[near, 1] <= bottom) & (self._high[near, 1] >= top)]
        deepest: dict[int, float] = {}
        for k in sorted(near.tolist()):
            depth = _sunk(body, self.start[k], self.end[k], by)
            wall = int(self.wall[k])
            if depth > deepest.get(wall, 0.0):
                deepest[wall] = depth
        return deepest


def distance_beyond_hull(outline: Outline, points: Array) -> Array:
    """(P,) px by which points (P, 2) lie outside the outline's convex hull, 0 inside; never more than the distance."""
    if isinstance(outline, Disc):
        return np.asarray(np.maximum(np.hypot(*(points - outline.center).T) - outline.radius, 0.0))
    corners = hull(np.concatenate([ring.outer for ring in outline.rings]))
    along = np.roll(corners, -1, axis=0) - corners
    outward = np.stack([along[:, 1], -along[:, 0]], axis=-1) / np.hypot(*along.T)[:, None]
    most = np.zeros(len(points))
    for corner, normal in zip(corners, outward, strict=True):
        np.maximum(most, (points - corner) @ normal, out=most)
    return most


def translated_outline(outline: Outline, by: Array) -> Outline:
    """The outline at another place."""
    if isinstance(outline, Disc):
        return Disc(outline.center + by, outline.radius)
    return Region(tuple(Ring(r.outer + by, tuple(h + by for h in r.holes)) for r in outline.rings))


def distance_to_outline(outline: Outline, point: Array) -> float:
    """How far a point (2,) lies outside an outline, px; 0 within."""
    if isinstance(outline, Disc):
        return max(0.0, float(np.hypot(*(point - outline.center))) - outline.radius)
    rings = [points for ring in outline.rings for points in (ring.outer, *ring.holes)]
    start = np.concatenate(rings)
    end = np.concatenate([np.roll(points, -1, axis=0) for points in rings])
    along = end - start
    share = np.clip(((point - start) * along).sum(1) / np.maximum((along * along).sum(1), 1e-300), 0, 1)
    length = np.hypot(*(point - start - share[:, None] * along).T)
    below = (start[:, 1] <= point[1]) != (end[:, 1] <= point[1])
    side = cross(along, point - start) * np.where(end[:, 1] > start[:, 1], 1.0, -1.0)
    inside = int((below & (side > 0)).sum()) % 2 == 1
    return 0.0 if inside else float(length.min())


def _extremes(body: Body) -> Array:
    if body.radius is not None:
        return np.array([[-body.radius, -body.radius], [body.radius, body.radius]])
    return np.concatenate(body.pieces)


def _sunk(body: Body, a: Array, b: Array, by: Array | None) -> float:
    """How far a body reaches across the segment from a to b, px; 0 when it does not touch."""
    center = body.center if by is None else body.center + by
    along = b - a
    length = float(np.hypot(*along))
    if length == 0:
        return 0.0
    along = along / length
    if body.radius is not None:
        at = float(np.clip((center - a) @ along, 0, length))
        return max(0.0, body.radius - float(np.hypot(*(center - a - at * along))))
    across = np.array([-along[1], along[0]])
    places = (piece + center - a for piece in body.pieces)
    return max(_across(points @ along, points @ across, length) for points in places)


def _across(x: Array, y: Array, length: float) -> float:
    """How far a convex piece lies on both sides of the segment y = 0, 0 <= x <= length, within that length, px."""
    ends = [(x, y), (np.roll(x, -1), np.roll(y, -1))]
    heights = [y[(x >= 0) & (x <= length)]]
    for at in (0.0, length):  # where edges cross the segment's ends
        (x0, y0), (x1, y1) = ends
        cut = (x0 < at) != (x1 < at)
        heights.append(y0[cut] + (at - x0[cut]) / (x1[cut] - x0[cut]) * (y1[cut] - y0[cut]))
    inside = np.concatenate(heights)
    if not len(inside):
        return 0.0
    return max(0.0, float(min(inside.max(), -inside.min())))
