"""Write rows to CSV and, where pyarrow is installed, to Parquet."""

from __future__ import annotations

import csv
import fcntl
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from enum import Enum
from importlib.util import find_spec
from io import BufferedWriter, FileIO, TextIOWrapper
from pathlib import Path
from types import TracebackType

from physgen.files import partial

GROUP = 4096
"""Rows of a group of a Parquet file."""
HINT = 'the table is CSV alone; pip install "physgen[tables]" adds Parquet'

Cell = str | int | float | bool | None
"""None is an empty cell."""


class Kind(Enum):
    """Of the values of a column."""

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
    """Takes rows; `publish` makes `paths` of them, and leaving it without that makes none."""

    def __init__(self, stem: Path, columns: Sequence[Column]) -> None:
        """`stem` is the files' path without its ending."""
        self.lost: Exception | None = None
        """Why there is no Parquet after all: the CSV goes on without it."""
        self._columns = tuple(columns)
        self._stack = ExitStack()
        self._begun: list[tuple[Path, Path]] = []
        self.count = 0
        self.paths = [stem.with_name(f"{stem.name}.csv")]
        if has_parquet():
            self.paths.append(stem.with_name(f"{stem.name}.parquet"))

    def __enter__(self) -> Table:
        with ExitStack() as stack:
            files = [stack.enter_context(_beside(path)) for path in self.paths]
            self._begun = [(Path(file.name), path) for file, path in zip(files, self.paths, strict=True)]
            self._text = stack.enter_context(TextIOWrapper(BufferedWriter(files[0]), "utf-8", newline=""))
            self._rows = csv.writer(self._text, lineterminator="\n")
            self._rows.writerow(column.name for column in self._columns)
            self._parquet: _Parquet | None = None
            with self._apart():
                self._parquet = stack.enter_context(_Parquet(files[1], self._columns)) if files[1:] else None
            self._stack = stack.pop_all()
        return self

    def add(self, row: Mapping[str, Cell]) -> None:
        """One row by the columns' names; what it lacks is empty."""
        cells = [row.get(column.name) for column in self._columns]
        with self._named():
            self._rows.writerow(map(_written, cells))
            self._text.flush()
            with self._apart():
                if self._parquet is not None:
                    self._parquet.add(cells)
        self.count += 1

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        with suppress(OSError):  # of a full disk, once more, while files are closed that nobody needs
            self._stack.__exit__(kind, error, trace)
        for beside, _ in self._begun:
            beside.unlink(missing_ok=True)

    def publish(self) -> list[Path]:
        """All rows are there: the files under their final names."""
        with self._named():
            with self._apart():
                if self._parquet is not None:
                    self._parquet.close()
            self._text.close()
            for beside, path in self._begun:
                if path in self.paths:
                    beside.replace(path)
                else:  # of an earlier run: it would tell of other rows than the CSV
                    beside.unlink(missing_ok=True)
                    path.unlink(missing_ok=True)
        self._begun.clear()
        return self.paths

    @contextmanager
    def _apart(self) -> Iterator[None]:
        """Whatever becomes of Parquet, the CSV has it not to suffer."""
        try:
            yield
        except Exception as error:
            self.lost, self._parquet = error, None
            del self.paths[1:]

    @contextmanager
    def _named(self) -> Iterator[None]:
        """A disk's error says which file it is of."""
        try:
            yield
        except OSError as error:
            raise OSError(error.errno, error.strerror or str(error), str(self.paths[0])) from error


@contextmanager
def _beside(path: Path) -> Iterator[FileIO]:
    """`NAME.part.csv`, for whoever wants to look; gone at the end. Where another run fills it, a file of our own."""
    beside = path.with_name(f"{path.stem}.part{path.suffix}")
    file = FileIO(beside, "a")
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        file.close()
        beside = partial(path)
        file = FileIO(beside, "a")
    except OSError:
        pass  # a file system without locks
    with file:
        file.truncate(0)
        file.seek(0)
        yield file


def _written(value: Cell) -> str | int:
    """As pandas reads it back: floats to the last bit."""
    if value is None:
        return ""
    if isinstance(value, bool):
        return "true" if value else "false"
    return repr(value) if isinstance(value, float) else value


class _Parquet:
    """Rows -> one Parquet file with typed columns; units are in the columns' metadata."""

    def __init__(self, file: FileIO, columns: Sequence[Column]) -> None:
        import pyarrow
        from pyarrow import parquet

        kinds = {
            Kind.TEXT: pyarrow.string(),
            Kind.WHOLE: pyarrow.int64(),
            Kind.NUMBER: pyarrow.float64(),
            Kind.TRUTH: pyarrow.bool_(),
        }
        fields = [
            pyarrow.field(c.name, kinds[c.kind], metadata={"unit": c.unit} if c.unit else None)
            for c in columns
        ]
        self._schema = pyarrow.schema(fields)
        self._arrow = pyarrow
        self._writer = parquet.ParquetWriter(file, self._schema)
        self._held: list[list[Cell]] = []

    def __enter__(self) -> _Parquet:
        return self

    def __exit__(self, *error: object) -> None:
        with suppress(Exception):  # what could not be written before
            self._writer.close()

    def add(self, cells: list[Cell]) -> None:
        """One row."""
        self._held.append(cells)
        if len(self._held) == GROUP:
            self._flush()

    def close(self) -> None:
        """The file is whole after it."""
        if self._held:
            self._flush()
        self._writer.close()

    def _flush(self) -> None:
        arrays = [
            self._arrow.array(list(cells), field.type)
            for cells, field in zip(zip(*self._held, strict=True), self._schema, strict=True)
        ]
        self._writer.write_table(self._arrow.Table.from_arrays(arrays, schema=self._schema))
        self._held.clear()
