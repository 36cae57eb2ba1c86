"""Photo -> masks that may be objects, by edges and circles and by the network, and what the network says of each."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.perceive.backends.segment_classical import LEAST, MOST, edges
from physgen.perceive.learned.evidence import evidence
from physgen.perceive.learned.judge import expected
from physgen.perceive.learned.network import Seen
from physgen.perceive.learned.parts import guided, parts
from physgen.perceive.proposals.proposal import Proposal, cut_out, distinct

MIDDLE, WIDTH = 0.8, 0.05
"""Of the logistic that turns a score of the choice by edges into how sure it is; chosen on tune and validation."""
ON = 0.2
"""Mean foreground of a proposal below which nobody need look closer."""
SMALLEST = 14
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
    by_edges = edges(rgb)
    shape, grid = by_edges.shape, seen.foreground.shape
    cells = grid[0] * grid[1]
    own = parts(seen, max(SMALLEST, round(LEAST * cells)), round(MOST * cells))
    bounds = (max(12, round(part * shape[0] * shape[1])) for part in (LEAST, MOST))
    both_ways = distinct([*by_edges.proposals, *guided(by_edges.gradient, seen, *bounds)])
    pool: list[tuple[Proposal | None, Proposal | None, bool]] = [
        (one, rescaled(one, shape, grid), False) for one in (*by_edges.chosen, *both_ways)
    ]
    pool += [(rescaled(one, grid, shape), one, True) for one in distinct(own)]
    sure = np.zeros(len(pool))
    sure[: len(by_edges.chosen)] = 1 / (1 + np.exp((MIDDLE - by_edges.scores) / WIDTH))
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


def judged(some: Sequence[Proposal], seen: Seen, shape: tuple[int, int]) -> NDArray[np.float64]:
    """(n,) 0..1: how well proposals on a grid of `shape` (h, w) are expected to fit."""
    there = [rescaled(one, shape, seen.foreground.shape) for one in some]
    fit = np.zeros(len(some))
    known = [k for k, one in enumerate(there) if one is not None]
    if known:
        fit[known] = expected(evidence([one for one in there if one is not None], seen))
    return fit


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
