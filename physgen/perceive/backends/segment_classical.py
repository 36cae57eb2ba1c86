"""Backend segment=classical: objects by edges, circles and colour, without a trained model."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from physgen.perceive.roles import Segment, Segments
from physgen.perceive.segment.proposals import Proposal
from physgen.perceive.segment.selection import search_edges, tighten


def classical() -> Segment:
    """The segmenter; it is deterministic and keeps no state."""
    return segment


def segment(rgb: NDArray[np.uint8]) -> Segments:
    """The movable objects of a photo (H, W, 3) uint8 sRGB."""
    found = search_edges(rgb)
    return as_segments(rgb, found.chosen, found.scores, confidence(found.scores), found.shape)


def as_segments(
    rgb: NDArray[np.uint8],
    proposals: Sequence[Proposal],
    scores: NDArray[np.float64],
    confidences: NDArray[np.float64],
    shape: tuple[int, int],
) -> Segments:
    """Proposals on a grid of `shape` (h, w) as labels of the photo, their outlines fitted to its edges, left to right.

    Of two with a common pixel the one with the better score gets it.
    """
    rising = np.argsort(scores, kind="stable")
    labels = tighten(rgb, [proposals[i].on(shape) for i in rising.tolist()])
    count = np.bincount(labels.ravel(), minlength=len(rising) + 1)
    x = np.bincount(labels.ravel(), np.indices(labels.shape)[1].ravel(), len(count)) / np.maximum(count, 1)
    order = 1 + np.argsort(x[1:], kind="stable")
    order = order[count[order] > 0]
    ids = np.zeros(len(count), np.uint16)
    ids[order] = np.arange(1, len(order) + 1)
    return Segments(ids[labels], confidences[rising][order - 1])


def confidence(score: NDArray[np.float64]) -> NDArray[np.float64]:
    """0..1 from a score, by a logistic fitted by eye: about half of the objects that score 0.7 are right."""
    return 1 / (1 + np.exp((0.7 - score) / 0.06))
