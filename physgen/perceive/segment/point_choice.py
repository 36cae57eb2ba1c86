"""The object selected by a click: the best of the candidates and boxes at a point.

The judge rates the cut-outs of all boxes at the point, and of squares around it, beside
the candidates of the whole photo. It prefers wholes, including piles; a click lies deep
inside the intended object, and the head cuts that object out with higher confidence.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.perceive.roles import Mask, PromptedMask, Rgb
from physgen.perceive.segment.detector import box_overlap
from physgen.perceive.segment.judge import (
    JudgedCandidates,
    judge_others,
    judge_photo,
)
from physgen.perceive.segment.network import mask_in_box, rough_mask_in_box
from physgen.perceive.segment.proposals import Proposal, cut_out

Pixel = tuple[int, int]
"""Column and row of the photo."""
Scale = NDArray[np.float64]
"""Horizontal and vertical size of the photo over the candidates' grid."""


@dataclass(frozen=True)
class PointConstants:
    """Constants of clicks.

    Chosen on clicks on 75 objects of household photos, COCO's and two rendered piles.
    """

    # Least expected fit of a possible candidate.
    least_fit: float = 0.05
    # Least expected fit of the smallest possible candidate.
    smallest_fit: float = 0.1
    known_fit: float = 0.3
    """Expected fit of the best candidate above which the judge knows an object
    there.
    """
    # Largest number of candidates for a second cut-out.
    tries: int = 6
    same_box: float = 0.9
    """Least IoU of a box with the box of a candidate in its place."""
    photo_share: float = 0.9
    """Share of the photo above which a mask is the photo rather than an object."""
    caution: float = 0.8
    """Factor of a candidate's confidence relative to a cut-out around the point
    alone.
    """


POINT = PointConstants()


@dataclass(frozen=True, eq=False)
class PointChoice:
    """A candidate at a point."""

    candidate: Proposal
    # 0..1: expected IoU with the best object.
    fit: float
    # 0..1: depth of the point in the mask; 1 at the pixel farthest from its rim.
    depth: float
    # On the photo, if it is already cut out.
    mask: PromptedMask | None = None


@dataclass(frozen=True)
class Ranking:
    """Exponents and offsets of the criteria for the intended candidate."""

    shallow: float
    """Added to the depth of a click, since some clicks are near the rim."""
    # Exponent of the judge's fit.
    fit_power: float
    # Exponent of the IoU that the head expects.
    confidence_power: float

    def worth(self, choice: PointChoice, confidence: float = 1.0) -> float:
        """Return the rank of a candidate with a confidence of its cut-out."""
        depth = self.shallow + choice.depth
        fit = choice.fit**self.fit_power
        return float(depth * fit * confidence**self.confidence_power)


BY_DEPTH = Ranking(0.2, 0.5, 2.0)
"""Used if the judge knows objects there, including piles."""
BY_FIT = Ranking(2.0, 1.0, 0.5)
"""Used if the judge expects little of all candidates."""


def object_at_point(
    rgb: Rgb,
    pixel: Pixel,
    others: Sequence[Pixel],
    smallest: bool,
    look_around: Callable[[], Sequence[PromptedMask]],
) -> PromptedMask | None:
    """Return the best candidate at a pixel without the other pixels, or None.

    With `smallest`, it is the smallest likely one. `look_around` returns cut-outs
    around the pixel without candidates.
    """
    judgement = judge_photo(rgb)
    shape = judgement.candidates.shape
    scale = np.array([rgb.shape[1] / shape[1], rgb.shape[0] / shape[0]])
    choices = _choices(rgb, judgement, pixel, others, scale)
    if smallest:
        likely_choices = []
        for choice in choices:
            if choice.fit >= POINT.smallest_fit:
                likely_choices.append(choice)
        likely_choices.sort(key=lambda one: one.candidate.area)
        masks = _cut_out_again(rgb, likely_choices[: POINT.tries], pixel, others, scale)
        return next((mask for _, mask in masks), None)
    has_good_fit = (
        max((choice.fit for choice in choices), default=0.0) >= POINT.known_fit
    )
    if has_good_fit:
        ranking = BY_DEPTH
    else:
        ranking = BY_FIT
    choices += _judge_looks(rgb, judgement, look_around(), pixel, scale)
    choices.sort(key=lambda one: -ranking.worth(one))
    masks = list(_cut_out_again(rgb, choices[: POINT.tries], pixel, others, scale))
    if not masks:
        return None
    return max(masks, key=lambda pair: ranking.worth(pair[0], pair[1].confidence))[1]


def _choices(
    rgb: Rgb,
    judgement: JudgedCandidates,
    pixel: Pixel,
    others: Sequence[Pixel],
    scale: Scale,
) -> list[PointChoice]:
    """Return the candidates and the cut-outs of boxes at a pixel."""
    candidates = judgement.candidates
    cut_outs = []
    for proposal in _cut_out_boxes(rgb, judgement, pixel, scale):
        if _holds(proposal, pixel, others, scale):
            cut_outs.append(proposal)
    fits = np.concatenate([judgement.fit, judge_others(rgb, judgement, cut_outs)])
    rated_proposals = zip(
        [*candidates.proposals, *cut_outs], fits.tolist(), strict=True
    )
    return [
        PointChoice(proposal, fit, _depth(proposal, pixel, scale))
        for proposal, fit in rated_proposals
        if fit >= POINT.least_fit and _holds(proposal, pixel, others, scale)
    ]


def _judge_looks(
    rgb: Rgb,
    judgement: JudgedCandidates,
    looks: Sequence[PromptedMask],
    pixel: Pixel,
    scale: Scale,
) -> list[PointChoice]:
    """Return cut-outs around a pixel as choices."""
    size = judgement.candidates.shape[::-1]
    pieces: list[tuple[Proposal, PromptedMask]] = []
    for look in looks:
        share = cv2.resize(
            look.mask.astype(np.float32), size, interpolation=cv2.INTER_AREA
        )
        piece = cut_out(share >= 0.5, 0, 0, 1)
        if piece is not None and _holds(piece, pixel, (), scale):
            pieces.append((piece, look))
    fits = judge_others(rgb, judgement, [piece for piece, _ in pieces])
    return [
        PointChoice(piece, fit, _depth(piece, pixel, scale), look)
        for (piece, look), fit in zip(pieces, fits.tolist(), strict=True)
        if fit >= POINT.least_fit
    ]


def _cut_out_boxes(
    rgb: Rgb, judgement: JudgedCandidates, pixel: Pixel, scale: Scale
) -> Iterable[Proposal]:
    """Yield cut-outs of the boxes around a pixel that match no candidate."""
    boxes = judgement.boxes
    rectangles = np.array(
        [proposal.box for proposal in judgement.candidates.proposals], np.float64
    )
    corners = rectangles.reshape(-1, 4) * np.tile(scale, 2)
    best_overlap = box_overlap(boxes.corners, corners).max(axis=1, initial=0.0)
    is_inside = (boxes.corners[:, :2] <= pixel) & (boxes.corners[:, 2:] > pixel)
    is_free = is_inside.all(axis=1) & (best_overlap < POINT.same_box)
    for k in np.flatnonzero(is_free).tolist():
        piece = rough_mask_in_box(rgb, boxes.corners[k], judgement.candidates.shape)
        if piece is not None:
            yield piece


def _cut_out_again(
    rgb: Rgb,
    choices: Iterable[PointChoice],
    pixel: Pixel,
    others: Sequence[Pixel],
    scale: Scale,
) -> Iterable[tuple[PointChoice, PromptedMask]]:
    """Yield candidates with their masks on the photo, if those contain only the own
    pixel.
    """
    for choice in choices:
        cut_out_mask = choice.mask or mask_in_box(
            rgb, choice.candidate.box * np.tile(scale, 2)
        )
        if (
            contains_prompt(cut_out_mask.mask, pixel, others)
            and cut_out_mask.mask.mean() < POINT.photo_share
        ):
            confidence = POINT.caution * cut_out_mask.confidence
            yield choice, PromptedMask(cut_out_mask.mask, confidence)


def contains_prompt(mask: Mask, pixel: Pixel, others: Sequence[Pixel]) -> bool:
    """Return whether a mask (H, W) contains the own pixel and none of the others."""
    return bool(mask[pixel[::-1]]) and not any(mask[v, u] for u, v in others)


def _place(proposal: Proposal, pixel: Pixel, scale: Scale) -> Pixel:
    """Return a pixel of the photo as column and row of a candidate's mask."""
    x, y = (
        ((np.array(pixel) + 0.5) / scale - (proposal.x, proposal.y))
        .astype(int)
        .tolist()
    )
    return x, y


def _holds(
    proposal: Proposal, position: Pixel, others: Sequence[Pixel], scale: Scale
) -> bool:
    """Return whether a candidate contains the own pixel of the photo and none of the
    others.
    """

    def contains(pixel: Pixel) -> bool:
        x, y = _place(proposal, pixel, scale)
        height, width = proposal.mask.shape
        return 0 <= x < width and 0 <= y < height and bool(proposal.mask[y, x])

    return contains(position) and not any(map(contains, others))


def _depth(proposal: Proposal, pixel: Pixel, scale: Scale) -> float:
    """Return the relative depth of a pixel of the photo in a candidate, 0..1."""
    mask = np.pad(proposal.mask, 1).astype(np.uint8)
    distances = cv2.distanceTransform(mask, cv2.DIST_L2, 5)[1:-1, 1:-1]
    x, y = _place(proposal, pixel, scale)
    return float(distances[y, x] / distances.max())
