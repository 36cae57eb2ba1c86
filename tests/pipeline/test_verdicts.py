"""Doubts about a photo from the outcome of its push."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from physgen.maps import Percepts
from physgen.materials import LIVING, is_living, nouns
from physgen.perceive.roles import PerceivedScene, Suitability
from physgen.pipeline.push_outcomes import Grade, Outcome
from physgen.pipeline.verdicts import (
    living_doubts,
    outcome_doubts,
    stillness_doubts,
    toy_note,
    with_doubts,
)

GOOD = Outcome(Grade.STORY, 1.0, 0.2, 0.5, ("box-1",), ())


def scene_of(label: str = "box", width: int = 20, busy: bool = False) -> PerceivedScene:
    """An object of `width` x 50 px in a photo of 100 x 100 px."""
    labels = np.zeros((100, 100), np.uint16)
    labels[25:75, 10 : 10 + width] = 1
    rgb = np.full((100, 100, 3), 128, np.uint8)
    if busy:
        rgb[:] = np.random.default_rng(0).integers(0, 255, rgb.shape, np.uint8)
    none = np.zeros(labels.shape, np.float32)
    percepts = Percepts(
        rgb=rgb, labels=labels, coverage=none, background=rgb, clean=None
    )
    document: dict[str, Any] = {
        "objects": {"box-1": {"label": label, "mask": 1}},
        "render": {"slow": 4},
    }
    return PerceivedScene(percepts, document, {}, suitability=Suitability())


def test_a_short_story_on_a_plain_ground_is_good() -> None:
    assert outcome_doubts(scene_of(), ["box-1"], GOOD) == []


@pytest.mark.parametrize(
    ("outcome", "count"),
    [
        (Outcome(Grade.NOTHING, 0.0, 0.01, 0.1, (), ()), 1),
        (Outcome(Grade.LEAVES, 1.0, 0.2, 0.1, ("box-1",), ("box-1",)), 1),
        (Outcome(Grade.LEAVES, 1.0, 0.2, 0.1, ("box-1",), ()), 1),
        (Outcome(Grade.RESTLESS, 1.0, 0.2, 4.0, ("box-1",), ()), 1),
        (Outcome(Grade.SHORT, 1.0, 0.2, 0.1, ("box-1",), ()), 1),
        (Outcome(Grade.SHORT, 1.0, 0.2, 0.2, ("box-1",), ()), 0),
    ],
)
def test_an_outcome_that_disappoints_is_a_doubt(outcome: Outcome, count: int) -> None:
    assert len(outcome_doubts(scene_of(), ["box-1"], outcome)) == count


@pytest.mark.parametrize(
    ("width", "busy", "percent"), [(20, False, ""), (20, True, "10 %"), (60, False, "")]
)
def test_a_fill_beside_fine_detail_is_a_doubt(
    width: int, busy: bool, percent: str
) -> None:
    doubts = outcome_doubts(scene_of(width=width, busy=busy), ["box-1"], GOOD)
    assert len(doubts) == bool(percent)
    assert percent in "".join(doubts)


@pytest.mark.parametrize(
    ("label", "is_named"),
    [("dog", True), ("man", True), ("toy dog", False), ("", False)],
)
def test_people_and_animals_are_named(label: str, is_named: bool) -> None:
    doubts = living_doubts(scene_of(label))
    assert len(doubts) == is_named
    assert all("box-1" in doubt for doubt in doubts)


@pytest.mark.parametrize("label", ["dog", "brown bear", "two sheep"])
def test_label_that_is_suggested_for_a_toy_is_no_animal(label: str) -> None:
    (doubt,) = living_doubts(scene_of(label))
    suggested = doubt.split('"')[1]
    assert not is_living(suggested)
    assert living_doubts(scene_of(suggested)) == []


def test_toys_of_all_living_things_are_toys() -> None:
    words = [word for row, names in nouns() if row.noun in LIVING for word in names]
    assert {word for word in words if is_living(f"toy {word}")} == set()
    assert all(map(is_living, words))


def test_doubts_are_added_once() -> None:
    scene = with_doubts(with_doubts(scene_of(), ["a"]), ["a", "b"])
    assert scene.suitability == Suitability(("a", "b"))


@pytest.mark.parametrize(
    ("label", "is_named"),
    [
        ("car", True),
        ("red bus", True),
        ("toy car", False),
        ("boat", False),
        ("", False),
    ],
)
def test_a_lone_car_is_taken_for_a_toy(label: str, is_named: bool) -> None:
    assert ("box-1" in toy_note(scene_of(label))) == is_named


@pytest.mark.parametrize("is_cut", [True, False])
def test_objects_at_the_border_are_named(is_cut: bool) -> None:
    scene = scene_of()
    if is_cut:
        scene.comments["objects.box-1.motion"] = "cut off by the photo's border"
    (reason,) = stillness_doubts(scene, ["box-1"])
    assert ("box-1" in reason) == is_cut
    assert stillness_doubts(scene, []) == []
