"""The judge's trees by hand, and the shipped file's shape."""

from __future__ import annotations

import numpy as np
import pytest

from physgen.perceive.segment.evidence import (
    CONTEXT_FEATURES,
    FEATURES,
    context_features,
)
from physgen.perceive.segment.judge import (
    Judge,
    confidence,
    shipped_judge,
    sum_trees,
)
from physgen.perceive.segment.proposals import Proposal

TWO_TREES = {
    # a stump on feature 1, then a tree that splits feature 0 and then feature 1
    "root": np.array([0, 3]),
    "feature": np.array([1, 0, 0, 0, 0, 1, 0, 0]),
    "threshold": np.array([0.5, 0, 0, 2.0, 0, 1.5, 0, 0]),
    "low": np.array([1, 1, 2, 4, 4, 6, 6, 7]),
    "high": np.array([2, 1, 2, 5, 4, 7, 6, 7]),
    "value": np.array([0, 0.1, 0.2, 0, -0.05, 0, 0.3, 0.9]),
    "depth": np.array(2),
    "base": np.array(0.25),
}


@pytest.mark.parametrize(
    ("features", "expected"),
    [((2.0, 0.5), 0.3), ((2.1, 0.6), 0.75), ((9.0, 1.6), 1.0)],
)
def test_trees_add_their_leaves(features: tuple[float, float], expected: float) -> None:
    fit = sum_trees(np.array([features]), TWO_TREES)
    assert fit == pytest.approx([expected])


def test_no_candidates_have_no_fit() -> None:
    assert sum_trees(np.zeros((0, 2)), TWO_TREES).shape == (0,)


def test_confidence_follows_counted_shares() -> None:
    shares = np.array([0.0, 0.5, 1.0]), np.array([0.0, 0.6, 0.9])
    stated = confidence(np.array([0.25, 0.75]), Judge({}, {}, *shares))
    assert stated == pytest.approx([0.3, 0.75])


def rectangle(x: int, y: int, width: int, height: int) -> Proposal:
    return Proposal(x, y, np.ones((height, width), np.bool_), width * height)


def test_context_counts_parts_of_pile() -> None:
    """Two blocks, both together, and a patch of one of them."""
    some = [
        rectangle(0, 0, 20, 20),
        rectangle(20, 0, 20, 20),
        rectangle(0, 0, 40, 20),
        rectangle(2, 2, 8, 8),
    ]
    context = context_features(some, np.array([0.9, 0.8, 0.6, 0.1]))
    number = dict(zip(CONTEXT_FEATURES, context.T, strict=True))
    assert number["number of parts"].tolist() == [0, 0, 2, 0]
    assert number["share in parts"][2] == pytest.approx(0.85)
    assert number["best candidate around"].tolist() == [0.6, 0.6, 0, 0.9]
    assert number["fitting others alike"][:2] == pytest.approx([0.8, 0.9])


def test_shipped_judge_reads_all_features() -> None:
    some = [rectangle(0, 0, 20, 20), rectangle(30, 0, 20, 20)]
    judge = shipped_judge()
    fit = judge.expected_fit(some, np.zeros((2, len(FEATURES))))
    assert ((fit >= 0) & (fit <= 1)).all()
    assert judge.expected_fit([], np.zeros((0, len(FEATURES)))).shape == (0,)
    sure = confidence(np.linspace(0, 1, 20))
    assert (np.diff(sure) >= 0).all()
    assert sure.max() < 1
