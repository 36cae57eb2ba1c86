"""People, animals and other objects of a photo, which are not copied into its ground."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.perceive.roles import Mask, Rgb
from physgen.perceive.segment.detector import DetectedBoxes, detect_boxes
from physgen.perceive.segment.evidence import ANIMALS, PERSON
from physgen.perceive.segment.network import rough_mask_in_box, run_network


@dataclass(frozen=True)
class BarrierLimits:
    """Limits of objects that are not copied."""

    score: float = 0.5
    """Least score of a person, an animal or a movable whole: hands of people score as
    high.
    """
    rim_share: float = 0.25
    """Share of a hole's rim above which the hole lies in front of the object, which
    then continues in it.
    """
    # px: width of that rim.
    rim: int = 4


BARRIERS = BarrierLimits()


def find_copy_barriers(rgb: Rgb, hole: Mask) -> Mask:
    """Return the pixels (H, W) of objects beside the `hole` (H, W) of a photo (H, W, 3).

    A hand over a table is not copied into the table. An object around most of the hole
    is the ground of the hole.
    """
    result = np.zeros_like(hole)
    if not hole.any():
        return result
    names, rim_sizes, rim_mask = _rims(hole)
    for barrier in _visible_objects(rgb):
        covered = np.bincount(names[rim_mask & barrier], minlength=len(rim_sizes))
        if (covered <= BARRIERS.rim_share * rim_sizes).all():
            result |= barrier
    return result & ~hole


def _rims(hole: Mask) -> tuple[NDArray[np.int32], NDArray[np.int64], Mask]:
    """Return the numbers (H, W) of the pieces of a hole with their rims, the sizes (n,)
    of the rims, and the rims (H, W).
    """
    square = np.ones((2 * BARRIERS.rim + 1, 2 * BARRIERS.rim + 1), np.uint8)
    wide_hole = cv2.dilate(hole.view(np.uint8), square)
    count, names = cv2.connectedComponents(wide_hole, connectivity=8)
    rim_mask = (wide_hole > 0) & ~hole
    rim_sizes = np.bincount(names[rim_mask], minlength=count)
    return np.asarray(names, np.int32), np.asarray(rim_sizes, np.int64), rim_mask


def _visible_objects(rgb: Rgb) -> Iterator[Mask]:
    """Yield the pixels (H, W) of each detected person, animal or movable whole."""
    boxes = detect_boxes(rgb)
    shape = run_network(rgb).foreground.shape
    height, width = rgb.shape[:2]
    for k in np.flatnonzero(_scores(boxes) >= BARRIERS.score).tolist():
        proposal = rough_mask_in_box(rgb, boxes.corners[k], (shape[0], shape[1]))
        if proposal is None:
            continue
        mask = proposal.on(shape).view(np.uint8)
        large = cv2.resize(mask, (width, height), interpolation=cv2.INTER_NEAREST)
        yield large > 0


def _scores(boxes: DetectedBoxes) -> NDArray[np.float64]:
    """Return the scores (n,) of boxes as people, animals or movable wholes."""
    living = boxes.classes[:, [*PERSON, *ANIMALS]].max(axis=1, initial=0.0)
    movable = np.where(boxes.movable > boxes.immovable, boxes.movable, 0.0)
    return np.asarray(np.maximum(living, movable), np.float64)
