"""A background whose shadows were lifted -> the same with what lies under and between objects filled anew."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.perceive.roles import Inpaint, Rgb

RING = 3
"""px around objects where lifting is not to be trusted."""
GAP = 6
"""px: half the width of gaps between objects, too dark to tell what is there."""


def refilled(lifted: Rgb, coverage: NDArray[np.float32], inpaint: Inpaint) -> Rgb:
    """What the photo hid lay in shadow when it was first filled; now it is filled from lifted surroundings."""
    hole = cv2.dilate((coverage > 0).astype(np.uint8), np.ones((2 * RING + 1, 2 * RING + 1), np.uint8))
    hole = cv2.morphologyEx(hole, cv2.MORPH_CLOSE, np.ones((2 * GAP + 1, 2 * GAP + 1), np.uint8))
    return inpaint(lifted, hole > 0)
