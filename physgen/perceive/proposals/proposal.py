"""Proposals: masks that may be whole objects. Cutting out, comparing, joining, dropping doubles."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

Mask = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Proposal:
    """One connected region without holes, kept as the cut-out that bounds it."""

    x: int
    y: int
    mask: Mask
    """(h, w), its top-left pixel at (x, y) of the photo."""
    area: int
    """px."""

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
    return cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * radius + 1, 2 * radius + 1)).astype(np.uint8)


def outline(mask: Mask) -> NDArray[np.int32]:
    """(n, 2) int32: x, y of the pixels along the longest outer contour of a mask."""
    contours, _ = cv2.findContours(mask.astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    return max(contours, key=len)[:, 0].astype(np.int32)


def polygons(contour: NDArray[np.int32]) -> list[NDArray[np.int32]]:
    """Polygons of 4 to 6 corners (k, 2) close to a contour (n, 2): tightest rectangle, simplified hull."""
    found = [np.rint(cv2.boxPoints(cv2.minAreaRect(contour))).astype(np.int32)]
    hull, length = cv2.convexHull(contour), cv2.arcLength(contour, True)
    for tolerance in (0.02, 0.035, 0.06):
        corners = cv2.approxPolyDP(hull, tolerance * length, True)[:, 0].astype(np.int32)
        if 4 <= len(corners) <= 6:
            found.append(corners)
    return found


def cut_out(mask: Mask, x: int, y: int, smallest: int, opening: int = 0) -> Proposal | None:
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


def overlap(a: Proposal, b: Proposal) -> int:
    """Pixels that two proposals share."""
    left, top = max(a.x, b.x), max(a.y, b.y)
    right, bottom = min(a.box[2], b.box[2]), min(a.box[3], b.box[3])
    if right <= left or bottom <= top:
        return 0
    part_a = a.mask[top - a.y : bottom - a.y, left - a.x : right - a.x]
    part_b = b.mask[top - b.y : bottom - b.y, left - b.x : right - b.x]
    return int(np.count_nonzero(part_a & part_b))


def distinct(proposals: Sequence[Proposal], same: float = 0.96) -> list[Proposal]:
    """Proposals by area, without those whose intersection over union with a smaller one exceeds `same`."""
    kept: list[Proposal] = []
    first = 0  # kept[first:] are large enough to be the same as the one at hand
    for one in sorted(proposals, key=lambda proposal: proposal.area):
        while first < len(kept) and kept[first].area < same * one.area:
            first += 1
        slack = 4 + 0.12 * sum(one.mask.shape)
        for other in kept[first:]:
            if sum(abs(p - q) for p, q in zip(one.box, other.box, strict=True)) <= slack:
                shared = overlap(one, other)
                if shared > same * (one.area + other.area - shared):
                    break
        else:
            kept.append(one)
    return kept


def unions(proposals: Sequence[Proposal], scores: NDArray[np.float64], largest: int) -> list[Proposal]:
    """Unions of good proposals that touch along a good part of the smaller: objects of two colours."""
    best = [int(i) for i in np.argsort(-scores, kind="stable")[:160] if scores[i] > 0.45]
    reach = 1  # px
    grown = {i: _grow(proposals[i], reach) for i in best}
    pairs = []
    for rank, i in enumerate(best):
        for j in best[:rank]:
            small, large = sorted((proposals[i].area, proposals[j].area))
            if small + large > largest or large > 12 * small:
                continue
            touching = overlap(grown[i], grown[j]) / (2 * reach + 1) / (3.54 * np.sqrt(small))
            if touching > 0.2 and overlap(proposals[i], proposals[j]) <= 0.1 * small:
                pairs.append((min(scores[i], scores[j]) + 0.3 * min(1, touching), i, j))
    joined = (_join(grown[i], grown[j], reach) for _, i, j in sorted(pairs, reverse=True)[:350])
    return [union for union in joined if union is not None and union.area <= largest]


def _grow(proposal: Proposal, reach: int) -> Proposal:
    mask = cv2.dilate(np.pad(proposal.mask, reach).astype(np.uint8), disc(reach)) > 0
    return Proposal(proposal.x - reach, proposal.y - reach, mask, int(mask.sum()))


def _join(a: Proposal, b: Proposal, reach: int) -> Proposal | None:
    """The union of two grown proposals, shrunk again; the seam between them closes."""
    x, y = min(a.x, b.x), min(a.y, b.y)
    canvas = np.zeros((max(a.box[3], b.box[3]) - y, max(a.box[2], b.box[2]) - x), np.bool_)
    for one in (a, b):
        canvas[one.y - y : one.box[3] - y, one.x - x : one.box[2] - x] |= one.mask
    image = np.pad(canvas, 1).astype(np.uint8)
    shrunk = cv2.erode(image, disc(reach), iterations=1)[1:-1, 1:-1] > 0
    return cut_out(shrunk, x, y, smallest=1)


def variants(proposal: Proposal, shape: tuple[int, int]) -> list[Proposal]:
    """The proposal itself, then without bays, without spurs, its hull, polygons: undoes leaks along a weak edge.
    `shape`: H, W of the photo."""
    reach = max(1, round(0.12 * float(np.sqrt(proposal.area))))
    pad = 2 * reach
    image, ball = np.pad(proposal.mask, pad).astype(np.uint8), disc(reach)
    contour = outline(proposal.mask) + pad
    rounder = (cv2.convexHull(contour), *polygons(contour))
    changed = [
        cv2.morphologyEx(image, cv2.MORPH_CLOSE, ball),
        cv2.morphologyEx(image, cv2.MORPH_OPEN, ball),
        *(cv2.fillPoly(np.zeros_like(image), [one], 1) for one in rounder),
    ]
    x, y = proposal.x - pad, proposal.y - pad
    left, top = max(0, -x), max(0, -y)  # what the photo does not show
    inside = np.s_[top : shape[0] - y, left : shape[1] - x]
    others = (cut_out(one[inside] > 0, x + left, y + top, smallest=1) for one in changed)
    return [proposal, *(other for other in others if other is not None)]
