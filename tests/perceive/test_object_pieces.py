"""Pieces of one object that hang together become one object."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from test_prompts import crates

from physgen.perceive.roles import PromptedMask, Segments
from physgen.perceive.segment import pieces
from physgen.perceive.segment.detector import DetectedBoxes
from physgen.perceive.segment.prompts import Segmenter
from physgen.registry import Backends


def grey() -> np.ndarray:
    return np.full((200, 200, 3), 128, np.uint8)


def robot() -> Segments:
    """Return a head, a trunk and a foot above each other, and a ball beside them."""
    labels = np.zeros((200, 200), np.int32)
    # no blocks: each is a trapezium
    for name, rows, above, below in (
        (1, (20, 59), (60, 99), (40, 119)),
        (2, (63, 119), (25, 134), (60, 99)),
        (3, (123, 179), (60, 99), (35, 124)),
    ):
        (top, bottom), (a, b), (c, d) = rows, above, below
        corners = np.array([(a, top), (b, top), (d, bottom), (c, bottom)])
        cv2.fillPoly(labels, [corners], name)
    labels[150:180, 160:190] = 4
    return Segments(labels.astype(np.uint16), np.array([0.6, 0.7, 0.8, 0.9]))


def boxes(*corners: tuple[int, int, int, int]) -> DetectedBoxes:
    """Return boxes that are movable wholes for sure."""
    scores = np.zeros((len(corners), 82))
    scores[:, 0] = 0.95
    return DetectedBoxes(np.array(corners, np.float64).reshape(-1, 4), scores)


@pytest.fixture
def drawing(monkeypatch):
    """Let the network draw the middle of the robot, with the seams."""
    drawn = np.zeros((200, 200), bool)
    drawn[25:175, 60:100] = True
    labels = robot().labels
    drawn |= (labels > 0) & (labels < 4)
    asked = []

    def mask_in_box(rgb, box):
        asked.append(box)
        return PromptedMask(drawn, 0.8)

    monkeypatch.setattr(pieces, "mask_in_box", mask_in_box)
    return asked


def test_pieces_become_one_object(drawing):
    united = pieces.unite_pieces(grey(), robot(), boxes((160, 150, 190, 180)))
    assert drawing == [[25, 20, 135, 180]]
    assert np.unique(united.labels).tolist() == [0, 1, 2]
    robot_mask = united.labels == united.labels[90, 80]
    assert robot_mask[20:180, 60:100].all()
    assert united.confidence == pytest.approx([0.7, 0.9])


def test_objects_with_boxes_of_their_own_stay(drawing):
    own = [(40, 20, 120, 60), (25, 63, 135, 120), (160, 150, 190, 180)]
    one = robot()
    united = pieces.unite_pieces(grey(), one, boxes(*own))
    assert np.array_equal(united.labels, one.labels)
    assert not drawing


def test_pieces_stay_if_the_network_draws_one_of_them(monkeypatch):
    one = robot()
    head = PromptedMask(one.labels == 1, 0.9)
    monkeypatch.setattr(pieces, "mask_in_box", lambda rgb, box: head)
    united = pieces.unite_pieces(grey(), one, boxes((160, 150, 190, 180)))
    assert np.array_equal(united.labels, one.labels)


@pytest.mark.slow
def test_stacked_crates_stay_apart() -> None:
    rgb, _ = crates()
    backends = Backends()
    backends.begin()
    objects = Segmenter(backends, ())(rgb)
    assert len(np.unique(objects.labels)) >= 4
