"""Boxes from a detector's file: run by OpenCV, decoded, with duplicates suppressed."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from coco_classes import MOVABLE_INDICES
from numpy.typing import NDArray

SIDE = 416
"""Side of the input, px."""
STRIDES = (8, 16, 32, 64)
"""Size of the cells of each level, px."""
MEAN = np.array((103.53, 116.28, 123.675), np.float32)
DEVIATION = np.array((57.375, 57.12, 58.395), np.float32)
BINS = 8
"""Bins of a distance."""
SUPPRESSION = 0.6
"""IoU from which the weaker of two boxes is a duplicate."""
WEAKEST = 0.01
"""Score below which a box is not reported."""
MOST = 100
"""Boxes of a photo that are reported."""


@dataclass(frozen=True)
class Boxes:
    """Boxes of one photo, best first."""

    boxes: NDArray[np.float32]
    """(N, 4) left, top, right, bottom, px of the photo."""
    scores: NDArray[np.float32]
    """(N,) the score by which they are ranked."""
    classes: NDArray[np.float32]
    """(N, 80) scores of COCO's classes."""


def prepared(bgr: NDArray[np.uint8], side: int = SIDE) -> NDArray[np.float32]:
    """Return the input (1, 3, side, side) of a photo (H, W, 3)."""
    height, width = bgr.shape[:2]
    scale = side / max(height, width)
    size = (max(1, round(width * scale)), max(1, round(height * scale)))
    method = cv2.INTER_AREA if scale < 1 else cv2.INTER_LINEAR
    canvas = np.zeros((side, side, 3), np.uint8)
    canvas[: size[1], : size[0]] = cv2.resize(bgr, size, interpolation=method)
    values = (canvas.astype(np.float32) - MEAN) / DEVIATION
    return np.ascontiguousarray(values.transpose(2, 0, 1)[None])


class BoxFinder:
    """A detector's file. `ranking` is "movable" (every file: the score of movable
    wholes, or, for the given PicoDet, the best of the movable classes) or "any" (the
    best of all scores)."""

    def __init__(self, path: Path, ranking: str) -> None:
        self.net = cv2.dnn.readNetFromONNX(str(path))
        self.ranking = ranking
        names = list(self.net.getUnconnectedOutLayersNames())
        if "scores-8" in names:
            self.names = [f"scores-{s}" for s in STRIDES]
            self.names += [f"boxes-{s}" for s in STRIDES]
        else:
            self.names = [f"save_infer_model/scale_{k}.tmp_1" for k in range(8)]

    def raw(
        self, bgr: NDArray[np.uint8]
    ) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Return scores (N, 80 or 82) and boxes (N, 4) of all cells, px of the photo."""
        self.net.setInput(prepared(bgr))
        outputs = self.net.forward(self.names)
        scores = np.concatenate([output[0] for output in outputs[:4]])
        boxes = []
        for stride, output in zip(STRIDES, outputs[4:], strict=True):
            boxes.append(decoded(output[0], stride))
        scale = max(bgr.shape[:2]) / SIDE
        return scores, np.concatenate(boxes) * np.float32(scale)

    def find(self, bgr: NDArray[np.uint8]) -> Boxes:
        """Return the boxes of a photo (H, W, 3)."""
        scores, boxes = self.raw(bgr)
        height, width = bgr.shape[:2]
        boxes = boxes.clip(0, (width, height, width, height))
        classes = scores[:, -80:]
        if self.ranking == "any":
            ranks = scores.max(axis=1)
        elif scores.shape[1] == 80:
            ranks = classes[:, MOVABLE_INDICES].max(axis=1)
        else:
            ranks = scores[:, 0]
        kept = suppressed(boxes, ranks)
        return Boxes(boxes[kept], ranks[kept], classes[kept])


def decoded(logits: NDArray[np.float32], stride: int) -> NDArray[np.float32]:
    """Return boxes (N, 4), px of the input, of the bins (N, 32) of a level."""
    count = -(-SIDE // stride)
    middle = (np.arange(count, dtype=np.float32) + 0.5) * stride
    x, y = (axis.ravel() for axis in np.meshgrid(middle, middle))
    bins = logits.reshape(-1, 4, BINS)
    shares = np.exp(bins - bins.max(axis=2, keepdims=True))
    shares /= shares.sum(axis=2, keepdims=True)
    left, top, right, bottom = (shares @ np.arange(BINS, dtype=np.float32)).T * stride
    return np.stack([x - left, y - top, x + right, y + bottom], axis=1)


def suppressed(
    boxes: NDArray[np.float32], scores: NDArray[np.float32]
) -> NDArray[np.int64]:
    """Return places of the boxes without duplicates, best first."""
    likely = np.flatnonzero(scores > WEAKEST)
    likely = likely[np.argsort(-scores[likely], kind="stable")][:1000]
    kept: list[int] = []
    while len(likely) and len(kept) < MOST:
        best, likely = likely[0], likely[1:]
        kept.append(int(best))
        overlap = ious(boxes[best][None], boxes[likely])[0]
        likely = likely[overlap < SUPPRESSION]
    return np.array(kept, np.int64)


def ious(
    first: NDArray[np.float32], second: NDArray[np.float32]
) -> NDArray[np.float32]:
    """Return the IoU (N, M) of boxes (N, 4) and (M, 4)."""
    top_left = np.maximum(first[:, None, :2], second[None, :, :2])
    bottom_right = np.minimum(first[:, None, 2:], second[None, :, 2:])
    common = (bottom_right - top_left).clip(0).prod(axis=2)
    areas = [(b[:, 2:] - b[:, :2]).clip(0).prod(axis=1) for b in (first, second)]
    union = areas[0][:, None] + areas[1][None] - common
    return common / np.maximum(union, 1e-6)
