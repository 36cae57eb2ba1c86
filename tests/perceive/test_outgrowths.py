"""Parts of an object outside its mask belong to the hole; ground like it does not."""

from __future__ import annotations

import cv2
import numpy as np

from physgen.perceive.inpaint.outgrowths import (
    _Neighbourhood,
    attach_outgrowths,
    outgrowths,
)
from physgen.perceive.inpaint.poisson import with_rim


def toy_car() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return a photo, the mask without its left wheel, and that wheel."""
    rng = np.random.default_rng(3)
    rgb = np.clip(rng.normal((200, 130, 100), 4, (240, 320, 3)), 0, 255).astype(
        np.uint8
    )
    body, wheels = np.zeros((240, 320), np.uint8), np.zeros((240, 320), np.uint8)
    cv2.ellipse(body, (160, 120), (60, 50), 0, 0, 360, 1, -1)
    for x in (107, 213):
        cv2.ellipse(wheels, (x, 145), (12, 24), 0, 0, 360, 1, -1)
    rgb[wheels > 0] = (30, 30, 35)
    rgb[body > 0] = (180, 30, 30)
    left = (wheels > 0) & (body == 0)
    left[:, 160:] = False
    return rgb, ((body > 0) | (wheels > 0)) & ~left, left


def test_wheel_outside_the_mask_belongs_to_the_hole():
    rgb, mask, wheel = toy_car()
    parts = outgrowths(rgb, mask)
    assert (parts[wheel]).mean() > 0.9
    assert not (parts & ~wheel & ~mask).sum() > 0.2 * wheel.sum()
    assert with_rim(rgb, mask)[wheel].mean() > 0.95


def test_plain_ground_is_no_part():
    rgb, mask, wheel = toy_car()
    rgb[wheel] = (200, 130, 100)
    assert not outgrowths(rgb, mask).any()


def test_ground_like_the_object_is_no_part():
    """A board of the same colour goes on below the object to the photo's sides."""
    rgb, mask, _ = toy_car()
    rgb[165:200] = (180, 30, 30)
    assert outgrowths(rgb, mask)[170:, :60].mean() < 0.01


def test_wheel_with_a_clear_border_belongs_to_the_object():
    rgb, mask, wheel = toy_car()
    labels = mask.astype(np.uint16)
    attached = attach_outgrowths(rgb, labels) > 0
    assert attached[wheel].mean() > 0.9
    assert (attached & ~wheel & ~mask).sum() < 0.1 * wheel.sum()


def test_part_continues_while_its_colour_changes():
    """Three bands of a tyre differ by 29 levels each, the first from the last by 58."""
    photo = np.full((120, 100, 3), (200, 130, 100), np.uint8)
    body = np.zeros(photo.shape[:2], bool)
    body[10:60, 10:90] = True
    photo[body] = (180, 30, 30)
    bands = [np.s_[60 + 8 * k : 68 + 8 * k, 40:60] for k in range(3)]
    for level, band in zip((20, 49, 78), bands, strict=True):
        photo[band] = level
    away = cv2.distanceTransform((~body).view(np.uint8), cv2.DIST_L2, 5)
    first = np.zeros_like(body)
    first[bands[0]] = True
    parts = _Neighbourhood(photo, away, body, 30.0).parts(first)
    assert parts[60:84, 40:60].all()
    assert parts.sum() == 24 * 20


def test_soft_shadow_stays_ground():
    rgb, mask, wheel = toy_car()
    rgb[wheel] = (200, 130, 100)
    shade = np.zeros((240, 320), np.float32)
    cv2.ellipse(shade, (160, 175), (70, 12), 0, 0, 360, 1, -1)
    light = 1 - 0.8 * cv2.GaussianBlur(shade, (0, 0), 6)
    rgb[~mask] = (rgb[~mask] * light[~mask][:, None]).astype(np.uint8)
    labels = mask.astype(np.uint16)
    assert np.array_equal(attach_outgrowths(rgb, labels), labels)


def test_gap_between_boards_is_no_part():
    """A pale streak behind touches the object with its narrow end."""
    rgb, mask, _ = toy_car()
    cv2.line(rgb, (95, 130), (60, 165), (180, 30, 30), 5)
    labels = mask.astype(np.uint16)
    assert not (attach_outgrowths(rgb, labels) > 0)[150:, :80].any()
