"""The part of a sprite's halo on the floor, apart from the part that stays in place."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.arrays import F32
from physgen.geometry.shadows import Silhouette, floor_contact
from physgen.render.foot_halos import FOOT_HALO, FootHalo, Slices
from physgen.render.sprites import Sprite

TINY = 1e-9
"""Linear light: less missing light is none."""


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
    light of the background, (H, W, 3). `is_mirror`: whether the background lacks
    mirror images, so that halos contain them.
    """
    moving: dict[int, _Moving] = {}
    for k, (sprite, start) in enumerate(zip(sprites, starts, strict=True)):
        contact = floor_contact(start, tilt)
        lift = FOOT_HALO.lift * start.coverage.shape[0]
        is_standing = contact is not None and contact.low < max(lift, 1)
        part = _moving_part(sprite, start.ends, is_mirror) if is_standing else None
        if part is not None:
            moving[k] = part
    return _apart(sprites, starts, moving, behind)


def _apart(
    sprites: Sequence[Sprite],
    starts: Sequence[Silhouette],
    moving: Mapping[int, _Moving],
    behind: F32,
) -> list[Sprite]:
    """Return sprites with their `moving` light, by index, in foot halos."""
    # Shade multiplies the light of the next ground, and so keeps its grain. Where
    # shades overlap, their product is the shade of the photo.
    total_dark = np.zeros(behind.shape[:2], np.float32)
    for part in moving.values():
        total_dark[part.box] += part.dark
    brightness = np.maximum(behind.mean(axis=2), FOOT_HALO.darkest)
    total_left = np.maximum(
        1 + total_dark / brightness, np.float32(np.exp(-FOOT_HALO.deepest))
    )
    result = list(sprites)
    for k, part in moving.items():
        dark = np.minimum(total_dark[part.box], np.float32(-TINY))
        share = (part.dark / dark)[..., None]
        left = total_left[part.box][..., None]
        shade = np.repeat(-np.log(left) * share, 3, axis=2).astype(np.float32)
        foot_halo = FootHalo(part.corner, part.light, shade, starts[k].ends, part.side)
        # The halo keeps what shade and light do not explain: frame 0 is the photo.
        removed_light = behind[part.box] * (1 - left) * share
        rest = np.asarray(part.halo - part.light + removed_light, np.float32)
        halo = (part.corner, rest, part.neighbours)
        result[k] = replace(sprites[k], halo=halo, foot_halo=foot_halo)
    return result


@dataclass(frozen=True)
class _Moving:
    """The moving light of one halo."""

    corner: tuple[int, int]
    """Column and row of the photo."""
    halo: F32
    """The whole halo, (h, w, 3)."""
    neighbours: NDArray[np.int32]
    light: F32
    """Added light, (h, w, 3)."""
    dark: F32
    """Light that is missing, (h, w), at most 0."""
    side: float
    """Smaller side of the object, px."""

    @property
    def box(self) -> Slices:
        """Return the rows and columns of the photo."""
        x, y = self.corner
        height, width = self.dark.shape
        return np.s_[y : y + height, x : x + width]


def _moving_part(
    sprite: Sprite, ends: tuple[float, float], is_mirror: bool
) -> _Moving | None:
    """Return the part of a halo that moves with its object; None without any.

    `ends`: columns of both ends of the floor, px.
    """
    if sprite.halo is None:
        return None
    corner, halo, neighbours = sprite.halo
    weight = _floor_weight(sprite, corner, halo.shape[:2])
    if weight is None:
        return None
    # Light beyond the floor stays: `FootHalo.moved` does not draw it there.
    columns = corner[0] + np.arange(halo.shape[1])
    weight = weight * ((columns >= ends[0]) & (columns <= ends[1]))
    if not weight.any():
        return None
    side = float(max(min(sprite.coverage.shape), 1))
    moving = _moving_light(halo, sprite.halo_reach, side, is_mirror=is_mirror)
    moving *= weight[..., None]
    light = np.maximum(moving, 0)
    if is_mirror:
        light = moving
    dark = np.minimum(moving - light, 0).mean(axis=2)
    return _Moving(corner, halo, neighbours, light, np.asarray(dark, np.float32), side)


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
