"""Light at the foot of an object that moves along a floor with the object.

The halo of a sprite is the photo beyond sprites and shaded background: a thin contact
shadow, the colours of a mirror image, the lower rim of the object itself. Most of it
fades where it is. The part on the floor belongs to the object; if it stayed behind,
the object would hover.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import exp, hypot
from typing import TYPE_CHECKING

import cv2
import numpy as np

from physgen.arrays import F32
from physgen.geometry.polygon import Pose
from physgen.geometry.shadows import Silhouette, floor_contact
from physgen.render.shadow_decomposition import SHADOW, shifted_picture

if TYPE_CHECKING:
    from physgen.render.sprites import Sprite

Slices = tuple[slice, slice]
"""Rows and columns of the photo."""


@dataclass(frozen=True)
class FootHaloTuning:
    """Extent of the floor around a foot; lengths are shares of an object's height."""

    legs: float = 0.3
    """Height of the gaps between legs or wheels over the foot."""
    beside: float = 0.1
    """Height over the foot at which the floor begins beside an object."""
    lift: float = 0.03
    """Largest height of an object on its floor: a mask may lack the lowest rim."""
    ramp: float = 4.0
    """px over which the floor's part begins, and over which detail fades."""
    rim: float = 0.05
    """Width of a lower rim that the mask may lack."""
    even: tuple[float, float] = (0.85, 0.97)
    """Mean darkness over its root mean square: of grain, and of a rim."""
    smooth: float = 0.02
    """Standard deviation of the blur: grain of the ground stays with the ground."""
    steep: float = 0.25
    """Largest slope of a floor."""
    darkest: float = 1e-3
    """Linear light of a ground without visible shade."""
    deepest: float = 3.0
    """-log of the least light that shade leaves."""
    faint: float = 0.02
    """Largest invisible share."""


FOOT_HALO = FootHaloTuning()


@dataclass(frozen=True)
class FootHalo:
    """The moving part of a halo."""

    corner: tuple[int, int]
    """Column and row of the photo."""
    light: F32
    """Linear light that is added, (h, w, 3)."""
    shade: F32
    """-log of the share of light that is left, (h, w, 3)."""
    ends: tuple[float, float]
    """Columns of both ends of the floor, px."""
    side: float
    """Smaller side of the object, px."""

    def moved(
        self, start: Pose, pose: Pose, turn: float, size: tuple[int, int]
    ) -> tuple[Slices, F32, F32] | None:
        """Return a box of the photo, the share of its light that is left there, and the
        added light, (h, w, 3), at a pose; None if both are invisible.
        """
        dx, dy = pose.x - start.x, pose.y - start.y
        # The object follows its floor; a larger rise lifts it off.
        rise = min(max(dy, -FOOT_HALO.steep * abs(dx)), FOOT_HALO.steep * abs(dx))
        lift = (dy - rise) / (SHADOW.lift * self.side)
        share = exp(-(hypot(lift, turn / SHADOW.turn) ** 2))
        if share < FOOT_HALO.faint:
            return None
        shift = (dx, rise)
        box, light = shifted_picture(self.light, self.corner, shift, size)
        _, shade = shifted_picture(self.shade, self.corner, shift, size)
        if box is None:
            return None
        columns = np.arange(box[0], box[2])
        is_floor = (columns >= self.ends[0]) & (columns <= self.ends[1])
        weight = (np.float32(share) * is_floor.astype(np.float32))[:, None]
        shape = (box[3] - box[1], box[2] - box[0], 3)
        factor = np.exp(-shade.reshape(shape) * weight).astype(np.float32)
        place = np.s_[box[1] : box[3], box[0] : box[2]]
        return place, factor, np.asarray(light.reshape(shape) * weight, np.float32)


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
    dark = np.minimum(moving - light, 0) / np.maximum(ground, FOOT_HALO.darkest)
    left = np.maximum(1 + dark, np.exp(-FOOT_HALO.deepest)).astype(np.float32)
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
    share = near * np.clip((evenness - low) / (high - low), 0, 1)
    dark = smooth + near * (np.minimum(smooth, 0) - smooth)
    moving = share * np.minimum(halo, 0) + (1 - share) * dark
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
