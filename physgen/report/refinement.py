"""What refinement changed: the frame that changed most, and the rows of the page."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from physgen.report.html import U8
from physgen.report.record import REFINING
from physgen.text import value_text

ELSEWHERE = {"failed", *REFINING}
"""Keys of `RunRecord.refine` that are shown elsewhere."""


class MostChanged:
    """The frame that refinement changed most, of frames as they come."""

    def __init__(self) -> None:
        self.index = 0
        self.refined: U8 = np.zeros((0, 0, 3), np.uint8)
        """(H, W, 3) sRGB: that frame after refinement."""
        self._seen, self._largest = 0, -1.0

    def add(self, guidance: U8, refined: U8) -> None:
        """The next frame, (H, W, 3) sRGB, before and after."""
        change = float(np.abs(np.subtract(refined, guidance, dtype=np.int16)).mean())
        if change > self._largest:
            self._largest, self.index, self.refined = change, self._seen, refined.copy()
        self._seen += 1


def refinement(note: Mapping[str, Any] | None) -> dict[str, Any] | None:
    """`RunRecord.refine` for the page: `failed`, lines of a message; `facts`, names and values of the settings."""
    if note is None:
        return None
    rows = [
        (name.replace("_", " "), value_text(value)) for name, value in note.items() if name not in ELSEWHERE
    ]
    return {
        "failed": str(note.get("failed", "")).splitlines(),
        "facts": [(name, value) for name, value in rows if value],
    }
