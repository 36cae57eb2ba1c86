"""Stems, antennas and handles that a mask leaves out."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from physgen.perceive.remains import find_remains


def toy(thing: str):
    """A red box on a grey floor, with a thing beside it; its mask, and the thing's."""
    photo = np.full((300, 400, 3), 170, np.uint8)
    photo[220:] = 120
    if thing == "streak":
        # A plain background would show wide parts, too.
        photo[:120] = 60
    labels = np.zeros((300, 400), np.uint16)
    part = np.zeros((300, 400), np.uint8)
    if thing == "antenna":
        cv2.line(part, (200, 130), (212, 60), 1, 4)
    elif thing == "strap":
        cv2.polylines(
            part, [np.array([[160, 132], [150, 100], [175, 85]])], False, 1, 4
        )
    elif thing == "line behind":
        cv2.line(part, (0, 180), (399, 180), 1, 4)
    elif thing == "streak":
        cv2.line(part, (251, 214), (300, 213), 1, 4)
    elif thing == "apart":
        cv2.line(part, (300, 100), (300, 180), 1, 4)
    photo[part > 0] = (240, 220, 40)
    cv2.rectangle(photo, (150, 130), (250, 220), (190, 30, 30), -1)
    cv2.rectangle(labels, (150, 130), (250, 220), 1, -1)
    part[labels > 0] = 0
    return photo, labels, part > 0


@pytest.mark.parametrize("thing", ["antenna", "strap"])
def test_a_thin_part_belongs_to_its_object(thing: str):
    photo, labels, part = toy(thing)
    (remain,) = find_remains(photo, labels, [1])
    assert remain.owner == 1
    assert remain.is_confident
    common = (remain.mask & part).sum() / (remain.mask | part).sum()
    assert common > 0.8


@pytest.mark.parametrize("thing", ["line behind", "apart", "nothing"])
def test_lines_that_go_on_belong_to_no_object(thing: str):
    photo, labels, _ = toy(thing)
    assert find_remains(photo, labels, [1]) == []


def test_a_streak_beside_the_foot_is_reported_alone():
    """Objects that slide would collide with a streak on the tray."""
    photo, labels, part = toy("streak")
    remains = find_remains(photo, labels, [1])
    assert [remain for remain in remains if remain.is_confident] == []
    assert any((remain.mask & part).any() for remain in remains)


def test_a_faint_part_is_reported_alone():
    photo, labels, part = toy("antenna")
    photo[part] = (190, 190, 190)
    (remain,) = find_remains(photo, labels, [1])
    assert not remain.is_confident
    assert part[remain.place[1], remain.place[0]]


def test_a_wide_handle_on_a_plain_wall_belongs_to_its_bag():
    photo = np.full((300, 400, 3), 235, np.uint8)
    labels = np.zeros((300, 400), np.uint16)
    part = np.zeros((300, 400), np.uint8)
    cv2.ellipse(part, (200, 135), (34, 60), 0, 180, 360, 1, 16)
    photo[part > 0] = (30, 30, 40)
    cv2.rectangle(photo, (140, 130), (260, 230), (120, 120, 125), -1)
    cv2.rectangle(labels, (140, 130), (260, 230), 1, -1)
    part[labels > 0] = 0
    (remain,) = find_remains(photo, labels, [1])
    assert remain.is_confident
    assert (remain.mask & (part > 0)).sum() > 0.85 * (part > 0).sum()


def test_a_shadow_on_a_plain_floor_is_no_part():
    photo = np.full((300, 400), 235, np.float32)
    shadow = np.zeros((300, 400), np.float32)
    cv2.ellipse(shadow, (280, 225), (70, 14), 0, 0, 360, 90, -1)
    photo -= cv2.GaussianBlur(shadow, (0, 0), 7)
    picture = np.repeat(photo[..., None], 3, axis=2).astype(np.uint8)
    labels = np.zeros((300, 400), np.uint16)
    cv2.rectangle(picture, (140, 130), (260, 230), (120, 60, 60), -1)
    cv2.rectangle(labels, (140, 130), (260, 230), 1, -1)
    assert find_remains(picture, labels, [1]) == []


def test_texture_has_no_parts():
    """Among blades of grass none is a part."""
    photo, labels, _ = toy("antenna")
    random = np.random.default_rng(0)
    for _ in range(900):
        x, y = random.integers(0, 400), random.integers(0, 300)
        tip = (int(x + random.integers(-9, 9)), int(y - random.integers(10, 40)))
        shade = int(random.integers(40, 230))
        cv2.line(photo, (int(x), int(y)), tip, (shade // 2, shade, 30), 2)
    cv2.rectangle(photo, (150, 130), (250, 220), (190, 30, 30), -1)
    assert [one for one in find_remains(photo, labels, [1]) if one.is_confident] == []
