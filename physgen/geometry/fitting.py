"""Outlines of one mask or of all masks of a label map: discs where circles fit, regions otherwise.

Objects that touch in the photo touch in their outlines, and no outlines overlap.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.arrays import Mask
from physgen.geometry.circles import RoughDisc, fit_circle, fit_discs
from physgen.geometry.polygon import Array, Disc, Outline, Region, polygon_moments
from physgen.geometry.raster import coverage
from physgen.geometry.regions import close_gaps, fit_regions, trace_borders

CIRCLE_IOU = 0.85
"""IoU with a mask above which a circle replaces it (the paper, supplement, primitive
fitting).
"""


@dataclass(frozen=True)
class FitTuning:
    """Thresholds of fitted outlines."""

    round_iou: float = 0.93
    """IoU of a circle that replaces a completely visible mask, reduced by half a pixel
    at its border. In photos of COCO, cakes, pizzas, cups and bananas reach less; balls
    of 6 px and more reach more in photos of any quality.
    """
    foot: float = 2.0
    foot_depth: float = 0.065
    """Depth of a circle below the flat foot of its mask: px, and share of the radius.
    Masks of balls in tuning photos lack at most 0.05."""
    foot_width: float = 1.5
    """Width of a flat foot, relative to a circle 1.5 px above its lowest point."""
    foot_iou: float = 0.97
    """IoU above which a circle replaces a mask with a flat foot: grass or a rug may hide
    a ball's foot."""
    touch: int = 2
    """Distance between two touching masks, px."""
    keep_iou: float = 0.7
    """IoU of a disc below which it is replaced by a region, after it was moved to make
    room. In a rack of balls of 20 px, in a photo of low quality, discs at the right
    places keep 0.78."""
    hidden_weight: float = 0.1
    """Weight of a border point beside another object, as it may be the other's
    border.
    """
    exact_side: float = 960.0
    """Longer side of the photos whose outlines follow their masks within a pixel, px.
    In larger photos the tolerance grows with the side. From 640 px on, bodies of some
    photos sank by over 1 px onto their supports and were taken for unstable."""


FIT = FitTuning()


def disc_of(mask: Mask, is_whole_mask: bool) -> Disc | None:
    """Fit a circle to a clean mask; None if it fits too badly, or worse than a
    rectangle.

    `is_whole_mask`: no part of the mask can be hidden.
    """
    border = long_border(mask)
    disc, iou = fit_circle(mask, border)
    # A completely visible disc must match better than a partly hidden one.
    lowest_iou = CIRCLE_IOU
    if is_whole_mask:
        lowest_iou = max(CIRCLE_IOU, FIT.round_iou - 1 / disc.radius)
    if iou >= lowest_iou and iou > box_iou(border):
        return disc
    return None


def stands_flat(part: NDArray[np.integer], i: int, disc: Disc) -> bool:
    """Check whether object i of a label map `(H, W)` stands on a flat foot, as bowls
    do.

    A foot hidden by other objects or by the photo's border does not count.
    """
    mask = part == i
    rows, columns = np.nonzero(mask)
    last = rows.max()
    foot = columns[rows >= last - 1]
    # The part of the circle below the last row of the mask.
    depth = float(disc.center[1]) + disc.radius - (float(last) + 0.5)
    if depth < max(FIT.foot, FIT.foot_depth * disc.radius):
        return False
    # The last rows of a ball are narrow; those of a bowl are wide.
    width = float(np.ptp(foot)) + 1
    if width < FIT.foot_width * 2 * np.sqrt(3 * disc.radius):
        return False
    # Another object, or the photo's border, may hide the rest of a ball.
    if last + 1 >= len(part) or part[last + 1, foot].any():
        return False
    y, x = np.mgrid[: part.shape[0], : part.shape[1]]
    circle = np.hypot(x - disc.center[0], y - disc.center[1]) <= disc.radius
    shared_area = float((mask & circle).sum())
    union = float((mask | circle).sum())
    return shared_area < FIT.foot_iou * union


def long_border(mask: Mask) -> Array:
    """Return the half-level line `(n, 2)` px around the mask's longest border."""
    top, bottom, left, right = _box(mask)
    borders = trace_borders(mask[top:bottom, left:right].astype(np.uint8))
    longest = max(borders.borders, key=lambda border: len(border.corners))
    line: Array = longest.middles + np.array([left, top])
    return line


def box_iou(border: Array) -> float:
    """Return the IoU of the smallest rotated rectangle around a contour `(n, 2)` and
    its inside.

    A circle's best IoU with a square is 0.834, and 0.85 with rounded corners: by the
    paper's rule alone, toy blocks would become wheels. The paper takes "the primitive
    type with the maximum coverage", hence the circle must be better than the rectangle,
    too.
    """
    (_, (width, height), _) = cv2.minAreaRect(border.astype(np.float32))
    return abs(polygon_moments(border).area) / max(width * height, 1e-9)


def without_specks(mask: Mask) -> Mask:
    """Remove specks: pieces and holes under 0.5 % of the area (4 to 16 px²).

    The largest piece stays.
    """
    top, bottom, left, right = _box(mask)
    part = mask[top:bottom, left:right]
    # Small objects consist of few pixels, of which none may be lost.
    smallest_area = float(np.clip(part.sum() / 200, 4, 16))
    pieces, areas = _components(part, 4)
    areas[0] = 0
    is_large = areas >= smallest_area
    is_large[int(np.argmax(areas))] = True
    object_part = np.asarray(is_large[pieces])
    outside = np.pad(~object_part, 1, constant_values=True)
    gaps, areas = _components(outside, 8)
    is_speck = areas < smallest_area
    # Neither the object itself nor its surroundings are a hole.
    is_speck[[0, gaps[0, 0]]] = False
    result = np.zeros_like(mask, dtype=bool)
    result[top:bottom, left:right] = object_part | is_speck[gaps[1:-1, 1:-1]]
    return result


def _components(
    mask: Mask, connectivity: int
) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    """Return the number of the component of each pixel, and the area of each, px²."""
    _, labels, stats, _ = cv2.connectedComponentsWithStats(
        mask.astype(np.uint8), connectivity=connectivity
    )
    areas = np.array(stats[:, cv2.CC_STAT_AREA], np.int32)
    return np.asarray(labels, np.int32), areas


def _box(mask: Mask) -> tuple[int, int, int, int]:
    """Return the first row, the last + 1, and the same of columns, of the mask."""
    rows = np.flatnonzero(mask.any(axis=1))
    columns = np.flatnonzero(mask.any(axis=0))
    top = int(rows[0])
    bottom = int(rows[-1]) + 1
    left = int(columns[0])
    right = int(columns[-1]) + 1
    return top, bottom, left, right


def fit_outlines(
    labels: NDArray[np.integer], ids: Sequence[int], never_discs: Collection[int] = ()
) -> dict[int, Outline]:
    """Fit outlines to the objects `ids` of a label map `(H, W)`.

    Circles are fitted together; other objects share their borders, which differ from
    the half-level lines of their masks by at most 1 px (Hausdorff distance). In photos
    above `FIT.exact_side` this distance grows with the photo. Objects of
    `never_discs`, and those on a flat foot, are regions. Pieces of a few px² are
    dropped, and such holes are filled. Raises ValueError if an id has no pixels.
    """
    owners = _clean_labels(labels, ids)
    views = _views(owners, ids)
    # The jags of a mask grow with the photo and are not part of the object's shape.
    coarseness = max(1.0, max(labels.shape) / FIT.exact_side)
    rough_shapes = {}
    for i, view in views.items():
        if i in never_discs:
            disc = None
        else:
            disc = _disc_in_view(owners[view], i)
        if disc is not None:
            rough_shapes[i] = Disc(disc.center + _corner(view), disc.radius)
    # After the common fit, a disc may no longer match its mask. Make such discs
    # regions, and fit the rest again, until all discs match.
    while True:
        others = np.where(np.isin(owners, list(rough_shapes)), 0, owners)
        regions = fit_regions(close_gaps(others), coarseness)
        discs = _fit_together(owners, views, rough_shapes, regions)
        lost_ids = []
        for i, disc in discs.items():
            if _iou(disc, owners[views[i]] == i, views[i]) < FIT.keep_iou:
                lost_ids.append(i)
        if not lost_ids:
            break
        for i in lost_ids:
            del rough_shapes[i]
    return {i: discs[i] if i in discs else regions[i] for i in ids}


def _disc_in_view(part: NDArray[np.int64], i: int) -> Disc | None:
    """Return the disc of object i in a part of a label map; None if it is not a
    disc.
    """
    mask = part == i
    # The object may continue beyond the photo.
    others = np.pad((part > 0) & ~mask, 1, constant_values=True)
    padded_mask = np.pad(mask, 1).astype(np.uint8)
    surroundings = cv2.dilate(padded_mask, np.ones((5, 5), np.uint8)) > 0
    disc = disc_of(mask, is_whole_mask=not (surroundings & others).any())
    if disc is None or stands_flat(part, i, disc):
        return None
    return disc


def touching_masks(
    labels: NDArray[np.integer], ids: Sequence[int]
) -> list[tuple[int, int]]:
    """Return the pairs of objects with masks at most `FIT.touch` px apart."""
    pairs = set()
    id_set = set(ids)
    side = 2 * FIT.touch + 1
    # Each mask is dilated within its own surroundings, as whole maps would take
    # long.
    kernel = cv2.getStructuringElement(cv2.MORPH_RECT, (side, side))
    for i, view in _views(labels, ids).items():
        part = labels[view]
        neighbourhood = cv2.dilate((part == i).astype(np.uint8), kernel) > 0
        for j in np.unique(part[neighbourhood]).tolist():
            if j != i and j in id_set:
                pairs.add((min(i, j), max(i, j)))
    return sorted(pairs)


View = tuple[slice, slice]


def _views(labels: NDArray[np.integer], ids: Sequence[int]) -> dict[int, View]:
    """Return the surroundings of each id as rows and columns, with half its size as
    margin.
    """
    boxes = _label_boxes(labels)
    views = {}
    for i in ids:
        if i == 0 or i not in boxes:
            raise ValueError(f"no pixel of the label map has id {i}")
        y0, x0, y1, x1 = boxes[i]
        # The margin contains the rest of a partly hidden circle.
        margin = max(y1 - y0, x1 - x0) // 2 + FIT.touch + 2
        rows = slice(max(y0 - margin, 0), y1 + margin + 1)
        views[i] = (rows, slice(max(x0 - margin, 0), x1 + margin + 1))
    return views


def _label_boxes(labels: NDArray[np.integer]) -> dict[int, tuple[int, int, int, int]]:
    """Return first row and column, last row and column of each id but 0, in one pass
    over the map.
    """
    pixels = np.flatnonzero(labels)
    if not len(pixels):
        return {}
    owner = labels.reshape(-1)[pixels]
    if int(owner.max()) < 2**16:
        owner = owner.astype(np.uint16)  # NumPy sorts 16 bits by radix sort
    # Sort the pixels by id, and reduce each run of equal ids.
    order = np.argsort(owner, kind="stable")
    pixels = pixels[order]
    owner = owner[order]
    is_first = np.concatenate([[True], owner[1:] != owner[:-1]])
    first = np.flatnonzero(is_first)
    places = np.stack(np.divmod(pixels, labels.shape[1]), axis=1)
    low = np.minimum.reduceat(places, first).tolist()
    high = np.maximum.reduceat(places, first).tolist()
    boxes = {}
    for id_, start, end in zip(owner[first].tolist(), low, high, strict=True):
        boxes[id_] = (*start, *end)
    return boxes


def _corner(view: View) -> Array:
    """Return the first column and row of a view, (2,)."""
    return np.array([view[1].start, view[0].start], dtype=np.float64)


def _clean_labels(labels: NDArray[np.integer], ids: Sequence[int]) -> NDArray[np.int64]:
    """Return the label map of the ids alone, without specks."""
    known_labels = np.where(np.isin(labels, list(ids)), labels, 0).astype(np.int64)
    owners = np.zeros_like(known_labels)
    for i, view in _views(known_labels, ids).items():
        part = known_labels[view]
        # A hole is filled only with pixels of no other object.
        is_free = (part == i) | (part == 0)
        owners[view][without_specks(part == i) & is_free] = i
    return owners


def _fit_together(
    label_map: NDArray[np.int64],
    views: dict[int, View],
    rough_shapes: dict[int, Disc],
    regions: dict[int, Region],
) -> dict[int, Disc]:
    """Move discs until they touch their neighbours, discs and regions."""
    ids = list(rough_shapes)
    place = {i: k for k, i in enumerate(ids)}
    pairs = touching_masks(label_map, [*ids, *regions])
    contacts = []
    for i, j in pairs:
        if i in place and j in place and _could_touch(rough_shapes[i], rough_shapes[j]):
            contacts.append((place[i], place[j]))
    obstacles: dict[int, list[tuple[Region, bool]]] = {}
    for i in ids:
        for j, region in regions.items():
            if _is_near(rough_shapes[i], region):
                touches = (min(i, j), max(i, j)) in pairs
                obstacles.setdefault(place[i], []).append((region, touches))
    rough_discs = [_rough_shape(label_map, i, views[i], rough_shapes[i]) for i in ids]
    return dict(zip(ids, fit_discs(rough_discs, contacts, obstacles), strict=True))


def _is_near(disc: Disc, region: Region) -> bool:
    """Check whether the boxes of a disc and a region are at most 8 px apart."""
    low = disc.center - disc.radius - 8
    high = disc.center + disc.radius + 8
    points = np.concatenate([ring.outer for ring in region.rings])
    ends_beyond = (points.max(axis=0) > low).all()
    return bool(ends_beyond and (points.min(axis=0) < high).all())


def _could_touch(a: Disc, b: Disc) -> bool:
    """Check whether two discs are near as circles: ragged masks may touch without the
    circles.
    """
    gap = float(np.hypot(*(a.center - b.center))) - a.radius - b.radius
    return gap <= max(2.0 * FIT.touch, 0.1 * min(a.radius, b.radius))


def _rough_shape(
    label_map: NDArray[np.int64], i: int, view: View, disc: Disc
) -> RoughDisc:
    """Return a disc with the border of its mask; hidden and cut parts have little
    weight.
    """
    part = label_map[view]
    local = long_border(part == i)
    # About 128 points determine a circle; more only take time.
    local = local[:: max(1, len(local) // 128)]
    others = ((part != 0) & (part != i)).astype(np.uint8)
    side = 2 * FIT.touch + 1
    is_near_other = cv2.dilate(others, np.ones((side, side), np.uint8)) > 0
    last_local = (part.shape[1] - 1, part.shape[0] - 1)
    pixels = np.clip(np.round(local).astype(np.intp), 0, last_local)
    is_beside_other = is_near_other[pixels[:, 1], pixels[:, 0]]
    border = local + _corner(view)
    last = np.array([label_map.shape[1] - 1, label_map.shape[0] - 1])
    is_cut = ((border < 0) | (border > last)).any(axis=1)
    weight = np.where(is_cut, 1e-3, np.where(is_beside_other, FIT.hidden_weight, 1.0))
    return RoughDisc(disc, border, weight)


def disc_iou(disc: Disc, mask: Mask) -> float:
    """Return the IoU of a disc and a mask `(H, W)` of the photo."""
    return _iou(disc, mask, (slice(0, None), slice(0, None)))


def _iou(disc: Disc, mask: Mask, view: View) -> float:
    """Return the IoU of a disc and a mask in a view."""
    height, width = mask.shape
    local = Disc(disc.center - _corner(view), disc.radius)
    coverage_map = coverage(local, (width, height))
    return float(
        np.minimum(coverage_map, mask).sum() / np.maximum(coverage_map, mask).sum()
    )
