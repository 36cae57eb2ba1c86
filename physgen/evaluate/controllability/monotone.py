"""Sizes of pushes and of answers -> rank correlations, and steps that rise; by numpy alone."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import sqrt

import numpy as np
from numpy.typing import NDArray

from physgen.simulate.uncertainty_summary import ranks

Array = NDArray[np.float64]

EQUAL = 0.01
"""px up to which two answers are the same."""


@dataclass(frozen=True)
class Rise:
    """How one series follows another; None where one of the two never changes."""

    spearman: float | None
    kendall: float | None
    """tau-b, which makes up for ties."""
    steps: int
    rising: int
    """Steps, in the order of the pushes, by which the answer grows."""


def rise(sizes: Sequence[float], answers: Sequence[float]) -> Rise:
    """Of two numbers or more each, in any order.

    >>> rise([1, 2, 3], [10, 20, 15])
    Rise(spearman=0.5, kendall=0.3333333333333333, steps=2, rising=1)
    """
    pushes = np.asarray(sizes, np.float64)
    # what differs by rounding is the same
    found = np.round(np.asarray(answers, np.float64) / EQUAL) * EQUAL
    order = np.argsort(pushes, kind="stable")
    grown = np.diff(pushes[order]) > 0
    steps = np.diff(found[order])[grown]
    return Rise(spearman(pushes, found), kendall(pushes, found), len(steps), int((steps > EQUAL / 2).sum()))


def spearman(one: Array, other: Array) -> float | None:
    """Pearson's correlation of the ranks."""
    a, b = (rank - rank.mean() for rank in map(ranks, (one, other)))
    size = float(np.sqrt((a * a).sum() * (b * b).sum()))
    return float((a * b).sum()) / size if size > 0 else None


def kendall(one: Array, other: Array) -> float | None:
    """tau-b: pairs in the same order less those in the other, over the root of those tied in neither."""
    k, m = np.triu_indices(len(one), 1)
    a, b = np.sign(one[k] - one[m]), np.sign(other[k] - other[m])
    size = sqrt(float((a != 0).sum()) * float((b != 0).sum()))
    return float((a * b).sum()) / size if size > 0 else None
