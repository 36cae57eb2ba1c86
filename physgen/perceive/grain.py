"""A hole filled by votes, and where each pixel is borrowed from -> the same with grain as strong as that around it.

A mean of votes is smooth, and what is smooth looks most like plain places and borrows from them. So the fill's fine
part is copied from one place alone, which keeps its spectrum, and made as strong as around the hole.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.perceive.membrane import F32, Mask, pieces

GRAIN = 2.0
"""px: standard deviation of the blur that tells grain from colour."""
AROUND = 10
"""px around a piece of the hole whose grain it is to have."""
GAIN = 0.8, 1.6
"""How many times stronger its own is made, at least and at most."""


def grained(guess: F32, picture: F32, hole: Mask, field: NDArray[np.int64]) -> F32:
    """`guess` (H, W, 3) with the grain of `picture` where `field` (H, W, 2: row, column) has each pixel from."""
    known = np.where(hole, np.float32(0), np.float32(1))
    near = np.maximum(cv2.GaussianBlur(known, (0, 0), GRAIN), np.float32(1e-3))
    wide = cv2.GaussianBlur(picture * known[:, :, None], (0, 0), GRAIN) / near[:, :, None]
    own = np.asarray(picture - wide, np.float32)
    y, x = np.nonzero(hole)
    fine = np.zeros_like(own)
    fine[y, x] = own[field[y, x, 0], field[y, x, 1]]
    for part, piece in pieces(hole):
        grown = tuple(slice(max(s.start - AROUND, 0), s.stop + AROUND) for s in part)
        whole = np.zeros(hole[grown].shape, np.uint8)
        within = tuple(slice(s.start - g.start, s.stop - g.start) for s, g in zip(part, grown, strict=True))
        whole[within] = piece[: whole[within].shape[0], : whole[within].shape[1]]
        ring = cv2.dilate(whole, np.ones((2 * AROUND + 1, 2 * AROUND + 1), np.uint8)) > 0
        around, inside = _strength(own[grown][ring & ~hole[grown]]), _strength(fine[part][piece])
        if around > 0 and inside > 0:
            fine[part][piece] *= np.float32(np.clip(around / inside, *GAIN))
    return np.where(hole[:, :, None], cv2.GaussianBlur(guess, (0, 0), GRAIN) + fine, guess)


def _strength(fine: F32) -> float:
    """Levels, of (n, 3): a root of the median, not of the mean, so that an edge among them does not count as grain."""
    return float(np.median((fine**2).mean(axis=1)) ** 0.5) if len(fine) else 0.0
