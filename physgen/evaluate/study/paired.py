"""Two methods, rated by the same people in the same scenes -> how far apart they are, and whether that may be
chance.

The test flips signs: were there no difference, the mean difference of a rater would as soon be the other way round
(R. Fisher, The Design of Experiments, 1935, section 21). It is done twice, with raters and with scenes as what
varies, and the larger p counts: a difference must hold for other people and for other videos (H. Clark, The
language-as-fixed-effect fallacy, 1973). docs/study.md has how often simulated studies of methods that are alike find
a difference all the same.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from physgen.evaluate.study.intervals import Draws, Mean, Scores, differences

F64 = NDArray[np.float64]

EXACT = 16
"""Differences up to which all patterns of signs are gone through."""
DRAWS = 50_000
"""Patterns that are drawn beyond that."""


@dataclass(frozen=True)
class Pair:
    """One method against another in one question."""

    one: int
    other: int
    """Of the methods, from 0."""
    apart: Mean
    """Mean of `one` less that of `other`."""
    better: int
    even: int
    worse: int
    """Answers of one rater to one scene in which `one` has more, as much, less."""
    by_raters: float | None
    by_videos: float | None
    """p, two-sided; None where there is one rater or one video alone, or nobody rated both methods."""
    adjusted: float | None = None
    """The larger of them after Holm, for all pairs of a question."""

    @property
    def p(self) -> float | None:
        """The larger of the two."""
        return max((p for p in (self.by_raters, self.by_videos) if p is not None), default=None)


def pairs(scores: Scores, draws: Draws, seed: int = 0) -> list[Pair]:
    """Every two methods of (R, M, S) scores."""
    found = [_pair(scores, a, b, draws, seed) for a, b in combinations(range(scores.shape[1]), 2)]
    adjusted = holm([pair.p for pair in found])
    return [replace(pair, adjusted=p) for pair, p in zip(found, adjusted, strict=True)]


def _pair(scores: Scores, one: int, other: int, draws: Draws, seed: int) -> Pair:
    both = (scores[:, one] > 0) & (scores[:, other] > 0)
    apart = np.where(both, scores[:, one] - scores[:, other], 0)
    by_raters, by_videos = (
        sign_flip(_means(apart, both, axis), seed) if units > 1 and both.any() else None
        for axis, units in ((1, scores.shape[0]), (0, scores.shape[2]))
    )
    return Pair(
        one,
        other,
        differences(scores, one, other, draws),
        int((apart > 0).sum()),
        int((both & (apart == 0)).sum()),
        int((apart < 0).sum()),
        by_raters,
        by_videos,
    )


def _means(apart: NDArray[np.int64], both: NDArray[np.bool_], axis: int) -> F64:
    """Mean difference of every rater (axis 1) or scene (axis 0) that has one."""
    count = both.sum(axis=axis)
    return np.asarray(apart.sum(axis=axis)[count > 0] / count[count > 0], np.float64)


def sign_flip(values: F64, seed: int = 0) -> float:
    """p, two-sided, of a mean as far from 0 as that of `values` (n,), had each the other sign as soon.

    Exact up to 16 values; else of 50,000 patterns of signs drawn with `seed`, the one that was seen among them.
    """
    n = len(values)
    if n == 0:
        return 1.0
    seen = abs(values.sum()) * (1 - 1e-12) - 1e-12
    if n <= EXACT:
        signs = 1 - 2 * ((np.arange(2**n)[:, None] >> np.arange(n)) & 1)
        return float((np.abs(signs @ values) >= seen).mean())
    signs = 1 - 2 * np.random.default_rng(seed).integers(0, 2, (DRAWS, n), np.int8)
    return float((1 + (np.abs(signs @ values) >= seen).sum()) / (1 + DRAWS))


def holm(found: Sequence[float | None]) -> list[float | None]:
    """p of several tests, adjusted so that the chance of any false alarm stays what it says (S. Holm, 1979).

    >>> holm([0.01, 0.04, None, 0.03])
    [0.03, 0.06, None, 0.06]
    """
    known = sorted((p, k) for k, p in enumerate(found) if p is not None)
    adjusted: list[float | None] = [None] * len(found)
    most = 0.0
    for rank, (p, k) in enumerate(known):
        most = max(most, min((len(known) - rank) * p, 1.0))
        adjusted[k] = most
    return adjusted
