"""The object in a box or at a point, cut out by a head of the segmentation network."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.perceive.roles import PromptedMask
from physgen.perceive.segment.network import F32, LOCK, MEAN, as_input, run_levels
from physgen.perceive.segment.proposals import cut_out

WEIGHTS = "cutout.onnx"
SIDE = 192  # px of the crop that the head looks at
MARGIN = 0.25  # of a box's sides: seen around it


def crop(
    image: NDArray[np.uint8], box: Sequence[float], side: int, beyond: int = round(MEAN)
) -> NDArray[np.uint8]:
    """A box (left, top, right, bottom px) and its margin, squeezed to (side, side[, 3]); `beyond` is off the photo."""
    left, top, right, bottom = bounds(box)
    height, width = image.shape[:2]
    part = image[max(top, 0) : max(bottom, 0), max(left, 0) : max(right, 0)]
    outside = max(-top, 0), max(bottom - height, 0), max(-left, 0), max(right - width, 0)
    whole = cv2.copyMakeBorder(part, *outside, cv2.BORDER_CONSTANT, value=(beyond,) * 3)
    how = cv2.INTER_AREA if min(whole.shape[:2]) > side else cv2.INTER_LINEAR
    return np.asarray(cv2.resize(whole, (side, side), interpolation=how), np.uint8)


def bounds(box: Sequence[float]) -> tuple[int, int, int, int]:
    """Left, top, right, bottom px of a box's crop, which may reach beyond the photo."""
    across, down = MARGIN * (box[2] - box[0]), MARGIN * (box[3] - box[1])
    return round(box[0] - across), round(box[1] - down), round(box[2] + across), round(box[3] + down)


def mask_in_box(rgb: NDArray[np.uint8], box: Sequence[float]) -> PromptedMask:
    """The object in a box (left, top, right, bottom px), in one piece; an empty mask where none is seen.

    The confidence is the overlap (IoU) that the head expects.
    """
    return _segment(rgb, box, at_point=False)


def mask_at_point(rgb: NDArray[np.uint8], point: tuple[float, float], side: float) -> PromptedMask:
    """The same for the object at a point (x, y px), looked for in a square around it with sides of `side` px."""
    half = side / (1 + 2 * MARGIN) / 2
    x, y = point
    return _segment(rgb, (x - half, y - half, x + half, y + half), at_point=True)


def box_of(mask: NDArray[np.bool_]) -> tuple[int, int, int, int]:
    """Left, top, right, bottom px of a mask (H, W); the last two just outside."""
    x, y, width, height = cv2.boundingRect(mask.astype(np.uint8))
    return x, y, x + width, y + height


def _segment(rgb: NDArray[np.uint8], box: Sequence[float], *, at_point: bool) -> PromptedMask:
    height, width = rgb.shape[:2]
    left, top, right, bottom = bounds(box)
    small = _chances(crop(rgb, box, SIDE), at_point)
    chances = cv2.resize(small, (right - left, bottom - top), interpolation=cv2.INTER_LINEAR)
    x, y = max(left, 0), max(top, 0)
    chances = chances[y - top : height - top, x - left : width - left]
    piece = cut_out(chances >= 0.5, 0, 0, 1)
    mask = np.zeros((height, width), np.bool_)
    if piece is None:
        return PromptedMask(mask, 0.0)
    inside = piece.on(chances.shape)
    mask[y : y + inside.shape[0], x : x + inside.shape[1]] = inside
    on = float(chances[inside].sum())
    return PromptedMask(mask, on / (float(inside.sum()) + float(chances.sum()) - on))


def _chances(rgb: NDArray[np.uint8], at_point: bool) -> F32:
    """(SIDE / 2, SIDE / 2) 0..1 of a crop and its mirror image, whose errors differ."""
    head, found = _head(), []
    for view in (rgb, np.ascontiguousarray(rgb[:, ::-1])):
        levels = run_levels(as_input(view))
        with LOCK:
            for name, level in levels.items():
                head.setInput(level, name)
            head.setInput(np.full((1, 1, 1, 1), at_point, np.float32), "at-point")
            found.append(np.array(head.forward()[0], np.float32))
    mean = (found[0] + found[1][:, ::-1]) / 2
    return np.asarray(1 / (1 + np.exp(-np.clip(mean, -30, 30))), np.float32)


@cache
def _head() -> cv2.dnn.Net:
    return cv2.dnn.readNetFromONNX(str(Path(__file__).with_name(WEIGHTS)))
