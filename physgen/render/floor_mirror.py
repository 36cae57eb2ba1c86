"""Measurement of the reflections of objects on their floor."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from physgen.arrays import F32
from physgen.geometry.polygon import Array
from physgen.geometry.shadows import Silhouette, floor_contact
from physgen.render.sprites import (
    MARGIN,
    Sprite,
)
from physgen.render.stage import Mirror


@dataclass(frozen=True)
class MirrorTuning:
    """Rows and correlation of reflections."""

    rows: int = 60
    """Rows below an object's foot in which a reflection is measured, px."""
    foot_rows: int = 4
    """Rows of these that objects' blurred rims and contact shadows may disturb, px."""
    correlation: float = 0.7
    """Correlation with the upside-down object above which a floor mirrors it."""


MIRROR = MirrorTuning()


def floor_mirror(
    sprites: Sequence[Sprite],
    starts: Sequence[Silhouette],
    reflections: F32,
    coverage: F32,
    tilt: float,
) -> Mirror | None:
    """Measure the reflections of objects on their floor.

    `reflections` (H, W, 3): linear light of the photo beyond the background. None
    unless they resemble the objects upside down.
    """
    # Sums over pixels of object x reflection, object², reflection², by row below the
    # foot, give the regression and the correlation of each row.
    sums = np.zeros((3, MIRROR.rows))
    feet: list[tuple[int, float, float] | None] = []
    for sprite, start in zip(sprites, starts, strict=True):
        foot = _standing_foot(sprite, start, tilt)
        feet.append(None if foot is None else (foot, *start.ends))
        if foot is not None:
            _add_reflection(sums, sprite, foot, reflections, coverage)
    share = sums[0] / np.maximum(sums[1], 1e-6)
    correlation = sums[0] / np.sqrt(sums[1] * sums[2] + 1e-12)
    count = len(share)
    unlike_rows = np.flatnonzero(correlation[MIRROR.foot_rows :] < MIRROR.correlation)
    if len(unlike_rows):
        count = MIRROR.foot_rows + int(unlike_rows[0])
    if count < 3 * MIRROR.foot_rows:
        return None
    fade = np.minimum(np.arange(count, 0, -1) / (2 * MIRROR.foot_rows), 1)
    return Mirror((np.maximum(share[:count], 0) * fade).astype(np.float32), feet)


def _standing_foot(sprite: Sprite, start: Silhouette, tilt: float) -> int | None:
    """Return the last row of a sprite that stands on a floor, in the photo;
    else None.
    """
    rows = np.flatnonzero((sprite.coverage > 0.5).any(axis=1))
    contact = floor_contact(start, tilt)
    if contact is None or not len(rows) or contact.low >= 1:
        return None
    return sprite.corner[1] + int(rows[-1])


def _add_reflection(
    sums: Array, sprite: Sprite, foot: int, reflections: F32, coverage: F32
) -> None:
    """Add the products of the upside-down sprite and the photo below its foot,
    by row.
    """
    left = sprite.corner[0] + MARGIN
    first_row = foot + 1
    last_row = foot - sprite.corner[1]
    flipped_sprite = sprite.light[last_row::-1, MARGIN:-MARGIN][: MIRROR.rows]
    height, width = flipped_sprite.shape[:2]
    place = np.s_[first_row : first_row + height, left : left + width]
    # Compare only pixels of the bare floor, not of other objects.
    is_floor = (coverage[place] == 0)[..., None]
    reflection = reflections[place] * is_floor
    count = len(reflection)
    flipped_sprite = flipped_sprite[:count] * is_floor
    products = (
        flipped_sprite * reflection,
        flipped_sprite * flipped_sprite,
        reflection * reflection,
    )
    for total, product in zip(sums, products, strict=True):
        total[:count] += product.sum(axis=(1, 2))
