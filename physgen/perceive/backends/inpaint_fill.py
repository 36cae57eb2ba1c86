"""Photo and hole -> the photo with the hole filled: pieces of the surroundings, in the light of where they come to.

Borrowed pieces carry lines and grain on. Only their steps of colour are kept, and summed up from the photo around the
hole, so that no seam shows between pieces. Pixels right beside an object are mixed with its blurred
edge and its contact shadow: nothing is learnt from them, they stay, and the fill meets them within a few pixels.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from physgen.perceive.borrow import borrow
from physgen.perceive.membrane import closed, grown, integrate, meet
from physgen.perceive.roles import Inpaint, Rgb

MIXED = 2
"""px beside the hole that are not trusted."""
BAND = 3
"""px beyond them that are borrowed too, so that the steps of colour into the hole are known."""


def fill() -> Inpaint:
    """The backend `fill`."""
    return _fill


def _fill(rgb: Rgb, hole: NDArray[np.bool_]) -> Rgb:
    if not hole.any() or hole.all():
        return rgb.copy()
    photo = rgb.astype(np.float32)
    whole = closed(hole)
    near, far = grown(whole, MIXED), grown(whole, MIXED + BAND)
    if far.all():  # hardly anything is left to learn from
        near = far = hole
    found = borrow(photo, far)
    start = np.where(near[:, :, None], found.picture, photo)
    return meet(integrate(start, found.right, found.down, near), rgb, hole)
