"""Small unsure objects that hang in the air beside an object: they are parts of it.

The handle of a pot that was found as an object of its own would stay in the air while
the pot slides away. What lies at rest is carried by something below it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import cv2
import numpy as np

from physgen.perceive.roles import Labels, Mask


@dataclass(frozen=True)
class HangingLimits:
    """Limits of parts that hang beside an object; chosen on pots, cars and stacks."""

    confidence: float = 0.7
    """Confidence from which an object is not a part."""
    small: float = 0.35
    """Of the other object's area, at most."""
    touch: float = 0.01
    """Gap between them, as a share of the root of the other's area."""
    height: float = 0.15
    """Of the other's height, between the lower ends of both, at least."""
    side_distance: float = 0.1
    """Of its width, by which what is under it may lie beside its middle."""
    gap: float = 0.06
    """Of its height, between it and what is under it."""


HANGING = HangingLimits()


def attach_hanging_parts(labels: Labels, confidence: Mapping[int, float]) -> Labels:
    """Return the label map (H, W) with parts that hang in the air as their objects'.

    `confidence` is that of each id. The photo is seen from the side.
    """
    attached = labels.copy()
    for i in sorted(confidence, key=lambda k: confidence[k]):
        own = attached == i
        if confidence[i] >= HANGING.confidence or not own.any() or _is_cut(own):
            continue
        owner = _owner(attached, own, i)
        if owner and not _has_carrier(attached, own):
            attached[own] = owner
    return attached


def _is_cut(mask: Mask) -> bool:
    """Return whether a mask reaches the border of the photo."""
    return bool(mask[[0, -1]].any() or mask[:, [0, -1]].any())


def _owner(labels: Labels, mask: Mask, i: int) -> int:
    """Return the id of the larger object that a mask alone touches; 0 if there is none."""
    area = np.count_nonzero(mask)
    reach = max(2, round(HANGING.touch * float(np.sqrt(area / HANGING.small))))
    touching_ids = _find_touching_ids(labels, mask, reach) - {0, i}
    if len(touching_ids) != 1:
        return 0
    (other_id,) = touching_ids
    other = labels == other_id
    other_rows = np.flatnonzero(other.any(axis=1))
    other_height = int(other_rows[-1] - other_rows[0]) + 1
    bottom = int(np.flatnonzero(mask.any(axis=1))[-1]) + 1
    is_small = area < HANGING.small * np.count_nonzero(other)
    is_above = bottom < other_rows[-1] - HANGING.height * other_height
    if is_small and is_above:
        return other_id
    return 0


def _find_touching_ids(labels: Labels, mask: Mask, reach: int) -> set[int]:
    """Return the ids at most `reach` px from a mask."""
    x, y, width, height = cv2.boundingRect(mask.view(np.uint8))
    rows = slice(max(y - reach, 0), y + height + reach)
    columns = slice(max(x - reach, 0), x + width + reach)
    kernel = np.ones((2 * reach + 1, 2 * reach + 1), np.uint8)
    surroundings = cv2.dilate(mask[rows, columns].view(np.uint8), kernel) > 0
    return set(np.unique(labels[rows, columns][surroundings]).tolist())


def _has_carrier(labels: Labels, mask: Mask) -> bool:
    """Return whether something is under the middle of a mask, or on both sides of it."""
    rows, columns = np.nonzero(mask)
    left = int(columns.min())
    right = int(columns.max())
    bottom = np.zeros(right - left + 1, np.int64)
    np.maximum.at(bottom, columns - left, rows)
    gap = max(3, int(HANGING.gap * (rows.max() - rows.min() + 1)))
    steps = np.arange(1, gap + 1)[:, None]
    below = np.minimum(bottom + steps, labels.shape[0] - 1)
    here = np.arange(left, right + 1)
    is_held = ((labels[below, here] > 0) & ~mask[below, here]).any(axis=0)
    held = here[is_held]
    if not len(held):
        return False
    middle = float(columns.mean())
    slack = HANGING.side_distance * len(here)
    return bool(held.min() <= middle + slack and held.max() >= middle - slack)
