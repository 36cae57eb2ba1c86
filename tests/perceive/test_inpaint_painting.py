"""Somebody paints, and the photo stays: windows, the reach of the hole, and colours that meet."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from physgen.perceive.inpaint.painting import (
    inpaint_windows,
    model_size,
    widen,
    windows,
)

H, W = 256, 512
Y, X = np.mgrid[:H, :W]


def ramp() -> np.ndarray:
    """A wall that brightens to the right."""
    grey = 80 + X * 0.2
    return np.rint(np.stack([grey, grey * 0.9, grey * 0.7], -1)).astype(np.uint8)


def disc(x: float, y: float, radius: float) -> np.ndarray:
    return np.hypot(X - x, Y - y) <= radius


def test_outside_the_hole_the_photo_stays_whatever_is_painted():
    rgb = np.random.default_rng(0).integers(0, 256, (H, W, 3), np.uint8)
    hole = disc(100, 100, 20) | disc(300, 200, 40)
    before = rgb.copy()
    filled = inpaint_windows(rgb, hole, lambda part, wanted: 255 - part, 64)
    assert np.array_equal(filled[~hole], rgb[~hole])
    assert np.array_equal(rgb, before)


@pytest.mark.parametrize("hole", [np.zeros((H, W), bool), np.ones((H, W), bool)])
def test_without_a_hole_or_without_a_photo_nobody_is_asked(hole):
    def never(part, wanted):
        raise AssertionError

    assert np.array_equal(inpaint_windows(ramp(), hole, never, 64), ramp())


def test_a_painters_shift_of_colour_is_taken_away():
    hole = disc(250, 120, 30)
    photo = np.where(hole[..., None], 0, ramp()).astype(np.uint8)

    def tinted(
        part, wanted
    ):  # knows the wall, and paints all of it in a tint of its own
        return np.clip(ramp().astype(int) + np.array([9, -6, 4]), 0, 255).astype(
            np.uint8
        )

    filled = inpaint_windows(photo, hole, tinted, max(H, W))
    assert np.abs(filled.astype(int) - ramp())[hole].max() <= 2


def test_a_contact_shadow_beside_the_hole_is_painted_over_not_continued():
    hole = disc(250, 120, 30)
    shade = 1 - 0.6 * np.clip(1 - (np.hypot(X - 250, Y - 120) - 30) / 10, 0, 1)
    photo = (ramp() * shade[..., None]).astype(np.uint8)
    seen = {}

    def even(part, wanted):  # continues what it sees around what is to be painted
        seen["around"] = part[
            cv2.dilate(wanted.astype(np.uint8), np.ones((3, 3))).astype(bool) & ~wanted
        ]
        return np.where(wanted[..., None], ramp(), part)

    filled = inpaint_windows(photo, hole, even, max(H, W))
    assert seen["around"].min() > 60  # no dark rim for the painter to continue
    deep = disc(250, 120, 15)
    assert np.abs(filled.astype(int) - ramp())[deep].max() <= 3
    assert np.array_equal(
        filled[~hole], photo[~hole]
    )  # the shadow that is seen stays: another role lifts it


def test_the_reach_is_the_papers_and_grows_with_the_photo():
    for scale in (1, 3):
        point = np.zeros((512 * scale, 512 * scale), bool)
        point[256 * scale, 256 * scale] = True
        wide = widen(point)
        assert wide.any(1).sum() == pytest.approx(40 * scale, abs=2)


def test_windows_hold_the_holes_with_surroundings_and_do_not_overlap():
    hole = disc(30, 30, 8) | disc(60, 40, 8) | disc(450, 200, 20)
    found = windows(hole, 64)
    assert len(found) == 2  # the two near each other share one
    count = np.zeros((H, W), int)
    for part in found:
        count[part] += 1
        assert min(count[part].shape) >= 64
        assert 2 * hole[part].sum() < hole[part].size
    assert count.max() == 1
    assert (count[hole] == 1).all()


@pytest.mark.parametrize(
    "shape", [(512, 512), (100, 100), (3000, 2000), (20, 4000), (1, 1)]
)
def test_frames_are_of_the_models_size(shape):
    tall, wide = model_size(shape, 512, 16)
    assert tall % 16 == wide % 16 == 0
    assert tall * wide <= 1.1 * 512**2
    assert max(tall, wide) <= 1024
