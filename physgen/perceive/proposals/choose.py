"""Scored proposals -> the best set of them without overlap, and what each is worth beside the others."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.perceive.proposals.proposal import Proposal, outline, overlap
from physgen.perceive.proposals.score import Looks

# Chosen on photos.
THRESHOLD = 0.58
"""The score below which a proposal is better left out."""
AREA_POWER = 0.7
"""The gain of a proposal grows with area to this power: wholes against their parts."""
SHARED = 0.12
"""Proposals that share more than this part of the smaller one exclude each other."""
SET_BONUS = 0.1
"""What a proposal gains when three chosen ones have its size and compactness: things come in sets."""
GAP_PENALTY = 0.4
"""What a small proposal loses when chosen larger ones surround it: a gap between them, or a face of one."""
BACKGROUND_PENALTY = 0.4
"""What a proposal loses whose colours all go on around it: it is background seen between objects."""
REACH = 1.0
"""How far around a proposal its background is looked for, in square roots of its area."""
RARER = 3.0
"""A colour of a proposal may be this much rarer around it and still count as going on there."""
BANDWIDTH = np.array([8, 5, 5], np.float32)
"""CIELAB units within which colours count as the same; lightness varies more, by shading and shadow."""
OUTLIER = 0.7
"""Chosen ones score at least this much of the upper quartile of all chosen."""

Flags = NDArray[np.bool_]
Values = NDArray[np.float64]


def choose(
    proposals: Sequence[Proposal], looks: Looks, colour: NDArray[np.float32]
) -> tuple[list[Proposal], NDArray[np.float64]]:
    """The set without overlap that gains the most, with final scores; in two rounds, as what is chosen
    changes the scores. `colour` is the photo (H, W, 3) in CIELAB."""
    worth = np.flatnonzero(looks.score > THRESHOLD - SET_BONUS)
    pool = [proposals[i] for i in worth.tolist()]
    if not pool:
        return [], np.zeros(0)
    score, compactness = looks.score[worth], looks.compactness[worth]
    area = np.array([proposal.area for proposal in pool], np.float64)
    shape = colour.shape[0], colour.shape[1]
    weight = (area / (shape[0] * shape[1])) ** AREA_POWER
    excludes = exclusions(pool)
    final, gap = score, np.zeros(len(pool))
    chosen = best_set((final - THRESHOLD) * weight, final, excludes)
    for _ in range(2):
        gap = np.maximum(gap, _gaps(pool, area, chosen, shape))
        final = score + _sets(score, area, compactness, chosen, excludes) - gap
        final -= BACKGROUND_PENALTY * background(pool, chosen, final > THRESHOLD, colour)
        chosen = best_set((final - THRESHOLD) * weight, final, excludes)
    if chosen.any():
        chosen &= final > max(THRESHOLD, OUTLIER * float(np.quantile(final[chosen], 0.75)))
    return [pool[i] for i in np.flatnonzero(chosen).tolist()], final[chosen]


def exclusions(proposals: Sequence[Proposal]) -> Flags:
    """(n, n): which proposals share too much to be chosen together; false on the diagonal."""
    boxes = np.array([proposal.box for proposal in proposals], np.float64)
    area = np.array([proposal.area for proposal in proposals], np.float64)
    low, high = np.maximum(boxes[:, None, :2], boxes[:, :2]), np.minimum(boxes[:, None, 2:], boxes[:, 2:])
    meeting = np.clip(high - low, 0, None).prod(-1) > SHARED * np.minimum(area[:, None], area)
    excludes = np.zeros(meeting.shape, np.bool_)
    for i, j in np.argwhere(np.triu(meeting, 1)).tolist():
        excludes[i, j] = excludes[j, i] = overlap(proposals[i], proposals[j]) > SHARED * min(area[i], area[j])
    return excludes


def best_set(gain: Values, score: Values, excludes: Flags) -> Flags:
    """(n,): the independent set of the largest total gain, by local search from three starts: gainful first,
    good first, and between. Whether a group or its members is the hard part; no single start settles it."""
    starts = (gain, score, gain * np.maximum(score, 1e-6) ** 4)
    ends = [_climb(gain, excludes, np.argsort(-start, kind="stable")) for start in starts]
    return max(ends, key=lambda chosen: float(gain[chosen].sum()))


def _climb(gain: Values, excludes: Flags, order: NDArray[np.intp]) -> Flags:
    """Take what fits in the given order; then put one in or out, refill the room, and keep what is better."""
    by_gain = np.argsort(-gain, kind="stable")
    by_gain = by_gain[gain[by_gain] > 0]
    chosen = _fill(np.zeros(len(gain), np.bool_), order[gain[order] > 0], excludes)
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


def _sets(score: Values, area: Values, compactness: Values, chosen: Flags, excludes: Flags) -> Values:
    """(n,): the bonus of proposals that have the size and compactness of several chosen ones."""
    size = np.log(area[:, None] / area[chosen]) / 0.12
    round_ = np.log(compactness[:, None] / compactness[chosen]) / 0.15
    alike = np.exp(-(size**2) - round_**2) * np.clip((score[chosen] - THRESHOLD) / 0.2, 0, 1)
    alike[(excludes | np.eye(len(area), dtype=np.bool_))[:, chosen]] = 0
    bonus: Values = SET_BONUS * np.minimum(alike.sum(1), 3) / 3
    return bonus


def _gaps(proposals: Sequence[Proposal], area: Values, chosen: Flags, shape: tuple[int, int]) -> Values:
    """(n,): the penalty of chosen proposals that lie against larger chosen ones along much of the outline."""
    reach = 3
    labels = np.zeros((shape[0] + 2 * reach, shape[1] + 2 * reach), np.int32)
    members = np.flatnonzero(chosen).tolist()
    for i in members:
        left, top, right, bottom = (edge + reach for edge in proposals[i].box)
        labels[top:bottom, left:right][proposals[i].mask] = i + 1
    penalty = np.zeros(len(proposals))
    for i in members:
        left, top, right, bottom = proposals[i].box
        around = labels[top : bottom + 2 * reach, left : right + 2 * reach]
        others = (around > 0) & (around != i + 1)
        if not others.any():
            continue
        near = cv2.dilate(others.astype(np.uint8), np.ones((2 * reach + 1, 2 * reach + 1), np.uint8))
        x, y = (outline(proposals[i].mask) + reach).T
        enclosed = max(0.0, float(near[y, x].mean()) - 0.3) / 0.7
        beside = float(np.median(area[np.unique(around[others]) - 1]))
        penalty[i] = GAP_PENALTY * enclosed * np.clip(1 - area[i] / (0.6 * beside), 0, 1)
    return penalty


def background(
    proposals: Sequence[Proposal], chosen: Flags, which: Flags, colour: NDArray[np.float32]
) -> Values:
    """(n,) 0..1: how well the colours around a proposal, where nothing is chosen, explain the colours in it;
    0 where not asked for. Compares densities of colour, smoothed by a Gaussian."""
    free = np.ones(colour.shape[:2], np.bool_)
    for i in np.flatnonzero(chosen).tolist():
        left, top, right, bottom = proposals[i].box
        free[top:bottom, left:right] &= ~proposals[i].mask
    explained = np.zeros(len(proposals))
    for i in np.flatnonzero(which).tolist():
        one = proposals[i]
        reach = max(3, int(REACH * np.sqrt(one.area)))
        left, top = max(0, one.x - reach), max(0, one.y - reach)
        around = np.s_[top : one.box[3] + reach, left : one.box[2] + reach]
        ring = free[around].copy()
        ring[one.y - top : one.box[3] - top, one.x - left : one.box[2] - left] &= ~one.mask
        inside = _some(colour[one.y : one.box[3], one.x : one.box[2]], one.mask, 100)
        outside = _some(colour[around], ring, 300)
        if len(outside) < 20:
            continue
        own, other = (_density(inside, colours) for colours in (inside, outside))
        explained[i] = np.minimum(1, RARER * other / own).mean()
    return np.clip((explained - 0.5) / 0.3, 0, 1)


def _some(colour: NDArray[np.float32], mask: Flags, most: int) -> NDArray[np.float32]:
    """About `most` of the colours (h, w, 3) under a mask (h, w), evenly spread."""
    at = np.flatnonzero(mask)
    return colour[np.unravel_index(at[:: max(1, len(at) // most)], mask.shape)]


def _density(at: NDArray[np.float32], colours: NDArray[np.float32]) -> Values:
    """(n,): how dense the `colours` (m, 3) are at the colours `at` (n, 3), CIELAB: Gaussian kernel density."""
    off = (at[:, None] - colours) / BANDWIDTH
    density: Values = np.exp(-(off * off).sum(2) / 2).mean(1).astype(np.float64)
    return density + 1e-6
