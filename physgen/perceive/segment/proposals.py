"""Proposals: masks that may be whole objects; cutting out, comparing, joining and scoring them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.perceive.roles import Doubt
from physgen.perceive.segment.gradient import Gradient, sample

Mask = NDArray[np.bool_]
STRAIGHT = 0.01
"""Of an outline's length: tolerance of a doubtful object's polygon."""


@dataclass(frozen=True, eq=False)
class Proposal:
    """A mask, kept as the cut-out that bounds it: many masks of a large photo would fill the memory."""

    x: int
    y: int
    mask: Mask  # (h, w), its top-left pixel at (x, y) of the photo
    area: int  # px

    @property
    def box(self) -> tuple[int, int, int, int]:
        """Left, top, right, bottom; the last two just outside."""
        return self.x, self.y, self.x + self.mask.shape[1], self.y + self.mask.shape[0]

    def on(self, shape: tuple[int, int]) -> Mask:
        """(H, W): the mask on the whole photo."""
        whole = np.zeros(shape, np.bool_)
        left, top, right, bottom = self.box
        whole[top:bottom, left:right] = self.mask
        return whole


def disc(radius: int) -> NDArray[np.uint8]:
    """The structuring element of a radius in px."""
    return cv2.getStructuringElement(
        cv2.MORPH_ELLIPSE, (2 * radius + 1, 2 * radius + 1)
    ).astype(np.uint8)


def outline(mask: Mask) -> NDArray[np.int32]:
    """(n, 2) int32: x, y of the pixels along the longest outer contour of a mask."""
    contours, _ = cv2.findContours(
        mask.astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE
    )
    return max(contours, key=len)[:, 0].astype(np.int32)


def polygons(contour: NDArray[np.int32]) -> list[NDArray[np.int32]]:
    """Polygons of 4 to 6 corners (k, 2) close to a contour (n, 2): tightest rectangle, simplified hull."""
    found = [np.rint(cv2.boxPoints(cv2.minAreaRect(contour))).astype(np.int32)]
    hull, length = cv2.convexHull(contour), cv2.arcLength(contour, True)
    for tolerance in (0.02, 0.035, 0.06):
        corners = cv2.approxPolyDP(hull, tolerance * length, True)[:, 0].astype(
            np.int32
        )
        if 4 <= len(corners) <= 6:
            found.append(corners)
    return found


def cut_out(
    mask: Mask, x: int, y: int, smallest: int, opening: int = 0
) -> Proposal | None:
    """The largest part of a mask whose corner lies at (x, y), opened by a disc and its holes filled;
    None when it holds fewer than `smallest` px."""
    image = np.pad(mask, opening + 1).astype(np.uint8)
    if opening:
        image = cv2.morphologyEx(image, cv2.MORPH_OPEN, disc(opening)).astype(np.uint8)
    count, parts, stats, _ = cv2.connectedComponentsWithStats(image, connectivity=4)
    if count < 2:
        return None
    largest = 1 + int(stats[1:, cv2.CC_STAT_AREA].argmax())
    left, top, width, height, _ = (int(value) for value in stats[largest])
    filled = np.zeros((height, width), np.uint8)
    part = parts[top : top + height, left : left + width] == largest
    cv2.fillPoly(filled, [outline(part)], 1)
    area = int(filled.sum())
    if area < smallest:
        return None
    return Proposal(x + left - opening - 1, y + top - opening - 1, filled > 0, area)


def common(a: Proposal, b: Proposal) -> tuple[slice, slice]:
    """The part of the mask of `a` that lies in the box of `b`; empty where they do not meet."""
    left, top, right, bottom = b.box
    return (
        slice(max(top - a.y, 0), max(bottom - a.y, 0)),
        slice(max(left - a.x, 0), max(right - a.x, 0)),
    )


def overlap(a: Proposal, b: Proposal) -> int:
    """Pixels that two proposals share."""
    part = a.mask[common(a, b)]
    return int(np.count_nonzero(part & b.mask[common(b, a)])) if part.size else 0


def doubt_about(
    one: Proposal, confidence: float, scale: tuple[float, float] = (1.0, 1.0)
) -> list[Doubt]:
    """A doubtful object on a photo `scale` (across, down) times as large as the proposal's, with few corners; none
    where its outline is too thin."""
    contour = outline(one.mask)
    corners = cv2.approxPolyDP(contour, STRAIGHT * cv2.arcLength(contour, True), True)[
        :, 0
    ] + [one.x, one.y]
    if len(corners) < 3:
        return []
    points = np.round((corners + 0.5) * scale - 0.5, 1)
    return [Doubt([(float(x), float(y)) for x, y in points], round(confidence, 3))]


def distinct(proposals: Sequence[Proposal], same: float = 0.96) -> list[Proposal]:
    """Proposals by area, without those whose intersection over union with a smaller one exceeds `same`."""
    kept: list[Proposal] = []
    first = 0  # kept[first:] are large enough to be the same as the one at hand
    for one in sorted(proposals, key=lambda proposal: proposal.area):
        while first < len(kept) and kept[first].area < same * one.area:
            first += 1
        slack = 4 + 0.12 * sum(one.mask.shape)
        for other in kept[first:]:
            if (
                sum(abs(p - q) for p, q in zip(one.box, other.box, strict=True))
                <= slack
            ):
                shared = overlap(one, other)
                if shared > same * (one.area + other.area - shared):
                    break
        else:
            kept.append(one)
    return kept


def iou(a: Proposal, b: Proposal) -> float:
    """Intersection over union."""
    common = overlap(a, b)
    return common / max(a.area + b.area - common, 1)


POINTS = 96
"""Samples along an outline."""


@dataclass(frozen=True, eq=False)
class Scores:
    """(n,) float64 each."""

    score: NDArray[np.float64]  # About 0.6 for a doubtful object, 1 for a perfect one
    compactness: NDArray[
        np.float64
    ]  # Isoperimetric quotient: 1 for a disc, less for longer outlines


def contour_normals(contour: NDArray[np.int32]) -> NDArray[np.float64]:
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


def score_proposals(
    proposals: Sequence[Proposal], colour: NDArray[np.float32], gradient: Gradient
) -> Scores:
    """The looks of each proposal, from its outline and shape. The score is a weighted geometric mean (weights
    chosen on photos): edges along all of the outline and along its weakest quarter, contrast between its two
    sides, solidity, likeness to an ellipse or a polygon of few corners, not being a mere line, and how little
    the border of the photo cuts off."""
    if not proposals:
        return Scores(np.zeros(0), np.zeros(0))
    height, width = gradient.strength.shape
    contours = [outline(proposal.mask) for proposal in proposals]
    rim = np.zeros((len(proposals), POINTS, 4))
    for i, (proposal, contour) in enumerate(zip(proposals, contours, strict=True)):
        at = np.linspace(0, len(contour), POINTS, endpoint=False).astype(int)
        rim[i] = np.hstack(
            [np.add(contour, (proposal.x, proposal.y)), contour_normals(contour)]
        )[at]
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
    weakest = np.array(
        [row[: max(1, n // 4)].mean() for row, n in zip(rising, count, strict=True)]
    )
    weakest[free.sum(1) <= 8] = 0

    soft, side = (
        cv2.GaussianBlur(colour, (0, 0), 1.5).astype(np.float32),
        np.maximum(3, reach),
    )
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
    crosses = ((left <= 2) & (right >= width - 2)) | (
        (top <= 2) & (bottom >= height - 2)
    )
    return Scores(np.where(crosses, 0.6, 1) * score, compactness)


def _shape(mask: Mask, contour: NDArray[np.int32]) -> tuple[float, float, float]:
    """Solidity, likeness (intersection over union) to the ellipse or polygon that fits best, compactness."""
    area, length = cv2.contourArea(contour), cv2.arcLength(contour, True)
    solidity = (area + length / 2 + 1) / (
        cv2.contourArea(cv2.convexHull(contour)) + length / 2 + 1
    )
    y, x = np.nonzero(mask)
    spread = np.cov(x, y) + 0.08 * np.eye(2)
    along, down = (
        np.arange(mask.shape[1]) - x.mean(),
        np.arange(mask.shape[0])[:, None] - y.mean(),
    )
    form = np.linalg.inv(spread)
    shapes = [
        form[0, 0] * along**2 + 2 * form[0, 1] * along * down + form[1, 1] * down**2
        <= 4
    ]
    blank = np.zeros(mask.shape, np.uint8)
    shapes += [
        cv2.fillPoly(blank.copy(), [corners], 1) > 0 for corners in polygons(contour)
    ]
    likeness = max(
        float((shape & mask).sum() / (shape | mask).sum()) for shape in shapes
    )
    return float(solidity), likeness, float(4 * np.pi * area / max(length, 1) ** 2)
