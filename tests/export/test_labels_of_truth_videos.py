"""Masks and flow of clips that move as the studio's truth videos do, against what the path tracer sees in them."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
sys.path.append(str(ROOT / "benchmarks"))
from label_truth import compared  # noqa: E402

from physgen.evaluate.fidelity import TRUTH, truths  # noqa: E402

BALLS = ("billiards", "curling")


@pytest.mark.slow
@pytest.mark.parametrize("name", ["billiards", "curling", "shelf"])
def test_labels_are_what_a_path_tracer_sees(name: str, tmp_path: Path) -> None:
    """The bounds are those that docs/labels.md states."""
    (truth,) = truths(TRUTH, [name])
    row = compared(truth, tmp_path)
    assert row.differ < 0.002
    assert row.beyond_1 < (
        1e-5 if name in BALLS else 2.5e-4
    )  # of a box, the path tracer sees sides that the photo hid
    assert row.overlap > 0.98
    assert row.lands > 0.992  # a pixel that two balls share has flow of one of them
    assert row.grey < 2.6
    assert row.moved < 0.5 * row.unmoved  # highlights and shadows stay where they are
