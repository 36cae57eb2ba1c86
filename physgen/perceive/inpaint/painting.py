"""Inpainting by a generative model in windows around the hole, blended back into the photo."""

from __future__ import annotations

import math
from collections.abc import Callable

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.perceive.inpaint.poisson import blend_at_border, harmonic_fill
from physgen.perceive.roles import Rgb

F32 = NDArray[np.float32]
Mask = NDArray[np.bool_]
Painter = Callable[[Rgb, Mask], Rgb]
"""(h, w, 3) and what to paint (h, w) -> (h, w, 3) uint8; it need not keep the rest."""

CONTACT = 20 / 512
"""Of the photo's longer side: how far beyond an object its shadow is painted over, too. The paper dilates by a kernel
of 40 px at 512 px (appendix, background inpainting)."""
EVEN = 4.0
"""px: standard deviation of the blur that tells a painter's shift of colour from its strokes."""


def inpaint_windows(rgb: Rgb, hole: Mask, paint: Painter, least: int) -> Rgb:
    """`rgb` with `hole` (H, W) painted; outside the hole it is `rgb`, bit by bit.

    The painter paints over the contact shadows around the hole as well, so that it does not continue them; what it
    sees is at least `least` px wide and high where the photo is. A shift of colour between its painting and the photo
    is taken away. Without a hole, and without anything but a hole, the photo comes back.
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
    """The hole and the contact shadows around it; less far where nothing would be left of the photo."""
    away = cv2.distanceTransform(1 - hole.astype(np.uint8), cv2.DIST_L2, 5)
    reach = CONTACT * max(hole.shape)
    while reach > 1:
        wide = away <= reach
        if not wide.all():
            return np.asarray(wide)
        reach /= 2
    return hole


def windows(hole: Mask, least: int) -> list[tuple[slice, slice]]:
    """Rows and columns that hold the pieces of `hole` (H, W) with as much again around them; no two overlap.

    Each is at least `least` px high and wide, where the photo is.
    """
    canvas = np.zeros_like(hole)
    for rows, columns in _rectangles(hole):
        canvas[_around(rows, hole.shape[0], least), _around(columns, hole.shape[1], least)] = True
    while True:  # those that touch become one
        found = _rectangles(canvas)
        before = np.count_nonzero(canvas)
        for part in found:
            canvas[part] = True
        if np.count_nonzero(canvas) == before:
            return found


def frame(shape: tuple[int, ...], native: int, step: int) -> tuple[int, int]:
    """The size in which a model of `native` px squared is shown a window of `shape` (H, W): multiples of `step`.

    >>> frame((300, 400), 512, 16)
    (448, 592)
    """
    scale = min(native / math.sqrt(shape[0] * shape[1]), 2 * native / max(shape[:2]))
    tall, wide = (max(2, round(side * scale / step)) * step for side in shape[:2])
    return tall, wide


def shown(rgb: Rgb, wanted: Mask, size: tuple[int, int]) -> tuple[Rgb, Mask]:
    """A window and what is to be painted in it, both in `size` (h, w)."""
    if rgb.shape[:2] == size:
        return rgb, wanted
    how = cv2.INTER_AREA if size[1] < rgb.shape[1] else cv2.INTER_LINEAR
    mask = cv2.resize(wanted.astype(np.float32), size[::-1], interpolation=how)
    return back(rgb, size), np.asarray(mask > 0)


def back(picture: Rgb, size: tuple[int, int]) -> Rgb:
    """A picture in a window's own `size` (h, w)."""
    if picture.shape[:2] == size:
        return picture
    how = cv2.INTER_AREA if size[1] < picture.shape[1] else cv2.INTER_CUBIC
    return np.asarray(cv2.resize(picture, size[::-1], interpolation=how), np.uint8)


def _rectangles(mask: Mask) -> list[tuple[slice, slice]]:
    """Rows and columns of each connected piece."""
    _, _, stats, _ = cv2.connectedComponentsWithStats(mask.astype(np.uint8), connectivity=8)
    return [(slice(y, y + h), slice(x, x + w)) for x, y, w, h, _ in stats[1:].tolist()]


def _around(span: slice, side: int, least: int) -> slice:
    """A span with half its length on both sides, `least` in all, kept on the photo's `side`."""
    wanted = min(side, max(least, 2 * (span.stop - span.start)))
    start = min(max(0, (span.start + span.stop - wanted) // 2), side - wanted)
    return slice(start, start + wanted)


def _shift(photo: Rgb, picture: Rgb, wide: Mask) -> F32:
    """What the painting is off the photo around the hole, (h, w, 3), without its strokes, spread over the hole."""
    off = np.where(wide[:, :, None], np.float32(0), photo.astype(np.float32) - picture)
    seen = cv2.GaussianBlur((~wide).astype(np.float32), (0, 0), EVEN)
    even = cv2.GaussianBlur(off, (0, 0), EVEN) / np.maximum(seen, 1e-3)[:, :, None]
    return harmonic_fill(np.where(wide[:, :, None], np.float32(0), even), wide, 0.1)
