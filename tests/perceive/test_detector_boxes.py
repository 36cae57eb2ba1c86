"""Boxes from the detector's outputs, against what is known by construction."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from physgen.perceive.segment import detector
from physgen.perceive.segment.detector import BINS, SIDE, STRIDES, detect_boxes

CELLS = [(-(-SIDE // stride)) ** 2 for stride in STRIDES]


class OneBox:
    """Outputs of a network that is sure of one box, which a cell of stride 32 sees."""

    def __init__(self, distances: tuple[int, int, int, int]) -> None:
        self.scores = np.zeros((sum(CELLS), 82))
        self.logits = np.zeros((sum(CELLS), 4 * BINS))
        row, column = 4, 6
        self.center = ((column + 0.5) * 32, (row + 0.5) * 32)
        cell = sum(CELLS[:2]) + row * 13 + column
        self.scores[cell, :3] = 0.9, 0.1, 0.7
        self.logits[cell].reshape(4, BINS)[np.arange(4), distances] = 50.0
        self.cell = cell

    def __call__(
        self, blob: NDArray[np.float32]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        assert blob.shape == (1, 3, SIDE, SIDE)
        return self.scores, self.logits


@pytest.mark.parametrize("size", [(208, 416), (832, 1664), (104, 52)])
def test_box_lies_where_its_cell_says(
    monkeypatch: pytest.MonkeyPatch, size: tuple[int, int]
) -> None:
    outputs = OneBox((2, 1, 3, 1))
    monkeypatch.setattr(detector, "run_levels", outputs)
    found = detect_boxes(np.zeros((*size, 3), np.uint8))
    x, y = outputs.center
    scale = max(size) / SIDE
    expected = np.array([x - 64, y - 32, x + 96, y + 32]) * scale
    expected = np.clip(expected, 0, (size[1], size[0], size[1], size[0]))
    assert found.corners[0] == pytest.approx(expected)
    assert (found.movable[0], found.immovable[0]) == (0.9, 0.1)


def test_doubles_of_box_are_suppressed(monkeypatch: pytest.MonkeyPatch) -> None:
    outputs = OneBox((2, 2, 2, 2))
    outputs.scores[outputs.cell + 1] = 0.8
    shifted = outputs.logits[outputs.cell + 1].reshape(4, BINS)
    shifted[np.arange(4), (3, 2, 1, 2)] = 50.0
    monkeypatch.setattr(detector, "run_levels", outputs)
    assert len(detect_boxes(np.zeros((416, 416, 3), np.uint8))) == 1


def test_photo_without_boxes_gives_none(monkeypatch: pytest.MonkeyPatch) -> None:
    outputs = OneBox((2, 2, 2, 2))
    outputs.scores[:] = 0
    monkeypatch.setattr(detector, "run_levels", outputs)
    assert len(detect_boxes(np.zeros((60, 80, 3), np.uint8))) == 0


def test_overlap_of_boxes_is_that_of_areas() -> None:
    first = np.array([[0.0, 0.0, 10.0, 10.0]])
    second = np.array([[0.0, 5.0, 10.0, 15.0], [20.0, 0.0, 30.0, 10.0]])
    assert detector.box_overlap(first, second)[0] == pytest.approx([1 / 3, 0.0])
