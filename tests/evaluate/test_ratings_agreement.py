"""Krippendorff's alpha against what its author computed by hand, and against another implementation."""

from __future__ import annotations

import krippendorff
import numpy as np
import pytest
from pytest import approx

from physgen.evaluate.ratings import agreement

AUTHORS = """\
1 2 3 3 2 1 4 1 2 . . .
1 2 3 3 2 2 4 1 2 5 . 3
. 3 3 3 2 3 4 2 2 5 1 .
1 2 3 3 2 4 4 1 2 5 1 .
"""
"""K. Krippendorff, Computing Krippendorff's Alpha-Reliability (2011), section D: four observers, twelve units."""


def table(text: str) -> np.ndarray:
    return np.array(
        [[0 if score == "." else int(score) for score in line.split()] for line in text.splitlines()]
    )


def test_as_its_author_computed_it() -> None:
    assert agreement(table(AUTHORS)).alpha == approx(0.815, abs=5e-4)


@pytest.mark.parametrize("seed", range(12))
def test_as_another_implementation_has_it(seed: int) -> None:
    random = np.random.default_rng(seed)
    truth = random.integers(1, 6, 20)
    scores = np.clip(truth + random.integers(-seed // 4 - 1, seed // 4 + 2, (2 + seed % 5, 20)), 1, 5)
    scores[random.random(scores.shape) < 0.05 * (seed % 6)] = 0
    theirs = krippendorff.alpha(
        np.where(scores == 0, np.nan, scores), level_of_measurement="ordinal", value_domain=[1, 2, 3, 4, 5]
    )
    assert agreement(scores).alpha == approx(theirs, abs=1e-12)


def test_who_says_the_same_agrees_wholly_and_who_throws_dice_not_at_all() -> None:
    random = np.random.default_rng(0)
    truth = random.integers(1, 6, 40)
    same = agreement(np.stack([truth] * 3))
    assert (same.alpha, same.low, same.high) == (1, 1, 1)
    dice = agreement(random.integers(1, 6, (4, 400)))
    assert dice.alpha == approx(0, abs=0.05)
    assert dice.low is not None
    assert dice.high is not None
    assert dice.low < 0 < dice.high


@pytest.mark.parametrize(
    "scores",
    [
        [[3, 4, 5]],  # one rater
        [[3, 3, 3], [3, 3, 3]],  # the same everywhere
        [[1, 2, 0], [0, 0, 3]],  # no clip twice
        [[0, 0], [0, 0]],
    ],
)
def test_where_it_has_no_meaning_it_has_no_value(scores: list[list[int]]) -> None:
    found = agreement(np.array(scores))
    assert (found.alpha, found.low, found.high) == (None, None, None)


def test_the_interval_narrows_with_clips() -> None:
    """A quarter as wide with sixteen times the clips."""
    random = np.random.default_rng(3)
    widths = []
    for clips in (50, 800):
        scores = np.clip(random.integers(1, 6, clips) + random.integers(-1, 2, (5, clips)), 1, 5)
        found = agreement(scores)
        assert found.low is not None
        assert found.high is not None
        assert found.alpha is not None
        assert found.low < found.alpha < found.high
        widths.append(found.high - found.low)
    assert widths[1] / widths[0] == approx(1 / 4, rel=0.35)
