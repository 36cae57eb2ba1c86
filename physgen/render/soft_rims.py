"""Rims of blurred objects, continued below their objects.

Out of focus, an object is dark far beyond its mask. That rim stays as a halo, and fades
while the object moves. The ground that the object uncovers first would be in full
light, and so a bright line between the object and the rest of its rim.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np

from physgen.arrays import F32, Mask
from physgen.render.sprites import Sprite


@dataclass(frozen=True)
class SoftRimTuning:
    """Limits of blurred rims; by eye on toys out of focus and on the bundled scenes."""

    ring: float = 2.5
    """px: width of the compared rim outside an outline."""
    light_loss: float = 0.15
    """Least share of the ground's light that a blurred rim lacks ..."""
    outline_share: float = 0.6
    """... along at least this share of the outline: contact shade is below only."""
    depth: float = 4.0
    """px: width of the continuation inside the outline."""
    spread: float = 1.5
    """px: standard deviation of the blur that continues a rim."""
    least_light: float = 0.05
    """Least share of the ground's light that a rim leaves."""


SOFT_RIM = SoftRimTuning()
DARKEST = 1e-3
"""Smallest linear light of a ground in ratios."""


def continue_soft_rims(sprites: Sequence[Sprite], background: F32) -> list[Sprite]:
    """Return the sprites with the rims of blurred objects continued below them.

    `background`: linear light of the background, (H, W, 3). Frame 0 does not change.
    """
    covers = np.zeros(background.shape[:2], np.uint8)
    for sprite in sprites:
        photo_box, sprite_box = _boxes(sprite, (0, 0), covers.shape)
        covers[photo_box] += sprite.coverage[sprite_box] > 0
    return [_continue_rim(sprite, background, covers > 1) for sprite in sprites]


def _boxes(
    sprite: Sprite, corner: tuple[int, int], shape: tuple[int, ...]
) -> tuple[tuple[slice, slice], tuple[slice, slice]]:
    """Return the common box of a sprite and of a picture of a `shape` at a `corner` of
    the photo, in px of the picture and in px of the sprite.
    """
    places, own_places = [], []
    for axis in (0, 1):
        offset = sprite.corner[1 - axis] - corner[1 - axis]
        start = max(offset, 0)
        stop = max(min(offset + sprite.coverage.shape[axis], shape[axis]), start)
        places.append(slice(start, stop))
        own_places.append(slice(start - offset, stop - offset))
    return (places[0], places[1]), (own_places[0], own_places[1])


def _continue_rim(sprite: Sprite, background: F32, is_shared: Mask) -> Sprite:
    """Return a sprite with its rim continued, unchanged if it is not blurred.

    `is_shared` (H, W): pixels of several sprites, which stay.
    """
    if sprite.halo is None or sprite.rest is None or sprite.ball is not None:
        return sprite
    (x, y), halo, numbers = sprite.halo
    window = np.s_[y : y + halo.shape[0], x : x + halo.shape[1]]
    ground, reach = background[window], sprite.halo_reach
    ring = (reach > 0) & (reach <= SOFT_RIM.ring)
    darkness = -halo.mean(axis=2) / np.maximum(ground.mean(axis=2), DARKEST)
    if (
        not ring.any()
        or (darkness[ring] > SOFT_RIM.light_loss).mean() < SOFT_RIM.outline_share
    ):
        return sprite
    rim = _rim_below(halo, ground, reach) * ~is_shared[window][..., None]
    place, sprite_box = _boxes(sprite, (x, y), halo.shape)
    rest = sprite.rest.copy()
    # At its start, the object hides the rim except at its soft border.
    rest[sprite_box] -= (1 - sprite.coverage[sprite_box])[..., None] * rim[place]
    return replace(
        sprite, rest=rest, halo=((x, y), np.asarray(halo + rim, np.float32), numbers)
    )


def _rim_below(halo: F32, ground: F32, reach: F32) -> F32:
    """Return the light (h, w, 3), at most 0, of a `halo` continued below its object.

    `ground`: light of the ground, (h, w, 3). `reach`: px to the object, (h, w).
    """
    inside = (reach == 0).astype(np.uint8)
    depth = cv2.distanceTransform(inside, cv2.DIST_L2, 5)
    band = (inside > 0) & (depth <= SOFT_RIM.depth)
    ring = ((reach > 0) & (reach <= SOFT_RIM.depth)).astype(np.float32)
    weights = cv2.GaussianBlur(ring, (0, 0), SOFT_RIM.spread)[..., None]
    sums = cv2.GaussianBlur(halo * ring[..., None], (0, 0), SOFT_RIM.spread)
    darkest = (SOFT_RIM.least_light - 1) * ground
    rim = np.clip(sums / np.maximum(weights, DARKEST), darkest, 0)
    return np.asarray(rim * band[..., None], np.float32)
