"""Assignment of shadow pixels to the objects that cast them.

A shadow lies where light was removed; its owner is the object that blocks most light from the place. Where geometry
predicts no shadow, the place goes to the owner of the nearest that it predicts.
"""

from __future__ import annotations

from collections.abc import Iterable

import cv2
import numpy as np

from physgen.geometry.shadows import PixelBox
from physgen.perceive.roles import F32, Labels, Mask, Rgb
from physgen.perceive.shadow.silhouettes import DARKEST, away_from_objects
from physgen.photometry import decode, luminance

FAINT = 0.08  # -log of light, smoothed: less is no visible shadow
PREDICTED = 0.02  # -log of light from which geometry predicts a shadow
SHARE = 0.3  # weight of geometry: the photo alone leaves the soft ends of shadows to its grain
SMOOTH = 2.0  # px: standard deviation of the blur; finer detail is grain
SPECK = 16  # px: a smaller patch is none


def shadow_owners(
    background: Rgb, clean: Rgb, coverage: F32, casts: Iterable[tuple[int, PixelBox, F32]]
) -> Labels | None:
    """(H, W) the id of the object whose shadow lies there, 0 = none; None where no shadow is seen.

    `casts`: of each object its id and -log of the light that it leaves in a box of the photo.
    """
    owner, most = _strongest(casts, coverage.shape)
    dark = (1 - SHARE) * removed_light(background, clean, coverage) + SHARE * most > FAINT
    return assign_regions(dark & (coverage < 0.5), owner)


def shadow_owners_by_model(
    coverage: F32, casts: Iterable[tuple[int, PixelBox, F32]], dark: F32
) -> Labels | None:
    """The same where `dark` (H, W), -log of light, is known, and the photo too coarse to say more."""
    owner, _ = _strongest(casts, coverage.shape)
    return assign_regions((dark > FAINT) & (coverage < 0.5), owner)


def _strongest(casts: Iterable[tuple[int, PixelBox, F32]], shape: tuple[int, ...]) -> tuple[Labels, F32]:
    """(H, W) the object that blocks most light, and -log of the light left."""
    owner, most = np.zeros(shape, np.uint16), np.zeros(shape, np.float32)
    for number, (x0, y0, x1, y1), values in casts:
        part = np.s_[y0:y1, x0:x1]
        more = values > np.maximum(most[part], PREDICTED)
        owner[part][more] = number
        most[part][more] = values[more]
    return owner, most


def removed_light(background: Rgb, clean: Rgb, coverage: F32) -> F32:
    """(H, W) -log of light that was removed, smooth; right beside objects, where none is, the light missing there.

    Contact shadows lie there.
    """
    logs = [np.log(luminance(decode(picture)) + DARKEST) for picture in (clean, background)]
    free = away_from_objects(coverage).astype(np.float32)
    near = np.maximum(cv2.GaussianBlur(free, (0, 0), SMOOTH), 1e-2)
    removed, level = (
        cv2.GaussianBlur(part.astype(np.float32) * free, (0, 0), SMOOTH) / near
        for part in (logs[0] - logs[1], logs[0])
    )
    contact = np.where((free == 0) & (near > 0.05), level - cv2.GaussianBlur(logs[1], (0, 0), 0.7), 0)
    return np.asarray(np.maximum(removed, contact), np.float32)


def assign_regions(dark: Mask, owner: Labels) -> Labels | None:
    """`owner` (H, W) where it is `dark`, elsewhere the nearest; specks left out. None where nothing is left."""
    if not owner.any():
        return None
    count, names, stats, _ = cv2.connectedComponentsWithStats(dark.astype(np.uint8), connectivity=8)
    owned = np.bincount(names[owner > 0], minlength=count) > 0  # a patch that no object predicts is no shadow
    kept = owned & (stats[:, cv2.CC_STAT_AREA] >= SPECK)
    kept[0] = False
    there = kept[names]
    if not there.any():
        return None
    _, nearest = cv2.distanceTransformWithLabels(
        (owner == 0).astype(np.uint8), cv2.DIST_L2, 5, labelType=cv2.DIST_LABEL_PIXEL
    )
    ids = np.zeros(int(nearest.max()) + 1, np.uint16)
    ids[nearest[owner > 0]] = owner[owner > 0]
    return np.where(there, ids[nearest], 0).astype(np.uint16)
