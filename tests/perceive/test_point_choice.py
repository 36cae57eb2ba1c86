"""What a point means: the candidate that fits best there, or the smallest one."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
import yaml
from numpy.typing import NDArray

from physgen.cli.main import main
from physgen.perceive.roles import PromptedMask
from physgen.perceive.segment import point_choice, prompts
from physgen.perceive.segment.candidates import Candidates
from physgen.perceive.segment.detector import DetectedBoxes
from physgen.perceive.segment.judge import JudgedCandidates
from physgen.perceive.segment.proposals import Proposal

SIZE = (80, 120)  # of the photo; candidates lie on a grid half as fine
MUG, LABEL, PILE = (10, 10, 20, 25), (14, 14, 8, 8), (5, 5, 45, 32)
"""x, y, width, height on the grid."""
FITS = {MUG: 0.9, LABEL: 0.4, PILE: 0.6}


def judged(rgb: NDArray[np.uint8]) -> JudgedCandidates:
    """Return a mug with a label on it, in a pile."""
    some = [Proposal(x, y, np.ones((h, w), bool), w * h) for x, y, w, h in FITS]
    count = len(some)
    found = Candidates((40, 60), some, np.zeros((count, 1)), np.zeros(count))
    boxes = DetectedBoxes(np.zeros((0, 4)), np.zeros((0, 82)))
    return JudgedCandidates(found, np.array(list(FITS.values())), boxes)


def whole_box(rgb: NDArray[np.uint8], box: NDArray[np.float64]) -> PromptedMask:
    """Return the box itself as the mask."""
    mask = np.zeros(rgb.shape[:2], bool)
    left, top, right, bottom = np.rint(box).astype(int)
    mask[top:bottom, left:right] = True
    return PromptedMask(mask, 0.9)


@pytest.fixture
def photo(monkeypatch: pytest.MonkeyPatch) -> NDArray[np.uint8]:
    monkeypatch.setattr(point_choice, "judge_photo", judged)
    monkeypatch.setattr(point_choice, "mask_in_box", whole_box)
    monkeypatch.setattr(prompts, "_looks_around", lambda *_: ([], False))
    return np.full((*SIZE, 3), 128, np.uint8)


def box_found(mask: NDArray[np.bool_]) -> tuple[int, int, int, int]:
    x, y, width, height = cv2.boundingRect(mask.astype(np.uint8))
    return x // 2, y // 2, width // 2, height // 2


@pytest.mark.parametrize(
    ("point", "smallest", "expected"),
    [
        ((36, 36), False, MUG),
        ((36, 36), True, LABEL),
        ((24, 66), True, MUG),
        ((90, 60), False, PILE),
        ((90, 60), True, PILE),
    ],
)
def test_point_means_best_or_smallest_candidate(
    photo: NDArray[np.uint8],
    point: tuple[float, float],
    smallest: bool,
    expected: tuple[int, int, int, int],
) -> None:
    found = prompts.segment_point(photo, point, None, smallest=smallest)
    assert box_found(found.mask) == expected


def test_candidate_of_another_point_is_not_meant(photo: NDArray[np.uint8]) -> None:
    points = [(36.0, 36.0), (24.0, 66.0)]
    found = prompts.segment_point(photo, points[0], None, points)
    assert box_found(found.mask) == LABEL


def test_box_that_no_candidate_shows_may_be_meant(
    photo: NDArray[np.uint8], monkeypatch: pytest.MonkeyPatch
) -> None:
    """The detector sees a jug around the mug, which the judge rates above it."""
    jug = (6, 8, 28, 28)
    x, y, width, height = jug
    corners = 2.0 * np.array([[x, y, x + width, y + height]])
    boxes = DetectedBoxes(corners, np.zeros((1, 82)))
    with_box = replace(judged(photo), boxes=boxes)
    cut_out = Proposal(x, y, np.ones((height, width), bool), width * height)
    monkeypatch.setattr(point_choice, "judge_photo", lambda rgb: with_box)
    monkeypatch.setattr(point_choice, "rough_mask_in_box", lambda *_: cut_out)
    for fit, expected in ((0.99, jug), (0.1, MUG)):
        fits = np.array([fit])
        monkeypatch.setattr(
            point_choice,
            "judge_others",
            lambda rgb, judged, others, fits=fits: fits[: len(others)],
        )
        found = prompts.segment_point(photo, (40, 44), None)
        assert box_found(found.mask) == expected


def test_click_may_mean_what_is_seen_around_it(
    photo: NDArray[np.uint8], monkeypatch: pytest.MonkeyPatch
) -> None:
    """The judge knows no object in the pile; what is seen around the click fits better."""
    doubtful = replace(judged(photo), fit=np.array([0.1, 0.06, 0.2]))
    jug = PromptedMask(np.zeros(SIZE, bool), 0.9)
    jug.mask[20:60, 20:70] = True
    monkeypatch.setattr(point_choice, "judge_photo", lambda rgb: doubtful)
    monkeypatch.setattr(prompts, "_looks_around", lambda *_: ([(jug, 0.8)], False))
    for fit, expected in ((0.4, (10, 10, 25, 20)), (0.05, PILE)):
        fits = np.array([fit])
        monkeypatch.setattr(
            point_choice,
            "judge_others",
            lambda rgb, judged, others, fits=fits: fits[: len(others)],
        )
        found = prompts.segment_point(photo, (36, 36), None)
        assert box_found(found.mask) == expected


@pytest.mark.parametrize(("point", "is_lid"), [((40, 32), True), ((52, 40), False)])
def test_click_means_what_it_lies_deep_in(
    photo: NDArray[np.uint8],
    monkeypatch: pytest.MonkeyPatch,
    point: tuple[float, float],
    is_lid: bool,
) -> None:
    """The judge rates a box as it rates the lid before it."""
    box, lid = (10, 8, 40, 26), (12, 10, 16, 12)
    some = [Proposal(x, y, np.ones((h, w), bool), w * h) for x, y, w, h in (box, lid)]
    found = Candidates((40, 60), some, np.zeros((2, 1)), np.zeros(2))
    alike = replace(judged(photo), candidates=found, fit=np.array([0.8, 0.8]))
    monkeypatch.setattr(point_choice, "judge_photo", lambda rgb: alike)
    meant = prompts.segment_point(photo, point, None)
    assert box_found(meant.mask) == (lid if is_lid else box)


def test_smallest_without_point_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    photo = tmp_path / "photo.png"
    cv2.imwrite(str(photo), np.full((*SIZE, 3), 128, np.uint8))
    assert main(["perceive", str(photo), "--smallest"]) == 2
    assert "--smallest" in capsys.readouterr().err


@pytest.mark.slow
def test_scene_keeps_box_of_smallest(photo: NDArray[np.uint8], tmp_path: Path) -> None:
    photo[28:44, 28:44] = (200, 60, 40)
    path, scene = tmp_path / "photo.png", tmp_path / "scene.yaml"
    cv2.imwrite(str(path), photo)
    flags = ["--point", "36,36", "--smallest", "-o", str(scene)]
    assert main(["perceive", str(path), *flags]) == 0
    (item,) = yaml.safe_load(scene.read_text())["objects"].values()
    assert item["prompt"] == {"box": [28, 28, 16, 16]}
