"""Write rows to CSV and, where pyarrow is installed, to Parquet.

CSV is written row by row; at the end Parquet is made of it.
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
from typing import TextIO

from physgen.files import partial

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
        """Why Parquet could not be written."""
        self.count = 0
        self.path = stem.with_name(f"{stem.name}.csv")
        self._columns = tuple(columns)
        self._names = [column.name for column in columns]

    def __enter__(self) -> Table:
        self._file = _open_part(self.path)
        self._part = Path(self._file.name)
        self._rows = csv.writer(self._file, lineterminator="\n")
        self._rows.writerow(self._names)
        return self

    def add(self, row: Mapping[str, Cell]) -> None:
        """Adds a row, by the names of columns; missing cells are empty."""
        with self._named_errors():
            self._rows.writerow(_csv_text(row.get(name)) for name in self._names)
            self._file.flush()
        self.count += 1

    def publish(self) -> list[Path]:
        """Completes the files and returns their paths."""
        parquet = self.path.with_suffix(".parquet")
        with self._named_errors():
            self._file.close()
            parquet.unlink(missing_ok=True)  # an earlier one would differ from the CSV
        paths = [self.path]
        if has_parquet():
            part = partial(parquet)
            try:
                _write_parquet(self._part, part, self._columns)
                part.replace(parquet)
                paths.append(parquet)
            except Exception as error:  # the CSV is complete without it
                self.lost = error
                part.unlink(missing_ok=True)
        with self._named_errors():
            self._part.replace(self.path)
        return paths

    def __exit__(self, *error: object) -> None:
        with suppress(OSError):  # a full disk fails once more; nobody needs this file
            self._file.close()
        self._part.unlink(missing_ok=True)

    @contextmanager
    def _named_errors(self) -> Iterator[None]:
        """Errors of the disk name the table's file."""
        try:
            yield
        except OSError as error:
            raise OSError(error.errno, error.strerror or str(error), str(self.path)) from error


def _write_parquet(table: Path, path: Path, columns: Sequence[Column]) -> None:
    """The rows of a CSV file, in groups: memory does not grow with them. A text that is missing is empty."""
    import pyarrow
    from pyarrow import csv as reader
    from pyarrow import parquet

    types = {
        Kind.TEXT: pyarrow.string(),
        Kind.WHOLE: pyarrow.int64(),
        Kind.NUMBER: pyarrow.float64(),
        Kind.TRUTH: pyarrow.bool_(),
    }
    schema = pyarrow.schema(
        pyarrow.field(c.name, types[c.kind], metadata={"unit": c.unit} if c.unit else None) for c in columns
    )
    kinds = {field.name: field.type for field in schema}
    how = reader.ConvertOptions(column_types=kinds, null_values=[""])
    breaks = reader.ParseOptions(newlines_in_values=True)
    with (
        reader.open_csv(table, convert_options=how, parse_options=breaks) as batches,
        parquet.ParquetWriter(path, schema) as writer,
    ):
        for batch in batches:
            writer.write_batch(batch)


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
