"""The film of a clip on a page: linked or embedded, with a poster."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from PIL import Image

from physgen.export.video import U8, sample_frames
from physgen.problems import Place, Problem, Severity
from physgen.report.html import data_uri, encoded, fitted

MAILED = 50_000_000
"""Bytes of a page that most mailboxes accept."""
BEST = (".mp4", ".webp", ".gif")
"""Films, the best first: only a video plays in step with the player. A folder of frames comes last."""
SIDE = 480
"""px of the longer side of a poster, at most."""
QUALITY = 80
"""Of WebP. A poster takes about 8 kB."""


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


def embedded_film(folder: Path, made: Sequence[str], title: str) -> Film:
    """The same inside the page, saved as `title`; of a folder of frames, the one in the middle."""
    name = _best(made)
    if "." not in name:
        return Film(data_uri(poster(folder / name / "00000.png"), ".webp"), False, f"{title}.webp")
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


def _rgb(file: Path) -> U8:
    return np.asarray(Image.open(file).convert("RGB"))


def poster(film: Path) -> bytes:
    """The first frame of a film, which is the photo, as WebP. Raises OSError where it cannot be read."""
    try:
        frame = sample_frames(film, 1, SIDE)[0] if film.suffix == ".mp4" else _rgb(film)
    except (SyntaxError, ValueError, EOFError, IndexError) as error:  # SyntaxError: a broken PNG
        raise OSError(f"{film} cannot be read: {error}") from error
    return encoded(fitted(frame, SIDE), "WEBP", quality=QUALITY)
