"""Features of two sets of pictures -> the Fréchet distance of the two normal distributions that have their
moments.

    d² = |m1 - m2|² + tr(S1 + S2 - 2 (S1 S2)^½)

Heusel et al., GANs Trained by a Two Time-Scale Update Rule, NeurIPS 2017, equation 6. With S1 = A'A and S2 = B'B, the
eigenvalues of S1 S2 are the squares of the singular values of A B', and the trace of the root is their sum. Nothing is
inverted, and no root is taken of what rounding made a little negative: sets of fewer pictures than features will do.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

F64 = NDArray[np.float64]


@dataclass(frozen=True)
class Moments:
    """Of a set of pictures."""

    mean: F64
    """(D,)."""
    root: F64
    """(K, D), K <= D: the covariance (divided by N - 1) is root' root."""

    @property
    def spread(self) -> float:
        """The trace of the covariance."""
        return float(np.square(self.root).sum())


def moments(features: F64, weights: F64 | None = None) -> Moments:
    """Of (N, D) features. `weights` (N,) say how often each counts, as if it were there so many times.

    Raises ValueError for fewer than two pictures.
    """
    counts = np.ones(len(features)) if weights is None else np.asarray(weights, np.float64)
    total = float(counts.sum())
    if total < 2:
        raise ValueError("a covariance needs two pictures or more")
    there = counts > 0
    features, counts = np.asarray(features[there], np.float64), counts[there]
    mean = counts @ features / total
    scaled = (features - mean) * np.sqrt(counts / (total - 1))[:, None]
    if len(scaled) <= scaled.shape[1]:
        return Moments(mean, scaled)
    # of more pictures than features, a triangle that has the same moments
    return Moments(mean, np.asarray(np.linalg.qr(scaled, "r"), np.float64))


def moments_of(mean: F64, covariance: F64) -> Moments:
    """Of a mean (D,) and a symmetric covariance (D, D) without negative eigenvalues."""
    values, vectors = np.linalg.eigh(np.asarray(covariance, np.float64))
    return Moments(np.asarray(mean, np.float64), np.sqrt(np.maximum(values, 0))[:, None] * vectors.T)


def frechet(one: Moments, other: Moments) -> float:
    """The squared distance d², which is what is called FID; 0 or more."""
    shared = np.linalg.svd(one.root @ other.root.T, compute_uv=False)
    apart = float(np.square(one.mean - other.mean).sum())
    return max(0.0, apart + one.spread + other.spread - 2 * float(shared.sum()))
