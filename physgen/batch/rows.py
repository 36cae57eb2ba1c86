"""A clip of a sweep and how it ended -> its row of the table."""

from __future__ import annotations

from physgen.batch.columns import Cell, cell
from physgen.batch.pool import Done
from physgen.batch.sweep import Point, Sweep
from physgen.problems import Severity


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
