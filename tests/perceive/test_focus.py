"""Objects in and out of focus beside each other."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from physgen.perceive.segment.focus import blur_shares, rim_sharpness
from physgen.perceive.segment.proposals import Proposal, cut_out

GRID = (120, 160)
"""(h, w) of the candidates; the photo is twice as fine."""
PLACES = ((30, 60), (80, 60), (130, 60))
"""Columns and rows of discs on the grid."""


def photo_of(blurs: tuple[float, ...]) -> np.ndarray:
    """Draw a disc at each place, out of focus by so many px."""
    rgb = np.full((240, 320, 3), (60, 70, 90), np.float32)
    for (x, y), blur in zip(PLACES, blurs, strict=True):
        share = np.zeros((240, 320), np.float32)
        cv2.circle(share, (2 * x, 2 * y), 36, 1.0, -1, cv2.LINE_AA)
        share = cv2.GaussianBlur(share, (0, 0), blur)[..., None]
        rgb = share * np.array([200, 160, 60], np.float32) + (1 - share) * rgb
    return np.clip(rgb, 0, 255).astype(np.uint8)


def shares_of(blurs: tuple[float, ...]) -> np.ndarray:
    ratios = rim_sharpness(photo_of(blurs), discs(), GRID)
    return blur_shares(ratios, np.ones(len(ratios)))


def discs() -> list[Proposal]:
    rows, columns = np.ogrid[: GRID[0], : GRID[1]]
    masks = [np.hypot(columns - x, rows - y) <= 18 for x, y in PLACES]
    return [one for mask in masks if (one := cut_out(mask, 0, 0, 1)) is not None]


def test_blurred_disc_is_out_of_focus() -> None:
    shares = shares_of((0.6, 0.7, 6.0))
    assert shares == pytest.approx([0, 0, 1])


def test_equally_soft_discs_are_in_focus() -> None:
    shares = shares_of((4.0, 4.0, 4.0))
    assert shares == pytest.approx([0, 0, 0])


def test_one_soft_object_is_in_focus() -> None:
    photo = photo_of((0.6, 0.7, 6.0))
    alone = rim_sharpness(photo, discs()[2:], GRID)
    assert blur_shares(alone, np.ones(1)) == pytest.approx([0])
    assert (
        rim_sharpness(photo, [], GRID).shape
        == blur_shares(alone[:0], alone[:0]).shape
        == (0,)
    )


def test_sharpness_falls_with_blur() -> None:
    ratios = rim_sharpness(photo_of((0.6, 2.0, 6.0)), discs(), GRID)
    assert ratios[0] > ratios[1] > ratios[2] > 1


def test_flat_picture_has_no_sharpness() -> None:
    flat = np.full((240, 320, 3), 120, np.uint8)
    ratios = rim_sharpness(flat, discs(), GRID)
    assert ratios == pytest.approx([0, 0, 0])
    assert blur_shares(ratios, np.ones(3)) == pytest.approx([0, 0, 0])


def test_speck_does_not_tell_focus() -> None:
    ratios = np.array([1.9, 9.0])
    assert blur_shares(ratios, np.array([700.0, 6.0])) == pytest.approx([0, 0])
    assert blur_shares(ratios, np.array([700.0, 300.0])) == pytest.approx([1, 0])
