"""Draws compared with SciPy's distributions."""

from __future__ import annotations

from collections import Counter

import numpy as np
import pytest
from scipy import stats

from physgen.batch.axes import read_axes
from physgen.batch.sweep import draw, plan_clips

SIGNIFICANCE = 1e-3
"""Seeds are fixed, so a test that passes goes on passing."""


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("~uniform(-3, 5)", stats.uniform(-3, 8)),
        ("~normal(200, 15)", stats.norm(200, 15)),
        ("~loguniform(0.01, 1000)", stats.loguniform(0.01, 1000)),
    ],
)
def test_draws_have_the_distribution(text: str, expected: stats.rv_continuous) -> None:
    sweep = plan_clips(read_axes([f"a.b={text}"]), samples=3000, seed=7)
    found = [point.values[0].data for point in sweep]
    assert stats.kstest(found, expected.cdf).pvalue > SIGNIFICANCE
    assert len(set(found)) == 3000


def test_choices_are_equally_likely() -> None:
    points = plan_clips(read_axes(["b=~choice(x, y, y, [1, 2])"]), samples=6000, seed=1)
    words = Counter(point.values[0].text for point in points)
    found = [words["x"], words["y"], words["[1, 2]"]]
    assert stats.chisquare(found, [1500, 3000, 1500]).pvalue > SIGNIFICANCE


def test_draws_of_keys_and_seeds_are_independent() -> None:
    keys = ("objects.ball.mass", "objects.ball.masses", "objects.bal.lmass")
    found = np.array(
        [
            [draw(seed, key, k) for k in range(4000)]
            for key in keys
            for seed in (0, 1, -1)
        ]
    )
    assert np.abs(np.corrcoef(found) - np.eye(9)).max() < 4.5 / np.sqrt(4000)
    assert stats.kstest(found.ravel(), "uniform").pvalue > SIGNIFICANCE


def test_a_draw_depends_on_its_seed_key_and_number_only() -> None:
    one = plan_clips(read_axes(["a.b=~uniform(0,1)"]), samples=50, seed=3)
    keys = ["z=~normal(0,1)", "g=1,2", "a.b=~uniform(0,1)", "c=~choice(1,9)"]
    more = plan_clips(read_axes(keys), samples=90, seed=3)
    alone = [point.values[0] for point in one]
    assert [more[k].values[2] for k in range(50)] == alone
    assert [
        more[90 + k].values[2] for k in range(50)
    ] == alone  # the other point of the grid
    other = plan_clips(read_axes(["a.b=~uniform(0,1)"]), samples=50, seed=4)
    assert all(a.values != b.values for a, b in zip(one, other, strict=True))


def test_the_millionth_clip_needs_none_before_it() -> None:
    sweep = plan_clips(
        read_axes(["a=~normal(0,1)", "b=1:10:10"]), samples=10**6, seed=1
    )
    assert len(sweep) == 10**7
    assert sweep[10**7 - 1].name.startswith("09-999999,")
