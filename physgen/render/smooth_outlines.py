"""Outlines of sprites without the steps of the photo's pixels.

The coverage of a slanted edge has steps between pixels, most of all along the border of
two masks. They are invisible in the photo. If the object rotates until its edge is level,
the steps look like the teeth of a saw.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np

from physgen.arrays import F32, Mask
from physgen.perceive.inpaint.poisson import dilate
from physgen.render.sprites import CUT, Sprite


@dataclass(frozen=True)
class OutlineTuning:
    """Widths of the smoothing; by eye on boxes of the bundled scenes."""

    width: float = 1.0
    """Standard deviation of the blur along and across an outline, px."""
    slope: float = 2.2
    """Factor that makes the blurred edge as steep as that of a photo."""
    inside: float = 0.9
    """Coverage from which the light of a pixel is that of the object alone."""


OUTLINE = OutlineTuning()


def smooth_outline(sprite: Sprite) -> Sprite:
    """Return a sprite with a smooth outline; light and coverage change at the border
    only.
    """
    coverage = sprite.coverage
    object_mask = coverage > 0.5
    core = ~dilate(~object_mask, 1)
    if not core.any():
        return sprite
    blurred_cover = cv2.GaussianBlur(coverage, (0, 0), OUTLINE.width)
    smooth_cover = np.clip((blurred_cover - 0.5) * OUTLINE.slope + 0.5, 0, 1)
    light, is_known = _object_light(sprite)
    # Thin parts have no core, and keep their outline.
    is_border = (
        dilate(core, CUT.clean_depth + 1) & is_known & (smooth_cover != coverage)
    )
    new_cover = np.where(is_border, smooth_cover, coverage).astype(np.float32)
    new_light = np.where(
        is_border[..., None], light * new_cover[..., None], sprite.light
    )
    return replace(sprite, coverage=new_cover, light=new_light.astype(np.float32))


def _object_light(sprite: Sprite) -> tuple[F32, Mask]:
    """Return the light (h, w, 3) of the object without coverage, and the mask of pixels
    with it.

    Outside, the light of the nearest pixels inside continues.
    """
    coverage = sprite.coverage
    inside = np.asarray(coverage > OUTLINE.inside, np.float32)
    own_light = sprite.light / np.maximum(coverage, CUT.least_blur)[..., None]
    light_sum = cv2.GaussianBlur(own_light * inside[..., None], (0, 0), OUTLINE.width)
    weight = cv2.GaussianBlur(inside, (0, 0), OUTLINE.width)
    continued_light = light_sum / np.maximum(weight, CUT.least_blur)[..., None]
    light = np.where(inside[..., None] > 0, own_light, continued_light)
    is_known = weight > CUT.least_blur
    return np.asarray(light, np.float32), np.asarray(is_known, np.bool_)
