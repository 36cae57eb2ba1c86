"""The detector: boxes around whole objects, with scores.

`studio/segmentation/detector.py` describes the network and its outputs; OpenCV runs it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from threading import Lock

import cv2
import numpy as np
from numpy.typing import NDArray

F32 = NDArray[np.float32]
Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

WEIGHTS = "detector.onnx"
SIDE = 416  # px of the square input
STRIDES = (8, 16, 32, 64)  # px of a cell of each level
BINS = 8  # of the distribution of a distance
MEAN = (103.53, 116.28, 123.675)
SPREAD = (57.375, 57.12, 58.395)
"""Of blue, green and red: the input is (code - MEAN) / SPREAD."""
LEAST_SCORE = 0.05
"""Of movable or immovable wholes, or of a class: a box below it is dropped."""
SAME_BOX = 0.6
"""IoU from which two boxes mean one object; the better one stays."""
MOST_BOXES = 60
"""Boxes of a photo at most, the best ones."""

_lock = Lock()
"""A net holds state between its calls."""


@dataclass(frozen=True, eq=False)
class DetectedBoxes:
    """Boxes of a photo, the best first."""

    corners: Array  # (n, 4) px: left, top, right, bottom, on the photo
    scores: Array  # (n, 82) 0..1: movable whole, immovable whole, COCO's classes

    @property
    def movable(self) -> Array:
        """(n,) 0..1: the score of a whole object that a person could move."""
        return self.scores[:, 0]

    @property
    def immovable(self) -> Array:
        """(n,) 0..1: the score of a whole that is not moved."""
        return self.scores[:, 1]

    @property
    def classes(self) -> Array:
        """(n, 80) 0..1: the scores of COCO's classes."""
        return self.scores[:, 2:]

    def as_movable(self, selected: Flags, classes: Sequence[int]) -> DetectedBoxes:
        """Return the boxes, selected ones (n,) as movable and of none of some classes."""
        scores = self.scores.copy()
        scores[selected, 0] = scores[selected, :2].max(axis=1)
        scores[selected, 1] = 0
        for index in classes:
            scores[selected, 2 + index] = 0
        return replace(self, scores=scores)

    def scaled(self, across: float, down: float) -> DetectedBoxes:
        """Return the boxes on a photo of another size."""
        return replace(self, corners=self.corners * (across, down, across, down))

    def __len__(self) -> int:
        """Return the number of boxes."""
        return len(self.corners)


def detect_boxes(rgb: NDArray[np.uint8]) -> DetectedBoxes:
    """Return the boxes of a photo (H, W, 3) sRGB after suppression of doubles."""
    height, width = rgb.shape[:2]
    scale = SIDE / max(height, width)
    scores, distances = run_levels(_as_input(rgb, scale))
    corners = _decode(distances) / scale
    corners = np.clip(corners, 0, (width, height, width, height))
    best = scores.max(axis=1)
    kept = np.flatnonzero(best > LEAST_SCORE)
    corners, scores, best = corners[kept], scores[kept], best[kept]
    order = _suppress(corners, best)
    return DetectedBoxes(corners[order], scores[order])


def _as_input(rgb: NDArray[np.uint8], scale: float) -> F32:
    """Return the photo, scaled, at the top left of a black square (1, 3, 416, 416)."""
    size = [max(1, min(round(side * scale), SIDE)) for side in rgb.shape[1::-1]]
    how = cv2.INTER_AREA if scale < 1 else cv2.INTER_LINEAR
    square = np.zeros((SIDE, SIDE, 3), np.float32)
    square[: size[1], : size[0]] = cv2.resize(rgb, size, interpolation=how)[..., ::-1]
    blob = np.asarray((square - np.array(MEAN)) / np.array(SPREAD), np.float32)
    return np.ascontiguousarray(blob.transpose(2, 0, 1)[None])


def run_levels(blob: F32) -> tuple[Array, Array]:
    """Return scores (N, 82) and logits of distances (N, 32) of the cells of all levels."""
    network = _network()
    names = [f"{kind}-{stride}" for kind in ("scores", "boxes") for stride in STRIDES]
    with _lock:
        network.setInput(blob)
        parts = [np.array(part[0], np.float64) for part in network.forward(names)]
    levels = len(STRIDES)
    return np.concatenate(parts[:levels]), np.concatenate(parts[levels:])


@cache
def _network() -> cv2.dnn.Net:
    return cv2.dnn.readNetFromONNX(str(Path(__file__).with_name(WEIGHTS)))


@cache
def _cells() -> tuple[Array, Array]:
    """Return the centres (N, 2) px of the cells of all levels, and their strides (N,)."""
    centres, strides = [], []
    for stride in STRIDES:
        count = -(-SIDE // stride)
        row, column = np.indices((count, count)).reshape(2, -1)
        centres.append((np.stack([column, row], axis=1) + 0.5) * stride)
        strides.append(np.full(count * count, float(stride)))
    return np.concatenate(centres), np.concatenate(strides)


def _decode(logits: Array) -> Array:
    """Return corners (N, 4) px of the input from logits of distances (N, 32)."""
    centres, strides = _cells()
    bins = logits.reshape(-1, 4, BINS)
    weights = np.exp(bins - bins.max(axis=2, keepdims=True))
    weights /= weights.sum(axis=2, keepdims=True)
    distances = (weights @ np.arange(BINS)) * strides[:, None]
    near, far = distances[:, :2], distances[:, 2:]
    return np.concatenate([centres - near, centres + far], axis=1)


def _suppress(corners: Array, best: Array) -> list[int]:
    """Return the indices of boxes (n, 4) without doubles, the best first."""
    sides = np.hstack([corners[:, :2], corners[:, 2:] - corners[:, :2]])
    kept: Sequence[int] = cv2.dnn.NMSBoxes(
        sides.tolist(), best.tolist(), 0.0, SAME_BOX, top_k=0
    )
    large = [int(k) for k in kept if sides[k, 2:].min() >= 2]
    return large[:MOST_BOXES]


def box_overlap(first: Array, second: Array) -> Array:
    """Return the IoU (n, m) of two sets of boxes (n, 4) and (m, 4)."""
    low = np.maximum(first[:, None, :2], second[None, :, :2])
    high = np.minimum(first[:, None, 2:], second[None, :, 2:])
    shared = np.clip(high - low, 0, None).prod(axis=2)
    areas = [
        np.clip(one[:, 2:] - one[:, :2], 0, None).prod(axis=1)
        for one in (first, second)
    ]
    union = areas[0][:, None] + areas[1][None] - shared
    return np.asarray(shared / np.maximum(union, 1e-9))


def box_shares(first: Array, second: Array) -> Array:
    """Return the share (n, m) of each of some boxes (n, 4) in each of others (m, 4)."""
    low = np.maximum(first[:, None, :2], second[None, :, :2])
    high = np.minimum(first[:, None, 2:], second[None, :, 2:])
    shared = np.clip(high - low, 0, None).prod(axis=2)
    areas = (first[:, 2:] - first[:, :2]).prod(axis=1)
    return np.asarray(shared / np.maximum(areas[:, None], 1e-9))
