"""Results of the closed forms -> docs/physics.md."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from .scorecard import quantity

HEAD = """\
# Physics

Written by `python benchmarks/run.py physics` from `benchmarks/results/physics.json`; do not edit.

What physgen simulates against what is known in closed form. Each row is a scene file, run as any
other is: `python benchmarks/closed_forms.py` runs them all and exits with 1 where a bar is missed. The
parameters of a row are drawn at random five times, from fixed seeds, and the worst counts. Errors
are at default settings, 960 steps a second; the columns behind show how the error of the first draw
changes with the steps. The numbers in the first column lead to the scenes of the first draw, which
`physgen render` shows. Seen from the side unless stated; g is 980 px/s² unless drawn, e elasticity,
mu friction, I moment of inertia, R radius.

"""


def page(rows: Sequence[dict[str, Any]], machine: str) -> str:
    """Two tables: errors with their convergence and second engines; what is drawn, and the reason for the bar."""
    rates = sorted(
        {rate for row in rows for one in row["measures"] for rate in one["convergence"]}, key=float
    )
    engines = list(
        dict.fromkeys(name for row in rows for one in row["measures"] for name in one.get("rivals", {}))
    )
    heads = ["#", "test", "closed form", "bar", "error", *(f"{rate}/s" for rate in rates), *engines]
    lines = [
        [
            "<br>".join(
                f"[{row['row']}{'abcdefgh'[k] if k else ''}](../scenes/physics/{name})"
                for k, name in enumerate(row["scenes"])
            ),
            row["title"],
            row["closed_form"],
            _cell(row, lambda one, row=row: _name(row, one) + _bar(one)),
            _cell(
                row,
                lambda one: quantity(one["error"], one["unit"]) + ("" if one["passed"] else " **misses**"),
            ),
            *(_cell(row, lambda one, rate=rate: _part(one, "convergence", rate, "none")) for rate in rates),
            *(_cell(row, lambda one, name=name: _part(one, "rivals", name, "-")) for name in engines),
        ]
        for row in rows
    ]
    passed = sum(row["passed"] for row in rows)
    why = [[str(row["row"]), row["draws"], row["why"]] for row in rows]
    return "\n".join(
        [
            HEAD + table(heads, lines), "",
            f"{passed} of {len(rows)} rows pass.", "",
            "## What is drawn, and why the bar is where it is", "",
            table(["#", "draws", "measure and bar"], why), "",
            f"Measured on {machine}.", "",
        ]
    )  # fmt: skip


def _cell(row: dict[str, Any], each: Callable[[dict[str, Any]], str]) -> str:
    return "<br>".join(map(each, row["measures"]))


def _name(row: dict[str, Any], measure: dict[str, Any]) -> str:
    """The measure's name, where a row has several."""
    return f"{measure['name']}: " if len(row["measures"]) > 1 else ""


def _bar(measure: dict[str, Any]) -> str:
    return "as stated" if measure["unit"] == "switch" else quantity(measure["bar"], measure["unit"])


def _part(measure: dict[str, Any], group: str, key: str, none: str) -> str:
    """An error at a rate or of an engine; empty where it was not run."""
    found = measure.get(group, {})
    if key not in found:
        return ""
    return none if found[key] is None else quantity(found[key], measure["unit"])


def table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join("| " + " | ".join(cell.replace("|", "\\|") for cell in line) + " |" for line in lines)
