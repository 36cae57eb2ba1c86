"""Features of two sets of clips -> KID, the squared distance of their means under a cubic kernel; it has no bias.

Binkowski et al., Demystifying MMD GANs, ICLR 2018: k(x, y) = (x·y / D + 1)³. Frames of one clip are alike, so within a
set only pairs of frames of different clips count: clips, not frames, are drawn independently, and only so is the mean
over draws the distance of the two distributions, however few clips there are.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

F64 = NDArray[np.float64]


@dataclass(frozen=True)
class Blocks:
    """Sums of a kernel over the pairs of frames of every pair of clips."""

    sums: F64
    """(A, B)."""
    pairs: F64
    """(A, B): how many pairs of frames."""


def blocks(one: F64, first: NDArray[np.intp], other: F64, second: NDArray[np.intp]) -> Blocks:
    """Of features (N, D) and (M, D), whose clips `first` (N,) and `second` (M,) count from 0."""
    kernel = (one @ other.T / one.shape[1] + 1) ** 3
    sums = np.zeros((first.max() + 1, len(other)))
    np.add.at(sums, first, kernel)
    both = np.zeros((first.max() + 1, second.max() + 1))
    np.add.at(both.T, second, sums.T)
    return Blocks(both, np.outer(np.bincount(first), np.bincount(second)).astype(np.float64))


def kid(one: Blocks, other: Blocks, across: Blocks, first: F64, second: F64) -> float | None:
    """Squared distance; below 0 by chance, where two sets are alike. None where a set has a single clip.

    `first` and `second` say how often each clip counts; a clip that counts twice is no pair with itself.
    """
    parts = [
        _mean(one, np.outer(first, first) * (1 - np.eye(len(first)))),
        _mean(other, np.outer(second, second) * (1 - np.eye(len(second)))),
        _mean(across, np.outer(first, second)),
    ]
    if any(part is None for part in parts):
        return None
    within, beside, between = (float(part) for part in parts if part is not None)
    return within + beside - 2 * between


def _mean(sums: Blocks, weights: F64) -> float | None:
    count = float((sums.pairs * weights).sum())
    return float((sums.sums * weights).sum()) / count if count else None
