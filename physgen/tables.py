"""Write rows to a CSV file that appears when it is complete."""

from __future__ import annotations

import csv
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TextIO

from physgen.files import partial
from physgen.operating_system import IS_POSIX, lock_file

Cell = str | int | float | bool | None
"""None is an empty cell."""


class Table:
    """Takes rows.

    `publish` gives the file its name, and leaving the block without it removes the file.
    """

    def __init__(self, path: Path, columns: Sequence[str]) -> None:
        """Open no file yet; `path` ends in `.csv`, `columns` are names."""
        self.count = 0
        self.path = path
        self._names = columns

    def __enter__(self) -> Table:
        self._file = _open_part(self.path)
        self.part = Path(self._file.name)
        self._rows = csv.writer(self._file, lineterminator="\n")
        self._rows.writerow(self._names)
        return self

    def add(self, row: Mapping[str, Cell]) -> None:
        """Add a row, by the names of columns; missing cells are empty."""
        with self._named_errors():
            cells = map(row.get, self._names)  # floats are written to the last bit
            self._rows.writerow(
                str(cell).lower() if isinstance(cell, bool) else cell for cell in cells
            )
            self._file.flush()
        self.count += 1

    def publish(self) -> None:
        """Close the complete file and give it its name."""
        with self._named_errors():
            self._file.close()
            self.part.replace(self.path)

    def __exit__(self, *error: object) -> None:
        with suppress(OSError):  # a full disk fails once more; nobody needs this file
            self._file.close()
        self.part.unlink(missing_ok=True)

    @contextmanager
    def _named_errors(self) -> Iterator[None]:
        """Name the table's file in errors of the disk."""
        try:
            yield
        except OSError as error:
            raise OSError(
                error.errno, error.strerror or str(error), str(self.path)
            ) from error


def _open_part(path: Path) -> TextIO:
    """Open `NAME.part.csv`, which users may look at.

    A file of this process if another run writes that.
    """
    part = path.with_name(f"{path.stem}.part{path.suffix}")
    if IS_POSIX:  # elsewhere, an open file cannot be locked
        file = part.open("a", encoding="utf-8", newline="")
        if lock_file(file):
            file.truncate(0)
            return file
        file.close()
    return partial(path).open("w", encoding="utf-8", newline="")
