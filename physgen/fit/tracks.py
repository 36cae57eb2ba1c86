"""Tracks: the poses of a scene's objects at the times of a film."""

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
"""Columns of a table of tracks: s, name, px, px, degrees."""
REQUIRED_COLUMNS = COLUMNS[:4]
LATEST_TIME = 120.0
"""Last time of tracks, s, at most; larger numbers are frames or milliseconds."""
LEAST_TIMES = 5
"""Number of times of a motion, at least."""


@dataclass(frozen=True)
class Tracks:
    """Observed poses of N objects at T times; NaN without an observation."""

    times: F64
    """(T,) s, rising; 0 is the time of the photo."""
    names: tuple[str, ...]
    """N names, in the order of the world's bodies."""
    poses: F64
    """(T, N, 3): x px, y px, angle rad, of the centre of mass."""
    losses: tuple[tuple[str, float], ...] = ()
    """Objects lost in plain sight, with the time of their last observation, s."""


@dataclass(frozen=True)
class _Row:
    """One observation of a table."""

    time: float
    name: str
    pose: tuple[float, float, float]


def read_tracks(path: Path, names: Sequence[str]) -> Tracks:
    """Read a table with COLUMNS; the angle is optional.

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
    heading = [name.strip() for name in reader.fieldnames or ()]
    reader.fieldnames = heading
    _check_columns(path, heading)
    rows: list[_Row] = []
    problems: list[Problem] = []
    known_rows: set[tuple[float, str]] = set()
    for row in reader:
        place = Place(str(path), reader.line_num, 1)
        row_problems = list(_row_problems(place, row, names))
        problems += row_problems
        # Other lines are still checked, so that all problems appear at once.
        if row_problems:
            continue
        observation = _read_row(row)
        name, time = observation.name, observation.time
        if (time, name) in known_rows:
            message = Message.TRACKS_TWICE
            problems.append(message.problem(place, "", f'"{name}"', time=time))
        known_rows.add((time, name))
        rows.append(observation)
    if problems:
        raise InputError(problems)
    return rows


def _check_columns(path: Path, heading: Sequence[str]) -> None:
    """Refuse a table without a required column. Raises InputError."""
    problems = []
    place = Place(str(path), 1, 1)
    columns = ",".join(COLUMNS)
    for column in REQUIRED_COLUMNS:
        if column not in heading:
            message = Message.TRACKS_COLUMN_MISSING
            problems.append(message.problem(place, "", f'"{column}"', columns=columns))
    if problems:
        raise InputError(problems)


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
            message = Message.TRACKS_NOT_NUMBER
            yield message.problem(place, column, f'"{text}"', unit=unit)
        elif column == "time" and value > LATEST_TIME:
            message = Message.TRACKS_LATE
            yield message.problem(place, column, f'"{text}"', longest=LATEST_TIME)


def _number(text: str) -> float:
    """Return the number in a text, or NaN."""
    try:
        return float(text)
    except ValueError:
        return nan


def _read_row(row: dict[str, str | None]) -> _Row:
    """Return the observation of a line without problems."""
    values = {column: _number((row.get(column) or "").strip()) for column in COLUMNS}
    pose = (values["x"], values["y"], radians(values["angle"]))
    return _Row(values["time"], (row["object"] or "").strip(), pose)


def _assemble(rows: Sequence[_Row], names: tuple[str, ...]) -> Tracks:
    """Return the tracks of all rows."""
    times = sorted({row.time for row in rows})
    time_index = {time: k for k, time in enumerate(times)}
    poses = np.full((len(times), len(names), 3), nan)
    for row in rows:
        poses[time_index[row.time], names.index(row.name)] = row.pose
    for k in range(len(names)):
        poses[:, k, 2] = _unwrap_angles(poses[:, k, 2])
    return Tracks(np.array(times, np.float64), names, poses)


def _unwrap_angles(angles: F64) -> F64:
    """Return angles (T,) rad without jumps by whole turns; NaN stays."""
    # A table states each angle within one turn.
    is_observed = np.isfinite(angles)
    result = angles.copy()
    result[is_observed] = np.unwrap(angles[is_observed])
    return result


def tracks_csv(tracks: Tracks) -> str:
    """Return the tracks as a table with COLUMNS."""
    lines = [",".join(COLUMNS)]
    for time, poses in zip(tracks.times.tolist(), tracks.poses, strict=True):
        for name, (x, y, angle) in zip(tracks.names, poses.tolist(), strict=True):
            if isfinite(x):
                turn = ""
                if isfinite(angle):
                    turn = f"{np.degrees(angle):.3f}"
                lines.append(f"{time:.6g},{name},{x:.3f},{y:.3f},{turn}")
    return "\n".join(lines) + "\n"
