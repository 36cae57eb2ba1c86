"""Windows over long clips: what they cover, that they change nothing a model says, and that no joint shows."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from physgen.refine.latents import blend_predictions, window_spans


@given(window=st.integers(1, 40), extra=st.integers(0, 400), overlap=st.integers(0, 40))
def test_all_is_covered_with_what_is_shared(
    window: int, extra: int, overlap: int
) -> None:
    total = window + extra
    found = window_spans(total, window, overlap)
    assert found[0][0] == 0
    assert found[-1][1] == total
    assert all(last - first == window for first, last in found) or len(found) == 1
    shared = min(overlap, window - 1)
    assert all(b - c >= shared and c > a for (a, b), (c, _) in pairwise(found))
    fewer = 1 if total <= window else -(-(total - shared) // (window - shared))
    assert len(found) == fewer  # no more than must be


@given(total=st.integers(1, 120), window=st.integers(1, 20), overlap=st.integers(0, 19))
def test_shares_sum_to_one_and_a_model_that_looks_at_cells_says_the_same(
    total, window, overlap
) -> None:
    windows = window_spans(total, window, overlap)
    z = (
        np.random.default_rng(total)
        .standard_normal((total, 2, 3, 1))
        .astype(np.float32)
    )
    ones = blend_predictions(lambda part, first: np.ones_like(part), z, windows)
    assert np.abs(ones - 1).max() < 1e-6
    linear = blend_predictions(lambda part, first: 3 * part - 1, z, windows)
    assert np.abs(linear - (3 * z - 1)).max() < 5e-6


@pytest.mark.parametrize(
    ("total", "window"),
    [(30, 16), (45, 16), (17, 16), (48, 16), (21, 13), (40, 14)],
)
def test_no_joint_shows_where_windows_disagree(total: int, window: int) -> None:
    """Windows that each see another brightness, drawn anew, and root mean squares over many draws of how much frames
    differ from those before. Where a window begins or ends that is about as much as inside of what windows share (a
    quarter more where three share), and everywhere less than 15 % of what a cut from one window to the next would be.
    """
    windows = window_spans(total, window, window // 2)
    rng = np.random.default_rng(1)
    z = np.zeros((total, 1, 1, 2000), np.float32)
    out = blend_predictions(
        lambda part, first: part + rng.standard_normal(2000, np.float32), z, windows
    )
    change = np.sqrt(np.mean(np.diff(out[:, 0, 0], axis=0) ** 2, axis=1))
    borders = {
        at - 1 for first, last in windows for at in (first, last) if 0 < at < total
    }
    inside = [change[k] for k in range(total - 1) if k not in borders]
    assert max(change[list(borders)]) <= 1.25 * max(inside)
    assert change.max() < 0.15 * np.sqrt(2)
