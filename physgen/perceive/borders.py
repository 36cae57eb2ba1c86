"""A picture with a hole -> where borders enter the hole: their directions and the colours on both their sides."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.perceive.membrane import F32, Mask, grown

F64 = NDArray[np.float64]

OFF = 5
"""px from the hole at which borders are looked for."""
STRIP = 12
"""px to each side of a border that are carried on with it."""
SIDE = 7
"""px on each side of a border whose colours are averaged."""
CONTRAST = 22.0
"""Levels between the two sides (the length of the difference) from which there is a border."""
COHERENT = 0.75
"""Of the structure tensor, from which a border has a direction."""


@dataclass(frozen=True)
class End:
    """Where a border enters a hole."""

    order: int
    """Place along the contour."""
    at: F64
    """x, y."""
    towards: F64
    """Unit vector into the hole."""
    left: F64
    """Mean colour to the left of `towards` (y down: the side of (ty, -tx))."""
    right: F64
    contrast: float
    profile: F64
    """(2 STRIP + 1, 3): colours across it, from left to right; NaN where hidden."""


@dataclass(frozen=True)
class Line:
    """A border in the hole."""

    points: F64
    """(n, 2): x, y, at most 1 px apart."""
    first: F64
    """(2 STRIP + 1, 3): colours across its first point, from left to right."""
    last: F64
    """The same at its last point."""


@dataclass(frozen=True)
class Ring:
    """What is known around the hole: colours and the structure tensor of their gradients."""

    picture: F32
    blocked: Mask
    tensor: tuple[F32, F32, F32]

    @classmethod
    def of(cls, picture: F32, blocked: Mask) -> Ring:
        """Of `picture` (H, W, 3), of which nothing is known where `blocked` (H, W)."""
        smooth = cv2.GaussianBlur(picture, (0, 0), 1)
        known = (~grown(blocked, 1)).astype(np.float32)[:, :, None]
        gx, gy = (cv2.Sobel(smooth, cv2.CV_32F, *d, ksize=3) / 8 * known for d in ((1, 0), (0, 1)))
        xx, xy, yy = (
            cv2.GaussianBlur((a * b).sum(2), (0, 0), 3.5) for a, b in ((gx, gx), (gx, gy), (gy, gy))
        )
        return cls(np.asarray(smooth, np.float32), blocked, (xx, xy, yy))


def ends(ring: Ring, piece: Mask) -> Iterator[End]:
    """The borders that enter a piece of the hole, in the order of its contour."""
    picture, blocked = ring.picture, ring.blocked
    h, w = piece.shape
    r = OFF + SIDE + 2
    wide = cv2.copyMakeBorder(piece.astype(np.uint8), r, r, r, r, cv2.BORDER_CONSTANT, value=0)
    contours, _ = cv2.findContours(
        np.asarray(grown(wide > 0, OFF), np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE
    )
    path = max(contours, key=len)[:, 0, :].astype(np.float64) - r
    x, y = path.astype(int).T
    inside = (x >= 2) & (y >= 2) & (x < w - 2) & (y < h - 2)
    xc, yc = np.clip(x, 0, w - 1), np.clip(y, 0, h - 1)
    usable = inside & ~blocked[yc, xc]
    n = len(path)
    if n < 6 * SIDE or not usable.any():
        return
    xx, xy, yy = (a[yc, xc].astype(np.float64) for a in ring.tensor)
    angle = 0.5 * np.arctan2(2 * xy, xx - yy)  # of the gradient
    spread = np.hypot(xx - yy, 2 * xy)
    coherence = spread / np.maximum(xx + yy, 1e-6)
    # inward normal from the distance to the piece
    inward = cv2.GaussianBlur(wide.astype(np.float32), (0, 0), OFF)
    nx, ny = (cv2.Sobel(inward, cv2.CV_32F, *d, ksize=3)[y + r, x + r] for d in ((1, 0), (0, 1)))
    tx, ty = -np.sin(angle), np.cos(angle)
    sign = np.where(tx * nx + ty * ny < 0, -1, 1)
    tx, ty = tx * sign, ty * sign
    slant = (tx * nx + ty * ny) / np.maximum(np.hypot(nx, ny), 1e-9)
    # colours to both sides, across the border
    steps = np.arange(2, SIDE + 1)
    sides = []
    ok = usable.copy()
    for turn in (1, -1):
        sx = np.round(path[:, 0, None] + turn * ty[:, None] * steps).astype(int)
        sy = np.round(path[:, 1, None] - turn * tx[:, None] * steps).astype(int)
        legal = (sx >= 0) & (sy >= 0) & (sx < w) & (sy < h)
        sx, sy = np.clip(sx, 0, w - 1), np.clip(sy, 0, h - 1)
        legal &= ~blocked[sy, sx]
        ok &= legal.sum(1) >= 3
        sides.append((picture[sy, sx] * legal[:, :, None]).sum(1) / np.maximum(legal.sum(1), 1)[:, None])
    left, right = sides
    contrast = np.linalg.norm(left - right, axis=1)
    ok &= (coherence > COHERENT) & (contrast > CONTRAST) & (slant > 0.3)
    score = np.where(ok, spread, 0)
    for i in np.flatnonzero(ok):
        around = np.arange(i - 6, i + 7) % n
        if score[i] == score[around].max() and not (score[around[:6]] == score[i]).any():
            towards = np.array([tx[i], ty[i]])
            across = profile(picture, blocked, path[i], towards)
            slope = np.linalg.norm(across[4:] - across[:-4], axis=1)[2:-2]
            shift = 0 if np.isnan(slope).all() else int(np.nanargmax(slope)) - (len(slope) - 1) // 2
            at = path[i] + shift * np.array([-towards[1], towards[0]])
            across = profile(picture, blocked, at, towards)
            yield End(int(i), at, towards, left[i], right[i], float(contrast[i]), across)


def profile(picture: F32, blocked: Mask, at: F64, towards: F64) -> F64:
    """Colours (2 STRIP + 1, 3) across a border from left to right, averaged along its last px; NaN if hidden."""
    h, w = blocked.shape
    across = np.arange(-STRIP, STRIP + 1)[:, None]
    back = np.arange(0, 4)[None, :]
    x = at[0] - towards[0] * back - towards[1] * across
    y = at[1] - towards[1] * back + towards[0] * across
    xi, yi = np.round(x).astype(int), np.round(y).astype(int)
    legal = (xi >= 0) & (yi >= 0) & (xi < w) & (yi < h)
    xi, yi = np.clip(xi, 0, w - 1), np.clip(yi, 0, h - 1)
    legal &= ~blocked[yi, xi]
    weight = legal.sum(1)[:, None]
    mean = (picture[yi, xi] * legal[:, :, None]).sum(1) / np.maximum(weight, 1)
    return np.where(weight > 0, mean, np.nan)
