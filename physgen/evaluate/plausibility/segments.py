"""Noise of tracks, and segments of constant acceleration in each track."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray

from physgen.evaluate.plausibility.tracks import Array, Tracks


@dataclass(frozen=True)
class Tuning:
    """Constants from the calibration in benchmarks/plausibility."""

    price: float = 30.0
    """Price of a segment, in squared noise: six fitted numbers, and a border chosen
    among many.
    """
    max_frames: int = 90
    """Maximum number of frames of a segment."""
    min_frames: int = 4
    """Minimum number of frames for a velocity: one more than the three numbers of a
    parabola.
    """


TUNING = Tuning()
MEDIAN_TO_SIGMA = 1.4826
"""Standard deviation of a normal distribution over its median deviation."""
DIFFERENCE_VARIANCE = 20
"""Variance of a third difference over the variance of a value: 1 + 9 + 9 + 1."""


def find_runs(visible: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Return the first and last + 1 of each run of frames without a gap.

    >>> find_runs(np.array([True, True, False, True]))
    [(0, 2), (3, 4)]
    """
    # A frame without a body at both ends closes every run.
    flags = np.concatenate([[False], visible, [False]]).astype(np.int8)
    edges = np.flatnonzero(np.diff(flags))
    return [(int(a), int(b)) for a, b in zip(edges[::2], edges[1::2], strict=True)]


# ---- noise


def measure_noise(tracks: Tracks) -> Array:
    """Return the standard deviation of each body along each axis, (N,) px, at least
    `tracks.noise_floor`.

    The median ignores impacts, if they are rare. A body at rest gives no estimate:
    centroids of pixels shake only in motion. A body without an estimate gets the median
    of the others.
    """
    sigma = np.array([_body_noise(tracks, k) for k in range(len(tracks.names))])
    is_known = np.isfinite(sigma)
    typical = tracks.noise_floor
    if is_known.any():
        typical = float(np.median(sigma[is_known]))
    # Very quiet tracks get half of the usual noise: their few frames may be luck.
    sigma = np.where(is_known, sigma, typical)
    sigma = np.clip(sigma, typical / 2, None)
    return np.asarray(np.maximum(sigma, tracks.noise_floor))


def _body_noise(tracks: Tracks, body: int) -> float:
    """Return the noise of one body from third differences, px; NaN if unknown."""
    parts = [np.empty((0, 2))]
    for first, last in find_runs(tracks.visible[:, body]):
        path = tracks.places[first:last, body]
        # A third difference removes any parabola, so that noise and impacts remain.
        distances = np.hypot(*(path[3:] - path[:-3]).T)
        is_moving = distances > 2 * tracks.noise_floor
        third_differences = np.abs(np.diff(path, 3, axis=0))
        parts.append(third_differences[is_moving])
    differences = np.concatenate(parts)
    if len(differences) <= TUNING.min_frames:
        return np.nan
    to_sigma = MEDIAN_TO_SIGMA / np.sqrt(DIFFERENCE_VARIANCE)
    return float(to_sigma * float(np.median(differences)))


# ---- segments


@dataclass(frozen=True, eq=False)
class Segment:
    """Frames of a motion with constant acceleration."""

    first: int
    last: int
    """First and last frame, both inclusive."""
    middle: float
    """Time of the middle, s."""
    terms: Array
    """(3, 2): place px, velocity px/s, acceleration px/s², at the middle."""
    spread: Array
    """(3, 3): covariance of the terms, along each axis; infinite for too few frames."""
    residual: float = 0.0
    """Root mean square of the deviations, over the noise; 0 for too few frames."""

    @property
    def count(self) -> int:
        """Return the number of frames."""
        return self.last - self.first + 1

    @property
    def has_velocity(self) -> bool:
        """Return whether the number of frames is enough for a velocity."""
        return self.count >= TUNING.min_frames

    @property
    def acceleration(self) -> Array:
        """Return the acceleration, (2,) px/s²."""
        return np.asarray(self.terms[2])

    def value(self, time: float, order: int = 0) -> Array:
        """Return the place px, velocity px/s or acceleration px/s² (`order` 0,
        1, 2), (2,).
        """
        return np.asarray(_factors(time - self.middle, order) @ self.terms)

    def error(self, time: float, order: int = 0) -> float:
        """Return the standard deviation of `value` along each axis."""
        if not np.isfinite(self.spread).all():
            return np.inf
        factors = _factors(time - self.middle, order)
        return float(np.sqrt(max(float(factors @ self.spread @ factors), 0.0)))


def _factors(s: float, order: int) -> Array:
    """Return the factors of the three terms at a time (s) from the middle, (3,)."""
    derivatives = ([1.0, s, s * s / 2], [0.0, 1.0, s], [0.0, 0.0, 1.0])
    return np.array(derivatives[order])


def split_segments(
    path: Array, times: Array, first: int, sigma: float
) -> list[Segment]:
    """Return the segments of frames without a gap, `path` (n, 2) px at `times` (n,) s;
    `first` is their first frame.

    The borders minimise the sum of squared errors and prices, by dynamic programming.
    """
    n = len(path)
    # Costs are in squared noise, as the price of a segment is.
    costs = _parabola_costs((path - path.mean(0)) / sigma)
    lowest_costs = np.full(n + 1, np.inf)
    best_begins = np.zeros(n + 1, np.int64)
    lowest_costs[0] = 0.0
    for end in range(1, n + 1):
        begins = np.arange(max(0, end - TUNING.max_frames), end)
        # The best split up to `end` has a last segment and the best split before it.
        totals = lowest_costs[begins] + costs[end - begins, begins] + TUNING.price
        k = int(np.argmin(totals))
        lowest_costs[end] = totals[k]
        best_begins[end] = begins[k]
    # The best begins lead back from the last frame to the first.
    segments = []
    end = n
    while end > 0:
        begin = int(best_begins[end])
        frames = slice(begin, end)
        segments.append(fit_segment(path[frames], times[frames], first + begin, sigma))
        end = begin
    return segments[::-1]


def _parabola_costs(path: Array) -> Array:
    """Return [length, first]: squared errors of the best parabola through `length`
    frames from `first`.
    """
    n = len(path)
    # Costs of windows with up to three frames stay 0: a parabola passes through them.
    longest = min(n, TUNING.max_frames)
    costs = np.zeros((longest + 1, n))
    for length in range(TUNING.min_frames, longest + 1):
        # All windows of one length share the basis, so that one product fits them all.
        windows = np.lib.stride_tricks.sliding_window_view(path, length, axis=0)
        # The shape is (m, 2, length).
        # Differences from the first frame keep digits; a parabola absorbs any offset.
        offsets = windows - windows[..., :1]
        explained = ((offsets @ _parabola_basis(length)) ** 2).sum(axis=2)
        errors = (offsets**2).sum(axis=2) - explained
        costs[length, : n - length + 1] = np.maximum(errors, 0.0).sum(axis=1)
    return costs


@cache
def _parabola_basis(length: int) -> Array:
    """Return an orthonormal basis of all parabolas, (length, 3)."""
    # With an orthonormal basis, the squared projection is the explained square.
    grid = np.linspace(-1.0, 1.0, length)
    columns = np.stack([np.ones(length), grid, grid**2], axis=1)
    return np.asarray(np.linalg.qr(columns)[0])


def fit_segment(path: Array, times: Array, first: int, sigma: float) -> Segment:
    """Return the segment of all frames of a path, (n, 2) px at (n,) s; `sigma`
    is their noise, px.
    """
    n = len(path)
    middle = float(times.mean())
    # Times from the middle make the columns nearly orthogonal, and the inverse
    # accurate.
    s = times - middle
    # Few frames determine only a place, or a place and a velocity.
    order = min(n, 3)
    columns = np.stack([np.ones(n), s, s * s / 2], axis=1)[:, :order]
    inverse = np.linalg.pinv(columns)
    terms = np.zeros((3, 2))
    spread = np.full((3, 3), np.inf)
    residual = 0.0
    terms[:order] = inverse @ path
    if n >= TUNING.min_frames:
        # Two axes with n - 3 free residuals each.
        deviations = path - columns @ terms
        squared_error = (deviations**2).sum() / (2 * (n - 3))
        residual = float(np.sqrt(squared_error)) / sigma
        # Residuals above the noise mean that the noise or the model is worse than
        # assumed.
        spread = inverse @ inverse.T * (sigma * max(1.0, residual)) ** 2
    return Segment(first, first + n - 1, middle, terms, spread, residual)
