"""Occlusion order of objects, and the layers in which they are drawn.

A hidden part follows from the continuation of the visible outline: a round object's
circle, or the hull that closes a bay or a hole, continues under the object in front
(amodal completion, Kanizsa 1979). A common border of two objects belongs to the nearer
one and therefore follows that object's smooth outline. If two objects only touch, no
part is hidden.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.geometry.circles import robust_circle
from physgen.geometry.fitting import long_border, touching_masks
from physgen.geometry.polygon import Array
from physgen.perceive.roles import Labels, Mask

Box = tuple[int, int, int, int]
"""x, y, width and height, px."""


@dataclass(frozen=True)
class _Limits:
    """Limits of occlusion; px unless stated."""

    # Least depth of an object under another, and at least ...
    least_depth: float = 6.0
    # ... this share of the smaller object's size. True masks of stacked objects seen
    # slightly from above overlap by 5 px (chosen on the studio's tuning half).
    part: float = 0.1
    # Least ratio of both depths if each object seems to reach under the other.
    depth_ratio: float = 2.0
    # Least visible part of a circle's border, as a share of a full turn.
    free_arc: float = 0.25
    # Largest distance of a round object's border from its circle, as a share of the
    # radius, and at least ...
    circle_deviation: float = 0.04
    # ... this distance.
    least_deviation: float = 0.8
    # Least share of the visible border within that distance.
    fits: float = 0.95
    # Largest share of background in a circle in place of the object.
    open: float = 0.04
    # Least share of a bay or hole that another object fills.
    filled_share: float = 0.8
    # Least visible share of the circle of a round object in front.
    circle_share: float = 0.97
    # Largest distance between common borders of two objects.
    border_distance: float = 2.6


LIMITS = _Limits()


@dataclass(frozen=True)
class OcclusionOrder:
    """An object in front of another, by their ids."""

    front: int
    back: int
    confidence: float  # 0..1


def occlusion_orders(labels: Labels, ids: Sequence[int]) -> list[OcclusionOrder]:
    """Return pairs of objects in which one hides a part of the other, most confident
    first.

    The result of the last label map is cached, since outlines and layers both use it.
    """
    return list(
        _find_orders(labels.tobytes(), labels.shape, labels.dtype.str, tuple(ids))
    )


@lru_cache(maxsize=1)
def _find_orders(
    numbers: bytes, shape: tuple[int, ...], kind: str, ids: tuple[int, ...]
) -> list[OcclusionOrder]:
    """Return the occlusion orders of a label map given as bytes."""
    labels: Labels = np.frombuffer(numbers, kind).reshape(shape)
    touching = touching_masks(labels, ids)
    boxes = {i: _box_of(labels, i) for i in {i for pair in touching for i in pair}}
    circles = {i: _free_circle(labels, i, box) for i, box in boxes.items()}
    orders = []
    for i, j in touching:
        order = _order_pair(labels, (i, j), boxes, circles)
        if order is not None:
            orders.append(order)
    return sorted(
        orders, key=lambda order: (-order.confidence, order.front, order.back)
    )


def _order_pair(
    labels: Labels,
    pair: tuple[int, int],
    boxes: Mapping[int, Box],
    circles: Mapping[int, Array | None],
) -> OcclusionOrder | None:
    """Return the order of two objects that touch, or None if none hides the other.

    `circles` are those of their free borders.
    """
    i, j = pair
    part, inner, corner = _window(labels, _box_around([boxes[i], boxes[j]]))
    size = min(float(np.sqrt((part == k).sum())) for k in pair)
    window_circles = {
        k: None if (circle := circles[k]) is None else circle - corner for k in pair
    }
    first_depth = _reach_under(part, inner, window_circles, i, j)
    second_depth = _reach_under(part, inner, window_circles, j, i)
    depth = max(first_depth, second_depth)
    # The depth must be large for the objects' size, and clearly larger than the
    # opposite depth.
    if depth < max(LIMITS.least_depth, LIMITS.part * size):
        return None
    if depth < LIMITS.depth_ratio * min(first_depth, second_depth):
        return None
    confidence = round(min(0.5 + 0.4 * depth / size, 0.9), 2)
    if first_depth > second_depth:
        return OcclusionOrder(j, i, confidence)
    return OcclusionOrder(i, j, confidence)


def drawing_layers(
    orders: Sequence[OcclusionOrder], fixed_layers: Mapping[int, int] | None = None
) -> tuple[dict[int, int], list[OcclusionOrder]]:
    """Return the layers of all objects in `orders` that are not 0, by id, and their
    orders.

    Orders that would close a cycle are dropped, the least confident first. `fixed_layers`
    layers stay.
    """
    before: dict[int, set[int]] = {}
    kept_orders: list[OcclusionOrder] = []
    for order in sorted(orders, key=lambda one: -one.confidence):
        if (
            order.front in _collect_objects_behind(order.back, before)
            or order.front == order.back
        ):
            continue
        before.setdefault(order.front, set()).add(order.back)
        kept_orders.append(order)
    level = dict(fixed_layers or {})

    def layer(i: int) -> int:
        if i not in level:
            level[i] = max((layer(k) + 1 for k in before.get(i, ())), default=0)
        return level[i]

    layers = {i: layer(i) for one in kept_orders for i in (one.front, one.back)}
    return {
        i: k for i, k in layers.items() if k and i not in (fixed_layers or {})
    }, kept_orders


def _collect_objects_behind(start: int, before: Mapping[int, set[int]]) -> set[int]:
    """Return all objects behind an object, directly or through others."""
    ids: set[int] = set()
    left = [start]
    while left:
        for i in before.get(left.pop(), set()) - ids:
            ids.add(i)
            left.append(i)
    return ids


def _reach_under(
    part: Labels, inner: Mask, circles: Mapping[int, Array | None], i: int, j: int
) -> float:
    """Return the apparent depth of object i under object j, px.

    `circles` are the circles of their free borders.
    """
    mask = part == i
    other = part == j
    depth = _filled_bay(mask, other)
    if (circle := circles[i]) is not None:
        rim_depth = circle[2] - _distance(circle, other.shape)
        # The circle may continue under j only, not over visible background.
        if (
            (rim_depth > 0) & (part == 0) & inner
        ).sum() <= LIMITS.open * np.pi * circle[2] ** 2:
            depth = max(depth, float(rim_depth[other].max()))
    if (circle := circles[j]) is not None:
        in_circle = _distance(circle, other.shape) <= circle[2]
        # If j is a complete circle, a common border that bulges into i belongs to j.
        if (in_circle & other).sum() >= LIMITS.circle_share * (in_circle & inner).sum():
            depth = max(depth, _bulge(mask, other))
    return depth


def _filled_bay(mask: Mask, other: Mask) -> float:
    """Return the depth of an object inside the hull of another, px.

    Only bays and holes filled by the first object count.
    """
    # The hull lies in the box of the object, so nothing beyond the box counts.
    box = _slices_around(mask)
    mask = mask[box]
    other = other[box]
    hull = np.zeros(mask.shape, np.uint8)
    cv2.fillConvexPoly(hull, cv2.convexHull(_row_ends(mask)), 1)
    hull_depth = cv2.distanceTransform(np.pad(hull, 1), cv2.DIST_L2, 5)[1:-1, 1:-1]
    open_ = ((hull > 0) & ~mask).astype(np.uint8)
    count, bays, stats, _ = cv2.connectedComponentsWithStats(open_, connectivity=4)
    is_filled = (
        np.bincount(bays[other], minlength=count)
        >= LIMITS.filled_share * stats[:, cv2.CC_STAT_AREA]
    )
    is_filled[0] = False
    depths = hull_depth[is_filled[bays] & other]
    if len(depths):
        return float(depths.max())
    return 0.0


def _slices_around(mask: Mask) -> tuple[slice, slice]:
    """Return the rows and the columns of the box around a mask."""
    column, row, width, height = cv2.boundingRect(mask.view(np.uint8))
    return slice(row, row + height), slice(column, column + width)


def _row_ends(mask: Mask) -> NDArray[np.int32]:
    """Return the first and the last pixel (x, y) of each row of a mask, `(N, 2)` px.

    They have the hull of the whole mask, and are far fewer than its pixels.
    """
    rows = np.flatnonzero(mask.any(axis=1))
    first = mask[rows].argmax(axis=1)
    last = mask.shape[1] - 1 - mask[rows, ::-1].argmax(axis=1)
    columns = np.concatenate([first, last])
    return np.column_stack([columns, np.tile(rows, 2)]).astype(np.int32)


def _free_circle(labels: Labels, i: int, box: Box) -> Array | None:
    """Return the circle (x, y, radius; px) of an object's free border, or None."""
    part, inner, corner = _window(labels, box)
    border = long_border(part == i)
    others = (part != 0) & (part != i)
    free = border[
        (_gap(others, border) > LIMITS.border_distance)
        & (_gap(~inner, border) > LIMITS.border_distance)
    ]
    if len(free) < 12:
        return None
    circle = robust_circle(free)
    x, y = (free - circle[:2]).T
    angles = np.unique((np.arctan2(y, x) * 36 / np.pi).astype(int))
    distances = np.abs(np.hypot(x, y) - circle[2])
    fits = float(
        (
            distances
            <= max(LIMITS.least_deviation, LIMITS.circle_deviation * circle[2])
        ).mean()
    )
    if len(angles) >= LIMITS.free_arc * 72 and fits >= LIMITS.fits:
        return circle + corner
    return None


def _bulge(mask: Mask, other: Mask) -> float:
    """Return the bulge of the common border of two objects into the first one, px."""
    border = long_border(other)
    is_common = _gap(mask, border) <= LIMITS.border_distance
    if is_common.all():
        return float(np.ptp(border, axis=0).min())
    # Start outside the common border, so that each common stretch is contiguous.
    order = np.roll(np.arange(len(border)), -int(np.argmin(is_common)))
    common_points = np.flatnonzero(is_common[order])
    if not len(common_points):
        return 0.0
    run = max(
        np.split(common_points, np.flatnonzero(np.diff(common_points) > 5) + 1), key=len
    )
    points = border[order[run]]
    chord = points[-1] - points[0]
    distances = np.abs((points - points[0]) @ [-chord[1], chord[0]]) / max(
        float(np.hypot(*chord)), 1e-9
    )
    return float(distances.max())


def _distance(circle: Array, shape: tuple[int, ...]) -> Array:
    """Return the distance (h, w) from the centre of a circle, px."""
    y, x = np.ogrid[: shape[0], : shape[1]]
    return np.asarray(np.hypot(x - circle[0], y - circle[1]))


def _gap(mask: Mask, points: Array) -> Array:
    """Return the distance `(N,)` from points `(N, 2)` to a mask, px; infinite if it is
    empty.
    """
    if not mask.any():
        return np.full(len(points), np.inf)
    distance = cv2.distanceTransform((~mask).astype(np.uint8), cv2.DIST_L2, 5)
    column, row = np.clip(
        np.round(points).astype(np.intp), 0, np.array(mask.shape[::-1]) - 1
    ).T
    return np.asarray(distance[row, column], np.float64)


def _box_of(labels: Labels, i: int) -> Box:
    """Return x, y, width and height of the box around an object, px."""
    x, y, width, height = cv2.boundingRect((labels == i).view(np.uint8))
    return x, y, width, height


def _box_around(boxes: Sequence[Box]) -> Box:
    """Return the box around boxes."""
    left = min(box[0] for box in boxes)
    top = min(box[1] for box in boxes)
    right = max(box[0] + box[2] for box in boxes)
    bottom = max(box[1] + box[3] for box in boxes)
    return left, top, right - left, bottom - top


def _window(labels: Labels, box: Box) -> tuple[Labels, Mask, Array]:
    """Return the label map around a box, its pixels inside the photo, and its corner
    (x, y, 0).
    """
    x, y, width, height = box
    # A circle may reach farther than its visible part.
    margin = (max(width, height) - 1) // 2 + 4
    top = max(y - margin, 0)
    left = max(x - margin, 0)
    cut = labels[top : y + height + margin, left : x + width + margin]
    return (
        np.pad(cut, 2),
        np.pad(np.ones(cut.shape, bool), 2),
        np.array([left - 2, top - 2, 0.0]),
    )
