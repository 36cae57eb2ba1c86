"""Label map -> all outlines together: what touches in the photo touches in its shapes, and nothing overlaps."""

from __future__ import annotations

from collections.abc import Collection, Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.geometry import Array
from physgen.outline.discs import RoughDisc, fit_discs
from physgen.outline.fit import clean, disc_of, long_border, stands_flat
from physgen.outline.outline import Disc, Outline, Region
from physgen.outline.raster import coverage
from physgen.outline.shared import close_gaps, fit_regions

TOUCH = 2
"""px between two masks that still count as touching."""

KEEP_IOU = 0.8
"""A disc that had to leave its mask further than this to make room becomes a region after all."""

_HIDDEN = 0.1
"""Weight of a border point that faces another object: it may be the other's border."""


def fit_outlines(
    labels: NDArray[np.integer], ids: Sequence[int], never_discs: Collection[int] = ()
) -> dict[int, Outline]:
    """Outlines of the objects `ids` of a label map `(H, W)`; ValueError where an id has no pixels.

    Discs as in `fit_outline`, then moved together; the other objects share their borders. Those of `never_discs` are
    regions, however round, and so is what stands on a flat foot.
    """
    owned = _owned(labels, ids)
    views = _views(owned, ids)
    rough = {}
    for i, view in views.items():
        disc = None if i in never_discs else disc_of(owned[view] == i)
        if disc is not None and not stands_flat(owned[view], i, disc):
            rough[i] = Disc(disc.center + _corner(view), disc.radius)
    while True:
        regions = fit_regions(close_gaps(np.where(np.isin(owned, list(rough)), 0, owned)))
        discs = _together(owned, views, rough, regions)
        lost = [i for i, disc in discs.items() if _iou(disc, owned[views[i]] == i, views[i]) < KEEP_IOU]
        if not lost:
            break
        for i in lost:
            del rough[i]
    return {i: discs[i] if i in discs else regions[i] for i in ids}


def touching(labels: NDArray[np.integer], ids: Sequence[int]) -> list[tuple[int, int]]:
    """Pairs of objects whose masks are at most `TOUCH` px apart."""
    pairs = set()
    known = set(ids)
    kernel = cv2.getStructuringElement(cv2.MORPH_RECT, (2 * TOUCH + 1, 2 * TOUCH + 1))
    for i, view in _views(labels, ids).items():
        near = cv2.dilate((labels[view] == i).astype(np.uint8), kernel) > 0
        pairs |= {
            (min(i, j), max(i, j)) for j in np.unique(labels[view][near]).tolist() if j != i and j in known
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
    begin = np.flatnonzero(np.concatenate([[True], owner[1:] != owner[:-1]])) if len(at) else at
    known, places = owner[begin], np.stack(np.divmod(at, labels.shape[1]), axis=1)
    low, high = (way.reduceat(places, begin) if len(begin) else places for way in (np.minimum, np.maximum))
    views = {}
    for i in ids:
        k = int(np.searchsorted(known, i))
        if i == 0 or k == len(known) or known[k] != i:
            raise ValueError(f"no pixel of the label map has id {i}")
        (y0, x0), (y1, x1) = low[k].tolist(), high[k].tolist()
        margin = max(y1 - y0, x1 - x0) // 2 + TOUCH + 2
        views[i] = (slice(max(y0 - margin, 0), y1 + margin + 1), slice(max(x0 - margin, 0), x1 + margin + 1))
    return views


def _corner(view: View) -> Array:
    return np.array([view[1].start, view[0].start], dtype=np.float64)


def _owned(labels: NDArray[np.integer], ids: Sequence[int]) -> NDArray[np.int64]:
    """The map of the ids alone, without specks."""
    known = np.where(np.isin(labels, list(ids)), labels, 0).astype(np.int64)
    owned = np.zeros_like(known)
    for i, view in _views(known, ids).items():
        part = known[view]
        # a hole is filled only where nobody else is
        owned[view][clean(part == i) & ((part == i) | (part == 0))] = i
    return owned


def _together(
    owned: NDArray[np.int64], views: dict[int, View], rough: dict[int, Disc], regions: dict[int, Region]
) -> dict[int, Disc]:
    """Move discs so that they touch their neighbours, discs and regions."""
    ids = list(rough)
    place = {i: k for k, i in enumerate(ids)}
    pairs = touching(owned, [*ids, *regions])
    contacts = [
        (place[i], place[j])
        for i, j in pairs
        if i in place and j in place and _could_touch(rough[i], rough[j])
    ]
    obstacles: dict[int, list[tuple[Region, bool]]] = {}
    for i in ids:
        low, high = rough[i].center - rough[i].radius - 8, rough[i].center + rough[i].radius + 8
        for j, region in regions.items():
            points = np.concatenate([ring.outer for ring in region.rings])
            if (points.max(axis=0) > low).all() and (points.min(axis=0) < high).all():
                touches = (min(i, j), max(i, j)) in pairs
                obstacles.setdefault(place[i], []).append((region, touches))
    fitted = fit_discs([_rough(owned, i, views[i], rough[i]) for i in ids], contacts, obstacles)
    return dict(zip(ids, fitted, strict=True))


def _could_touch(a: Disc, b: Disc) -> bool:
    """Near enough as circles too: ragged masks may meet where their circles do not."""
    gap = float(np.hypot(*(a.center - b.center))) - a.radius - b.radius
    return gap <= max(2.0 * TOUCH, 0.1 * min(a.radius, b.radius))


def _rough(owned: NDArray[np.int64], i: int, view: View, disc: Disc) -> RoughDisc:
    part = owned[view]
    local = long_border(part == i)
    local = local[:: max(1, len(local) // 128)]
    others = ((part != 0) & (part != i)).astype(np.uint8)
    near = cv2.dilate(others, np.ones((2 * TOUCH + 1, 2 * TOUCH + 1), np.uint8)) > 0
    place = np.clip(np.round(local).astype(np.intp), 0, (part.shape[1] - 1, part.shape[0] - 1))
    border = local + _corner(view)
    last = np.array([owned.shape[1] - 1, owned.shape[0] - 1])
    cut = ((border < 0) | (border > last)).any(axis=1)
    weight = np.where(cut, 1e-3, np.where(near[place[:, 1], place[:, 0]], _HIDDEN, 1.0))
    return RoughDisc(disc, border, weight)


def _iou(disc: Disc, mask: NDArray[np.bool_], view: View) -> float:
    covered = coverage(Disc(disc.center - _corner(view), disc.radius), (mask.shape[1], mask.shape[0]))
    return float(np.minimum(covered, mask).sum() / np.maximum(covered, mask).sum())
