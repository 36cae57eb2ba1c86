"""Highlights that stay in the picture while their discs turn.

A highlight of a disc and a mark on it look alike. Discs of one set tell them apart:
their marks are turned differently, and their highlights are on one side of each.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import pi, radians

import cv2
import numpy as np

from physgen.arrays import F32, Mask


@dataclass(frozen=True)
class HighlightTuning:
    """Limits of the separation of highlights and paint."""

    discs: int = 4
    """Least number of discs that tell light from paint."""
    angles: int = 240
    """Number of directions on a ring."""
    width: float = 0.3
    """Largest width of a highlight, radii."""
    least_light: float = 0.12
    """Least light of a highlight beyond the paint beneath it."""
    paint: float = 90.0
    """Percentile of a disc's white light that is still paint."""
    dark_light: float = 0.05
    """Linear light added before logarithms, so that dark rings count less."""
    side: float = 50.0
    """Largest difference of the directions of two discs' highlights, degrees: a lamp
    may be near.
    """
    rings: float = 0.1
    """Largest difference of their distances from the centre, radii."""
    common: float = 0.7
    """Least share of the discs with a highlight there."""
    border_width: float = 1.0
    """Width of a highlight's border, px."""
    differ: float = 0.5
    """Least variance between discs over that of their median: with less, their paints
    may be turned alike.
    """
    ring_share: float = 0.99
    """Share of a sample on a ring from which all its pixels are known."""
    unknown: float = 0.5
    """Share of unknown samples from which a disc is not compared with the others."""


SHINE = HighlightTuning()


@dataclass(frozen=True)
class DiscPicture:
    """The picture of a disc in the view from above."""

    light: F32
    """Linear light, (h, w, 3)."""
    mask: Mask
    """Pixels that show the disc alone, (h, w)."""
    center: tuple[float, float]
    """Centre, px of the picture."""
    radius: float


def shared_highlights(discs: Sequence[DiscPicture]) -> list[F32]:
    """Return the light (h, w, 3) of the highlights on each of a set of discs.

    The list is empty if there are too few discs, or if their paints are not turned
    differently.
    """
    if len(discs) < SHINE.discs:
        return []
    excess = list(map(_excess, discs))
    # In the discs' own frames, paint turns with each disc, and a highlight does not.
    masks = []
    for disc, shine in zip(discs, excess, strict=True):
        masks.append(_unroll(_is_highlight(disc, shine), disc))
    if not _turned_differently(discs):
        return []
    # Bright pixels at the same place on most discs are light.
    is_shared = np.mean(list(map(_spread, masks)), axis=0) >= SHINE.common
    highlights = []
    for disc, mask, shine in zip(discs, masks, excess, strict=True):
        share = _roll(np.where(is_shared, mask, 0).astype(np.float32), disc)
        white = np.repeat((shine * share)[..., None], 3, axis=2)
        highlights.append(np.asarray(white, np.float32))
    return highlights


def _excess(disc: DiscPicture) -> F32:
    """Return the white light (h, w) of bright spots up to `SHINE.width`.

    A highlight is white on any paint: it is what all channels have in common.
    """
    width = max(round(SHINE.width * disc.radius), 2)
    spot = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * width + 1,) * 2)
    white = np.where(disc.mask, disc.light.min(axis=2), 0).astype(np.float32)
    # Grain is no highlight: the median takes it out of the light beneath.
    beneath = cv2.morphologyEx(cv2.medianBlur(white, 3), cv2.MORPH_OPEN, spot)
    return np.asarray(np.maximum(white - beneath, 0), np.float32)


def _is_highlight(disc: DiscPicture, excess: F32) -> Mask:
    """Return the bright spots (h, w) that outshine the paint of the whole disc."""
    white = disc.light.min(axis=2)
    if not disc.mask.any():
        return disc.mask
    paint = np.percentile(white[disc.mask], SHINE.paint)
    is_bright = (excess > SHINE.least_light) & (white > paint + SHINE.least_light / 2)
    return np.asarray(is_bright & disc.mask, np.bool_)


def _turned_differently(discs: Sequence[DiscPicture]) -> bool:
    """Check whether discs differ more than their median changes along rings.

    Pixels outside a disc's picture, or of other objects, have no part in it; discs with
    few others are left out.
    """
    levels = []
    for disc in discs:
        is_unknown = _unroll(disc.mask, disc) < SHINE.ring_share
        if is_unknown.mean() > SHINE.unknown:
            continue
        brightness = disc.light.mean(axis=2) + np.float32(SHINE.dark_light)
        ring = np.ma.masked_array(_unroll(brightness, disc), is_unknown)
        levels.append(np.ma.log(ring / ring.mean(axis=1, keepdims=True)))
    if len(levels) < SHINE.discs:
        return False
    level = np.ma.stack(levels)
    median = np.median(level.filled(0), axis=0)
    variance = ((level - median) ** 2).mean()
    return bool(variance >= SHINE.differ * float((median**2).mean()))


RINGS = 32
"""Number of rings of a disc."""


def _unroll(picture: F32 | Mask, disc: DiscPicture) -> F32:
    """Return a picture (h, w) on `RINGS` rings, (rings, angles)."""
    angle = np.arange(SHINE.angles) * (2 * pi / SHINE.angles)
    distance = (np.arange(RINGS)[:, None] + 0.5) * (disc.radius / RINGS)
    offset_x = distance * np.cos(angle)
    offset_y = distance * np.sin(angle)
    x = (offset_x + disc.center[0]).astype(np.float32)
    y = (offset_y + disc.center[1]).astype(np.float32)
    values = cv2.remap(picture.astype(np.float32), x, y, cv2.INTER_LINEAR)
    return np.asarray(values, np.float32)


def _spread(mask: F32) -> Mask:
    """Return a mask (rings, angles) grown to all places that another disc may have."""
    around = max(round(radians(SHINE.side) / (2 * pi) * SHINE.angles), 1)
    across = max(round(SHINE.rings * RINGS), 1)
    wrapped_mask = np.concatenate([mask[:, -around:], mask, mask[:, :around]], axis=1)
    kernel = np.ones((2 * across + 1, 2 * around + 1), np.uint8)
    grown_mask = cv2.dilate((wrapped_mask > 0.5).astype(np.uint8), kernel)
    return np.asarray(grown_mask[:, around:-around] > 0, np.bool_)


def _roll(rings: F32, disc: DiscPicture) -> F32:
    """Return (rings, angles) as a picture (h, w) with soft borders."""
    rows, columns = np.indices(disc.mask.shape, np.float32)
    x = columns - disc.center[0]
    y = rows - disc.center[1]
    ring = np.hypot(x, y) * np.float32(RINGS / disc.radius) - np.float32(0.5)
    turn = np.arctan2(y, x) % np.float32(2 * pi)
    angle = turn * np.float32(SHINE.angles / (2 * pi))
    # One more column, so that interpolation goes around.
    wrapped_rings = np.concatenate([rings, rings[:, :1]], axis=1)
    picture = cv2.remap(wrapped_rings, angle, ring, cv2.INTER_LINEAR)
    wide_picture = cv2.dilate(picture, np.ones((3, 3), np.uint8))
    return np.asarray(
        cv2.GaussianBlur(wide_picture, (0, 0), SHINE.border_width), np.float32
    )
