"""Backend segment=learned: boxes, groups and edges propose, a head draws, a judge chooses."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.perceive.roles import Doubt, Segment, Segments
from physgen.perceive.segment.candidates import Candidates
from physgen.perceive.segment.detector import box_overlap
from physgen.perceive.segment.evidence import COLOUR_STEPS, FEATURES, colour_steps
from physgen.perceive.segment.focus import blur_shares, rim_sharpness
from physgen.perceive.segment.judge import (
    JudgedCandidates,
    confidence,
    judge_photo,
)
from physgen.perceive.segment.living import find_likely_toys, parts_of_living
from physgen.perceive.segment.network import mask_in_box
from physgen.perceive.segment.pieces import unite_pieces
from physgen.perceive.segment.plain_ground import cut_out_on_plain
from physgen.perceive.segment.proposals import (
    Mask,
    Proposal,
    cut_out,
    doubt_about,
    overlap,
)
from physgen.perceive.segment.selection import (
    SHARED,
    Selection,
    choose_candidates,
    unite_parts,
)

Array = NDArray[np.float64]


@dataclass(frozen=True)
class LearnedConstants:
    """Constants of the choice, chosen on photos that the judge learns from."""

    threshold: float = 0.55  # expected fit above which a candidate may be an object
    agreement: float = 0.5  # bonus of what the photo's edges select as well
    possible: float = 0.35  # expected fit from which that counts: edges bound gaps, too
    foreground: tuple[float, float] = (0.3, 0.6)
    """Mean foreground from which that counts in part, and in full."""
    gap_penalty: float = 0.35  # of a candidate whose colours continue around it
    rarer: float = 3.0
    """Factor by which a colour may be rarer there and still count as continued."""
    explained: tuple[float, float] = (0.5, 0.8)
    """Share of such colours from which that counts in part, and in full."""
    own_box: tuple[float, float] = (0.55, 0.7)
    """Score of its own box from which a candidate is no gap in part, and for sure."""
    doubtful: float = 0.1  # confidence from which a candidate is a doubtful object
    doubts: int = 8  # doubtful objects at most
    same_box: float = 0.7
    """IoU of a candidate's box with the one that it was cut out in, from which it is cut
    out there again; on 200 objects the masks are as good, in less time."""
    same: float = 0.5  # IoU below which what is cut out again is another object
    round: float = 0.9
    """Share of its smallest enclosing circle from which an object is round."""


LEARNED = LearnedConstants()


def learned() -> Segment:
    """Return the segmenter; it is deterministic and keeps no state."""
    return segment


@dataclass(frozen=True)
class Rules:
    """The rules that choose among candidates; measurements take one away."""

    gaps: bool = True  # drop gaps between others
    wholes: bool = True  # put wholes in place of their parts
    living: bool = True  # drop parts of people and animals
    focus: bool = True  # drop the blurred background
    pieces: bool = True  # put an object in place of its loose pieces


ALL_RULES = Rules()


def segment(rgb: NDArray[np.uint8]) -> Segments:
    """Return the movable objects of a photo (H, W, 3) uint8 sRGB, and doubtful ones."""
    judged = judge_photo(rgb)
    objects = choose_objects(rgb, judged)
    toys = find_likely_toys(rgb, judged.boxes, objects.labels)
    return replace(objects, doubtful=[*toys, *objects.doubtful])


def choose_objects(
    rgb: NDArray[np.uint8], judged: JudgedCandidates, rules: Rules = ALL_RULES
) -> Segments:
    """Return the objects among the candidates of a photo, and doubtful ones."""
    found = judged.found
    fit = with_agreement(judged.fit, found.edges, found.features)
    best = choose_candidates(found.proposals, found.shape, fit, LEARNED.threshold)
    if rules.gaps:
        fit[best] -= _gap_penalties(rgb, judged, best, fit[best])
        best = best[fit[best] > LEARNED.threshold]
    selection = Selection(best)
    if rules.wholes:
        boxes = judged.boxes.scaled(*_scale_to(found.shape, rgb))
        selection = unite_parts(found.proposals, best, (judged.fit, fit), boxes)
        best = selection.chosen
    chosen = [found.proposals[k] for k in best.tolist()]
    if rules.living:
        is_part = parts_of_living(rgb, judged.boxes, chosen, found.shape)
        fit[best] -= LEARNED.threshold * is_part
    if rules.focus:
        areas = np.array([one.area for one in chosen], np.float64)
        fit[best] *= 1 - blur_shares(rim_sharpness(rgb, chosen, found.shape), areas)
    sure = best[fit[best] > LEARNED.threshold]
    selection = replace(selection, chosen=sure)
    objects = as_segments(rgb, found, selection, fit[sure])
    if rules.pieces:
        objects = left_to_right(unite_pieces(rgb, objects, judged.boxes))
    objects = cut_out_on_plain(rgb, objects)
    taken = [*sure.tolist(), *selection.parts_of(sure)]
    return replace(objects, doubtful=find_doubts(found, fit, taken, rgb.shape[:2]))


def _gap_penalties(
    rgb: NDArray[np.uint8],
    judged: JudgedCandidates,
    best: NDArray[np.intp],
    fit: Array,
) -> Array:
    """Return what chosen candidates of some fit lose as gaps between others, (n,).

    Edges bound a gap as they bound an object: there their agreement says nothing.
    """
    found = judged.found
    gap = continued_colours(rgb, [found.proposals[k] for k in best], found.shape)
    gap *= 1 - own_box(found.features[best])
    return np.asarray(gap * (LEARNED.gap_penalty + fit - judged.fit[best]))


def continued_colours(
    rgb: NDArray[np.uint8], chosen: Sequence[Proposal], shape: tuple[int, int]
) -> Array:
    """Return (n,) 0..1: how surely chosen candidates are gaps between others.

    The colours around a gap are seen through it. `shape` (h, w) is that of the grid.
    """
    if not chosen:
        return np.zeros(0)
    colours = colour_steps(rgb, shape)
    masks = [one.on(shape) for one in chosen]
    free = ~np.any(masks, axis=0)
    shares = []
    for one, mask in zip(chosen, masks, strict=True):
        reach = max(3, int(np.sqrt(one.area)))
        left, top, right, bottom = one.box
        ring = np.s_[
            max(0, top - reach) : bottom + reach, max(0, left - reach) : right + reach
        ]
        own, other = (
            np.bincount(part, minlength=COLOUR_STEPS)
            for part in (colours[mask], colours[ring][free[ring]])
        )
        around = LEARNED.rarer * other / max(other.sum(), 1)
        shares.append(np.minimum(own / own.sum(), around).sum())
    return np.asarray(np.interp(shares, LEARNED.explained, (0, 1)))


def own_box(features: Array) -> Array:
    """Return (n,) 0..1: how surely candidates have a box of a movable whole of their own.

    `features` (n, k) are as of FEATURES. No box is on a gap.
    """
    score = features[:, FEATURES.index("movable box")]
    return np.asarray(np.interp(score, LEARNED.own_box, (0, 1)))


def _scale_to(shape: tuple[int, int], rgb: NDArray[np.uint8]) -> tuple[float, float]:
    """Return the size of a grid `shape` (h, w), across and down, as parts of a photo's."""
    return shape[1] / rgb.shape[1], shape[0] / rgb.shape[0]


def with_agreement(fit: Array, edges: Array, features: Array) -> Array:
    """Return expected fits (n,) with a bonus for what edges select on an object.

    `edges` (n,) is the confidence of that selection, `features` (n, k) as of FEATURES.
    """
    foreground = features[:, FEATURES.index("foreground")]
    share = np.interp(foreground, LEARNED.foreground, (0, 1))
    share[fit < LEARNED.possible] = 0
    return np.asarray(fit + LEARNED.agreement * edges * share)


def find_doubts(
    found: Candidates,
    fit: Array,
    taken_places: Sequence[int],
    size: tuple[int, ...],
) -> list[Doubt]:
    """Return the best other candidates, mostly outside those that are taken.

    `size` is that of the photo (H, W).
    """
    scale = size[1] / found.shape[1], size[0] / found.shape[0]
    right = confidence(fit)
    taken = [found.proposals[k] for k in taken_places]
    doubtful: list[Doubt] = []
    for k in np.argsort(-fit, kind="stable").tolist():
        if right[k] < LEARNED.doubtful or len(doubtful) == LEARNED.doubts:
            break
        one = found.proposals[k]
        if any(
            overlap(one, other) > SHARED * min(one.area, other.area) for other in taken
        ):
            continue
        taken.append(one)
        doubtful += doubt_about(one, float(right[k]), scale)
    return doubtful


def as_segments(
    rgb: NDArray[np.uint8],
    found: Candidates,
    selection: Selection,
    fit: Array,
) -> Segments:
    """Return the chosen candidates as labels of the photo; `fit` is theirs.

    Each is cut out again in its box, as is each part of it; what is round stays so, and
    what is not found again stays as it is. Of two with a common pixel the better one
    gets it. Ids run left to right.
    """
    rising = np.argsort(fit, kind="stable")
    size = rgb.shape[0], rgb.shape[1]
    labels = np.zeros(size, np.uint16)
    for label, k in enumerate(selection.chosen[rising].tolist(), 1):
        for one in (k, *selection.parts.get(k, ())):
            labels[_cut_out_again(rgb, found, one)] = label
    for label in range(1, len(rising) + 1):
        own = labels == label
        left, top, width, height = cv2.boundingRect(own.view(np.uint8))
        box = np.s_[top : top + height, left : left + width]
        piece = cut_out(own[box], 0, 0, 1)
        if piece is not None:  # without what a later one cut off
            labels[box][own[box] & ~piece.on((height, width))] = 0
    return left_to_right(Segments(labels, confidence(fit[rising])))


def _cut_out_again(rgb: NDArray[np.uint8], found: Candidates, k: int) -> Mask:
    """Return the mask (H, W) of a candidate on the photo."""
    across, down = _scale_to(found.shape, rgb)
    corners = found.proposals[k].box / np.array([across, down, across, down])
    if k in found.corners:
        fit = box_overlap(corners[None], found.corners[k][None])[0, 0]
        # the first look into the box of the candidate is known
        corners = found.corners[k] if fit >= LEARNED.same_box else corners
    own = found.on_photo(k, (rgb.shape[0], rgb.shape[1]))
    return better_mask(own, mask_in_box(rgb, corners.tolist()).mask)


def better_mask(own: Mask, again: Mask) -> Mask:
    """Return what was cut out again, or else the mask before."""
    shared, union = np.count_nonzero(own & again), np.count_nonzero(own | again)
    is_other = shared < LEARNED.same * union
    loses_roundness = bool(round_radius(own)) and not round_radius(again)
    return own if is_other or loses_roundness else again


def round_radius(mask: Mask) -> float:
    """Return the radius (px) of a round mask (H, W), 0 of any other."""
    x, y, width, height = cv2.boundingRect(mask.view(np.uint8))
    if not width:
        return 0.0
    rows, columns = np.nonzero(mask[y : y + height, x : x + width])
    points = np.stack([columns + x, rows + y], axis=1).astype(np.float32)
    _, around = cv2.minEnclosingCircle(points)
    is_round = len(points) > LEARNED.round * np.pi * around**2
    return float(np.sqrt(len(points) / np.pi)) if is_round else 0.0


def left_to_right(objects: Segments) -> Segments:
    """Return the same with ids from left to right by centroid.

    Those without a pixel are left out.
    """
    labels = objects.labels
    rows, columns = np.nonzero(labels)
    present = labels[rows, columns]
    count = np.bincount(present, minlength=len(objects.confidence) + 1)
    x = np.bincount(present, columns, len(count)) / np.maximum(count, 1)
    order = 1 + np.argsort(x[1:], kind="stable")
    order = order[count[order] > 0]
    ids = np.zeros(len(count), np.uint16)
    ids[order] = np.arange(1, len(order) + 1)
    return replace(
        objects, labels=ids[labels], confidence=objects.confidence[order - 1]
    )
