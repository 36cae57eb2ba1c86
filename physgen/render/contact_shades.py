"""Contact shades of objects that may rock on their floors."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from physgen.arrays import F32, Mask
from physgen.geometry.shadows import PixelBox, floor_contact, joined_pictures
from physgen.render.foot_halos import FootHalo
from physgen.render.shadow_decomposition import (
    CastShadow,
    LitBackground,
    crop_to_visible,
)
from physgen.render.sprites import Sprite
from physgen.render.standing_shade import STANDING, split_contact_shade


def add_contact_shades(
    background: LitBackground, sprites: Sequence[Sprite]
) -> LitBackground:
    """Return a side view's background with the contact shades of standing objects.

    The shade at a base is that of the photo, as far as foot halos contain it.
    """
    casts = []
    for cast, sprite in zip(background.casts, sprites, strict=True):
        if _can_rock(cast, background.setting.tilt):
            cast = _with_contact_shade(cast, sprite.foot_halo, background)
        casts.append(cast)
    return replace(background, casts=casts)


def _can_rock(cast: CastShadow, tilt: float) -> bool:
    """Check whether an object may rock: it stands on its floor and is not round."""
    if cast.is_round or cast.picture is None:
        return False
    contact = floor_contact(cast.start, tilt)
    tolerance = STANDING.gap * cast.start.coverage.shape[0]
    return contact is not None and contact.low <= max(tolerance, 1.0)


def _with_contact_shade(
    cast: CastShadow, foot_halo: FootHalo | None, background: LitBackground
) -> CastShadow:
    """Return a cast with its contact shade."""
    assert cast.moving_picture is not None
    box, shade = cast.moving_picture
    # The cast has one darkness for all channels; its colour is that of the photo's
    # shadows.
    colours = shade[..., None] * background.tint
    measured_mask = np.zeros(shade.shape, np.bool_)
    if foot_halo is not None and foot_halo.darkness is not None:
        # Where the photo itself shows the shade at the foot, it replaces the model's.
        box, colours, measured_mask = _measured_shade(
            cast.moving_picture, foot_halo, background
        )
    parts = split_contact_shade(cast.start, box, colours, measured_mask)
    if parts is None:
        return cast
    contact, rest = parts
    beyond_contact = crop_to_visible(box, rest)
    if not beyond_contact[1].size:
        return replace(cast, contact=contact)
    return replace(cast, contact=contact, beyond_contact=beyond_contact)


def _measured_shade(
    shadow: tuple[PixelBox, F32], foot_halo: FootHalo, background: LitBackground
) -> tuple[PixelBox, F32, Mask]:
    """Return a box, the shade (h, w, 3) of an object in it, and the mask (h, w) of
    pixels with the photo's own shade.

    `shadow`: the shade without that of the foot halo.
    """
    assert foot_halo.darkness is not None
    weight = foot_halo.weight[..., None]
    (x, y), (height, width) = foot_halo.corner, weight.shape[:2]
    halo_box = (x, y, x + width, y + height)
    empty_shade = np.zeros((height, width), np.float32)
    box, shade = joined_pictures([shadow, (halo_box, empty_shade)])
    window = np.s_[y - box[1] : y - box[1] + height, x - box[0] : x - box[0] + width]
    # The foot halo contains the shades of neighbours, too, which stay with them.
    others = background.total[y : y + height, x : x + width] - shade[window]
    other_colours = others[..., None] * background.tint
    colours = shade[..., None] * background.tint
    own_darkness = np.maximum(foot_halo.darkness - other_colours, 0)
    colours[window] += weight * (own_darkness - colours[window])
    measured_mask = np.zeros(shade.shape, np.bool_)
    measured_mask[window] = foot_halo.weight > MEASURED_WEIGHT
    return box, np.asarray(colours, np.float32), measured_mask


MEASURED_WEIGHT = 0.5
"""Weight in a foot halo from which the shade of a pixel is that of the photo."""
