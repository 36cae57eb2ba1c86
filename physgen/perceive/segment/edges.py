"""Proposals from the photo's edges and from circles, and the best set of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.perceive.segment.gradient import colour_gradient, smoothed_lab
from physgen.perceive.segment.proposals import (
    Proposal,
    Scores,
    distinct,
    outline,
    score_proposals,
)
from physgen.perceive.segment.regions import discs, stable_regions
from physgen.perceive.segment.selection import best_set, exclusions


@dataclass(frozen=True)
class SelectionConstants:
    """Constants of the selection by edges, chosen on photos."""

    threshold: float = 0.58
    """Score below which a proposal is dropped. All values were chosen on photos."""
    area_power: float = 0.7
    """Exponent of the area in a proposal's gain; it balances wholes against their
    parts.
    """
    set_bonus: float = 0.1
    """Bonus if three selected proposals have the same size and compactness, because
    objects often come in sets.
    """
    gap_penalty: float = 0.4
    """Penalty of a small proposal between larger selected ones: a gap, or a face of an
    object.
    """
    # px: area of the searched picture; larger photos are reduced to it.
    working_area: int = 512 * 512
    # px: longest side of the searched picture, for panoramas.
    working_side: int = 4096
    areas: tuple[float, ...] = (0.0012, 0.22)
    """Bounds of an object's area over the photo's."""
    noise: float = 1.2
    """Median edge strength, CIELAB per px, above which edges rarely select correct
    objects.
    """


SELECTION = SelectionConstants()
GAP_REACH = 3
"""px: distance from an outline to neighbours."""

Flags = NDArray[np.bool_]
Values = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class EdgeSearch:
    """The best set of proposals from edges and circles, on a grid of `shape` (h, w)."""

    shape: tuple[int, int]
    proposals: Sequence[Proposal]
    scores: NDArray[np.float64]  # (n,) of the chosen ones


def search_edges(rgb: NDArray[np.uint8]) -> EdgeSearch:
    """Return the best set of proposals of a photo (H, W, 3) uint8 sRGB."""
    small_photo = _shrink_photo(rgb)
    height, width = small_photo.shape[:2]
    shape = height, width
    smallest, largest = (round(part * width * height) for part in SELECTION.areas)
    smallest = max(12, smallest)
    colour = smoothed_lab(small_photo)
    gradient = colour_gradient(colour)
    # In a rough photo, edges rarely bound objects.
    if gradient.noise > SELECTION.noise:
        return EdgeSearch(shape, [], np.zeros(0))
    regions = stable_regions(colour, gradient, smallest, largest)
    circles = discs(gradient, smallest, largest)
    proposals = distinct(regions + circles)
    least_score = SELECTION.threshold - SELECTION.set_bonus
    scores = score_proposals(proposals, colour, gradient, least_score)
    return EdgeSearch(shape, *select(proposals, scores, shape))


def _shrink_photo(rgb: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return a photo at the size of the search."""
    height, width = rgb.shape[:2]
    scale = min(
        1.0,
        (SELECTION.working_area / (height * width)) ** 0.5,
        SELECTION.working_side / max(height, width),
    )
    if scale == 1:
        return rgb
    size = max(1, round(width * scale)), max(1, round(height * scale))
    small_photo = cv2.resize(rgb, size, interpolation=cv2.INTER_AREA)
    return np.asarray(small_photo, np.uint8)


def select(
    proposals: Sequence[Proposal], looks: Scores, shape: tuple[int, int]
) -> tuple[list[Proposal], NDArray[np.float64]]:
    """Return the set with the largest gain without overlap, and its final scores.

    The grid is `shape` (h, w). There are two rounds, since the scores depend on the
    selection.
    """
    worth = np.flatnonzero(looks.score > SELECTION.threshold - SELECTION.set_bonus)
    pool = [proposals[i] for i in worth.tolist()]
    if not pool:
        return [], np.zeros(0)
    score = looks.score[worth]
    compactness = looks.compactness[worth]
    area = np.array([proposal.area for proposal in pool], np.float64)
    weight = (area / (shape[0] * shape[1])) ** SELECTION.area_power
    excludes = exclusions(pool)
    final = score
    gap = np.zeros(len(pool))
    selection = best_set((final - SELECTION.threshold) * weight, excludes)
    # Sets and gaps depend on the selection, and the selection on them.
    for _ in range(2):
        gap = np.maximum(gap, _gaps(pool, area, selection, shape))
        final = score + _sets(score, area, compactness, selection, excludes) - gap
        selection = best_set((final - SELECTION.threshold) * weight, excludes)
    return [pool[i] for i in np.flatnonzero(selection).tolist()], final[selection]


def _sets(
    score: Values, area: Values, compactness: Values, selection: Flags, excludes: Flags
) -> Values:
    """Return the bonus (n,) of proposals similar to several selected ones in size and
    compactness.
    """
    size = np.log(area[:, None] / area[selection]) / 0.12
    compactness_ratio = np.log(compactness[:, None] / compactness[selection]) / 0.15
    similarity = np.exp(-(size**2) - compactness_ratio**2) * np.clip(
        (score[selection] - SELECTION.threshold) / 0.2, 0, 1
    )
    similarity[(excludes | np.eye(len(area), dtype=np.bool_))[:, selection]] = 0
    bonus: Values = SELECTION.set_bonus * np.minimum(similarity.sum(1), 3) / 3
    return bonus


def _gaps(
    proposals: Sequence[Proposal],
    area: Values,
    selection: Flags,
    shape: tuple[int, int],
) -> Values:
    """Return the penalty (n,) of selected proposals with larger selected ones along
    their outline.
    """
    labels = np.zeros((shape[0] + 2 * GAP_REACH, shape[1] + 2 * GAP_REACH), np.int32)
    members = np.flatnonzero(selection).tolist()
    for i in members:
        left, top, right, bottom = (edge + GAP_REACH for edge in proposals[i].box)
        labels[top:bottom, left:right][proposals[i].mask] = i + 1
    penalty = np.zeros(len(proposals))
    for i in members:
        left, top, right, bottom = proposals[i].box
        window = labels[top : bottom + 2 * GAP_REACH, left : right + 2 * GAP_REACH]
        others = (window > 0) & (window != i + 1)
        if not others.any():
            continue
        enclosure = _enclosure(proposals[i].mask, others)
        neighbour_area = float(np.median(area[np.unique(window[others]) - 1]))
        relative_size = area[i] / (0.6 * neighbour_area)
        smallness = np.clip(1 - relative_size, 0, 1)
        penalty[i] = SELECTION.gap_penalty * enclosure * smallness
    return penalty


def _enclosure(mask: NDArray[np.bool_], others: NDArray[np.bool_]) -> float:
    """Return how much of a proposal's outline is near others, 0..1.

    `others` (h, w) has a margin of GAP_REACH px around the mask.
    """
    kernel = np.ones((2 * GAP_REACH + 1, 2 * GAP_REACH + 1), np.uint8)
    near_others = cv2.dilate(others.astype(np.uint8), kernel)
    x, y = (outline(mask) + GAP_REACH).T
    near_share = float(near_others[y, x].mean())
    return max(0.0, near_share - 0.3) / 0.7
