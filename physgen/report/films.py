"""The film of a clip on a page: linked or embedded, with a poster and a strip of frames."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from tempfile import TemporaryDirectory

import cv2
import numpy as np
from numpy.typing import NDArray
from PIL import Image

from physgen.export.video import Format, open_video, sample_frames
from physgen.problems import Place, Problem, Severity
from physgen.report.html import data_uri

MAILED = 50_000_000
"""Bytes of a single file above which few would mail it."""
BEST = (".mp4", ".webp", ".gif")
"""Films, the best first: only a video goes in step with the player. A folder of frames comes last."""


@dataclass(frozen=True)
class Film:
    """A clip on a page."""

    source: str
    """Address of the file, or of the first of its frames; or a data URI."""
    plays: bool
    """It is a video; else a picture, which may move by itself."""
    name: str
    """The file beside the page, or what one that is carried may be saved as."""
    frames: str = ""
    """Folder of its frames beside the page, where these are all there is."""


def linked_film(folder: Path, made: Sequence[str]) -> Film:
    """The best of the files and folders of frames that lie in `folder`."""
    name = _best(made)
    if "." in name:
        return Film(name, name.endswith(".mp4"), name)
    return Film(f"{name}/00000.png", False, f"{name}/00000.png", f"{name}/")


def embedded_film(folder: Path, made: Sequence[str], fps: float, title: str) -> Film:
    """The same inside the page; frames of a folder become a video at `fps`, 1/s. `title` is what it is saved as."""
    name = _best(made)
    if "." not in name:
        return Film(data_uri(_filmed(folder / name, fps), ".mp4"), True, f"{title}.mp4")
    ending = Path(name).suffix
    return Film(data_uri((folder / name).read_bytes(), ending), ending == ".mp4", f"{title}{ending}")


def size_warning(page: Path, fix: str) -> Problem | None:
    """A warning of a page that few mailboxes take."""
    size = page.stat().st_size
    if size <= MAILED:
        return None
    found = f"has {size / 1e6:.0f} MB"
    return Problem(
        Place(str(page)), "", "", found, f"few mailboxes take more than 50: {fix}", Severity.WARNING
    )


def _best(made: Sequence[str]) -> str:
    return min(
        made, key=lambda name: BEST.index(ending) if (ending := Path(name).suffix) in BEST else len(BEST)
    )


def _filmed(frames: Path, fps: float) -> bytes:
    """An MP4 of the PNGs of a folder."""
    with TemporaryDirectory() as place:
        with ExitStack() as film:
            write = None
            for file in sorted(frames.glob("*.png")):
                rgb = np.asarray(Image.open(file).convert("RGB"))
                if write is None:
                    size = rgb.shape[1], rgb.shape[0]
                    write = film.enter_context(open_video(Path(place), Format.MP4, size, fps))
                write(rgb)
        return (Path(place) / Format.MP4.file).read_bytes()


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


def strip_frames(frames: int) -> int:
    """Frames that the strip of a film of so many has."""
    return max(min(MOST, frames), 1)


def strip_columns(frames: int) -> int:
    """How many of them lie side by side."""
    return min(ACROSS, strip_frames(frames))


def poster_and_strip(film: Path, frames: int) -> tuple[bytes, bytes]:
    """Poster (the middle of the film) and strip; frame k of the strip is k / (shown - 1) of the way to the last.

    Raises OSError where the film cannot be read.
    """
    taken = _taken(film, strip_frames(frames))
    cells = [_within(frame, CELL) for frame in taken]
    cells += [np.zeros_like(cells[0])] * (-len(cells) % strip_columns(frames))
    rows = [
        np.concatenate(cells[k : k + strip_columns(frames)], 1)
        for k in range(0, len(cells), strip_columns(frames))
    ]
    return _webp(taken[len(taken) // 2], QUALITY), _webp(np.concatenate(rows), STRIP_QUALITY)


def _taken(film: Path, count: int) -> list[U8]:
    """So many frames evenly from the first to the last, none larger than a poster; fewer come more than once."""
    try:
        found = {".mp4": sample_frames, ".png": _of_folder}.get(film.suffix, _of_pages)(film, count, SIDE)
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
