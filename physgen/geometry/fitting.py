"""Outlines of one mask or of all masks of a label map: discs where circles fit, regions otherwise.

Objects that touch in the photo touch in their outlines, and no outlines overlap.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.geometry.circles import RoughDisc, fit_circle, fit_discs
from physgen.geometry.polygon import Array, Disc, Outline, Region, polygon_moments
from physgen.geometry.raster import coverage
from physgen.geometry.regions import close_gaps, fit_regions, trace_borders

CIRCLE_IOU = 0.85
"""A circle that covers a mask at least this well stands for it (the paper, supplement, primitive fitting)."""


@dataclass(frozen=True)
class FitTuning:
    """Thresholds of fitted outlines."""

    round: float = 0.93
    """So well, but for half a pixel at its border, a circle covers a mask that it stands for. Of COCO's photos cake,
    pizza, cups and bananas reach less; balls of 6 px and more reach more in photos of any quality."""
    foot: float = 2.0
    foot_depth: float = 0.065
    """px, and share of its radius, by which a circle sinks below what stands on a flat foot. Masks of balls in tuning
    photos lack 0.05 at most."""
    foot_width: float = 1.5
    """Times as wide as a circle is 1.5 px above its lowest point, at its second row."""
    foot_iou: float = 0.97
    """A circle that covers a mask so well stands for it, whatever is hidden of its foot: grass, a rug."""
    touch: int = 2
    """px between two masks that still count as touching."""
    keep_iou: float = 0.7
    """A disc that had to leave its mask further than this to make room becomes a region after all. In a rack of balls
    of 20 px, from a photo of low quality, 0.78 is left of discs that lie right and of masks that do not."""
    hidden: float = 0.1
    """Weight of a border point that faces another object: it may be the other's border."""


FIT = FitTuning()


def disc_of(mask: NDArray[np.bool_], whole: bool) -> Disc | None:
    """The circle of a clean mask, where it covers the mask well enough and better than a rectangle does.

    `whole`: nothing may hide a part of it.
    """
    border = long_border(mask)
    disc, iou = fit_circle(mask, border)
    least = max(CIRCLE_IOU, FIT.round - 1 / disc.radius) if whole else CIRCLE_IOU
    return disc if iou >= least and iou > box_iou(border) else None


def stands_flat(part: NDArray[np.integer], i: int, disc: Disc) -> bool:
    """Whether object i of a label map `(H, W)` stands on a flat foot, as bowls do, not on the round that `disc` has.

    A foot that other objects or the photo's border hide does not count.
    """
    mask = part == i
    rows, columns = np.nonzero(mask)
    low = rows >= rows.max() - 1
    sunk = float(disc.center[1]) + disc.radius - (float(rows.max()) + 0.5)
    wide = float(np.ptp(columns[low])) + 1
    if sunk < max(
        FIT.foot, FIT.foot_depth * disc.radius
    ) or wide < FIT.foot_width * 2 * np.sqrt(3 * disc.radius):
        return False
    if rows.max() + 1 >= len(part) or part[rows.max() + 1, columns[low]].any():
        return False
    y, x = np.mgrid[: part.shape[0], : part.shape[1]]
    round_ = np.hypot(x - disc.center[0], y - disc.center[1]) <= disc.radius
    return float((mask & round_).sum()) < FIT.foot_iou * float((mask | round_).sum())


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


def without_specks(mask: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Without specks: pieces and holes under 0.5 % of the area (4 to 16 px²); the largest piece stays."""
    top, bottom, left, right = _box(mask)
    part = mask[top:bottom, left:right]
    speck = float(np.clip(part.sum() / 200, 4, 16))
    _, pieces, stats, _ = cv2.connectedComponentsWithStats(
        part.astype(np.uint8), connectivity=4
    )
    areas = stats[:, cv2.CC_STAT_AREA].copy()
    areas[0] = 0
    keep = areas >= speck
    keep[int(np.argmax(areas))] = True
    kept = np.asarray(keep[pieces])
    outside = np.pad(~kept, 1, constant_values=True)
    _, gaps, stats, _ = cv2.connectedComponentsWithStats(
        outside.astype(np.uint8), connectivity=8
    )
    fill = stats[:, cv2.CC_STAT_AREA] < speck
    fill[[0, gaps[0, 0]]] = False
    found = np.zeros_like(mask, dtype=bool)
    found[top:bottom, left:right] = kept | fill[gaps[1:-1, 1:-1]]
    return found


def _box(mask: NDArray[np.bool_]) -> tuple[int, int, int, int]:
    """First and one past the last row, then column, of the mask."""
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    return int(rows[0]), int(rows[-1]) + 1, int(columns[0]), int(columns[-1]) + 1


def fit_outlines(
    labels: NDArray[np.integer], ids: Sequence[int], never_discs: Collection[int] = ()
) -> dict[int, Outline]:
    """Outlines of the objects `ids` of a label map `(H, W)`; ValueError where an id has no pixels.

    Discs where circles fit, moved together; the other objects share their borders, which stand off the half-level
    lines of their masks by at most 0.5 px (Hausdorff distance). Those of `never_discs` are regions, however round, and
    so is what stands on a flat foot. Pieces under a few px² are dropped and such holes filled.
    """
    owned = _owned(labels, ids)
    views = _views(owned, ids)
    rough = {}
    for i, view in views.items():
        mask = owned[view] == i
        beside = (
            cv2.dilate(np.pad(mask, 1).astype(np.uint8), np.ones((5, 5), np.uint8)) > 0
        )
        whole = not (
            beside & np.pad((owned[view] > 0) & ~mask, 1, constant_values=True)
        ).any()
        disc = None if i in never_discs else disc_of(mask, whole)
        if disc is not None and not stands_flat(owned[view], i, disc):
            rough[i] = Disc(disc.center + _corner(view), disc.radius)
    while True:
        regions = fit_regions(
            close_gaps(np.where(np.isin(owned, list(rough)), 0, owned))
        )
        discs = _together(owned, views, rough, regions)
        lost = [
            i
            for i, disc in discs.items()
            if _iou(disc, owned[views[i]] == i, views[i]) < FIT.keep_iou
        ]
        if not lost:
            break
        for i in lost:
            del rough[i]
    return {i: discs[i] if i in discs else regions[i] for i in ids}


def touching_masks(
    labels: NDArray[np.integer], ids: Sequence[int]
) -> list[tuple[int, int]]:
    """Pairs of objects whose masks are at most `FIT.touch` px apart."""
    pairs = set()
    known = set(ids)
    kernel = cv2.getStructuringElement(
        cv2.MORPH_RECT, (2 * FIT.touch + 1, 2 * FIT.touch + 1)
    )
    for i, view in _views(labels, ids).items():
        near = cv2.dilate((labels[view] == i).astype(np.uint8), kernel) > 0
        pairs |= {
            (min(i, j), max(i, j))
            for j in np.unique(labels[view][near]).tolist()
            if j != i and j in known
        }
    return sorted(pairs)


View = tuple[slice, slice]


def _views(labels: NDArray[np.integer], ids: Sequence[int]) -> dict[int, View]:
    """For each id the rows and columns of its surroundings, half its size to each side, within the photo."""
    at = np.flatnonzero(labels)
    owner = labels.reshape(-1)[at]
    if not len(at) or int(owner.max()) < 2**16:
        owner = owner.astype(np.uint16)  # which NumPy sorts in one pass
    order = np.argsort(owner, kind="stable")
    at, owner = at[order], owner[order]
    begin = (
        np.flatnonzero(np.concatenate([[True], owner[1:] != owner[:-1]]))
        if len(at)
        else at
    )
    known, places = owner[begin], np.stack(np.divmod(at, labels.shape[1]), axis=1)
    low, high = (
        way.reduceat(places, begin) if len(begin) else places
        for way in (np.minimum, np.maximum)
    )
    views = {}
    for i in ids:
        k = int(np.searchsorted(known, i))
        if i == 0 or k == len(known) or known[k] != i:
            raise ValueError(f"no pixel of the label map has id {i}")
        (y0, x0), (y1, x1) = low[k].tolist(), high[k].tolist()
        margin = max(y1 - y0, x1 - x0) // 2 + FIT.touch + 2
        views[i] = (
            slice(max(y0 - margin, 0), y1 + margin + 1),
            slice(max(x0 - margin, 0), x1 + margin + 1),
        )
    return views


def _corner(view: View) -> Array:
    return np.array([view[1].start, view[0].start], dtype=np.float64)


def _owned(labels: NDArray[np.integer], ids: Sequence[int]) -> NDArray[np.int64]:
    """The map of the ids alone, without specks."""
    known = np.where(np.isin(labels, list(ids)), labels, 0).astype(np.int64)
    owned = np.zeros_like(known)
    for i, view in _views(known, ids).items():
        part = known[view]
        # a hole is filled only where no other object is
        owned[view][without_specks(part == i) & ((part == i) | (part == 0))] = i
    return owned


def _together(
    owned: NDArray[np.int64],
    views: dict[int, View],
    rough: dict[int, Disc],
    regions: dict[int, Region],
) -> dict[int, Disc]:
    """Move discs so that they touch their neighbours, discs and regions."""
    ids = list(rough)
    place = {i: k for k, i in enumerate(ids)}
    pairs = touching_masks(owned, [*ids, *regions])
    contacts = [
        (place[i], place[j])
        for i, j in pairs
        if i in place and j in place and _could_touch(rough[i], rough[j])
    ]
    obstacles: dict[int, list[tuple[Region, bool]]] = {}
    for i in ids:
        low, high = (
            rough[i].center - rough[i].radius - 8,
            rough[i].center + rough[i].radius + 8,
        )
        for j, region in regions.items():
            points = np.concatenate([ring.outer for ring in region.rings])
            if (points.max(axis=0) > low).all() and (points.min(axis=0) < high).all():
                touches = (min(i, j), max(i, j)) in pairs
                obstacles.setdefault(place[i], []).append((region, touches))
    fitted = fit_discs(
        [_rough(owned, i, views[i], rough[i]) for i in ids], contacts, obstacles
    )
    return dict(zip(ids, fitted, strict=True))


def _could_touch(a: Disc, b: Disc) -> bool:
    """Near enough as circles too: ragged masks may meet where their circles do not."""
    gap = float(np.hypot(*(a.center - b.center))) - a.radius - b.radius
    return gap <= max(2.0 * FIT.touch, 0.1 * min(a.radius, b.radius))


def _rough(owned: NDArray[np.int64], i: int, view: View, disc: Disc) -> RoughDisc:
    part = owned[view]
    local = long_border(part == i)
    local = local[:: max(1, len(local) // 128)]
    others = ((part != 0) & (part != i)).astype(np.uint8)
    near = (
        cv2.dilate(others, np.ones((2 * FIT.touch + 1, 2 * FIT.touch + 1), np.uint8))
        > 0
    )
    place = np.clip(
        np.round(local).astype(np.intp), 0, (part.shape[1] - 1, part.shape[0] - 1)
    )
    border = local + _corner(view)
    last = np.array([owned.shape[1] - 1, owned.shape[0] - 1])
    cut = ((border < 0) | (border > last)).any(axis=1)
    weight = np.where(
        cut, 1e-3, np.where(near[place[:, 1], place[:, 0]], FIT.hidden, 1.0)
    )
    return RoughDisc(disc, border, weight)


def disc_iou(disc: Disc, mask: NDArray[np.bool_]) -> float:
    """Return how well a disc covers a mask `(H, W)` of the photo."""
    return _iou(disc, mask, (slice(0, None), slice(0, None)))


def _iou(disc: Disc, mask: NDArray[np.bool_], view: View) -> float:
    covered = coverage(
        Disc(disc.center - _corner(view), disc.radius), (mask.shape[1], mask.shape[0])
    )
    return float(np.minimum(covered, mask).sum() / np.maximum(covered, mask).sum())
