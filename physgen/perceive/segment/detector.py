"""The detector: boxes around whole objects, with scores.

`studio/segmentation/detector.py` describes the network and its outputs; OpenCV runs it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache, lru_cache
from pathlib import Path
from threading import Lock

import cv2
import numpy as np
from numpy.typing import NDArray

F32 = NDArray[np.float32]
Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

WEIGHTS = "detector.onnx"
# px: side of the square input.
SIDE = 416
# px: side of a cell of each level.
STRIDES = (8, 16, 32, 64)
# Bins of the distribution of a distance.
BINS = 8
MEAN = (103.53, 116.28, 123.675)
SPREAD = (57.375, 57.12, 58.395)
"""Mean and standard deviation of blue, green and red: the input is (level - MEAN) /
SPREAD.
"""
LEAST_SCORE = 0.05
"""Least score of a box as movable or immovable whole, or of a class."""
SAME_BOX = 0.6
"""Least IoU of two boxes of one object; the better box is kept."""
MOST_BOXES = 60
"""Largest number of boxes per photo; the best ones are kept."""

_lock = Lock()
"""An OpenCV network holds state between its calls."""


@dataclass(frozen=True, eq=False)
class DetectedBoxes:
    """Boxes of a photo, the best first."""

    # (n, 4) px: left, top, right, bottom, on the photo.
    corners: Array
    # (n, 82) 0..1: movable whole, immovable whole, COCO's classes.
    scores: Array

    @property
    def movable(self) -> Array:
        """Return the scores (n,) 0..1 of whole objects that a person could move."""
        return self.scores[:, 0]

    @property
    def immovable(self) -> Array:
        """Return the scores (n,) 0..1 of whole immovable objects."""
        return self.scores[:, 1]

    @property
    def classes(self) -> Array:
        """Return the scores (n, 80) 0..1 of COCO's classes."""
        return self.scores[:, 2:]

    def as_movable(self, selection: Flags, classes: Sequence[int]) -> DetectedBoxes:
        """Return the boxes with `selection` ones (n,) movable and without some
        classes.
        """
        scores = self.scores.copy()
        scores[selection, 0] = scores[selection, :2].max(axis=1)
        scores[selection, 1] = 0
        for index in classes:
            scores[selection, 2 + index] = 0
        return replace(self, scores=scores)

    def scale_to(self, right: float, down: float) -> DetectedBoxes:
        """Return the boxes on a photo of another size."""
        return replace(self, corners=self.corners * (right, down, right, down))

    def __len__(self) -> int:
        """Return the number of boxes."""
        return len(self.corners)


def detect_boxes(rgb: NDArray[np.uint8]) -> DetectedBoxes:
    """Return the boxes of a photo (H, W, 3) sRGB without duplicates."""
    height, width = rgb.shape[:2]
    scale = SIDE / max(height, width)
    scores, distances = run_levels(_as_input(rgb, scale))
    corners = _decode(distances) / scale
    corners = np.clip(corners, 0, (width, height, width, height))
    best = scores.max(axis=1)
    valid = np.flatnonzero(best > LEAST_SCORE)
    corners = corners[valid]
    scores = scores[valid]
    best = best[valid]
    order = _suppress(corners, best)
    return DetectedBoxes(corners[order], scores[order])


def _as_input(rgb: NDArray[np.uint8], scale: float) -> F32:
    """Return the scaled photo at the top left of a black square (1, 3, 416, 416)."""
    size = [max(1, min(round(side * scale), SIDE)) for side in rgb.shape[1::-1]]
    if scale < 1:
        interpolation = cv2.INTER_AREA
    else:
        interpolation = cv2.INTER_LINEAR
    square = np.zeros((SIDE, SIDE, 3), np.float32)
    square[: size[1], : size[0]] = cv2.resize(rgb, size, interpolation=interpolation)[
        ..., ::-1
    ]
    blob = np.asarray((square - np.array(MEAN)) / np.array(SPREAD), np.float32)
    return np.ascontiguousarray(blob.transpose(2, 0, 1)[None])


def run_levels(blob: F32) -> tuple[Array, Array]:
    """Return scores (N, 82) and logits of distances (N, 32) of the cells of all
    levels.

    The last ones are cached, since several roles use them; the arrays are read-only.
    """
    return _run(blob.tobytes())


@lru_cache(maxsize=1)
def _run(numbers: bytes) -> tuple[Array, Array]:
    """Return `run_levels` of an input given as bytes."""
    network = _network()
    blob = np.frombuffer(numbers, np.float32).reshape(1, 3, SIDE, SIDE)
    names = []
    for kind in ("scores", "boxes"):
        for stride in STRIDES:
            names.append(f"{kind}-{stride}")
    with _lock:
        network.setInput(blob)
        parts = [np.array(part[0], np.float64) for part in network.forward(names)]
    levels = len(STRIDES)
    outputs = np.concatenate(parts[:levels]), np.concatenate(parts[levels:])
    for output in outputs:
        output.setflags(write=False)
    return outputs


@cache
def _network() -> cv2.dnn.Net:
    return cv2.dnn.readNetFromONNX(str(Path(__file__).with_name(WEIGHTS)))


@cache
def _cells() -> tuple[Array, Array]:
    """Return the centres (N, 2) of the cells of all levels, px, and their strides
    (N,).
    """
    centres, strides = [], []
    for stride in STRIDES:
        count = -(-SIDE // stride)
        row, column = np.indices((count, count)).reshape(2, -1)
        centres.append((np.stack([column, row], axis=1) + 0.5) * stride)
        strides.append(np.full(count * count, float(stride)))
    return np.concatenate(centres), np.concatenate(strides)


def _decode(logits: Array) -> Array:
    """Return corners (N, 4) in px of the input, from logits of distances (N, 32)."""
    centres, strides = _cells()
    bins = logits.reshape(-1, 4, BINS)
    weights = np.exp(bins - bins.max(axis=2, keepdims=True))
    weights /= weights.sum(axis=2, keepdims=True)
    # A distance is the mean of its predicted distribution, in strides.
    distances = (weights @ np.arange(BINS)) * strides[:, None]
    upper_distances = distances[:, :2]
    lower_distances = distances[:, 2:]
    return np.concatenate(
        [centres - upper_distances, centres + lower_distances], axis=1
    )


def _suppress(corners: Array, best: Array) -> list[int]:
    """Return the indices of boxes (n, 4) without duplicates, the best first."""
    sides = np.hstack([corners[:, :2], corners[:, 2:] - corners[:, :2]])
    indices: Sequence[int] = cv2.dnn.NMSBoxes(
        sides.tolist(), best.tolist(), 0.0, SAME_BOX, top_k=0
    )
    large = []
    for k in indices:
        if sides[k, 2:].min() >= 2:
            large.append(int(k))
    return large[:MOST_BOXES]


def box_overlap(first: Array, second: Array) -> Array:
    """Return the IoU (n, m) of two sets of boxes (n, 4) and (m, 4)."""
    low = np.maximum(first[:, None, :2], second[None, :, :2])
    high = np.minimum(first[:, None, 2:], second[None, :, 2:])
    intersection = np.clip(high - low, 0, None).prod(axis=2)
    areas = []
    for boxes in (first, second):
        areas.append(np.clip(boxes[:, 2:] - boxes[:, :2], 0, None).prod(axis=1))
    union = areas[0][:, None] + areas[1][None] - intersection
    return np.asarray(intersection / np.maximum(union, 1e-9))


def box_shares(first: Array, second: Array) -> Array:
    """Return the share (n, m) of each of the boxes (n, 4) inside each of the others (m,
    4).
    """
    low = np.maximum(first[:, None, :2], second[None, :, :2])
    high = np.minimum(first[:, None, 2:], second[None, :, 2:])
    intersection = np.clip(high - low, 0, None).prod(axis=2)
    areas = (first[:, 2:] - first[:, :2]).prod(axis=1)
    return np.asarray(intersection / np.maximum(areas[:, None], 1e-9))
