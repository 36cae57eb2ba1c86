"""Guidance, refined frames and coverage, one after the other -> what refinement changed: figures, and the strip.

Only a few small columns and the frames before are held, so a clip may be as long as it likes.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.report.strip import COLUMNS, LUMA, Column, column, strip

U8 = NDArray[np.uint8]
F32 = NDArray[np.float32]

CHANNELS = 3
NEAR = 0.05
"""Of the frame's diagonal: so far from an object its shadow, and what it reflects, is near it."""
PLACES = ("objects", "near", "elsewhere")


@dataclass
class _Jump:
    """The largest mean change from a frame to the next, in grey levels, and the later of the two."""

    size: float = 0.0
    at: int = 0

    def to(self, size: float, at: int) -> None:
        if size > self.size:
            self.size, self.at = size, at


@dataclass
class Changes:
    """What is told of frames as they come."""

    count: int
    """Frames of the clip."""
    fps: float
    most: int = 0
    """The frame that changed most."""
    refined: U8 = field(default_factory=lambda: np.zeros((0, 0, 3), np.uint8))
    """(H, W, 3) sRGB: what became of it."""
    _largest: float = -1.0
    _columns: list[Column] = field(default_factory=list)
    _last: tuple[U8, U8, NDArray[np.int16]] | None = None
    """The frame before: guidance, refined, and their difference."""
    _seen: int = 0
    _sums: NDArray[np.float64] = field(default_factory=lambda: np.zeros((len(PLACES), 2)))
    """Of each place: change, and pixels."""
    _first: float = 0.0
    _near: float = 0.0
    _guided: _Jump = field(default_factory=_Jump)
    _refined: _Jump = field(default_factory=_Jump)
    _apart: _Jump = field(default_factory=_Jump)

    def add(self, guidance: U8, refined: U8, coverage: F32) -> None:
        """The next frame: (H, W, 3) sRGB twice, and (H, W) coverage of objects, 0..1."""
        difference = np.subtract(refined, guidance, dtype=np.int16)
        change = _summed(np.asarray(cv2.absdiff(refined, guidance), np.uint8))
        self._near = NEAR * float(np.hypot(*change.shape))
        for k, share in enumerate(_shares(coverage, self._near)):
            pixels = float(share.sum(dtype=np.float64))
            self._sums[k] += float((share * change).sum(dtype=np.float64)) / CHANNELS, pixels
        at = self._seen
        if self._last is None:
            self._first = float(change.mean(dtype=np.float64)) / CHANNELS
        else:
            before, after, between = self._last
            self._guided.to(cv2.norm(guidance, before, cv2.NORM_L1) / guidance.size, at)
            self._refined.to(cv2.norm(refined, after, cv2.NORM_L1) / guidance.size, at)
            self._apart.to(cv2.norm(difference, between, cv2.NORM_L1) / guidance.size, at)
        if at in self._shown():
            luma = np.asarray(cv2.transform(difference.astype(np.float32), LUMA[None]), np.float32)
            self._columns.append(column(at / self.fps, guidance, refined, luma, coverage))
        if (mean := float(change.mean(dtype=np.float64))) > self._largest:
            self._largest, self.most, self.refined = mean, at, refined.copy()
        self._last = guidance, refined, difference
        self._seen += 1

    def figures(self) -> dict[str, float | None]:
        """Mean absolute changes of the sRGB codes, in grey levels of 255; None where there is no such place.

        `objects`, `near` them (up to `near_px` off) and `elsewhere`; each pixel counts by its coverage, or by what
        coverage leaves. `all`: of the whole clip, `first`: of the first frame. `jump_guidance` and `jump_refined`: the
        largest mean change from one frame to the next; `flicker`: how many times larger it became. `jump_of_change`:
        the same of refined less guidance, which moves with nothing, at `jump_at` s.
        """
        means = {
            place: float(total / pixels) if pixels > 0 else None
            for place, (total, pixels) in zip(PLACES, self._sums.tolist(), strict=True)
        }
        total, pixels = self._sums.sum(axis=0).tolist()
        before, after = self._guided.size, self._refined.size
        found = {
            **means,
            "all": total / max(pixels, 1.0),
            "near_px": self._near,
            "first": self._first,
            "jump_guidance": before,
            "jump_refined": after,
            "flicker": after / before if before > 0 else None,
            "jump_of_change": self._apart.size,
            "jump_at": self._apart.at / self.fps,
        }
        return {name: None if value is None else round(value, 4) for name, value in found.items()}

    @property
    def columns(self) -> list[Column]:
        """Moments of the strip, as far as they have come."""
        return self._columns

    def picture(self) -> U8:
        """(H, W, 3) sRGB: the difference strip."""
        return strip(self._columns)

    def _shown(self) -> set[int]:
        """Frames of the strip: the first, the last, and as many evenly between."""
        return set(np.linspace(0, self.count - 1, min(COLUMNS, self.count)).round().astype(int).tolist())


def _summed(codes: U8) -> F32:
    """(H, W) of (H, W, 3): over the channels."""
    return np.asarray(cv2.transform(codes.astype(np.float32), np.ones((1, CHANNELS), np.float32)), np.float32)


def _shares(coverage: F32, near: float) -> tuple[F32, F32, F32]:
    """(H, W) each, together 1: of objects, of what is up to `near` px from one, and of all else."""
    beyond = (coverage < 0.5).astype(np.uint8)
    left = 1 - coverage
    if beyond.all():  # the distance to nothing
        return coverage, np.zeros_like(left), left
    away = cv2.distanceTransform(beyond, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    return coverage, np.where(away <= near, left, np.float32(0)), np.where(away > near, left, np.float32(0))
