"""Outlines of objects as they go on behind others.

The engine needs outlines that do not overlap; the renderer needs the whole object,
since what hides it moves away. A ball or a fruit is a circle through its visible
border, other round things an ellipse; else a bay that another object fills is closed by
the hull.
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
"""Of `materials.Kind`: what is about as deep as it is wide and high."""


@dataclass(frozen=True)
class HiddenConstants:
    """Constants of continued outlines, tuned on apples and toys by eye."""

    near: float = 3.0  # px: a border so near to another object may be that one's
    points: int = 24  # of a visible border, at least
    arc: float = 0.3  # of a turn that a circle's visible border covers, at least
    ellipse_arc: float = 0.45  # the same of an ellipse
    lumpy: float = 0.09  # of its radius, by which a fruit's border leaves its circle
    fits: float = 0.8  # share of the border that lies so near
    smooth: float = 0.03  # of its size, by which a border leaves an ellipse
    open: float = 0.08  # share of a circle that may show what is behind the object
    least: float = 0.02  # of an object's area: less is not worth completing
    least_of_ball: float = 0.004  # of a ball's disc: a bite shows on a round outline
    most: float = 1.5  # times its area: more is a guess
    bay: float = 0.8  # share of a bay that objects in front fill
    smallest: float = 0.6  # of a ball's radius that is left where neighbours touch
    moved: float = 0.06  # of a ball's radius by which neighbours push it off its border


HIDDEN = HiddenConstants()


def continue_outlines(
    labels: Labels, objects: Sequence[PhotoObject]
) -> tuple[list[PhotoObject], dict[int, Outline]]:
    """Return the objects, hidden balls as discs, and whole outlines by id.

    An object has a whole outline if others hide a part of it.
    """
    ids = [item.id for item in objects]
    _, orders = drawing_layers(occlusion_orders(labels, ids), {})
    fronts = with_neighbours_of_balls(fronts_of(orders), labels, objects)
    wholes: dict[int, Outline] = {}
    completed = list(objects)
    for place, item in enumerate(objects):
        if item.id not in fronts or item.cut:
            continue
        whole = _whole_outline(labels, item, fronts[item.id])
        if whole is not None:
            wholes[item.id] = whole
        circle = whole
        if not isinstance(whole, Disc):
            circle = _border_circle(labels, item, fronts[item.id])
        if isinstance(circle, Disc):
            others = [other for other in completed if other.id != item.id]
            disc = _free_disc(circle, others)
            if disc is not None:
                completed[place] = replace(item, outline=disc)
    return completed, wholes


def _border_circle(labels: Labels, item: PhotoObject, fronts: set[int]) -> Disc | None:
    """Return the circle of a ball's border if neighbours pushed its disc off it.

    Discs of balls that touch are moved together, which lumpy fruit does not bear.
    """
    disc = item.outline
    if not isinstance(disc, Disc) or kind(item.label).form not in ROLLING_FORMS:
        return None
    window, corner = _window(labels, item.id)
    own = window == item.id
    border = _free_border(own, window)
    if len(border) < HIDDEN.points:
        return None
    circle = _circle(border, own, np.isin(window, list(fronts)))
    if circle is None:
        return None
    center = circle.center + corner
    shift = float(np.hypot(*(center - disc.center)))
    if shift <= max(HIDDEN.near, HIDDEN.moved * circle.radius):
        return None
    return Disc(center, circle.radius)


def with_neighbours_of_balls(
    fronts: Mapping[int, set[int]], labels: Labels, objects: Sequence[PhotoObject]
) -> dict[int, set[int]]:
    """Return the fronts, of each ball with all that it touches.

    Its circle shows the hidden part of it, also where an order of two is unsure.
    """
    completed = {i: set(front) for i, front in fronts.items()}
    balls = {item.id for item in objects if kind(item.label).form in ROLLING_FORMS}
    for i, j in touching_masks(labels, [item.id for item in objects]):
        for own, other in ((i, j), (j, i)):
            if own in balls:
                completed.setdefault(own, set()).add(other)
    return completed


def fronts_of(orders: Sequence[OcclusionOrder]) -> Mapping[int, set[int]]:
    """Return the ids of what hides each object."""
    fronts: dict[int, set[int]] = {}
    for order in orders:
        fronts.setdefault(order.behind, set()).add(order.front)
    return fronts


def _whole_outline(
    labels: Labels, item: PhotoObject, fronts: set[int]
) -> Outline | None:
    """Return the outline with its hidden part; None if none is found."""
    window, corner = _window(labels, item.id)
    own = window == item.id
    by = np.isin(window, list(fronts))
    border = _free_border(own, window)
    if len(border) < HIDDEN.points:
        return None
    is_ball = kind(item.label).form in ROLLING_FORMS
    if is_ball:
        disc = _circle(border, own, by)
        if disc is None or _hidden_share(disc, own, by) < HIDDEN.least_of_ball:
            return None
        return Disc(disc.center + corner, disc.radius)
    hidden = _ellipse(border, own, by)
    if hidden is None:
        hidden = _bays(own, by)
    whole = own | (hidden & by)
    gained = np.count_nonzero(whole) - np.count_nonzero(own)
    area = np.count_nonzero(own)
    if not HIDDEN.least * area <= gained <= HIDDEN.most * area:
        return None
    full = np.zeros(labels.shape, np.uint16)
    rows, columns = np.nonzero(whole)
    inside_rows, inside_columns = rows + int(corner[1]), columns + int(corner[0])
    is_inside = (inside_rows >= 0) & (inside_rows < labels.shape[0])
    is_inside &= (inside_columns >= 0) & (inside_columns < labels.shape[1])
    full[inside_rows[is_inside], inside_columns[is_inside]] = 1
    return fit_outlines(full, [1], never_discs=[1])[1]


def _window(labels: Labels, i: int) -> tuple[Labels, Array]:
    """Return the label map around an object, and the photo's px at its corner."""
    x, y, width, height = cv2.boundingRect((labels == i).astype(np.uint8))
    margin = max(width, height) // 2 + 6
    padded = np.pad(labels, margin)
    part = padded[y : y + height + 2 * margin, x : x + width + 2 * margin]
    return part, np.array([x - margin, y - margin], np.float64)


def _free_border(own: Mask, window: Labels) -> Array:
    """Return `(N, 2)` px of the border that no other object is near."""
    border = long_border(own)
    others = ((window != 0) & ~own).astype(np.uint8)
    if not others.any():
        return border
    away = cv2.distanceTransform(1 - others, cv2.DIST_L2, 5)
    columns = np.clip(np.rint(border[:, 0]).astype(int), 0, own.shape[1] - 1)
    rows = np.clip(np.rint(border[:, 1]).astype(int), 0, own.shape[0] - 1)
    is_free = away[rows, columns] > HIDDEN.near
    return np.asarray(border[is_free], np.float64)


def _covered_turn(border: Array, center: Array) -> float:
    """Return the share of a turn about a centre in which a border is visible."""
    x, y = (border - center).T
    steps = np.unique((np.arctan2(y, x) * 36 / np.pi).astype(int))
    return len(steps) / 72


def _circle(border: Array, own: Mask, by: Mask) -> Disc | None:
    """Return the circle of a ball or a fruit."""
    circle = robust_circle(border)
    center, radius = circle[:2], float(circle[2])
    off = np.abs(np.hypot(*(border - center).T) - radius)
    fits = float((off <= max(1.0, HIDDEN.lumpy * radius)).mean())
    if fits < HIDDEN.fits or _covered_turn(border, center) < HIDDEN.arc:
        return None
    rows, columns = np.indices(own.shape)
    inside = np.hypot(columns - center[0], rows - center[1]) <= radius
    if (inside & ~own & ~by).sum() > HIDDEN.open * np.pi * radius**2:
        return None
    return Disc(center, radius)


def _hidden_share(disc: Disc, own: Mask, by: Mask) -> float:
    """Return the share of a disc that what is in front of it hides."""
    rows, columns = np.indices(own.shape)
    away = np.hypot(columns - disc.center[0], rows - disc.center[1])
    inside = away <= disc.radius
    return float((inside & by).sum() / max(inside.sum(), 1))


def _ellipse(border: Array, own: Mask, by: Mask) -> Mask | None:
    """Return the pixels of an ellipse through the border; None if it fits none."""
    (x, y), axes, angle = cv2.fitEllipseAMS(border.astype(np.float32))
    size = float(min(axes)) / 2
    if not np.isfinite([x, y, *axes]).all() or not 2 < size < max(own.shape):
        return None
    if max(axes) > 2 * max(own.shape):
        return None
    if _covered_turn(border, np.array([x, y])) < HIDDEN.ellipse_arc:
        return None
    turn = np.radians(angle)
    along = np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]])
    scaled = (border - [x, y]) @ along.T / (np.array(axes) / 2)
    off = np.abs(np.hypot(*scaled.T) - 1)
    if float(np.quantile(off, HIDDEN.fits)) > HIDDEN.smooth:
        return None
    filled = np.zeros(own.shape, np.uint8)
    cv2.ellipse(filled, ((x, y), axes, angle), 1, -1)
    inside = filled > 0
    open_ = (inside & ~own & ~by).sum()
    return None if open_ > HIDDEN.open * inside.sum() else inside


def _bays(own: Mask, by: Mask) -> Mask:
    """Return the bays of an object's hull that what is in front of it fills."""
    hull = np.zeros(own.shape, np.uint8)
    corners = cv2.convexHull(np.argwhere(own)[:, ::-1].astype(np.int32))
    cv2.fillConvexPoly(hull, corners, 1)
    open_ = ((hull > 0) & ~own).astype(np.uint8)
    count, bays, stats, _ = cv2.connectedComponentsWithStats(open_, connectivity=4)
    filled = np.bincount(bays[by], minlength=count)
    is_filled = filled >= HIDDEN.bay * stats[:, cv2.CC_STAT_AREA]
    is_filled[0] = False
    return np.asarray(is_filled[bays])


def _free_disc(whole: Disc, others: Sequence[PhotoObject]) -> Disc | None:
    """Return the largest disc about the ball's middle that overlaps no other object.

    None if little is left: the ball stays as it is visible.
    """
    radius = whole.radius
    for other in others:
        outline = other.outline
        if isinstance(outline, Disc):
            gap = float(np.hypot(*(outline.center - whole.center))) - outline.radius
        else:
            rings = [shapely.Polygon(ring.outer).buffer(0) for ring in outline.rings]
            gap = shapely.union_all(rings).distance(shapely.Point(whole.center))
        radius = min(radius, gap - 0.01)
    if radius < HIDDEN.smallest * whole.radius:
        return None
    return Disc(whole.center, radius)
