"""Owners of shadows.

A shadow lies where light was added; its owner is the object that blocks most light
there, or else at the nearest predicted place.
"""

from __future__ import annotations

from collections.abc import Iterable

import cv2
import numpy as np

from physgen.geometry.shadows import PixelBox
from physgen.maps import F32
from physgen.perceive.roles import Labels, Mask, Rgb
from physgen.perceive.shadow.shadow_removal import FAINT
from physgen.perceive.shadow.silhouettes import DARKEST, away_from_objects
from physgen.photometry import decode, luminance

# Least -log of light of a predicted shadow.
PREDICTED = 0.02
# Weight of geometry: with the photo alone, grain would decide the soft ends of shadows.
SHARE = 0.3
# px: standard deviation of the blur; finer detail is grain.
SMOOTH = 2.0
# px: smaller patches are noise.
SPECK = 16


def shadow_owners(
    background: Rgb,
    clean: Rgb,
    coverage: F32,
    casts: Iterable[tuple[int, PixelBox, F32]],
) -> Labels | None:
    """Return the id (H, W) of the object that casts each shadow, 0 = none, or None.

    `casts` gives, per object, its id and -log of its remaining light in a box of the
    photo. None means that no shadow is visible.
    """
    owner, strongest = _strongest(casts, coverage.shape)
    shadow_mask = (1 - SHARE) * removed_light(
        background, clean, coverage
    ) + SHARE * strongest > FAINT
    return assign_regions(shadow_mask & (coverage < 0.5), owner)


def shadow_owners_by_model(
    coverage: F32, casts: Iterable[tuple[int, PixelBox, F32]], dark: F32
) -> Labels | None:
    """Return the owners if `dark` (H, W), -log of light, is known from the model.

    The photo is then too coarse to correct the model.
    """
    owner, _ = _strongest(casts, coverage.shape)
    return assign_regions((dark > FAINT) & (coverage < 0.5), owner)


def _strongest(
    casts: Iterable[tuple[int, PixelBox, F32]], shape: tuple[int, ...]
) -> tuple[Labels, F32]:
    """Return the object (H, W) that blocks most light, and -log of the remaining
    light.
    """
    owner = np.zeros(shape, np.uint16)
    strongest = np.zeros(shape, np.float32)
    for number, (x0, y0, x1, y1), values in casts:
        part = np.s_[y0:y1, x0:x1]
        is_stronger = values > np.maximum(strongest[part], PREDICTED)
        owner[part][is_stronger] = number
        strongest[part][is_stronger] = values[is_stronger]
    return owner, strongest


def removed_light(background: Rgb, clean: Rgb, coverage: F32) -> F32:
    """Return -log (H, W) of the removed light, smoothed.

    Directly beside objects, where none is removed, the missing light counts: contact
    shadows lie there.
    """
    logs = []
    for picture in (clean, background):
        logs.append(np.log(luminance(decode(picture)) + DARKEST))
    free = away_from_objects(coverage).astype(np.float32)
    known_share = np.maximum(cv2.GaussianBlur(free, (0, 0), SMOOTH), 1e-2)
    free_gain = (logs[0] - logs[1]).astype(np.float32) * free
    log_gain = cv2.GaussianBlur(free_gain, (0, 0), SMOOTH) / known_share
    free_light = logs[0].astype(np.float32) * free
    level = cv2.GaussianBlur(free_light, (0, 0), SMOOTH) / known_share
    is_beside = (free == 0) & (known_share > 0.05)
    missing_light = level - cv2.GaussianBlur(logs[1], (0, 0), 0.7)
    contact = np.where(is_beside, missing_light, 0)
    return np.asarray(np.maximum(log_gain, contact), np.float32)


def assign_regions(dark: Mask, owner: Labels) -> Labels | None:
    """Return `owner` (H, W) inside `dark` regions, elsewhere in them the nearest owner,
    or None.

    Specks are removed.
    """
    if not owner.any():
        return None
    count, names, stats, _ = cv2.connectedComponentsWithStats(
        dark.astype(np.uint8), connectivity=8
    )
    # A patch that no object predicts is not a shadow.
    has_owner = np.bincount(names[owner > 0], minlength=count) > 0
    valid_patches = has_owner & (stats[:, cv2.CC_STAT_AREA] >= SPECK)
    valid_patches[0] = False
    region = valid_patches[names]
    if not region.any():
        return None
    _, nearest = cv2.distanceTransformWithLabels(
        (owner == 0).astype(np.uint8), cv2.DIST_L2, 5, labelType=cv2.DIST_LABEL_PIXEL
    )
    ids = np.zeros(int(nearest.max()) + 1, np.uint16)
    ids[nearest[owner > 0]] = owner[owner > 0]
    return np.where(region, ids[nearest], 0).astype(np.uint16)
