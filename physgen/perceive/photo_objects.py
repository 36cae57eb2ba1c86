"""Objects from detections: outlines, discs and loose parts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from math import hypot

import numpy as np

from physgen.arrays import Mask
from physgen.geometry import raster
from physgen.geometry.fitting import disc_iou, fit_outlines
from physgen.geometry.polygon import Disc, Outline, bounds
from physgen.materials import kind
from physgen.messages import Message
from physgen.perceive.contents import attach_contents
from physgen.perceive.hanging_parts import attach_hanging_parts
from physgen.perceive.remains import Remain
from physgen.perceive.roles import (
    SMALLEST_OBJECT,
    BoundaryGuess,
    Detections,
    Labels,
    PhotoObject,
    Rgb,
)
from physgen.perceive.segment.network import run_network
from physgen.perceive.segment.plain_ground import shows_ground_beyond
from physgen.perceive.spheres import has_round_form, is_shaded_as_sphere
from physgen.perceive.support.view_classifier import view_chances
from physgen.problems import THIS_PHOTO, Problem

SOURCES_BY_HAND = ("given", "pointed at", "drawn", "kept")
"""Beginnings of the sources of masks from the user."""

# Limits of a label map: ids if most of them are specks, and objects in any case.
MOST_IDS, MOST_OBJECTS = (200, 5000)

EXACTLY_ROUND = 0.975
"""Least IoU of a mask with its circle for a disc of any label: a wheel, a lid.

In COCO's photos a clock reaches 0.90, a pizza 0.93, a cup 0.96.
"""

CUT_END = 0.2
"""Width of an end at the border that is cut off, by the root of the mask's area.

A narrower one is the flank of a plate or the foot of a figure: next to nothing of it is
outside the photo.
"""
OUTSIDE = 0.04
"""Largest part of a whole object's outline beyond the border, in the same unit."""
BROAD_END = 0.3
"""Width of an end that the border cuts, by the root of the mask's area.

Of COCO's photos, nine masks end near the border without touching it: all nine objects
are complete, and eight of these ends are narrower.
"""

# Least IoU of a mask with its circle for its replacement; balls have 0.96.
NEARLY_ROUND = 0.93
# The same for one of several balls of equal size: in a rack, a neighbour's shadow hides
# the rim.
ROUND_AMONG_EQUALS = 0.8
# Least number of other nearly round objects of equal size.
FEWEST_EQUALS = 3
# Largest relative difference of equal radii.
EQUAL_RADIUS = 0.04
# Largest distance from the centre, in radii, of a mask that is cut back to its disc; a
# handle reaches farther.
FARTHEST_SLIVER = 1.2


def fit_objects(rgb: Rgb, detections: Detections) -> tuple[list[PhotoObject], int]:
    """Return every object with its outline, without specks, and the number of
    specks.
    """
    labels = detections.labels
    _check_size(labels, rgb)
    height, width = rgb.shape[:2]
    ids, count = _list_object_ids(detections)
    if not ids:
        return [], count
    outlines = fit_outlines(labels, ids)
    # The mask of a network may end slightly before the border that cuts its object.
    margin = min(round(0.012 * max(width, height)), min(width, height) // 4)
    ids_at_border = _find_ids_at_border(labels, 0) | _find_ids_at_border(labels, margin)
    objects = []
    for i in ids:
        outline = outlines[i]
        is_cut = _reaches_outside(outline, width, height)
        is_uncertain = not (_is_exact(detections, i) or isinstance(outline, Disc))
        # Masks of objects far from the border need no look: a map may have thousands.
        if not is_cut and i in ids_at_border:
            mask = labels == i
            is_cut = _ends_broadly(mask, 0, CUT_END)
            # Visible ground outside the mask shows that the object is complete, and so
            # does a mask that only a narrow tip brings near the border.
            if not is_cut and is_uncertain and _ends_broadly(mask, margin, BROAD_END):
                is_cut = not shows_ground_beyond(rgb, mask, margin)
        objects.append(PhotoObject(i, outline, cut=is_cut))
    return objects, count - len(ids)


def _check_size(labels: Labels, rgb: Rgb) -> None:
    """Raise InputError if a label map has another size than the photo."""
    height, width = rgb.shape[:2]
    if labels.shape != (height, width):
        size = f"{labels.shape[1]} x {labels.shape[0]} px"
        message = Message.NOT_PHOTO_SIZE
        raise message.error("--masks", size, width=width, height=height)


def _list_object_ids(detections: Detections) -> tuple[list[int], int]:
    """Return the ids of all objects, without specks, and the number of all ids.

    Raises InputError if a label map of the user contains too many or no objects.
    """
    counts = np.bincount(detections.labels.ravel(), minlength=2)
    all_ids = np.flatnonzero(counts[1:]) + 1
    ids = []
    for i in all_ids:
        if counts[i] >= SMALLEST_OBJECT:
            ids.append(int(i))
    has_mostly_specks = 2 * len(ids) < len(all_ids)
    is_photo = len(all_ids) > MOST_IDS and has_mostly_specks
    if is_photo or len(ids) > MOST_OBJECTS:
        specks = ""
        if has_mostly_specks:
            specks = ", most of them of a few pixels"
        count = f"{len(all_ids):,} ids{specks}"
        raise Message.NOT_A_LABEL_MAP.error("--masks", count=count)
    if not ids and detections.source == "given":
        if len(all_ids):
            raise Message.MASKS_OF_SPECKS.error("--masks", least=SMALLEST_OBJECT)
        raise Message.MASKS_EMPTY.error("--masks")
    return ids, len(all_ids)


def _find_ids_at_border(labels: Labels, margin: int) -> set[int]:
    """Return the ids at a distance of `margin` px from the photo's border."""
    sides = (
        labels[margin],
        labels[-1 - margin],
        labels[:, margin],
        labels[:, -1 - margin],
    )
    return set(np.unique(np.concatenate(sides)).tolist())


def _ends_broadly(mask: Mask, margin: int, share: float) -> bool:
    """Return whether a broad part of a mask lies within `margin` px of a border.

    `share`: its least width, by the root of the mask's area.
    """
    sides = (
        mask[: margin + 1].any(axis=0),
        mask[-margin - 1 :].any(axis=0),
        mask[:, : margin + 1].any(axis=1),
        mask[:, -margin - 1 :].any(axis=1),
    )
    # The broadest end decides: corners touch two borders with narrow ends.
    width = max(np.count_nonzero(side) for side in sides)
    return bool(width > share * np.count_nonzero(mask) ** 0.5)


def _reaches_outside(outline: Outline, width: int, height: int) -> bool:
    """Return whether more than a narrow part of an outline is outside the photo."""
    x0, y0, x1, y1 = bounds(outline)
    # Pixel centres are at whole numbers: the photo ends half a pixel beyond them.
    excess = max(-0.5 - x0, -0.5 - y0, x1 - width + 0.5, y1 - height + 0.5)
    return bool(excess > OUTSIDE * hypot(x1 - x0, y1 - y0))


def _is_exact(detections: Detections, i: int) -> bool:
    """Return whether the user gave, drew or selected a mask."""
    source = detections.mask_sources.get(i) or detections.source
    return i in detections.prompts or source.startswith(SOURCES_BY_HAND)


def attach_loose_parts(
    rgb: Rgb, detections: Detections, view: BoundaryGuess | None
) -> Detections:
    """Return the detections with parts that move with their objects, as the view tells."""
    if view is not None:
        return detections
    chances = view_chances(run_network(rgb).features)
    if chances.tilt is not None:
        return attach_contents(detections)
    if chances.is_level:
        attached = attach_hanging_parts(detections.labels, detections.confidence)
        return replace(detections, labels=attached)
    return detections


def remain_problem(remain: Remain, name: str) -> Problem:
    """Return a warning about a narrow part beside an object that may stay behind."""
    x, y = remain.place
    description = f"something narrow at {x}, {y}"
    path = f"objects.{name}.mask"
    return Message.REMAINS_BEHIND.warning(THIS_PHOTO, path, description)


def outline_as_named(
    rgb: Rgb, labels: Labels, objects: Sequence[PhotoObject]
) -> list[PhotoObject]:
    """Return the objects, with circles replaced by regions unless there is evidence for
    them.

    Evidence is the label of a round object or the shading of a sphere: a pouf, a van or
    the face of a box does not roll.
    """
    rejected_ids = []
    for item in objects:
        if (
            isinstance(item.outline, Disc)
            and not has_round_form(kind(item.label))
            and not is_shaded_as_sphere(rgb, item.outline)
            and disc_iou(item.outline, labels == item.id) < EXACTLY_ROUND
        ):
            rejected_ids.append(item.id)
    if not rejected_ids:
        return list(objects)
    ids = [item.id for item in objects]
    regions = fit_outlines(labels, ids, never_discs=rejected_ids)
    return [
        replace(item, outline=regions[item.id]) if item.id in rejected_ids else item
        for item in objects
    ]


def replace_by_discs(labels: Labels, objects: Sequence[PhotoObject]) -> Labels:
    """Return the label map with the masks of round objects extended to their discs.

    A mask is extended only if it changes little, so that a mug keeps its handle. One of
    several balls of equal size may change more, and slivers beside its disc go.
    """
    size = labels.shape[1], labels.shape[0]
    discs = {}
    for item in objects:
        if isinstance(item.outline, Disc):
            discs[item.id] = item.outline
    areas = {i: raster.coverage(disc, size) >= 0.5 for i, disc in discs.items()}
    overlaps = {i: _overlap_with_disc(labels, i, area) for i, area in areas.items()}
    round_radii = np.array(
        [discs[i].radius for i, iou in overlaps.items() if iou > NEARLY_ROUND],
        np.float64,
    )
    result = labels.copy()
    for i, disc in discs.items():
        differences = np.abs(round_radii / disc.radius - 1)
        has_equals = np.count_nonzero(differences < EQUAL_RADIUS) >= FEWEST_EQUALS
        if overlaps[i] <= (ROUND_AMONG_EQUALS if has_equals else NEARLY_ROUND):
            continue
        if has_equals:
            result[_slivers(result == i, areas[i], disc)] = 0
        # Other parts outside the disc stay in the mask, not in the background.
        result[areas[i] & (result == 0)] = i
    return result


def _overlap_with_disc(labels: Labels, number: int, area: Mask) -> float:
    """Return the IoU of an object's mask with its disc, without the disc's parts that
    other objects cover.
    """
    mask = labels == number
    visible_area = area & (mask | (labels == 0))
    intersection = int(np.count_nonzero(mask & visible_area))
    union = int(np.count_nonzero(mask | visible_area))
    return intersection / max(union, 1)


def _slivers(mask: Mask, area: Mask, disc: Disc) -> Mask:
    """Return the parts (H, W) of a mask outside its disc, if none of them is wide."""
    outside = mask & ~area
    rows, columns = np.nonzero(outside)
    distances = np.hypot(columns - disc.center[0], rows - disc.center[1])
    if distances.max(initial=0.0) > FARTHEST_SLIVER * disc.radius:
        return np.zeros_like(outside)
    return outside
