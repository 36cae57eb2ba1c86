"""Rows, one at a time -> `sweep.csv`, and `sweep.parquet` where pyarrow is: each appears when it is whole.

Memory does not grow with the rows: CSV goes out row by row, Parquet in groups.
"""

from __future__ import annotations

import csv
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from importlib.util import find_spec
from pathlib import Path
from types import TracebackType
from typing import Any, TextIO

from physgen.batch.columns import Cell, Column, Kind
from physgen.whole import partial

GROUP = 4096
"""Rows of a group of a Parquet file."""
HINT = 'the table is CSV alone; pip install "physgen[tables]" adds Parquet'


def has_parquet() -> bool:
    """Whether Parquet can be written here."""
    return find_spec("pyarrow") is not None


class Table:
    """Takes rows until it is left; then `paths` are there, or on any error none of them."""

    def __init__(self, stem: Path, columns: Sequence[Column]) -> None:
        """`stem` is the files' path without its ending."""
        self._columns = tuple(columns)
        self._stack = ExitStack()
        self._begun: list[tuple[Path, Path]] = []
        self.paths = [stem.with_name(f"{stem.name}.csv")]
        if has_parquet():
            self.paths.append(stem.with_name(f"{stem.name}.parquet"))

    def __enter__(self) -> Table:
        with ExitStack() as stack:
            for path in self.paths:
                beside = partial(path)
                stack.callback(beside.unlink, missing_ok=True)
                self._begun.append((beside, path))
            self._csv = stack.enter_context(self._begun[0][0].open("w", encoding="utf-8", newline=""))
            self._rows = csv.writer(self._csv, lineterminator="\n")
            self._rows.writerow(column.name for column in self._columns)
            self._parquet = (
                stack.enter_context(_Parquet(self._begun[1][0], self._columns)) if self.paths[1:] else None
            )
            self._stack = stack.pop_all()
        return self

    def add(self, row: Mapping[str, Cell]) -> None:
        """One row by the columns' names; what it lacks is empty."""
        cells = [row.get(column.name) for column in self._columns]
        self._rows.writerow(map(_written, cells))
        self._csv.flush()
        if self._parquet is not None:
            self._parquet.add(cells)

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        with self._stack:
            if kind is None:
                if self._parquet is not None:
                    self._parquet.close()
                self._csv.close()
                for beside, path in self._begun:
                    beside.replace(path)


def _written(value: Cell) -> str | int:
    """As pandas reads it back: floats to the last bit."""
    if value is None:
        return ""
    if isinstance(value, bool):
        return "true" if value else "false"
    return repr(value) if isinstance(value, float) else value


class _Parquet:
    """Rows -> one Parquet file with typed columns; units are in the columns' metadata."""

    def __init__(self, path: Path, columns: Sequence[Column]) -> None:
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
        self._writer = parquet.ParquetWriter(path, self._schema)
        self._held: list[list[Cell]] = []

    def __enter__(self) -> _Parquet:
        return self

    def __exit__(self, *error: object) -> None:
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
