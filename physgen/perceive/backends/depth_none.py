"""Backend depth=none: the same depth everywhere, for backends that need none."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from physgen.perceive.roles import Depth, Rgb


def none() -> Depth:
    """The backend `none`."""
    return _none


def _none(rgb: Rgb) -> NDArray[np.float32]:
    return np.zeros(rgb.shape[:2], np.float32)
