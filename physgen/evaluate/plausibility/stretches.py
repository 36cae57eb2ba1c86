"""A track -> stretches of constant acceleration, least squares in all; where they meet, something happened.

Optimal partitioning (Jackson et al., 2005): the pieces that make squared errors plus a price for each piece least,
found exactly by dynamic programming. Bounces fall between frames, and so do the borders of pieces.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np

from physgen.evaluate.plausibility.tracks import Array

PRICE = 30.0
"""Of a piece, in squared noise: six numbers are fitted, and its border is chosen among many."""
LONGEST = 90
"""Frames: what is longer is cut, which harms nobody."""
FEWEST = 4
"""Frames that tell a velocity: one more than an acceleration's three numbers."""


@dataclass(frozen=True, eq=False)
class Stretch:
    """Frames in which a thing moved with one acceleration."""

    first: int
    last: int
    """Frames, both in it."""
    middle: float
    """s."""
    terms: Array
    """(3, 2): place px, velocity px/s, acceleration px/s², at the middle."""
    spread: Array
    """(3, 3): covariance of the terms, along each axis; infinite where frames are too few."""
    jerk: Array
    """(2,) px/s³ of a cubic in its place."""
    jerk_error: float
    residual: float
    """Root mean square of what is left, over the noise; 0 where nothing can be."""

    @property
    def count(self) -> int:
        """Of its frames."""
        return self.last - self.first + 1

    @property
    def good(self) -> bool:
        """Whether it tells velocities."""
        return self.count >= FEWEST

    @property
    def acceleration(self) -> Array:
        """(2,) px/s²."""
        return np.asarray(self.terms[2])

    @property
    def acceleration_error(self) -> float:
        """px/s², standard deviation along each axis."""
        return float(np.sqrt(self.spread[2, 2]))

    def place(self, time: float) -> Array:
        """(2,) px."""
        s = time - self.middle
        return np.asarray(self.terms[0] + s * self.terms[1] + s * s / 2 * self.terms[2])

    def place_error(self, time: float) -> float:
        """px."""
        s = time - self.middle
        return _error(np.array([1.0, s, s * s / 2]), self.spread)

    def velocity(self, time: float) -> Array:
        """(2,) px/s."""
        return np.asarray(self.terms[1] + (time - self.middle) * self.terms[2])

    def velocity_error(self, time: float) -> float:
        """px/s, standard deviation along each axis."""
        return _error(np.array([0.0, 1.0, time - self.middle]), self.spread)


def stretches(path: Array, times: Array, first: int, sigma: float) -> list[Stretch]:
    """Of frames without a gap, `path` (n, 2) px at `times` (n,) s; `first` is the number of their first frame."""
    return [
        fitted(path[a:b], times[a:b], first + a, sigma) for a, b in _borders((path - path.mean(0)) / sigma)
    ]


def _borders(path: Array) -> list[tuple[int, int]]:
    """`path` in units of its noise."""
    n = len(path)
    costs = _costs(path)
    best = np.full(n + 1, np.inf)
    best[0] = 0.0
    back = np.zeros(n + 1, np.int64)
    for end in range(1, n + 1):
        begin = max(0, end - LONGEST)
        lengths = end - np.arange(begin, end)
        total = best[begin:end] + costs[lengths, np.arange(begin, end)] + PRICE
        k = int(np.argmin(total))
        best[end], back[end] = total[k], begin + k
    found = []
    end = n
    while end > 0:
        found.append((int(back[end]), end))
        end = int(back[end])
    return found[::-1]


def _costs(path: Array) -> Array:
    """[length, first]: squared errors of the best parabola through `length` frames from `first` on."""
    n = len(path)
    costs = np.zeros((min(n, LONGEST) + 1, n))
    for length in range(4, min(n, LONGEST) + 1):
        windows = np.lib.stride_tricks.sliding_window_view(path, length, axis=0)  # (m, 2, length)
        off = windows - windows[..., :1]
        left = (off**2).sum(axis=2) - ((off @ _basis(length)) ** 2).sum(axis=2)
        costs[length, : n - length + 1] = np.maximum(left, 0.0).sum(axis=1)
    return costs


@cache
def _basis(length: int) -> Array:
    """(length, 3): orthonormal, spans parabolas."""
    grid = np.linspace(-1.0, 1.0, length)
    return np.asarray(np.linalg.qr(np.stack([np.ones(length), grid, grid**2], axis=1))[0])


def fitted(path: Array, times: Array, first: int, sigma: float) -> Stretch:
    """All frames as one stretch."""
    n = len(path)
    middle = float(times.mean())
    s = times - middle
    order = min(n, 3)
    columns = np.stack([np.ones(n), s, s * s / 2], axis=1)[:, :order]
    inverse = np.linalg.pinv(columns)
    terms, spread = np.zeros((3, 2)), np.full((3, 3), np.inf)
    terms[:order] = inverse @ path
    left = path - columns @ terms[:order]
    residual = 0.0
    if n >= FEWEST:
        residual = float(np.sqrt((left**2).sum() / (2 * (n - 3)))) / sigma
        spread = inverse @ inverse.T * (sigma * max(1.0, residual)) ** 2
    jerk, error = np.zeros(2), np.inf
    if n > FEWEST:
        cubic = np.linalg.pinv(np.concatenate([columns, (s**3 / 6)[:, None]], axis=1))
        jerk = cubic[3] @ path
        error = float(np.sqrt(cubic[3] @ cubic[3])) * sigma
    return Stretch(first, first + n - 1, middle, terms, spread, jerk, error, residual)


def _error(row: Array, spread: Array) -> float:
    if not np.isfinite(spread).all():
        return np.inf
    return float(np.sqrt(max(float(row @ spread @ row), 0.0)))
