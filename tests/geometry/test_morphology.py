"""Opening by discs, against OpenCV's own."""

import cv2
import numpy as np
import pytest

from physgen.geometry.morphology import disc_rectangles, open_by_disc


@pytest.mark.parametrize("radius", [1, 2, 3, 7, 12, 20, 31])
def test_opening_equals_that_of_opencv(radius: int) -> None:
    noise = np.random.default_rng(radius).random((150, 230)).astype(np.float32)
    blurred_noise = cv2.GaussianBlur(noise, (0, 0), 1 + radius / 2)
    mask = (blurred_noise > np.quantile(blurred_noise, 0.3)).astype(np.uint8)
    side = 2 * radius + 1
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (side, side))
    expected_mask = cv2.morphologyEx(mask, cv2.MORPH_OPEN, disc)
    opened_mask = open_by_disc(mask, radius)
    assert 0 < opened_mask.sum() < mask.sum()
    np.testing.assert_array_equal(opened_mask, expected_mask)


@pytest.mark.parametrize("radius", range(1, 40))
def test_rectangles_cover_the_disc(radius: int) -> None:
    side = 2 * radius + 1
    covered = np.zeros((side, side), np.uint8)
    for width, height in disc_rectangles(radius):
        top = (side - height) // 2
        left = (side - width) // 2
        covered[top : top + height, left : left + width] = 1
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (side, side))
    np.testing.assert_array_equal(covered, disc)
