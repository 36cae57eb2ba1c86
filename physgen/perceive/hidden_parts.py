"""Outlines of objects continued behind others.

The engine needs outlines without overlap; the renderer needs the complete object,
because the object in front moves away. A ball or a fruit is a circle through its
visible border, and other round objects are ellipses. Otherwise the hull closes a bay
that another object fills.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
import shapely

from physgen.geometry.circles import robust_circle
from physgen.geometry.fitting import fit_outlines, long_border, touching_masks
from physgen.geometry.polygon import Array, Disc, Outline
from physgen.materials import kind
from physgen.perceive.occlusion import OcclusionOrder, drawing_layers, occlusion_orders
from physgen.perceive.roles import Labels, Mask, PhotoObject

ROLLING_FORMS = ("ball", "lump")
"""Values of `materials.Kind.form` of objects with about equal depth, width and
height.
"""


@dataclass(frozen=True)
class HiddenConstants:
    """Constants of continued outlines, tuned on apples and toys by eye."""

    # px: a border this near to another object may belong to that object.
    border_distance: float = 3.0
    # Least number of points of a visible border.
    points: int = 24
    # Least visible part of a circle's border, as a share of a turn.
    arc: float = 0.3
    # The same for an ellipse.
    ellipse_arc: float = 0.45
    # Largest distance of a fruit's border from its circle, as a share of the radius.
    lumpy: float = 0.09
    # Least share of the border within that distance.
    fits: float = 0.8
    # Largest distance of a border from its ellipse, as a share of the size.
    deviation: float = 0.03
    # Largest share of background in a circle.
    open: float = 0.08
    # Least completed hidden area, as a share of the object's area.
    least_share: float = 0.02
    # The same as a share of a ball's disc: a bite is visible on a round outline.
    least_of_ball: float = 0.004
    # Largest hidden area as a multiple of the visible area; more would be a guess.
    largest_share: float = 1.5
    # Least share of a bay filled by objects in front.
    bay: float = 0.8
    # Least remaining share of a ball's radius between touching neighbours.
    smallest: float = 0.6
    # Displacement by neighbours from which a ball returns to its border, in radii.
    displacement: float = 0.06


HIDDEN = HiddenConstants()


def continue_outlines(
    labels: Labels, objects: Sequence[PhotoObject]
) -> tuple[list[PhotoObject], dict[int, Outline]]:
    """Return the objects, with hidden balls as discs, and full outlines by id.

    An object has a full outline if other objects hide a part of it.
    """
    ids = [item.id for item in objects]
    _, orders = drawing_layers(occlusion_orders(labels, ids), {})
    fronts = with_neighbours_of_balls(fronts_of(orders), labels, objects)
    wholes: dict[int, Outline] = {}
    result = list(objects)
    for place, item in enumerate(objects):
        if item.id not in fronts or item.cut:
            continue
        full_outline = _whole_outline(labels, item, fronts[item.id])
        if full_outline is not None:
            wholes[item.id] = full_outline
        circle = full_outline
        if not isinstance(full_outline, Disc):
            circle = _border_circle(labels, item, fronts[item.id])
        # The engine gets a disc without overlap, the renderer the full outline.
        if isinstance(circle, Disc):
            others = []
            for other in result:
                if other.id != item.id:
                    others.append(other)
            disc = _free_disc(circle, others)
            if disc is not None:
                result[place] = replace(item, outline=disc)
    return result, wholes


def _border_circle(labels: Labels, item: PhotoObject, fronts: set[int]) -> Disc | None:
    """Return the circle of a ball's border if neighbours displaced its disc, else None.

    The fit moves the discs of touching balls together, which distorts lumpy fruit.
    """
    disc = item.outline
    if not isinstance(disc, Disc) or kind(item.label).form not in ROLLING_FORMS:
        return None
    window, corner = _window(labels, item.id)
    mask = window == item.id
    border = _free_border(mask, window)
    if len(border) < HIDDEN.points:
        return None
    circle = _circle(border, mask, np.isin(window, list(fronts)))
    if circle is None:
        return None
    center = circle.center + corner
    shift = float(np.hypot(*(center - disc.center)))
    if shift <= max(HIDDEN.border_distance, HIDDEN.displacement * circle.radius):
        return None
    return Disc(center, circle.radius)


def with_neighbours_of_balls(
    fronts: Mapping[int, set[int]], labels: Labels, objects: Sequence[PhotoObject]
) -> dict[int, set[int]]:
    """Return the fronts, with all neighbours of each ball added.

    The ball's circle shows its hidden part even if the order of two objects is
    uncertain.
    """
    result = {i: set(front) for i, front in fronts.items()}
    balls = set()
    for item in objects:
        if kind(item.label).form in ROLLING_FORMS:
            balls.add(item.id)
    for i, j in touching_masks(labels, [item.id for item in objects]):
        for ball, other in ((i, j), (j, i)):
            if ball in balls:
                result.setdefault(ball, set()).add(other)
    return result


def fronts_of(orders: Sequence[OcclusionOrder]) -> Mapping[int, set[int]]:
    """Return the ids of the objects that hide each object."""
    fronts: dict[int, set[int]] = {}
    for order in orders:
        fronts.setdefault(order.back, set()).add(order.front)
    return fronts


def _whole_outline(
    labels: Labels, item: PhotoObject, fronts: set[int]
) -> Outline | None:
    """Return the outline with its hidden part, or None."""
    window, corner = _window(labels, item.id)
    mask = window == item.id
    front_mask = np.isin(window, list(fronts))
    border = _free_border(mask, window)
    if len(border) < HIDDEN.points:
        return None
    is_ball = kind(item.label).form in ROLLING_FORMS
    if is_ball:
        disc = _circle(border, mask, front_mask)
        if disc is None or _hidden_share(disc, mask, front_mask) < HIDDEN.least_of_ball:
            return None
        return Disc(disc.center + corner, disc.radius)
    hidden_part = _ellipse(border, mask, front_mask)
    if hidden_part is None:
        hidden_part = _bays(mask, front_mask)
    full_mask = mask | (hidden_part & front_mask)
    hidden_area = np.count_nonzero(full_mask) - np.count_nonzero(mask)
    area = np.count_nonzero(mask)
    if not HIDDEN.least_share * area <= hidden_area <= HIDDEN.largest_share * area:
        return None
    photo_mask = _paste(full_mask, corner, labels.shape)
    return fit_outlines(photo_mask, [1], never_discs=[1])[1]


def _paste(mask: Mask, corner: Array, shape: tuple[int, ...]) -> Labels:
    """Return a mask whose first pixel is at a corner (x, y px) as a label map.

    The mask may leave the photo; only the pixels inside remain.
    """
    labels = np.zeros(shape, np.uint16)
    rows, columns = np.nonzero(mask)
    rows = rows + int(corner[1])
    columns = columns + int(corner[0])
    is_inside = (rows >= 0) & (rows < shape[0])
    is_inside &= (columns >= 0) & (columns < shape[1])
    labels[rows[is_inside], columns[is_inside]] = 1
    return labels


def _window(labels: Labels, i: int) -> tuple[Labels, Array]:
    """Return the label map around an object, and the position of its corner, px."""
    x, y, width, height = cv2.boundingRect((labels == i).astype(np.uint8))
    margin = max(width, height) // 2 + 6
    padded_labels = np.pad(labels, margin)
    part = padded_labels[y : y + height + 2 * margin, x : x + width + 2 * margin]
    return part, np.array([x - margin, y - margin], np.float64)


def _free_border(mask: Mask, window: Labels) -> Array:
    """Return the border `(N, 2)` away from other objects, px."""
    border = long_border(mask)
    others = ((window != 0) & ~mask).astype(np.uint8)
    if not others.any():
        return border
    distance = cv2.distanceTransform(1 - others, cv2.DIST_L2, 5)
    columns = np.clip(np.rint(border[:, 0]).astype(int), 0, mask.shape[1] - 1)
    rows = np.clip(np.rint(border[:, 1]).astype(int), 0, mask.shape[0] - 1)
    is_free = distance[rows, columns] > HIDDEN.border_distance
    return np.asarray(border[is_free], np.float64)


def _covered_turn(border: Array, center: Array) -> float:
    """Return the share of a turn about a centre in which a border is visible."""
    x, y = (border - center).T
    steps = np.unique((np.arctan2(y, x) * 36 / np.pi).astype(int))
    return len(steps) / 72


def _circle(border: Array, mask: Mask, front_mask: Mask) -> Disc | None:
    """Return the circle of a ball or a fruit, or None."""
    circle = robust_circle(border)
    center = circle[:2]
    radius = float(circle[2])
    distances = np.abs(np.hypot(*(border - center).T) - radius)
    fits = float((distances <= max(1.0, HIDDEN.lumpy * radius)).mean())
    if fits < HIDDEN.fits or _covered_turn(border, center) < HIDDEN.arc:
        return None
    rows, columns = np.indices(mask.shape)
    inside = np.hypot(columns - center[0], rows - center[1]) <= radius
    if (inside & ~mask & ~front_mask).sum() > HIDDEN.open * np.pi * radius**2:
        return None
    return Disc(center, radius)


def _hidden_share(disc: Disc, mask: Mask, front_mask: Mask) -> float:
    """Return the share of a disc behind objects in front."""
    rows, columns = np.indices(mask.shape)
    distance = np.hypot(columns - disc.center[0], rows - disc.center[1])
    inside = distance <= disc.radius
    return float((inside & front_mask).sum() / max(inside.sum(), 1))


def _ellipse(border: Array, mask: Mask, front_mask: Mask) -> Mask | None:
    """Return the pixels of an ellipse through the border, or None."""
    (x, y), axes, angle = cv2.fitEllipseAMS(border.astype(np.float32))
    size = float(min(axes)) / 2
    if not np.isfinite([x, y, *axes]).all() or not 2 < size < max(mask.shape):
        return None
    if max(axes) > 2 * max(mask.shape):
        return None
    if _covered_turn(border, np.array([x, y])) < HIDDEN.ellipse_arc:
        return None
    turn = np.radians(angle)
    axes_matrix = np.array(
        [[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]]
    )
    unit_points = (border - [x, y]) @ axes_matrix.T / (np.array(axes) / 2)
    distances = np.abs(np.hypot(*unit_points.T) - 1)
    if float(np.quantile(distances, HIDDEN.fits)) > HIDDEN.deviation:
        return None
    ellipse_mask = np.zeros(mask.shape, np.uint8)
    cv2.ellipse(ellipse_mask, ((x, y), axes, angle), 1, -1)
    inside = ellipse_mask > 0
    open_ = (inside & ~mask & ~front_mask).sum()
    if open_ > HIDDEN.open * inside.sum():
        return None
    return inside


def _bays(mask: Mask, front_mask: Mask) -> Mask:
    """Return the bays of an object's hull filled by objects in front."""
    hull = np.zeros(mask.shape, np.uint8)
    corners = cv2.convexHull(np.argwhere(mask)[:, ::-1].astype(np.int32))
    cv2.fillConvexPoly(hull, corners, 1)
    open_ = ((hull > 0) & ~mask).astype(np.uint8)
    count, bays, stats, _ = cv2.connectedComponentsWithStats(open_, connectivity=4)
    fill_counts = np.bincount(bays[front_mask], minlength=count)
    bay_mask = fill_counts >= HIDDEN.bay * stats[:, cv2.CC_STAT_AREA]
    bay_mask[0] = False
    return np.asarray(bay_mask[bays])


def _free_disc(disc: Disc, others: Sequence[PhotoObject]) -> Disc | None:
    """Return the largest disc about the ball's centre without overlap, or None.

    None means that little would remain; then the ball keeps its visible outline.
    """
    radius = disc.radius
    for other in others:
        outline = other.outline
        if isinstance(outline, Disc):
            gap = float(np.hypot(*(outline.center - disc.center))) - outline.radius
        else:
            rings = [shapely.Polygon(ring.outer).buffer(0) for ring in outline.rings]
            gap = shapely.union_all(rings).distance(shapely.Point(disc.center))
        radius = min(radius, gap - 0.01)
    if radius < HIDDEN.smallest * disc.radius:
        return None
    return Disc(disc.center, radius)
