"""What a click means: the best of the candidates and boxes at a point.

The judge rates the cut-outs of all of the detector's boxes there, and of squares around
the point, beside the candidates of the whole photo. It prefers wholes, piles among them;
a click lies deep in what is meant, and the head cuts that out more surely.
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
"""Across and down: how many times as large as the candidates' grid the photo is."""


@dataclass(frozen=True)
class PointConstants:
    """Constants of clicks.

    Chosen on clicks on 75 objects of household photos, COCO's and two rendered piles.
    """

    least: float = 0.05  # expected fit from which a candidate may be meant
    likely: float = 0.1  # expected fit from which the smallest candidate may be meant
    sure: float = 0.3
    """Expected fit of the best from which the judge knows an object there."""
    tries: int = 6  # candidates that are cut out again at most
    same_box: float = 0.9
    """IoU of a box with a candidate's from which the candidate stands for it."""
    whole: float = 0.9
    """Share of the photo from which a mask is the photo and no object."""
    caution: float = 0.8
    """Factor on a candidate's confidence beside what is seen around the point alone."""


POINT = PointConstants()


@dataclass(frozen=True, eq=False)
class PointChoice:
    """A candidate at a point."""

    candidate: Proposal
    fit: float  # 0..1: expected IoU with the best object
    depth: float  # 0..1: of the point in the mask; 1 is the pixel farthest from its rim
    mask: PromptedMask | None = None  # on the photo, if it is cut out already


@dataclass(frozen=True)
class Ranking:
    """Weights of what tells the candidate that is meant."""

    shallow: float
    """Added to the depth of a click, since some lie near the rim."""
    fit_power: float  # of the judge's fit
    confidence_power: float  # of the IoU that the head expects

    def worth(self, one: PointChoice, confidence: float = 1.0) -> float:
        """Return the rank of a candidate that is cut out with some confidence."""
        depth = self.shallow + one.depth
        fit = one.fit**self.fit_power
        return float(depth * fit * confidence**self.confidence_power)


BY_DEPTH = Ranking(0.2, 0.5, 2.0)
"""If the judge knows objects there, piles among them."""
BY_FIT = Ranking(2.0, 1.0, 0.5)
"""If the judge expects little of all candidates."""


def object_at_point(
    rgb: Rgb,
    own: Pixel,
    others: Sequence[Pixel],
    smallest: bool,
    look_around: Callable[[], Sequence[PromptedMask]],
) -> PromptedMask | None:
    """Return the best candidate at a pixel that holds none of the other ones.

    With `smallest`, the smallest likely one. None if there is none. `look_around`
    returns what is seen around the pixel without candidates.
    """
    judged = judge_photo(rgb)
    shape = judged.found.shape
    scale = np.array([rgb.shape[1] / shape[1], rgb.shape[0] / shape[0]])
    choices = _choices(rgb, judged, own, others, scale)
    if smallest:
        likely = [one for one in choices if one.fit >= POINT.likely]
        likely.sort(key=lambda one: one.candidate.area)
        masks = _cut_out_again(rgb, likely[: POINT.tries], own, others, scale)
        return next((mask for _, mask in masks), None)
    is_known = max((one.fit for one in choices), default=0.0) >= POINT.sure
    ranking = BY_DEPTH if is_known else BY_FIT
    choices += _judge_looks(rgb, judged, look_around(), own, scale)
    choices.sort(key=lambda one: -ranking.worth(one))
    masks = list(_cut_out_again(rgb, choices[: POINT.tries], own, others, scale))
    if not masks:
        return None
    return max(masks, key=lambda pair: ranking.worth(pair[0], pair[1].confidence))[1]


def _choices(
    rgb: Rgb,
    judged: JudgedCandidates,
    own: Pixel,
    others: Sequence[Pixel],
    scale: Scale,
) -> list[PointChoice]:
    """Return the candidates and the cut-outs of boxes at a pixel."""
    found = judged.found
    cut_outs = [
        one
        for one in _cut_out_boxes(rgb, judged, own, scale)
        if _holds(one, own, others, scale)
    ]
    fits = np.concatenate([judged.fit, judge_others(rgb, judged, cut_outs)])
    some = zip([*found.proposals, *cut_outs], fits.tolist(), strict=True)
    return [
        PointChoice(one, fit, _depth(one, own, scale))
        for one, fit in some
        if fit >= POINT.least and _holds(one, own, others, scale)
    ]


def _judge_looks(
    rgb: Rgb,
    judged: JudgedCandidates,
    looks: Sequence[PromptedMask],
    own: Pixel,
    scale: Scale,
) -> list[PointChoice]:
    """Return what is seen around a pixel as choices."""
    size = judged.found.shape[::-1]
    pieces: list[tuple[Proposal, PromptedMask]] = []
    for look in looks:
        share = cv2.resize(
            look.mask.astype(np.float32), size, interpolation=cv2.INTER_AREA
        )
        piece = cut_out(share >= 0.5, 0, 0, 1)
        if piece is not None and _holds(piece, own, (), scale):
            pieces.append((piece, look))
    fits = judge_others(rgb, judged, [piece for piece, _ in pieces])
    return [
        PointChoice(piece, fit, _depth(piece, own, scale), look)
        for (piece, look), fit in zip(pieces, fits.tolist(), strict=True)
        if fit >= POINT.least
    ]


def _cut_out_boxes(
    rgb: Rgb, judged: JudgedCandidates, own: Pixel, scale: Scale
) -> Iterable[Proposal]:
    """Yield cut-outs of the boxes around a pixel that no candidate stands for."""
    boxes = judged.boxes
    rectangles = np.array([one.box for one in judged.found.proposals], np.float64)
    corners = rectangles.reshape(-1, 4) * np.tile(scale, 2)
    known = box_overlap(boxes.corners, corners).max(axis=1, initial=0.0)
    is_inside = (boxes.corners[:, :2] <= own) & (boxes.corners[:, 2:] > own)
    is_free = is_inside.all(axis=1) & (known < POINT.same_box)
    for k in np.flatnonzero(is_free).tolist():
        piece = rough_mask_in_box(rgb, boxes.corners[k], judged.found.shape)
        if piece is not None:
            yield piece


def _cut_out_again(
    rgb: Rgb,
    choices: Iterable[PointChoice],
    own: Pixel,
    others: Sequence[Pixel],
    scale: Scale,
) -> Iterable[tuple[PointChoice, PromptedMask]]:
    """Yield candidates with their masks on the photo, if those hold the pixel alone."""
    for one in choices:
        found = one.mask or mask_in_box(rgb, one.candidate.box * np.tile(scale, 2))
        if is_meant(found.mask, own, others) and found.mask.mean() < POINT.whole:
            confidence = POINT.caution * found.confidence
            yield one, PromptedMask(found.mask, confidence)


def is_meant(mask: Mask, own: Pixel, others: Sequence[Pixel]) -> bool:
    """Return whether a mask (H, W) holds the own pixel and no other one."""
    return bool(mask[own[::-1]]) and not any(mask[v, u] for u, v in others)


def _place(one: Proposal, pixel: Pixel, scale: Scale) -> Pixel:
    """Return a pixel of the photo as column and row of a candidate's mask."""
    x, y = ((np.array(pixel) + 0.5) / scale - (one.x, one.y)).astype(int).tolist()
    return x, y


def _holds(one: Proposal, own: Pixel, others: Sequence[Pixel], scale: Scale) -> bool:
    """Return whether a candidate holds the own pixel of the photo and no other."""

    def has(pixel: Pixel) -> bool:
        x, y = _place(one, pixel, scale)
        height, width = one.mask.shape
        return 0 <= x < width and 0 <= y < height and bool(one.mask[y, x])

    return has(own) and not any(map(has, others))


def _depth(one: Proposal, own: Pixel, scale: Scale) -> float:
    """Return how deep a pixel of the photo lies in a candidate, 0..1."""
    mask = np.pad(one.mask, 1).astype(np.uint8)
    distances = cv2.distanceTransform(mask, cv2.DIST_L2, 5)[1:-1, 1:-1]
    x, y = _place(one, own, scale)
    return float(distances[y, x] / distances.max())
