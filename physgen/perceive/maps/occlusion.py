"""Occlusion order of objects, and the layers to draw them in."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.geometry.circles import robust_circle
from physgen.geometry.fitting import long_border, touching_masks
from physgen.geometry.polygon import Array
from physgen.perceive.roles import Labels

Mask = NDArray[np.bool_]

DEEP, PART = 6.0, 0.1
"""px, and share of the smaller thing's size, by which a thing must reach under another: true masks of things that rest
on each other, seen a little from above, reach 5 px under. Chosen on the studio's tuning half."""
FREE = 0.25
"""Of a full turn: what must be seen of a circle's border that it is known to go on."""
ROUND = 0.04
"""Of its radius, `COARSE` px at least: how far the border of a round thing that is seen may lie off its circle."""
COARSE = 0.8
FITS = 0.95
"""Of the border that is seen: what lies so near to the circle."""
OPEN = 0.04
"""Of a circle: what of it may show the background, where the thing would be if it went on."""
FILLED = 0.8
"""Of a bay or a hole: what another thing fills of it."""
WHOLE = 0.97
"""Of its circle: what is seen of a round thing that nothing hides."""
TWICE = 2.0
"""How much deeper one of two must reach under the other, where each seems to reach under the other."""
NEAR = 2.6
"""px between borders that two things share."""


@dataclass(frozen=True)
class OcclusionOrder:
    """One thing before another."""

    front: int
    """Its id."""
    behind: int
    """Likewise."""
    confidence: float
    """0..1."""


def occlusion_orders(labels: Labels, ids: Sequence[int]) -> list[OcclusionOrder]:
    """What hides a part of what, the surest first."""
    found = []
    for i, j in touching_masks(labels, ids):
        part, inner = _window(labels, i, j)
        size = min(float(np.sqrt((part == k).sum())) for k in (i, j))
        under = [_under(part, inner, i, j), _under(part, inner, j, i)]
        deep = max(under)
        if deep < max(DEEP, PART * size) or deep < TWICE * min(under):
            continue
        front, behind = (j, i) if under[0] > under[1] else (i, j)
        found.append(OcclusionOrder(front, behind, round(min(0.5 + 0.4 * deep / size, 0.9), 2)))
    return sorted(found, key=lambda order: (-order.confidence, order.front, order.behind))


def drawing_layers(
    found: Sequence[OcclusionOrder], fixed: Mapping[int, int] | None = None
) -> tuple[dict[int, int], list[OcclusionOrder]]:
    """The layers of all things in `found` that are not 0, by id, and the orders that they keep.

    Orders that would close a ring are left out, the least sure first. Layers that are `fixed` stay, whatever is found.
    """
    before: dict[int, set[int]] = {}
    kept: list[OcclusionOrder] = []
    for order in sorted(found, key=lambda one: -one.confidence):
        if order.front in _all_behind(order.behind, before) or order.front == order.behind:
            continue
        before.setdefault(order.front, set()).add(order.behind)
        kept.append(order)
    level = dict(fixed or {})

    def of(i: int) -> int:
        if i not in level:
            level[i] = max((of(k) + 1 for k in before.get(i, ())), default=0)
        return level[i]

    told = {i: of(i) for one in kept for i in (one.front, one.behind)}
    return {i: k for i, k in told.items() if k and i not in (fixed or {})}, kept


def _all_behind(start: int, before: Mapping[int, set[int]]) -> set[int]:
    """What lies behind a thing, and behind that, and so on."""
    seen: set[int] = set()
    left = [start]
    while left:
        for i in before.get(left.pop(), set()) - seen:
            seen.add(i)
            left.append(i)
    return seen


def _under(part: Labels, inner: Mask, i: int, j: int) -> float:
    """px by which thing i seems to reach under thing j."""
    mine, other = part == i, part == j
    deep = _bay(mine, other)
    if (circle := _circle(part, inner, i)) is not None:
        off = circle[2] - _far(circle, other.shape)
        if ((off > 0) & (part == 0) & inner).sum() <= OPEN * np.pi * circle[2] ** 2:
            deep = max(deep, float(off[other].max()))
    if (circle := _circle(part, inner, j)) is not None:
        within = _far(circle, other.shape) <= circle[2]
        if (within & other).sum() >= WHOLE * (within & inner).sum():
            deep = max(deep, _sag(mine, other))
    return deep


def _bay(mine: Mask, other: Mask) -> float:
    """px by which another thing reaches into the hull of one, in bays and holes that it fills."""
    hull = np.zeros(mine.shape, np.uint8)
    cv2.fillConvexPoly(hull, cv2.convexHull(np.argwhere(mine)[:, ::-1].astype(np.int32)), 1)
    within = cv2.distanceTransform(np.pad(hull, 1), cv2.DIST_L2, 5)[1:-1, 1:-1]
    count, bays, stats, _ = cv2.connectedComponentsWithStats(
        ((hull > 0) & ~mine).astype(np.uint8), connectivity=4
    )
    filled = np.bincount(bays[other], minlength=count) >= FILLED * stats[:, cv2.CC_STAT_AREA]
    filled[0] = False
    reached = within[filled[bays] & other]
    return float(reached.max()) if len(reached) else 0.0


def _circle(part: Labels, inner: Mask, i: int) -> Array | None:
    """`(3,)` px: x, y, radius of the circle that the free border of a thing lies on; None where it lies on none."""
    border = long_border(part == i)
    free = border[(_gap((part != 0) & (part != i), border) > NEAR) & (_gap(~inner, border) > NEAR)]
    if len(free) < 12:
        return None
    circle = robust_circle(free)
    x, y = (free - circle[:2]).T
    seen = np.unique((np.arctan2(y, x) * 36 / np.pi).astype(int))
    off = np.abs(np.hypot(x, y) - circle[2])
    fits = float((off <= max(COARSE, ROUND * circle[2])).mean())
    return circle if len(seen) >= FREE * 72 and fits >= FITS else None


def _sag(mine: Mask, other: Mask) -> float:
    """px by which the border that another thing shares with one bulges into it."""
    border = long_border(other)
    shared = _gap(mine, border) <= NEAR
    if shared.all():
        return float(np.ptp(border, axis=0).min())
    order = np.roll(np.arange(len(border)), -int(np.argmin(shared)))
    along = np.flatnonzero(shared[order])
    if not len(along):
        return 0.0
    run = max(np.split(along, np.flatnonzero(np.diff(along) > 5) + 1), key=len)
    points = border[order[run]]
    chord = points[-1] - points[0]
    off = np.abs((points - points[0]) @ [-chord[1], chord[0]]) / max(float(np.hypot(*chord)), 1e-9)
    return float(off.max())


def _far(circle: Array, shape: tuple[int, ...]) -> Array:
    """(h, w) px from the centre of a circle."""
    y, x = np.ogrid[: shape[0], : shape[1]]
    return np.asarray(np.hypot(x - circle[0], y - circle[1]))


def _gap(mask: Mask, points: Array) -> Array:
    """`(N,)` px from points `(N, 2)` to a mask; far where it is empty."""
    if not mask.any():
        return np.full(len(points), np.inf)
    away = cv2.distanceTransform((~mask).astype(np.uint8), cv2.DIST_L2, 5)
    column, row = np.clip(np.round(points).astype(np.intp), 0, np.array(mask.shape[::-1]) - 1).T
    return np.asarray(away[row, column], np.float64)


def _window(labels: Labels, i: int, j: int) -> tuple[Labels, Mask]:
    """The label map around two things, and what of it lies within the photo."""
    rows, columns = np.nonzero((labels == i) | (labels == j))
    # a circle may reach farther than what is seen of it
    margin = max(int(np.ptp(rows)), int(np.ptp(columns))) // 2 + 4
    cut = np.s_[
        max(rows.min() - margin, 0) : rows.max() + margin + 1,
        max(columns.min() - margin, 0) : columns.max() + margin + 1,
    ]
    part = np.pad(labels[cut], 2)
    inner = np.pad(np.ones(labels[cut].shape, bool), 2)
    return part, inner
