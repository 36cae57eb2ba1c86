"""Draws against the distributions that they are of, and a Latin hypercube against what makes one."""

from __future__ import annotations

import subprocess
import sys
from collections import Counter

import numpy as np
import pytest
from scipy import stats

from physgen.batch.axes import read_axes
from physgen.batch.distributions import below, between, lot, normal, read_distribution, shuffled, stratified
from physgen.batch.sweep import Design, planned

FEW = 1e-3
"""A true sample is refused so seldom; seeds are fixed, so a test that passes goes on passing."""


@pytest.mark.parametrize("design", list(Design))
@pytest.mark.parametrize(
    ("text", "true"),
    [
        ("~uniform(-3, 5)", stats.uniform(-3, 8)),
        ("~normal(200, 15)", stats.norm(200, 15)),
        ("~loguniform(0.01, 1000)", stats.loguniform(0.01, 1000)),
        ("~normal(0.5, 0.3, 0, 1)", stats.truncnorm(-5 / 3, 5 / 3, 0.5, 0.3)),
        ("~normal(5, 2, 9, inf)", stats.truncnorm(2, np.inf, 5, 2)),
    ],
)
def test_draws_have_the_distribution(text: str, true: stats.rv_continuous, design: Design) -> None:
    sweep = planned(read_axes([f"a.b={text}"]), samples=3000, seed=7, design=design)
    found = [point.values[0].data for point in sweep]
    assert stats.kstest(found, true.cdf).pvalue > FEW
    assert len(set(found)) == 3000


def test_bounds_are_kept_to_the_last_digits_however_far_from_the_mean() -> None:
    shares = np.array([1e-12, 1e-3, 0.25, 0.5, 0.9, 1 - 1e-9])
    for low, high in ((-1, 1), (-0.5, 30), (8, 9), (-np.inf, -3), (20, np.inf), (-36.5, -36.4)):
        found = [
            read_distribution(f"~normal(10, 2, {10 + 2 * low}, {10 + 2 * high})").at(share).data
            for share in shares
        ]
        assert found == pytest.approx(list(stats.truncnorm(low, high, 10, 2).ppf(shares)), rel=1e-10)
        assert all(10 + 2 * low <= value <= 10 + 2 * high for value in found)
    points = [*np.linspace(-37, 8, 91), 0.0]
    assert [float(below(z)) for z in points] == pytest.approx(list(stats.norm.cdf(points)), rel=1e-12)


def test_a_logarithm_of_negative_numbers_is_mirrored() -> None:
    found = [
        -read_distribution("~loguniform(-100, -1)").at(share).data for share in np.linspace(0.01, 0.99, 99)
    ]
    assert found == pytest.approx(list(stats.loguniform(1, 100).ppf(1 - np.linspace(0.01, 0.99, 99))))


def test_integers_and_choices_are_all_alike() -> None:
    sweep = planned(read_axes(["a=~integers(1, 6)", "b=~choice(x, y, y, [1, 2])"]), samples=6000, seed=1)
    points = list(sweep)
    dice = Counter(point.values[0].data for point in points)
    assert sorted(dice) == [1, 2, 3, 4, 5, 6]
    assert stats.chisquare(list(dice.values())).pvalue > FEW
    words = Counter(point.values[1].text for point in points)
    assert stats.chisquare([words["x"], words["y"], words["[1, 2]"]], [1500, 3000, 1500]).pvalue > FEW


def test_the_quantile_of_the_normal_distribution_is_true_to_the_last_digits() -> None:
    shares = np.concatenate(
        [np.linspace(1e-6, 1 - 1e-6, 2001), 10.0 ** -np.arange(2, 17), 1 - 10.0 ** -np.arange(2, 16)]
    )
    found = np.array([normal(share) for share in shares.tolist()])
    assert found == pytest.approx(stats.norm.ppf(shares), rel=2e-14, abs=1e-16)
    for low, high in ((1, 10), (1e-300, 1e300)):
        from decimal import Decimal

        assert between(low, high, Decimal(0)) == low
        assert between(low, high, Decimal(1)) == high


def test_draws_of_keys_and_seeds_are_independent() -> None:
    keys = ("objects.ball.mass", "objects.ball.masses", "objects.bal.lmass")
    found = np.array([[lot(seed, key, k) for k in range(4000)] for key in keys for seed in (0, 1, -1)])
    assert np.abs(np.corrcoef(found) - np.eye(9)).max() < 4.5 / np.sqrt(4000)
    assert stats.kstest(found.ravel(), "uniform").pvalue > FEW
    lag = [np.corrcoef(row[:-1], row[1:])[0, 1] for row in found]
    assert np.abs(lag).max() < 4.5 / np.sqrt(4000)


def test_a_draw_depends_on_its_seed_key_and_number_alone() -> None:
    one = planned(read_axes(["a.b=~uniform(0,1)"]), samples=50, seed=3)
    more = planned(
        read_axes(["z=~normal(0,1)", "g=1,2", "a.b=~uniform(0,1)", "c=~integers(1,9)"]), samples=90, seed=3
    )
    alone = [point.values[0] for point in one]
    assert [more[k].values[2] for k in range(50)] == alone
    assert [
        more[90 + k].values[2] for k in range(50)
    ] == alone  # the other point of the grid has the same draws
    other = planned(read_axes(["a.b=~uniform(0,1)"]), samples=50, seed=4)
    assert all(a.values != b.values for a, b in zip(one, other, strict=True))


def test_draws_are_the_same_in_another_process_and_written_down() -> None:
    code = (
        "from physgen.batch.distributions import lot, stratified\n"
        "print(lot(3, 'a', 10**6), stratified(3, 'a', 5, 1000))"
    )
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert run.stdout.split() == [repr(lot(3, "a", 10**6)), repr(stratified(3, "a", 5, 1000))]
    # of the first version: a sweep that is repeated in a year has the same draws
    assert run.stdout.split() == ["0.20654014334315052", "0.42951240491867065"]


@pytest.mark.parametrize("count", [1, 2, 3, 5, 8, 17, 100, 1000])
def test_a_latin_hypercube_has_one_draw_in_every_stratum_of_every_axis(count: int) -> None:
    axes = ["a=~uniform(10, 20)", "b=~normal(0, 1)", "c=~loguniform(1, 100)"]
    sweep = planned(read_axes(axes), samples=count, seed=2, design=Design.LATIN)
    found = np.array([[value.data for value in point.values] for point in sweep])
    shares = np.stack(
        [
            stats.uniform(10, 10).cdf(found[:, 0]),
            stats.norm.cdf(found[:, 1]),
            stats.loguniform(1, 100).cdf(found[:, 2]),
        ]
    )
    for axis in shares:
        assert sorted(np.floor(axis * count).astype(int)) == list(range(count))


def test_axes_of_a_latin_hypercube_are_shuffled_apart() -> None:
    found = np.array([[shuffled(5, key, k, 997) for k in range(997)] for key in "abcd"])
    assert np.abs(np.corrcoef(found) - np.eye(4)).max() < 4.5 / np.sqrt(997)
    assert np.abs(np.corrcoef(found, np.arange(997))[-1, :-1]).max() < 4.5 / np.sqrt(997)
    inside = np.array([[stratified(5, key, k, 997) for k in range(997)] for key in "abcd"]) * 997 % 1
    assert stats.kstest(inside.ravel(), "uniform").pvalue > FEW


@pytest.mark.parametrize("count", [*range(1, 40), 64, 101, 2500])
def test_shuffling_is_a_permutation(count: int) -> None:
    assert sorted(shuffled(1, "key", k, count) for k in range(count)) == list(range(count))


def test_every_permutation_is_as_likely() -> None:
    orders = Counter(tuple(shuffled(seed, "key", k, 4) for k in range(4)) for seed in range(4800))
    assert len(orders) == 24
    assert stats.chisquare(list(orders.values())).pvalue > FEW
    places = Counter(shuffled(seed, "key", 3, 7) for seed in range(2100))
    assert stats.chisquare([places[k] for k in range(7)]).pvalue > FEW


def test_the_millionth_clip_needs_none_before_it() -> None:
    sweep = planned(read_axes(["a=~normal(0,1)", "b=1:10:10"]), samples=10**6, seed=1, design=Design.LATIN)
    assert len(sweep) == 10**7
    assert sweep[10**7 - 1].name.startswith("09-999999,")
