"""A film -> two small WebP pictures of it: one to look at, and a strip of frames to run through it without a video."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.report.video import glimpses

U8 = NDArray[np.uint8]

SIDE = 480
"""px of a poster's longest side, at most."""
CELL = 240
"""The same of one frame of the strip."""
MOST, ACROSS = 16, 4
"""Frames of a strip, and how many lie side by side."""
QUALITY, STRIP_QUALITY = 80, 50
"""Of WebP. A poster takes about 8 kB, a strip 33 kB (docs/benchmarks.md)."""


def shown(frames: int) -> int:
    """Frames that the strip of a film of so many has."""
    return max(min(MOST, frames), 1)


def across(frames: int) -> int:
    """How many of them lie side by side."""
    return min(ACROSS, shown(frames))


def pictures(film: Path, frames: int) -> tuple[bytes, bytes]:
    """Poster (the middle of the film) and strip; frame k of the strip is k / (shown - 1) of the way to the last.

    Raises OSError where the film cannot be read.
    """
    taken = glimpses(film, shown(frames), SIDE)
    cells = [_within(frame, CELL) for frame in taken]
    cells += [np.zeros_like(cells[0])] * (-len(cells) % across(frames))
    rows = [np.concatenate(cells[k : k + across(frames)], 1) for k in range(0, len(cells), across(frames))]
    return _webp(taken[len(taken) // 2], QUALITY), _webp(np.concatenate(rows), STRIP_QUALITY)


def _within(rgb: U8, side: int) -> U8:
    high, wide = rgb.shape[:2]
    part = side / max(high, wide)
    if part >= 1:
        return rgb
    size = max(round(wide * part), 1), max(round(high * part), 1)
    return np.asarray(cv2.resize(rgb, size, interpolation=cv2.INTER_AREA), np.uint8)


def _webp(rgb: U8, quality: int) -> bytes:
    done, data = cv2.imencode(".webp", rgb[:, :, ::-1], [cv2.IMWRITE_WEBP_QUALITY, quality])
    if not done:
        raise OSError("the picture could not be written as WebP")
    return data.tobytes()
