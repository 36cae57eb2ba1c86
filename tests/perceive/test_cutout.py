"""The head that cuts out: crops lie where they should, and what it sees moves and turns with the photo."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from physgen.maps import read_labels
from physgen.perceive.segment.network import (
    MARGIN,
    SIDE,
    bounds,
    crop,
    follow_edges,
    mask_at_point,
    mask_in_box,
)
from physgen.perceive.segment.prompts import RULE, segment_box, segment_point
from physgen.photos import read_image
from physgen.problems import InputError
from tests.perceive.lambertian import overlap

ROOT = Path(__file__).resolve().parents[2]
GREY = 118


def ramp() -> NDArray[np.uint8]:
    """(60, 80, 3): red is the column, green the row."""
    y, x = np.mgrid[:60, :80].astype(np.uint8)
    return np.dstack([x, y, np.full_like(x, 200)])


def test_a_crop_shows_the_box_and_its_margin() -> None:
    box = (20, 10, 52, 42)
    left, top, right, bottom = bounds(box)
    assert (left, top, right, bottom) == (12, 2, 60, 50)
    found = crop(ramp(), box, right - left)
    assert np.array_equal(found, ramp()[top:bottom, left:right])
    assert (right - left) / 32 == pytest.approx(1 + 2 * MARGIN)


def test_what_lies_beyond_the_photo_is_grey() -> None:
    found = crop(ramp(), (-8, 0, 24, 32), 48)
    assert bounds((-8, 0, 24, 32)) == (-16, -8, 32, 40)
    assert (found[:8] == GREY).all()
    assert (found[:, :16] == GREY).all()
    assert np.array_equal(found[8:, 16:], ramp()[:40, :32])


@pytest.fixture(scope="module")
def shelf() -> tuple[NDArray[np.uint8], NDArray[np.uint16]]:
    folder = ROOT / "scenes/shelf"
    return read_image(folder / "photo.png"), read_labels(
        folder / "photo.assets/masks.png"
    )


def tight(mask: NDArray[np.bool_]) -> tuple[int, int, int, int]:
    x, y, w, h = cv2.boundingRect(mask.astype(np.uint8))
    return x, y, x + w, y + h


def test_the_mirror_image_has_the_mirrored_mask(shelf: tuple) -> None:
    rgb, labels = shelf
    left, top, right, bottom = tight(labels == 1)
    width = rgb.shape[1]
    mask = mask_in_box(rgb, (left, top, right, bottom)).mask
    other = mask_in_box(
        np.ascontiguousarray(rgb[:, ::-1]), (width - right, top, width - left, bottom)
    ).mask
    assert overlap(mask, other[:, ::-1]) > 0.97  # crops are rounded to whole px


def test_a_mask_moves_with_the_photo(shelf: tuple) -> None:
    rgb, labels = shelf
    left, top, right, bottom = tight(labels == 1)
    across, down = (right - left), (bottom - top)
    part = rgb[max(top - down, 0) :, max(left - across, 0) :]
    x, y = left - max(left - across, 0), top - max(top - down, 0)
    mask = mask_in_box(rgb, (left, top, right, bottom)).mask
    there = mask_in_box(part, (x, y, x + across, y + down)).mask
    assert np.array_equal(
        mask[rgb.shape[0] - part.shape[0] :, rgb.shape[1] - part.shape[1] :], there
    )


@pytest.mark.slow
def test_every_object_of_a_shelf_from_its_box_and_from_a_point(shelf: tuple) -> None:
    rgb, labels = shelf
    by_box, by_point = [], []
    for i in np.unique(labels[labels > 0]).tolist():
        mask = labels == i
        box = tight(mask)
        found = mask_in_box(rgb, box)
        by_box.append(overlap(found.mask, mask))
        assert found.confidence > 0.7
        inside = cv2.distanceTransform(
            np.pad(mask, 1).astype(np.uint8), cv2.DIST_L2, 5
        )[1:-1, 1:-1]
        y, x = np.unravel_index(int(inside.argmax()), inside.shape)
        side = max(box[2] - box[0], box[3] - box[1]) / 0.6
        by_point.append(
            overlap(mask_at_point(rgb, (float(x), float(y)), side).mask, mask)
        )
    assert np.median(by_box) > 0.95
    assert min(by_box) > 0.65
    assert np.median(by_point) > 0.7
    assert min(by_point) > 0.5


def test_nothing_is_seen_in_an_empty_picture() -> None:
    for rgb in (
        np.full((90, 120, 3), 120, np.uint8),
        np.random.default_rng(0).integers(0, 256, (90, 120, 3)).astype(np.uint8),
    ):
        found = mask_in_box(rgb, (30, 20, 80, 70))
        assert found.confidence < RULE.weak_confidence
        assert mask_at_point(rgb, (50, 50), 60).confidence < RULE.weak_confidence


@pytest.mark.slow
@pytest.mark.parametrize("size", [(8, 11), (40, 300)])
def test_small_and_narrow_photos(size: tuple[int, int]) -> None:
    rgb = np.random.default_rng(1).integers(0, 256, (*size, 3)).astype(np.uint8)
    for box in ((0, 0, 4, 4), (size[1] - 4, size[0] - 4, 9, 9), (-5, -5, 500, 500)):
        try:
            assert segment_box(rgb, box).mask.shape == size
        except InputError as error:
            assert "shows no object" in str(error)  # noqa: PT017
    assert not mask_in_box(rgb, (3, 3, 3, 3)).mask.any()
    assert not mask_in_box(rgb, (900, 900, 930, 930)).mask.any()
    try:
        assert segment_point(rgb, (2, 2), None).mask[2, 2]
    except InputError as error:
        assert "shows no object" in str(error)  # noqa: PT017


def test_a_coarse_outline_is_drawn_to_the_photo_s_own_edge() -> None:
    """A star whose points are finer than the head's pixels: enlarged, its chances lose them, the photo has them."""
    y, x = np.mgrid[:SIDE, :SIDE] - 0.5 * (SIDE - 1)
    star = np.hypot(x, y) < 55 + 14 * np.cos(10 * np.arctan2(y, x))
    rgb = np.where(
        star[..., None], (170, 90, 60), (120, 125, 130)
    ) + np.random.default_rng(0).normal(0, 4, (*star.shape, 3))
    rgb = np.clip(rgb, 0, 255).astype(np.uint8)
    coarse = cv2.GaussianBlur(
        cv2.resize(star.astype(np.float32), (SIDE // 2,) * 2), (0, 0), 2
    )
    weights = follow_edges(rgb, coarse)
    drawn = (weights[..., :3] * rgb).sum(-1) + weights[..., 3] >= 0.5
    enlarged = cv2.resize(coarse, star.shape[::-1]) >= 0.5
    assert (drawn != star).sum() < 0.7 * (enlarged != star).sum()
