"""Simplification of polylines within a tolerance."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import shapely
from numpy.typing import NDArray

from physgen.geometry.polygon import Array, cross, polygon_moments

_PRICE = 3.0
"""Squared distance that is worth another edge, in squared tolerances."""

_MOST_BREAKS = 600
"""Longer lines may break only where Douglas and Peucker would."""


def simplify(points: Array, tolerance: float, closed: bool) -> Array:
    """`(n, 2)` px -> `(K, 2)` px, no further apart than `tolerance` px (Hausdorff distance).

    An open line keeps its ends. A closed line keeps its area within 3 %: where the tolerance would flatten a small
    ring, a smaller one is taken.
    """
    if not closed:
        return (
            _straighten(points, tolerance, closed=False)
            if len(points) > 2
            else points.copy()
        )
    area = abs(polygon_moments(points).area)
    start = int(np.argmax(((points - points.mean(axis=0)) ** 2).sum(axis=1)))
    points = np.roll(points, -start, axis=0)
    for share in (1.0, 0.5, 0.25):
        found = _distinct(
            _straighten(
                np.concatenate([points, points[:1]]), share * tolerance, closed=True
            )
        )
        if (
            len(found) >= 3
            and abs(abs(polygon_moments(found).area) - area) <= 0.03 * area
        ):
            return found
    return points


def _straighten(points: Array, tolerance: float, closed: bool) -> Array:
    """As `simplify`; a closed line has its first point again at its end, in and out."""
    runs = _runs(points, tolerance)
    pinned: set[int] = set()
    for _ in range(12):
        corners = _corners(points, runs, pinned, closed, tolerance)
        bad = _off(points, runs, corners, tolerance)
        if not bad:
            return np.array([corner for pair in corners for corner in pair])
        for first, last in bad:
            chords = [
                first + k for k in _douglas_peucker(points[first : last + 1], tolerance)
            ]
            runs = sorted({*runs, *chords})
            pinned |= set(chords)
    return points[_douglas_peucker(points, tolerance)]


def _runs(points: Array, tolerance: float) -> list[int]:
    """Indices of the breaks of least price, the first and the last point among them."""
    count = len(points)
    where = (
        np.arange(count)
        if count <= _MOST_BREAKS
        else np.array(_douglas_peucker(points, 0.6 * tolerance))
    )
    p = points - points.mean(axis=0)
    columns = np.column_stack(
        [np.ones(count), p, p[:, 0] ** 2, p[:, 0] * p[:, 1], p[:, 1] ** 2]
    )
    upto = np.concatenate([np.zeros((1, 6)), np.cumsum(columns, axis=0)])
    before, after = upto[where], upto[where + 1]
    best = np.zeros(len(where))
    back = np.zeros(len(where), dtype=np.intp)
    for j in range(1, len(where)):
        n, x, y, xx, xy, yy = (after[j] - before[:j]).T
        a, b, c = xx - x * x / n, xy - x * y / n, yy - y * y / n
        squares = (a + c) / 2 - np.sqrt(((a - c) / 2) ** 2 + b * b)
        price = best[:j] + np.maximum(squares, 0) + _PRICE * tolerance**2
        back[j] = int(np.argmin(price))
        best[j] = price[back[j]]
    found = [len(where) - 1]
    while found[-1]:
        found.append(int(back[found[-1]]))
    breaks: list[int] = where[found[::-1]].tolist()
    return breaks


def _run_line(run: Array) -> tuple[Array, Array]:
    """Total least squares: a point on the line and its unit direction, along the order of the points."""
    # the ends of a run belong to two runs, and corners are rounded there
    points = run[1:-1] if len(run) >= 5 else run
    center = points.mean(axis=0)
    x, y = (points - center).T
    angle = 0.5 * np.arctan2(2 * (x @ y), x @ x - y @ y)
    direction = np.array([np.cos(angle), np.sin(angle)])
    if direction @ (points[-1] - points[0]) < 0:
        direction = -direction
    return center, direction


def end_lines(points: Array, tolerance: float) -> dict[int, tuple[Array, Array, int]]:
    """The straight runs at both ends (0 and -1) of an open line: a point, the unit direction, how many points."""
    runs = _runs(points, tolerance)
    found = {}
    for end, run in ((0, points[: runs[1] + 1]), (-1, points[runs[-2] :])):
        found[end] = (*_run_line(run), len(run))
    return found


def distances(points: Array, start: Array, end: Array) -> Array:
    """`(n,)` px from each point to the segment from `start` to `end`, each `(2,)` or `(n, 2)`."""
    along = end - start
    length = np.maximum((along * along).sum(axis=-1), 1e-300)
    share = np.clip(((points - start) * along).sum(axis=-1) / length, 0.0, 1.0)
    gap = points - start - share[..., None] * along
    found: Array = np.sqrt((gap * gap).sum(axis=-1))
    return found


def distances_to_line(points: Array, line: Array, closed: bool) -> Array:
    """`(n,)` px from each point to the nearest segment of a line `(K, 2)`."""
    following = np.roll(line, -1, axis=0) if closed else line[1:]
    start = line if closed else line[:-1]
    nearest: Array = distances(points[:, None], start[None], following[None]).min(
        axis=1
    )
    return nearest


def _distinct(corners: Array) -> Array:
    """Without corners that repeat the one before, all the way round."""
    kept: Array = corners[
        np.abs(corners - np.roll(corners, -1, axis=0)).max(axis=1) > 1e-6
    ]
    return kept


def _douglas_peucker(points: Array, tolerance: float) -> list[int]:
    """Indices kept, the first and the last among them."""
    kept = {0, len(points) - 1}
    waiting = [(0, len(points) - 1)]
    while waiting:
        first, last = waiting.pop()
        if last - first < 2:
            continue
        off = distances(points[first + 1 : last], points[first], points[last])
        index = int(np.argmax(off))
        if off[index] > tolerance:
            middle = first + 1 + index
            kept.add(middle)
            waiting += [(first, middle), (middle, last)]
    return sorted(kept)


def _corners(
    points: Array, runs: list[int], pinned: set[int], closed: bool, limit: float
) -> list[list[Array]]:
    """At each break one corner or the two of a bevel.

    A closed line repeats its first ones at its end.
    """
    lines = [_run_line(points[a : b + 1]) for a, b in pairwise(runs)]
    found = []
    for k in range(1, len(runs) - 1):
        around = points[runs[k - 1] : runs[k + 1] + 1]
        here = points[runs[k]]
        found.append(
            [here]
            if runs[k] in pinned
            else _meet(around, here, lines[k - 1], lines[k], limit)
        )
    if closed:
        around = np.concatenate([points[runs[-2] : -1], points[: runs[1] + 1]])
        pin = {0, runs[-1]} & pinned
        seam = (
            [points[0]] if pin else _meet(around, points[0], lines[-1], lines[0], limit)
        )
        return [seam, *found, seam]
    start, end = _joint(points[0], lines[0], 1.0), _joint(points[-1], lines[-1], -1.0)
    return [[points[0], *start], *found, [*end, points[-1]]]


def _joint(end: Array, line: tuple[Array, Array], way: float) -> list[Array]:
    """Where an end lies off its run's line: the point that soon brings the edge back to it, else none."""
    point, direction = line
    off = float(abs(cross(direction, end - point)))
    return (
        []
        if off < 0.25
        else [point + direction * (direction @ (end - point) + 2 * off * way)]
    )


def _meet(
    around: Array,
    here: Array,
    before: tuple[Array, Array],
    after: tuple[Array, Array],
    limit: float,
) -> list[Array]:
    """The corner of two lines (a point and a direction each) at the break `here` of the points `around`.

    A corner that would stand off the points by more than `limit` is bevelled.
    """
    (p, u), (q, v) = before, after
    turn = float(cross(u, v))
    if abs(turn) > 1e-3:
        corner = p + u * (float(cross(q - p, v)) / turn)
        for back in (0.0, 0.25, 0.5, 0.75, 1.0, 1.5, 2.0):
            ends = np.array([corner - back * u, corner + back * v])
            probe = np.array([ends[0], ends.mean(axis=0), ends[1]])
            if distances_to_line(probe, around, closed=False).max() <= limit:
                return [ends[0], ends[1]] if back else [corner]
    return [p + u * ((here - p) @ u), q + v * ((here - q) @ v)]


def _off(
    points: Array, runs: list[int], corners: list[list[Array]], tolerance: float
) -> list[tuple[int, int]]:
    """Runs (first and last index) that stand off their edge by more than the tolerance, or are walked backwards."""
    bad = []
    closed = bool((points[0] == points[-1]).all())
    share = np.linspace(0, 1, 17)[:, None]
    limit = tolerance + 1e-9
    for k, (first, last) in enumerate(pairwise(runs)):
        run = points[first : last + 1]
        before = corners[k - 1][-1:] if k > 0 else corners[-2][-1:] if closed else []
        after = (
            corners[k + 2][:1]
            if k + 2 < len(corners)
            else corners[1][:1]
            if closed
            else []
        )
        line = np.array([*before, *corners[k], *corners[k + 1], *after])
        start, end = corners[k][-1], corners[k + 1][0]
        low = runs[k - 1] if k > 0 else first
        high = runs[k + 2] if k + 2 < len(runs) else last
        near = points[low : high + 1]
        if closed and k == 0:
            near = np.concatenate([points[runs[-2] : -1], near])
        if closed and k == len(runs) - 2:
            near = np.concatenate([near, points[1 : runs[1] + 1]])
        probes = np.concatenate([start + (end - start) * share, corners[k + 1]])
        if (
            distances_to_line(run, line, closed=False).max() > limit
            or (end - start) @ (run[-1] - run[0]) <= 0
            or distances_to_line(probes, near, closed=False).max() > 0.99 * limit
        ):
            bad.append((first, last))
    return bad


def crossings(rings: list[Array]) -> NDArray[np.intp]:
    """Pairs of rings `(m, 2)` whose edges truly cross (a ring with itself included)."""
    start = np.concatenate(rings)
    along = np.concatenate([np.roll(ring, -1, axis=0) for ring in rings]) - start
    owner = np.repeat(np.arange(len(rings)), [len(ring) for ring in rings])
    edges = shapely.linestrings(np.stack([start, start + along], axis=1))
    i, j = shapely.STRtree(edges).query(edges)
    i, j = i[i < j], j[i < j]
    sides = [
        cross(along[a], start[b] + end * along[b] - start[a])
        for a, b in ((i, j), (j, i))
        for end in (0.0, 1.0)
    ]
    crossed = _opposite(*sides[:2]) & _opposite(*sides[2:])
    pairs = np.sort(owner[np.stack([i[crossed], j[crossed]], axis=1)], axis=1)
    return np.unique(pairs, axis=0).astype(np.intp).reshape(-1, 2)


def _opposite(a: Array, b: Array) -> NDArray[np.bool_]:
    """Strictly on two sides, beyond rounding: areas in px²."""
    apart: NDArray[np.bool_] = (np.minimum(a, b) < -1e-9) & (np.maximum(a, b) > 1e-9)
    return apart
