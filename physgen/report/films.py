"""The film of a clip on a page, and its poster."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import imageio.v3 as iio
import numpy as np

from physgen.export.video import U8, sample_frames
from physgen.report.html import encode_webp, fit_to_side

BEST = (".mp4", ".webp", ".gif")
"""Film suffixes in order of preference. Only a video plays in step with the player; a
folder of frames comes last.
"""
SIDE = 480
"""Maximum longer side of a poster, px."""
QUALITY = 80
"""Quality of WebP. A poster has about 8 kB."""


@dataclass(frozen=True)
class Film:
    """A clip on a page."""

    source: str
    """URL of the file, or of the first frame."""
    plays: bool
    """True for a video, false for a still or animated picture."""
    name: str
    """The file beside the page."""
    frames: str = ""
    """Folder of the frames beside the page, if there is no film."""


def linked_film(names: Sequence[str]) -> Film:
    """Return the best of the films and folders of frames `names` beside the page."""
    name = min(
        names, key=lambda name: (*BEST, Path(name).suffix).index(Path(name).suffix)
    )
    if "." in name:
        return Film(name, name.endswith(".mp4"), name)
    return Film(f"{name}/00000.png", False, f"{name}/00000.png", f"{name}/")


def _rgb(file: Path) -> U8:
    with file.open("rb") as stream:
        return np.asarray(iio.imread(stream, plugin="pillow", index=0, mode="RGB"))


def poster(film: Path) -> bytes:
    """Encode the first frame of a film, the photo, as WebP.

    Raise OSError for an unreadable film.
    """
    try:
        if film.suffix == ".mp4":
            frame = sample_frames(film, 1, SIDE)[0]
        else:
            frame = _rgb(film)
    except (
        SyntaxError,
        ValueError,
        EOFError,
        IndexError,
    ) as error:
        # Pillow raises SyntaxError for a broken PNG.
        raise OSError(f"{film} cannot be read: {error}") from error
    return encode_webp(fit_to_side(frame, SIDE), QUALITY)


def result_still(film: Path, *, middle: bool = False) -> bytes:
    """Encode the last or middle frame of an MP4 as WebP.

    Raise OSError for an unreadable film.
    """
    count = 2
    if middle:
        count = 3
    # The samples include both ends: of two, the second is the last frame; of three, the
    # second is the middle one.
    frames = sample_frames(film, count, SIDE)
    if not frames:
        raise OSError(f"{film} has no frames")
    if middle:
        frame = frames[len(frames) // 2]
    else:
        frame = frames[-1]
    return encode_webp(fit_to_side(frame, SIDE), QUALITY)
