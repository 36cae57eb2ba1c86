"""What a measure found -> text for a terminal, Markdown, and JSON; `page` makes a page of it.

A measure of the paper gives one `Findings`: sentences, tables, figures, the bars that it must reach, and the same as
data. Numbers in tables are texts, as a reader wants them; `rows` has them in full. What is
not known is "-", never NaN.
"""

from __future__ import annotations

import textwrap
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from math import isfinite
from typing import Any

WIDE = 100
"""Columns of a terminal that a sentence may take."""


@dataclass(frozen=True)
class Table:
    """Rows of texts under their heads."""

    heads: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    title: str = ""
    note: str = ""
    """A sentence below it."""


@dataclass(frozen=True)
class Figure:
    """A plot or picture, for the page alone."""

    picture: str | bytes
    """SVG as text, or PNG or JPEG as bytes."""
    about: str
    """What is seen: the caption, and what stands for it where it cannot be seen."""


@dataclass(frozen=True)
class Section:
    """A part of the page, with a title of its own."""

    title: str
    sentences: tuple[str, ...] = ()
    parts: tuple[Table | Figure, ...] = ()


@dataclass(frozen=True)
class Bar:
    """What must be reached, and whether it was."""

    what: str
    found: str
    bar: str
    met: bool

    def __str__(self) -> str:
        return f"{self.what}: {self.found}, the bar is {self.bar}: {'met' if self.met else 'MISSED'}"


@dataclass(frozen=True)
class Findings:
    """Of one measure."""

    measure: str
    """Its name on the command line."""
    title: str
    sentences: tuple[str, ...]
    """What was found, the most important first."""
    sections: tuple[Section, ...]
    rows: Sequence[Mapping[str, Any]]
    """As JSON: numbers in full, None where nothing is known."""
    bars: tuple[Bar, ...] = ()
    more: Mapping[str, Any] = field(default_factory=dict)
    """Beside `rows` in the JSON: settings, totals, versions."""

    @property
    def passed(self) -> bool:
        """Whether every bar was reached."""
        return all(bar.met for bar in self.bars)

    def as_dict(self) -> dict[str, Any]:
        """What `--json` prints. Raises ValueError where a number is none: that is never a result."""
        bars = [{"what": b.what, "found": b.found, "bar": b.bar, "passed": b.met} for b in self.bars]
        record = {
            "measure": self.measure,
            **self.more,
            "rows": list(self.rows),
            "bars": bars,
            "passed": self.passed,
        }
        _check_numbers(record, self.measure)
        return record


def text(findings: Findings) -> str:
    """For a terminal."""
    lines = [findings.title, "", *_wrapped(findings.sentences)]
    for section in findings.sections:
        lines += ["", section.title, *_wrapped(section.sentences)]
        for part in section.parts:
            if isinstance(part, Table):
                lines += ["", *([part.title] if part.title else []), *columns(part), *_wrapped([part.note])]
    if findings.bars:
        lines += ["", *map(str, findings.bars)]
    return "\n".join(lines) + "\n"


def markdown(findings: Findings) -> str:
    """As a page of the docs."""
    lines = [f"# {findings.title}", "", *findings.sentences, ""]
    for section in findings.sections:
        lines += [f"## {section.title}", "", *section.sentences, *([""] if section.sentences else [])]
        for part in section.parts:
            if isinstance(part, Table):
                lines += [f"**{part.title}**", ""] if part.title else []
                lines += [_row(part.heads), "|".join(["", *("---" for _ in part.heads), ""])]
                lines += [*map(_row, part.rows), "", *([part.note, ""] if part.note else [])]
    lines += [f"- {bar}" for bar in findings.bars]
    return "\n".join(lines).rstrip() + "\n"


def columns(table: Table) -> list[str]:
    """A table in letters of one width: words to the left, numbers to the right."""
    lines = [table.heads, *table.rows]
    widths = [max(len(line[k]) for line in lines) for k in range(len(table.heads))]
    right = [all(numeric(row[k]) for row in table.rows) for k in range(len(widths))]
    told = [
        "  ".join(
            cell.rjust(wide) if to_right else cell.ljust(wide)
            for cell, wide, to_right in zip(line, widths, right, strict=True)
        ).rstrip()
        for line in lines
    ]
    return [told[0], "  ".join("-" * wide for wide in widths), *told[1:]]


def numeric(cell: str) -> bool:
    """Whether a cell belongs to the right: a number, a share, an interval, or nothing known.

    >>> numeric("105.7"), numeric("-"), numeric("12 of 13"), numeric("[3.1, 4.5]"), numeric("billiard ball")
    (True, True, True, True, False)
    """
    return cell in ("", "-") or cell.lstrip("+-<>≈[±")[:1].isdigit()


def _wrapped(sentences: Sequence[str]) -> list[str]:
    return [line for sentence in sentences for line in textwrap.wrap(sentence, WIDE)]


def _row(cells: Sequence[str]) -> str:
    return "|".join(["", *(f" {cell} ".replace("|", "\\|") for cell in cells), ""])


def _check_numbers(value: Any, where: str) -> None:
    if isinstance(value, Mapping):
        for key, part in value.items():
            _check_numbers(part, f"{where}.{key}")
    elif isinstance(value, (list, tuple)):
        for k, part in enumerate(value):
            _check_numbers(part, f"{where}[{k}]")
    elif isinstance(value, float) and not isfinite(value):
        raise ValueError(f"{where} is {value}: no result")
