"""Objects that are not pushed: someone is at them, they float, they are tiny."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from physgen.maps import Percepts
from physgen.perceive.roles import PerceivedScene, Suitability
from physgen.perceive.segment.detector import DetectedBoxes
from physgen.perceive.support.view_classifier import ViewChances
from physgen.pipeline import refusals
from physgen.pipeline.refusals import UNSUITABLE, find_refusals

CUP = (40, 50, 60, 80)
"""Left, top, right and bottom of the object, px."""


def scene_of(label: str = "cup", box: tuple[int, ...] = CUP) -> PerceivedScene:
    """An object that fills a box of a photo of 100 x 100 px."""
    labels = np.zeros((100, 100), np.uint16)
    left, top, right, bottom = box
    labels[top:bottom, left:right] = 1
    rgb = np.full((100, 100, 3), 128, np.uint8)
    none = np.zeros(labels.shape, np.float32)
    percepts = Percepts(
        rgb=rgb, labels=labels, coverage=none, background=rgb, clean=None
    )
    document: dict[str, Any] = {"objects": {"cup-1": {"label": label, "mask": 1}}}
    return PerceivedScene(percepts, document, {}, suitability=Suitability())


def set_evidence(
    monkeypatch: pytest.MonkeyPatch,
    unsuitable: float = 0.05,
    people: tuple[tuple[int, ...], ...] = (),
) -> None:
    """Let the networks see people in these boxes, and this chance of no loose things."""
    corners = np.array(people, np.float64).reshape(-1, 4)
    scores = np.zeros((len(people), 82))
    scores[:, 2 + refusals.PERSON] = 0.9
    boxes = DetectedBoxes(corners, scores)
    chances = ViewChances(1 - unsuitable, 0.0, 0.0, unsuitable)
    monkeypatch.setattr(refusals, "detect_boxes", lambda rgb: boxes)
    monkeypatch.setattr(refusals, "view_chances", lambda features: chances)


@pytest.mark.parametrize(
    ("person", "is_refused"),
    [
        ((20, 40, 90, 95), True),  # behind and in front of it
        ((58, 40, 99, 95), True),  # at it, in a photo that may show a scene with people
        ((85, 60, 87, 62), False),  # far away
    ],
)
def test_an_object_in_hands_is_refused(
    person: tuple[int, ...], is_refused: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    set_evidence(monkeypatch, 0.4, (person,))
    found = find_refusals(scene_of())
    assert ("cup-1" in found.objects) == is_refused
    assert len(found.reasons) == is_refused
    assert all("cup-1" in reason for reason in found.reasons)


@pytest.mark.parametrize(
    ("person", "is_refused"),
    [
        ((40, 35, 48, 45), False),  # the driver behind the windscreen
        ((32, 30, 60, 80), True),  # someone who stands before it
    ],
)
def test_a_driver_does_not_hold_a_vehicle(
    person: tuple[int, ...], is_refused: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    set_evidence(monkeypatch, 0.4, (person,))
    found = find_refusals(scene_of("bus", (10, 20, 90, 80)))
    assert ("cup-1" in found.objects) == is_refused


@pytest.mark.parametrize(
    ("person", "side"), [((58, 40, 99, 95), "right"), ((1, 40, 42, 95), "left")]
)
def test_an_object_beside_someone_is_pushed_away(
    person: tuple[int, ...], side: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    set_evidence(monkeypatch, people=(person,))
    found = find_refusals(scene_of())
    assert found.barred_sides == {"cup-1": side}
    assert found.reasons == []


@pytest.mark.parametrize(("chance", "is_refused"), [(0.7, True), (0.1, False)])
def test_a_boat_outdoors_floats(
    chance: float, is_refused: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    set_evidence(monkeypatch, chance)
    assert ("cup-1" in find_refusals(scene_of("boat")).objects) == is_refused
    assert not find_refusals(scene_of("cup")).objects


def test_a_tiny_object_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    set_evidence(monkeypatch)
    assert find_refusals(scene_of(box=(40, 50, 43, 53))).objects
    assert not find_refusals(scene_of(box=(40, 50, 44, 54))).objects


def test_a_photo_of_nothing_loose_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    set_evidence(monkeypatch, 0.95)
    found = find_refusals(scene_of())
    assert found.photo == UNSUITABLE
    assert found.reasons == [UNSUITABLE]
