"""A folder, here or behind a URL -> a folder of this machine in which a sweep's own files are written."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from physgen.batch.asked import NAME, TABLES, read_asked
from physgen.batch.far import own_folder
from physgen.batch.places import Far, far
from physgen.problems import InputError
from physgen.urls import is_url, url_below

MOST = 1_000_000_000
"""Bytes of a `sweep.json`, or of a table."""


@dataclass(frozen=True)
class Staged:
    """Where files are written, and where they belong."""

    folder: Path
    there: Far | None = None
    """None: they are where they belong."""

    def bring(self, names: Sequence[str]) -> None:
        """Files that are where they belong are in the folder, too, after it. Raises OSError."""
        if self.there is not None:
            for name in names:
                self.there.fetch(name, self.folder / name, MOST)

    def removed(self, names: Sequence[str]) -> None:
        """Files that are no more in the folder go from where they belong."""
        if self.there is not None:
            self.there.remove(list(names))

    def sent(self, paths: Sequence[Path]) -> list[str]:
        """Files of the folder, whole, brought to where they belong; returns what they are called there."""
        if self.there is None:
            return [str(path) for path in paths]
        self.there.send({path.name: path for path in paths})
        return [url_below(self.there.url, path.name) for path in paths]


@contextmanager
def staged(out: str) -> Iterator[Staged]:
    """For as long as the sweep is made. Raises InputError where files of somebody else's are in the way, or OSError."""
    if not is_url(out):
        yield Staged(Path(out))
        return
    there = far(out)
    taken = {NAME, *TABLES} & set(there.top())
    with own_folder() as folder:
        if NAME in taken:
            there.fetch(NAME, folder / NAME, MOST)
        if taken and read_asked(folder) is None:
            fix = "move it away, or choose another folder with -o"
            name = url_below(out, min(taken))
            raise InputError.of(name, "", "is there already and was not made by physgen", fix)
        yield Staged(folder, there)
