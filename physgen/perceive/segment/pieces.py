"""Pieces of one object: a robot's head, arms and base become one object again.

An object at rest has a support below it. Connected parts are one object if the detector
sees none of them as a whole and the network draws them as one in their common box.
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
    """Constants of the union, chosen on a robot and checked on photos with many
    objects.
    """

    # Least number of pieces: two pieces are often two objects.
    fewest: int = 3
    # Largest number of pieces: more are a heap.
    largest_count: int = 10
    # Largest gap between connected pieces over the size of all.
    gap: float = 0.06
    # Score of its box times squared IoU, below which an object may be a piece.
    own_box: float = 0.55
    # Least share of all pieces that the network draws as one.
    covered_share: float = 0.7
    # Least confidence of that mask.
    confidence: float = 0.7
    # Largest share of that mask outside all pieces.
    outside: float = 0.35
    # Least share of its rectangle or circle that a block or ball fills.
    regular: float = 0.9
    # Least share of such pieces in a stack.
    stack_share: float = 0.5
    # Largest closed gap between parts over the size of all.
    close: float = 0.02
    # Largest area of a filled hole over the object's.
    hole: float = 0.01


PIECES = PieceConstants()


def unite_pieces(
    rgb: NDArray[np.uint8], objects: Segments, boxes: DetectedBoxes
) -> Segments:
    """Return the objects with each group of pieces united, and ids without gaps."""
    ids = []
    for i in np.unique(objects.labels):
        if i > 0:
            ids.append(int(i))
    piece_ids = []
    for i in ids:
        if _box_score(objects.labels == i, boxes) < PIECES.own_box:
            piece_ids.append(i)
    if len(piece_ids) < PIECES.fewest:
        return objects
    labels = objects.labels.copy()
    confidence = objects.confidence.copy()
    for group in _groups(labels, piece_ids):
        union_mask = _unite_pieces(rgb, labels, group)
        if union_mask is not None:
            labels[np.isin(labels, group)] = 0
            labels[union_mask & (labels == 0)] = group[0]
            confidence[group[0] - 1] = confidence[np.array(group) - 1].mean()
    if np.array_equal(labels, objects.labels):
        return objects
    remaining_ids = np.unique(labels[labels > 0])
    numbers = np.zeros(len(confidence) + 1, np.uint16)
    numbers[remaining_ids] = np.arange(1, len(remaining_ids) + 1)
    return replace(
        objects, labels=numbers[labels], confidence=confidence[remaining_ids - 1]
    )


def _box_score(mask: Mask, boxes: DetectedBoxes) -> float:
    """Return the score of the detector's best box around a mask (H, W)."""
    if not len(boxes):
        return 0.0
    left, top, width, height = cv2.boundingRect(mask.view(np.uint8))
    own_box = np.array([[left, top, left + width, top + height]], np.float64)
    scores = box_overlap(own_box, boxes.corners)[0] ** 2 * boxes.movable
    return float(scores.max())


def _groups(labels: NDArray[np.uint16], ids: Sequence[int]) -> list[list[int]]:
    """Return groups of enough connected pieces, by their ids."""
    pieces = np.isin(labels, ids)
    size = float(np.sqrt(np.count_nonzero(pieces)))
    distance = cv2.distanceTransform((~pieces).view(np.uint8), cv2.DIST_L2, 5)
    _, names = cv2.connectedComponents(
        (distance <= PIECES.gap * size / 2).view(np.uint8), connectivity=8
    )
    groups: dict[int, list[int]] = {}
    for i in ids:
        name = int(names[labels == i].max())
        groups.setdefault(name, []).append(i)
    possible = range(PIECES.fewest, PIECES.largest_count + 1)
    return [group for group in groups.values() if len(group) in possible]


def _unite_pieces(
    rgb: NDArray[np.uint8], labels: NDArray[np.uint16], group: Sequence[int]
) -> Mask | None:
    """Return the mask (H, W) of the object that a group of pieces forms, or None.

    None means that the pieces are several objects.
    """
    if _is_stack(labels, group):
        return None
    pieces = np.isin(labels, group)
    left, top, width, height = cv2.boundingRect(pieces.view(np.uint8))
    prediction = mask_in_box(rgb, [left, top, left + width, top + height])
    covered_share = float(prediction.mask[pieces].mean())
    outside = float((prediction.mask & ~pieces).sum() / max(prediction.mask.sum(), 1))
    is_single = covered_share >= PIECES.covered_share and outside <= PIECES.outside
    if not is_single or prediction.confidence < PIECES.confidence:
        return None
    radius = max(1, round(PIECES.close * float(np.sqrt(np.count_nonzero(pieces)))))
    closed_mask = _close_gaps(pieces | prediction.mask, radius)
    _, names = cv2.connectedComponents(closed_mask, connectivity=8)
    counts = np.bincount(names[closed_mask > 0])
    return _without_holes(np.asarray(names == int(counts.argmax())))


def _close_gaps(mask: Mask, radius: int) -> NDArray[np.uint8]:
    """Return a mask (H, W) with its gaps up to twice a radius, px, closed."""
    kernel = cv2.getStructuringElement(
        cv2.MORPH_ELLIPSE, (2 * radius + 1, 2 * radius + 1)
    )
    padded_mask = np.pad(mask.astype(np.uint8), 2 * radius)
    closed_mask = cv2.morphologyEx(padded_mask, cv2.MORPH_CLOSE, kernel)
    return np.asarray(
        closed_mask[2 * radius : -2 * radius, 2 * radius : -2 * radius], np.uint8
    )


def _is_stack(labels: NDArray[np.uint16], group: Sequence[int]) -> bool:
    """Return whether most pieces are blocks or balls, which are stacked rather than
    connected.
    """
    count = sum(_is_regular(labels == i) for i in group)
    return count >= PIECES.stack_share * len(group)


def _is_regular(mask: Mask) -> bool:
    """Return whether a mask (H, W) fills its smallest rectangle or circle."""
    outlines, _ = cv2.findContours(
        mask.view(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE
    )
    outline = max(outlines, key=cv2.contourArea)
    area = cv2.contourArea(outline)
    _, (width, height), _ = cv2.minAreaRect(outline)
    _, radius = cv2.minEnclosingCircle(outline)
    smallest_area = min(width * height, np.pi * radius**2)
    return bool(area >= PIECES.regular * max(smallest_area, 1.0))


def _without_holes(mask: Mask) -> Mask:
    """Return a mask (H, W) with its small holes filled."""
    count, names, stats, _ = cv2.connectedComponentsWithStats(
        (~mask).view(np.uint8), connectivity=4
    )
    largest = PIECES.hole * np.count_nonzero(mask)
    is_small = stats[:count, cv2.CC_STAT_AREA] < largest
    is_small[0] = False
    return np.asarray(mask | is_small[names])
