"""The scorecard's JSON -> a table for the terminal, or a page in Markdown."""

from __future__ import annotations

import textwrap
from collections.abc import Mapping, Sequence
from typing import Any

Record = Mapping[str, Any]

WHAT, FORM = 30, 42
"""Columns of a terminal for what a row is and for its closed form."""


def quantity(value: float | None, unit: str) -> str:
    """An error or a bar as a reader wants it: percent, pixels, degrees, or whether it is as it must be.

    >>> quantity(0.00123, "part"), quantity(3e-12, "part"), quantity(0.5, "px"), quantity(1.0, "switch")
    ('0.12 %', '< 1e-6 %', '0.5 px', 'no')
    """
    if value is None:
        return "none"
    if unit == "switch":
        return "no" if value else "yes"
    number, sign = (value * 100, "%") if unit == "part" else (value, unit)
    if number and abs(number) < 1e-6:
        return f"< 1e-6 {sign}"
    return f"{number:.2g} {sign}" if abs(number) < 100 else f"{number:.0f} {sign}"


def _bar(measure: Record) -> str:
    return "as stated" if measure["unit"] == "switch" else quantity(measure["bar"], measure["unit"])


def _name(row: Record, measure: Record) -> str:
    """The measure's name, where a row has several."""
    return f"{measure['name']}: " if len(row["measures"]) > 1 else ""


def _steps(rows: Sequence[Record]) -> list[str]:
    """Steps a second that any row was run at, as JSON has them."""
    found = {steps for row in rows for measure in row["measures"] for steps in measure["convergence"]}
    return sorted(found, key=float)


def _rivals(rows: Sequence[Record]) -> list[str]:
    """Engines that any row was also run on."""
    return list(dict.fromkeys(name for row in rows for m in row["measures"] for name in m.get("rivals", {})))


def text(result: Record) -> str:
    """Aligned columns, a line a measure, what cannot be run said below; ends with the count of rows that pass."""
    rows = result["rows"]
    steps = _steps(rows)
    lines: list[list[str]] = [
        ["row", "what", "closed form", "bar", "worst error", "verdict", *(f"at {s}/s" for s in steps)]
    ]
    for row in rows:
        what = textwrap.wrap(row["title"], WHAT)
        form = textwrap.wrap(row["closed_form"], FORM)
        for k in range(max(len(what), len(form), len(row["measures"]))):
            cells = [
                str(row["row"]) if k == 0 else "",
                what[k] if k < len(what) else "",
                form[k] if k < len(form) else "",
            ]
            if k < len(row["measures"]):
                measure = row["measures"][k]
                unit = measure["unit"]
                cells += [
                    _name(row, measure) + _bar(measure),
                    quantity(measure["error"], unit),
                    "pass" if measure["passed"] else "FAIL",
                    *(
                        quantity(measure["convergence"][s], unit) if s in measure["convergence"] else ""
                        for s in steps
                    ),
                ]
            lines.append(cells)
    wide = [max(len(cells[k]) for cells in lines if k < len(cells)) for k in range(len(lines[0]))]
    shown = ["  ".join(cell.ljust(wide[k]) for k, cell in enumerate(cells)).rstrip() for cells in lines]
    shown += [f"row {row['row']}: {problem}" for row in rows for problem in row["problems"]]
    passed = sum(row["passed"] for row in rows)
    return "\n".join([*shown, f"{passed} of {len(rows)} rows pass"]) + "\n"


def markdown(result: Record) -> str:
    """Two tables: errors with their convergence (and rivals where measured), and what is drawn and why the bar."""
    rows = result["rows"]
    steps, rivals = _steps(rows), _rivals(rows)
    head = ["#", "test", "closed form", "bar", "error", *(f"{s}/s" for s in steps), *rivals]
    body = []
    for row in rows:
        measures = row["measures"]

        def each(cell: Any, row: Record = row, measures: Sequence[Record] = measures) -> str:
            return "<br>".join(_name(row, measure) + cell(measure) for measure in measures)

        def plain(cell: Any, measures: Sequence[Record] = measures) -> str:
            return "<br>".join(cell(measure) for measure in measures)

        body.append(
            [
                "<br>".join(
                    f"[{_part(row, k)}](../scenes/physics/{name})" for k, name in enumerate(row["scenes"])
                ),
                row["title"],
                row["closed_form"],
                each(_bar),
                plain(lambda m: quantity(m["error"], m["unit"]) + ("" if m["passed"] else " **misses**")),
                *(
                    plain(
                        lambda m, s=s: (
                            quantity(m["convergence"][s], m["unit"]) if s in m["convergence"] else ""
                        )
                    )
                    for s in steps
                ),
                *(plain(lambda m, n=n: _rival(m, n)) for n in rivals),
            ]
        )
    passed = sum(row["passed"] for row in rows)
    about = [[str(row["row"]), row["draws"], row["why"]] for row in rows]
    return "\n".join(
        [
            *_table(head, body), "",
            f"{passed} of {len(rows)} rows pass.", "",
            "## What is drawn, and why the bar is where it is", "",
            *_table(["#", "draws", "measure and bar"], about),
        ]
    ) + "\n"  # fmt: skip


def _part(row: Record, k: int) -> str:
    """`21` for a row's first scene, `21b` for its second."""
    return str(row["row"]) + "abcdefgh"[k] * (k > 0)


def _rival(measure: Record, name: str) -> str:
    """A rival's error; a dash for what it cannot do, nothing where it was not run."""
    found = measure.get("rivals", {})
    if name not in found:
        return ""
    return "-" if found[name] is None else quantity(found[name], measure["unit"])


def _table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> list[str]:
    lines = [head, ["---"] * len(head), *rows]
    return ["| " + " | ".join(cell.replace("|", "\\|") for cell in line) + " |" for line in lines]
