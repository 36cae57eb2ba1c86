"""Draws compared with SciPy's distributions; Latin hypercubes compared with their definition."""

from __future__ import annotations

from collections import Counter

import numpy as np
import pytest
from scipy import stats

from physgen.batch.axes import read_axes
from physgen.batch.sweep import Design, draw, latin_draw, planned
from physgen.batch.values import read_distribution

SIGNIFICANCE = 1e-3
"""Seeds are fixed, so a test that passes goes on passing."""


@pytest.mark.parametrize("design", list(Design))
@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("~uniform(-3, 5)", stats.uniform(-3, 8)),
        ("~normal(200, 15)", stats.norm(200, 15)),
        ("~loguniform(0.01, 1000)", stats.loguniform(0.01, 1000)),
        ("~normal(0.5, 0.3, 0, 1)", stats.truncnorm(-5 / 3, 5 / 3, 0.5, 0.3)),
        ("~normal(5, 2, 9, inf)", stats.truncnorm(2, np.inf, 5, 2)),
    ],
)
def test_draws_have_the_distribution(text: str, expected: stats.rv_continuous, design: Design) -> None:
    sweep = planned(read_axes([f"a.b={text}"]), samples=3000, seed=7, design=design)
    found = [point.values[0].data for point in sweep]
    assert stats.kstest(found, expected.cdf).pvalue > SIGNIFICANCE
    assert len(set(found)) == 3000


def test_quantiles_of_truncated_normal_distributions_are_those_of_scipy() -> None:
    shares = np.array([1e-3, 0.25, 0.5, 0.9, 0.999])
    bounds = [(-1, 1), (-0.5, 30), (2, 4), (-np.inf, -3), (-5, -4), (-np.inf, np.inf)]
    for low, high in bounds:
        distribution = read_distribution(f"~normal(10, 2, {10 + 2 * low}, {10 + 2 * high})")
        found = [distribution.at(share).data for share in shares]
        assert found == pytest.approx(list(stats.truncnorm(low, high, 10, 2).ppf(shares)), rel=1e-9)
        assert all(10 + 2 * low <= value <= 10 + 2 * high for value in found)


def test_integers_and_choices_are_equally_likely() -> None:
    sweep = planned(read_axes(["a=~integers(1, 6)", "b=~choice(x, y, y, [1, 2])"]), samples=6000, seed=1)
    points = list(sweep)
    dice = Counter(point.values[0].data for point in points)
    assert sorted(dice) == [1, 2, 3, 4, 5, 6]
    assert stats.chisquare(list(dice.values())).pvalue > SIGNIFICANCE
    words = Counter(point.values[1].text for point in points)
    assert (
        stats.chisquare([words["x"], words["y"], words["[1, 2]"]], [1500, 3000, 1500]).pvalue > SIGNIFICANCE
    )


def test_draws_of_keys_and_seeds_are_independent() -> None:
    keys = ("objects.ball.mass", "objects.ball.masses", "objects.bal.lmass")
    found = np.array([[draw(seed, key, k) for k in range(4000)] for key in keys for seed in (0, 1, -1)])
    assert np.abs(np.corrcoef(found) - np.eye(9)).max() < 4.5 / np.sqrt(4000)
    assert stats.kstest(found.ravel(), "uniform").pvalue > SIGNIFICANCE


def test_a_draw_depends_on_its_seed_key_and_number_only() -> None:
    one = planned(read_axes(["a.b=~uniform(0,1)"]), samples=50, seed=3)
    keys = ["z=~normal(0,1)", "g=1,2", "a.b=~uniform(0,1)", "c=~integers(1,9)"]
    more = planned(read_axes(keys), samples=90, seed=3)
    alone = [point.values[0] for point in one]
    assert [more[k].values[2] for k in range(50)] == alone
    assert [more[90 + k].values[2] for k in range(50)] == alone  # the other point of the grid
    other = planned(read_axes(["a.b=~uniform(0,1)"]), samples=50, seed=4)
    assert all(a.values != b.values for a, b in zip(one, other, strict=True))


@pytest.mark.parametrize("count", [1, 2, 3, 17, 1000])
def test_a_latin_hypercube_has_one_draw_in_every_stratum_of_every_key(count: int) -> None:
    axes = ["a=~uniform(10, 20)", "b=~normal(0, 1)", "c=~loguniform(1, 100)"]
    sweep = planned(read_axes(axes), samples=count, seed=2, design=Design.LATIN)
    found = np.array([[value.data for value in point.values] for point in sweep]).T
    expected = (stats.uniform(10, 10), stats.norm, stats.loguniform(1, 100))
    for values, distribution in zip(found, expected, strict=True):
        assert sorted(np.floor(distribution.cdf(values) * count).astype(int)) == list(range(count))


def test_keys_of_a_latin_hypercube_are_independent() -> None:
    found = np.array([[latin_draw(5, key, k, 997) for k in range(997)] for key in "abcd"])
    assert np.abs(np.corrcoef([*found, np.arange(997)]) - np.eye(5)).max() < 4.5 / np.sqrt(997)
    assert stats.kstest((found * 997 % 1).ravel(), "uniform").pvalue > SIGNIFICANCE


def test_the_millionth_clip_needs_none_before_it() -> None:
    sweep = planned(read_axes(["a=~normal(0,1)", "b=1:10:10"]), samples=10**6, seed=1, design=Design.LATIN)
    assert len(sweep) == 10**7
    assert sweep[10**7 - 1].name.startswith("09-999999,")
