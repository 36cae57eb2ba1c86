"""Inpainting by a generative model in windows around the hole, blended back into the photo."""

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
"""Picture (h, w, 3) and hole (h, w) to picture (h, w, 3) uint8; pixels outside the hole may change."""

CONTACT = 20 / 512
"""Of the photo's longer side: margin around an object that is painted over, for its contact shadow. The paper dilates
by a kernel of 40 px at 512 px (appendix, background inpainting)."""
EVEN = 4.0
"""px: standard deviation of the blur that separates a painter's shift of colour from its detail."""


def inpaint_windows(rgb: Rgb, hole: Mask, paint: Painter, least: int) -> Rgb:
    """`rgb` with `hole` (H, W) painted; outside the hole it equals `rgb`.

    Contact shadows around the hole are painted over, so that they are not continued; windows are at least `least` px
    wide and high where the photo is. A shift of colour between painting and photo is removed. An empty hole, and one
    that covers the photo, return the photo.
    """
    if not hole.any() or hole.all():
        return rgb.copy()
    wide = widened(hole)
    picture = rgb.astype(np.float32)
    for part in windows(wide, least):
        strokes = paint(rgb[part], wide[part])
        picture[part] = strokes + _shift(rgb[part], strokes, wide[part])
    return blend_at_border(picture, rgb, hole)


def widened(hole: Mask) -> Mask:
    """The hole and the contact shadows around it; with a smaller margin where that would cover the photo."""
    away = cv2.distanceTransform(1 - hole.astype(np.uint8), cv2.DIST_L2, 5)
    reach = CONTACT * max(hole.shape)
    while reach > 1:
        wide = away <= reach
        if not wide.all():
            return np.asarray(wide)
        reach /= 2
    return hole


def windows(hole: Mask, least: int) -> list[tuple[slice, slice]]:
    """Rows and columns of windows twice as large as the pieces of `hole` (H, W); no two overlap.

    Each is at least `least` px high and wide, where the photo is.
    """
    canvas = np.zeros_like(hole)
    for rows, columns in _rectangles(hole):
        canvas[
            _around(rows, hole.shape[0], least), _around(columns, hole.shape[1], least)
        ] = True
    while True:  # touching windows are merged
        found = _rectangles(canvas)
        before = np.count_nonzero(canvas)
        for part in found:
            canvas[part] = True
        if np.count_nonzero(canvas) == before:
            return found


def model_size(shape: tuple[int, ...], native: int, step: int) -> tuple[int, int]:
    """The size of a window of `shape` (H, W) for a model of `native` px squared: multiples of `step`.

    >>> model_size((300, 400), 512, 16)
    (448, 592)
    """
    scale = min(native / math.sqrt(shape[0] * shape[1]), 2 * native / max(shape[:2]))
    tall, wide = (max(2, round(side * scale / step)) * step for side in shape[:2])
    return tall, wide


def resize_window(rgb: Rgb, wanted: Mask, size: tuple[int, int]) -> tuple[Rgb, Mask]:
    """A window and its hole, both resized to `size` (h, w)."""
    if rgb.shape[:2] == size:
        return rgb, wanted
    how = cv2.INTER_AREA if size[1] < rgb.shape[1] else cv2.INTER_LINEAR
    mask = cv2.resize(wanted.astype(np.float32), size[::-1], interpolation=how)
    return resize_picture(rgb, size), np.asarray(mask > 0)


def resize_picture(picture: Rgb, size: tuple[int, int]) -> Rgb:
    """A picture resized to `size` (h, w)."""
    if picture.shape[:2] == size:
        return picture
    how = cv2.INTER_AREA if size[1] < picture.shape[1] else cv2.INTER_CUBIC
    return np.asarray(cv2.resize(picture, size[::-1], interpolation=how), np.uint8)


def _rectangles(mask: Mask) -> list[tuple[slice, slice]]:
    """Rows and columns of each connected piece."""
    _, _, stats, _ = cv2.connectedComponentsWithStats(
        mask.astype(np.uint8), connectivity=8
    )
    return [(slice(y, y + h), slice(x, x + w)) for x, y, w, h, _ in stats[1:].tolist()]


def _around(span: slice, side: int, least: int) -> slice:
    """A span with half its length added on both sides, at least `least` long, within the photo's `side`."""
    wanted = min(side, max(least, 2 * (span.stop - span.start)))
    start = min(max(0, (span.start + span.stop - wanted) // 2), side - wanted)
    return slice(start, start + wanted)


def _shift(photo: Rgb, picture: Rgb, wide: Mask) -> F32:
    """(h, w, 3): the smoothed difference of photo and painting around the hole, extended over the hole."""
    off = np.where(wide[:, :, None], np.float32(0), photo.astype(np.float32) - picture)
    seen = cv2.GaussianBlur((~wide).astype(np.float32), (0, 0), EVEN)
    even = cv2.GaussianBlur(off, (0, 0), EVEN) / np.maximum(seen, 1e-3)[:, :, None]
    return harmonic_fill(np.where(wide[:, :, None], np.float32(0), even), wide, 0.1)
