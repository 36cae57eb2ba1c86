"""Counts and columns of draws -> shares with their intervals, rank correlations, spreads of places."""

from __future__ import annotations

from math import hypot, sqrt
from statistics import NormalDist

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

SURE = 0.95
"""Of intervals, and that a correlation is no chance."""
MOST = 0.9
"""Part of all draws that a spread holds."""


def wilson(count: int, total: int) -> tuple[float, float]:
    """The 95 % interval of a share of which `count` of `total` draws are known (Wilson, J. Am. Stat. Assoc. 22, 1927).

    >>> [round(end, 3) for end in wilson(13, 32)]
    [0.255, 0.577]
    """
    z = NormalDist().inv_cdf((1 + SURE) / 2)
    share, part = count / total, z * z / total
    middle = (share + part / 2) / (1 + part)
    half = z / (1 + part) * sqrt(share * (1 - share) / total + part / (4 * total))
    return max(middle - half, 0.0), min(middle + half, 1.0)


def mean_of_two(first: tuple[int, int], second: tuple[int, int]) -> tuple[float, float]:
    """The 95 % interval of the mean of two independent shares (count, total), by Wilson's of each (Newcombe 1998).

    >>> [round(end, 3) for end in mean_of_two((69, 72), (349, 366))]
    [0.917, 0.972]
    """
    shares = [count / total for count, total in (first, second)]
    (low, high), (lower, higher) = wilson(*first), wilson(*second)
    middle = sum(shares) / 2
    below, above = hypot(shares[0] - low, shares[1] - lower), hypot(high - shares[0], higher - shares[1])
    return middle - below / 2, middle + above / 2


def ranks(values: Array) -> Array:
    """(N,) places in rising order, the mean place where some are equal.

    >>> ranks(np.array([3.0, 1.0, 3.0])).tolist()
    [1.5, 0.0, 1.5]
    """
    _, back, counts = np.unique(values, return_inverse=True, return_counts=True)
    last = np.cumsum(counts) - 1
    return np.asarray((last - (counts - 1) / 2)[back.ravel()], np.float64)


def correlation(first: Array, second: Array) -> float:
    """Spearman's rank correlation of two columns (N,); 0 where one of them is all the same."""
    a, b = (rank - rank.mean() for rank in (ranks(first), ranks(second)))
    scale = float(np.sqrt((a @ a) * (b @ b)))
    return float(a @ b) / scale if scale > 0 else 0.0


def telling(draws: int, columns: int) -> float:
    """Size of a rank correlation from which it is no chance, that of the best of `columns` being looked at."""
    if draws < 4 or not columns:
        return 1.0
    return min(NormalDist().inv_cdf(1 - (1 - SURE) / 2 / columns) / sqrt(draws - 1), 1.0)


def radius(places: Array) -> float:
    """px about their middle within which 9 of 10 places `(N, 2)` lie."""
    off = places - np.median(places, axis=0)
    return float(np.quantile(np.hypot(*off.T), MOST, method="higher")) if len(places) else 0.0


def along(places: Array) -> Array:
    """(N,) px: how far each of the places `(N, 2)` lies along the line on which they differ most."""
    off = places - places.mean(axis=0)
    way = np.linalg.svd(off, full_matrices=False)[2][0]
    return np.asarray(off @ (way if way[np.argmax(np.abs(way))] > 0 else -way))
