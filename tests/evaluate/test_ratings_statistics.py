"""Means, intervals and comparisons of a study against scipy, closed forms and simulated studies of known truth."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.stats
from pytest import approx

from physgen.evaluate.ratings import Draws, holm, means, pairs, sign_flip

# ---- intervals -------------------------------------------------------------------------------------------------------


def test_with_one_rater_it_is_the_plain_bootstrap_over_videos() -> None:
    scores = np.random.default_rng(1).integers(1, 6, (1, 2, 15))
    theirs = [
        scipy.stats.bootstrap(
            (scores[0, m],), np.mean, n_resamples=20000, method="percentile", random_state=0
        )
        for m in range(2)
    ]
    for ours, other in zip(means(scores, Draws(1, 15)), theirs, strict=True):
        assert (ours.low, ours.high) == approx(tuple(other.confidence_interval), abs=0.07)


def test_it_is_as_wide_as_the_variances_of_raters_and_videos_say() -> None:
    """Of additive scores, the draws' variance is the sum of both plain ones (Owen 2007, theorem 3)."""
    random = np.random.default_rng(2)
    raters, videos = random.integers(0, 2, 12), random.integers(1, 4, 20)
    scores = (raters[:, None, None] + videos[None, None, :]).astype(np.int64)
    draws = Draws(12, 20)
    drawn = draws.sums(scores.astype(float)) / draws.sums(np.ones(scores.shape))
    assert drawn.var() == approx(raters.var() / 12 + videos.var() / 20, rel=0.06)


def test_it_holds_the_truth_as_often_as_it_says() -> None:
    """Raters and videos drawn from what they would be: 95 % or more of the intervals hold the mean of all."""
    random, held, studies = np.random.default_rng(5), 0, 120
    draws = Draws(14, 15)
    for _ in range(studies):
        raw = (
            3
            + random.normal(0, 0.5, (14, 1, 1))
            + random.normal(0, 0.5, (1, 1, 15))
            + random.normal(0, 0.6, (14, 1, 15))
        )
        found = means(np.clip(np.round(raw), 1, 5).astype(np.int64), draws)[0]
        assert found.low is not None
        assert found.high is not None
        held += found.low <= 3 <= found.high
    assert held / studies >= 0.90


def test_answers_that_are_missing_count_nowhere() -> None:
    scores = np.array([[[5, 0, 3]], [[0, 0, 4]]])
    found = means(scores, Draws(2, 3))[0]
    assert found.mean == 4
    assert found.low is not None
    assert found.high is not None
    assert 3 <= found.low <= found.high <= 5


def test_nothing_known_is_none_and_one_answer_has_no_interval() -> None:
    silent = means(np.zeros((2, 1, 3), np.int64), Draws(2, 3))[0]
    assert (silent.mean, silent.low, silent.high) == (None, None, None)
    alone = means(np.full((1, 1, 1), 4), Draws(1, 1))[0]
    assert (alone.mean, alone.low, alone.high) == (4, None, None)


# ---- pairs -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("seed", range(4))
def test_the_exact_test_is_scipys(seed: int) -> None:
    values = np.random.default_rng(seed).normal(0.2 * seed, 1, 9)
    theirs = scipy.stats.permutation_test((values,), np.mean, permutation_type="samples", n_resamples=np.inf)
    assert sign_flip(values) == approx(theirs.pvalue, abs=1e-12)


@pytest.mark.parametrize("seed", range(4))
def test_of_signed_ranks_it_is_wilcoxons(seed: int) -> None:
    values = np.random.default_rng(10 + seed).normal(0.15 * seed, 1, 12)
    ranks = np.sign(values) * scipy.stats.rankdata(np.abs(values))
    assert sign_flip(ranks) == approx(scipy.stats.wilcoxon(values, method="exact").pvalue, abs=1e-12)


def test_many_differences_are_drawn_and_come_near_the_normal_law() -> None:
    values = np.random.default_rng(7).normal(0.25, 1, 60)
    z = values.sum() / np.sqrt((values**2).sum())
    assert sign_flip(values) == approx(2 * scipy.stats.norm.sf(abs(z)), rel=0.1)
    assert sign_flip(values) == sign_flip(values)


def test_no_difference_is_no_finding() -> None:
    assert sign_flip(np.zeros(8)) == 1
    assert sign_flip(np.array([0.5])) == 1
    assert sign_flip(np.array([])) == 1


def test_holm_on_a_worked_example() -> None:
    """Of p 0.01, 0.04, 0.03, 0.005 (Wikipedia, Holm–Bonferroni method): 0.03, 0.06, 0.06, 0.02."""
    assert holm([0.01, 0.04, 0.03, 0.005]) == approx([0.03, 0.06, 0.06, 0.02])


def test_false_alarms_stay_rare_where_people_differ() -> None:
    """Methods that are alike to all people together, though each has his own taste: one test alone is fooled."""
    random, studies = np.random.default_rng(11), 300
    draws, alarms, fooled = Draws(12, 12), 0, 0
    for _ in range(studies):
        taste, luck = random.normal(0, 0.5, (12, 2, 1)), random.normal(0, 0.1, (1, 2, 12))
        raw = 3 + taste + luck + random.normal(0, 0.7, (12, 2, 12))
        found = pairs(np.clip(np.round(raw), 1, 5).astype(np.int64), draws)[0]
        assert found.p is not None
        assert found.by_videos is not None
        alarms += found.p < 0.05
        fooled += found.by_videos < 0.05
    assert alarms / studies <= 0.09  # 0.05, and what 300 studies may be off by
    assert fooled / studies >= 0.2


def test_a_clear_difference_is_found_and_turning_it_round_turns_all() -> None:
    random = np.random.default_rng(12)
    scores = np.stack([random.integers(3, 6, (10, 10)), random.integers(1, 4, (10, 10))], axis=1)
    one, other = pairs(scores, Draws(10, 10))[0], pairs(scores[:, ::-1], Draws(10, 10))[0]
    assert one.p == other.p == approx(2 / 2**10)
    assert one.apart.mean == approx(-other.apart.mean)
    assert (one.better, one.even, one.worse) == (other.worse, other.even, other.better)
    assert one.apart.low is not None
    assert one.apart.low > 1


def test_only_who_scored_both_counts() -> None:
    scores = np.array([[[5, 5], [3, 0]], [[0, 4], [1, 4]]])
    found = pairs(scores, Draws(2, 2))[0]
    assert (found.better, found.even, found.worse) == (1, 1, 0)
    assert found.apart.mean == 1
    nobody = pairs(np.array([[[5, 0], [0, 3]]]), Draws(1, 2))[0]
    assert (nobody.p, nobody.adjusted, nobody.apart.mean) == (None, None, None)
