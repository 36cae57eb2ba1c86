"""Mirror images on a glossy ground: detected, removed, and nothing else changed."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from physgen.perceive.shadow.mirror_images import (
    find_mirror_image,
    remove_mirror_images,
)

FOOT = 120
"""Row below the lowest one of the object."""


def photo_of(share: float) -> tuple[np.ndarray, np.ndarray]:
    """Draw a striped box on a grey ground that mirrors this share of its light."""
    random = np.random.default_rng(1)
    rgb = np.full((220, 240, 3), 110, np.float32)
    labels = np.zeros(rgb.shape[:2], np.uint16)
    labels[40:FOOT, 90:150] = 1
    for row in range(40, FOOT, 20):
        rgb[row : row + 10, 90:150] = (20, 120, 230)
        rgb[row + 10 : row + 20, 90:150] = (240, 200, 60)
    item = rgb[40:FOOT, 90:150]
    ground = rgb[FOOT : FOOT + 80, 90:150]
    blurred = cv2.GaussianBlur(item[::-1], (0, 0), 2)
    ground += share * (blurred - ground)
    noisy = rgb + random.normal(0, 1.0, rgb.shape)
    return np.clip(noisy, 0, 255).astype(np.uint8), labels


def fill_with_ground(rgb: np.ndarray, hole: np.ndarray) -> np.ndarray:
    return np.where(hole[..., None], np.uint8(110), rgb).astype(np.uint8)


@pytest.mark.parametrize(
    ("share", "is_glossy"), [(0.25, True), (0.1, True), (0.0, False)]
)
def test_a_mirror_image_is_found_below(share: float, is_glossy: bool) -> None:
    rgb, labels = photo_of(share)
    image = find_mirror_image(rgb, labels, 1)
    assert (image is not None) == is_glossy
    if image is not None:
        assert image[FOOT : FOOT + 80, 90:150].all()
        assert not image[:FOOT, 90:150].any()


def test_a_shadow_is_no_mirror_image() -> None:
    rgb, labels = photo_of(0.0)
    rgb[FOOT : FOOT + 60, 80:160] = rgb[FOOT : FOOT + 60, 80:160] // 2
    assert find_mirror_image(rgb, labels, 1) is None


def test_the_clean_background_lacks_mirror_images() -> None:
    rgb, labels = photo_of(0.25)
    coverage = (labels > 0).astype(np.float32)
    clean = remove_mirror_images(rgb, rgb, labels, coverage, [1], fill_with_ground)
    assert clean is not None
    assert np.abs(clean[FOOT : FOOT + 80, 90:150].astype(int) - 110).max() == 0
    matt, _ = photo_of(0.0)
    assert (
        remove_mirror_images(matt, matt, labels, coverage, [1], fill_with_ground)
        is None
    )


def photo_of_bag(softness: float) -> tuple[np.ndarray, np.ndarray]:
    """Draw a plain bag with a strap above a low strip of ground that mirrors it.

    `softness` is the blur of the image below the bag, px.
    """
    random = np.random.default_rng(2)
    labels = np.zeros((430, 320), np.uint16)
    labels[20:400, 60:300] = labels[100:370, 20:40] = 1
    rgb = np.full((*labels.shape, 3), 250, np.float32)
    image = np.zeros(labels.shape, np.float32)
    image[400:, 60:300] = image[370:, 20:40] = 1
    if softness:
        image = cv2.GaussianBlur(image, (0, 0), softness)
    rgb -= 14 * image[..., None]
    rgb[labels > 0] = 90
    noisy = rgb + random.normal(0, 0.5, rgb.shape)
    return np.clip(noisy, 0, 255).astype(np.uint8), labels


def test_a_plain_mirror_image_has_the_outline_of_its_object() -> None:
    rgb, labels = photo_of_bag(0)
    image = find_mirror_image(rgb, labels, 1)
    assert image is not None
    assert image[400:, 60:300].all()
    # The strap ends above the foot: it stands on the ground farther back.
    assert image[370:, 20:40].all()
    assert not image[:340].any()


def test_a_soft_shadow_below_is_no_mirror_image() -> None:
    rgb, labels = photo_of_bag(20.0)
    assert find_mirror_image(rgb, labels, 1) is None
