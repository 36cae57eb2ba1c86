"""What a run wrote of its clip -> the film as its page shows it: a file beside the page, or carried in it."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from PIL import Image

from physgen.problems import Place, Problem, Severity
from physgen.report.encoded import data_uri
from physgen.report.video import Format, open_video

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


def beside(folder: Path, made: Sequence[str]) -> Film:
    """The best of the files and folders of frames that lie in `folder`."""
    name = _best(made)
    if "." in name:
        return Film(name, name.endswith(".mp4"), name)
    return Film(f"{name}/00000.png", False, f"{name}/00000.png", f"{name}/")


def carried(folder: Path, made: Sequence[str], fps: float, title: str) -> Film:
    """The same inside the page; frames of a folder become a video at `fps`, 1/s. `title` is what it is saved as."""
    name = _best(made)
    if "." not in name:
        return Film(data_uri(_filmed(folder / name, fps), ".mp4"), True, f"{title}.mp4")
    ending = Path(name).suffix
    return Film(data_uri((folder / name).read_bytes(), ending), ending == ".mp4", f"{title}{ending}")


def heavy(page: Path, fix: str) -> Problem | None:
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
