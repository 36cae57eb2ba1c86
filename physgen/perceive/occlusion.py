"""Occlusion order of objects, and the layers to draw them in.

A hidden part follows from how its outline would go on: a round object's circle, or the
hull that closes a bay or a hole, passes under what lies in front (amodal completion,
Kanizsa 1979). A border that two objects share belongs to the nearer one, so it follows
that one's own smooth outline. Where two objects just touch, nothing is hidden.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np

from physgen.geometry.circles import robust_circle
from physgen.geometry.fitting import long_border, touching_masks
from physgen.geometry.polygon import Array
from physgen.perceive.roles import Labels, Mask

Box = tuple[int, int, int, int]
"""x, y, width and height, px."""


@dataclass(frozen=True)
class _Limits:
    """When an object reaches under another; px unless stated."""

    deep: float = 6.0  # and at least ...
    # ... this share of the smaller object's size: true masks of objects on each other,
    part: float = 0.1
    # seen a little from above, reach 5 px under (chosen on the studio's tuning half)
    # how much deeper one of two must reach, where each seems to reach under the other
    twice: float = 2.0
    # of a full turn: what must be seen of a circle's border that it is known to go on
    free_arc: float = 0.25
    rounded: float = 0.04  # of its radius, and at least ...
    # ... this: by how much the border of a round object may lie off its circle
    coarse: float = 0.8
    fits: float = 0.95  # share of the seen border that lies so near to the circle
    # share of a circle that may show the background, where the object would be if it went on
    open: float = 0.04
    filled: float = 0.8  # share of a bay or a hole that another object fills
    whole: float = 0.97  # share of its circle that is seen of a round object in front
    near: float = 2.6  # between borders that two objects share


LIMITS = _Limits()


@dataclass(frozen=True)
class OcclusionOrder:
    """One object in front of another, by their ids."""

    front: int
    behind: int
    confidence: float  # 0..1


def occlusion_orders(labels: Labels, ids: Sequence[int]) -> list[OcclusionOrder]:
    """Pairs where one object hides a part of the other, the surest first.

    Those of the last labels are kept, since outlines and layers need them.
    """
    return list(
        _find_orders(labels.tobytes(), labels.shape, labels.dtype.str, tuple(ids))
    )


@lru_cache(maxsize=1)
def _find_orders(
    numbers: bytes, shape: tuple[int, ...], kind: str, ids: tuple[int, ...]
) -> list[OcclusionOrder]:
    labels: Labels = np.frombuffer(numbers, kind).reshape(shape)
    found = []
    touching = touching_masks(labels, ids)
    boxes = {i: _box_of(labels, i) for i in {i for pair in touching for i in pair}}
    free = {i: _free_circle(labels, i, box) for i, box in boxes.items()}
    for i, j in touching:
        part, inner, corner = _window(labels, _box_around([boxes[i], boxes[j]]))
        size = min(float(np.sqrt((part == k).sum())) for k in (i, j))
        circles = {
            k: None if (circle := free[k]) is None else circle - corner for k in (i, j)
        }
        under = [_reach_under(part, inner, circles, a, b) for a, b in ((i, j), (j, i))]
        deep = max(under)
        if deep < max(LIMITS.deep, LIMITS.part * size) or deep < LIMITS.twice * min(
            under
        ):
            continue
        front, behind = (j, i) if under[0] > under[1] else (i, j)
        found.append(
            OcclusionOrder(front, behind, round(min(0.5 + 0.4 * deep / size, 0.9), 2))
        )
    return sorted(
        found, key=lambda order: (-order.confidence, order.front, order.behind)
    )


def drawing_layers(
    found: Sequence[OcclusionOrder], fixed: Mapping[int, int] | None = None
) -> tuple[dict[int, int], list[OcclusionOrder]]:
    """Return the layers of all objects in `found` that are not 0, by id, and the orders
    that they keep.

    Orders that would close a ring are left out, the least sure first. `fixed` layers
    stay.
    """
    before: dict[int, set[int]] = {}
    kept: list[OcclusionOrder] = []
    for order in sorted(found, key=lambda one: -one.confidence):
        if (
            order.front in _all_behind(order.behind, before)
            or order.front == order.behind
        ):
            continue
        before.setdefault(order.front, set()).add(order.behind)
        kept.append(order)
    level = dict(fixed or {})

    def layer(i: int) -> int:
        if i not in level:
            level[i] = max((layer(k) + 1 for k in before.get(i, ())), default=0)
        return level[i]

    layers = {i: layer(i) for one in kept for i in (one.front, one.behind)}
    return {i: k for i, k in layers.items() if k and i not in (fixed or {})}, kept


def _all_behind(start: int, before: Mapping[int, set[int]]) -> set[int]:
    """Objects behind an object, and behind those, and so on."""
    seen: set[int] = set()
    left = [start]
    while left:
        for i in before.get(left.pop(), set()) - seen:
            seen.add(i)
            left.append(i)
    return seen


def _reach_under(
    part: Labels, inner: Mask, circles: Mapping[int, Array | None], i: int, j: int
) -> float:
    """px by which object i seems to reach under object j; `circles` are those of their
    free borders.
    """
    mine, other = part == i, part == j
    deep = _filled_bay(mine, other)
    if (circle := circles[i]) is not None:
        off = circle[2] - _distance(circle, other.shape)
        if ((off > 0) & (part == 0) & inner).sum() <= LIMITS.open * np.pi * circle[
            2
        ] ** 2:
            deep = max(deep, float(off[other].max()))
    if (circle := circles[j]) is not None:
        within = _distance(circle, other.shape) <= circle[2]
        if (within & other).sum() >= LIMITS.whole * (within & inner).sum():
            deep = max(deep, _bulge(mine, other))
    return deep


def _filled_bay(mine: Mask, other: Mask) -> float:
    """px by which another object reaches into the hull of one, in bays and holes that
    it fills.
    """
    hull = np.zeros(mine.shape, np.uint8)
    cv2.fillConvexPoly(
        hull, cv2.convexHull(np.argwhere(mine)[:, ::-1].astype(np.int32)), 1
    )
    within = cv2.distanceTransform(np.pad(hull, 1), cv2.DIST_L2, 5)[1:-1, 1:-1]
    open_ = ((hull > 0) & ~mine).astype(np.uint8)
    count, bays, stats, _ = cv2.connectedComponentsWithStats(open_, connectivity=4)
    filled = (
        np.bincount(bays[other], minlength=count)
        >= LIMITS.filled * stats[:, cv2.CC_STAT_AREA]
    )
    filled[0] = False
    reached = within[filled[bays] & other]
    return float(reached.max()) if len(reached) else 0.0


def _free_circle(labels: Labels, i: int, box: Box) -> Array | None:
    """`(3,)` px: x, y, radius of the circle that the free border of an object lies on;
    None where it lies on none.
    """
    part, inner, corner = _window(labels, box)
    border = long_border(part == i)
    others = (part != 0) & (part != i)
    free = border[
        (_gap(others, border) > LIMITS.near) & (_gap(~inner, border) > LIMITS.near)
    ]
    if len(free) < 12:
        return None
    circle = robust_circle(free)
    x, y = (free - circle[:2]).T
    seen = np.unique((np.arctan2(y, x) * 36 / np.pi).astype(int))
    off = np.abs(np.hypot(x, y) - circle[2])
    fits = float((off <= max(LIMITS.coarse, LIMITS.rounded * circle[2])).mean())
    return (
        circle + corner
        if len(seen) >= LIMITS.free_arc * 72 and fits >= LIMITS.fits
        else None
    )


def _bulge(mine: Mask, other: Mask) -> float:
    """px by which the border that another object shares with one bulges into it."""
    border = long_border(other)
    shared = _gap(mine, border) <= LIMITS.near
    if shared.all():
        return float(np.ptp(border, axis=0).min())
    order = np.roll(np.arange(len(border)), -int(np.argmin(shared)))
    along = np.flatnonzero(shared[order])
    if not len(along):
        return 0.0
    run = max(np.split(along, np.flatnonzero(np.diff(along) > 5) + 1), key=len)
    points = border[order[run]]
    chord = points[-1] - points[0]
    off = np.abs((points - points[0]) @ [-chord[1], chord[0]]) / max(
        float(np.hypot(*chord)), 1e-9
    )
    return float(off.max())


def _distance(circle: Array, shape: tuple[int, ...]) -> Array:
    """(h, w) px from the centre of a circle."""
    y, x = np.ogrid[: shape[0], : shape[1]]
    return np.asarray(np.hypot(x - circle[0], y - circle[1]))


def _gap(mask: Mask, points: Array) -> Array:
    """`(N,)` px from points `(N, 2)` to a mask; infinite where it is empty."""
    if not mask.any():
        return np.full(len(points), np.inf)
    away = cv2.distanceTransform((~mask).astype(np.uint8), cv2.DIST_L2, 5)
    column, row = np.clip(
        np.round(points).astype(np.intp), 0, np.array(mask.shape[::-1]) - 1
    ).T
    return np.asarray(away[row, column], np.float64)


def _box_of(labels: Labels, i: int) -> Box:
    """Return x, y, width and height of the box around an object, px."""
    x, y, width, height = cv2.boundingRect((labels == i).view(np.uint8))
    return x, y, width, height


def _box_around(boxes: Sequence[Box]) -> Box:
    """Return the box around boxes."""
    left, top = min(box[0] for box in boxes), min(box[1] for box in boxes)
    right = max(box[0] + box[2] for box in boxes)
    bottom = max(box[1] + box[3] for box in boxes)
    return left, top, right - left, bottom - top


def _window(labels: Labels, box: Box) -> tuple[Labels, Mask, Array]:
    """Return the label map around a box, the part of it within the photo, and where it
    begins: x, y, 0.
    """
    x, y, width, height = box
    # a circle may reach farther than what is seen of it
    margin = (max(width, height) - 1) // 2 + 4
    top, left = max(y - margin, 0), max(x - margin, 0)
    cut = labels[top : y + height + margin, left : x + width + margin]
    return (
        np.pad(cut, 2),
        np.pad(np.ones(cut.shape, bool), 2),
        np.array([left - 2, top - 2, 0.0]),
    )
