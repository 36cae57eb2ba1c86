"""A clip that failed -> `NAME.failed.json` beside where its folder would be, until it succeeds: for the gallery."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from physgen.problems import Problem, Severity
from physgen.report.record import write_json
from physgen.whole import write_whole

ENDING = ".failed.json"


@dataclass(frozen=True)
class Trace:
    """What was to be made, and why it was not."""

    scene: str
    """Name of the folder that it would have got."""
    path: str
    """The scene's file, as it was given."""
    variant: str | None
    overrides: tuple[str, ...]
    command: tuple[str, ...]
    problems: tuple[str, ...]
    """Errors, one line each."""
    warnings: tuple[str, ...] = ()


def trace_of(
    scene: str,
    path: str,
    variant: str | None,
    overrides: Sequence[str],
    command: Sequence[str],
    problems: Sequence[Problem],
) -> Trace:
    """Of what a run was given, and the problems that it ended with, warnings among them."""
    errors = tuple(str(p) for p in problems if p.severity is Severity.ERROR)
    warnings = tuple(str(p) for p in problems if p.severity is Severity.WARNING)
    return Trace(scene, path, variant, tuple(overrides), tuple(command), errors, warnings)


def leave(out: Path, trace: Trace, page: str) -> None:
    """Write it and its `page`, whole, in place of an earlier one; a file of somebody else's there stays as it is."""
    file = out / f"{trace.scene}{ENDING}"
    if file.exists() and trace_in(file) is None:
        return
    out.mkdir(parents=True, exist_ok=True)
    write_json(file, {"failed": 1, **vars(trace)})
    write_whole(file.with_suffix(".html"), page.encode("utf-8"))


def clear(out: Path, scene: str) -> None:
    """The clip is there: take away what an earlier failure left, if it is ours."""
    file = out / f"{scene}{ENDING}"
    if trace_in(file) is not None:
        for left in (file.with_suffix(".html"), file):
            with suppress(OSError):
                left.unlink()


def trace_in(file: Path) -> Trace | None:
    """What a file tells; None where it is none of ours."""
    try:
        told: Mapping[str, Any] = json.loads(file.read_text(encoding="utf-8"))
        if told["failed"] != 1:
            return None
        lists = {name: _texts(told[name]) for name in ("overrides", "command", "problems", "warnings")}
        variant = None if told["variant"] is None else str(told["variant"])
        return Trace(str(told["scene"]), str(told["path"]), variant, **lists)
    except (OSError, ValueError, KeyError, TypeError):
        return None


def _texts(values: Any) -> tuple[str, ...]:
    if not isinstance(values, list):
        raise TypeError
    return tuple(map(str, values))
