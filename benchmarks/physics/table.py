"""Results of the closed forms -> their table in docs/accuracy.md."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from layout import table

from physgen.evaluate.physics.scorecard import quantity

ENGINES = ("box2d", "mujoco")
"""Shown beside ours; `plain` (Chipmunk alone) and the convergence with the steps are in the JSON."""


def lines(rows: Sequence[dict[str, Any]]) -> list[str]:
    """Errors beside their bars and two other engines."""
    body = [
        [
            row["row"],
            row["title"],
            row["closed_form"],
            _cell(row, lambda one, row=row: _name(row, one) + _bar(one)),
            _cell(
                row,
                lambda one: (
                    quantity(one["error"], one["unit"])
                    + ("" if one["passed"] else " **missed**")
                ),
            ),
            *(
                _cell(row, lambda one, name=name: _engine(one, name))
                for name in ENGINES
            ),
        ]
        for row in rows
    ]
    return table(["#", "test", "closed form", "bar", "physgen", *ENGINES], body)


def _cell(row: dict[str, Any], each: Callable[[dict[str, Any]], str]) -> str:
    return "<br>".join(map(each, row["measures"]))


def _name(row: dict[str, Any], measure: dict[str, Any]) -> str:
    """The measure's name, where a row has several."""
    return f"{measure['name']}: " if len(row["measures"]) > 1 else ""


def _bar(measure: dict[str, Any]) -> str:
    return (
        "as stated"
        if measure["unit"] == "switch"
        else quantity(measure["bar"], measure["unit"])
    )


def _engine(measure: dict[str, Any], name: str) -> str:
    """An engine's error; empty where it was not run."""
    found = measure.get("rivals", {})
    if name not in found:
        return ""
    return "-" if found[name] is None else quantity(found[name], measure["unit"])
