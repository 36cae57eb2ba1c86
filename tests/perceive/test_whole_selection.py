"""Wholes in place of their parts, and separate objects that stay separate."""

from __future__ import annotations

import numpy as np
import pytest

from physgen.perceive.segment.detector import DetectedBoxes
from physgen.perceive.segment.proposals import Proposal
from physgen.perceive.segment.selection import unite_parts

CORNERS = {
    "car": (10, 10, 70, 50),
    "body": (10, 10, 70, 40),
    "wheel": (20, 40, 32, 50),
    "bag": (20, 10, 80, 50),
    "strap": (8, 20, 20, 40),
    "bag with strap": (8, 10, 80, 50),
}
"""Left, top, right, bottom; the car has a body and a wheel."""


def rectangle(name: str, gap: int = 0) -> Proposal:
    """Return a filled box of CORNERS, narrower by a gap on the right."""
    left, top, right, bottom = CORNERS[name]
    mask = np.ones((bottom - top, right - left - gap), bool)
    return Proposal(left, top, mask, mask.size)


def boxes_of(*some: tuple[str, float]) -> DetectedBoxes:
    """Return the boxes of names with scores of movable wholes."""
    scores = np.zeros((len(some), 82))
    scores[:, 0] = [score for _, score in some]
    corners = np.array([CORNERS[name] for name, _ in some], np.float64)
    return DetectedBoxes(corners.reshape(-1, 4), scores)


CANDIDATES = [rectangle(name) for name in ("car", "body", "wheel")]
PARTS = np.flatnonzero([False, True, True])


def test_part_without_box_joins_whole() -> None:
    fit = np.array([0.85, 0.9, 0.6])
    selection = unite_parts(CANDIDATES, PARTS, (fit, fit), boxes_of(("car", 0.8)))
    assert selection.indices.tolist() == [0]
    assert selection.parts == {0: [1, 2]}


@pytest.mark.parametrize(
    ("fit", "boxes"),
    [
        ([0.85, 0.9, 0.6], boxes_of(("car", 0.8), ("wheel", 0.7))),
        ([0.85, 0.9, 0.8], boxes_of(("car", 0.8))),
        ([0.85, 0.7, 0.9], boxes_of(("car", 0.8))),
        ([0.85, 0.9, 0.6], boxes_of(("car", 0.3))),
        ([0.85, 0.9, 0.6], boxes_of()),
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
    assert selection.indices.tolist() == [1, 2]
    assert selection.parts == {}


def test_part_joins_body_if_whole_is_worse() -> None:
    fit = np.array([0.5, 0.9, 0.6])
    selection = unite_parts(CANDIDATES, PARTS, (fit, fit), boxes_of(("car", 0.8)))
    assert selection.indices.tolist() == [1]
    assert selection.parts == {1: [2]}


def test_nothing_chosen_stays_so() -> None:
    none = np.zeros(0, np.intp)
    fits = np.zeros(3), np.zeros(3)
    selection = unite_parts(CANDIDATES, none, fits, boxes_of(("car", 0.8)))
    assert not len(selection.indices)


def chosen_of(fit: float, gap: int = 0) -> list[int]:
    """Return what is chosen of a bag and a strap of some fit, `gap` px apart."""
    candidates = [rectangle("bag"), rectangle("strap", gap)]
    fits = np.array([0.8, fit])
    both = np.arange(2)
    boxes = boxes_of(("bag with strap", 0.8))
    selection = unite_parts(candidates, both, (fits, fits), boxes)
    chosen: list[int] = selection.indices.tolist()
    rest = [k for k in both.tolist() if k not in chosen]
    assert selection.parts_of(selection.indices) == rest
    return chosen


def test_strap_that_completes_box_joins_bag() -> None:
    assert chosen_of(0.6) == [0]


def test_clear_or_distant_object_does_not_join() -> None:
    assert chosen_of(0.9) == [0, 1]
    assert chosen_of(0.6, gap=5) == [0, 1]
