"""People and animals, which are never moved, their parts, and toy animals.

The detector takes toys for animals. ImageNet has a class of dinosaurs, all of whose
photos show models. Other animals may be toys if the photo looks like photos of loose
objects at rest, but this evidence is too weak to move them.
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
    """Constants of people and animals; those of toys were chosen on 200 photos of COCO
    and Caltech-101.
    """

    box: float = 0.25
    """Least score of an examined box of an animal.

    Also the score of a candidate's own box above which the candidate is not a part: on
    60 photos, objects held by people have at least .34.
    """
    # Largest number of examined boxes: each costs 30 ms.
    looks: int = 3
    loose: float = 0.1
    """Probability of a photo without loose objects below which an animal may be a toy.

    Nine of ten photos of real animals have more.
    """
    # Confidence that such an animal is a toy.
    confidence: float = 0.3
    reason: str = "looks like an animal; if it is a toy, move it to objects"
    # Least share of a candidate's box inside its animal's box.
    inside: float = 0.7
    # Least share of a candidate that the animal's cut-out covers.
    covered_share: float = 0.8


LIVING = LivingConstants()


def release_models(rgb: NDArray[np.uint8], boxes: DetectedBoxes) -> DetectedBoxes:
    """Return the boxes of a photo (H, W, 3) sRGB, with models of animals as movable
    wholes.
    """
    animals = _animals(boxes)
    models = []
    for k in animals:
        if _is_model(rgb, boxes.corners[k]):
            models.append(k)
    if not models:
        return boxes
    is_model = _inside(boxes.corners, boxes.corners[models])
    return boxes.as_movable(is_model, ANIMALS)


def find_likely_toys(
    rgb: NDArray[np.uint8], boxes: DetectedBoxes, labels: NDArray[np.uint16]
) -> list[Doubt]:
    """Return animals that may be toys, outside objects (`labels` (H, W) > 0)."""
    animals = _animals(boxes)
    if not animals:
        return []
    if view_chances(run_network(rgb).features).unsuitable >= LIVING.loose:
        return []
    free = labels == 0
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
    candidates: Sequence[Proposal],
    shape: tuple[int, int],
) -> Flags:
    """Return (n,) whether chosen candidates are parts of people or animals.

    The cut-out of a person covers a hand, but also a held object; the held object has a
    box of its own. `boxes` are on the photo, candidates on its grid of `shape` (h, w).
    """
    is_part = np.zeros(len(candidates), np.bool_)
    living = _living(boxes)
    if not len(candidates) or not living:
        return is_part
    grid = boxes.scale_to(shape[1] / rgb.shape[1], shape[0] / rgb.shape[0]).corners
    rectangles = np.array([proposal.box for proposal in candidates], np.float64)
    own_scores = (box_overlap(rectangles, grid) ** 2 * boxes.movable).max(axis=1)
    inside = box_shares(rectangles, grid[living]) >= LIVING.inside
    inside &= own_scores[:, None] < LIVING.box
    for place in np.flatnonzero(inside.any(axis=0)).tolist():
        cut_out_mask = rough_mask_in_box(rgb, boxes.corners[living[place]], shape)
        for k in np.flatnonzero(inside[:, place]).tolist():
            is_part[k] |= cut_out_mask is not None and _is_part(
                candidates[k], cut_out_mask
            )
    return is_part


def _living(boxes: DetectedBoxes) -> list[int]:
    """Return the indices of boxes that certainly show a person or an animal."""
    classes = boxes.classes
    living = classes[:, [*PERSON, *ANIMALS]].max(axis=1, initial=0.0)
    confident_boxes = (living >= WHOLE.score) & (boxes.immovable >= WHOLE.score)
    return list(
        map(int, np.flatnonzero(confident_boxes & (boxes.immovable > boxes.movable)))
    )


def _is_part(part: Proposal, whole: Proposal) -> bool:
    """Return whether a person's cut-out covers a candidate and more."""
    covers_candidate = overlap(part, whole) >= LIVING.covered_share * part.area
    return covers_candidate and part.area <= PART * whole.area


def _animals(boxes: DetectedBoxes) -> list[int]:
    """Return the indices of the best boxes of animals, without parts of each other."""
    classes = boxes.classes
    animal = classes[:, list(ANIMALS)].max(axis=1, initial=0.0)
    person = classes[:, list(PERSON)].max(axis=1, initial=0.0)
    is_animal = (animal > LIVING.box) & (animal >= person)
    is_animal &= boxes.immovable > boxes.movable
    best: list[int] = []
    order = np.argsort(-animal, kind="stable")
    for k in order[is_animal[order]].tolist():
        own_corners = boxes.corners[[k]]
        if not best or not _inside(own_corners, boxes.corners[best])[0]:
            best.append(k)
    return best[: LIVING.looks]


def _inside(corners: Array, others: Array) -> Flags:
    """Return (n,) whether boxes (n, 4) lie mostly in one of the others (m, 4)."""
    return np.asarray((box_shares(corners, others) >= WITHIN).any(axis=1))


def _is_model(rgb: NDArray[np.uint8], corners: Array) -> bool:
    """Return whether a box shows an animal of a kind that exists only as models."""
    left, top, right, bottom = np.rint(corners).astype(int).tolist()
    if min(right - left, bottom - top) < 2:
        return False
    box_mask = np.zeros(rgb.shape[:2], np.bool_)
    box_mask[top:bottom, left:right] = True
    return bool(heads().is_model(features(crop(rgb, box_mask))[None])[0])
