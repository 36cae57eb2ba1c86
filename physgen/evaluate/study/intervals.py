"""Scores -> means by method, and where they would lie with other raters and other videos.

The interval is a bootstrap over both: raters and scenes are drawn again, with replacement and apart from each other,
and the mean is taken anew (A. Owen, The pigeonhole bootstrap, Annals of Applied Statistics 2007; it errs on the wide
side). Methods share the draws, so that their differences have intervals too.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

F64 = NDArray[np.float64]
Scores = NDArray[np.int64]
"""(R, M, S): 1 to 5 that R raters gave M methods in S scenes, 0 where a rater gave none."""

DRAWS = 5000
COVER = (0.025, 0.975)


@dataclass(frozen=True)
class Mean:
    """With its 95 % interval; None where nothing is known, and no interval of a single answer."""

    mean: float | None
    low: float | None
    high: float | None


class Draws:
    """Raters and scenes drawn again and again; one set for all that is asked of a study."""

    def __init__(self, raters: int, scenes: int, seed: int = 0) -> None:
        self.alone = raters == 1 and scenes == 1
        """Then nothing can be drawn."""
        random = np.random.default_rng(seed)
        self._raters = _drawn(raters, random)
        self._scenes = _drawn(scenes, random)

    def sums(self, values: F64) -> F64:
        """(R, M, S) -> (B, M): their sum in every draw."""
        raters, methods, scenes = values.shape
        by_raters = (self._raters @ values.reshape(raters, -1)).reshape(-1, methods, scenes)
        return np.asarray((by_raters * self._scenes[:, None]).sum(axis=2), np.float64)


def means(scores: Scores, draws: Draws) -> list[Mean]:
    """One a method: of all answers that it got."""
    return ratio(scores.astype(np.float64), (scores > 0).astype(np.float64), draws)


def differences(scores: Scores, one: int, other: int, draws: Draws) -> Mean:
    """Of two methods, where a rater scored both in a scene."""
    both = ((scores[:, one] > 0) & (scores[:, other] > 0)).astype(np.float64)
    apart = (scores[:, one] - scores[:, other]) * both
    return ratio(apart[:, None], both[:, None], draws)[0]


def ratio(values: F64, counted: F64, draws: Draws) -> list[Mean]:
    """Means of (R, M, S) values by method, each over what is `counted`, with intervals."""
    count = counted.sum(axis=(0, 2))
    total = values.sum(axis=(0, 2))
    if draws.alone:
        return [Mean(float(t / n) if n else None, None, None) for t, n in zip(total, count, strict=True)]
    tops, below = draws.sums(values), draws.sums(counted)
    found = []
    for k, n in enumerate(count):
        has = below[:, k] > 0  # where answers are missing, a draw may hold none
        if not n or not has.any():
            found.append(Mean(None, None, None))
            continue
        ends = np.quantile(tops[has, k] / below[has, k], COVER).tolist() if n > 1 else (None, None)
        found.append(Mean(float(total[k] / n), *ends))
    return found


def _drawn(count: int, random: np.random.Generator) -> F64:
    """(B, count): how often each came."""
    return random.multinomial(count, np.full(count, 1 / count), DRAWS).astype(np.float64)
