"""Selection of the best candidates without overlap, wholes before their parts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.perceive.segment.detector import DetectedBoxes, box_overlap, box_shares
from physgen.perceive.segment.evidence import SURROUNDINGS
from physgen.perceive.segment.proposals import Proposal, overlap

SHARED = 0.12
"""Common share of the smaller of two candidates above which they exclude each other."""
AREA_POWER = 0.7
"""Exponent of the area in a candidate's gain; it balances wholes against parts."""

Flags = NDArray[np.bool_]
Values = NDArray[np.float64]


@dataclass(frozen=True)
class WholeConstants:
    """Constants of wholes, chosen on 200 photos of the judge's training set."""

    # Least score of a box as a whole whose parts may be candidates.
    score: float = 0.5
    match: float = 0.7
    """Least IoU of the whole's box with that box, and least share of a part inside the
    whole.
    """
    # Least share of a part's box inside that box.
    inner_share: float = 0.8
    own_box: float = 0.65
    """Score of a part's own box over the whole's, above which the part is an object."""
    clear_fit: float = 0.75
    """Fit, with its bonus, above which a part beside the largest one is an object."""
    # Largest deficit of the whole's fit to that of the best part.
    worse: float = 0.1
    better: float = 0.05
    """Least gain of IoU with the box by a strap or a handle."""


WHOLE = WholeConstants()


@dataclass(frozen=True, eq=False)
class Selection:
    """Chosen candidates, and the parts of the wholes among them, by index."""

    indices: NDArray[np.intp]
    parts: dict[int, list[int]] = field(default_factory=dict)

    def parts_of(self, wholes: NDArray[np.intp]) -> list[int]:
        """Return the parts of some wholes."""
        result: list[int] = []
        for k in wholes.tolist():
            for part in self.parts.get(k, ()):
                result.append(part)
        return result


def unite_parts(
    candidates: Sequence[Proposal],
    indices: NDArray[np.intp],
    fits: tuple[Values, Values],
    boxes: DetectedBoxes,
) -> Selection:
    """Return the selection with wholes in place of chosen candidates that are parts.

    The parts of a whole lie in one of the detector's `boxes` (on the grid of the
    candidates), a candidate matches that box, and the parts have no such box of their
    own. `fits` belong to all candidates, (n,) each, without and with the bonus of
    edges.
    """
    selection = Selection(indices)
    rectangles = np.array(
        [candidate.box for candidate in candidates], np.float64
    ).reshape(-1, 4)
    is_whole_box = (boxes.movable >= WHOLE.score) & (boxes.movable > boxes.immovable)
    for k in np.flatnonzero(is_whole_box).tolist():
        parts = _weak_parts(rectangles[selection.indices], boxes, k)
        if len(parts) > 1:
            matches = box_overlap(rectangles, boxes.corners[[k]])[:, 0] >= WHOLE.match
            wholes = np.flatnonzero(matches)
            selection = _unite(candidates, selection, parts, wholes, fits)
            parts = _weak_parts(rectangles[selection.indices], boxes, k)
            places = parts[fits[1][selection.indices[parts]] <= WHOLE.clear_fit]
            selection = _append(candidates, selection, places, boxes.corners[k])
    return selection


def _append(
    candidates: Sequence[Proposal],
    selection: Selection,
    places: NDArray[np.intp],
    corners: Values,
) -> Selection:
    """Return the selection with appendages as parts of the whole in a box.

    An appendage, at one of the `places` of `selection.chosen`, touches the whole, and
    both together fit the box with these `corners` better than the whole alone.
    """
    rectangles = np.array([candidates[k].box for k in selection.indices], np.float64)
    fits = box_overlap(rectangles, corners[None])[:, 0]
    best = int(fits.argmax())
    whole_index = int(selection.indices[best])
    if fits[best] < WHOLE.match:
        return selection
    current_box = rectangles[best]
    current_fit = fits[best]
    parts: list[int] = []
    for place in places.tolist():
        part = int(selection.indices[place])
        joint_box = np.concatenate(
            [
                np.minimum(current_box[:2], rectangles[place, :2]),
                np.maximum(current_box[2:], rectangles[place, 2:]),
            ]
        )
        fit = box_overlap(joint_box[None], corners[None])[0, 0]
        touches = _touch(candidates[whole_index], candidates[part])
        if place != best and touches and fit >= current_fit + WHOLE.better:
            current_box = joint_box
            current_fit = fit
            parts.append(part)
    if not parts:
        return selection
    rest = selection.indices[~np.isin(selection.indices, parts)]
    known_parts = selection.parts.get(whole_index, [])
    return Selection(rest, {**selection.parts, whole_index: [*known_parts, *parts]})


def _touch(first: Proposal, other: Proposal) -> bool:
    """Return whether two candidates are at most SURROUNDINGS px apart."""
    reach = SURROUNDINGS
    kernel = np.ones((2 * reach + 1, 2 * reach + 1), np.uint8)
    mask = cv2.dilate(np.pad(first.mask, reach).astype(np.uint8), kernel) > 0
    area = int(np.count_nonzero(mask))
    dilated_proposal = Proposal(first.x - reach, first.y - reach, mask, area)
    return overlap(dilated_proposal, other) > 0


def _weak_parts(rectangles: Values, boxes: DetectedBoxes, k: int) -> NDArray[np.intp]:
    """Return the rectangles (n, 4) in box k without a similar box of their own."""
    inside = box_shares(rectangles, boxes.corners[[k]])[:, 0] >= WHOLE.inner_share
    scores = box_overlap(rectangles, boxes.corners) ** 2 * boxes.movable
    scores[:, k] = 0
    lacks_box = scores.max(axis=1) <= WHOLE.own_box * boxes.movable[k]
    return np.flatnonzero(inside & lacks_box)


def _unite(
    candidates: Sequence[Proposal],
    selection: Selection,
    places: NDArray[np.intp],
    wholes: NDArray[np.intp],
    fits: tuple[Values, Values],
) -> Selection:
    """Return the selection with the best whole that covers two or more parts.

    `places` of `selection.chosen` are the parts.
    """
    plain_fits, fit = fits
    chosen = selection.indices
    for whole in wholes[np.argsort(-plain_fits[wholes], kind="stable")].tolist():
        whole_candidate = candidates[whole]
        shares = np.array(
            [overlap(whole_candidate, candidates[k]) for k in chosen.tolist()]
        )
        areas = np.array([candidates[k].area for k in chosen.tolist()])
        is_part = np.isin(np.arange(len(chosen)), places)
        is_part &= shares >= WHOLE.match * areas
        is_rival = shares > SHARED * np.minimum(areas, whole_candidate.area)
        parts = chosen[is_part]
        # A whole must cover at least two parts and must not collide with other objects.
        if len(parts) < 2 or (is_rival & ~is_part).any():
            continue
        largest = parts[areas[is_part].argmax()]
        # Several well fitting parts are a pile of objects rather than one whole.
        has_good_part = fit[parts[parts != largest]].max() > WHOLE.clear_fit
        if has_good_part or plain_fits[whole] < plain_fits[parts].max() - WHOLE.worse:
            continue
        new_choice = np.append(chosen[~is_part], whole)
        return Selection(new_choice, {**selection.parts, whole: parts.tolist()})
    return selection


def choose_candidates(
    candidates: Sequence[Proposal],
    shape: tuple[int, int],
    fit: Values,
    least_fit: float,
) -> NDArray[np.intp]:
    """Return the set with the largest gain without overlap, above the least fit.

    `fit` is (n,); `shape` (h, w) is the size of the grid.
    """
    pool = np.flatnonzero(fit > least_fit)
    if not len(pool):
        return pool
    pool_candidates = [candidates[k] for k in pool.tolist()]
    area = np.array([candidate.area for candidate in pool_candidates], np.float64) / (
        shape[0] * shape[1]
    )
    gain = (fit[pool] - least_fit) * area**AREA_POWER
    return pool[best_set(gain, exclusions(pool_candidates))]


def exclusions(proposals: Sequence[Proposal]) -> Flags:
    """Return (n, n) whether two proposals overlap too much to be chosen together.

    The diagonal is False.
    """
    boxes = np.array([proposal.box for proposal in proposals], np.float64)
    area = np.array([proposal.area for proposal in proposals], np.float64)
    low = np.maximum(boxes[:, None, :2], boxes[:, :2])
    high = np.minimum(boxes[:, None, 2:], boxes[:, 2:])
    meeting = np.clip(high - low, 0, None).prod(-1) > SHARED * np.minimum(
        area[:, None], area
    )
    excludes = np.zeros(meeting.shape, np.bool_)
    for i, j in np.argwhere(np.triu(meeting, 1)).tolist():
        excludes[i, j] = excludes[j, i] = overlap(
            proposals[i], proposals[j]
        ) > SHARED * min(area[i], area[j])
    return excludes


def best_set(gain: Values, excludes: Flags) -> Flags:
    """Return the independent set (n,) with the largest gain, by local search.

    Proposals are added by decreasing gain; then one is added or removed, the free space
    is refilled, and improvements are kept.
    """
    by_gain = np.argsort(-gain, kind="stable")
    by_gain = by_gain[gain[by_gain] > 0]
    best = _fill(np.zeros(len(gain), np.bool_), by_gain, excludes)
    for _ in range(12):
        before = float(gain[best].sum())
        # Move: add or remove one proposal and refill the freed space.
        for i in by_gain:
            trial = best.copy()
            out = best & excludes[i]
            if best[i]:
                trial[i], out = False, np.arange(len(gain)) == i
            # Replacing much more gain than the candidate's rarely pays after the
            # refill.
            elif gain[out].sum() > 1.7 * gain[i]:
                continue
            else:
                trial[out], trial[i] = False, True
            room = excludes[out].any(0)
            trial = _fill(trial, by_gain[room[by_gain]], excludes)
            if gain[trial].sum() > gain[best].sum() + 1e-9:
                best = trial
        if gain[best].sum() <= before + 1e-9:
            break
    return best


def _fill(selection: Flags, order: NDArray[np.intp], excludes: Flags) -> Flags:
    """Return the set with all compatible proposals added in the given order."""
    selection = selection.copy()
    exclusion_mask = excludes[selection].any(0) | selection
    for i in order:
        if not exclusion_mask[i]:
            selection[i] = True
            exclusion_mask |= excludes[i]
    return selection
