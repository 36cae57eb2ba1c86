"""A sweep -> `sweep.json` in its folder: all that is needed to make it again; and back."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from physgen.batch.axes import Listed, read_axes
from physgen.batch.columns import Column, Kind
from physgen.batch.sweep import Design, Sweep
from physgen.problems import InputError, Place, Problem, Severity
from physgen.report.record import file_hash, versions, write_json
from physgen.report.swept import unit
from physgen.scene.words import Path as Keys
from physgen.simulate.settled import LASTING, START, STILL, STILL_TURN

NAME = "sweep.json"
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


def _way(path: Keys) -> tuple[str | int, ...]:
    """With numbers for what is counted: `velocity.0` is spelt so, too."""
    return tuple(int(part) if str(part).isdecimal() else part for part in path)


def asked(sweep: Sweep, scene: Path, folder: Path, **told: Any) -> dict[str, Any]:
    """As JSON data; `told` is what else was said: overrides, formats, the command."""
    return {
        "sweep": 1,
        "scene": Path(os.path.relpath(scene.resolve(), folder.resolve())).as_posix(),
        "sha256": file_hash(scene),
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
    try:
        told = json.loads((folder / NAME).read_text(encoding="utf-8"))
        return told if told["sweep"] == 1 else None
    except (OSError, ValueError, KeyError, TypeError):
        return None


def sweep_of(told: Mapping[str, Any]) -> Sweep:
    """The sweep that a `sweep.json` tells of; raises KeyError, TypeError, ValueError or InputError otherwise."""
    axes = read_axes([f"{axis['key']}={axis['values']}" for axis in told["axes"]])
    return Sweep(axes, tuple(told["variants"]), told["samples"], told["seed"], Design(told["design"]))


def begun(folder: Path, told: Mapping[str, Any], sweep: Sweep) -> list[Problem]:
    """Writes `sweep.json`; the warning that clips of another sweep lie there, too. Raises InputError.

    Nothing of the user's is written over: a `sweep.json` or table that is not ours is refused.
    """
    before = read_asked(folder)
    if folder.exists() and not folder.is_dir():
        raise InputError.of("-o", f'"{folder}"', "is a file", "name a folder")
    for name in (NAME, "sweep.csv", "sweep.parquet"):
        if before is None and (folder / name).exists():
            fix = "move it away, or choose another folder with -o"
            raise InputError.of(str(folder / name), "", "is there already and was not made by physgen", fix)
    warnings = []
    if before is not None and any(before.get(key) != value for key, value in core(sweep).items()):
        strange = [
            p.name for p in folder.iterdir() if (p / "manifest.json").is_file() and not sweep.find(p.name)
        ]
        if strange:
            many = f"{len(strange)} clip{'s' * (len(strange) != 1)}"
            found = f"holds {many} of another sweep, {sorted(strange)[0]} among them"
            fix = "they stay, and the gallery shows them; another -o keeps sweeps apart"
            warnings.append(Problem(Place(str(folder)), "", "", found, fix, Severity.WARNING))
    folder.mkdir(parents=True, exist_ok=True)
    write_json(folder / NAME, told)
    return warnings
