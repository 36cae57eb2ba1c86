"""Wheels and fronts of vehicles, found in drawings of them."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from physgen.geometry.fitting import fit_outlines
from physgen.perceive.roles import Name, PhotoObject, Wall
from physgen.perceive.wheels import find_vehicles, find_wheels, guess_facing, may_drive
from physgen.scene.scene import Facing


def drawn_car(flip: bool = False):
    """A hatchback that looks to the left, and its mask."""
    photo = np.full((240, 420, 3), 205, np.uint8)
    mask = np.zeros((240, 420), np.uint8)
    body = np.array(
        [[60, 180], [60, 130], [140, 120], [180, 70], [330, 70], [360, 130], [360, 180]]
    )
    for picture, colour in ((photo, (40, 60, 170)), (mask, 1)):
        cv2.fillPoly(picture, [body], colour, cv2.LINE_AA)
    window = np.array([[165, 115], [190, 80], [310, 80], [335, 115]])
    cv2.fillPoly(photo, [window], (90, 110, 120), cv2.LINE_AA)
    for x in (120, 300):
        cv2.circle(photo, (x, 180), 34, (15, 15, 15), -1, cv2.LINE_AA)
        cv2.circle(photo, (x, 180), 21, (170, 170, 175), -1, cv2.LINE_AA)
        cv2.circle(photo, (x, 180), 8, (60, 60, 60), -1, cv2.LINE_AA)
        cv2.circle(mask, (x, 180), 34, 1, -1)
    step = -1 if flip else 1
    return photo[:, ::step].copy(), mask[:, ::step].copy() > 0


@pytest.mark.parametrize("flip", [False, True])
def test_wheels_of_a_car_are_its_circles(flip: bool):
    photo, mask = drawn_car(flip)
    wheels, confidence = find_wheels(photo, mask)
    expected = (119, 299) if flip else (120, 300)
    assert confidence > 0.8
    assert [w.center[0] for w in wheels] == pytest.approx(expected, abs=3)
    assert [w.center[1] for w in wheels] == pytest.approx([180, 180], abs=3)
    assert [w.radius for w in wheels] == pytest.approx([34, 34], abs=3)


@pytest.mark.parametrize("flip", [False, True])
def test_a_car_faces_away_from_its_cabin(flip: bool):
    photo, mask = drawn_car(flip)
    wheels, _ = find_wheels(photo, mask)
    assert guess_facing(mask, wheels) is (Facing.RIGHT if flip else Facing.LEFT)


def test_a_box_has_no_wheels():
    photo, mask = drawn_car()
    mask[:] = False
    mask[60:180, 60:360] = True
    photo[mask] = (150, 110, 70)
    photo[100:105, 60:360] = (90, 60, 30)
    assert find_wheels(photo, mask) == ((), 0.0)


def test_only_vehicles_are_searched():
    photo, mask = drawn_car()
    labels = mask.astype(np.uint16)
    outline = fit_outlines(labels, [1])[1]
    found = {}
    for label in ("car", "teapot"):
        item = PhotoObject(1, outline, label)
        found[label] = find_vehicles(photo, labels, [item], {}, [])
    assert set(found["car"]) == {1}
    assert found["teapot"] == {}


def test_likely_vehicles_may_drive():
    likely = (("car", 0.62), ("bus", 0.14))
    assert may_drive("object", Name("object", 0.2, likely))
    assert not may_drive("object", Name("object", 0.2, (("person", 0.6),)))
    assert not may_drive("teapot", Name("teapot", 0.7, likely))


def test_wheels_stand_on_the_ground_that_is_near():
    photo, mask = drawn_car()
    labels = mask.astype(np.uint16)
    item = PhotoObject(1, fit_outlines(labels, [1])[1], "car")
    floor = Wall("floor", ((-500, 218), (900, 218)), 0.5, 0.3, 1, "given", "")
    vehicle = find_vehicles(photo, labels, [item], {}, [floor])[1]
    for wheel in vehicle.wheels:
        assert wheel.center[1] + wheel.radius == pytest.approx(218, abs=0.02)
