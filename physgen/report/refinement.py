"""What refinement changed: measured changes, and the rows of the page. Frames come one after the other."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.report.html import U8
from physgen.report.record import REFINING
from physgen.text import value_text

F32 = NDArray[np.float32]

NEAR = 0.05
"""Of the frame's diagonal: pixels up to this distance from an object count as near it, as shadows are."""
PLACES = ("objects", "near", "elsewhere")


ELSEWHERE = {"changes", "failed", *REFINING}
"""Keys of `RunRecord.refine` that are shown elsewhere."""


class RefinementChanges:
    """Measures of frames as they come."""

    def __init__(self) -> None:
        self.most = 0
        """The frame that changed most."""
        self.refined: U8 = np.zeros((0, 0, 3), np.uint8)
        """(H, W, 3) sRGB: that frame after refinement."""
        self._largest, self._first, self._near = -1.0, 0.0, 0.0
        self._seen = 0
        self._sums = np.zeros((len(PLACES), 2))  # of each place: change, and pixels

    def add(self, guidance: U8, refined: U8, coverage: F32) -> None:
        """The next frame: (H, W, 3) sRGB twice, and (H, W) coverage of objects, 0..1."""
        change = np.abs(np.subtract(refined, guidance, dtype=np.int16)).sum(axis=2).astype(np.float32) / 3
        self._near = NEAR * float(np.hypot(*change.shape))
        for k, share in enumerate(_shares(coverage, self._near)):
            pixels = float(share.sum(dtype=np.float64))
            self._sums[k] += float((share * change).sum(dtype=np.float64)), pixels
        mean = float(change.mean(dtype=np.float64))
        if self._seen == 0:
            self._first = mean
        if mean > self._largest:
            self._largest, self.most, self.refined = mean, self._seen, refined.copy()
        self._seen += 1

    def figures(self) -> dict[str, float | None]:
        """Mean absolute changes of the sRGB codes, in grey levels of 255; None where there is no such place.

        `objects`, `near` them (up to `near_px` away) and `elsewhere`; each pixel counts by its coverage, or by the
        rest. `all`: of the whole clip, `first`: of the first frame.
        """
        means = {
            place: total / pixels if pixels > 0 else None
            for place, (total, pixels) in zip(PLACES, self._sums.tolist(), strict=True)
        }
        total, pixels = self._sums.sum(axis=0).tolist()
        found = {**means, "all": total / max(pixels, 1.0), "near_px": self._near, "first": self._first}
        return {name: None if value is None else round(value, 4) for name, value in found.items()}


def _shares(coverage: F32, near: float) -> tuple[F32, F32, F32]:
    """(H, W) each, together 1: of objects, of pixels up to `near` px from one, and of all others."""
    beyond = (coverage < 0.5).astype(np.uint8)
    rest = 1 - coverage
    if beyond.all():
        return coverage, np.zeros_like(rest), rest
    away = cv2.distanceTransform(beyond, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    return coverage, np.where(away <= near, rest, np.float32(0)), np.where(away > near, rest, np.float32(0))


def refinement(note: Mapping[str, Any] | None) -> dict[str, Any] | None:
    """`RunRecord.refine` for the page: `failed`, lines of a message; `changes` and `facts`, names and values."""
    if note is None:
        return None
    return {
        "failed": str(note.get("failed", "")).splitlines(),
        "changes": _change_rows(note["changes"]) if "changes" in note else [],
        "facts": _facts(note),
    }


def _change_rows(found: Mapping[str, float | None]) -> list[tuple[str, str]]:
    near = f"near them (up to {found['near_px']:.0f} px away)"
    places = {"objects": "on objects", "near": near, "elsewhere": "elsewhere", "first": "in the first frame"}
    return [(text, f"{found[name]:.2f}") for name, text in places.items() if found[name] is not None]


def _facts(note: Mapping[str, Any]) -> list[tuple[str, str]]:
    """Backend and settings."""
    rows = [
        (name.replace("_", " "), value_text(value)) for name, value in note.items() if name not in ELSEWHERE
    ]
    return [(name, value) for name, value in rows if value]
