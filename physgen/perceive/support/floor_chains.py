"""Floors as chains of points on which every object stands as in the photo.

An object stands on the edge of its convex hull below its centre of mass, or, for a
ball, on a level spot. Coordinates are image axes, px.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from physgen.geometry.polygon import Array, Disc, bounds
from physgen.perceive.roles import PhotoObject
from physgen.perceive.support.ground_contact import Foot, Line

Point = tuple[float, float]
Chain = Sequence[Point]
"""Points of a wall from left to right, px."""

INVISIBLE = 0.06
"""px: largest distance of points from a line in their place."""
STRAIGHT = 0.005
"""px: largest distance of a redundant point from the line between its neighbours."""
ROUNDS = 8
"""Largest number of rounds that add hull points to a chain."""
NEST_ANGLE = 25.0
"""degrees from the lowest point of a ball to an end of its nest."""
NEST_REACH = 0.3
"""Width of a nest on either side of the centre of mass, as a share of the object's."""


def rounded_down(x: float, y: float) -> tuple[float, float]:
    """Round to 0.01 px, y downwards, so that a wall does not enter the objects on
    it.
    """
    return round(x, 2), float(np.ceil(y * 100 - 1e-6) / 100)


def floor_points(
    line: Line, group: Sequence[Foot], ends: tuple[float, float]
) -> list[Point]:
    """Return a chain from x = `ends[0]` to `ends[1]` that carries every object of a
    group.

    The chain enters none of the objects.
    """
    chain = _join_feet(group)
    first = chain[0]
    last = chain[-1]
    start = min(ends[0], first[0] - 0.01)
    end = max(ends[1], last[0] + 0.01)
    chain = [
        (start, _clear_of_hulls(group, first, start, line.slope, -1)),
        *chain,
        (end, _clear_of_hulls(group, last, end, line.slope, 1)),
    ]
    rounded_chain = [rounded_down(x, y) for x, y in chain]
    return _without_straight_points(
        [
            p
            for i, p in enumerate(rounded_chain)
            if i == 0 or p[0] > rounded_chain[i - 1][0]
        ]
    )


def _join_feet(group: Sequence[Foot]) -> list[Point]:
    """Return a chain through feet that enters no hull between its ends."""
    chain = sorted((float(x), float(y)) for f in group for x, y in (f.left, f.right))
    # Add hull points below the chain until the chain enters no hull.
    for _ in range(ROUNDS):
        xs, ys = np.array(chain).T
        low = []
        for f in group:
            for x, y in f.hull:
                if y > np.interp(x, xs, ys, -np.inf, -np.inf) + 1e-6:
                    low.append((float(x), float(y)))
        inside = []
        for p in low:
            if xs[0] <= p[0] <= xs[-1]:
                inside.append(p)
        if not inside:
            break
        chain = sorted({*chain, *inside})
    return chain


def _clear_of_hulls(
    group: Sequence[Foot], start: tuple[float, float], x: float, slope: float, side: int
) -> float:
    """Return y at x of a line from `start` outwards that stays below every hull.

    The line has at least the given slope.
    """
    y = start[1] + slope * (x - start[0])
    for f in group:
        points = f.hull[(f.hull[:, 0] - start[0]) * side > 0.05]
        for px, py in points:
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
    """Return a chain without points on the line between their neighbours, to 0.005 px.

    If all points nearly lie on one line, only the two ends remain.
    """
    points = np.array(chain)
    (x0, y0), (x1, y1) = points[0], points[-1]
    distances = points[:, 1] - (
        y0 + (y1 - y0) * (points[:, 0] - x0) / max(x1 - x0, 1e-9)
    )
    if np.ptp(distances) <= INVISIBLE:
        down = float(distances.max())
        return [
            (x, float(np.ceil((y + down) * 100 - 1e-6) / 100))
            for x, y in (chain[0], chain[-1])
        ]
    result = [chain[0]]
    for i in range(1, len(chain) - 1):
        (x0, y0), (x, y), (x1, y1) = result[-1], chain[i], chain[i + 1]
        if abs(y0 + (y1 - y0) * (x - x0) / (x1 - x0) - y) > STRAIGHT:
            result.append(chain[i])
    return [*result, chain[-1]]


def cradle(item: PhotoObject, center: Array, hull: Array) -> list[Point]:
    """Return a chain along the underside of an object: a nest that holds it.

    The chain extends to both sides of the centre of mass.
    """
    if isinstance(item.outline, Disc):
        chain = _draw_ball_nest(item.outline)
    else:
        x0, _, x1, _ = bounds(item.outline)
        chain = _draw_hull_nest(center, hull, NEST_REACH * (x1 - x0))
    return [rounded_down(float(x), y) for x, y in chain]


def _draw_ball_nest(disc: Disc) -> list[Point]:
    """Return a nest under a ball."""
    x = float(disc.center[0])
    y = float(disc.center[1])
    r = disc.radius
    angle = np.radians(NEST_ANGLE)
    inner = r * np.tan(angle / 2)
    side = r * np.sin(angle)
    depth = r * np.cos(angle)
    return [
        (x - side, y + depth),
        (x - inner, y + r),
        (x + inner, y + r),
        (x + side, y + depth),
    ]


def _draw_hull_nest(center: Array, hull: Array, reach: float) -> list[Point]:
    """Return a nest along a hull (K, 2), `reach` px to both sides of the centre."""
    xs, ys = hull.T
    ends = np.clip([center[0] - reach, center[0] + reach], xs[0], xs[-1])
    # The object rests on corners of its hull: without a corner on either side of
    # its centre it would tip.
    k = int(np.clip(np.searchsorted(xs, center[0]), 1, len(hull) - 1))
    end_columns = [
        min(ends[0], xs[k - 1] - 0.5),
        max(ends[1], xs[k] + 0.5),
    ]
    left, right = np.clip(end_columns, xs[0], xs[-1])
    inner_columns = xs[(xs > left) & (xs < right)]
    nest = []
    for x in (left, *inner_columns, right):
        nest.append((float(x), float(np.interp(x, xs, ys))))
    return nest
