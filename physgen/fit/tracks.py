"""Tracks: where the objects of a scene are at the times of a film."""

from __future__ import annotations

import csv
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from math import isfinite, nan, radians
from pathlib import Path

import numpy as np

from physgen.arrays import F64
from physgen.messages import Message, one_of
from physgen.problems import InputError, Place, Problem

COLUMNS = ("time", "object", "x", "y", "angle")
"""Of a table of tracks: s, name, px, px, degrees."""
NEEDED = COLUMNS[:4]
LONGEST = 120.0
"""s: last time of tracks, at most. Later ones are frames or milliseconds."""
LEAST_TIMES = 5
"""Times without which no motion is fitted."""


@dataclass(frozen=True)
class Tracks:
    """Observed poses of N objects at T times; what was not observed is NaN."""

    times: F64
    """(T,) s, rising; 0 is the photo's moment."""
    names: tuple[str, ...]
    """N names, in the order of the world's bodies."""
    poses: F64
    """(T, N, 3): x px, y px, angle rad, of the centre of mass."""
    losses: tuple[tuple[str, float], ...] = ()
    """Objects that a tracker lost for good, with the last time at which it saw them."""


@dataclass(frozen=True)
class _Row:
    """One observation of a table."""

    time: float
    name: str
    pose: tuple[float, float, float]


def read_tracks(path: Path, names: Sequence[str]) -> Tracks:
    """Read a table with COLUMNS, of which the angle may be missing or empty.

    `names` are the objects of the scene. Raises InputError with every wrong line.
    """
    try:
        text = path.read_text(encoding="utf-8-sig")
    except UnicodeDecodeError:
        raise Message.TRACKS_NOT_TEXT.error(str(path)) from None
    try:
        rows = _read_rows(path, text, names)
    except csv.Error as error:
        raise Message.CSV_UNREADABLE.error(str(path), reason=error) from None
    tracks = _assemble(rows, tuple(names))
    if len(tracks.times) < LEAST_TIMES:
        raise Message.TRACKS_FEW.error(
            str(path), f"{len(tracks.times)} times", least=LEAST_TIMES
        )
    return tracks


def _read_rows(path: Path, text: str, names: Sequence[str]) -> list[_Row]:
    """Return the rows of a table. Raises InputError, and csv.Error."""
    reader = csv.DictReader(text.splitlines())
    heading = [one.strip() for one in reader.fieldnames or ()]
    reader.fieldnames = heading
    missing = [column for column in NEEDED if column not in heading]
    if missing:
        place = Place(str(path), 1, 1)
        columns = ",".join(COLUMNS)
        absent = Message.TRACKS_COLUMN_MISSING
        raise InputError(
            [absent.problem(place, "", f'"{one}"', columns=columns) for one in missing]
        )
    rows: list[_Row] = []
    problems: list[Problem] = []
    seen: set[tuple[float, str]] = set()
    for row in reader:
        place = Place(str(path), reader.line_num, 1)
        faults = list(_row_problems(place, row, names))
        problems += faults
        if faults:
            continue
        one = _read_row(row)
        if (one.time, one.name) in seen:
            twice = Message.TRACKS_TWICE
            problems.append(twice.problem(place, "", f'"{one.name}"', time=one.time))
        seen.add((one.time, one.name))
        rows.append(one)
    if problems:
        raise InputError(problems)
    return rows


def _row_problems(
    place: Place, row: dict[str, str | None], names: Sequence[str]
) -> Iterator[Problem]:
    """Yield the problems of one line."""
    name = (row["object"] or "").strip()
    if name not in names:
        fix = one_of(name, names)
        yield Message.TRACKS_UNKNOWN_OBJECT.problem(place, "", f'"{name}"', fix=fix)
    for column in COLUMNS:
        text = (row.get(column) or "").strip()
        if column == "object" or (column == "angle" and not text):
            continue
        value = _number(text)
        if not isfinite(value) or (column == "time" and value < 0):
            unit = {"time": "seconds from 0", "angle": "degrees"}.get(column, "px")
            wrong = Message.TRACKS_NOT_NUMBER
            yield wrong.problem(place, column, f'"{text}"', unit=unit)
        elif column == "time" and value > LONGEST:
            late = Message.TRACKS_LATE
            yield late.problem(place, column, f'"{text}"', longest=LONGEST)


def _number(text: str) -> float:
    """Return the number that a text is, NaN if it is none."""
    try:
        return float(text)
    except ValueError:
        return nan


def _read_row(row: dict[str, str | None]) -> _Row:
    values = {column: _number((row.get(column) or "").strip()) for column in COLUMNS}
    pose = (values["x"], values["y"], radians(values["angle"]))
    return _Row(values["time"], (row["object"] or "").strip(), pose)


def _assemble(rows: Sequence[_Row], names: tuple[str, ...]) -> Tracks:
    """Return the tracks of all rows."""
    times = sorted({row.time for row in rows})
    number = {time: k for k, time in enumerate(times)}
    poses = np.full((len(times), len(names), 3), nan)
    for row in rows:
        poses[number[row.time], names.index(row.name)] = row.pose
    for k in range(len(names)):
        poses[:, k, 2] = _unwrapped(poses[:, k, 2])
    return Tracks(np.array(times, np.float64), names, poses)


def _unwrapped(angles: F64) -> F64:
    """Return angles (T,) rad without jumps by whole turns; NaN stays."""
    known = np.isfinite(angles)
    result = angles.copy()
    result[known] = np.unwrap(angles[known])
    return result


def tracks_csv(tracks: Tracks) -> str:
    """Return the tracks as a table with COLUMNS."""
    lines = [",".join(COLUMNS)]
    for time, poses in zip(tracks.times.tolist(), tracks.poses, strict=True):
        for name, (x, y, angle) in zip(tracks.names, poses.tolist(), strict=True):
            if isfinite(x):
                turn = f"{np.degrees(angle):.3f}" if isfinite(angle) else ""
                lines.append(f"{time:.6g},{name},{x:.3f},{y:.3f},{turn}")
    return "\n".join(lines) + "\n"
