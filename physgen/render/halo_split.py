"""The part of a sprite's halo on the floor, apart from the part that stays in place."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.arrays import F32, F64, Mask
from physgen.geometry.shadows import Silhouette, floor_contact
from physgen.render.foot_halos import FOOT_HALO, FootHalo, Slices
from physgen.render.sprites import Sprite
from physgen.render.standing_shade import continue_into

TINY = 1e-9
"""Smallest divisor."""
LEAST = 1e-3
"""Largest invisible share of moving light."""
BLUR_REACH = 3
"""Standard deviations after which a blur ends."""


def split_halos(
    sprites: Sequence[Sprite],
    starts: Sequence[Silhouette],
    tilt: float,
    background: F32,
    *,
    is_mirror: bool,
    plate: F32 | None = None,
) -> list[Sprite]:
    """Return the sprites of a side view with the floor's part of their halos apart.

    `tilt`: rise of a floor's point in the picture per px of distance. `background`: linear
    light of the background, (H, W, 3). `is_mirror`: whether the background lacks
    mirror images, so that halos contain them. `plate`: `background` without the shadows
    that are drawn with objects; None if there are none.
    """
    ground = _Ground(background, background if plate is None else plate)
    moving: dict[int, _Moving] = {}
    for k, (sprite, start) in enumerate(zip(sprites, starts, strict=True)):
        contact = floor_contact(start, tilt)
        lift = FOOT_HALO.lift * start.coverage.shape[0]
        is_standing = contact is not None and contact.low < max(lift, 1)
        part = None
        if is_standing:
            part = _moving_part(sprite, start.ends, ground, is_mirror=is_mirror)
        if part is not None:
            moving[k] = part
    return _add_moving_halos(sprites, starts, moving, background)


@dataclass(frozen=True)
class _Ground:
    """Linear light of the background, (H, W, 3)."""

    background: F32
    """With the shadows that are drawn with objects."""
    plate: F32
    """In full light."""


def _add_moving_halos(
    sprites: Sequence[Sprite],
    starts: Sequence[Silhouette],
    moving: Mapping[int, _Moving],
    background: F32,
) -> list[Sprite]:
    """Return sprites with their `moving` light, by index, in foot halos."""
    # Shade multiplies the light of the next ground, and so keeps its grain. Where
    # shades overlap, their product is the shade of the photo.
    total_weight = np.full(background.shape[:2], np.float32(TINY))
    for part in moving.values():
        total_weight[part.box] += part.weight
    total_shade = np.zeros_like(background)
    for part in moving.values():
        share = (part.weight / total_weight[part.box])[..., None]
        total_shade[part.box] += share * part.shade
    result = list(sprites)
    for k, part in moving.items():
        sprite_halo = sprites[k].halo
        assert sprite_halo is not None
        share = (part.weight / total_weight[part.box])[..., None]
        whole_shade = total_shade[part.box]
        shade = np.asarray(share * whole_shade, np.float32)
        foot_halo = FootHalo(
            part.corner,
            part.light,
            shade,
            starts[k].ends,
            part.side,
            np.asarray(share[..., 0] * part.weight, np.float32),
            part.darkness,
        )
        # The halo keeps what shade and light do not explain: frame 0 is the photo.
        removed_light = background[part.box] * (1 - np.exp(-whole_shade)) * share
        corner, whole_halo, neighbours = sprite_halo
        rest = whole_halo.copy()
        rest[part.window] += removed_light - part.visible_light(sprites[k])
        result[k] = replace(
            _without_light_behind(sprites[k], part),
            halo=(corner, rest, neighbours),
            foot_halo=foot_halo,
        )
    return result


def _without_light_behind(sprite: Sprite, part: _Moving) -> Sprite:
    """Return a sprite whose soft border does not contain the light that moves behind
    it: frame 0 is the photo.
    """
    if sprite.rest is None:
        return sprite
    sprite_box, light_box = _common_slices(
        _box_at(sprite.corner, sprite.coverage), part.box
    )
    # The soft border of the object lets a share of the moving light through.
    coverage = sprite.coverage[sprite_box][..., None]
    visible_light = (1 - coverage) * part.light[light_box]
    rest = sprite.rest.copy()
    rest[sprite_box] -= np.where(coverage > 0, visible_light, 0)
    return replace(sprite, rest=rest)


def _common_slices(box: Slices, other_box: Slices) -> tuple[Slices, Slices]:
    """Return the common pixels of two boxes of the photo, in each of them."""
    box_slices, other_slices = [], []
    for span, other_span in zip(box, other_box, strict=True):
        start = max(span.start, other_span.start)
        stop = max(min(span.stop, other_span.stop), start)
        box_slices.append(slice(start - span.start, stop - span.start))
        other_slices.append(slice(start - other_span.start, stop - other_span.start))
    return (box_slices[0], box_slices[1]), (other_slices[0], other_slices[1])


@dataclass(frozen=True)
class _Moving:
    """The moving light of one halo."""

    corner: tuple[int, int]
    """Column and row of the photo."""
    window: Slices
    """Rows and columns of the halo."""
    light: F32
    """Added light, (h, w, 3)."""
    weight: F32
    """Share of the light that moves, (h, w), 0..1."""
    shade: F32
    """-log of the share of the background's light that is left, (h, w, 3)."""
    side: float
    """Smaller side of the object, px."""
    darkness: F32 | None = None
    """-log of the share of full light in the photo, (h, w, 3); None of a mirror
    image."""

    @property
    def box(self) -> Slices:
        """Return the rows and columns of the photo."""
        return _box_at(self.corner, self.weight)

    def visible_light(self, sprite: Sprite) -> F32:
        """Return the added light (h, w, 3) beside the object in the photo."""
        distance = sprite.halo_reach[self.window][..., None]
        return np.asarray(np.where(distance > 0, self.light, 0), np.float32)


def _box_at(corner: tuple[int, int], picture: F32) -> Slices:
    """Return the rows and columns of the photo that a picture covers."""
    x, y = corner
    height, width = picture.shape[:2]
    return np.s_[y : y + height, x : x + width]


def _moving_part(
    sprite: Sprite, ends: tuple[float, float], ground: _Ground, *, is_mirror: bool
) -> _Moving | None:
    """Return the part of a halo that moves with its object; None without any.

    `ends`: columns of both ends of the floor, px.
    """
    if sprite.halo is None:
        return None
    (x, y), halo, _ = sprite.halo
    weight = _floor_weight(sprite, (x, y), halo.shape[:2])
    if weight is None:
        return None
    # Light beyond the floor stays: `FootHalo.draw` does not draw it there.
    weight = weight * _floor_columns(x, halo.shape[1], ends)
    side = float(max(min(sprite.coverage.shape), 1))
    near = _nearness(sprite.halo_reach, side, is_mirror=is_mirror)
    if not is_mirror:
        weight = weight * near
    sigma = max(FOOT_HALO.blur_width * side, 1.0)
    window = _window_of(weight > LEAST, math.ceil(BLUR_REACH * sigma))
    if window is None:
        return None
    moving = _Moving(
        corner=(x + window[1].start, y + window[0].start),
        window=window,
        light=np.zeros_like(halo[window]),
        weight=np.asarray(weight[window], np.float32),
        shade=np.zeros_like(halo[window]),
        side=side,
    )
    blur = _GroundBlur(sprite.halo_reach[window], sigma)
    if is_mirror:
        light = _carried_light(halo[window], near[window], blur)
        light = light * moving.weight[..., None]
        distance = sprite.halo_reach[window]
        return replace(moving, light=_continue_below_base(light, distance))
    return _with_shade(moving, halo[window], ground, blur)


def _continue_below_base(light: F32, distance: F32) -> F32:
    """Return light (h, w, 3) that continues below an object, at `distance` 0 (h, w).

    A base that is lifted uncovers floor: a mirror image must not end there at the old
    outline. The thin contact shadow beside the outline does not continue.
    """
    continued_light = continue_into(light, distance < FOOT_HALO.ramp)
    result = np.where((distance == 0)[..., None], continued_light, light)
    return np.asarray(result, np.float32)


def _with_shade(
    moving: _Moving, halo: F32, ground: _Ground, blur: _GroundBlur
) -> _Moving:
    """Return the moving light of a halo (h, w, 3) with the shade of its ground."""
    ground = _Ground(ground.background[moving.box], ground.plate[moving.box])
    photo = ground.background + halo
    smooth_photo, smooth_plate = blur.blur_below(photo), blur.blur_below(ground.plate)
    # Detail that is dark all over is a rim that the mask lacks; other detail is the
    # grain of the ground. Under the soft border of the object, the halo is empty and
    # would leave a bright line: the shade beside it continues there.
    share = (_rim_share(halo, blur) * blur.known)[..., None]
    seen_light = share * photo + (1 - share) * smooth_photo
    full_light = share * ground.plate + (1 - share) * smooth_plate
    shade = _carried_shade(seen_light, full_light, ground) * moving.weight[..., None]
    # The rim of an object is no shade of its floor.
    darkness = _channel_darkness(smooth_photo, smooth_plate)
    return replace(moving, shade=shade, darkness=darkness)


def _floor_columns(left: int, width: int, ends: tuple[float, float]) -> Mask:
    """Return the mask (w,) of columns between both ends of a floor, px."""
    columns = left + np.arange(width)
    return np.asarray((columns >= ends[0]) & (columns <= ends[1]), np.bool_)


def _nearness(distance: F32, side: float, *, is_mirror: bool) -> F32:
    """Return the share 0..1 of light at a distance (h, w), px, that is an object's.

    `side`: the object's smaller side, px.
    """
    share = FOOT_HALO.rim if is_mirror else FOOT_HALO.shade
    reach = max(FOOT_HALO.ramp, share * side)
    return np.asarray(np.exp(-np.square(distance / reach)), np.float32)


def _carried_light(halo: F32, near_light: F32, blur: _GroundBlur) -> F32:
    """Return the light of a mirror image in a halo, (h, w, 3).

    Close to the outline, where `near_light` (h, w) is 1, light corrects the fill.
    """
    share = near_light[..., None]
    return np.asarray(share * halo + (1 - share) * blur.blur_below(halo), np.float32)


def _window_of(mask: Mask, margin: int) -> Slices | None:
    """Return the rows and columns of a mask with a margin; None of an empty mask."""
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    if not len(rows):
        return None
    window = []
    for places, size in ((rows, mask.shape[0]), (columns, mask.shape[1])):
        start = max(int(places[0]) - margin, 0)
        window.append(slice(start, min(int(places[-1]) + margin + 1, size)))
    return window[0], window[1]


class _GroundBlur:
    """Blur of the ground's light without the pixels of an object."""

    def __init__(self, distance: F32, sigma: float) -> None:
        """`distance` (h, w): px from the object. `sigma`: standard deviation, px."""
        self.sigma = sigma
        # Pixels of the object are unknown; the ground beside it continues below it.
        self.known = (distance > 0).astype(np.float32)
        blurred_known = cv2.GaussianBlur(self.known, (0, 0), self.sigma)
        self.gain = 1 / np.maximum(blurred_known, np.float32(0.05))

    def blur_below(self, picture: F32) -> F32:
        """Return a blurred picture (h, w, 3), continued below the object."""
        known_picture = picture * self.known[..., None]
        blurred_picture = cv2.GaussianBlur(known_picture, (0, 0), self.sigma)
        return np.asarray(blurred_picture * self.gain[..., None], np.float32)


def _carried_shade(seen_light: F32, full_light: F32, ground: _Ground) -> F32:
    """Return -log of the share of the background's light that an object leaves on its
    floor, (h, w, 3).

    The shade of the photo is the quotient of two blurred pictures, photo and ground in
    full light. The part of it that is drawn as a shadow is left out.
    """
    drawn_shade = _relative_darkness(ground.background, ground.plate)
    shade = _relative_darkness(seen_light, full_light) - drawn_shade
    # The drawn shadow is not brightened: it changes on its way, and would glow.
    shade = np.clip(shade, 0, FOOT_HALO.deepest)
    return np.repeat(shade[..., None], 3, axis=2)


def _channel_darkness(light: F32, full_light: F32) -> F32:
    """Return -log of the share of each channel that is left, (h, w, 3), at least 0."""
    least = np.float32(FOOT_HALO.darkest)
    ratio = np.maximum(full_light, least) / np.maximum(light, least)
    darkness = np.clip(np.log(ratio), 0, FOOT_HALO.deepest)
    return np.asarray(darkness, np.float32)


def _relative_darkness(light: F32, full_light: F32) -> F32:
    """Return -log of the share of the brightness that is left, (h, w), at least 0."""
    least = np.float32(FOOT_HALO.darkest)
    brightness = np.maximum(light.mean(axis=2), least)
    full_brightness = np.maximum(full_light.mean(axis=2), least)
    darkness = np.log(full_brightness / brightness)
    return np.asarray(np.maximum(darkness, 0), np.float32)


def _rim_share(halo: F32, blur: _GroundBlur) -> F32:
    """Return the likelihood 0..1 that dark detail is a rim that the mask lacks,
    (h, w).
    """
    mean = blur.blur_below(halo).mean(axis=2)
    power = cv2.GaussianBlur(np.square(halo.mean(axis=2)), (0, 0), blur.sigma)
    deviation = np.sqrt(power * blur.gain)
    low, high = FOOT_HALO.rim_ratio
    evenness = -mean / np.maximum(deviation, np.float32(1e-4))
    return np.asarray(np.clip((evenness - low) / (high - low), 0, 1), np.float32)


def _floor_weight(
    sprite: Sprite, corner: tuple[int, int], shape: tuple[int, ...]
) -> F32 | None:
    """Return the share (h, w) of a halo's pixels that lies on the floor; None without
    any visible pixel of the sprite.
    """
    solid = sprite.coverage > 0.5
    rows = np.flatnonzero(solid.any(axis=1))
    if not len(rows):
        return None
    height = float(np.ptp(rows)) + 1
    foot = sprite.corner[1] + float(rows[-1])
    top = foot - FOOT_HALO.legs * height
    begins = np.full(shape[1], foot - FOOT_HALO.floor_height * height)
    columns, own_begins = _lowest_rows(sprite, solid, corner[0], shape[1])
    begins[columns] = np.maximum(own_begins, top)
    is_own = np.zeros(shape[1], np.bool_)
    is_own[columns] = own_begins > top
    # Beside the outline, the floor begins softly.
    places = corner[1] + np.arange(shape[0])[:, None]
    below = places - begins[None]
    weight = np.clip(below / FOOT_HALO.ramp, 0, 1)
    weight = np.where(is_own[None], np.clip(below, 0, 1), weight)
    weight = weight * np.clip((places - top) / (FOOT_HALO.soft_top * height), 0, 1)
    reach = max(FOOT_HALO.side_reach * height, 1.0)
    return _spread_sideways(np.asarray(weight, np.float32), reach)


def _lowest_rows(
    sprite: Sprite, solid: Mask, left: int, width: int
) -> tuple[NDArray[np.intp], F64]:
    """Return the columns (n,) of a halo below an object, and the lowest row of the
    object in each, px of the photo.

    `solid` (h, w): mask of the sprite; `left` and `width`: columns of the halo.
    """
    columns = np.flatnonzero(solid.any(axis=0))
    lowest = solid.shape[0] - 1 - np.argmax(solid[::-1], axis=0)[columns]
    places = columns + sprite.corner[0] - left
    is_inside = (places >= 0) & (places < width)
    rows = np.asarray(sprite.corner[1] + lowest[is_inside], np.float64)
    return places[is_inside], rows


def _spread_sideways(weight: F32, reach: float) -> F32:
    """Return weights (h, w) that fade linearly over `reach` px along each row.

    The floor below an overhang continues beside it: without a fade, the shade below an
    apple or between legs would end at a vertical line and carry that line along.
    """
    # Columns are contiguous in memory here, which halves the time.
    columns = weight.T.copy()
    loss = np.float32(1 / reach)
    # One pass to the right and one to the left give the largest faded neighbour.
    for column, neighbour in zip(columns[1:], columns[:-1], strict=True):
        np.maximum(column, neighbour - loss, out=column)
    backwards = columns[::-1]
    for column, neighbour in zip(backwards[1:], backwards[:-1], strict=True):
        np.maximum(column, neighbour - loss, out=column)
    return np.ascontiguousarray(columns.T)
