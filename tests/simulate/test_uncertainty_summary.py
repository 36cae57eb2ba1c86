"""Intervals, correlations and spreads beside scipy's."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from physgen.evaluate.controllability import correlation, ranks
from physgen.simulate.uncertainty import radius, wilson


@pytest.mark.parametrize(("count", "total"), [(0, 2), (13, 32), (32, 32), (1, 1000)])
def test_intervals_are_wilsons(count: int, total: int) -> None:
    known = stats.binomtest(count, total).proportion_ci(0.95, method="wilson")
    assert wilson(count, total) == pytest.approx((known.low, known.high), abs=1e-9)


def test_correlations_are_spearmans() -> None:
    random = np.random.default_rng(1)
    for _ in range(20):
        a = random.integers(0, 6, 30).astype(float)
        b = a + random.normal(0, 3, 30)
        assert np.array_equal(ranks(a) + 1, stats.rankdata(a))
        assert correlation(a, b) == pytest.approx(stats.spearmanr(a, b).statistic, abs=1e-12)
    assert correlation(np.ones(5), np.arange(5.0)) == 0


def test_nine_of_ten_places_lie_within_the_radius() -> None:
    places = np.random.default_rng(3).normal(0, 10, (4000, 2))
    assert radius(places) == pytest.approx(10 * np.sqrt(stats.chi2(2).ppf(0.9)), rel=0.05)
