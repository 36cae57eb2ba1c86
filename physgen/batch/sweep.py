"""A sweep: its clips by number, their names, a check before the first render, and its
table.

In the order of clips, variants change slowest. The keys of the grid follow in the order
of the arguments, and the last key changes fastest. All points of the grid have the same
draws, so that two points differ only in the grid's keys.

In the name `04-01,velocity.x=-500,elasticity=0.9`, the first key has its fifth value
and the second key its second. Draws have four digits or more: `0007,mass=183.4`. The
numbers make names unique and sort them in the order of the sweep. A value at the end of
an axis, or more draws, leave the other names unchanged.
"""

from __future__ import annotations

import csv
import re
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property, partial
from hashlib import sha256
from math import prod
from pathlib import Path
from typing import Any, TextIO

from physgen.batch.axes import Axis, DistributionAxis, ListAxis, same_key
from physgen.batch.run import JobResult
from physgen.batch.values import Value
from physgen.files import back_up
from physgen.messages import Message
from physgen.problems import InputError, Place, Problem, Severity, collect
from physgen.report.sweep_keys import shortest_names
from physgen.scene.load import OpenedScene
from physgen.scene.scene import Scene
from physgen.tables import Cell, Table
from physgen.text import quoted

MAX_CLIPS = 10_000_000
MAX_NAME_BYTES = 100
"""Maximum length of a name. File systems allow 255 bytes, but traces and partial files
append to the name.
"""
MAX_VALUE_LENGTH = 24
"""Maximum number of characters for a value in a name."""
MAX_CHECKED_VARIANTS = 50
"""Maximum number of variants to check, so that a sweep starts without a long wait."""


@dataclass(frozen=True)
class Point:
    """One clip of a sweep."""

    # Counted from 0.
    number: int
    # Name of the folder.
    name: str
    variant: str | None
    # One value per axis.
    values: tuple[Value, ...]
    # `KEY=VALUE` per axis, in the syntax of `--set`.
    overrides: tuple[str, ...]


@dataclass(frozen=True)
class Sweep:
    """All clips to make; `sweep[k]` is clip k. Clips are computed on request, so that
    millions take no memory.
    """

    axes: tuple[Axis, ...]
    # None is the file without a variant.
    variants: tuple[str | None, ...] = (None,)
    # Draws at each point of the grid; 0 if all keys have lists.
    samples: int = 0
    seed: int = 0

    def __len__(self) -> int:
        return prod(self._sizes)

    def __getitem__(self, number: int) -> Point:
        if not 0 <= number < len(self):
            raise IndexError(number)
        # A clip's number is a number of mixed radix: the draw is its lowest digit, then
        # come the axes from last to first, and the variant is the highest.
        rest, draw_number = divmod(number, max(self.samples, 1))
        indices: list[int] = []
        for axis in reversed(self._grid):
            rest, index = divmod(rest, len(axis.values))
            indices.insert(0, index)
        values = self._values(iter(indices), draw_number)
        variant = self.variants[rest]
        # Numbers of fixed width sort as text. A single variant needs no number.
        numbers = [f"{rest:02d}"] * (len(self.variants) > 1) + [
            f"{index:02d}" for index in indices
        ]
        numbers += [f"{draw_number:04d}"] * bool(self.samples)
        if variant is not None and len(self.variants) > 1:
            parts = [variant]
        else:
            parts = []
        parts += [
            f"{key}={short_text(value)}"
            for key, value in zip(self._short_keys, values, strict=True)
        ]
        return Point(
            number, clip_name(numbers, parts), variant, values, self.set_to(values)
        )

    def __iter__(self) -> Iterator[Point]:
        return map(self.__getitem__, range(len(self)))

    @property
    def _sizes(self) -> list[int]:
        return [
            *(len(axis.values) for axis in self._grid),
            max(self.samples, 1),
            len(self.variants),
        ]

    @cached_property
    def _grid(self) -> tuple[ListAxis, ...]:
        return tuple(axis for axis in self.axes if isinstance(axis, ListAxis))

    @cached_property
    def _short_keys(self) -> list[str]:
        return [
            ".".join(parts)
            for parts in shortest_names([axis.key for axis in self.axes])
        ]

    def _values(self, indices: Iterator[int], draw_number: int) -> tuple[Value, ...]:
        values = []
        for axis in self.axes:
            if isinstance(axis, ListAxis):
                values.append(axis.values[next(indices)])
            else:
                # A draw depends on its key: further axes leave the draws of this one
                # unchanged.
                values.append(
                    axis.distribution.quantile(
                        draw(self.seed, same_key(axis), draw_number)
                    )
                )
        return tuple(values)

    def set_to(self, values: Sequence[Value]) -> tuple[str, ...]:
        """Return `KEY=VALUE` for each axis."""
        return tuple(
            f"{axis.key}={value.text}"
            for axis, value in zip(self.axes, values, strict=True)
        )

    def typical(self) -> tuple[Value, ...]:
        """Return the first value of each list and the median of each distribution."""
        return tuple(
            axis.values[0]
            if isinstance(axis, ListAxis)
            else axis.distribution.quantile(0.5)
            for axis in self.axes
        )


def draw(seed: int, key: str, number: int) -> float:
    """Return a draw from the uniform distribution over 0 < x < 1, independent for every
    seed, key and number.
    """
    digest = sha256(f"{seed}\n{key}\n{number}".encode()).digest()
    # 52 bits and a half step: the draw is exact in a float and never 0 or 1.
    return ((int.from_bytes(digest[:8], "big") >> 12) + 0.5) / 2**52


def plan_clips(
    axes: Sequence[Axis],
    variants: Sequence[str | None] = (None,),
    samples: int | None = None,
    seed: int | None = None,
) -> Sweep:
    """Return a sweep after a check that its parts fit together. None stands for a
    missing option. Raise InputError.
    """
    problems = _problems_of_draws(axes, samples, seed)
    if not axes and len(variants) == 1:
        problems.append(Message.NO_KEYS_TO_SWEEP.problem(Place("sweep")))
    draw_count = 0
    # Clips without a distribution would be equal for all draws, so they get none.
    if samples and any(isinstance(axis, DistributionAxis) for axis in axes):
        draw_count = samples
    sweep = Sweep(tuple(axes), tuple(variants), draw_count, seed or 0)
    count = prod(sweep._sizes)
    if count > MAX_CLIPS:
        problem = Message.TOO_MANY_CLIPS.problem(
            Place("sweep"),
            product=" x ".join(f"{size:,}" for size in sweep._sizes if size > 1),
            count=count,
            most=MAX_CLIPS,
        )
        problems.append(problem)
    if problems:
        raise InputError(problems)
    return sweep


def _problems_of_draws(
    axes: Sequence[Axis], samples: int | None, seed: int | None
) -> list[Problem]:
    """Return the problems of distributions without a count, and of options without
    them.
    """
    for axis in axes:
        if isinstance(axis, DistributionAxis):
            if samples is None:
                return [Message.DRAWS_WITHOUT_COUNT.problem(axis.place)]
            return []
    problems = []
    for flag, value in (("--samples", samples), ("--seed", seed)):
        if value is not None:
            problems.append(Message.NOTHING_TO_DRAW.problem(Place(flag)))
    return problems


def clip_name(numbers: Sequence[str], parts: Sequence[str]) -> str:
    """Return `00-01,part,part`. Parts beyond the maximum length are counted: `,+2`."""
    text = "-".join(numbers)
    for n, part in enumerate(parts):
        longer = f"{text},{part}"
        left = len(parts) - n - 1
        # File systems count bytes and not characters.
        if len(longer.encode()) + (len(f",+{left}") if left else 0) > MAX_NAME_BYTES:
            return f"{text},+{left + 1}"
        text = longer
    return text


def short_text(value: Value) -> str:
    """Return a value in about four digits or one word, in safe characters for shells
    and file systems.

    >>> [short_text(Value("", data)) for data in (-500, 0.1 + 0.2, 12345.678, 1.5e-7, True, None, [256, 256], "a b/c")]
    ['-500', '0.3', '12346', '1.5e-7', 'true', 'none', '256x256', 'a_b_c']
    """
    data = value.data
    if (
        isinstance(data, list)
        and 0 < len(data) <= 4
        and all(isinstance(item, int | float) for item in data)
    ):
        return "x".join(map(_short_scalar, data))
    return _short_scalar(value.text if isinstance(data, list | dict) else data)


def _short_scalar(data: Any) -> str:
    if data is None or isinstance(data, bool):
        return {None: "none", True: "true", False: "false"}[data]
    if isinstance(data, int | float):
        size = abs(data)
        if (size < 1e7 and data % 1 == 0) or 1e3 <= size < 1e7:
            text = f"{data:.0f}"
        else:
            text = f"{data:.4g}"
        # Shorten the exponent: 1.5e-07 becomes 1.5e-7.
        return re.sub(r"e\+?(-?)0*", r"e\1", text)
    return re.sub(r"[^\w.+-]+", "_", str(data)).strip("_.")[:MAX_VALUE_LENGTH] or "_"


def check_values(
    sweep: Sweep, scene_file: OpenedScene, overrides: Sequence[str] = ()
) -> tuple[str, ...]:
    """Load the scene with a typical value of every key, and return the names of all
    movable objects.

    `overrides` come from `--set`. Raise InputError if the typical values fail: a key is
    misspelt, or its values do not fit. Other failing values are failed clips.
    """
    typical = sweep.typical()
    variants = sweep.variants[:MAX_CHECKED_VARIANTS]
    scenes = collect(
        partial(_scene, sweep, scene_file, overrides, typical, variant)
        for variant in variants
    )
    movable = (
        item.name
        for scene in scenes
        for item in scene.objects
        if item.motion.value != "static"
    )
    return tuple(dict.fromkeys(movable))


def _scene(
    sweep: Sweep,
    scene_file: OpenedScene,
    overrides: Sequence[str],
    values: Sequence[Value],
    variant: str | None,
) -> Scene:
    """Return the scene with the values. Raise InputError with the sweep's arguments as
    the places of problems, instead of `--set`.
    """
    settings = sweep.set_to(values)
    places = {}
    # A problem names the source of its edit: map it to the argument of the sweep.
    for text, axis in zip(settings, sweep.axes, strict=True):
        places[quoted(f"--set {text}", "", 80)] = axis.place
    try:
        return scene_file.scene((*overrides, *settings), variant)
    except InputError as error:
        raise InputError(
            replace(problem, place=places.get(problem.place.file, problem.place))
            for problem in error.problems
        ) from None


def table_columns(sweep: Sweep, outcomes: Sequence[str]) -> tuple[str, ...]:
    """Return the columns of the table: the clip, its values, its state, its outcomes
    and its files.
    """
    keys = (axis.key for axis in sweep.axes)
    return (
        "number",
        "name",
        "variant",
        "folder",
        *keys,
        "state",
        "error",
        *outcomes,
        "video",
        "manifest",
    )


def table_row(sweep: Sweep, point: Point, result: JobResult) -> dict[str, Cell]:
    """Return cells by column name. Paths are relative to the sweep's folder."""
    cells: dict[str, Cell] = {
        "number": point.number,
        "name": point.name,
        "variant": point.variant or "",
    }
    for axis, value in zip(sweep.axes, point.values, strict=True):
        cells[axis.key] = value.cell
    if result.folder is None:
        errors = (
            str(problem)
            for problem in result.problems
            if problem.severity is Severity.ERROR
        )
        return cells | {"state": "failed", "error": " | ".join(errors)}
    files: dict[str, Cell] = {
        "folder": point.name,
        "video": f"{point.name}/{result.job.options.formats[0].file}",
        "manifest": f"{point.name}/manifest.json",
    }
    return cells | {"state": "done"} | files | dict(result.outcomes or {})


def open_table(path: Path, columns: Sequence[str]) -> Table:
    """Return the table of a sweep, which opens its file at the start of a `with`
    block.
    """
    return Table(path, columns)


def write_row(stream: TextIO, cells: Sequence[Cell]) -> None:
    """Write one row of a CSV table."""
    csv.writer(stream, lineterminator="\n").writerow(cells)


def keep_other_table(
    table: Path, new_table: Path, keep: Callable[[Path], None]
) -> None:
    """Rename an existing `table` to `NAME~` if its clips or columns differ from the new
    table's.
    """
    if table.is_file() and _names(table) != _names(new_table):
        back_up(table, keep)


def _names(table: Path) -> list[str | None]:
    """Return the columns of a table and the names of its clips, or an empty list for
    another file.
    """
    with (
        table.open(encoding="utf-8", errors="replace", newline="") as text,
        suppress(csv.Error),
    ):
        rows = csv.DictReader(text)
        return [*(rows.fieldnames or ()), *(row.get("name") for row in rows)]
    return []
