"""What the backends of `evaluate fid` take and give: pictures to features, and two pictures to flow."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

U8 = NDArray[np.uint8]
F32 = NDArray[np.float32]
F64 = NDArray[np.float64]


class Features(Protocol):
    """Role `features`."""

    comparable: bool
    """Whether these are the features that published FIDs are made of."""

    def __call__(self, pictures: U8) -> F64:
        """(N, H, W, 3) sRGB -> (N, D), all finite."""
        ...

    def note(self) -> Mapping[str, Any]:
        """For the record: what it was, exactly."""
        ...


class Flow(Protocol):
    """Role `flow`."""

    def __call__(self, one: U8, other: U8) -> F32:
        """Two frames (H, W, 3) sRGB -> (H, W, 2) px, right and down, that each point of `one` moves until `other`."""
        ...

    def note(self) -> Mapping[str, Any]:
        """For the record."""
        ...
