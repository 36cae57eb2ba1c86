"""Mask -> outline: a disc where a circle fits (the paper's rule), else the contour as a region of rings."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.geometry import Array, polygon_moments
from physgen.outline.borders import trace_borders
from physgen.outline.circle import fit_circle
from physgen.outline.outline import Disc, Outline
from physgen.outline.shared import fit_regions

CIRCLE_IOU = 0.85
"""A circle that covers a mask at least this well stands for it (the paper, supplement, primitive fitting)."""

FOOT, FOOT_DEPTH = 2.0, 0.065
"""px, and share of its radius, by which a circle sinks below what stands on a flat foot. Masks of balls in the studio's
tuning photos, and of the peers' pool, lack 0.05 at most."""
FOOT_WIDTH = 1.5
"""Times as wide as a circle is 1.5 px above its lowest point, at its second row."""
FOOT_IOU = 0.97
"""A circle that covers a mask so well stands for it, whatever is hidden of its foot: grass, a rug."""


def fit_outline(mask: NDArray[np.bool_]) -> Outline:
    """The outline of one object's mask `(H, W)`; ValueError where the mask is empty.

    A region's borders stand off the mask's half-level line by at most 0.5 px (Hausdorff distance). Pieces under a few
    px² are dropped and such holes filled; see `clean`.
    """
    if not mask.any():
        raise ValueError("the mask is empty")
    mask = clean(mask)
    disc = disc_of(mask)
    return disc if disc is not None else fit_regions(mask.astype(np.int64))[1]


def disc_of(mask: NDArray[np.bool_]) -> Disc | None:
    """The circle of a clean mask, where it covers the mask well enough and better than a rectangle does."""
    border = long_border(mask)
    disc, iou = fit_circle(mask, border)
    return disc if iou >= CIRCLE_IOU and iou > box_iou(border) else None


def stands_flat(part: NDArray[np.integer], i: int, disc: Disc) -> bool:
    """Whether thing i of a label map `(H, W)` stands on a flat foot, as bowls do, not on the round that `disc` has.

    A foot that other things or the photo's border hide tells nothing.
    """
    mask = part == i
    rows, columns = np.nonzero(mask)
    low = rows >= rows.max() - 1
    sunk = float(disc.center[1]) + disc.radius - (float(rows.max()) + 0.5)
    wide = float(np.ptp(columns[low])) + 1
    if sunk < max(FOOT, FOOT_DEPTH * disc.radius) or wide < FOOT_WIDTH * 2 * np.sqrt(3 * disc.radius):
        return False
    if rows.max() + 1 >= len(part) or part[rows.max() + 1, columns[low]].any():
        return False
    y, x = np.mgrid[: part.shape[0], : part.shape[1]]
    round_ = np.hypot(x - disc.center[0], y - disc.center[1]) <= disc.radius
    return float((mask & round_).sum()) < FOOT_IOU * float((mask | round_).sum())


def long_border(mask: NDArray[np.bool_]) -> Array:
    """The half-level line `(n, 2)` px around the mask's longest border."""
    top, bottom, left, right = _box(mask)
    traced = trace_borders(mask[top:bottom, left:right].astype(np.uint8))
    longest = max(traced.borders, key=lambda border: len(border.corners))
    line: Array = longest.middles + np.array([left, top])
    return line


def box_iou(border: Array) -> float:
    """How well the smallest turned rectangle around a contour `(n, 2)` covers what lies within the contour.

    A circle's best IoU with a square is 0.834, and 0.85 with rounded corners: the paper's rule alone would make wheels
    of toy blocks. The paper takes "the primitive type with the maximum coverage", so the circle has to beat this too.
    """
    (_, (width, height), _) = cv2.minAreaRect(border.astype(np.float32))
    return abs(polygon_moments(border).area) / max(width * height, 1e-9)


def clean(mask: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Without specks: pieces and holes under 0.5 % of the area (4 to 16 px²); the largest piece stays."""
    top, bottom, left, right = _box(mask)
    part = mask[top:bottom, left:right]
    speck = float(np.clip(part.sum() / 200, 4, 16))
    _, pieces, stats, _ = cv2.connectedComponentsWithStats(part.astype(np.uint8), connectivity=4)
    areas = stats[:, cv2.CC_STAT_AREA].copy()
    areas[0] = 0
    keep = areas >= speck
    keep[int(np.argmax(areas))] = True
    kept = np.asarray(keep[pieces])
    outside = np.pad(~kept, 1, constant_values=True)
    _, gaps, stats, _ = cv2.connectedComponentsWithStats(outside.astype(np.uint8), connectivity=8)
    fill = stats[:, cv2.CC_STAT_AREA] < speck
    fill[[0, gaps[0, 0]]] = False
    found = np.zeros_like(mask, dtype=bool)
    found[top:bottom, left:right] = kept | fill[gaps[1:-1, 1:-1]]
    return found


def _box(mask: NDArray[np.bool_]) -> tuple[int, int, int, int]:
    """First and one past the last row, then column, of the mask."""
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    return int(rows[0]), int(rows[-1]) + 1, int(columns[0]), int(columns[-1]) + 1
