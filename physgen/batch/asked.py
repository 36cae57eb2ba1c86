"""A sweep -> `sweep.json` in its folder: all that is needed to make it again; and back."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from physgen.batch.axes import Listed, read_axes
from physgen.batch.columns import Column, Kind
from physgen.batch.sweep import Design, Sweep
from physgen.problems import InputError, Place, Problem, Severity
from physgen.report.record import file_hash, versions, write_json
from physgen.report.swept import unit
from physgen.scene.words import KeyPath
from physgen.simulate.settled import LASTING, START, STILL, STILL_TURN
from physgen.urls import is_url
from physgen.whole import set_aside

NAME = "sweep.json"
TABLES = ("sweep.csv", "sweep.parquet")
MOST_COMPARED = 1000
"""Rows of the table that is there, that are looked for in the new one."""
FILES_OF_OURS = (NAME, *TABLES)
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


def asked(sweep: Sweep, scene: str, at_hand: Path, out: str, **told: Any) -> dict[str, Any]:
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
        **core(sweep),
        **told,
        "versions": versions(),
        "rest": {"px/s": STILL, "degrees/s": STILL_TURN, "lasting s": LASTING},
        "start s": START,
    }


def core(sweep: Sweep) -> dict[str, Any]:
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


def read_asked(folder: Path) -> dict[str, Any] | None:
    """What a folder's `sweep.json` tells; None where there is none of ours."""
    if not (folder / NAME).is_file():
        return None
    try:
        told = json.loads((folder / NAME).read_text(encoding="utf-8"))
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


def begun(
    folder: Path,
    told: Mapping[str, Any],
    sweep: Sweep,
    bring: Callable[[Sequence[str]], None] = lambda names: None,
) -> Begun:
    """Writes `sweep.json`; warns that other clips lie there, too. Raises InputError.

    Nothing of the user's is written over: a `sweep.json` or table that is not ours is refused, and a table of ours with
    rows that the new one will not have is kept as `NAME~`; `bring` fetches it where the folder stands for another.
    """
    before = read_asked(folder)
    if folder.exists() and not folder.is_dir():
        raise InputError.of("-o", f'"{folder}"', "is a file", "name a folder")
    there = [] if before is not None else [name for name in FILES_OF_OURS if (folder / name).exists()]
    if there:
        fix = "move it away, or choose another folder with -o"
        raise InputError.of(str(folder / there[0]), "", "is there already and was not made by physgen", fix)
    warnings = []
    changed = before is not None and any(before.get(key) != value for key, value in core(sweep).items())
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
            set_aside(folder / name, kept.append)
    folder.mkdir(parents=True, exist_ok=True)
    write_json(folder / NAME, told)
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
