"""Sharpness of the rims of objects: a blurred object belongs to the background.

An edge is compared at two scales. A sharp edge is much steeper at the fine scale; an
edge blurred by the lens is not (Zhuo and Sim 2011, Defocus map estimation).
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
    # CIELAB per px: a weaker edge has no measurable sharpness.
    weakest: float = 1.0
    # px of the network's grid: largest distance of an edge from the rim.
    reach: int = 5
    # Quantile of the objects' sharpness as the reference.
    sharpest: float = 0.9
    # Least area of an object in that quantile over the median area.
    small: float = 0.1
    share: tuple[float, float] = (0.55, 0.7)
    """Ratio to the reference: an object is blurred below the first and sharp above the
    second.
    """
    # Ratio above which an object is sharp in any case.
    clear_ratio: float = 2.1


FOCUS = FocusConstants()


def blur_shares(ratios: Array, areas: Array) -> Array:
    """Return the probability (n,) that objects are out of focus relative to each other.

    `ratios` (n,) is the sharpness of their rims. A single object is the subject, and a
    small one says little about a large one.
    """
    if len(ratios) < 2:
        return np.zeros(len(ratios))
    large = areas >= FOCUS.small * np.median(areas)
    reference = max(float(np.quantile(ratios[large], FOCUS.sharpest)), 1e-6)
    shares = np.interp(ratios / reference, FOCUS.share, (1, 0))
    is_relative = (ratios > 0) & (ratios < FOCUS.clear_ratio)
    return np.asarray(np.where(is_relative, shares, 0))


def rim_sharpness(
    rgb: NDArray[np.uint8], proposals: Sequence[Proposal], shape: tuple[int, int]
) -> Array:
    """Return the median ratio (n,) of fine to wide edges along each rim, 0 without
    edges.
    """
    kernel = np.ones((FOCUS.reach, FOCUS.reach), np.uint8)
    fine_edges, wide_edges = (
        cv2.dilate(proposal, kernel) for proposal in edge_steps(rgb, shape)
    )
    ratios = np.zeros(len(proposals))
    for k, proposal in enumerate(proposals):
        x, y = (outline(proposal.mask) + np.array([proposal.x, proposal.y])).T
        is_free = (x > 0) & (y > 0) & (x < shape[1] - 1) & (y < shape[0] - 1)
        x = x[is_free]
        y = y[is_free]
        has_edge = fine_edges[y, x] > FOCUS.weakest
        x = x[has_edge]
        y = y[has_edge]
        if len(x):
            ratios[k] = np.median(fine_edges[y, x] / (wide_edges[y, x] + 0.1))
    return ratios


def edge_steps(rgb: NDArray[np.uint8], shape: tuple[int, int]) -> tuple[F32, F32]:
    """Return the strength (h, w) of edges at the fine and at the wide scale.

    The grid is twice as fine as `shape` (h, w); of four cells the strongest counts.
    """
    height, width = shape
    small = cv2.resize(rgb, (2 * width, 2 * height), interpolation=cv2.INTER_AREA)
    lab = cv2.cvtColor(small.astype(np.float32) / 255, cv2.COLOR_RGB2LAB)
    steps = []
    for blur in FOCUS.blurs:
        blurred_lab = cv2.GaussianBlur(lab, (0, 0), blur)
        x_gradient = cv2.Sobel(blurred_lab, cv2.CV_32F, 1, 0, ksize=3, scale=1 / 8)
        down = cv2.Sobel(blurred_lab, cv2.CV_32F, 0, 1, ksize=3, scale=1 / 8)
        strength = np.sqrt((x_gradient**2 + down**2).sum(axis=2))
        steps.append(strength.reshape(height, 2, width, 2).max(axis=(1, 3)))
    return steps[0], steps[1]
