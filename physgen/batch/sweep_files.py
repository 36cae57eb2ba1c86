"""The files of a sweep: sweep.json, rows of the table, and a local staging folder for remote output."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from physgen.batch.axes import Listed
from physgen.batch.remote import RemoteFolder, is_url, open_folder, url_below
from physgen.batch.run import Done
from physgen.batch.sweep import Point, Sweep
from physgen.batch.values import cell
from physgen.files import back_up
from physgen.problems import InputError, Place, Problem, Severity
from physgen.report.folders import temporary_folder
from physgen.report.record import file_hash, versions, write_json
from physgen.report.sweep_keys import unit
from physgen.simulate.trajectory import REST_DURATION, REST_SPEED, REST_TURN, START_TIME
from physgen.tables import Cell, Column, Kind

SWEEP_FILE = "sweep.json"
TABLES = ("sweep.csv", "sweep.parquet")
MAX_FILE_BYTES = 1_000_000_000
"""Of a `sweep.json` or a table that is fetched."""
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


def sweep_record(sweep: Sweep, scene: str, scene_file: Path, out: str, **more: Any) -> dict[str, Any]:
    """Content of `sweep.json`; `more` is added: overrides, formats, the command.

    `scene` and `out` are as the user names them; `scene_file` is where the scene can be read.
    """
    source = os.path.abspath(scene) if is_url(out) and not is_url(scene) else scene
    if not is_url(source) and not is_url(out):
        source = Path(os.path.relpath(Path(scene).resolve(), Path(out).resolve())).as_posix()
    return {
        "sweep": 1,
        "scene": source,
        "sha256": file_hash(scene_file),
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


@dataclass(frozen=True)
class SweepFolder:
    """The folder of a sweep's own files; `folder` stands for `remote` where the results are remote."""

    out: str
    """As the user names it."""
    folder: Path
    remote: RemoteFolder | None = None

    def begin(self, record: Mapping[str, Any], sweep: Sweep) -> list[Problem]:
        """Writes `sweep.json`; returns warnings. Raises InputError and OSError.

        No file of the user is overwritten: a `sweep.json` or table that physgen did not write is refused, and the
        tables of another sweep are kept as `NAME~`.
        """
        folder = self.folder
        if folder.exists() and not folder.is_dir():
            raise InputError.of("-o", f'"{folder}"', "is a file", "name a folder")
        before = read_sweep_record(folder)
        if before is None:
            for name in (SWEEP_FILE, *TABLES):
                if (folder / name).exists():
                    raise InputError.of(str(folder / name), "", NOT_OURS, NOT_OURS_FIX)
        warnings = []
        kept: list[Path] = []
        if before is not None and any(before.get(key) != value for key, value in _settings(sweep).items()):
            for name in TABLES:
                if self.remote is not None:
                    self.remote.fetch(name, folder / name, MAX_FILE_BYTES)
                back_up(folder / name, kept.append)
        for path in kept:
            found = f"{path.name.rpartition('~')[0]} is of another sweep; kept as {path.name}"
            warnings.append(Problem(Place(self.out), "", "", found, "", Severity.WARNING))
        folder.mkdir(parents=True, exist_ok=True)
        write_json(folder / SWEEP_FILE, record)
        self.send([folder / SWEEP_FILE, *kept])
        if self.remote is not None:
            self.remote.remove([path.name.rpartition("~")[0] for path in kept])
        return warnings

    def send(self, paths: Sequence[Path]) -> list[str]:
        """Copies complete files of the folder to the remote one, if any; returns their names for the user."""
        if self.remote is None:
            return [str(path) for path in paths]
        self.remote.send({path.name: path for path in paths})
        return [url_below(self.remote.url, path.name) for path in paths]


@contextmanager
def sweep_folder(out: str) -> Iterator[SweepFolder]:
    """For the duration of a sweep. Raises InputError where files that physgen did not write are there, or OSError."""
    if not is_url(out):
        yield SweepFolder(out, Path(out))
        return
    remote = open_folder(out)
    existing = {SWEEP_FILE, *TABLES} & set(remote.top())
    with temporary_folder() as folder:
        if SWEEP_FILE in existing:
            remote.fetch(SWEEP_FILE, folder / SWEEP_FILE, MAX_FILE_BYTES)
        if existing and read_sweep_record(folder) is None:
            raise InputError.of(url_below(out, min(existing)), "", NOT_OURS, NOT_OURS_FIX)
        yield SweepFolder(out, folder, remote)
