"""Centres of circles by votes of gradients.

Gradients on a circle point at its centre (Loy and Zelinsky, Fast radial symmetry for
detecting points of interest, 2003).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

STRONG = 0.7
"""Quantile of gradients above which they vote: most of a picture is not an edge."""
WEAKEST = 4.0
"""Smallest gradient beyond noise, 8-bit codes per px."""
SPREAD = 0.12
"""Standard deviation of votes, radii, for a circle seen slightly from the side."""


@dataclass(frozen=True)
class _Edges:
    """Edge pixels that vote for the centres of circles."""

    rows: NDArray[np.intp]
    """(E,) px."""
    columns: NDArray[np.intp]
    """(E,) px."""
    directions: NDArray[np.floating]
    """Unit gradients, (2, E): x, y."""

    def votes(self, radius: float, shape: tuple[int, int]) -> NDArray[np.float32]:
        """Return the number of edges at `radius` (px) from each pixel, (h, w)."""
        height, width = shape
        total = np.zeros(height * width, np.float32)
        for sign in (1, -1):
            offsets = sign * radius * self.directions
            x = np.rint(self.columns + offsets[0]).astype(np.int64)
            y = np.rint(self.rows + offsets[1]).astype(np.int64)
            is_inside = (x >= 0) & (x < width) & (y >= 0) & (y < height)
            place = y[is_inside] * width + x[is_inside]
            # A circle may be brighter or darker than its surroundings.
            counts = np.bincount(place, minlength=height * width)
            total = np.maximum(total, counts.astype(np.float32))
        return total.reshape(height, width)


def circle_votes(
    grey: NDArray[np.float32], region: NDArray[np.bool_], radii: Sequence[float]
) -> NDArray[np.float32]:
    """Return `(R, h, w)` the share of a circle of each radius about each pixel.

    `grey` (h, w) has 8-bit codes; edges in and beside `region` (h, w) vote.
    """
    # Grain would turn the gradients of single pixels.
    blurred_grey = cv2.GaussianBlur(grey, (0, 0), 1.0)
    gx = cv2.Sobel(blurred_grey, cv2.CV_32F, 1, 0)
    gy = cv2.Sobel(blurred_grey, cv2.CV_32F, 0, 1)
    size = np.hypot(gx, gy)
    surroundings = cv2.dilate(region.astype(np.uint8), np.ones((5, 5), np.uint8)) > 0
    if not surroundings.any():
        return np.zeros((len(radii), *grey.shape), np.float32)
    # The limit follows the picture: a pale wheel has weak edges.
    lowest_gradient = max(float(np.quantile(size[surroundings], STRONG)), WEAKEST)
    rows, columns = np.nonzero(surroundings & (size >= lowest_gradient))
    directions = np.stack([gx, gy])[:, rows, columns] / size[rows, columns]
    edges = _Edges(rows, columns, directions)
    votes = []
    # Votes of one radius add up at the centre; those of other radii form a ring
    # around it.
    for radius in radii:
        total = edges.votes(radius, grey.shape)
        spread = max(SPREAD * radius, 1.0)
        picture = cv2.GaussianBlur(total, (0, 0), spread)
        # Normalise such that the votes of a complete circle, spread over its centre,
        # give 1.
        votes.append(picture * (2 * np.pi * spread**2) / (2 * np.pi * radius))
    return np.stack(votes)
