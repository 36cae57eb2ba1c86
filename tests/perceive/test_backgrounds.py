"""Backgrounds from one fill, and what is found at reduced size, beside the truth."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from physgen import registry
from physgen.perceive.inpaint.poisson import fill_from_surroundings
from physgen.perceive.roles import Mask, Rgb, Shadows
from physgen.perceive.shadow.backgrounds import fill_backgrounds, find_surroundings
from physgen.perceive.shadow.reduced import reduce_photo, restore_size
from physgen.photometry import DistantLight, decode, encode_u8

LIGHT = DistantLight((0.0, -0.6, 0.8), 0.8, 0.4)


def ground(height: int, width: int, seed: int = 0) -> np.ndarray:
    """Linear light (H, W, 3) of a ground with grain."""
    grain = np.random.default_rng(seed).normal(0, 0.03, (height, width, 1))
    grain = cv2.GaussianBlur(grain, (0, 0), 1.0)[..., None]
    return np.array([0.5, 0.42, 0.33]) * np.exp(grain)


def shadow(height: int, width: int) -> np.ndarray:
    """Share of light (H, W, 1) that a soft round shadow leaves."""
    y, x = np.mgrid[:height, :width] / width
    away = np.hypot(x - 0.55, (y - 0.5 * height / width) * 2)
    return (1 - 0.5 / (1 + np.exp((away - 0.15) / 0.008)))[..., None]


def found(clean: Rgb) -> Shadows:
    """Shadows as the role finds them."""
    owners = np.ones(clean.shape[:2], np.uint16)
    return Shadows(clean, owners, LIGHT, 4.0, 4.0, 10.0, 0.8)


def test_shadow_of_a_large_photo_is_lifted_as_at_reduced_size() -> None:
    lit, left = ground(1000, 1600), shadow(1000, 1600)
    photo, truth = encode_u8(lit * left), encode_u8(lit)
    coverage = np.zeros(photo.shape[:2], np.float32)
    reduced = reduce_photo(photo, coverage)
    assert reduced.size == (640, 400)
    small = cv2.resize(truth, reduced.size, interpolation=cv2.INTER_AREA)
    restored = restore_size(found(small), reduced, photo, coverage)
    assert restored.backdrop == pytest.approx(25.0)
    assert restored.owners is not None
    assert restored.owners.shape == photo.shape[:2]
    assert restored.clean_background is not None
    before, after = (
        np.abs(one.astype(float) - truth).mean()
        for one in (photo, restored.clean_background)
    )
    assert after < 0.1 * before
    is_lit = left[..., 0] > 0.999
    assert np.abs(restored.clean_background.astype(int) - photo)[is_lit].max() <= 2


def test_small_photo_is_not_reduced() -> None:
    photo = encode_u8(ground(300, 640))
    coverage = np.zeros(photo.shape[:2], np.float32)
    shadows = found(photo)
    reduced = reduce_photo(photo, coverage)
    assert reduced.background is photo
    assert restore_size(shadows, reduced, photo, coverage) is shadows


@pytest.mark.parametrize("width", [400, 1000])
def test_both_backgrounds_come_from_one_fill(width: int) -> None:
    """A disc on its shadow: the fill has light, and dimmed it goes on in the shadow."""
    height = width // 2
    lit, left = ground(height, width), shadow(height, width)
    shaded = encode_u8(lit * left)
    y, x = np.mgrid[:height, :width]
    disc = np.hypot(x - 0.55 * width, y - 0.5 * height) < 0.05 * width
    photo = np.where(disc[..., None], np.uint8(20), shaded)
    coverage = disc.astype(np.float32)
    around = find_surroundings(photo, coverage)
    lifted = np.where(around.hole[..., None], around.guess, encode_u8(lit))
    calls = []

    def inpaint(rgb: Rgb, hole: Mask) -> Rgb:
        calls.append(hole)
        return registry.make("inpaint")(rgb, hole)

    backgrounds = fill_backgrounds(around, found(lifted), inpaint)
    assert len(calls) == 1
    assert backgrounds.clean_picture is not None
    assert np.array_equal(backgrounds.shaded_picture[~around.hole], photo[~around.hole])
    for picture, truth in (
        (backgrounds.clean_picture, lit),
        (backgrounds.shaded_picture, lit * left),
    ):
        light = decode(picture)[disc].mean(axis=0)
        assert light == pytest.approx(truth[disc].mean(axis=0), rel=0.08)


@pytest.mark.slow
def test_fill_of_a_large_photo_has_its_grain_and_stripes() -> None:
    """Stripes of 60 px with grain, finer than the reduced photo shows."""
    height, width = 700, 1400
    y, x = np.mgrid[:height, :width]
    stripes = np.where((x // 60) % 2, 150.0, 90.0)[..., None]
    grain = np.random.default_rng(3).normal(0, 6, (height, width, 1))
    truth = np.clip(stripes + grain, 0, 255).astype(np.uint8).repeat(3, axis=2)
    hole = np.hypot(x - 700, y - 350) < 70
    photo = np.where(hole[..., None], np.uint8(255), truth)
    filled = registry.make("inpaint")(photo, hole)
    assert np.array_equal(filled[~hole], truth[~hole])
    smooth = [
        cv2.GaussianBlur(one.astype(np.float32), (0, 0), 3) for one in (filled, truth)
    ]
    inside = np.hypot(x - 700, y - 350) < 60
    assert np.abs(smooth[0] - smooth[1])[inside].mean() < 10
    fine, true_fine = (
        (one - soft)[inside].std()
        for one, soft in zip((filled, truth), smooth, strict=True)
    )
    assert fine == pytest.approx(true_fine, rel=0.35)


def test_small_holes_are_filled_from_close_by() -> None:
    photo = encode_u8(ground(500, 900))
    hole = np.zeros(photo.shape[:2], bool)
    hole[40:50, 40:60] = hole[400:410, 800:830] = True
    sizes = []

    def inpaint(rgb: Rgb, part: Mask) -> Rgb:
        sizes.append(part.size)
        return np.where(part[..., None], np.uint8(7), rgb)

    filled = fill_from_surroundings(photo, hole, inpaint)
    assert len(sizes) == 2
    assert sum(sizes) < 0.3 * hole.size
    assert (filled[hole] == 7).all()
    assert np.array_equal(filled[~hole], photo[~hole])
