"""Scores of several raters -> Krippendorff's alpha for ordinal data, with an interval.

K. Krippendorff, Computing Krippendorff's Alpha-Reliability (2011), section E: any number of raters, answers may be
missing. 1 is perfect agreement, 0 is what chance would give, below 0 is disagreement beyond chance.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

F64 = NDArray[np.float64]
Scores = NDArray[np.int64]

POINTS = 5
DRAWS = 2000
LEAST = 2
"""Clips with two answers below which nothing is drawn."""


@dataclass(frozen=True)
class Agreement:
    """Between raters."""

    alpha: float | None
    """None where it has no meaning: one rater, or the same score everywhere."""
    low: float | None = None
    high: float | None = None
    """Of the 95 % interval: clips drawn again."""


def agreement(scores: Scores, seed: int = 0) -> Agreement:
    """Of (R, U) scores 1 to 5 that R raters gave U clips, 0 where a rater gave none.

    The interval draws clips, not raters: a rater who is drawn twice would agree with himself.
    """
    units = _units(scores)
    alpha = float(_alphas(units.sum(axis=0, keepdims=True))[0])
    if not np.isfinite(alpha):
        return Agreement(None)
    if len(units) < LEAST:
        return Agreement(alpha)
    drawn = np.random.default_rng(seed).multinomial(len(units), np.full(len(units), 1 / len(units)), DRAWS)
    found = _alphas(np.tensordot(drawn.astype(np.float64), units, axes=1))
    found = found[np.isfinite(found)]
    low, high = np.quantile(found, (0.025, 0.975)).tolist() if len(found) else (None, None)
    return Agreement(alpha, low, high)


def _units(scores: Scores) -> F64:
    """(U, 5, 5): how often score c meets score k in a clip, a pair of raters weighing 1 / (answers - 1)."""
    counts = np.stack([(scores == point).sum(axis=0) for point in range(1, POINTS + 1)], axis=1).astype(
        np.float64
    )
    answers = counts.sum(axis=1)
    counts, answers = counts[answers > 1], answers[answers > 1]
    pairs = counts[:, :, None] * counts[:, None, :] - counts[:, :, None] * np.eye(POINTS)
    return np.asarray(pairs / (answers - 1)[:, None, None], np.float64)


def _alphas(met: F64) -> F64:
    """Of (B, 5, 5) coincidences; NaN where scores do not differ at all."""
    n_c = met.sum(axis=2)
    n = n_c.sum(axis=1)
    up_to = np.cumsum(n_c, axis=1)
    # the ordinal distance of c and k: all answers between them, half of their own
    middle = up_to - n_c / 2
    far = (middle[:, :, None] - middle[:, None, :]) ** 2
    seen = (met * far).sum(axis=(1, 2))
    by_chance = (n_c[:, :, None] * n_c[:, None, :] * far).sum(axis=(1, 2))
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.asarray(1 - (n - 1) * seen / by_chance, np.float64)
