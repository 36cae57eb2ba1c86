"""Checks of outlines: area and self-intersection.

Only lines that properly cross are refused; an outline may touch itself, as contours of masks do.
"""

from __future__ import annotations

from collections.abc import Sequence

Corner = tuple[float, float]

SMALL = 400
"""Corners up to which a sweep in plain Python is faster than shapely, which also has to be imported."""
MAX_PAIRS = 2_000_000
"""Pairs of lines that are compared at most: a contour of 100,000 corners needs some 400,000."""
BLOCK = 16
"""Lines that are compared with all others at a time: bounds the memory where every line is near every other."""


def same_point(a: Corner, b: Corner) -> bool:
    """Whether two points are one, to what a float of 10^6 px resolves."""
    return abs(a[0] - b[0]) < 1e-9 and abs(a[1] - b[1]) < 1e-9


def outline_problem(points: Sequence[Corner], crossing: bool) -> tuple[str, str] | None:
    """`expected` and `fix` of a Problem, None for a good outline; `crossing`: its lines may not cross."""
    x0, y0 = points[0]
    xs = [x - x0 for x, _ in points]
    ys = [y - y0 for _, y in points]
    area = sum(xs[i - 1] * ys[i] - xs[i] * ys[i - 1] for i in range(len(points))) / 2
    extent = (max(xs) - min(xs)) * (max(ys) - min(ys))
    if extent == 0 or (not crossing and len(points) < 4 and abs(area) < 1e-12 * extent):
        return "has no area", "write at least three corners that are not on one line"
    if crossing:
        pair = _sweep(points) if len(points) <= SMALL else _tree_search(points)
        if pair == (-1, -1):
            return "is too tangled to check for crossings", "simplify it"
        if pair:
            return (
                f"crosses itself: the lines from corners {pair[0]} and {pair[1]}",
                "write the corners in order",
            )
        if abs(area) < 1e-12 * extent:
            return "has no area", "write at least three corners that are not on one line"
    return None


def _cross(a: Corner, b: Corner, c: Corner, d: Corner) -> bool:
    """Whether the segments ab and cd properly cross."""
    abx, aby = b[0] - a[0], b[1] - a[1]
    cdx, cdy = d[0] - c[0], d[1] - c[1]
    s = abx * (c[1] - a[1]) - aby * (c[0] - a[0])
    t = abx * (d[1] - a[1]) - aby * (d[0] - a[0])
    if not (s < 0 < t or t < 0 < s):
        return False
    s = cdx * (a[1] - c[1]) - cdy * (a[0] - c[0])
    t = cdx * (b[1] - c[1]) - cdy * (b[0] - c[0])
    return s < 0 < t or t < 0 < s


def _sweep(points: Sequence[Corner]) -> tuple[int, int] | None:
    """First pair of lines that cross, by their first corners: lines in order of their left ends."""
    n = len(points)
    lines = []
    for i, a in enumerate(points):
        b = points[i + 1 - n]
        lines.append((min(a[0], b[0]), max(a[0], b[0]), i, a, b))
    lines.sort()
    active: list[tuple[float, float, int, Corner, Corner]] = []
    found: tuple[int, int] | None = None
    for line in lines:
        left, _, i, a, b = line
        active = [other for other in active if other[1] >= left]
        top, bottom = (a[1], b[1]) if a[1] < b[1] else (b[1], a[1])
        for _, _, j, c, d in active:
            if (c[1] < top and d[1] < top) or (c[1] > bottom and d[1] > bottom) or (i - j) % n in (1, n - 1):
                continue
            if _cross(a, b, c, d):
                pair = (min(i, j), max(i, j))
                found = pair if found is None else min(found, pair)
        active.append(line)
    return found


def _tree_search(points: Sequence[Corner]) -> tuple[int, int] | None:
    """The same for many corners, with shapely's search tree; (-1, -1) after MAX_PAIRS comparisons."""
    import numpy as np
    import shapely

    corners = np.asarray(points, dtype=float)
    lines = shapely.linestrings(np.stack([corners, np.roll(corners, -1, axis=0)], axis=1))
    tree = shapely.STRtree(lines)
    compared = 0
    for start in range(0, len(lines), BLOCK):
        first, second = tree.query(lines[start : start + BLOCK])
        first += start
        compared += len(first)
        if compared > MAX_PAIRS:
            return (-1, -1)
        hits = (second > first) & shapely.crosses(lines[first], lines[second])
        if hits.any():
            return min(zip(first[hits].tolist(), second[hits].tolist(), strict=True))
    return None
