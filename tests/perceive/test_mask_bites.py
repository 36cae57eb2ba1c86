"""Bites in masks are filled; shade, neighbours and ground are not bites."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import cv2
import numpy as np
import pytest

from physgen.perceive.bites import fill_bites

SCENES = Path(__file__).parents[2] / "scenes"
CAR = 1
"""Id of the toy car in its photo."""


@cache
def photo(scene: str) -> np.ndarray:
    """Return the bundled photo (H, W, 3) of a scene."""
    bgr = cv2.imread(str(SCENES / scene / "photo.png"))
    return np.ascontiguousarray(bgr[..., ::-1])


@cache
def masks(scene: str) -> np.ndarray:
    """Return the label map (H, W) of a bundled scene, drawn by hand."""
    path = SCENES / scene / "photo.assets/masks.png"
    return cv2.imread(str(path), cv2.IMREAD_UNCHANGED).astype(np.uint16)


def bite(mask: np.ndarray, side: str) -> np.ndarray:
    """Return the part of a mask (H, W) in a disc at the middle of its side."""
    rows, columns = np.nonzero(mask)
    ends = rows == rows.max() if side == "bottom" else columns == columns.max()
    disc = np.zeros(mask.shape, np.uint8)
    radius = round(0.13 * float(np.sqrt(len(rows))))
    centre = int(np.median(columns[ends])), int(np.median(rows[ends]))
    cv2.circle(disc, centre, radius, 1, -1)
    return mask & (disc > 0)


@pytest.mark.parametrize(
    ("scene", "label", "side"),
    [("toy-car", CAR, "bottom"), ("cups", 1, "bottom"), ("cups", 1, "right")],
)
def test_bite_in_a_mask_is_filled(scene, label, side):
    labels = masks(scene).copy()
    missing = bite(labels == label, side)
    labels[missing] = 0
    filled = fill_bites(photo(scene), labels)
    assert (filled[missing] == label).mean() > 0.85
    added = (filled != labels) & ~missing
    assert added.sum() < 0.15 * missing.sum()


def test_complete_masks_stay():
    labels = masks("toy-car")
    assert np.array_equal(fill_bites(photo("toy-car"), labels), labels)


def test_shade_below_an_object_is_no_bite():
    labels = masks("toy-car")
    car = (labels == CAR).astype(np.float32)
    shade = np.roll(car, (12, -20), axis=(0, 1))
    light = 1 - 0.4 * cv2.GaussianBlur(shade, (0, 0), 3)
    light[labels > 0] = 1
    shaded = (photo("toy-car") * light[..., None]).astype(np.uint8)
    assert np.array_equal(fill_bites(shaded, labels), labels)


@pytest.mark.slow
def test_neighbour_without_a_mask_is_no_bite():
    """A tin stands before the car; the network sees both as objects."""
    labels = masks("toy-car")
    rgb = photo("toy-car").copy()
    rows, columns = np.nonzero(labels == CAR)
    left, bottom = int(columns.min()), int(rows.max())
    cv2.rectangle(rgb, (left - 60, bottom - 90), (left - 3, bottom), (40, 90, 160), -1)
    added = fill_bites(rgb, labels) != labels
    assert added.sum() < 0.005 * len(rows)


@pytest.mark.slow
def test_textured_ground_is_no_bite():
    labels = masks("toy-car")
    noise = np.random.default_rng(2).normal(0, 30, labels.shape)
    noise = cv2.GaussianBlur(noise, (0, 0), 2) * 4
    noise[labels > 0] = 0
    rough = np.clip(photo("toy-car") + noise[..., None], 0, 255).astype(np.uint8)
    added = fill_bites(rough, labels) != labels
    assert added.sum() < 0.005 * np.count_nonzero(labels == CAR)
