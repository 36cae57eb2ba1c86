"""Drawings of flat shapes: their truth, and the half that is held out."""

from __future__ import annotations

import sys
from collections import Counter
from itertools import islice
from pathlib import Path

import cv2
import numpy as np
import pytest

ROOT = Path(__file__).resolve().parents[2]
sys.path.append(str(ROOT / "studio/segmentation"))

from flat_shapes import (  # noqa: E402
    COUNT,
    KINDS,
    LEAST_CONTRAST,
    PUZZLE_OBJECTS,
    drawings,
)


@pytest.mark.slow
def test_half_of_each_kind_is_held_out() -> None:
    held_out = Counter(
        one.name.rsplit("-", 1)[0] for one in drawings() if one.is_held_out
    )
    assert held_out == dict.fromkeys(KINDS, COUNT // len(KINDS) // 2)


def test_drawings_are_the_same_each_time() -> None:
    for one, other in zip(islice(drawings(), 4), islice(drawings(), 4), strict=True):
        assert np.array_equal(one.rgb, other.rgb)
        assert np.array_equal(one.labels, other.labels)


def test_each_label_is_one_visible_shape() -> None:
    for one in islice(drawings(), 24):
        count = int(one.labels.max())
        if one.name.startswith("puzzle"):
            assert count == PUZZLE_OBJECTS
        for number in range(1, count + 1):
            mask = one.labels == number
            parts, _ = cv2.connectedComponents(mask.astype(np.uint8))
            assert parts == 2, one.name
            if not one.name.startswith(("puzzle", "noise")):
                step = one.rgb[mask].mean(axis=0) - one.rgb[one.labels == 0].mean(
                    axis=0
                )
                assert np.abs(step).max() > 0.2 * LEAST_CONTRAST, one.name
