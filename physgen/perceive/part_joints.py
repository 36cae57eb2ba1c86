"""Cracks between an object's mask and the parts that were added to it.

A part is found at reduced size, so that a line of one or two px may stay free between
the part and the mask. The line would show the background in front of the object, and
leave its own pixels behind when the object moves.
"""

from __future__ import annotations

import cv2
import numpy as np

from physgen.perceive.roles import Labels, Mask

CRACK = 0.012
"""Largest width of a crack over the object's size, the root of its area."""
NARROWEST = 2
"""px: least such width."""


def close_part_joints(before: Labels, after: Labels) -> Labels:
    """Return the labels `after` (H, W) parts were added to those of `before`, without
    cracks between parts and objects.
    """
    result = after.copy()
    parts = (after > 0) & (before != after)
    for number in np.unique(after[parts]).tolist():
        part = parts & (after == number)
        core = (before == number) & ~parts
        width = max(round(CRACK * float(np.sqrt(np.count_nonzero(core)))), NARROWEST)
        gap = _dilate(part, width) & _dilate(core, width)
        # Closing keeps notches open, of which one side alone is near.
        closing = cv2.morphologyEx(
            (after == number).view(np.uint8), cv2.MORPH_CLOSE, _disc(width)
        )
        result[gap & (closing > 0) & (result == 0)] = number
    return result


def _dilate(mask: Mask, reach: int) -> Mask:
    return np.asarray(cv2.dilate(mask.view(np.uint8), _disc(reach)) > 0)


def _disc(reach: int) -> np.ndarray[tuple[int, int], np.dtype[np.uint8]]:
    side = 2 * reach + 1
    kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (side, side))
    return np.asarray(kernel, np.uint8)
