"""Pieces of one object: a robot's head, arms and base become one object again.

What lies at rest is held by something below it. Parts that hang together, of which the
detector sees none as a whole, and which the network draws as one in the box around all
of them, are one object.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.perceive.roles import Segments
from physgen.perceive.segment.detector import DetectedBoxes, box_overlap
from physgen.perceive.segment.network import mask_in_box

Mask = NDArray[np.bool_]


@dataclass(frozen=True)
class PieceConstants:
    """Constants of the union, chosen on a robot and checked on photos of many objects."""

    fewest: int = 3  # pieces of an object: two are as often two objects
    most: int = 10  # pieces: more are a heap
    gap: float = 0.06  # of the size of all: between pieces that hang together
    own_box: float = 0.55  # score of its box, times squared IoU: a piece has less
    covered: float = 0.7  # share of all pieces that the network draws as one
    confidence: float = 0.7  # of that drawing, at least
    outside: float = 0.35  # of it that lies in no piece, at most
    regular: float = 0.9  # share of its rectangle or circle that a block or ball fills
    stacked: float = 0.5  # share of such pieces from which all are a stack
    close: float = 0.02  # of the size of all: gaps between parts that are closed
    hole: float = 0.01  # of the object's area: smaller holes in it belong to it


PIECES = PieceConstants()


def unite_pieces(
    rgb: NDArray[np.uint8], objects: Segments, boxes: DetectedBoxes
) -> Segments:
    """Return the objects, groups of pieces as one object each, ids without gaps."""
    ids = [int(i) for i in np.unique(objects.labels) if i > 0]
    weak = [i for i in ids if _box_score(objects.labels == i, boxes) < PIECES.own_box]
    if len(weak) < PIECES.fewest:
        return objects
    labels, confidence = objects.labels.copy(), objects.confidence.copy()
    for group in _groups(labels, weak):
        whole = _whole(rgb, labels, group)
        if whole is not None:
            labels[np.isin(labels, group)] = 0
            labels[whole & (labels == 0)] = group[0]
            confidence[group[0] - 1] = confidence[np.array(group) - 1].mean()
    if np.array_equal(labels, objects.labels):
        return objects
    kept = np.unique(labels[labels > 0])
    numbers = np.zeros(len(confidence) + 1, np.uint16)
    numbers[kept] = np.arange(1, len(kept) + 1)
    return replace(objects, labels=numbers[labels], confidence=confidence[kept - 1])


def _box_score(mask: Mask, boxes: DetectedBoxes) -> float:
    """Return the score of the detector's best box around a mask (H, W)."""
    if not len(boxes):
        return 0.0
    left, top, width, height = cv2.boundingRect(mask.view(np.uint8))
    own = np.array([[left, top, left + width, top + height]], np.float64)
    scores = box_overlap(own, boxes.corners)[0] ** 2 * boxes.movable
    return float(scores.max())


def _groups(labels: NDArray[np.uint16], ids: Sequence[int]) -> list[list[int]]:
    """Return the groups of enough pieces that hang together, by their ids."""
    pieces = np.isin(labels, ids)
    size = float(np.sqrt(np.count_nonzero(pieces)))
    away = cv2.distanceTransform((~pieces).view(np.uint8), cv2.DIST_L2, 5)
    _, names = cv2.connectedComponents(
        (away <= PIECES.gap * size / 2).view(np.uint8), connectivity=8
    )
    groups: dict[int, list[int]] = {}
    for i in ids:
        name = int(names[labels == i].max())
        groups.setdefault(name, []).append(i)
    possible = range(PIECES.fewest, PIECES.most + 1)
    return [group for group in groups.values() if len(group) in possible]


def _whole(
    rgb: NDArray[np.uint8], labels: NDArray[np.uint16], group: Sequence[int]
) -> Mask | None:
    """Return the object that a group of pieces is (H, W); None if they are several."""
    if _is_stack(labels, group):
        return None
    pieces = np.isin(labels, group)
    left, top, width, height = cv2.boundingRect(pieces.view(np.uint8))
    drawn = mask_in_box(rgb, [left, top, left + width, top + height])
    covered = float(drawn.mask[pieces].mean())
    outside = float((drawn.mask & ~pieces).sum() / max(drawn.mask.sum(), 1))
    is_whole = covered >= PIECES.covered and outside <= PIECES.outside
    if not is_whole or drawn.confidence < PIECES.confidence:
        return None
    radius = max(1, round(PIECES.close * float(np.sqrt(np.count_nonzero(pieces)))))
    kernel = cv2.getStructuringElement(
        cv2.MORPH_ELLIPSE, (2 * radius + 1, 2 * radius + 1)
    )
    union = np.pad((pieces | drawn.mask).astype(np.uint8), 2 * radius)
    closed = cv2.morphologyEx(union, cv2.MORPH_CLOSE, kernel)
    closed = closed[2 * radius : -2 * radius, 2 * radius : -2 * radius]
    _, names = cv2.connectedComponents(closed, connectivity=8)
    counts = np.bincount(names[closed > 0])
    return _without_holes(np.asarray(names == int(counts.argmax())))


def _is_stack(labels: NDArray[np.uint16], group: Sequence[int]) -> bool:
    """Return whether most pieces have the shape of a block or a ball: these are stacked."""
    count = sum(_is_regular(labels == i) for i in group)
    return count >= PIECES.stacked * len(group)


def _is_regular(mask: Mask) -> bool:
    """Return whether a mask (H, W) fills its smallest rectangle or circle."""
    outlines, _ = cv2.findContours(
        mask.view(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE
    )
    outline = max(outlines, key=cv2.contourArea)
    area = cv2.contourArea(outline)
    _, (width, height), _ = cv2.minAreaRect(outline)
    _, radius = cv2.minEnclosingCircle(outline)
    least = min(width * height, np.pi * radius**2)
    return bool(area >= PIECES.regular * max(least, 1.0))


def _without_holes(mask: Mask) -> Mask:
    """Return a mask (H, W) with its small holes filled."""
    count, names, stats, _ = cv2.connectedComponentsWithStats(
        (~mask).view(np.uint8), connectivity=4
    )
    largest = PIECES.hole * np.count_nonzero(mask)
    is_small = stats[:count, cv2.CC_STAT_AREA] < largest
    is_small[0] = False
    return np.asarray(mask | is_small[names])
