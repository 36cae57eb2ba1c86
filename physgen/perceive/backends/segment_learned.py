"""Backend segment=learned: boxes, groups and edges propose, a head draws, a judge
chooses.
"""

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
    """Constants of the choice, tuned on the judge's training photos."""

    # Least expected fit of an object.
    threshold: float = 0.55
    # Bonus for a candidate that the photo's edges select, too.
    agreement: float = 0.5
    # Least expected fit for that bonus, since edges also bound gaps.
    possible: float = 0.35
    foreground: tuple[float, float] = (0.3, 0.6)
    """Mean foreground probabilities for no bonus and for the full bonus."""
    # Penalty for a candidate with continued colours around it.
    gap_penalty: float = 0.35
    rarer: float = 3.0
    """Largest ratio of the frequencies of a colour inside and around for a continued
    colour.
    """
    colour_shares: tuple[float, float] = (0.5, 0.8)
    """Shares of continued colours for no penalty and for the full penalty."""
    own_box: tuple[float, float] = (0.55, 0.7)
    """Scores of a candidate's own box for the full penalty and for none."""
    # Least confidence of a doubtful object.
    doubtful: float = 0.1
    # Largest number of doubtful objects.
    doubts: int = 8
    same_box: float = 0.7
    """Least IoU of a candidate's box and its first box for a repeated cut-out in the
    first box.

    On 200 objects the masks are as good and take less time.
    """
    # Least IoU of a candidate and its repeated cut-out; below it the new mask is
    # another object.
    least_iou: float = 0.5
    roundness: float = 0.9
    """Least share of its smallest enclosing circle that a round object covers."""


LEARNED = LearnedConstants()


def learned() -> Segment:
    """Return the segmenter; it is deterministic and keeps no state."""
    return segment


@dataclass(frozen=True)
class Rules:
    """Rules that choose among candidates; measurements switch them off one by one."""

    # Drop gaps between other objects.
    gaps: bool = True
    # Replace parts by wholes.
    wholes: bool = True
    # Drop parts of people and animals.
    living: bool = True
    # Drop the blurred background.
    focus: bool = True
    # Replace loose pieces by one object.
    pieces: bool = True


ALL_RULES = Rules()


def segment(rgb: NDArray[np.uint8]) -> Segments:
    """Return the movable and the doubtful objects of a photo (H, W, 3) uint8 sRGB."""
    candidates = judge_photo(rgb)
    objects = choose_objects(rgb, candidates)
    toys = find_likely_toys(rgb, candidates.boxes, objects.labels)
    return replace(objects, doubtful=[*toys, *objects.doubtful])


def choose_objects(
    rgb: NDArray[np.uint8], judgement: JudgedCandidates, rules: Rules = ALL_RULES
) -> Segments:
    """Return the objects and the doubtful objects among the candidates of a photo."""
    candidates = judgement.candidates
    fit = with_agreement(judgement.fit, candidates.edges, candidates.features)
    best = choose_candidates(
        candidates.proposals, candidates.shape, fit, LEARNED.threshold
    )
    # A gap between objects has the colours of the background, but edges like an object.
    if rules.gaps:
        fit[best] -= _gap_penalties(rgb, judgement, best, fit[best])
        best = best[fit[best] > LEARNED.threshold]
    selection = Selection(best)
    if rules.wholes:
        boxes = judgement.boxes.scale_to(*_scale_to(candidates.shape, rgb))
        selection = unite_parts(candidates.proposals, best, (judgement.fit, fit), boxes)
        best = selection.indices
    proposals = [candidates.proposals[k] for k in best.tolist()]
    # A part of a person or animal is not movable by itself: its fit falls below the
    # threshold.
    if rules.living:
        is_part = parts_of_living(rgb, judgement.boxes, proposals, candidates.shape)
        fit[best] -= LEARNED.threshold * is_part
    # Blurred regions lie behind the subject of the photo.
    if rules.focus:
        areas = np.array([proposal.area for proposal in proposals], np.float64)
        fit[best] *= 1 - blur_shares(
            rim_sharpness(rgb, proposals, candidates.shape), areas
        )
    object_ids = best[fit[best] > LEARNED.threshold]
    selection = replace(selection, indices=object_ids)
    objects = as_segments(rgb, candidates, selection, fit[object_ids])
    if rules.pieces:
        objects = left_to_right(unite_pieces(rgb, objects, judgement.boxes))
    objects = cut_out_on_plain(rgb, objects)
    used_ids = [*object_ids.tolist(), *selection.parts_of(object_ids)]
    return replace(
        objects, doubtful=find_doubts(candidates, fit, used_ids, rgb.shape[:2])
    )


def _gap_penalties(
    rgb: NDArray[np.uint8],
    judgement: JudgedCandidates,
    best: NDArray[np.intp],
    fit: Array,
) -> Array:
    """Return the penalties (n,) of chosen candidates that may be gaps between objects.

    Edges bound a gap as they bound an object, so the bonus for edges is also removed.
    """
    candidates = judgement.candidates
    gap = continued_colours(
        rgb, [candidates.proposals[k] for k in best], candidates.shape
    )
    gap *= 1 - own_box(candidates.features[best])
    return np.asarray(gap * (LEARNED.gap_penalty + fit - judgement.fit[best]))


def continued_colours(
    rgb: NDArray[np.uint8], candidates: Sequence[Proposal], shape: tuple[int, int]
) -> Array:
    """Return the probability (n,) that chosen candidates are gaps between others.

    The colours around a gap are visible through it. `shape` (h, w) is the size of the
    grid.
    """
    if not candidates:
        return np.zeros(0)
    colours = colour_steps(rgb, shape)
    masks = [candidate.on(shape) for candidate in candidates]
    free = ~np.any(masks, axis=0)
    shares = []
    for candidate, mask in zip(candidates, masks, strict=True):
        ring = _box_around(candidate)
        inner_counts = np.bincount(colours[mask], minlength=COLOUR_STEPS)
        ring_colours = colours[ring][free[ring]]
        ring_counts = np.bincount(ring_colours, minlength=COLOUR_STEPS)
        ring_shares = LEARNED.rarer * ring_counts / max(ring_counts.sum(), 1)
        shares.append(np.minimum(inner_counts / inner_counts.sum(), ring_shares).sum())
    return np.asarray(np.interp(shares, LEARNED.colour_shares, (0, 1)))


def _box_around(candidate: Proposal) -> tuple[slice, slice]:
    """Return the rows and columns of a candidate and its surroundings."""
    reach = max(3, int(np.sqrt(candidate.area)))
    left, top, right, bottom = candidate.box
    rows = slice(max(0, top - reach), bottom + reach)
    return rows, slice(max(0, left - reach), right + reach)


def own_box(features: Array) -> Array:
    """Return the probability (n,) that a box of a movable object fits each candidate.

    The columns of `features` (n, k) are FEATURES. No box fits a gap.
    """
    score = features[:, FEATURES.index("movable box")]
    return np.asarray(np.interp(score, LEARNED.own_box, (0, 1)))


def _scale_to(shape: tuple[int, int], rgb: NDArray[np.uint8]) -> tuple[float, float]:
    """Return the width and height of a grid `shape` (h, w) as shares of the photo's."""
    return shape[1] / rgb.shape[1], shape[0] / rgb.shape[0]


def with_agreement(fit: Array, edges: Array, features: Array) -> Array:
    """Return expected fits (n,) with a bonus for objects that edges select, too.

    `edges` (n,) is the confidence of that selection, and `features` (n, k) has the
    columns FEATURES.
    """
    foreground = features[:, FEATURES.index("foreground")]
    share = np.interp(foreground, LEARNED.foreground, (0, 1))
    share[fit < LEARNED.possible] = 0
    return np.asarray(fit + LEARNED.agreement * edges * share)


def find_doubts(
    candidates: Candidates,
    fit: Array,
    taken_places: Sequence[int],
    size: tuple[int, ...],
) -> list[Doubt]:
    """Return the best remaining candidates that barely overlap the chosen ones.

    `size` is the photo's (H, W).
    """
    scale = size[1] / candidates.shape[1], size[0] / candidates.shape[0]
    right = confidence(fit)
    used_proposals = [candidates.proposals[k] for k in taken_places]
    doubtful: list[Doubt] = []
    for k in np.argsort(-fit, kind="stable").tolist():
        if right[k] < LEARNED.doubtful or len(doubtful) == LEARNED.doubts:
            break
        proposal = candidates.proposals[k]
        if any(
            overlap(proposal, other) > SHARED * min(proposal.area, other.area)
            for other in used_proposals
        ):
            continue
        used_proposals.append(proposal)
        doubtful += doubt_about(proposal, float(right[k]), scale)
    return doubtful


def as_segments(
    rgb: NDArray[np.uint8],
    candidates: Candidates,
    selection: Selection,
    fit: Array,
) -> Segments:
    """Return the chosen candidates as a label map of the photo; `fit` belongs to them.

    Each candidate and each of its parts is cut out again in its box, except if
    roundness or the object would be lost. Of two overlapping objects the one with the
    better fit keeps the common pixels. Ids increase from left to right.
    """
    rising = np.argsort(fit, kind="stable")
    size = rgb.shape[0], rgb.shape[1]
    labels = np.zeros(size, np.uint16)
    for label, k in enumerate(selection.indices[rising].tolist(), 1):
        for index in (k, *selection.parts.get(k, ())):
            labels[_cut_out_again(rgb, candidates, index)] = label
    for label in range(1, len(rising) + 1):
        mask = labels == label
        left, top, width, height = cv2.boundingRect(mask.view(np.uint8))
        box = np.s_[top : top + height, left : left + width]
        piece = cut_out(mask[box], 0, 0, 1)
        # Remove pieces that a later object has cut off.
        if piece is not None:
            labels[box][mask[box] & ~piece.on((height, width))] = 0
    return left_to_right(Segments(labels, confidence(fit[rising])))


def _cut_out_again(rgb: NDArray[np.uint8], candidates: Candidates, k: int) -> Mask:
    """Return the mask (H, W) of a candidate on the photo."""
    x_scale, y_scale = _scale_to(candidates.shape, rgb)
    corners = candidates.proposals[k].box / np.array(
        [x_scale, y_scale, x_scale, y_scale]
    )
    if k in candidates.corners:
        fit = box_overlap(corners[None], candidates.corners[k][None])[0, 0]
        # The cut-out in the first box is cached.
        if fit >= LEARNED.same_box:
            corners = candidates.corners[k]
    mask = candidates.on_photo(k, (rgb.shape[0], rgb.shape[1]))
    return better_mask(mask, mask_in_box(rgb, corners.tolist()).mask)


def better_mask(mask: Mask, second_mask: Mask) -> Mask:
    """Return the repeated mask, or the first mask if the repeated one is worse."""
    common = np.count_nonzero(mask & second_mask)
    union = np.count_nonzero(mask | second_mask)
    is_other = common < LEARNED.least_iou * union
    loses_roundness = bool(round_radius(mask)) and not round_radius(second_mask)
    if is_other or loses_roundness:
        return mask
    return second_mask


def round_radius(mask: Mask) -> float:
    """Return the radius of a round mask (H, W) in px, and 0 for other masks."""
    x, y, width, height = cv2.boundingRect(mask.view(np.uint8))
    if not width:
        return 0.0
    rows, columns = np.nonzero(mask[y : y + height, x : x + width])
    points = np.stack([columns + x, rows + y], axis=1).astype(np.float32)
    _, enclosing_radius = cv2.minEnclosingCircle(points)
    is_disc = len(points) > LEARNED.roundness * np.pi * enclosing_radius**2
    if is_disc:
        return float(np.sqrt(len(points) / np.pi))
    return 0.0


def left_to_right(objects: Segments) -> Segments:
    """Return the objects with ids ordered from left to right by centroid.

    Objects without pixels are removed.
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
