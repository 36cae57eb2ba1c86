"""A picture with a hole -> the same at ever coarser scales, until the hole is shallow."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.perceive.membrane import F32, Mask

RADIUS = 3
"""px: patches are 7 px wide."""
DEPTH = 4.5
"""px that the hole may be deep at the coarsest scale."""
WIDE = 30_000
"""px: a coarsest scale with more of them is halved once more; photos more than three times as wide as high have it."""
STRATA = 4.0
"""Of that, at most so many times (before it is squared) where the picture lies in layers, for crossing them."""


@dataclass(frozen=True)
class Level:
    """The picture at one scale."""

    picture: F32
    """(H, W, 3); what is in the hole means nothing."""
    hole: Mask
    """(H, W)."""
    drawn: Mask
    """(H, W): where, in the hole, the picture holds a border carried on."""


def strata(level: Level) -> NDArray[np.float64]:
    """(2,): by how much more it costs to borrow from other rows, and from other columns, than from one's own.

    A floor, a shelf, a horizon lie along the rows: there the picture is more like itself to the side than up or down.
    """
    reach = max(min(level.hole.shape) // 8, 2)
    unlike = []
    for axis in (0, 1):
        before, after = (
            tuple(part if a == axis else slice(None) for a in (0, 1))
            for part in (slice(None, -reach), slice(reach, None))
        )
        both = ~(level.hole[before] | level.hole[after])
        gap = np.abs(level.picture[before] - level.picture[after]).mean(axis=2)[both]
        unlike.append(float(gap.mean()) if gap.size else 1.0)
    ratio = np.clip((unlike[0] + 1) / (unlike[1] + 1), 1 / STRATA, STRATA)
    return np.array([max(ratio, 1.0), max(1 / ratio, 1.0)]) ** 2


def pyramid(picture: F32, hole: Mask, start: F32, strips: Mask) -> Iterator[Level]:
    """From the finest to the coarsest scale that still knows something."""
    known = (~hole).astype(np.float32)
    value = picture * known[:, :, None]
    part = strips.astype(np.float32)
    strip = start * part[:, :, None]
    for k in range(12):
        now = known < (0.999 if k == 0 else 0.5)
        radius = RADIUS if k else 2
        if sources(now, radius).sum() < 64:
            return
        mean, line = (v / np.maximum(p, 1e-6)[:, :, None] for v, p in ((value, known), (strip, part)))
        drawn = now & (part > 0.35)
        yield Level(np.where(drawn[:, :, None], line, mean).astype(np.float32), now, drawn)
        depth = cv2.distanceTransform(now.astype(np.uint8), cv2.DIST_L2, 3).max()
        if depth < DEPTH or min(now.shape) < (96 if now.size < WIDE else 48):
            return
        size = (now.shape[1] + 1) // 2, (now.shape[0] + 1) // 2
        value, known, strip, part = (
            np.asarray(cv2.resize(a, size, interpolation=cv2.INTER_AREA), np.float32)
            for a in (value, known, strip, part)
        )


def sources(hole: Mask, radius: int) -> Mask:
    """Centres of patches that are known as a whole."""
    blocked = np.pad(hole, radius, constant_values=True).astype(np.uint8)
    width = 2 * radius + 1
    blocked = cv2.dilate(blocked, np.ones((width, width), np.uint8)).astype(np.uint8)
    return np.asarray(blocked[radius:-radius, radius:-radius] == 0)
