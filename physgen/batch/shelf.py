"""The folder of results -> what is beside the clips in it: a gallery, and traces of those that failed."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Protocol

from physgen.batch.pool import Done, ended
from physgen.report.gallery import Progress
from physgen.urls import is_url


class Shelf(Protocol):
    """A folder, here or behind a URL. Methods raise OSError where it cannot be reached, or written."""

    @property
    def index(self) -> str:
        """The gallery's file, as the user knows it."""

    def has_index(self) -> bool:
        """Whether there is a gallery."""

    def ended(self, done: Done, gallery: bool) -> None:
        """What `pool.ended` leaves or takes away; never raises."""

    def write_index(self, progress: Progress, kept: Callable[[str], None]) -> None:
        """The gallery of all clips there, made again; a file of somebody else's there is `kept` by another name."""


class NearShelf:
    """A folder of this machine."""

    def __init__(self, root: Path) -> None:
        self._root = root

    @property
    def index(self) -> str:
        """The gallery's file."""
        return str(self._root / "index.html")

    def has_index(self) -> bool:
        """Whether there is a gallery."""
        return (self._root / "index.html").exists()

    def ended(self, done: Done, gallery: bool) -> None:
        """See `pool.ended`."""
        ended(done, self._root, gallery)

    def write_index(self, progress: Progress, kept: Callable[[str], None]) -> None:
        """The gallery, where there is a folder at all."""
        from physgen.report.gallery import write_gallery

        if self._root.is_dir():
            index = self._root / "index.html"
            write_gallery([self._root], index, progress=progress, keep=lambda path: kept(path.name))


def shelf(out: str) -> Shelf:
    """That of a folder as the user names it. Raises InputError where nobody knows its protocol."""
    if not is_url(out):
        return NearShelf(Path(out))
    from physgen.batch.far_index import FarShelf

    return FarShelf(out)
