"""Two outlines -> how deep they overlap, px: the length of the shortest move that would part their deepest pieces."""

from __future__ import annotations

import numpy as np

from physgen.geometry import Array
from physgen.outline.outline import Disc, Outline, bounds
from physgen.outline.pieces import convex_pieces

_ROUNDING = 1e-9
"""px: less is none."""


def overlap_depth(a: Outline, b: Outline) -> float:
    """Penetration px of two outlines, 0 when they are apart or touch.

    Exact for two discs and for convex outlines (separating axes); else the deepest pair of convex pieces.
    """
    if not _boxes_meet(bounds(a), bounds(b)):
        return 0.0
    if isinstance(a, Disc) and isinstance(b, Disc):
        depth = a.radius + b.radius - float(np.hypot(*(a.center - b.center)))
        return depth if depth > _ROUNDING else 0.0
    deepest = 0.0
    mine, others = _parts(a), _parts(b)
    boxes = [_box(part) for part in others]
    for part in mine:
        box = _box(part)
        for other, other_box in zip(others, boxes, strict=True):
            if _boxes_meet(box, other_box):
                deepest = max(deepest, _depth(part, other))
    return deepest if deepest > _ROUNDING else 0.0


def _parts(outline: Outline) -> list[Disc | Array]:
    return [outline] if isinstance(outline, Disc) else list(convex_pieces(outline))


def _box(part: Disc | Array) -> tuple[float, float, float, float]:
    if isinstance(part, Disc):
        return bounds(part)
    (x0, y0), (x1, y1) = part.min(axis=0).tolist(), part.max(axis=0).tolist()
    return x0, y0, x1, y1


def _boxes_meet(a: tuple[float, float, float, float], b: tuple[float, float, float, float]) -> bool:
    return a[0] < b[2] and b[0] < a[2] and a[1] < b[3] and b[1] < a[3]


def _depth(a: Disc | Array, b: Disc | Array) -> float:
    """Least overlap of the two shadows over all axes that could part them; negative when apart."""
    axes = np.concatenate([_axes(a, b), _axes(b, a)])
    (low_a, high_a), (low_b, high_b) = _shadow(a, axes), _shadow(b, axes)
    return float(np.minimum(high_a - low_b, high_b - low_a).min())


def _axes(part: Disc | Array, other: Disc | Array) -> Array:
    """Unit axes `(m, 2)`: a polygon's normals, or from a disc's centre to the other's corners."""
    if isinstance(part, Disc):
        along = (other.center[None] if isinstance(other, Disc) else other) - part.center
    else:
        sides = np.roll(part, -1, axis=0) - part
        along = np.column_stack([sides[:, 1], -sides[:, 0]])
    length = np.hypot(*along.T)
    axes: Array = along[length > 0] / length[length > 0, None]
    return axes


def _shadow(part: Disc | Array, axes: Array) -> tuple[Array, Array]:
    if isinstance(part, Disc):
        middle = axes @ part.center
        return middle - part.radius, middle + part.radius
    reach = axes @ part.T
    return reach.min(axis=1), reach.max(axis=1)
