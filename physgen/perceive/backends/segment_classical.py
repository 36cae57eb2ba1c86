"""Photo -> labels of movable objects, without training: edges propose, a joint choice keeps the best."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.perceive.proposals.choose import choose
from physgen.perceive.proposals.circles import discs
from physgen.perceive.proposals.gradient import colour_gradient, lab
from physgen.perceive.proposals.proposal import Proposal, distinct, unions, variants
from physgen.perceive.proposals.regions import stable_regions
from physgen.perceive.proposals.score import Looks, looks
from physgen.perceive.proposals.tighten import tighten
from physgen.perceive.roles import Segment, Segments

WORKING_AREA = 512 * 512
"""px that the search looks at; larger photos are reduced to it, and only the outlines see the full photo."""
WORKING_SIDE = 4096
"""px; the longest side that the search looks at, of a panorama."""
SMALLEST, LARGEST = 0.0012, 0.22
"""Parts of the photo that an object may cover."""


def classical() -> Segment:
    """The segmenter; it keeps nothing between photos and draws no random numbers."""
    return segment


def segment(rgb: NDArray[np.uint8]) -> Segments:
    """The movable objects of a photo (H, W, 3) uint8 sRGB."""
    proposals, scores, shape = chosen_by_edges(rgb)
    return told(rgb, proposals, scores, confidence(scores), shape)


def chosen_by_edges(
    rgb: NDArray[np.uint8],
) -> tuple[list[Proposal], NDArray[np.float64], tuple[int, int]]:
    """The objects of a photo (H, W, 3), their scores, and the size (h, w) of the grid that they lie on."""
    height, width = rgb.shape[:2]
    scale = min(1.0, (WORKING_AREA / (height * width)) ** 0.5, WORKING_SIDE / max(height, width))
    size = max(1, round(width * scale)), max(1, round(height * scale))
    reduced = cv2.resize(rgb, size, interpolation=cv2.INTER_AREA) if scale < 1 else rgb
    return *find(reduced.astype(np.uint8)), (size[1], size[0])


def told(
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


def find(rgb: NDArray[np.uint8]) -> tuple[list[Proposal], NDArray[np.float64]]:
    """The objects of a photo of working size, and their scores."""
    shape = rgb.shape[0], rgb.shape[1]
    smallest, largest = max(12, round(SMALLEST * shape[0] * shape[1])), round(LARGEST * shape[0] * shape[1])
    colour = lab(rgb)
    gradient = colour_gradient(colour)
    regions = stable_regions(colour, gradient, smallest, largest)
    proposals = distinct(regions + discs(gradient, smallest, largest))
    seen = looks(proposals, colour, gradient)
    joined = distinct(unions(proposals, seen.score, largest))
    more = looks(joined, colour, gradient)
    everything = Looks(np.append(seen.score, more.score), np.append(seen.compactness, more.compactness))
    chosen, scores = choose(proposals + joined, everything, colour)
    forms = [variants(proposal, shape) for proposal in chosen]
    return [form[int(looks(form, colour, gradient).score.argmax())] for form in forms], scores
