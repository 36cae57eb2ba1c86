"""Wholes in place of their parts, and separate objects that stay separate."""

from __future__ import annotations

import numpy as np
import pytest

from physgen.perceive.segment.detector import DetectedBoxes
from physgen.perceive.segment.proposals import Proposal
from physgen.perceive.segment.selection import unite_parts

CAR, BODY, WHEEL = (10, 10, 70, 50), (10, 10, 70, 40), (20, 40, 32, 50)
"""Left, top, right, bottom: the car has a body and a wheel."""


def rectangle(box: tuple[int, int, int, int]) -> Proposal:
    left, top, right, bottom = box
    mask = np.ones((bottom - top, right - left), bool)
    return Proposal(left, top, mask, mask.size)


def boxes_of(*some: tuple[tuple[int, int, int, int], float]) -> DetectedBoxes:
    scores = np.zeros((len(some), 82))
    scores[:, 0] = [score for _, score in some]
    return DetectedBoxes(np.array([box for box, _ in some], np.float64), scores)


CANDIDATES = [rectangle(box) for box in (CAR, BODY, WHEEL)]
PARTS = np.array([1, 2])


def test_part_without_box_joins_whole() -> None:
    fit = np.array([0.85, 0.9, 0.6])
    selection = unite_parts(CANDIDATES, PARTS, (fit, fit), boxes_of((CAR, 0.8)))
    assert selection.chosen.tolist() == [0]
    assert selection.parts == {0: [1, 2]}


@pytest.mark.parametrize(
    ("fit", "boxes"),
    [
        ([0.85, 0.9, 0.6], boxes_of((CAR, 0.8), (WHEEL, 0.7))),
        ([0.85, 0.9, 0.8], boxes_of((CAR, 0.8))),
        ([0.5, 0.9, 0.6], boxes_of((CAR, 0.8))),
        ([0.85, 0.9, 0.6], boxes_of((CAR, 0.3))),
        ([0.85, 0.9, 0.6], DetectedBoxes(np.zeros((0, 4)), np.zeros((0, 82)))),
    ],
    ids=["own box", "clear fit", "worse whole", "weak box", "no boxes"],
)
def test_separate_objects_stay_separate(fit: list[float], boxes: DetectedBoxes) -> None:
    fits = np.array(fit), np.array(fit)
    selection = unite_parts(CANDIDATES, PARTS, fits, boxes)
    assert selection.chosen.tolist() == [1, 2]
    assert selection.parts == {}


def test_nothing_chosen_stays_so() -> None:
    none = np.zeros(0, np.intp)
    fits = np.zeros(3), np.zeros(3)
    selection = unite_parts(CANDIDATES, none, fits, boxes_of((CAR, 0.8)))
    assert not len(selection.chosen)
