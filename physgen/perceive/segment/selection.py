"""Selection of the best set of candidates without overlap, wholes before their parts."""

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
"""Exponent of the area in a candidate's gain, which balances wholes against parts."""

Flags = NDArray[np.bool_]
Values = NDArray[np.float64]


@dataclass(frozen=True)
class WholeConstants:
    """Constants of wholes, chosen on 200 photos that the judge learns from."""

    score: float = 0.5  # of a whole: a box from which candidates may be its parts
    match: float = 0.7
    """IoU of the box of a whole with that one, and share of a part that it covers."""
    within: float = 0.8  # share of a part's box in it
    own_box: float = 0.65
    """Of the whole's score: a part with a box that scores more is an object."""
    clear: float = 0.75
    """Fit, with its bonus, from which a part beside the largest one is an object."""
    worse: float = 0.1  # fit that the whole may lack beside the best part
    better: float = 0.05
    """IoU with the box by which a strap or a handle brings its whole nearer to it."""


WHOLE = WholeConstants()


@dataclass(frozen=True, eq=False)
class Selection:
    """Chosen candidates, and the parts of the wholes among them, by index."""

    chosen: NDArray[np.intp]
    parts: dict[int, list[int]] = field(default_factory=dict)

    def parts_of(self, wholes: NDArray[np.intp]) -> list[int]:
        """Return the parts of some wholes."""
        return [part for k in wholes.tolist() for part in self.parts.get(k, ())]


def unite_parts(
    candidates: Sequence[Proposal],
    chosen: NDArray[np.intp],
    fits: tuple[Values, Values],
    boxes: DetectedBoxes,
) -> Selection:
    """Return the selection with wholes in place of chosen candidates that are parts.

    The parts of a whole lie in one of the detector's `boxes` (on the grid of the
    candidates), of which a candidate shows the whole, and have no such box of their
    own. `fits` are those of all candidates, (n,) each, without and with the bonus of
    edges.
    """
    selection = Selection(chosen)
    rectangles = np.array([one.box for one in candidates], np.float64).reshape(-1, 4)
    is_clear = (boxes.movable >= WHOLE.score) & (boxes.movable > boxes.immovable)
    for k in np.flatnonzero(is_clear).tolist():
        parts = _weak_parts(rectangles[selection.chosen], boxes, k)
        if len(parts) > 1:
            matches = box_overlap(rectangles, boxes.corners[[k]])[:, 0] >= WHOLE.match
            wholes = np.flatnonzero(matches)
            selection = _unite(candidates, selection, parts, wholes, fits)
            parts = _weak_parts(rectangles[selection.chosen], boxes, k)
            places = parts[fits[1][selection.chosen[parts]] <= WHOLE.clear]
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
    the box with these `corners` fits the two better than the whole alone.
    """
    rectangles = np.array([candidates[k].box for k in selection.chosen], np.float64)
    fits = box_overlap(rectangles, corners[None])[:, 0]
    best = int(fits.argmax())
    whole = int(selection.chosen[best])
    if fits[best] < WHOLE.match:
        return selection
    own, reached = rectangles[best], fits[best]
    parts: list[int] = []
    for place in places.tolist():
        part = int(selection.chosen[place])
        both = np.concatenate(
            [
                np.minimum(own[:2], rectangles[place, :2]),
                np.maximum(own[2:], rectangles[place, 2:]),
            ]
        )
        fit = box_overlap(both[None], corners[None])[0, 0]
        is_near = _touch(candidates[whole], candidates[part])
        if place != best and is_near and fit >= reached + WHOLE.better:
            own, reached = both, fit
            parts.append(part)
    if not parts:
        return selection
    rest = selection.chosen[~np.isin(selection.chosen, parts)]
    known = selection.parts.get(whole, [])
    return Selection(rest, {**selection.parts, whole: [*known, *parts]})


def _touch(one: Proposal, other: Proposal) -> bool:
    """Return whether two candidates are at most SURROUNDINGS px apart."""
    reach = SURROUNDINGS
    kernel = np.ones((2 * reach + 1, 2 * reach + 1), np.uint8)
    mask = cv2.dilate(np.pad(one.mask, reach).astype(np.uint8), kernel) > 0
    area = int(np.count_nonzero(mask))
    wide = Proposal(one.x - reach, one.y - reach, mask, area)
    return overlap(wide, other) > 0


def _weak_parts(rectangles: Values, boxes: DetectedBoxes, k: int) -> NDArray[np.intp]:
    """Return which rectangles (n, 4) lie in box k and have no box like it of their own."""
    inside = box_shares(rectangles, boxes.corners[[k]])[:, 0] >= WHOLE.within
    scores = box_overlap(rectangles, boxes.corners) ** 2 * boxes.movable
    scores[:, k] = 0
    is_weak = scores.max(axis=1) <= WHOLE.own_box * boxes.movable[k]
    return np.flatnonzero(inside & is_weak)


def _unite(
    candidates: Sequence[Proposal],
    selection: Selection,
    places: NDArray[np.intp],
    wholes: NDArray[np.intp],
    fits: tuple[Values, Values],
) -> Selection:
    """Return the selection with the best whole that covers two or more parts.

    `places` of `selection.chosen` are those of the parts.
    """
    alone, fit = fits
    chosen = selection.chosen
    for whole in wholes[np.argsort(-alone[wholes], kind="stable")].tolist():
        one = candidates[whole]
        shares = np.array([overlap(one, candidates[k]) for k in chosen.tolist()])
        areas = np.array([candidates[k].area for k in chosen.tolist()])
        is_part = np.isin(np.arange(len(chosen)), places)
        is_part &= shares >= WHOLE.match * areas
        is_rival = shares > SHARED * np.minimum(areas, one.area)
        parts = chosen[is_part]
        if len(parts) < 2 or (is_rival & ~is_part).any():
            continue
        largest = parts[areas[is_part].argmax()]
        has_clear = fit[parts[parts != largest]].max() > WHOLE.clear
        if has_clear or alone[whole] < alone[parts].max() - WHOLE.worse:
            continue
        united = np.append(chosen[~is_part], whole)
        return Selection(united, {**selection.parts, whole: parts.tolist()})
    return selection


def choose_candidates(
    candidates: Sequence[Proposal], shape: tuple[int, int], fit: Values, least: float
) -> NDArray[np.intp]:
    """Return the set without overlap of the largest gain, of a fit (n,) above the least.

    `shape` (h, w) is that of the grid.
    """
    pool = np.flatnonzero(fit > least)
    if not len(pool):
        return pool
    some = [candidates[k] for k in pool.tolist()]
    area = np.array([one.area for one in some], np.float64) / (shape[0] * shape[1])
    gain = (fit[pool] - least) * area**AREA_POWER
    return pool[best_set(gain, exclusions(some))]


def exclusions(proposals: Sequence[Proposal]) -> Flags:
    """(n, n): which proposals share too much to be chosen together; false on the diagonal."""
    boxes = np.array([proposal.box for proposal in proposals], np.float64)
    area = np.array([proposal.area for proposal in proposals], np.float64)
    low, high = (
        np.maximum(boxes[:, None, :2], boxes[:, :2]),
        np.minimum(boxes[:, None, 2:], boxes[:, 2:]),
    )
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
    """(n,): the independent set of the largest gain, by local search.

    Proposals are taken by falling gain; then one is added or removed, the free place is refilled, and improvements
    are kept.
    """
    by_gain = np.argsort(-gain, kind="stable")
    by_gain = by_gain[gain[by_gain] > 0]
    chosen = _fill(np.zeros(len(gain), np.bool_), by_gain, excludes)
    for _ in range(12):
        before = float(gain[chosen].sum())
        for i in by_gain:
            trial, out = chosen.copy(), chosen & excludes[i]
            if chosen[i]:
                trial[i], out = False, np.arange(len(gain)) == i
            elif gain[out].sum() > 1.7 * gain[i]:
                continue
            else:
                trial[out], trial[i] = False, True
            room = excludes[out].any(0)
            trial = _fill(trial, by_gain[room[by_gain]], excludes)
            if gain[trial].sum() > gain[chosen].sum() + 1e-9:
                chosen = trial
        if gain[chosen].sum() <= before + 1e-9:
            break
    return chosen


def _fill(chosen: Flags, order: NDArray[np.intp], excludes: Flags) -> Flags:
    chosen = chosen.copy()
    blocked = excludes[chosen].any(0) | chosen
    for i in order:
        if not blocked[i]:
            chosen[i] = True
            blocked |= excludes[i]
    return chosen
