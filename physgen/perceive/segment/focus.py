"""How sharp the rims of objects are: what is out of focus belongs to the background.

An edge is compared at two scales. A sharp one is much steeper at the fine scale; one
that the lens has blurred is not (Zhuo and Sim 2011, Defocus map estimation).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.perceive.segment.network import F32
from physgen.perceive.segment.proposals import Proposal, outline

Array = NDArray[np.float64]


@dataclass(frozen=True)
class FocusConstants:
    """Constants of sharpness; px are of a grid twice as fine as the network's."""

    blurs: tuple[float, float] = (0.8, 3.0)
    """px: the scales; a step has a ratio of up to 3.75, a blur of 3 px one of 1.4."""
    weakest: float = 1.0  # of CIELAB a px: a weaker edge has no sharpness
    reach: int = 5  # px of the network's grid: an edge lies so near the rim
    sharpest: float = 0.9  # share of the objects that are less sharp than the reference
    small: float = 0.1  # of their median area: a smaller one does not count there
    share: tuple[float, float] = (0.55, 0.7)
    """Of the reference: an object is out of focus below the first, not above the other."""
    clear: float = 2.1  # ratio of an object that is in focus anyway


FOCUS = FocusConstants()


def blur_shares(ratios: Array, areas: Array) -> Array:
    """Return (n,) 0..1: how surely objects are out of focus beside one another.

    `ratios` (n,) is the sharpness of their rims. One object alone is the subject, and a
    small one says little of a large one.
    """
    if len(ratios) < 2:
        return np.zeros(len(ratios))
    large = areas >= FOCUS.small * np.median(areas)
    reference = max(float(np.quantile(ratios[large], FOCUS.sharpest)), 1e-6)
    shares = np.interp(ratios / reference, FOCUS.share, (1, 0))
    is_known = (ratios > 0) & (ratios < FOCUS.clear)
    return np.asarray(np.where(is_known, shares, 0))


def rim_sharpness(
    rgb: NDArray[np.uint8], chosen: Sequence[Proposal], shape: tuple[int, int]
) -> Array:
    """Return (n,): the median ratio of fine to wide edges along each rim.

    It is 0 where no edge runs along the rim.
    """
    kernel = np.ones((FOCUS.reach, FOCUS.reach), np.uint8)
    fine, wide = (cv2.dilate(one, kernel) for one in edge_steps(rgb, shape))
    ratios = np.zeros(len(chosen))
    for k, one in enumerate(chosen):
        x, y = (outline(one.mask) + np.array([one.x, one.y])).T
        is_free = (x > 0) & (y > 0) & (x < shape[1] - 1) & (y < shape[0] - 1)
        x, y = x[is_free], y[is_free]
        is_clear = fine[y, x] > FOCUS.weakest
        x, y = x[is_clear], y[is_clear]
        if len(x):
            ratios[k] = np.median(fine[y, x] / (wide[y, x] + 0.1))
    return ratios


def edge_steps(rgb: NDArray[np.uint8], shape: tuple[int, int]) -> tuple[F32, F32]:
    """Return the strength (h, w) of edges at the fine and at the wide scale.

    The strongest of four cells of a grid twice as fine as `shape` (h, w) counts.
    """
    height, width = shape
    small = cv2.resize(rgb, (2 * width, 2 * height), interpolation=cv2.INTER_AREA)
    lab = cv2.cvtColor(small.astype(np.float32) / 255, cv2.COLOR_RGB2LAB)
    steps = []
    for blur in FOCUS.blurs:
        smooth = cv2.GaussianBlur(lab, (0, 0), blur)
        across = cv2.Sobel(smooth, cv2.CV_32F, 1, 0, ksize=3, scale=1 / 8)
        down = cv2.Sobel(smooth, cv2.CV_32F, 0, 1, ksize=3, scale=1 / 8)
        strength = np.sqrt((across**2 + down**2).sum(axis=2))
        steps.append(strength.reshape(height, 2, width, 2).max(axis=(1, 3)))
    return steps[0], steps[1]
