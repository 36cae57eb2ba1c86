"""Photo -> labels of movable objects, without training: edges propose, a joint choice keeps the best."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.perceive.roles import Segment, Segments
from physgen.perceive.segment.gradient import Gradient, colour_gradient, smoothed_lab
from physgen.perceive.segment.proposals import Proposal, Scores, distinct, score_proposals, unions, variants
from physgen.perceive.segment.regions import discs, stable_regions
from physgen.perceive.segment.selection import select, tighten

WORKING_AREA = 512 * 512
"""px that the search looks at; larger photos are reduced to it, and only the outlines see the full photo."""
WORKING_SIDE = 4096
"""px; the longest side that the search looks at, of a panorama."""
SMALLEST, LARGEST = 0.0012, 0.22
"""Parts of the photo that an object may cover, where edges alone choose."""
LEAST, MOST = 0.0005, 0.6
"""And where others do."""


def classical() -> Segment:
    """The segmenter; it keeps nothing between photos and draws no random numbers."""
    return segment


def segment(rgb: NDArray[np.uint8]) -> Segments:
    """The movable objects of a photo (H, W, 3) uint8 sRGB."""
    found = search_edges(rgb)
    return as_segments(rgb, found.chosen, found.scores, confidence(found.scores), found.shape)


def as_segments(
    rgb: NDArray[np.uint8],
    proposals: Sequence[Proposal],
    scores: NDArray[np.float64],
    sure: NDArray[np.float64],
    shape: tuple[int, int],
) -> Segments:
    """Proposals on a grid of `shape` (h, w) as labels of the photo, with outlines on its edges, left to right.

    Of two that contend for a pixel the one of the better score gets it.
    """
    rising = np.argsort(scores, kind="stable")
    labels = tighten(rgb, [proposals[i].on(shape) for i in rising.tolist()])
    count = np.bincount(labels.ravel(), minlength=len(rising) + 1)
    x = np.bincount(labels.ravel(), np.indices(labels.shape)[1].ravel(), len(count)) / np.maximum(count, 1)
    order = 1 + np.argsort(x[1:], kind="stable")
    order = order[count[order] > 0]
    ids = np.zeros(len(count), np.uint16)
    ids[order] = np.arange(1, len(order) + 1)
    return Segments(ids[labels], sure[rising][order - 1])


def confidence(score: NDArray[np.float64]) -> NDArray[np.float64]:
    """A score as 0..1, a logistic set by eye on a few photos: about half of the objects that score 0.7 are right."""
    return 1 / (1 + np.exp((0.7 - score) / 0.06))


@dataclass(frozen=True, eq=False)
class EdgeSearch:
    """What edges and circles say of a photo, on a grid of `shape` (h, w)."""

    shape: tuple[int, int]
    gradient: Gradient
    proposals: Sequence[Proposal]
    """All that may be objects, larger and smaller ones too than are chosen from."""
    chosen: Sequence[Proposal]
    """The best of them together, and of their unions."""
    scores: NDArray[np.float64]
    """(n,) of the chosen ones."""


def search_edges(rgb: NDArray[np.uint8]) -> EdgeSearch:
    """Of a photo (H, W, 3) uint8 sRGB."""
    height, width = rgb.shape[:2]
    scale = min(1.0, (WORKING_AREA / (height * width)) ** 0.5, WORKING_SIDE / max(height, width))
    size = max(1, round(width * scale)), max(1, round(height * scale))
    reduced = cv2.resize(rgb, size, interpolation=cv2.INTER_AREA) if scale < 1 else rgb
    shape = size[1], size[0]
    least, smallest, largest, most = (
        round(part * size[0] * size[1]) for part in (LEAST, SMALLEST, LARGEST, MOST)
    )
    least, smallest = max(12, least), max(12, smallest)
    colour = smoothed_lab(np.asarray(reduced, np.uint8))
    gradient = colour_gradient(colour)
    every = stable_regions(colour, gradient, least, most)
    round_ = discs(gradient, smallest, largest)
    proposals = distinct([one for one in every if smallest <= one.area <= largest] + round_)
    seen = score_proposals(proposals, colour, gradient)
    joined = distinct(unions(proposals, seen.score, largest))
    more = score_proposals(joined, colour, gradient)
    everything = Scores(np.append(seen.score, more.score), np.append(seen.compactness, more.compactness))
    chosen, scores = select(proposals + joined, everything, colour)
    forms = [variants(proposal, shape) for proposal in chosen]
    best = [form[int(score_proposals(form, colour, gradient).score.argmax())] for form in forms]
    return EdgeSearch(shape, gradient, distinct(every + round_), best, scores)
