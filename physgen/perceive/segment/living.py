"""People and animals, which are never moved, their parts, and toys shaped like animals.

The detector takes toys for animals. ImageNet has a class of dinosaurs, of which all
photos show models. Other animals may be toys if the photo looks like photos of loose
objects at rest; that is too little to move them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from physgen.perceive.backends.label_imagenet import crop, features, heads
from physgen.perceive.roles import Doubt
from physgen.perceive.segment.detector import (
    DetectedBoxes,
    box_overlap,
    box_shares,
)
from physgen.perceive.segment.evidence import ANIMALS, PART, PERSON, WITHIN
from physgen.perceive.segment.network import mask_in_box, rough_mask_in_box, run_network
from physgen.perceive.segment.proposals import Proposal, cut_out, doubt_about, overlap
from physgen.perceive.segment.selection import WHOLE
from physgen.perceive.support.view_classifier import view_chances

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]


@dataclass(frozen=True)
class LivingConstants:
    """Constants of what lives: of toys, chosen on 200 photos of COCO and Caltech-101."""

    box: float = 0.25
    """Score of an animal from which a box is looked at.

    Also that of a candidate's own box, from which the candidate is no part: on 60 photos
    what people hold has .34 or more.
    """
    looks: int = 3  # boxes that are looked at: each costs 30 ms
    loose: float = 0.1
    """Chance of a photo without loose objects, below which an animal may be a toy.

    Nine of ten photos of real animals have more.
    """
    confidence: float = 0.3  # that such an animal is a toy
    reason: str = "looks like an animal; if it is a toy, move it to objects"
    inside: float = 0.7  # share of a candidate's box in its box
    covered: float = 0.8  # share of a candidate that its cut-out covers


LIVING = LivingConstants()


def release_models(rgb: NDArray[np.uint8], boxes: DetectedBoxes) -> DetectedBoxes:
    """Return the boxes of a photo (H, W, 3) sRGB, models of animals as movable wholes."""
    animals = _animals(boxes)
    models = [k for k in animals if _is_model(rgb, boxes.corners[k])]
    if not models:
        return boxes
    is_model = _inside(boxes.corners, boxes.corners[models])
    return boxes.as_movable(is_model, ANIMALS)


def find_likely_toys(
    rgb: NDArray[np.uint8], boxes: DetectedBoxes, taken: NDArray[np.uint16]
) -> list[Doubt]:
    """Return animals that may be toys, where no object is `taken` (H, W) > 0."""
    animals = _animals(boxes)
    if not animals:
        return []
    if view_chances(run_network(rgb).features).unsuitable >= LIVING.loose:
        return []
    free = taken == 0
    doubts: list[Doubt] = []
    for k in animals:
        piece = cut_out(mask_in_box(rgb, boxes.corners[k]).mask & free, 0, 0, 1)
        if piece is not None:
            free &= ~piece.on(free.shape)
            for doubt in doubt_about(piece, LIVING.confidence):
                doubts.append(replace(doubt, reason=LIVING.reason))
    return doubts


def parts_of_living(
    rgb: NDArray[np.uint8],
    boxes: DetectedBoxes,
    chosen: Sequence[Proposal],
    shape: tuple[int, int],
) -> Flags:
    """Return (n,) which chosen candidates are parts of people or animals.

    The cut-out of a person covers a hand, and what a person holds as well, but that has
    a box of its own. `boxes` are on the photo, candidates on its grid of `shape` (h, w).
    """
    is_part = np.zeros(len(chosen), np.bool_)
    living = _living(boxes)
    if not len(chosen) or not living:
        return is_part
    grid = boxes.scaled(shape[1] / rgb.shape[1], shape[0] / rgb.shape[0]).corners
    rectangles = np.array([one.box for one in chosen], np.float64)
    own = (box_overlap(rectangles, grid) ** 2 * boxes.movable).max(axis=1)
    inside = box_shares(rectangles, grid[living]) >= LIVING.inside
    inside &= own[:, None] < LIVING.box
    for place in np.flatnonzero(inside.any(axis=0)).tolist():
        whole = rough_mask_in_box(rgb, boxes.corners[living[place]], shape)
        for k in np.flatnonzero(inside[:, place]).tolist():
            is_part[k] |= whole is not None and _is_part(chosen[k], whole)
    return is_part


def _living(boxes: DetectedBoxes) -> list[int]:
    """Return the indices of boxes that are surely of a person or an animal."""
    classes = boxes.classes
    living = classes[:, [*PERSON, *ANIMALS]].max(axis=1, initial=0.0)
    is_sure = (living >= WHOLE.score) & (boxes.immovable >= WHOLE.score)
    return [int(k) for k in np.flatnonzero(is_sure & (boxes.immovable > boxes.movable))]


def _is_part(one: Proposal, whole: Proposal) -> bool:
    """Return whether a person's cut-out covers a candidate and more beside it."""
    is_covered = overlap(one, whole) >= LIVING.covered * one.area
    return is_covered and one.area <= PART * whole.area


def _animals(boxes: DetectedBoxes) -> list[int]:
    """Return the indices of the best boxes of animals, without parts of one another."""
    classes = boxes.classes
    animal = classes[:, list(ANIMALS)].max(axis=1, initial=0.0)
    person = classes[:, list(PERSON)].max(axis=1, initial=0.0)
    is_animal = (animal > LIVING.box) & (animal >= person)
    is_animal &= boxes.immovable > boxes.movable
    best: list[int] = []
    order = np.argsort(-animal, kind="stable")
    for k in order[is_animal[order]].tolist():
        own = boxes.corners[[k]]
        if not best or not _inside(own, boxes.corners[best])[0]:
            best.append(k)
    return best[: LIVING.looks]


def _inside(corners: Array, others: Array) -> Flags:
    """Return (n,) which boxes (n, 4) are for the most part in one of others (m, 4)."""
    return np.asarray((box_shares(corners, others) >= WITHIN).any(axis=1))


def _is_model(rgb: NDArray[np.uint8], corners: Array) -> bool:
    """Return whether a box shows an animal of which there are models only."""
    left, top, right, bottom = np.rint(corners).astype(int).tolist()
    if min(right - left, bottom - top) < 2:
        return False
    shown = np.zeros(rgb.shape[:2], np.bool_)
    shown[top:bottom, left:right] = True
    return bool(heads().is_model(features(crop(rgb, shown))[None])[0])
