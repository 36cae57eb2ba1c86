"""Outlines that go on behind other objects."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from physgen.geometry.fitting import fit_outlines
from physgen.geometry.polygon import Disc, mass_properties
from physgen.perceive.hidden_parts import continue_outlines
from physgen.perceive.roles import PhotoObject


def scene(back: str, label: str):
    """A thing (1) behind a disc (2), as a label map and objects; the thing's area."""
    labels = np.zeros((240, 320), np.uint16)
    if back == "circle":
        cv2.circle(labels, (130, 100), 60, 1, -1)
    elif back == "ellipse":
        cv2.ellipse(labels, (130, 100), (80, 50), 15, 0, 360, 1, -1)
    else:
        cv2.rectangle(labels, (60, 60), (260, 140), 1, -1)
    area = int((labels == 1).sum())
    cv2.circle(labels, (190, 165), 50, 2, -1)
    outlines = fit_outlines(labels, [1, 2])
    objects = [
        PhotoObject(1, outlines[1], label),
        PhotoObject(2, outlines[2], "apple"),
    ]
    return labels, objects, area


def test_a_hidden_apple_is_a_whole_circle():
    """To the engine it is a disc that ends where the other apple begins."""
    labels, objects, _ = scene("circle", "apple")
    after, wholes = continue_outlines(labels, objects)
    assert set(wholes) == {1}
    assert isinstance(wholes[1], Disc)
    assert wholes[1].center == pytest.approx([130, 100], abs=1.5)
    assert wholes[1].radius == pytest.approx(60, abs=1.5)
    assert isinstance(after[0].outline, Disc)
    front = after[1].outline
    assert isinstance(front, Disc)
    gap = np.hypot(*(front.center - after[0].outline.center))
    assert gap >= front.radius + after[0].outline.radius


@pytest.mark.parametrize("back", ["ellipse", "rectangle"])
def test_other_outlines_go_on_behind(back: str):
    labels, objects, area = scene(back, "object")
    after, wholes = continue_outlines(labels, objects)
    assert mass_properties(wholes[1]).area == pytest.approx(area, rel=0.04)
    assert mass_properties(objects[0].outline).area < 0.93 * area
    assert after[0].outline is objects[0].outline, "outlines do not overlap"


def test_nothing_is_added_where_nothing_is_hidden():
    labels = np.zeros((240, 320), np.uint16)
    cv2.circle(labels, (100, 100), 50, 1, -1)
    cv2.circle(labels, (240, 100), 50, 2, -1)
    outlines = fit_outlines(labels, [1, 2])
    objects = [PhotoObject(i, outlines[i], "apple") for i in (1, 2)]
    assert continue_outlines(labels, objects) == (objects, {})


def test_a_lumpy_fruit_keeps_the_circle_of_its_own_border():
    """Its disc was moved off its mask, to touch those of its neighbours."""
    labels = np.zeros((240, 320), np.uint16)
    cv2.ellipse(labels, (110, 120), (66, 60), 0, 0, 360, 1, -1)
    cv2.circle(labels, (228, 120), 50, 2, -1)
    pushed = PhotoObject(1, Disc(np.array([100.0, 104.0]), 62.0), "apple")
    neighbour = PhotoObject(2, Disc(np.array([228.0, 120.0]), 50.0), "apple")
    after, _ = continue_outlines(labels, [pushed, neighbour])
    disc = after[0].outline
    assert isinstance(disc, Disc)
    assert disc.center == pytest.approx([110, 120], abs=2)
    assert disc.radius == pytest.approx(62, abs=4)
    beside = PhotoObject(1, Disc(np.array([110.0, 120.0]), 62.0), "stone block")
    assert continue_outlines(labels, [beside, neighbour])[0][0] is beside
