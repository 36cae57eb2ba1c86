"""A small picture with a hole -> a first filling, patch after patch, where lines run into the hole first.

Criminisi, Perez, Toyama 2004, Region filling and object removal by exemplar-based inpainting. What goes first is known
best (confidence) or has the strongest edges across the hole's border (data).
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.perceive.membrane import F32, Mask

EDGE = 0.02
"""Part of the data term that a place without edges has, of 1."""


def peel(picture: F32, hole: Mask, centres: NDArray[np.int64], radius: int, away: NDArray[np.float64]) -> F32:
    """`(H, W, 3)` with `hole` filled by patches of 2 radius + 1 px around `centres` (n, 2); `away` see borrow."""
    h, w = hole.shape
    width, r = 2 * radius + 1, radius
    sides = ((r, r), (r, r))
    now = np.pad(np.round(picture / 2), (*sides, (0, 0)), mode="edge").astype(np.float32)
    open_ = np.pad(hole, sides)
    within = np.pad(np.ones_like(hole), sides)
    sure = np.where(open_, np.float32(0), within.astype(np.float32))
    view = np.lib.stride_tricks.sliding_window_view(now, (width, width), (0, 1))
    patches = np.ascontiguousarray(np.moveaxis(view, 2, -1)[centres[:, 0], centres[:, 1]])
    flat = patches.reshape(len(centres), -1)
    square = (patches**2).sum(-1).reshape(len(centres), -1)
    size = float(np.hypot(h, w))
    while open_.any():
        y, x = _first(now, open_, within, sure, width)
        here = (slice(y - r, y + r + 1), slice(x - r, x + r + 1))
        known = ~open_[here] & within[here]
        mask = known.astype(np.float32)
        target = now[here] * mask[:, :, None]
        gap = square @ mask.ravel() - 2 * (flat @ target.ravel()) + (target**2).sum()
        far = np.hypot(away[0] * (centres[:, 0] - (y - r)), away[1] * (centres[:, 1] - (x - r)))
        gap = gap / mask.sum() + (far / size).astype(np.float32)
        best = patches[int(gap.argmin())]
        new = open_[here] & within[here]
        now[here][new] = best[new]
        sure[here][new] = sure[here].mean()
        open_[here] &= ~within[here]
        open_[y, x] = False
    filled = 2 * now[r:-r, r:-r]
    return np.where(hole[:, :, None], filled, picture)


def _first(now: F32, open_: Mask, within: Mask, sure: F32, width: int) -> tuple[int, int]:
    """The pixel of the hole's border whose patch comes next."""
    known = (~open_ & within).astype(np.uint8)
    front = open_ & (cv2.dilate(known, np.ones((3, 3), np.uint8)) > 0)
    solid = cv2.erode(known, np.ones((3, 3), np.uint8)).astype(np.float32)[:, :, None]
    gx, gy = (cv2.Sobel(now, cv2.CV_32F, *d, ksize=3) / 8 * solid for d in ((1, 0), (0, 1)))
    soft = cv2.GaussianBlur(known.astype(np.float32), (0, 0), 1.5)
    nx, ny = (cv2.Sobel(soft, cv2.CV_32F, *d, ksize=3) for d in ((1, 0), (0, 1)))
    long = np.hypot(nx, ny) + np.float32(1e-6)
    tx, ty = -ny / long, nx / long
    box = (width, width)
    xx, xy, yy = (cv2.boxFilter((a * b).sum(2), -1, box) for a, b in ((gx, gx), (gx, gy), (gy, gy)))
    edges = np.sqrt(np.maximum(xx * tx * tx + 2 * xy * tx * ty + yy * ty * ty, 0)) / 16
    rank = np.where(front, cv2.boxFilter(sure, -1, box) * (np.minimum(edges, 1) + EDGE), -1)
    y, x = np.unravel_index(int(rank.argmax()), rank.shape)
    return int(y), int(x)
