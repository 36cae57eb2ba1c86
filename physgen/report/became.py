"""Tables of sweeps beside clips -> what became of each clip: numbers that a gallery sorts by."""

from __future__ import annotations

import csv
import json
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import islice
from math import isfinite
from pathlib import Path

from physgen.report.clips import Clip

TABLE, ASKED = "sweep.csv", "sweep.json"
BEFORE, BEHIND = "error", "video"
"""Columns between which outcomes stand."""
MOST, MOST_CELLS = 256, 200_000
"""Columns that are told of, the first ones, and values of all clips together: they stand in the page."""
MOST_ROWS = 1_000_000


@dataclass(frozen=True)
class Became:
    """One outcome."""

    column: str
    """Of the table: `objects.ball.rest_time`."""
    name: str
    """For people: `ball rest time`."""
    unit: str
    values: tuple[float | None, ...]
    """One a clip; None where it has none."""


def became(clips: Sequence[Clip]) -> list[Became]:
    """Outcomes that differ between clips, as tables beside their folders have them; none where there is no table."""
    places: dict[Path, dict[str, int]] = {}
    for k, clip in enumerate(clips):
        places.setdefault(clip.home.parent, {})[clip.home.name] = k
    found: dict[str, tuple[str, list[float | None]]] = {}
    most = min(MOST, MOST_CELLS // max(len(clips), 1))
    for folder, numbers in places.items():
        units = _units(folder / ASKED)
        for name, cells in _rows(folder / TABLE):
            if name in numbers:
                for column, value in cells:
                    if column not in found and len(found) >= most:
                        continue
                    _, values = found.setdefault(column, (units.get(column, ""), [None] * len(clips)))
                    values[numbers[name]] = value
    return [
        Became(column, _name(column), unit, tuple(values))
        for column, (unit, values) in found.items()
        if len({value for value in values if value is not None}) > 1
    ]


def _rows(table: Path) -> Iterable[tuple[str, list[tuple[str, float]]]]:
    """Name of a clip's folder, and its outcomes; nothing where the table is none of ours, or cannot be read."""
    rows = []
    try:
        with table.open(encoding="utf-8", newline="") as file:
            lines = csv.reader(file)
            heading = next(lines, [])
            if heading[:1] != ["number"] or not {"folder", BEFORE, BEHIND} <= set(heading):
                return []
            where = heading.index("folder")
            columns = list(enumerate(heading))[heading.index(BEFORE) + 1 : heading.index(BEHIND)]
            for line in islice(lines, MOST_ROWS):
                rows.append((line[where], [(name, float(line[k])) for k, name in columns if line[k]]))
    except (OSError, ValueError, IndexError, csv.Error):
        return []
    return [(name, [(column, value) for column, value in cells if isfinite(value)]) for name, cells in rows]


def _units(asked: Path) -> dict[str, str]:
    try:
        return {str(name): str(unit) for name, unit in json.loads(asked.read_bytes())["units"].items()}
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        return {}


def _name(column: str) -> str:
    """What a column is called.

    >>> _name("objects.ball-1.angle_degrees"), _name("peak_speed")
    ('ball-1 angle', 'peak speed')
    """
    thing, _, what = column.removeprefix("objects.").rpartition(".")
    return f"{thing} {what.removesuffix('_degrees').replace('_', ' ')}".strip()
