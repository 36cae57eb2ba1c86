"""The film of a clip on a page: linked or embedded, with a poster and a strip of frames."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from physgen.export.video import Format, open_video, sample_frames
from physgen.problems import Place, Problem, Severity
from physgen.report.html import data_uri, encoded, fitted

U8 = NDArray[np.uint8]

MAILED = 50_000_000
"""Bytes of a page that most mailboxes accept."""
BEST = (".mp4", ".webp", ".gif")
"""Films, the best first: only a video plays in step with the player. A folder of frames comes last."""
SIDE, CELL = 480, 240
"""px of the longer side of a poster, and of one frame of the strip, at most."""
MOST, ACROSS = 16, 4
"""Frames of a strip, and of a row of it."""
QUALITY, STRIP_QUALITY = 80, 50
"""Of WebP. A poster takes about 8 kB, a strip 33 kB (docs/benchmarks.md)."""


@dataclass(frozen=True)
class Film:
    """A clip on a page."""

    source: str
    """URL of the file, or of the first frame; or a data URI."""
    plays: bool
    """It is a video; else a picture, which may be animated."""
    name: str
    """The file beside the page, or the name under which an embedded one is saved."""
    frames: str = ""
    """Folder of the frames beside the page, where there is no film."""


def linked_film(folder: Path, made: Sequence[str]) -> Film:
    """The best of the films and folders of frames in `folder`."""
    name = _best(made)
    if "." in name:
        return Film(name, name.endswith(".mp4"), name)
    return Film(f"{name}/00000.png", False, f"{name}/00000.png", f"{name}/")


def embedded_film(folder: Path, made: Sequence[str], fps: float, title: str) -> Film:
    """The same inside the page, saved as `title`; frames of a folder become a video at `fps`, 1/s."""
    name = _best(made)
    if "." not in name:
        return Film(data_uri(_video_of(folder / name, fps), ".mp4"), True, f"{title}.mp4")
    ending = Path(name).suffix
    return Film(data_uri((folder / name).read_bytes(), ending), ending == ".mp4", f"{title}{ending}")


def size_warning(page: Path, fix: str) -> Problem | None:
    """A warning where a page is too large for most mailboxes."""
    size = page.stat().st_size
    if size <= MAILED:
        return None
    found, expected = f"has {size / 1e6:.0f} MB", f"few mailboxes take more than 50: {fix}"
    return Problem(Place(str(page)), "", "", found, expected, Severity.WARNING)


def _best(made: Sequence[str]) -> str:
    return min(made, key=lambda name: (*BEST, Path(name).suffix).index(Path(name).suffix))


def _video_of(frames: Path, fps: float) -> bytes:
    """An MP4 of the PNG files of a folder."""
    files = sorted(frames.glob("*.png"))
    with TemporaryDirectory() as place:
        with ExitStack() as film:
            size = Image.open(files[0]).size
            write = film.enter_context(open_video(Path(place), Format.MP4, size, fps))
            for file in files:
                write(_rgb(file))
        return (Path(place) / Format.MP4.file).read_bytes()


def _rgb(file: Path) -> U8:
    return np.asarray(Image.open(file).convert("RGB"))


def strip_frames(frames: int) -> int:
    """Frames in the strip of a film of so many."""
    return max(min(MOST, frames), 1)


def strip_columns(frames: int) -> int:
    """Frames in a row of it."""
    return min(ACROSS, strip_frames(frames))


def poster_and_strip(film: Path, frames: int) -> tuple[bytes, bytes]:
    """The middle of the film, and the strip, as WebP; frame k of the strip is k / (n - 1) of the way to the last.

    Raises OSError where the film cannot be read.
    """
    count, across = strip_frames(frames), strip_columns(frames)
    try:
        found = _frames(film, count)
    except (SyntaxError, ValueError, EOFError) as error:  # Pillow calls a broken PNG a SyntaxError
        raise OSError(f"{film} cannot be read: {error}") from error
    if not found:
        raise OSError(f"{film} has no frames")
    taken = [found[k * len(found) // count] for k in range(count)]
    cells = [fitted(frame, CELL) for frame in taken]
    cells += [np.zeros_like(cells[0])] * (-len(cells) % across)
    rows = [np.concatenate(cells[k : k + across], 1) for k in range(0, len(cells), across)]
    poster = encoded(taken[len(taken) // 2], "WEBP", quality=QUALITY)
    return poster, encoded(np.concatenate(rows), "WEBP", quality=STRIP_QUALITY)


def _frames(film: Path, count: int) -> list[U8]:
    """Up to so many, evenly from the first to the last, none larger than a poster."""
    if film.suffix == ".mp4":
        return sample_frames(film, count, SIDE)
    if film.suffix == ".png":
        files = sorted(film.parent.glob("*.png"))
        return [fitted(_rgb(files[k]), SIDE) for k in _evenly(len(files), count)]
    found = []
    with Image.open(film) as pages:
        for index in _evenly(getattr(pages, "n_frames", 1), count):
            pages.seek(index)
            found.append(fitted(np.asarray(pages.convert("RGB")), SIDE))
    return found


def _evenly(frames: int, count: int) -> list[int]:
    return sorted(set(np.linspace(0, frames - 1, count).round().astype(int).tolist())) if frames else []
