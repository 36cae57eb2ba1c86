"""Simplification of polylines within a tolerance."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import shapely
from numpy.typing import NDArray

from physgen.arrays import Mask
from physgen.geometry.polygon import Array, cross, polygon_moments

_PRICE = 3.0
"""Squared distance with the cost of another edge, in squared tolerances."""

_MOST_BREAKS = 600
"""Number of points above which only Douglas and Peucker's points may be breaks."""


def simplify(points: Array, tolerance: float, is_loop: bool) -> Array:
    """Simplify `(n, 2)` px to `(K, 2)` px within `tolerance` px (Hausdorff distance).

    An open line keeps its ends. A closed line keeps its area within 3 %: for a small
    ring, a smaller tolerance is used.
    """
    if not is_loop:
        if len(points) <= 2:
            return points.copy()
        return _straighten(points, tolerance, is_loop=False)
    # Start a closed line at its farthest point from the mean, a convex corner.
    # The area decides at the end whether the line is simplified too much.
    area = abs(polygon_moments(points).area)
    squares = ((points - points.mean(axis=0)) ** 2).sum(axis=1)
    points = np.roll(points, -int(np.argmax(squares)), axis=0)
    ring = np.concatenate([points, points[:1]])
    # A line within the tolerance can still lose much of a small ring's area.
    for share in (1.0, 0.5, 0.25):
        line = _distinct(_straighten(ring, share * tolerance, is_loop=True))
        if len(line) < 3:
            continue
        change = abs(abs(polygon_moments(line).area) - area)
        if change <= 0.03 * area:
            return line
    return points


def _straighten(points: Array, tolerance: float, is_loop: bool) -> Array:
    """Simplify as `simplify`; a closed line repeats its first point at its end."""
    runs = _runs(points, tolerance)
    pinned_corners: set[int] = set()
    for _ in range(12):
        corners = _corners(points, runs, pinned_corners, is_loop, tolerance)
        distant_runs = _deviation(points, runs, corners, tolerance)
        if not distant_runs:
            return np.array([corner for pair in corners for corner in pair])
        # Runs beyond the tolerance get more breaks, with corners fixed to points of the
        # line.
        for first, last in distant_runs:
            local = _douglas_peucker(points[first : last + 1], tolerance)
            breaks = [first + k for k in local]
            runs = sorted({*runs, *breaks})
            pinned_corners |= set(breaks)
    return points[_douglas_peucker(points, tolerance)]


def _runs(points: Array, tolerance: float) -> list[int]:
    """Return the breaks of minimum price, including the first and the last point.

    Dynamic programming over the last break.
    """
    count = len(points)
    if count <= _MOST_BREAKS:
        candidates = np.arange(count)
    else:
        # The work grows with the square of the candidates. A smaller
        # tolerance leaves enough candidates for a good choice.
        candidates = np.array(_douglas_peucker(points, 0.6 * tolerance))
    x, y = (points - points.mean(axis=0)).T
    columns = np.column_stack([np.ones(count), x, y, x**2, x * y, y**2])
    # Cumulative sums give the moments of any run as a difference.
    sums = np.concatenate([np.zeros((1, 6)), np.cumsum(columns, axis=0)])
    before = sums[candidates]
    after = sums[candidates + 1]
    # The best chain of runs to each candidate extends the best chain to an
    # earlier one.
    best = np.zeros(len(candidates))
    previous = np.zeros(len(candidates), dtype=np.intp)
    for j in range(1, len(candidates)):
        squares = _squared_distances((after[j] - before[:j]).T)
        price = best[:j] + np.maximum(squares, 0) + _PRICE * tolerance**2
        previous[j] = int(np.argmin(price))
        best[j] = price[previous[j]]
    # Follow the chain back from the last point.
    chain = [len(candidates) - 1]
    while chain[-1]:
        chain.append(int(previous[chain[-1]]))
    breaks: list[int] = candidates[chain[::-1]].tolist()
    return breaks


def _squared_distances(moments: Array) -> Array:
    """Return the sum (m,) of squared distances of runs from their best lines.

    `moments` (6, m): n, x, y, xx, xy, yy.
    """
    # The second moments about the mean of each run ...
    n, x, y, xx, xy, yy = moments
    a = xx - x * x / n
    b = xy - x * y / n
    c = yy - y * y / n
    # ... have as smaller eigenvalue the sum of squares across the best line.
    mean = (a + c) / 2
    half_difference = (a - c) / 2
    return np.asarray(mean - np.sqrt(half_difference**2 + b * b))


def _run_line(run: Array) -> tuple[Array, Array]:
    """Return a point and the unit direction of the line of total least squares.

    The direction follows the order of the points.
    """
    # The ends of a run belong to two runs, and corners are rounded there: leave them
    # out.
    if len(run) >= 5:
        points = run[1:-1]
    else:
        points = run
    center = points.mean(axis=0)
    x, y = (points - center).T
    angle = 0.5 * np.arctan2(2 * (x @ y), x @ x - y @ y)
    direction = np.array([np.cos(angle), np.sin(angle)])
    if direction @ (points[-1] - points[0]) < 0:
        direction = -direction
    return center, direction


def end_lines(points: Array, tolerance: float) -> dict[int, tuple[Array, Array, int]]:
    """Return the straight runs at both ends (0 and -1) of an open line.

    Each has a point, a unit direction and a number of points.
    """
    runs = _runs(points, tolerance)
    first = points[: runs[1] + 1]
    last = points[runs[-2] :]
    return {0: (*_run_line(first), len(first)), -1: (*_run_line(last), len(last))}


def distances(points: Array, start: Array, end: Array) -> Array:
    """Return the distance (n,) px of each point from a segment.

    `start`, `end`: `(2,)` or `(n, 2)`.
    """
    edge = end - start
    length = np.maximum((edge * edge).sum(axis=-1), 1e-300)
    projection = ((points - start) * edge).sum(axis=-1)
    share = np.clip(projection / length, 0.0, 1.0)
    gap = points - start - share[..., None] * edge
    lengths: Array = np.sqrt((gap * gap).sum(axis=-1))
    return lengths


def distances_to_line(points: Array, line: Array, is_loop: bool) -> Array:
    """Return the distance (n,) px of each point from a line `(K, 2)`."""
    start = line[:-1]
    end = line[1:]
    if is_loop:
        start = line
        end = np.roll(line, -1, axis=0)
    pair_distances = distances(points[:, None], start[None], end[None])
    nearest: Array = pair_distances.min(axis=1)
    return nearest


def _distinct(corners: Array) -> Array:
    """Remove corners equal to the one before, also across the end."""
    step = np.abs(corners - np.roll(corners, -1, axis=0)).max(axis=1)
    result: Array = corners[step > 1e-6]
    return result


def _douglas_peucker(points: Array, tolerance: float) -> list[int]:
    """Return the indices of the remaining points, including the first and the last."""
    indices = {0, len(points) - 1}
    parts = [(0, len(points) - 1)]
    while parts:
        first, last = parts.pop()
        if last - first < 2:
            continue
        distance = distances(points[first + 1 : last], points[first], points[last])
        farthest = int(np.argmax(distance))
        if distance[farthest] > tolerance:
            middle = first + 1 + farthest
            indices.add(middle)
            parts += [(first, middle), (middle, last)]
    return sorted(indices)


def _corners(
    points: Array, runs: list[int], pinned_points: set[int], is_loop: bool, limit: float
) -> list[list[Array]]:
    """Return for each break one corner, or the two of a bevel.

    A closed line repeats its first corners at its end.
    """
    lines = [_run_line(points[a : b + 1]) for a, b in pairwise(runs)]
    corners = []
    for k in range(1, len(runs) - 1):
        corner = points[runs[k]]
        if runs[k] in pinned_points:
            corners.append([corner])
            continue
        run_points = points[runs[k - 1] : runs[k + 1] + 1]
        corners.append(_meet(run_points, corner, lines[k - 1], lines[k], limit))
    # A closed line has a corner at its seam, too, between the last run and the first.
    if is_loop:
        seam = [points[0]]
        if not {0, runs[-1]} & pinned_points:
            last_run = points[runs[-2] : -1]
            first_run = points[: runs[1] + 1]
            run_points = np.concatenate([last_run, first_run])
            seam = _meet(run_points, points[0], lines[-1], lines[0], limit)
        return [seam, *corners, seam]
    start = _joint(points[0], lines[0], 1.0)
    end = _joint(points[-1], lines[-1], -1.0)
    return [[points[0], *start], *corners, [*end, points[-1]]]


def _joint(end: Array, line: tuple[Array, Array], sign: float) -> list[Array]:
    """Return the point at which the edge from an end reaches its run's line.

    Empty if the end lies on the line.
    """
    point, direction = line
    distance = float(abs(cross(direction, end - point)))
    if distance < 0.25:
        return []
    signed_distance = direction @ (end - point) + 2 * distance * sign
    return [point + direction * signed_distance]


def _meet(
    line: Array,
    break_point: Array,
    before: tuple[Array, Array],
    after: tuple[Array, Array],
    limit: float,
) -> list[Array]:
    """Return the corner of two lines (a point and a direction each) at the break
    `break_point`.

    A corner farther than `limit` from the points `line` is bevelled.
    """
    (p, u), (q, v) = before, after
    turn = float(cross(u, v))
    if abs(turn) > 1e-3:
        corner = p + u * (float(cross(q - p, v)) / turn)
        # A sharp corner may lie outside the tolerance: cut off as little as
        # possible of it.
        for back in (0.0, 0.25, 0.5, 0.75, 1.0, 1.5, 2.0):
            ends = np.array([corner - back * u, corner + back * v])
            probe = np.array([ends[0], ends.mean(axis=0), ends[1]])
            if distances_to_line(probe, line, is_loop=False).max() <= limit:
                if back:
                    return [ends[0], ends[1]]
                return [corner]
    # Nearly parallel lines have no usable corner: join them at the break.
    first_foot = p + u * ((break_point - p) @ u)
    second_foot = q + v * ((break_point - q) @ v)
    return [first_foot, second_foot]


def _deviation(
    points: Array, runs: list[int], corners: list[list[Array]], tolerance: float
) -> list[tuple[int, int]]:
    """Return the runs (first and last index) beyond the tolerance, or with reversed
    edges.
    """
    is_closed_line = bool((points[0] == points[-1]).all())
    share = np.linspace(0, 1, 17)[:, None]
    limit = tolerance + 1e-9
    distant_runs = []
    for k, (first, last) in enumerate(pairwise(runs)):
        run = points[first : last + 1]
        start = corners[k][-1]
        end = corners[k + 1][0]
        is_backwards = (end - start) @ (run[-1] - run[0]) <= 0
        line = _edge_with_neighbours(corners, k, is_closed_line)
        nearby_points = _points_around(points, runs, k, is_closed_line)
        # Check both directions: points of the run near the edge, and the edge near the
        # points.
        probes = np.concatenate([start + (end - start) * share, corners[k + 1]])
        if (
            is_backwards
            or distances_to_line(run, line, is_loop=False).max() > limit
            or distances_to_line(probes, nearby_points, is_loop=False).max()
            > 0.99 * limit
        ):
            distant_runs.append((first, last))
    return distant_runs


def _edge_with_neighbours(corners: list[list[Array]], k: int, is_loop: bool) -> Array:
    """Return the corners of edge k, with the corner before and the one after it."""
    line = [*corners[k], *corners[k + 1]]
    if k > 0:
        line.insert(0, corners[k - 1][-1])
    elif is_loop:
        line.insert(0, corners[-2][-1])
    if k + 2 < len(corners):
        line.append(corners[k + 2][0])
    elif is_loop:
        line.append(corners[1][0])
    return np.array(line)


def _points_around(points: Array, runs: list[int], k: int, is_loop: bool) -> Array:
    """Return the points of run k and of the runs beside it."""
    if k > 0:
        first = runs[k - 1]
    else:
        first = runs[k]
    if k + 2 < len(runs):
        last = runs[k + 2]
    else:
        last = runs[k + 1]
    nearby_points = points[first : last + 1]
    if is_loop and k == 0:
        nearby_points = np.concatenate([points[runs[-2] : -1], nearby_points])
    if is_loop and k == len(runs) - 2:
        nearby_points = np.concatenate([nearby_points, points[1 : runs[1] + 1]])
    return nearby_points


def crossings(rings: list[Array]) -> NDArray[np.intp]:
    """Return the pairs of rings `(m, 2)` with crossing edges, also of a ring with
    itself.
    """
    start = np.concatenate(rings)
    end = np.concatenate([np.roll(ring, -1, axis=0) for ring in rings])
    edge = end - start
    owner = np.repeat(np.arange(len(rings)), list(map(len, rings)))
    segments = shapely.linestrings(np.stack([start, start + edge], axis=1))
    # The tree finds candidate pairs by their boxes, each pair in both orders: keep one.
    i, j = shapely.STRtree(segments).query(segments)
    i, j = i[i < j], j[i < j]

    def sides(a: NDArray[np.intp], b: NDArray[np.intp]) -> tuple[Array, Array]:
        """Return on which side of edges `a` both ends of edges `b` lie."""
        to_start = cross(edge[a], start[b] + 0.0 * edge[b] - start[a])
        to_end = cross(edge[a], start[b] + 1.0 * edge[b] - start[a])
        return to_start, to_end

    # Two edges cross if the ends of each lie on opposite sides of the other.
    crosses = _opposite(*sides(i, j)) & _opposite(*sides(j, i))
    edges = np.stack([i[crosses], j[crosses]], axis=1)
    pairs = np.sort(owner[edges], axis=1)
    return np.unique(pairs, axis=0).astype(np.intp).reshape(-1, 2)


def _opposite(a: Array, b: Array) -> Mask:
    """Check whether areas, px², have opposite signs beyond rounding."""
    is_opposite: Mask = (np.minimum(a, b) < -1e-9) & (np.maximum(a, b) > 1e-9)
    return is_opposite
