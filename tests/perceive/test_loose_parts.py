"""Parts that move with their objects: handles in the air, contents of bowls, tails."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from physgen.perceive.contents import attach_contents
from physgen.perceive.hanging_parts import attach_hanging_parts
from physgen.perceive.remains import find_remains
from physgen.perceive.roles import Detections


def pot(handle: str):
    """A pot, 1, on the ground, and another object, 2."""
    labels = np.zeros((300, 400), np.uint16)
    cv2.rectangle(labels, (100, 150), (220, 260), 1, -1)
    if handle == "beside":
        cv2.rectangle(labels, (221, 165), (290, 180), 2, -1)
    elif handle == "on top":
        cv2.rectangle(labels, (140, 120), (180, 149), 2, -1)
    elif handle == "on the ground":
        cv2.rectangle(labels, (221, 240), (260, 260), 2, -1)
    elif handle == "apart":
        cv2.rectangle(labels, (250, 165), (320, 180), 2, -1)
    return labels


def test_a_handle_in_the_air_belongs_to_its_pot():
    labels = pot("beside")
    attached = attach_hanging_parts(labels, {1: 0.9, 2: 0.5})
    assert np.array_equal(attached > 0, labels > 0)
    assert set(np.unique(attached)) == {0, 1}


@pytest.mark.parametrize("handle", ["on top", "on the ground", "apart"])
def test_what_is_carried_or_apart_stays(handle: str):
    labels = pot(handle)
    assert np.array_equal(attach_hanging_parts(labels, {1: 0.9, 2: 0.5}), labels)


def test_a_sure_object_is_not_a_part():
    labels = pot("beside")
    assert np.array_equal(attach_hanging_parts(labels, {1: 0.9, 2: 0.8}), labels)


def bowl_with_fruit():
    """A bowl's wall, 1, seen from above at an angle, and fruit in it, 2 and 3."""
    labels = np.zeros((300, 400), np.uint16)
    cv2.ellipse(labels, (200, 150), (120, 110), 0, 0, 180, 1, -1)
    cv2.ellipse(labels, (200, 150), (120, 40), 0, 0, 360, 1, 6)
    cv2.ellipse(labels, (200, 150), (110, 80), 0, 0, 180, 0, -1)
    cv2.circle(labels, (150, 178), 46, 2, -1)
    cv2.circle(labels, (250, 178), 46, 3, -1)
    return labels


def test_fruit_moves_with_its_bowl():
    labels = bowl_with_fruit()
    found = Detections(labels, "learned", {1: 0.5, 2: 0.9, 3: 0.8}, {})
    attached = attach_contents(found)
    assert set(np.unique(attached.labels)) == {0, 1}
    assert (attached.labels[labels > 0] == 1).all()
    assert attached.labels[178, 200] == 1  # between the fruit
    assert attached.confidence[1] == 0.9


def test_fruit_beside_each_other_stays_apart():
    labels = np.zeros((300, 400), np.uint16)
    cv2.circle(labels, (140, 150), 60, 1, -1)
    cv2.circle(labels, (262, 170), 60, 2, -1)
    found = Detections(labels, "learned", {1: 0.9, 2: 0.9}, {})
    assert np.array_equal(attach_contents(found).labels, labels)


def test_a_tail_out_of_focus_belongs_to_its_toy_but_not_the_shadow():
    photo = np.full((300, 400, 3), 150.0)
    photo += np.linspace(-20, 20, 300)[:, None, None]  # a ground in uneven light
    shadow = np.zeros((300, 400), np.float32)
    cv2.ellipse(shadow, (200, 232), (90, 12), 0, 0, 360, 50, -1)
    photo -= cv2.GaussianBlur(shadow, (0, 0), 6)[..., None]
    toy, tail = (np.zeros((300, 400), np.uint8) for _ in range(2))
    cv2.rectangle(toy, (130, 130), (250, 230), 1, -1)
    cv2.fillConvexPoly(tail, np.array([[245, 150], [310, 170], [245, 195]]), 1)
    soft = cv2.GaussianBlur((toy | tail).astype(np.float32), (0, 0), 2.0)[..., None]
    photo = (soft * np.array([25, 25, 30]) + (1 - soft) * photo).astype(np.uint8)
    labels = toy.astype(np.uint16)
    sure = [one for one in find_remains(photo, labels, [1]) if one.is_confident]
    part = np.any([one.mask for one in sure], axis=0)
    expected = (tail > 0) & (labels == 0)
    assert (part & expected).sum() / expected.sum() > 0.6
    assert not part[238:].any()
