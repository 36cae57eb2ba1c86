"""Inpainting by a generative model in windows around the hole, blended into the
photo.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.maps import F32
from physgen.perceive.inpaint.poisson import blend_at_border, harmonic_fill
from physgen.perceive.roles import Rgb

Mask = NDArray[np.bool_]
Painter = Callable[[Rgb, Mask], Rgb]
"""Return a picture (h, w, 3) uint8 for a picture (h, w, 3) and a hole (h, w); pixels
outside the hole may change.
"""

CONTACT = 20 / 512
"""Margin around an object, as a share of the photo's longer side, that is painted
because of contact shadow.

The paper dilates by a kernel of 40 px at 512 px (appendix, background inpainting).
"""
EVEN = 4.0
"""px: standard deviation of the blur for the separation of colour shift and detail."""


def inpaint_windows(rgb: Rgb, hole: Mask, paint: Painter, least: int) -> Rgb:
    """Return `rgb` with `hole` (H, W) painted; other pixels are unchanged.

    Contact shadows around the hole are painted as well, so that they do not continue
    into it. Windows are at least `least` px wide and high if the photo is. A shift of
    colour between painting and photo is removed. If the hole is empty or covers the
    photo, the photo is returned.
    """
    if not hole.any() or hole.all():
        return rgb.copy()
    wide_hole = widen(hole)
    picture = rgb.astype(np.float32)
    # A model sees one window per piece, large enough for context.
    for part in windows(wide_hole, least):
        strokes = paint(rgb[part], wide_hole[part])
        picture[part] = strokes + _shift(rgb[part], strokes, wide_hole[part])
    return blend_at_border(picture, rgb, hole)


def widen(hole: Mask) -> Mask:
    """Return the hole with the contact shadows around it.

    The margin is reduced if it would cover the photo.
    """
    distance = cv2.distanceTransform(1 - hole.astype(np.uint8), cv2.DIST_L2, 5)
    reach = CONTACT * max(hole.shape)
    while reach > 1:
        wide_hole = distance <= reach
        if not wide_hole.all():
            return np.asarray(wide_hole)
        reach /= 2
    return hole


def windows(hole: Mask, least: int) -> list[tuple[slice, slice]]:
    """Return rows and columns of windows twice as large as the pieces of `hole` (H, W).

    Windows do not overlap and are at least `least` px high and wide if the photo is.
    """
    canvas = np.zeros_like(hole)
    for rows, columns in _rectangles(hole):
        canvas[
            _extend_span(rows, hole.shape[0], least),
            _extend_span(columns, hole.shape[1], least),
        ] = True
    # Merge touching windows until none touch.
    while True:
        rectangles = _rectangles(canvas)
        before = np.count_nonzero(canvas)
        for part in rectangles:
            canvas[part] = True
        if np.count_nonzero(canvas) == before:
            return rectangles


def model_size(shape: tuple[int, ...], native: int, step: int) -> tuple[int, int]:
    """Return the size for a model of `native` px squared, in multiples of `step`.

    `shape` (H, W) is the size of the window.

    >>> model_size((300, 400), 512, 16)
    (448, 592)
    """
    scale = min(native / math.sqrt(shape[0] * shape[1]), 2 * native / max(shape[:2]))
    model_height, model_width = (
        max(2, round(side * scale / step)) * step for side in shape[:2]
    )
    return model_height, model_width


def resize_window(rgb: Rgb, wanted: Mask, size: tuple[int, int]) -> tuple[Rgb, Mask]:
    """Return a window and its hole, both resized to `size` (h, w)."""
    if rgb.shape[:2] == size:
        return rgb, wanted
    interpolation = cv2.INTER_AREA if size[1] < rgb.shape[1] else cv2.INTER_LINEAR
    mask = cv2.resize(
        wanted.astype(np.float32), size[::-1], interpolation=interpolation
    )
    return resize_picture(rgb, size), np.asarray(mask > 0)


def resize_picture(picture: Rgb, size: tuple[int, int]) -> Rgb:
    """Return a picture resized to `size` (h, w)."""
    if picture.shape[:2] == size:
        return picture
    interpolation = cv2.INTER_AREA if size[1] < picture.shape[1] else cv2.INTER_CUBIC
    return np.asarray(
        cv2.resize(picture, size[::-1], interpolation=interpolation), np.uint8
    )


def _rectangles(mask: Mask) -> list[tuple[slice, slice]]:
    """Return rows and columns of each connected piece."""
    _, _, stats, _ = cv2.connectedComponentsWithStats(
        mask.astype(np.uint8), connectivity=8
    )
    return [(slice(y, y + h), slice(x, x + w)) for x, y, w, h, _ in stats[1:].tolist()]


def _extend_span(span: slice, side: int, least: int) -> slice:
    """Return a span extended by half its length on both sides, inside the photo's
    `side`.

    The result is at least `least` long.
    """
    length = min(side, max(least, 2 * (span.stop - span.start)))
    start = min(max(0, (span.start + span.stop - length) // 2), side - length)
    return slice(start, start + length)


def _shift(photo: Rgb, picture: Rgb, wide: Mask) -> F32:
    """Return the smoothed difference (h, w, 3) of photo and painting, extended over the
    hole.
    """
    differences = np.where(
        wide[:, :, None], np.float32(0), photo.astype(np.float32) - picture
    )
    known_share = cv2.GaussianBlur((~wide).astype(np.float32), (0, 0), EVEN)
    smooth_shift = (
        cv2.GaussianBlur(differences, (0, 0), EVEN)
        / np.maximum(known_share, 1e-3)[:, :, None]
    )
    # Inside the hole the shift is unknown: extend it smoothly.
    return harmonic_fill(
        np.where(wide[:, :, None], np.float32(0), smooth_shift), wide, 0.1
    )
