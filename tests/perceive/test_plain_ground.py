"""Objects before one plain colour: gaps, corners, borders and the shade below."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from physgen.perceive.photo_objects import fit_objects
from physgen.perceive.roles import Detections, Segments
from physgen.perceive.segment.plain_ground import (
    cut_out_on_plain,
    plain_colour,
    shade_below,
    shows_ground_beyond,
)


def bag() -> tuple[np.ndarray, np.ndarray]:
    """Return a photo of a dark bag with a ring for a handle, and its true mask."""
    rgb = np.full((240, 320, 3), 255, np.uint8)
    truth = np.zeros((240, 320), np.uint8)
    cv2.rectangle(truth, (60, 110), (260, 210), 1, -1)
    cv2.ellipse(truth, (160, 110), (60, 90), 0, 180, 360, 1, 12)
    rgb[truth > 0] = (70, 60, 60)
    return rgb, truth > 0


def detected(mask: np.ndarray) -> Segments:
    return Segments(mask.astype(np.uint16), np.array([0.8]))


def test_gap_below_a_handle_is_no_object():
    rgb, truth = bag()
    rough = truth.copy()
    cv2.ellipse(rough.view(np.uint8), (160, 110), (60, 90), 0, 180, 360, 1, -1)
    rough[180:, 200:] = False  # a corner that the network missed
    labels = cut_out_on_plain(rgb, detected(rough)).labels
    assert np.count_nonzero((labels > 0) != truth) < 0.01 * truth.sum()


def test_white_letters_stay_on_their_object():
    rgb, truth = bag()
    cv2.putText(rgb, "ABC", (90, 170), cv2.FONT_HERSHEY_SIMPLEX, 1, (255, 255, 255), 3)
    labels = cut_out_on_plain(rgb, detected(truth)).labels
    assert (labels[truth] > 0).mean() > 0.995


def test_pale_object_stays_whole():
    rows, columns = np.mgrid[:240, :320]
    away = np.hypot(columns - 160, rows - 120)
    shade = np.clip(255 - np.maximum(away - 30, 0), 0, 255)  # white in the middle
    rgb = np.full((240, 320, 3), 255, np.uint8)
    rgb[away <= 80] = shade[away <= 80].astype(np.uint8)[:, None]
    labels = cut_out_on_plain(rgb, detected(away <= 80)).labels
    assert (labels[away <= 80] > 0).all()


def test_wall_of_many_colours_is_not_plain():
    rng = np.random.default_rng(0)
    assert plain_colour(rng.integers(0, 255, (240, 320, 3)).astype(np.uint8)) is None


@pytest.mark.parametrize("top", [2, 0])
def test_ground_beyond_tells_whether_an_object_is_cut(top):
    rgb, mask = np.full((240, 320, 3), 255, np.uint8), np.zeros((240, 320), bool)
    rgb[top:150, 100:200] = 40
    mask[2:150, 100:200] = True
    assert shows_ground_beyond(rgb, mask, 4) is (top > 0)
    found = Detections(mask.astype(np.uint16), "learned", {1: 0.9}, {})
    assert fit_objects(rgb, found)[0][0].cut is (top == 0)


def test_shade_below_speaks_for_the_side():
    rgb, mask = bag()
    assert shade_below(rgb, mask.astype(np.uint16)) == 0
    rgb[211:230, 60:260] = 240
    assert shade_below(rgb, mask.astype(np.uint16)) == pytest.approx(15)
    rgb[100:210, 262:285] = 225  # a shadow beside it, as of what lies there
    assert shade_below(rgb, mask.astype(np.uint16)) == 0
