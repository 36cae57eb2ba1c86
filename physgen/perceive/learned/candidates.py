"""Photo -> masks that may be objects, by edges and circles and by the network, and what the network says of each."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.perceive.backends.segment_classical import chosen_by_edges
from physgen.perceive.learned.evidence import evidence
from physgen.perceive.learned.network import Seen, closer
from physgen.perceive.learned.parts import parts
from physgen.perceive.proposals.circles import discs
from physgen.perceive.proposals.gradient import colour_gradient, lab
from physgen.perceive.proposals.proposal import Proposal, cut_out, distinct
from physgen.perceive.proposals.regions import stable_regions

SMALLEST, LARGEST = 0.0005, 0.6
"""Parts of the photo that an object may cover."""
MIDDLE, WIDTH = 0.8, 0.05
"""Of the logistic that turns a score of the choice by edges into how sure it is; chosen on tune and validation."""
ON = 0.2
"""Mean foreground of a proposal below which nobody need look closer."""
LEAST = 14
"""px of the network's grid, of the smallest proposal."""


@dataclass(frozen=True, eq=False)
class Candidates:
    """Proposals on a grid of `shape`, and what the network says of them."""

    shape: tuple[int, int]
    proposals: Sequence[Proposal]
    evidence: NDArray[np.float64]
    """(n, k), see `evidence.NAMES`."""
    learned: NDArray[np.bool_]
    """(n,): which of them the network proposed itself."""
    edges: NDArray[np.float64]
    """(n,) 0..1: how sure the choice by edges alone is of it; 0 where that did not take it."""


def candidates(rgb: NDArray[np.uint8], seen: Seen) -> Candidates:
    """Of a photo (H, W, 3) sRGB."""
    height, width = rgb.shape[:2]
    scale = min(1.0, closer(max(height, width)) / max(height, width))  # only outlines see the full photo
    size = max(1, round(width * scale)), max(1, round(height * scale))
    reduced = cv2.resize(rgb, size, interpolation=cv2.INTER_AREA) if scale < 1 else rgb
    shape = size[1], size[0]
    smallest, largest = (round(share * size[0] * size[1]) for share in (SMALLEST, LARGEST))
    gradient = colour_gradient(lab(reduced.astype(np.uint8)))
    colour = lab(reduced.astype(np.uint8))
    edges = stable_regions(colour, gradient, max(12, smallest), largest)
    edges += discs(gradient, max(12, smallest), largest)
    grid = seen.foreground.shape
    cells = grid[0] * grid[1]
    own = parts(seen, max(LEAST, round(SMALLEST * cells)), round(LARGEST * cells))
    pool: list[tuple[Proposal | None, Proposal | None, bool]] = [
        (one, rescaled(one, shape, grid), False) for one in distinct(edges)
    ]
    pool += [(rescaled(one, grid, shape), one, True) for one in distinct(own)]
    taken, scores, where = chosen_by_edges(rgb)
    first = len(pool)
    pool += [(rescaled(one, where, shape), rescaled(one, where, grid), False) for one in taken]
    sure = np.concatenate([np.zeros(first), 1 / (1 + np.exp((MIDDLE - scores) / WIDTH))])
    both = [
        (fine, rough, learned, agreed)
        for (fine, rough, learned), agreed in zip(pool, sure.tolist(), strict=True)
        if fine is not None and rough is not None and _on(rough, seen) >= ON
    ]
    return Candidates(
        shape,
        [fine for fine, _, _, _ in both],
        evidence([rough for _, rough, _, _ in both], seen),
        np.array([learned for _, _, learned, _ in both], bool),
        np.array([agreed for _, _, _, agreed in both], np.float64),
    )


def _on(one: Proposal, seen: Seen) -> float:
    """Mean foreground of a proposal on the network's grid."""
    left, top, right, bottom = one.box
    return float(seen.foreground[top:bottom, left:right][one.mask].mean())


def rescaled(one: Proposal, shape: tuple[int, int], onto: tuple[int, int]) -> Proposal | None:
    """A proposal on a grid of `shape` (h, w) as it lies on the grid `onto`; None where nothing is left of it."""
    down, right = onto[0] / shape[0], onto[1] / shape[1]
    left, top, end, bottom = one.box
    x0, y0 = int(left * right), int(top * down)
    x1, y1 = min(int(np.ceil(end * right)), onto[1]), min(int(np.ceil(bottom * down)), onto[0])
    # canvas pixel centres to those of the proposal
    matrix = np.array(
        [
            [1 / right, 0, (x0 + 0.5) / right - 0.5 - left],
            [0, 1 / down, (y0 + 0.5) / down - 0.5 - top],
        ]
    )
    soft = one.mask.astype(np.float32)
    if right < 1:  # many pixels become one
        blur = cv2.GaussianBlur(soft, (0, 0), 0.4 / right, borderType=cv2.BORDER_CONSTANT)
        soft = np.asarray(blur, np.float32)
    there = cv2.warpAffine(
        soft,
        matrix,
        (x1 - x0, y1 - y0),
        flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP,
        borderMode=cv2.BORDER_CONSTANT,
    )
    return cut_out(there >= 0.5, x0, y0, 1)
