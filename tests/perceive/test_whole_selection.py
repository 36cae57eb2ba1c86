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
        ([0.85, 0.7, 0.9], boxes_of((CAR, 0.8))),
        ([0.85, 0.9, 0.6], boxes_of((CAR, 0.3))),
        ([0.85, 0.9, 0.6], DetectedBoxes(np.zeros((0, 4)), np.zeros((0, 82)))),
    ],
    ids=[
        "own box",
        "clear parts",
        "clear wheel",
        "weak box",
        "no boxes",
    ],
)
def test_separate_objects_stay_separate(fit: list[float], boxes: DetectedBoxes) -> None:
    fits = np.array(fit), np.array(fit)
    selection = unite_parts(CANDIDATES, PARTS, fits, boxes)
    assert selection.chosen.tolist() == [1, 2]
    assert selection.parts == {}


def test_part_joins_body_if_whole_is_worse() -> None:
    fit = np.array([0.5, 0.9, 0.6])
    selection = unite_parts(CANDIDATES, PARTS, (fit, fit), boxes_of((CAR, 0.8)))
    assert selection.chosen.tolist() == [1]
    assert selection.parts == {1: [2]}


def test_nothing_chosen_stays_so() -> None:
    none = np.zeros(0, np.intp)
    fits = np.zeros(3), np.zeros(3)
    selection = unite_parts(CANDIDATES, none, fits, boxes_of((CAR, 0.8)))
    assert not len(selection.chosen)


BAG, STRAP = (20, 10, 80, 50), (8, 20, 20, 40)
BOX = (8, 10, 80, 50)
"""The box of a bag with a strap beside it."""


def chosen_of(fit: float, *, gap: int = 0) -> list[int]:
    """Return what is chosen of a bag and a strap of some fit, `gap` px apart."""
    left, top, right, bottom = STRAP
    strap = rectangle((left, top, right - gap, bottom))
    fits = np.array([0.8, fit])
    both = np.array([0, 1])
    selection = unite_parts(
        [rectangle(BAG), strap], both, (fits, fits), boxes_of((BOX, 0.8))
    )
    assert selection.parts_of(selection.chosen) == [1] * (2 - len(selection.chosen))
    return selection.chosen.tolist()


def test_strap_that_completes_box_joins_bag() -> None:
    assert chosen_of(0.6) == [0]


def test_clear_or_distant_object_does_not_join() -> None:
    assert chosen_of(0.9) == [0, 1]
    assert chosen_of(0.6, gap=5) == [0, 1]
