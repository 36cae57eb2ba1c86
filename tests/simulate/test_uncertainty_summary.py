"""Intervals and spreads beside scipy's."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from physgen.simulate.uncertainty import radius, wilson


@pytest.mark.parametrize(("count", "total"), [(0, 2), (13, 32), (32, 32), (1, 1000)])
def test_intervals_are_wilsons(count: int, total: int) -> None:
    known = stats.binomtest(count, total).proportion_ci(0.95, method="wilson")
    assert wilson(count, total) == pytest.approx((known.low, known.high), abs=1e-9)


def test_nine_of_ten_places_lie_within_the_radius() -> None:
    places = np.random.default_rng(3).normal(0, 10, (4000, 2))
    assert radius(places) == pytest.approx(10 * np.sqrt(stats.chi2(2).ppf(0.9)), rel=0.05)
