"""Write rows to CSV and, where pyarrow is installed, to Parquet.

Memory does not grow with the rows: CSV is written row by row, Parquet in groups.
"""

from __future__ import annotations

import csv
import fcntl
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from enum import Enum
from importlib.util import find_spec
from pathlib import Path
from typing import Any, TextIO

from physgen.files import partial

GROUP = 4096
"""Rows of a row group of Parquet."""
HINT = 'the table is CSV alone; pip install "physgen[tables]" adds Parquet'

Cell = str | int | float | bool | None
"""None is an empty cell."""


class Kind(Enum):
    """Type of a column."""

    TEXT = "text"
    WHOLE = "whole"
    NUMBER = "number"
    TRUTH = "truth"


@dataclass(frozen=True)
class Column:
    """One column of a table."""

    name: str
    kind: Kind = Kind.NUMBER
    unit: str = ""


def has_parquet() -> bool:
    """Whether Parquet can be written here."""
    return find_spec("pyarrow") is not None


class Table:
    """Takes rows; `publish` gives the files their names, and leaving the block without it removes them."""

    def __init__(self, stem: Path, columns: Sequence[Column]) -> None:
        """`stem` is the path of the files without their suffix."""
        self.lost: Exception | None = None
        """Why Parquet could not be written; the CSV goes on without it."""
        self.count = 0
        self.paths = [stem.with_name(f"{stem.name}.csv")]
        if has_parquet():
            self.paths.append(stem.with_name(f"{stem.name}.parquet"))
        self._columns = tuple(columns)
        self._names = [column.name for column in columns]
        self._parts: dict[Path, Path] = {}
        """Final path -> the file that is being written."""
        self._held: list[list[Cell]] = []
        self._writer: Any = None
        """pyarrow's ParquetWriter; None where there is none."""

    def __enter__(self) -> Table:
        csv_path = self.paths[0]
        self._file = _open_part(csv_path)
        self._parts[csv_path] = Path(self._file.name)
        self._rows = csv.writer(self._file, lineterminator="\n")
        self._rows.writerow(self._names)
        for path in self.paths[1:]:
            self._parts[path] = self._parts[csv_path].with_suffix(path.suffix)
            with self._parquet_errors():
                self._open_parquet(self._parts[path])
        return self

    def add(self, row: Mapping[str, Cell]) -> None:
        """Adds a row, by the names of columns; missing cells are empty."""
        cells = [row.get(name) for name in self._names]
        with self._named_errors():
            self._rows.writerow(map(_csv_text, cells))
            self._file.flush()
        with self._parquet_errors():
            if self._writer is not None:
                self._held.append(cells)
                if len(self._held) == GROUP:
                    self._write_group()
        self.count += 1

    def publish(self) -> list[Path]:
        """Completes the files and returns their paths."""
        with self._parquet_errors():
            if self._writer is not None:
                self._write_group()
                self._writer.close()
        with self._named_errors():
            self._file.close()
            for path, part in self._parts.items():
                if path in self.paths:
                    part.replace(path)
                else:  # an earlier Parquet file would differ from the CSV
                    part.unlink(missing_ok=True)
                    path.unlink(missing_ok=True)
        self._parts.clear()
        return self.paths

    def __exit__(self, *error: object) -> None:
        for opened in (self._file, self._writer):
            with suppress(Exception):  # a full disk fails once more; nobody needs these files
                if opened is not None:
                    opened.close()
        for part in self._parts.values():
            part.unlink(missing_ok=True)

    def _open_parquet(self, path: Path) -> None:
        import pyarrow
        from pyarrow import parquet

        types = {
            Kind.TEXT: pyarrow.string(),
            Kind.WHOLE: pyarrow.int64(),
            Kind.NUMBER: pyarrow.float64(),
            Kind.TRUTH: pyarrow.bool_(),
        }
        self._schema = pyarrow.schema(
            pyarrow.field(c.name, types[c.kind], metadata={"unit": c.unit} if c.unit else None)
            for c in self._columns
        )
        self._writer = parquet.ParquetWriter(path, self._schema)

    def _write_group(self) -> None:
        import pyarrow

        if self._held:
            columns = zip(zip(*self._held, strict=True), self._schema, strict=True)
            arrays = [pyarrow.array(list(cells), field.type) for cells, field in columns]
            self._writer.write_table(pyarrow.Table.from_arrays(arrays, schema=self._schema))
            self._held.clear()

    @contextmanager
    def _parquet_errors(self) -> Iterator[None]:
        """An error in writing Parquet ends Parquet only."""
        try:
            yield
        except Exception as error:
            self.lost = error
            with suppress(Exception):
                self._writer.close()
            self._writer = None
            del self.paths[1:]

    @contextmanager
    def _named_errors(self) -> Iterator[None]:
        """Errors of the disk name the table's file."""
        try:
            yield
        except OSError as error:
            raise OSError(error.errno, error.strerror or str(error), str(self.paths[0])) from error


def _open_part(path: Path) -> TextIO:
    """`NAME.part.csv`, which users may look at; where another run writes that, a file of this process."""
    part = path.with_name(f"{path.stem}.part{path.suffix}")
    file = part.open("a", encoding="utf-8", newline="")
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        file.close()
        return partial(path).open("w", encoding="utf-8", newline="")
    except OSError:
        pass  # a file system without locks
    file.truncate(0)
    return file


def _csv_text(value: Cell) -> str | int:
    """Text that is read back exactly: floats to the last bit."""
    if value is None:
        return ""
    if isinstance(value, bool):
        return "true" if value else "false"
    return repr(value) if isinstance(value, float) else value
