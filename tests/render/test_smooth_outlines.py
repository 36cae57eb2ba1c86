"""Outlines of sprites without steps, at unchanged first frames."""

from __future__ import annotations

import cv2
import numpy as np

from physgen.arrays import F32
from physgen.render.smooth_outlines import smooth_outline
from physgen.render.sprites import Sprite


def _colour() -> F32:
    """Return the light of an object, (3,)."""
    return np.array([0.6, 0.3, 0.1], np.float32)


def _box_with_steps() -> Sprite:
    """Return a rotated box whose coverage is 0 or 1, as along the border of two masks."""
    corners = cv2.boxPoints(((40.0, 40.0), (40.0, 30.0), 28.0))
    mask = np.zeros((80, 80), np.uint8)
    cv2.fillConvexPoly(mask, np.rint(corners).astype(np.int32), 1)
    coverage = mask.astype(np.float32)
    return Sprite(0, (0, 0), coverage[..., None] * _colour(), coverage)


def _roughness(coverage: F32) -> float:
    """Return the change along the upper edge of a box that was rotated back, px."""
    turn = cv2.getRotationMatrix2D((40.0, 40.0), 28.0, 1.0)
    level = cv2.warpAffine(coverage, turn, (80, 80), flags=cv2.INTER_LINEAR)
    heights = level[15:40, 28:52].sum(axis=0)
    return float(np.std(np.diff(heights)))


def test_level_edges_have_no_teeth() -> None:
    sprite = _box_with_steps()
    smooth = smooth_outline(sprite)
    assert _roughness(smooth.coverage) < _roughness(sprite.coverage) / 2
    assert abs(smooth.coverage.sum() / sprite.coverage.sum() - 1) < 0.01


def test_light_stays_that_of_the_object() -> None:
    smooth = smooth_outline(_box_with_steps())
    border = smooth.coverage > 0.05
    colours = smooth.light[border] / smooth.coverage[border][:, None]
    assert np.allclose(colours, _colour(), atol=1e-4)


def test_thin_parts_keep_their_outline() -> None:
    coverage = np.zeros((40, 40), np.float32)
    coverage[:, 20] = 1
    sprite = Sprite(0, (0, 0), coverage[..., None] * _colour(), coverage)
    assert smooth_outline(sprite) is sprite
