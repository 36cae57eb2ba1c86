"""Proposals + what the network sees -> numbers that tell whole objects from parts, gaps, and pieces of furniture."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.perceive.learned.network import OFFSETS, Seen
from physgen.perceive.proposals.proposal import Mask, Proposal, outline

F32 = NDArray[np.float32]
Array = NDArray[np.float64]

NAMES = (
    "foreground", "foreground, weakest tenth", "foreground around", "border along the rim",
    "border along its weakest quarter", "border inside", "border inside, strongest fiftieth",
    "together, near", "together, farther", "together, far", "with others, near", "with others, farther",
    "with others, far", "log size", "cut by the photo", "solidity", "compactness", "facing the viewer",
)  # fmt: skip
RANGES = (range(0, 2), range(2, 6), range(6, 8))
"""Of the pairs: near, farther and far ones."""
ASIDE = 3
"""px of the grid beside a proposal that are looked at."""


def evidence(proposals: Sequence[Proposal], seen: Seen) -> Array:
    """(n, len(NAMES)) for proposals on the grid of the network's output."""
    rim = np.asarray(cv2.dilate(seen.boundary, np.ones((3, 3), np.uint8)), np.float32)
    reach = max(max(abs(down), abs(right)) for down, right in OFFSETS)
    return np.array([_one(proposal, seen, rim, reach) for proposal in proposals]).reshape(-1, len(NAMES))


def _one(one: Proposal, seen: Seen, rim: F32, reach: int) -> list[float]:
    height, width = seen.foreground.shape
    left, top, right, bottom = one.box
    x0, y0 = max(left - reach, 0), max(top - reach, 0)
    box = np.s_[y0 : min(bottom + reach, height), x0 : min(right + reach, width)]
    mask = np.zeros(seen.foreground[box].shape, bool)
    mask[top - y0 : bottom - y0, left - x0 : right - x0] = one.mask
    near = np.s_[
        max(top - ASIDE - y0, 0) : bottom + ASIDE - y0, max(left - ASIDE - x0, 0) : right + ASIDE - x0
    ]
    small = mask[near].astype(np.uint8)
    foreground, boundary = seen.foreground[box], seen.boundary[box]
    on = foreground[mask]
    kernel = np.ones((2 * ASIDE + 1, 2 * ASIDE + 1), np.uint8)
    around = (cv2.dilate(small, kernel) > 0) & (small == 0)
    inner = cv2.erode(small, np.ones((5, 5), np.uint8), borderType=cv2.BORDER_CONSTANT, borderValue=0) > 0
    contour = outline(one.mask)
    x, y = contour[:, 0] + left, contour[:, 1] + top
    free = (x > 0) & (y > 0) & (x < width - 1) & (y < height - 1)
    along = np.sort(rim[y[free], x[free]]) if free.any() else np.zeros(1, np.float32)
    inside = boundary[near][inner] if inner.any() else np.zeros(1, np.float32)
    together, others = _pairs(mask, foreground, seen.pairs[(slice(None), *box)])
    hull = cv2.convexHull(contour)
    area, length = max(float(one.area), 1.0), max(float(cv2.arcLength(contour, True)), 1.0)
    return [
        float(on.mean()),
        _lowest(on, 0.1),
        float(foreground[near][around].mean()) if around.any() else 0.0,
        float(along.mean()),
        float(along[: max(1, len(along) // 4)].mean()),
        float(inside.mean()),
        -_lowest(-inside, 0.02),
        *together,
        *others,
        float(np.log(area / (height * width))),
        1 - float(free.mean()),
        area / max(float(cv2.contourArea(hull)) + length / 2 + 1, area),
        float(np.sqrt(4 * np.pi * area) / length),
        float(seen.normals[box][..., 2][mask].mean()),
    ]


def _lowest(values: F32, share: float) -> float:
    """The greatest of the lowest `share` of some values."""
    k = int(share * (len(values) - 1))
    return float(np.partition(values, k)[k])


def _pairs(mask: Mask, foreground: F32, pairs: F32) -> tuple[list[float], list[float]]:
    """How much pixels of the proposal belong together, and with what else is on objects, by how far apart they are."""
    h, w = mask.shape
    within, across = [], []
    for some in RANGES:
        own = other = own_count = other_count = 0.0
        for n in some:
            down, right = OFFSETS[n]
            if down >= h or abs(right) >= w:
                continue
            here = np.s_[: h - down, max(-right, 0) : w - max(right, 0)]
            there = np.s_[down:, max(right, 0) : w + min(right, 0)]
            a, b, told = mask[here], mask[there], pairs[n][here]
            both = a & b
            own += float(told[both].sum())
            own_count += int(both.sum())
            one = a != b
            if one.any():
                weight = np.where(a, foreground[there], foreground[here])[one]
                other += float((told[one] * weight).sum())
                other_count += float(weight.sum())
        within.append((own + 0.5) / (own_count + 1.0))
        across.append(other / (other_count + 1.0))
    return within, across
