"""Selection of the best set of candidates without overlap."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from physgen.perceive.segment.proposals import Proposal, overlap

SHARED = 0.12
"""Common share of the smaller of two candidates above which they exclude each other."""
AREA_POWER = 0.7
"""Exponent of the area in a candidate's gain, which balances wholes against parts."""

Flags = NDArray[np.bool_]
Values = NDArray[np.float64]


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
