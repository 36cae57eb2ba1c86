"""The files of a sweep: sweep.json, and rows of the table."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from physgen.batch.axes import Listed
from physgen.batch.run import Done
from physgen.batch.sweep import Point, Sweep
from physgen.batch.values import cell
from physgen.files import back_up
from physgen.problems import InputError, Place, Problem, Severity
from physgen.report.record import file_hash, versions, write_json
from physgen.report.sweep_keys import unit
from physgen.simulate.trajectory import REST_DURATION, REST_SPEED, REST_TURN, START_TIME
from physgen.tables import Cell, Column, Kind

SWEEP_FILE = "sweep.json"
TABLES = ("sweep.csv", "sweep.parquet")
NOT_OURS = "is there already and was not made by physgen"
NOT_OURS_FIX = "move it away, or choose another folder with -o"


def table_columns(sweep: Sweep, outcomes: Sequence[Column]) -> tuple[Column, ...]:
    """Columns of the table: the clip, its values, its state, its outcomes and its files."""
    lead = (Column("number", Kind.WHOLE), *_texts("name", "variant", "folder"))
    keys = (Column(axis.key, axis.kind, unit(_numbered(axis.path))) for axis in sweep.axes)
    return (*lead, *keys, *_texts("state", "error"), *outcomes, *_texts("video", "manifest"))


def _texts(*names: str) -> tuple[Column, ...]:
    return tuple(Column(name, Kind.TEXT) for name in names)


def _numbered(path: Sequence[str | int]) -> tuple[str | int, ...]:
    """With integers for indices: `velocity.0` is one spelling of `velocity[0]`."""
    return tuple(int(part) if str(part).isdecimal() else part for part in path)


def table_row(sweep: Sweep, point: Point, done: Done) -> dict[str, Cell]:
    """Cells by the names of columns; paths are relative to the sweep's folder."""
    cells: dict[str, Cell] = {"number": point.number, "name": point.name, "variant": point.variant or ""}
    for axis, value in zip(sweep.axes, point.values, strict=True):
        cells[axis.key] = cell(value, axis.kind)
    if done.folder is None:
        errors = (str(problem) for problem in done.problems if problem.severity is Severity.ERROR)
        return cells | {"state": "failed", "error": " | ".join(errors)}
    files: dict[str, Cell] = {
        "folder": point.name,
        "video": f"{point.name}/{done.job.options.formats[0].file}",
        "manifest": f"{point.name}/manifest.json",
    }
    return cells | {"state": "done"} | files | dict(done.outcomes or {})


def sweep_record(sweep: Sweep, scene: str, out: str, **more: Any) -> dict[str, Any]:
    """Content of `sweep.json`; `more` is added: overrides, formats, the command."""
    return {
        "sweep": 1,
        "scene": Path(os.path.relpath(Path(scene).resolve(), Path(out).resolve())).as_posix(),
        "sha256": file_hash(Path(scene)),
        "clips": len(sweep),
        **_settings(sweep),
        **more,
        "versions": versions(),
        "rest": {"px/s": REST_SPEED, "degrees/s": REST_TURN, "lasting s": REST_DURATION},
        "start s": START_TIME,
    }


def _settings(sweep: Sweep) -> dict[str, Any]:
    """What the clips follow from, besides the scene."""
    return {
        "axes": [
            {"key": axis.key, "values": axis.argument.partition("=")[2].strip()}
            | ({"count": len(axis)} if isinstance(axis, Listed) else {"drawn": True})
            for axis in sweep.axes
        ],
        "variants": list(sweep.variants),
        "samples": sweep.samples,
        "seed": sweep.seed,
        "design": sweep.design.value,
    }


def read_sweep_record(folder: Path) -> dict[str, Any] | None:
    """The `sweep.json` of a folder; None where physgen wrote none there."""
    try:
        record = json.loads((folder / SWEEP_FILE).read_text(encoding="utf-8"))
        return record if record["sweep"] == 1 else None
    except (OSError, ValueError, KeyError, TypeError):
        return None


def begin(folder: Path, record: Mapping[str, Any], sweep: Sweep) -> list[Problem]:
    """Writes `sweep.json` into the sweep's folder; returns warnings. Raises InputError and OSError.

    No file of the user is overwritten: a `sweep.json` or table that physgen did not write is refused, and the tables
    of another sweep are kept as `NAME~`.
    """
    if folder.exists() and not folder.is_dir():
        raise InputError.of("-o", f'"{folder}"', "is a file", "name a folder")
    before = read_sweep_record(folder)
    if before is None:
        for name in (SWEEP_FILE, *TABLES):
            if (folder / name).exists():
                raise InputError.of(str(folder / name), "", NOT_OURS, NOT_OURS_FIX)
    kept: list[Path] = []
    if before is not None and any(before.get(key) != value for key, value in _settings(sweep).items()):
        for name in TABLES:
            back_up(folder / name, kept.append)
    folder.mkdir(parents=True, exist_ok=True)
    write_json(folder / SWEEP_FILE, record)
    found = ((path.name.rpartition("~")[0], path.name) for path in kept)
    return [
        Problem(
            Place(str(folder)), "", "", f"{name} is of another sweep; kept as {other}", "", Severity.WARNING
        )
        for name, other in found
    ]
