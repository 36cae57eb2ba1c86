"""A film -> two small WebP pictures of it: one to look at, and a strip of frames to run through it without a video."""

from __future__ import annotations

from io import BytesIO
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray
from PIL import Image

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

EFFORT = 2
"""Of WebP's encoder, 0 to 6: the fourth, its own choice, takes twice the time for 9 % less."""


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
    taken = _taken(film, shown(frames))
    cells = [_within(frame, CELL) for frame in taken]
    cells += [np.zeros_like(cells[0])] * (-len(cells) % across(frames))
    rows = [np.concatenate(cells[k : k + across(frames)], 1) for k in range(0, len(cells), across(frames))]
    return _webp(taken[len(taken) // 2], QUALITY), _webp(np.concatenate(rows), STRIP_QUALITY)


def _taken(film: Path, count: int) -> list[U8]:
    """So many frames evenly from the first to the last, none larger than a poster; fewer come more than once."""
    try:
        found = {".mp4": glimpses, ".png": _of_folder}.get(film.suffix, _of_pages)(film, count, SIDE)
    except (SyntaxError, ValueError, EOFError) as error:  # Pillow calls a broken PNG a SyntaxError
        raise OSError(f"{film} cannot be read: {error}") from error
    if not found:
        raise OSError(f"{film} has no frames")
    return [found[k * len(found) // count] for k in range(count)]


def _of_pages(path: Path, count: int, side: int) -> list[U8]:
    """Of a GIF or WebP."""
    with Image.open(path) as pages:
        found = []
        for index in _evenly(getattr(pages, "n_frames", 1), count):
            pages.seek(index)
            found.append(_within(np.asarray(pages.convert("RGB")), side))
    return found


def _of_folder(path: Path, count: int, side: int) -> list[U8]:
    """Of the folder of PNG that begins with `path`."""
    files = sorted(path.parent.glob("*.png"))
    return [
        _within(np.asarray(Image.open(files[k]).convert("RGB")), side) for k in _evenly(len(files), count)
    ]


def _evenly(frames: int, count: int) -> list[int]:
    return sorted(set(np.linspace(0, frames - 1, count).round().astype(int).tolist())) if frames else []


def _within(rgb: U8, side: int) -> U8:
    high, wide = rgb.shape[:2]
    part = side / max(high, wide)
    if part >= 1:
        return rgb
    size = max(round(wide * part), 1), max(round(high * part), 1)
    return np.asarray(cv2.resize(rgb, size, interpolation=cv2.INTER_AREA), np.uint8)


def _webp(rgb: U8, quality: int) -> bytes:
    buffer = BytesIO()
    Image.fromarray(rgb).save(buffer, "WEBP", quality=quality, method=EFFORT)
    return buffer.getvalue()
