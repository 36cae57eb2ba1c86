"""Proposals + gradient -> how much each looks like one whole object: outlined by edges, of compact shape."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.perceive.proposals.gradient import Gradient, sample
from physgen.perceive.proposals.proposal import Mask, Proposal, outline, polygons

POINTS = 96
"""Samples along an outline."""


@dataclass(frozen=True, eq=False)
class Looks:
    """What the choice weighs, (n,) float64 each."""

    score: NDArray[np.float64]
    """About 0.6 for a doubtful object, 1 for a perfect one."""
    compactness: NDArray[np.float64]
    """Isoperimetric quotient: 1 for a disc, less for longer outlines."""


def normals(contour: NDArray[np.int32]) -> NDArray[np.float64]:
    """(n, 2): the outward unit normals of a closed contour (n, 2) of pixels, its steps smoothed."""
    sigma = max(1.0, 0.012 * len(contour))
    ends = int(3 * sigma) + 3
    closed = np.pad(contour, ((ends, ends), (0, 0)), mode="wrap").astype(np.float64)
    smooth = cv2.GaussianBlur(closed, (1, 2 * ends - 3), sigmaX=0.1, sigmaY=sigma)
    along = (smooth[4:] - smooth[:-4])[ends - 2 : ends - 2 + len(contour)]
    along /= np.linalg.norm(along, axis=1, keepdims=True) + 1e-6
    x, y = contour.T.astype(np.float64)
    turn = 1 if (x * np.roll(y, -1) - y * np.roll(x, -1)).sum() >= 0 else -1
    return turn * np.stack([along[:, 1], -along[:, 0]], 1)


def looks(proposals: Sequence[Proposal], colour: NDArray[np.float32], gradient: Gradient) -> Looks:
    """The looks of each proposal, from its outline and shape. The score is a weighted geometric mean (weights
    chosen on photos): edges along all of the outline and along its weakest quarter, contrast between its two
    sides, solidity, likeness to an ellipse or a polygon of few corners, not being a mere line, and how little
    the border of the photo cuts off."""
    if not proposals:
        return Looks(np.zeros(0), np.zeros(0))
    height, width = gradient.strength.shape
    contours = [outline(proposal.mask) for proposal in proposals]
    rim = np.zeros((len(proposals), POINTS, 4))
    for i, (proposal, contour) in enumerate(zip(proposals, contours, strict=True)):
        at = np.linspace(0, len(contour), POINTS, endpoint=False).astype(int)
        rim[i] = np.hstack([np.add(contour, (proposal.x, proposal.y)), normals(contour)])[at]
    x, y, nx, ny = np.moveaxis(rim, 2, 0)
    free = (x >= 2.5) & (y >= 2.5) & (x <= width - 3.5) & (y <= height - 3.5)
    count = np.maximum(free.sum(1), 1)

    reach = np.clip(0.03 * np.sqrt([[proposal.area] for proposal in proposals]), 1.5, 4)
    angle, edge = np.arctan2(ny, nx), np.zeros_like(x)
    for step in np.linspace(-1, 1, 7):
        here = gradient.across(x + step * reach * nx, y + step * reach * ny, angle)
        edge = np.maximum(edge, here * (1 - 0.25 * step * step))
    support = np.where(free, gradient.support(edge), np.inf)
    cover = np.where(free, support, 0).sum(1) / count
    rising = np.sort(support, 1)
    weakest = np.array([row[: max(1, n // 4)].mean() for row, n in zip(rising, count, strict=True)])
    weakest[free.sum(1) <= 8] = 0

    soft, side = cv2.GaussianBlur(colour, (0, 0), 1.5).astype(np.float32), np.maximum(3, reach)
    inside, outside = (sample(soft, x + s * nx, y + s * ny) for s in (-side, side))
    step = np.linalg.norm(inside - outside, axis=2)
    contrast = (step / (step + 8) * free).sum(1) / count

    shapes = [_shape(p.mask, c) for p, c in zip(proposals, contours, strict=True)]
    solidity, likeness, compactness = np.array(shapes).T
    terms = (
        (1.2, cover + 1e-3),
        (0.6, weakest + 0.05),
        (0.6, contrast + 0.01),
        (2.0, solidity),
        (1.0, likeness + 1e-3),
        (0.5, np.clip(5 * compactness, 0.01, 1)),
        (1.5, np.maximum(free.mean(1), 0.01)),
    )
    score = np.exp(sum(weight * np.log(term) for weight, term in terms) / 2.4)
    left, top, right, bottom = np.array([proposal.box for proposal in proposals]).T
    crosses = ((left <= 2) & (right >= width - 2)) | ((top <= 2) & (bottom >= height - 2))
    return Looks(np.where(crosses, 0.6, 1) * score, compactness)


def _shape(mask: Mask, contour: NDArray[np.int32]) -> tuple[float, float, float]:
    """Solidity, likeness (intersection over union) to the ellipse or polygon that fits best, compactness."""
    area, length = cv2.contourArea(contour), cv2.arcLength(contour, True)
    solidity = (area + length / 2 + 1) / (cv2.contourArea(cv2.convexHull(contour)) + length / 2 + 1)
    y, x = np.nonzero(mask)
    spread = np.cov(x, y) + 0.08 * np.eye(2)
    along, down = np.arange(mask.shape[1]) - x.mean(), np.arange(mask.shape[0])[:, None] - y.mean()
    form = np.linalg.inv(spread)
    shapes = [form[0, 0] * along**2 + 2 * form[0, 1] * along * down + form[1, 1] * down**2 <= 4]
    blank = np.zeros(mask.shape, np.uint8)
    shapes += [cv2.fillPoly(blank.copy(), [corners], 1) > 0 for corners in polygons(contour)]
    likeness = max(float((shape & mask).sum() / (shape | mask).sum()) for shape in shapes)
    return float(solidity), likeness, float(4 * np.pi * area / max(length, 1) ** 2)
