"""The folder of results -> what is beside the clips in it: a gallery, and traces of those that failed."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Protocol

from physgen.batch.pool import Done, ended
from physgen.batch.workers import LostError, spread
from physgen.report.gallery import Progress
from physgen.urls import is_url

MANY = 1000
"""Clips whose gallery is made in a process of its own."""


class Shelf(Protocol):
    """A folder, here or behind a URL. Methods raise OSError where it cannot be reached, or written."""

    @property
    def index(self) -> str:
        """The gallery's file, as the user knows it."""

    def has_index(self, since: float = 0.0) -> bool:
        """Whether there is a gallery, made since then, s since 1970, as far as that can be told."""

    def ended(self, done: Done, gallery: bool) -> None:
        """What `pool.ended` leaves or takes away; never raises."""

    def cleared(self) -> AbstractContextManager[None]:
        """What processes were ended over goes, where the block is left early."""

    def write_index(self, progress: Progress, kept: Callable[[str], None], count: int) -> None:
        """The gallery of all clips there, some `count`, made again; a file of somebody else's is `kept` elsewhere."""


class NearShelf:
    """A folder of this machine."""

    def __init__(self, root: Path) -> None:
        self._root = root

    @property
    def index(self) -> str:
        """The gallery's file."""
        return str(self._root / "index.html")

    def has_index(self, since: float = 0.0) -> bool:
        """Whether there is a gallery that is not older."""
        index = self._root / "index.html"
        return index.exists() and index.stat().st_mtime >= since

    def ended(self, done: Done, gallery: bool) -> None:
        """See `pool.ended`."""
        ended(done, self._root, gallery)

    def cleared(self) -> AbstractContextManager[None]:
        """See `report.leftovers`."""
        from physgen.report.leftovers import cleared

        return cleared(self._root)

    def write_index(self, progress: Progress, kept: Callable[[str], None], count: int) -> None:
        """The gallery, where there is a folder at all; many clips fill another process's memory."""
        if not self._root.is_dir():
            return
        if count <= MANY:
            for path in _page(self._root, progress):
                kept(path.name)
            return
        progress("gallery", 0, 1)
        for paths in spread(_page, [self._root], 2, _lost):
            for path in paths:
                kept(path.name)


def _page(root: Path, progress: Progress = lambda stage, done, total: None) -> list[Path]:
    """The gallery of a folder; what stood in its way."""
    from physgen.report.gallery import write_gallery

    kept: list[Path] = []
    write_gallery([root], root / "index.html", progress=progress, keep=kept.append)
    return kept


def _lost(root: Path, error: LostError) -> list[Path]:
    raise OSError(f"{root}: the gallery could not be made: {error}")


def shelf(out: str) -> Shelf:
    """That of a folder as the user names it. Raises InputError where nobody knows its protocol."""
    if not is_url(out):
        return NearShelf(Path(out))
    from physgen.batch.far_index import FarShelf

    return FarShelf(out)
