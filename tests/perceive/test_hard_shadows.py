"""Shadows with a hard edge get the light of their surroundings, whatever their outline."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from physgen.perceive.shadow.hard_shadows import lighten_hard_shadows
from physgen.photometry import decode, encode_u8

SIZE = (240, 320)
"""Height and width of the photo, px."""
DEPTH = np.float32([1.4, 1.3, 1.1])
"""-log of light in the shadow: blue sky lights it."""


def lit_ground() -> NDArray[np.uint8]:
    """Return ground with grain, a slow change of light and a painted line."""
    rows, columns = np.mgrid[: SIZE[0], : SIZE[1]]
    light = 0.35 + 0.0004 * columns + np.random.default_rng(0).normal(0, 0.01, SIZE)
    light[(np.abs(rows - 0.5 * columns - 60) < 3)] = 0.7
    colours = light[..., None] * np.float32([1.0, 0.95, 0.85])
    return encode_u8(colours.astype(np.float32))


def polygon(corners: list[tuple[int, int]]) -> NDArray[np.bool_]:
    mask = np.zeros(SIZE, np.uint8)
    cv2.fillPoly(mask, [np.array(corners, np.int32)], 1)
    return mask > 0


BUS = polygon([(90, 60), (220, 70), (220, 130), (90, 140)])
SHADOW = polygon([(95, 130), (215, 120), (258, 152), (140, 176)])
PREDICTED = polygon([(90, 130), (220, 130), (240, 165), (110, 165)])
"""Where geometry expects the shadow: it covers about a half of it."""


def photo_with(shadow: NDArray[np.bool_]) -> NDArray[np.uint8]:
    light = decode(lit_ground())
    light[shadow] *= np.exp(-DEPTH)
    return encode_u8(light)


def test_the_whole_shadow_is_lightened() -> None:
    coverage = BUS.astype(np.float32)
    clean = lighten_hard_shadows(
        photo_with(SHADOW), coverage, 1.2 * PREDICTED.astype(np.float32), 90.0
    )
    assert clean is not None
    visible = cv2.dilate(BUS.astype(np.uint8), np.ones((7, 7))) == 0
    errors = np.abs(clean.astype(int) - lit_ground()).max(axis=2)
    assert np.median(errors[SHADOW & visible]) <= 8
    # Its edge leaves no rim, and lit ground stays as it is.
    assert np.percentile(errors[visible], 99) <= 25
    rim = cv2.dilate(SHADOW.astype(np.uint8), np.ones((7, 7))) > 0
    assert not errors[visible & ~rim].any()


def test_the_paint_in_a_shadow_stays() -> None:
    clean = lighten_hard_shadows(
        photo_with(SHADOW),
        BUS.astype(np.float32),
        1.2 * PREDICTED.astype(np.float32),
        90.0,
    )
    assert clean is not None
    inner = cv2.erode(SHADOW.astype(np.uint8), np.ones((9, 9))) > 0
    rows, columns = np.mgrid[: SIZE[0], : SIZE[1]]
    distance = np.abs(rows - 0.5 * columns - 60)
    line = inner & (distance < 2)
    beside = inner & (distance > 6) & (distance < 15)
    assert clean[line].mean() > clean[beside].mean() + 30


@pytest.mark.parametrize(
    "predicted",
    [
        np.zeros(SIZE, np.float32),
        1.2 * polygon([(90, 20), (220, 20), (220, 55), (90, 55)]).astype(np.float32),
    ],
)
def test_dark_ground_without_a_predicted_shadow_stays(
    predicted: NDArray[np.float32],
) -> None:
    mat = polygon([(20, 190), (120, 190), (120, 230), (20, 230)])
    coverage = BUS.astype(np.float32)
    assert lighten_hard_shadows(photo_with(mat), coverage, predicted, 90.0) is None
