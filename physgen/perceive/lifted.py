"""A background whose shadows were lifted -> the same with what lies under and between objects filled anew."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.perceive.roles import Inpaint, Rgb
from physgen.photometry import decode, luminance

Mask = NDArray[np.uint8]

RING = 3
"""px around objects where lifting is not to be trusted."""
GAP = 6
"""px: half the width of gaps between objects, too dark to tell what is there."""
NEAR = 8
"""px from an object within which shadows have been taken up by the first fill."""
DEEP = 0.45
"""Share of its light: where a shadow leaves less, and an object is near, nobody sees what is there."""
FADE = 0.03
"""Of the photo's longer side: how far into a hole from the nearest lifted shadow it is filled anew; then it fades."""
LIFTED = 3
"""Grey levels: less is no shadow."""


def refilled(lifted: Rgb, background: Rgb, coverage: NDArray[np.float32], inpaint: Inpaint) -> Rgb:
    """What the photo hid lay in shadow when `background` was filled; now it is filled from lifted surroundings.

    Only close to where a shadow was lifted: the first fill knew as much of the rest, from a smaller hole. So the rest
    stays, and what is filled anew meets it.
    """
    covered: Mask = (coverage > 0).astype(np.uint8)
    bright = np.abs(lifted.astype(np.int16) - background).max(axis=2) > LIFTED
    near = np.asarray(cv2.dilate((bright & (covered == 0)).astype(np.uint8), _square(NEAR)), np.uint8)
    grown = np.asarray(cv2.dilate(covered, _square(RING)), np.uint8)
    grown = np.asarray(cv2.morphologyEx(grown, cv2.MORPH_CLOSE, _square(GAP)), np.uint8)
    left = (luminance(decode(background)) + 1e-3) / (luminance(decode(lifted)) + 1e-3)
    deep = ((left < DEEP) & (cv2.dilate(covered, _square(NEAR)) > 0)).astype(np.uint8)
    hole = covered | (grown & near) | np.asarray(cv2.dilate(deep, _square(1)), np.uint8)
    away = cv2.distanceTransform(1 - (near & hole), cv2.DIST_L2, 3)
    new = np.clip(2 - away / (FADE * max(hole.shape)), 0, 1) * (hole > 0)
    old = np.where(hole[..., None] > 0, background, lifted)
    if not new.any():
        return old
    filled = inpaint(old, new > 0)
    return np.asarray(np.rint(new[..., None] * filled + (1 - new[..., None]) * old), np.uint8)


def _square(half: int) -> Mask:
    return np.ones((2 * half + 1, 2 * half + 1), np.uint8)
