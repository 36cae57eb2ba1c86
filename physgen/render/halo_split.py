"""The part of a sprite's halo on the floor, apart from the part that stays in place."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import cv2
import numpy as np

from physgen.arrays import F32
from physgen.geometry.shadows import Silhouette, floor_contact
from physgen.render.foot_halos import FOOT_HALO, FootHalo
from physgen.render.sprites import Sprite


def split_halos(
    sprites: Sequence[Sprite],
    starts: Sequence[Silhouette],
    tilt: float,
    behind: F32,
    *,
    is_mirror: bool,
) -> list[Sprite]:
    """Return the sprites of a side view with the floor's part of their halos apart.

    `tilt`: rise of a floor's point in the picture per px of distance. `behind`: linear
    light of the background, (H, W, 3). `is_mirror`:
    whether the background lacks mirror images, so that halos contain them.
    """
    result = []
    for sprite, start in zip(sprites, starts, strict=True):
        contact = floor_contact(start, tilt)
        lift = FOOT_HALO.lift * start.coverage.shape[0]
        is_standing = contact is not None and contact.low < max(lift, 1)
        if is_standing and sprite.halo is not None:
            sprite = _split(sprite, start.ends, behind, is_mirror=is_mirror)
        result.append(sprite)
    return result


def _split(
    sprite: Sprite, ends: tuple[float, float], behind: F32, *, is_mirror: bool
) -> Sprite:
    """Return a sprite with a foot halo, which its halo then lacks."""
    assert sprite.halo is not None
    corner, halo, neighbours = sprite.halo
    weight = _floor_weight(sprite, corner, halo.shape[:2])
    if weight is None or not weight.any():
        return sprite
    side = float(max(min(sprite.coverage.shape), 1))
    moving = _moving_light(halo, sprite.halo_reach, side, is_mirror=is_mirror)
    moving *= weight[..., None]
    light = moving if is_mirror else np.maximum(moving, 0)
    # Shade multiplies the light of the next ground, and so keeps its grain.
    x, y = corner
    ground = behind[y : y + halo.shape[0], x : x + halo.shape[1]]
    dark = np.minimum(moving - light, 0).mean(axis=2, keepdims=True)
    brightness = np.maximum(ground.mean(axis=2, keepdims=True), FOOT_HALO.darkest)
    left = np.maximum(1 + dark / brightness, np.exp(-FOOT_HALO.deepest))
    left = np.repeat(left, 3, axis=2).astype(np.float32)
    foot_halo = FootHalo(corner, light, -np.log(left), ends, side)
    rest = np.asarray(halo - light - ground * (left - 1), np.float32)
    return replace(sprite, halo=(corner, rest, neighbours), foot_halo=foot_halo)


def _moving_light(halo: F32, distance: F32, side: float, *, is_mirror: bool) -> F32:
    """Return the part (h, w, 3) of a halo that belongs to an object rather than to the
    ground.

    `distance` (h, w): px from the object.
    """
    sigma = max(FOOT_HALO.smooth * side, 1.0)
    # Pixels of the object are unknown; elsewhere the halo ends softly.
    known = (distance > 0).astype(np.float32)
    norm = np.maximum(cv2.GaussianBlur(known, (0, 0), sigma), np.float32(0.05))
    gain = (known / norm)[..., None]
    smooth = cv2.GaussianBlur(halo, (0, 0), sigma) * gain
    reach = max(FOOT_HALO.ramp, FOOT_HALO.rim * side)
    near = np.exp(-np.square(distance / reach))[..., None]
    if is_mirror:
        return np.asarray(near * halo + (1 - near) * smooth, np.float32)
    # Close to the outline, light corrects the fill. Detail that is dark all over is a
    # rim that the mask lacks; other detail is the grain of the ground.
    mean = smooth.mean(axis=2, keepdims=True)
    power = cv2.GaussianBlur(np.square(halo.mean(axis=2)), (0, 0), sigma)
    deviation = np.sqrt(power)[..., None] * np.sqrt(gain)
    low, high = FOOT_HALO.even
    evenness = -mean / np.maximum(deviation, np.float32(1e-4))
    share = np.clip((evenness - low) / (high - low), 0, 1)
    dark = share * halo + (1 - share) * smooth
    moving = near * np.minimum(dark, 0)
    return np.asarray(moving, np.float32)


def _floor_weight(
    sprite: Sprite, corner: tuple[int, int], shape: tuple[int, ...]
) -> F32 | None:
    """Return the share (h, w) of a halo's pixels that lies on the floor; None without
    any visible pixel of the sprite.
    """
    solid = sprite.coverage > 0.5
    columns = np.flatnonzero(solid.any(axis=0))
    rows = np.flatnonzero(solid.any(axis=1))
    if not len(rows):
        return None
    height = float(np.ptp(rows)) + 1
    foot = sprite.corner[1] + float(rows[-1])
    begins = np.full(shape[1], foot - FOOT_HALO.beside * height)
    lowest = solid.shape[0] - 1 - np.argmax(solid[::-1], axis=0)[columns]
    places = columns + sprite.corner[0] - corner[0]
    is_inside = (places >= 0) & (places < shape[1])
    own_begins = np.maximum(sprite.corner[1] + lowest, foot - FOOT_HALO.legs * height)
    begins[places[is_inside]] = own_begins[is_inside]
    # Beside the outline, the floor begins softly.
    below = corner[1] + np.arange(shape[0])[:, None] - begins[None]
    weight = np.clip(below / FOOT_HALO.ramp, 0, 1)
    is_own = np.zeros(shape[1], np.bool_)
    is_own[places[is_inside]] = own_begins[is_inside] > foot - FOOT_HALO.legs * height
    weight = np.where(is_own[None], np.clip(below, 0, 1), weight)
    return np.asarray(weight, np.float32)
