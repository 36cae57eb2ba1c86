"""Two frames -> flow by Dense Inverse Search (Kroeger et al., ECCV 2016), as OpenCV has it, at its medium setting."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import cv2
import numpy as np

from physgen.evaluate.fid import F32, U8, Flow


class Dis:
    """The backend `dis`."""

    def __init__(self) -> None:
        self._find = cv2.DISOpticalFlow.create(cv2.DISOPTICAL_FLOW_PRESET_MEDIUM)

    def __call__(self, one: U8, other: U8) -> F32:
        """(H, W, 2) px."""
        greys = [cv2.cvtColor(frame, cv2.COLOR_RGB2GRAY) for frame in (one, other)]
        return np.asarray(self._find.calc(*greys, None), np.float32)  # type: ignore[call-overload]

    def note(self) -> Mapping[str, Any]:
        """For the record."""
        return {"name": "DIS, medium", "opencv": cv2.__version__}


def dis() -> Flow:
    """The backend `dis`."""
    return Dis()
