"""Background -> by how much its surfaces are darker somewhere than the same surfaces are elsewhere; no light is asked.

The light of a place without its shadow is read off like-coloured surface near by, from where nothing is suspected of
lying in shadow. Paint is dark as well; but it does not lie just where a thing's shadow must.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.perceive.hues import DARKEST, hues
from physgen.perceive.roles import Rgb
from physgen.photometry import decode, luminance

F32 = NDArray[np.float32]
Mask = NDArray[np.bool_]

ALONG = ((0.7, 0.08, 1.0), (2.0, 0.16, 0.05), (4.0, 0.6, 2e-3), (8.0, 2.0, 1e-5))
"""Of an object's size, across and down: how far like surfaces are looked for; and how little the farther ones count.

On a floor seen from the side, what lies in one row is equally far.
"""
AROUND = ((0.5, 0.5, 1.0), (1.0, 1.0, 0.05), (3.0, 3.0, 2e-3))
"""The same on a table seen from above."""
SMOOTH = 3.0, 1.2
"""px across and down: standard deviations of the blur; finer is grain. From above the mean of both, both ways."""
SEEN = 0.4
"""Share of a place that must be free to say anything."""
LEAST = 40
"""px: the same."""
QUIET = 5e-3
"""-log of light: no surface is more even."""


def missing(background: Rgb, free: F32, suspect: Mask, size: float, *, from_above: bool) -> F32:
    """(H, W) -log of the light that is missing, smooth.

    `free`: 1 where no object is near. `suspect`: what may lie in shadow, and says nothing of surfaces in the light.
    """
    linear = decode(background)
    bright = np.log(luminance(linear) + DARKEST).astype(np.float32)
    plain = free * ~suspect
    level = np.zeros(bright.shape, np.float32)
    total = np.full(bright.shape, 1e-9, np.float32)
    for kin in hues(linear, plain, 4000):
        weight = plain * kin
        sums, weights = 1e-9 * bright, np.full(bright.shape, 1e-9, np.float32)
        for across, down, gain in AROUND if from_above else ALONG:
            sums = sums + gain * _blurred(bright * weight, across * size, down * size)
            weights = weights + gain * _blurred(weight, across * size, down * size)
        level += kin * sums / weights
        total += kin
    across, down = (sum(SMOOTH) / 2,) * 2 if from_above else SMOOTH
    near = np.maximum(_blurred(free, across, down), 1e-2)
    return np.asarray(_blurred((level / total - bright) * free, across, down) / near, np.float32)


def standing_out(
    dark: F32, free: Mask, within: Mask, around: Mask, shifts: Sequence[tuple[int, int]]
) -> tuple[float, float]:
    """By how much it is darker `within` a place than `around` it, and against what is so elsewhere.

    Elsewhere are the same two places moved by `shifts`, px right and down; the second number is by how many times
    more than there, and 0 where the places are out of sight or something elsewhere is as dark.
    """
    own = _contrast(dark, free, within, around)
    other = free & ~within
    moved = [_contrast(dark, other, _rolled(within, dx, dy), _rolled(around, dx, dy)) for dx, dy in shifts]
    others = np.array([one for one in moved if one is not None])
    if own is None or len(others) < max(1, len(shifts) // 4) or own <= others.max():
        return own or 0.0, 0.0
    # what is lighter than around is paint, and hides no shadow
    chance = float(np.sqrt(np.mean(np.maximum(others, 0) ** 2)))
    return own, own / max(chance, QUIET)


def _contrast(dark: F32, free: Mask, within: Mask, around: Mask) -> float | None:
    seen, plain = within & free, around & free
    if seen.sum() < max(LEAST, SEEN * within.sum()) or plain.sum() < LEAST:
        return None
    return float(np.median(dark[seen]) - np.median(dark[plain]))


def _rolled(mask: Mask, dx: int, dy: int) -> Mask:
    """Moved; what leaves the picture is gone."""
    h, w = mask.shape
    result = np.zeros_like(mask)
    if abs(dx) >= w or abs(dy) >= h:
        return result
    result[max(dy, 0) : h + min(dy, 0), max(dx, 0) : w + min(dx, 0)] = mask[
        max(-dy, 0) : h + min(-dy, 0), max(-dx, 0) : w + min(-dx, 0)
    ]
    return result


def _blurred(picture: F32, across: float, down: float) -> F32:
    """Gaussian blur of two widths, px; wide ones on a coarser grid."""
    h, w = picture.shape
    right, lower = max(1, min(int(across / 3), w // 8)), max(1, min(int(down / 3), h // 8))
    small: NDArray[Any] = picture
    if right > 1 or lower > 1:
        small = cv2.resize(picture, (-(-w // right), -(-h // lower)), interpolation=cv2.INTER_AREA)
    sigmas = max(across / right, 0.3), max(down / lower, 0.3)
    small = cv2.GaussianBlur(small, (0, 0), sigmaX=sigmas[0], sigmaY=sigmas[1], borderType=cv2.BORDER_REFLECT)
    if small.shape != picture.shape:
        small = cv2.resize(small, (w, h), interpolation=cv2.INTER_LINEAR)
    return np.asarray(small, np.float32)
