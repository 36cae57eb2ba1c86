"""Silhouettes of objects at any scale, and the darkness that geometry predicts from
them.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from math import ceil, inf

import cv2
import numpy as np

from physgen.geometry.polygon import Array, Disc, bounds, mass_properties
from physgen.geometry.shadows import (
    PixelBox,
    ShadowSetting,
    Silhouette,
    shadow_darkness,
)
from physgen.maps import F32
from physgen.perceive.roles import BoundaryGuess, Labels, Mask, Matter, PhotoObject
from physgen.scene.scene import Solid, View

# Number of objects, the largest ones.
MOST = 40
# px by which an object may reach below its floor.
SUNK = 3.0
# px around objects in which the background still shows traces of them.
MARGIN = 2
# Linear light added before logarithms and ratios, which black does not have.
DARKEST = 2e-3

Casts = Iterator[tuple[int, PixelBox, F32]]
"""Per object: its id, a box of the photo, and -log of the remaining light in the
box.
"""


def object_silhouettes(
    labels: Labels,
    objects: Sequence[PhotoObject],
    matter: Mapping[int, Matter],
    boundaries: BoundaryGuess,
    scale: float,
    floor: float | None = None,
) -> list[Silhouette]:
    """Return silhouettes of the largest objects, on a picture 1 / `scale` of the size.

    Each stands above the highest boundary below it, or above `floor`, a row of the
    photo, if it is given.
    """
    grounds = []
    for wall in boundaries.walls:
        for a, b in zip(wall.points[:-1], wall.points[1:], strict=True):
            grounds.append((np.array(a) / scale, np.array(b) / scale))
    result = []
    sizes = {t.id: mass_properties(t.outline).area for t in objects}
    for item in sorted(objects, key=lambda t: -sizes[t.id])[:MOST]:
        coverage = _reduced_coverage(labels, item, scale)
        if coverage is None:
            continue
        x, y = (mass_properties(item.outline).center / scale).tolist()
        if isinstance(item.outline, Disc):
            radius = item.outline.radius / scale
        else:
            radius = None
        ball = radius is not None and matter[item.id].solid is Solid.SPHERE
        bottom = bounds(item.outline)[3] / scale - 0.5
        if floor is None:
            floor_row = _row_below(grounds, x, bottom)
        else:
            floor_row = floor / scale
        result.append(
            Silhouette(
                *coverage,
                (x, y),
                radius if ball else None,
                _thickness(
                    item, scale, is_top_view=boundaries.view is View.TOP, ball=ball
                ),
                floor_row,
                id=item.id,
            )
        )
    return result


def _reduced_coverage(
    labels: Labels, item: PhotoObject, scale: float
) -> tuple[F32, tuple[int, int]] | None:
    """Return an object's coverage (h, w) on the reduced picture, and its upper left
    corner there; None if the object is hidden.
    """
    x0, y0, x1, y1 = bounds(item.outline)
    a = max(int(x0) - 2, 0)
    b = max(int(y0) - 2, 0)
    c = min(ceil(x1) + 3, labels.shape[1])
    d = min(ceil(y1) + 3, labels.shape[0])
    mask = (labels[b:d, a:c] == item.id).astype(np.float32)
    if not mask.any():
        return None
    corner = int(a / scale), int(b / scale)
    size = ceil(c / scale) + 1 - corner[0], ceil(d / scale) + 1 - corner[1]
    matrix = np.array(
        [
            [1 / scale, 0, (a + 0.5) / scale - 0.5 - corner[0]],
            [0, 1 / scale, (b + 0.5) / scale - 0.5 - corner[1]],
        ]
    )
    # Blur before sampling, so that a reduced mask has no aliasing.
    if scale > 1.2:
        smooth_mask = cv2.GaussianBlur(mask, (0, 0), 0.4 * scale)
    else:
        smooth_mask = mask
    small = cv2.warpAffine(smooth_mask, matrix, size, flags=cv2.INTER_LINEAR)
    return np.asarray(small, np.float32), corner


def _thickness(
    item: PhotoObject, scale: float, *, is_top_view: bool, ball: bool
) -> float:
    """Return an object's thickness, px of the reduced picture.

    The depth of an object is unknown: assume about the mean of its width and height.
    """
    is_disc = isinstance(item.outline, Disc)
    if isinstance(item.outline, Disc):
        thickness = 2 * (item.outline.radius / scale)
    else:
        x0, y0, x1, y1 = bounds(item.outline)
        thickness = 0.9 * ((x1 - x0) / scale * ((y1 - y0) / scale)) ** 0.5
    if is_top_view and not ball:
        thickness *= 0.4 if is_disc else 0.6
    return thickness


def join_silhouettes(silhouettes: Sequence[Silhouette]) -> list[Silhouette]:
    """Return each ball, and all other objects joined if floor and thickness are
    similar.

    Their shadows join, too.
    """
    groups: list[list[Silhouette]] = []
    for silhouette in sorted(
        (w for w in silhouettes if w.radius is None), key=lambda w: w.thickness
    ):
        for group in groups:
            if _can_join(group[0], silhouette):
                group.append(silhouette)
                break
        else:
            groups.append([silhouette])
    return [
        silhouette for silhouette in silhouettes if silhouette.radius is not None
    ] + [_union(group) for group in groups]


def _union(group: Sequence[Silhouette]) -> Silhouette:
    """Return one silhouette for a group."""
    corners = np.array([w.corner for w in group])
    sizes = np.array([w.coverage.shape[::-1] for w in group])
    x0, y0 = corners.min(axis=0).tolist()
    x1, y1 = (corners + sizes).max(axis=0).tolist()
    coverage = np.zeros((y1 - y0, x1 - x0), np.float32)
    for silhouette in group:
        left = silhouette.corner[0] - x0
        top = silhouette.corner[1] - y0
        height, width = silhouette.coverage.shape
        part = coverage[top : top + height, left : left + width]
        np.maximum(part, silhouette.coverage, out=part)
    thickness = float(np.median([w.thickness for w in group]))
    return Silhouette(
        coverage, (x0, y0), group[0].center, None, thickness, group[0].floor
    )


def _can_join(first: Silhouette, other: Silhouette) -> bool:
    if first.floor is None or other.floor is None:
        return False
    return (
        abs(first.floor - other.floor) < 1 and other.thickness < 1.5 * first.thickness
    )


def lowest_floor(boundaries: BoundaryGuess) -> float | None:
    """Return the row, px, of the lowest boundary that can carry objects, except the
    bottom.

    Returns None if there is none.
    """
    rows = []
    for wall in boundaries.walls:
        if wall.name == "bottom":
            continue
        for p, q in zip(wall.points[:-1], wall.points[1:], strict=True):
            if _can_carry(p, q):
                rows.append(max(p[1], q[1]))
    return max(rows, default=None)


def _can_carry(start: Sequence[float] | Array, end: Sequence[float] | Array) -> bool:
    """Return whether a line between two points is level enough to carry objects."""
    run = abs(end[0] - start[0])
    rise = abs(end[1] - start[1])
    return bool(run > 1.2 * rise)


def _row_below(
    grounds: Sequence[tuple[Array, Array]], x: float, bottom: float
) -> float | None:
    """Return the row of the highest ground below a point, or None."""
    rows = []
    for p, q in grounds:
        is_beside = x < min(p[0], q[0]) or x > max(p[0], q[0])
        if is_beside or not _can_carry(p, q):
            continue
        run = q[0] - p[0]
        rise = q[1] - p[1]
        rows.append(float(p[1] + rise * (x - p[0]) / run))
    return min((row for row in rows if row >= bottom - SUNK), default=None)


def typical_size(silhouettes: Sequence[Silhouette]) -> float:
    """Return the size of a typical object, px: the median root of the areas."""
    areas = [float((s.coverage > 0.5).sum()) for s in silhouettes]
    if areas:
        return float(np.median([area**0.5 for area in areas])) + 1
    return inf


def away_from_objects(coverage: F32, margin: int = MARGIN) -> Mask:
    """Return the pixels (H, W) farther than `margin` px from every object."""
    square = np.ones((2 * margin + 1, 2 * margin + 1), np.uint8)
    return np.asarray(cv2.dilate((coverage > 0).astype(np.uint8), square) == 0)


def predicted_darkness(
    silhouettes: Sequence[Silhouette], setting: ShadowSetting
) -> F32:
    """Return -log (h, w) of the light that objects leave."""
    w, h = setting.size
    model = np.zeros((h, w), np.float32)
    for silhouette in silhouettes:
        if (cast := shadow_darkness(silhouette, setting)) is not None:
            (x0, y0, x1, y1), values = cast
            model[y0:y1, x0:x1] += values
    return model
