"""The opening of a vessel whose lid or neighbour leaves.

From slightly above, the opening is an ellipse: a bright rim around the far inner wall,
which is darker than the outer one, and lit from the other side.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import atan, sin

import cv2
import numpy as np

from physgen.arrays import F32, U16, Mask
from physgen.compile.world import Body
from physgen.render.box_faces import labels_on_box
from physgen.render.sprites import MARGIN, Sprite


@dataclass(frozen=True)
class VesselTuning:
    """Shape and light of an opening."""

    rim_height: float = 0.04
    """Share of a vessel's height below its top within which points are on its rim."""
    widest: float = 0.5
    """Least width of an opening, shares of the vessel's width."""
    foot_height: float = 0.1
    """Share of a vessel's height above its bottom that is its foot."""
    flare: float = 1.05
    """Largest width of the foot over that of the opening; more is upside down."""
    least_height: float = 1.5
    """Least height of an opening's ellipse above its middle, px."""
    hidden_share: float = 0.6
    """Least share of an opening behind other objects."""
    wall: float = 0.3
    """Rows below the opening that show the light of the wall, shares of its width."""
    rim_width: float = 0.05
    """Width of the rim, shares of the opening's width; at least 1 px."""
    rim_gain: float = 1.12
    """Light of the rim over that of the wall: it faces upwards."""
    far_shade: float = 0.72
    """Light of the inner wall at the far rim over that of the outer wall."""
    near_shade: float = 0.42
    """The same at the near rim, deeper in the vessel."""
    fewest_visible: int = 20
    """Least number of visible pixels inside an opening that set its brightness."""
    most_light: float = 0.95
    """Largest linear light of a rim."""
    subpixels: int = 4
    """Sub-pixels per side."""
    blur_width: float = 3.0
    """Width of smoothing along the wall, px."""


VESSEL = VesselTuning()
# Around the load of a saucer or a plate, the inside is visible and nearly as bright as
# the outside.
SHALLOW_VESSEL = VesselTuning(
    hidden_share=0.3, wall=0.1, rim_width=0.02, far_shade=0.98, near_shade=0.86
)


@dataclass(frozen=True)
class Opening:
    """The ellipse of an opening, px of its sprite."""

    x: float
    y: float
    half_width: float
    half_height: float


def opening_of(body: Body, corner: Sequence[int], tilt: float) -> Opening | None:
    """Return the opening at the top of a vessel's shape; None if it is not visible, or
    if the vessel is upside down.

    `corner`: column and row of the sprite; `tilt`: tangent of the camera's angle above
    the horizon.
    """
    if not body.rings:
        return None
    points = np.concatenate(body.rings) + body.center - np.asarray(corner)
    (left, top), (right, bottom) = points.min(axis=0), points.max(axis=0)
    is_rim = points[:, 1] < top + VESSEL.rim_height * (bottom - top)
    start = points[is_rim, 0].min()
    end = points[is_rim, 0].max()
    foot = points[points[:, 1] > bottom - VESSEL.foot_height * (bottom - top), 0]
    half_width = (end - start) / 2
    half_height = half_width * sin(atan(tilt))
    least_width = max(VESSEL.widest * (right - left), np.ptp(foot) / VESSEL.flare)
    if end - start < least_width or half_height < VESSEL.least_height:
        return None
    return Opening((start + end) / 2, float(top), half_width, half_height)


def with_room_for_opening(
    sprite: Sprite,
    body: Body,
    labels: U16,
    tilt: float,
    bodies: Sequence[int] = (),
    tuning: VesselTuning = VESSEL,
) -> Sprite:
    """Return a vessel's sprite with empty rows above, for the far rim of an opening
    that `open_vessel` will draw.

    The rows end at the border of the photo.
    """
    opening = opening_of(body, sprite.corner, tilt)
    if opening is None:
        return sprite
    rows = MARGIN + round(opening.half_height - opening.y) + 1
    rows = max(min(rows, sprite.corner[1] + MARGIN), 0)
    roomy_sprite = _extend_upwards(sprite, rows)
    opening = replace(opening, y=opening.y + rows)
    if not _is_covered(_others(roomy_sprite, labels, bodies), opening, tuning):
        return sprite
    return roomy_sprite


def open_vessel(
    sprite: Sprite,
    body: Body,
    labels: U16,
    tilt: float,
    bodies: Sequence[int] = (),
    tuning: VesselTuning = VESSEL,
) -> Sprite:
    """Return a vessel's sprite with its opening, if other objects hide it in the photo.

    `labels` (H, W): id k + 1 is body k; `bodies`: those that may hide it, and itself;
    all if empty. The sprite has the room of
    `with_room_for_opening`.
    """
    opening = opening_of(body, sprite.corner, tilt)
    if opening is None:
        return sprite
    hidden_mask = _others(sprite, labels, bodies)
    if not _is_covered(hidden_mask, opening, tuning):
        return sprite
    wall = _wall_light(sprite, opening, tuning)
    if wall is None:
        return sprite
    light, cover = _draw(wall, sprite.coverage.shape, opening, tuning)
    if tuning is SHALLOW_VESSEL:
        light = light * _visible_gain(sprite, hidden_mask, light, cover)
    # Pixels beside the border of the other object are mixtures, and stay.
    share = cv2.erode(hidden_mask.astype(np.uint8), np.ones((3, 3), np.uint8))
    share = cv2.blur(share.astype(np.float32), (3, 3))
    cover = cover * share
    light = light * share[..., None]
    return replace(
        sprite,
        light=np.asarray(sprite.light * (1 - cover[..., None]) + light, np.float32),
        coverage=np.asarray(sprite.coverage * (1 - cover) + cover, np.float32),
    )


def _visible_gain(sprite: Sprite, hidden_mask: Mask, light: F32, cover: F32) -> F32:
    """Return the light (3,) of the visible part of an inside over the drawn `light`.

    `light` (h, w, 3) times coverage `cover` (h, w); `hidden_mask` (h, w): other objects.
    """
    is_near_other = (
        cv2.dilate(hidden_mask.astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
    )
    is_visible = (cover >= 1) & (sprite.coverage >= 1) & ~is_near_other
    if np.count_nonzero(is_visible) < VESSEL.fewest_visible:
        return np.ones(3, np.float32)
    actual_light = np.median(sprite.light[is_visible], axis=0)
    drawn_light = np.median(light[is_visible], axis=0)
    return np.asarray(actual_light / np.maximum(drawn_light, 1e-3), np.float32)


def _is_covered(hidden_mask: Mask, opening: Opening, tuning: VesselTuning) -> bool:
    """Check whether other objects cover most of an opening."""
    is_inside = _size(hidden_mask.shape, opening, 0.0, 1) <= 1
    share = hidden_mask[is_inside].mean() if is_inside.any() else 0.0
    return bool(share >= tuning.hidden_share)


def _extend_upwards(sprite: Sprite, rows: int) -> Sprite:
    """Return a sprite with empty rows above."""
    if not rows:
        return sprite
    hider = sprite.hider
    if hider is not None:
        hider = np.pad(hider, ((rows, 0), (0, 0)))
    return replace(
        sprite,
        corner=(sprite.corner[0], sprite.corner[1] - rows),
        light=np.pad(sprite.light, ((rows, 0), (0, 0), (0, 0))),
        coverage=np.pad(sprite.coverage, ((rows, 0), (0, 0))),
        hider=hider,
    )


def _others(sprite: Sprite, labels: U16, bodies: Sequence[int]) -> Mask:
    """Return the pixels (h, w) of a sprite's box that show other objects."""
    numbers = labels_on_box(sprite, labels, bodies)
    return np.asarray((numbers > 0) & (numbers != sprite.body + 1), np.bool_)


def _size(
    shape: tuple[int, ...], opening: Opening, thickness: float, subpixels: int
) -> F32:
    """Return the squared distance from an opening's middle, 1 at the ellipse inside the
    rim of a `thickness`, px; (h * subpixels, w * subpixels).
    """
    height = shape[0] * subpixels
    width = shape[1] * subpixels
    x = ((np.arange(width) + 0.5) / subpixels - 0.5 - opening.x) / (
        opening.half_width - thickness
    )
    # The near and the far rim are foreshortened.
    foreshortening = opening.half_height / opening.half_width
    half_height = opening.half_height - thickness * max(foreshortening, 0.5)
    y = ((np.arange(height) + 0.5) / subpixels - 0.5 - opening.y) / max(
        half_height, 0.5
    )
    return np.asarray(x * x + (y * y)[:, None], np.float32)


def _wall_light(sprite: Sprite, opening: Opening, tuning: VesselTuning) -> F32 | None:
    """Return the light of the outer wall below the near rim by column, (w, 3)."""
    first = round(opening.y + opening.half_height) + 2
    last = first + max(round(2 * tuning.wall * opening.half_width), 3)
    is_wall = (sprite.coverage[first:last] >= 1).astype(np.float32)
    if is_wall.sum() < opening.half_width:
        return None
    weight = is_wall.sum(axis=0)[None]
    wall_light = sprite.light[first:last] * is_wall[..., None]
    total = wall_light.sum(axis=0)[None]
    weight = cv2.GaussianBlur(weight, (0, 0), VESSEL.blur_width)
    total = cv2.GaussianBlur(total, (0, 0), VESSEL.blur_width)
    light = total / np.maximum(weight, 1e-3)[..., None]
    known_columns = np.flatnonzero(weight[0] > VESSEL.blur_width)
    if not len(known_columns):
        return None
    columns = np.clip(
        np.arange(light.shape[1]), known_columns.min(), known_columns.max()
    )
    return np.asarray(light[0][columns], np.float32)


def _draw(
    wall: F32, shape: tuple[int, ...], opening: Opening, tuning: VesselTuning
) -> tuple[F32, F32]:
    """Return light times coverage (h, w, 3) and coverage (h, w) of an opening."""
    thickness = max(2 * tuning.rim_width * opening.half_width, 1.0)
    outer = _coverage(shape, opening, 0.0)
    inner = _coverage(shape, opening, thickness)
    # The inner wall faces the outer one on the other side of the axis.
    columns = np.arange(shape[1])
    mirror_columns = np.clip(np.rint(2 * opening.x - columns), 0, shape[1] - 1).astype(
        int
    )
    depth = (np.arange(shape[0]) - opening.y) / (2 * opening.half_height) + 0.5
    depth = np.clip(depth, 0, 1)
    shade = tuning.far_shade + (tuning.near_shade - tuning.far_shade) * depth
    inside = shade[:, None, None] * wall[mirror_columns]
    rim = np.minimum(VESSEL.rim_gain * wall, max(VESSEL.most_light, float(wall.max())))
    light = inner[..., None] * inside + (outer - inner)[..., None] * rim
    return np.asarray(light, np.float32), outer


def _coverage(shape: tuple[int, ...], opening: Opening, thickness: float) -> F32:
    """Return the coverage (h, w) of the ellipse inside a rim."""
    is_inside = _size(shape, opening, thickness, VESSEL.subpixels) <= 1
    size = (shape[1], shape[0])
    small = cv2.resize(is_inside.astype(np.float32), size, interpolation=cv2.INTER_AREA)
    return np.asarray(small, np.float32)
