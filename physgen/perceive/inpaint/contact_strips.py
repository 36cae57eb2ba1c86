"""Contact shadow under an object, also between its wheels or legs.

Such a strip is far darker than the ground around and has no light of its own: nothing can be read off it, so that it is
filled with the hole, where a shadow is divided out.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import cv2
import numpy as np

from physgen.maps import F32
from physgen.perceive.roles import Mask, Rgb
from physgen.photometry import decode, luminance


@dataclass(frozen=True)
class _Tuning:
    """Chosen on two photos (a car, a toy car) and drawings."""

    reach: float = 10 / 512
    """Of the photo's longer side: below the foot and beside it; half the paper's kernel."""
    legs: float = 0.3  # of the object's height above its foot: room between wheels
    dark: float = 0.45  # share of the ground's light: less is contact shadow
    low: float = 0.1  # quantile of the ground's light that its own grains reach ...
    below_low: float = 0.8  # ... and the share of that below which it is shadow
    least_ground: float = 0.02  # linear light: a darker ground shows no shadow
    fewest: int = 30  # px of ground that must be visible
    smooth: float = 1.0  # px: standard deviation of the blur against grain
    smallest: int = 100  # px: a smaller piece of the hole is no object
    most: float = 0.4  # of the object's area: a larger dark place is another surface


TUNING = _Tuning()


def contact_strips(photo: Rgb, hole: Mask) -> Mask:
    """(H, W) dark strips under the objects in `hole` (H, W) of `photo` (H, W, 3)."""
    result = np.zeros_like(hole)
    light = luminance(decode(photo)).astype(np.float32)
    known = (~hole).astype(np.float32)
    near = np.maximum(cv2.GaussianBlur(known, (0, 0), TUNING.smooth), 1e-3)
    blurred = cv2.GaussianBlur(light * known, (0, 0), TUNING.smooth)
    light = np.asarray(blurred / near, np.float32)
    reach = max(2, round(TUNING.reach * max(hole.shape)))
    for piece, box in _objects(hole):
        strip = _strip(light, hole, piece, box, reach)
        if strip.sum() < TUNING.most * piece.sum():
            result |= strip
    return result & ~hole


def _objects(hole: Mask) -> Iterator[tuple[Mask, tuple[int, int, int, int]]]:
    """Connected pieces of `hole`, each with its left, top, width and height."""
    count, names, stats, _ = cv2.connectedComponentsWithStats(
        hole.astype(np.uint8), connectivity=8
    )
    for number in range(1, count):
        left, top, width, height, area = (int(value) for value in stats[number])
        if area >= TUNING.smallest:
            yield names == number, (left, top, width, height)


def _strip(
    light: F32, hole: Mask, piece: Mask, box: tuple[int, int, int, int], reach: int
) -> Mask:
    """(H, W) dark pixels around the foot of one `piece` that are joined to it."""
    left, top, width, height = box
    foot = top + height
    room = np.zeros_like(hole)
    rows = slice(foot - int(TUNING.legs * height), foot + reach)
    room[rows, max(0, left - reach) : left + width + reach] = True
    # under the object, or right beside it
    below = np.maximum.accumulate(piece, axis=0)
    size = 2 * reach + 1
    beside = cv2.dilate(piece.astype(np.uint8), np.ones((size, size), np.uint8)) > 0
    room &= (below | beside) & ~hole
    dark = room & (light < _darkest_ground(light, hole, box, reach))
    _, names = cv2.connectedComponents((dark | piece).astype(np.uint8), connectivity=8)
    own = np.unique(names[piece])
    return np.asarray(dark & np.isin(names, own[own > 0]))


def _darkest_ground(
    light: F32, hole: Mask, box: tuple[int, int, int, int], reach: int
) -> float:
    """Light below which the ground around a foot is shadow; 0 if it is unknown.

    Of the ground below and beside the object, the darker counts: a car on a dark road
    may stand behind a pale pavement. Dark grains of the ground are no shadow.
    """
    left, top, width, height = box
    foot = top + height
    side = max(width // 2, 2 * reach)
    columns = slice(max(0, left - reach), left + width + reach)
    below, beside = np.zeros_like(hole), np.zeros_like(hole)
    below[foot + reach : foot + 3 * reach, columns] = True
    rows = slice(max(0, foot - reach), foot + reach)
    beside[rows, max(0, left - side) : left + width + side] = True
    beside[rows, columns] = False
    limits = []
    for ground in (below & ~hole, beside & ~hole):
        if ground.sum() < TUNING.fewest:
            continue
        low, middle = np.quantile(light[ground], [TUNING.low, 0.5])
        if middle > TUNING.least_ground:
            limits.append(min(TUNING.dark * middle, TUNING.below_low * low))
    return float(min(limits, default=0.0))
