"""The files of a sweep: sweep.json, rows of the table, and a local staging folder for remote output."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from physgen.batch.axes import Listed, read_axes
from physgen.batch.remote import RemoteFolder, is_url, open_folder, url_below
from physgen.batch.run import Done, own_folder
from physgen.batch.sweep import Design, Point, Sweep
from physgen.batch.values import cell
from physgen.files import back_up
from physgen.problems import InputError, Place, Problem, Severity
from physgen.report.record import file_hash, versions, write_json
from physgen.report.sweep_keys import unit
from physgen.simulate.trajectory import REST_DURATION, REST_SPEED, REST_TURN, START_TIME
from physgen.tables import Cell, Column, Kind
from physgen.text import KeyPath

# ----------------------------------------------------------------------
# A sweep -> `sweep.json` in its folder: all that is needed to make it again; and back.

SWEEP_FILE = "sweep.json"
TABLES = ("sweep.csv", "sweep.parquet")
MOST_COMPARED = 1000
"""Rows of the table that is there, that are looked for in the new one."""
FILES_OF_OURS = (SWEEP_FILE, *TABLES)
LEAD = (
    Column("number", Kind.WHOLE),
    Column("name", Kind.TEXT),
    Column("variant", Kind.TEXT),
    Column("folder", Kind.TEXT),
)
STATE = (Column("state", Kind.TEXT), Column("error", Kind.TEXT))
FILES = (Column("video", Kind.TEXT), Column("manifest", Kind.TEXT))


def all_columns(sweep: Sweep, outcomes: Sequence[Column]) -> tuple[Column, ...]:
    """Of the table: which clip, what it was set to, whether it was made, what became of it, where it is."""
    keys = (Column(axis.key, axis.kind, unit(_way(axis.path))) for axis in sweep.axes)
    return (*LEAD, *keys, *STATE, *outcomes, *FILES)


def _way(path: KeyPath) -> tuple[str | int, ...]:
    """With numbers for what is counted: `velocity.0` is spelt so, too."""
    return tuple(int(part) if str(part).isdecimal() else part for part in path)


def sweep_record(sweep: Sweep, scene: str, at_hand: Path, out: str, **told: Any) -> dict[str, Any]:
    """As JSON data; `told` is what else was said: overrides, formats, the command.

    `scene` and `out` are as the user names them, `at_hand` is where the scene's file can be read.
    """
    where = os.path.abspath(scene) if is_url(out) and not is_url(scene) else scene
    if not is_url(where) and not is_url(out):
        where = Path(os.path.relpath(Path(scene).resolve(), Path(out).resolve())).as_posix()
    return {
        "sweep": 1,
        "scene": where,
        "sha256": file_hash(at_hand),
        "clips": len(sweep),
        **sweep_settings(sweep),
        **told,
        "versions": versions(),
        "rest": {"px/s": REST_SPEED, "degrees/s": REST_TURN, "lasting s": REST_DURATION},
        "start s": START_TIME,
    }


def sweep_settings(sweep: Sweep) -> dict[str, Any]:
    """What its clips follow from, but for the scene."""
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
    """What a folder's `sweep.json` tells; None where there is none of ours."""
    if not (folder / SWEEP_FILE).is_file():
        return None
    try:
        told = json.loads((folder / SWEEP_FILE).read_text(encoding="utf-8"))
        return told if told["sweep"] == 1 else None
    except (OSError, ValueError, KeyError, TypeError):
        return None


def sweep_of(told: Mapping[str, Any]) -> Sweep:
    """The sweep that a `sweep.json` tells of; raises KeyError, TypeError, ValueError or InputError otherwise."""
    axes = read_axes([f"{axis['key']}={axis['values']}" for axis in told["axes"]])
    return Sweep(axes, tuple(told["variants"]), told["samples"], told["seed"], Design(told["design"]))


@dataclass(frozen=True)
class Begun:
    """What the folder held before."""

    warnings: Sequence[Problem] = ()
    kept: Sequence[Path] = ()
    """Tables of another sweep, under the names that they have now."""


def begin(
    folder: Path,
    told: Mapping[str, Any],
    sweep: Sweep,
    bring: Callable[[Sequence[str]], None] = lambda names: None,
) -> Begun:
    """Writes `sweep.json`; warns that other clips lie there, too. Raises InputError.

    Nothing of the user's is written over: a `sweep.json` or table that is not ours is refused, and a table of ours with
    rows that the new one will not have is kept as `NAME~`; `bring` fetches it where the folder stands for another.
    """
    before = read_sweep_record(folder)
    if folder.exists() and not folder.is_dir():
        raise InputError.of("-o", f'"{folder}"', "is a file", "name a folder")
    there = [] if before is not None else [name for name in FILES_OF_OURS if (folder / name).exists()]
    if there:
        fix = "move it away, or choose another folder with -o"
        raise InputError.of(str(folder / there[0]), "", "is there already and was not made by physgen", fix)
    warnings = []
    changed = before is not None and any(
        before.get(key) != value for key, value in sweep_settings(sweep).items()
    )
    if changed or (before is None and folder.is_dir()):
        strange = [
            p.name for p in folder.iterdir() if (p / "manifest.json").is_file() and not sweep.find(p.name)
        ]
        if strange:
            many = f"{len(strange)} clip{'s' * (len(strange) != 1)}"
            whose = "of another sweep" if changed else "of no sweep"
            found = f"holds {many} {whose}, {sorted(strange)[0]} among them"
            fix = "they stay, and the gallery shows them; another -o keeps them apart"
            warnings.append(Problem(Place(str(folder)), "", "", found, fix, Severity.WARNING))
    kept: list[Path] = []
    if before is not None and changed and not _goes_on(before, sweep):
        bring(TABLES)
        for name in TABLES:
            back_up(folder / name, kept.append)
    folder.mkdir(parents=True, exist_ok=True)
    write_json(folder / SWEEP_FILE, told)
    return Begun(warnings, kept)


def _goes_on(before: Mapping[str, Any], sweep: Sweep) -> bool:
    """Whether all rows of the table that is there are in the new one, too: of the first ones and the last."""
    try:
        old = sweep_of(before)
    except (KeyError, TypeError, ValueError, InputError):
        return False
    some = {*range(min(len(old), MOST_COMPARED)), len(old) - 1}
    pairs = ((point, sweep.find(point.name)) for point in map(old.__getitem__, sorted(some)))
    return all(now is not None and now.overrides == point.overrides for point, now in pairs)


# ----------------------------------------------------------------------
# A clip of a sweep and how it ended -> its row of the table.


def row(sweep: Sweep, point: Point, done: Done) -> dict[str, Cell]:
    """By the columns' names; paths start at the sweep's folder."""
    cells: dict[str, Cell] = {"number": point.number, "name": point.name, "variant": point.variant or ""}
    for axis, value in zip(sweep.axes, point.values, strict=True):
        cells[axis.key] = cell(value, axis.kind)
    if done.folder is None:
        errors = (str(problem) for problem in done.problems if problem.severity is Severity.ERROR)
        return cells | {"state": "failed", "error": " | ".join(errors)}
    files: dict[str, Cell] = {
        "folder": point.name,
        "video": f"{point.name}/{done.job.formats[0].file}",
        "manifest": f"{point.name}/manifest.json",
    }
    return cells | {"state": "done"} | files | dict(done.outcomes or {})


# ----------------------------------------------------------------------
# A folder, here or behind a URL -> a folder of this machine in which a sweep's own files are written.

MOST_TABLE_BYTES = 1_000_000_000
"""Bytes of a `sweep.json`, or of a table."""


@dataclass(frozen=True)
class StagingFolder:
    """Where files are written, and where they belong."""

    folder: Path
    there: RemoteFolder | None = None
    """None: they are where they belong."""

    def bring(self, names: Sequence[str]) -> None:
        """Files that are where they belong are in the folder, too, after it. Raises OSError."""
        if self.there is not None:
            for name in names:
                self.there.fetch(name, self.folder / name, MOST_TABLE_BYTES)

    def removed(self, names: Sequence[str]) -> None:
        """Files that are no more in the folder go from where they belong."""
        if self.there is not None:
            self.there.remove(list(names))

    def sent(self, paths: Sequence[Path]) -> list[str]:
        """Files of the folder, whole, brought to where they belong; returns what they are called there."""
        if self.there is None:
            return [str(path) for path in paths]
        self.there.send({path.name: path for path in paths})
        return [url_below(self.there.url, path.name) for path in paths]


@contextmanager
def staging_folder(out: str) -> Iterator[StagingFolder]:
    """For as long as the sweep is made. Raises InputError where files of somebody else's are in the way, or OSError."""
    if not is_url(out):
        yield StagingFolder(Path(out))
        return
    there = open_folder(out)
    taken = {SWEEP_FILE, *TABLES} & set(there.top())
    with own_folder() as folder:
        if SWEEP_FILE in taken:
            there.fetch(SWEEP_FILE, folder / SWEEP_FILE, MOST_TABLE_BYTES)
        if taken and read_sweep_record(folder) is None:
            fix = "move it away, or choose another folder with -o"
            name = url_below(out, min(taken))
            raise InputError.of(name, "", "is there already and was not made by physgen", fix)
        yield StagingFolder(folder, there)
