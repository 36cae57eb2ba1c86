"""People, animals and their parts, and toys shaped like animals."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import yaml
from numpy.typing import NDArray

from physgen.perceive.perceive import perceive
from physgen.perceive.roles import Detections, PromptedMask
from physgen.perceive.scene_files import write_scene
from physgen.perceive.segment import living
from physgen.perceive.segment.detector import DetectedBoxes
from physgen.perceive.segment.proposals import Proposal
from physgen.perceive.support.view_classifier import ViewChances

CLASSES = {"bear": 21, "person": 0, "cup": 41}
"""Numbers of COCO's classes."""
BOXES = {
    "dinosaur": ((20, 20, 80, 90), 0.27, 0.9, "bear"),
    "head": ((20, 20, 45, 45), 0.1, 0.4, "bear"),
    "child": ((90, 10, 150, 110), 0.05, 0.9, "person"),
    "cup": ((120, 60, 140, 80), 0.6, 0.1, "cup"),
}
"""Corners, scores of movable and immovable, and class of what the detector sees."""
RGB = np.full((120, 160, 3), 128, np.uint8)
SIZE = RGB.shape[:2]


def boxes_of(*names: str) -> DetectedBoxes:
    """Return some of BOXES."""
    corners = np.array([BOXES[name][0] for name in names], np.float64)
    scores = np.zeros((len(names), 82))
    for row, name in zip(scores, names, strict=True):
        _, movable, immovable, word = BOXES[name]
        row[:2] = movable, immovable
        row[2 + CLASSES[word]] = max(movable, immovable)
    return DetectedBoxes(corners, scores)


def rectangle(left: int, top: int, right: int, bottom: int) -> Proposal:
    mask = np.ones((bottom - top, right - left), bool)
    return Proposal(left, top, mask, mask.size)


def cut_box(rgb: NDArray[np.uint8], box: NDArray[np.float64]) -> PromptedMask:
    """Return the box itself as the mask."""
    mask = np.zeros(rgb.shape[:2], bool)
    left, top, right, bottom = np.rint(box).astype(int)
    mask[top:bottom, left:right] = True
    return PromptedMask(mask, 0.9)


def test_model_of_dinosaur_becomes_movable(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(living, "_is_model", lambda rgb, corners: True)
    released = living.release_models(RGB, boxes_of("dinosaur", "head", "child"))
    assert released.movable == pytest.approx([0.9, 0.4, 0.05])
    assert released.immovable == pytest.approx([0, 0, 0.9])
    assert released.scores[0, 2 + CLASSES["bear"]] == 0


def test_living_animal_stays_immovable(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(living, "_is_model", lambda rgb, corners: False)
    boxes = boxes_of("dinosaur", "child")
    assert living.release_models(RGB, boxes) is boxes


def test_empty_photo_has_no_model() -> None:
    boxes = DetectedBoxes(np.zeros((0, 4)), np.zeros((0, 82)))
    assert living.release_models(RGB, boxes) is boxes
    assert living.find_likely_toys(RGB, boxes, np.zeros(SIZE, np.uint16)) == []


@pytest.mark.parametrize(("unsuitable", "count"), [(0.05, 1), (0.9, 0)])
def test_likely_toy_is_doubtful_with_reason(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, unsuitable: float, count: int
) -> None:
    chances = ViewChances(0.9, 0.05, 0.05, unsuitable)
    monkeypatch.setattr(living, "view_chances", lambda features: chances)
    monkeypatch.setattr(living, "mask_in_box", cut_box)
    labels = np.zeros(SIZE, np.uint16)
    toys = living.find_likely_toys(RGB, boxes_of("dinosaur", "child"), labels)
    assert len(toys) == count
    found = Detections(labels, "learned", {}, {}, doubtful=toys)
    text = write_scene(perceive(RGB, found), None, "photo", tmp_path / "a.yaml")
    assert len(yaml.safe_load(text)["doubtful"]) == count
    assert text.count(living.LIVING.reason) == count


def test_hand_is_part_of_person(monkeypatch: pytest.MonkeyPatch) -> None:
    whole = rectangle(90, 10, 150, 110)
    monkeypatch.setattr(living, "rough_mask_in_box", lambda rgb, box, shape: whole)
    hand, held = rectangle(95, 60, 110, 75), rectangle(120, 60, 140, 80)
    boxes = boxes_of("child", "cup")
    is_part = living.parts_of_living(RGB, boxes, [hand, held], SIZE)
    assert is_part.tolist() == [True, False]


def test_object_beside_person_is_no_part(monkeypatch: pytest.MonkeyPatch) -> None:
    whole = rectangle(90, 10, 150, 110)
    monkeypatch.setattr(living, "rough_mask_in_box", lambda rgb, box, shape: whole)
    beside = [rectangle(10, 60, 40, 90)]
    is_part = living.parts_of_living(RGB, boxes_of("child"), beside, SIZE)
    assert is_part.tolist() == [False]
