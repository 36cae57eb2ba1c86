"""Result of a measure, and its form as terminal text, JSON and a page.

A measure returns one `Findings`: sentences, tables, bars, and the same as data. Numbers
in tables are texts; `rows` has all digits. An unknown value is "-" in tables and None
in data, never NaN.
"""

from __future__ import annotations

import json
import shlex
import textwrap
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from physgen import __version__
from physgen.files import back_up, check_writable, write_atomic
from physgen.report.html import template

Progress = Callable[[str, int, int], None]
"""Stage, completed steps, all steps."""
PAGE, RESULT = "index.html", "result.json"
COLUMNS = 100
"""Maximum width of a sentence in a terminal, characters."""


@dataclass(frozen=True)
class Table:
    """Rows of texts under their heads."""

    heads: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    title: str = ""
    note: str = ""

    @property
    def numeric(self) -> list[bool]:
        """Return for each column whether all cells are numbers, which are aligned
        right.
        """
        columns = range(len(self.heads))
        return [all(is_numeric(row[k]) for row in self.rows) for k in columns]


@dataclass(frozen=True)
class Section:
    """A titled part of the page."""

    title: str
    sentences: tuple[str, ...] = ()
    tables: tuple[Table, ...] = ()


@dataclass(frozen=True)
class Bar:
    """A limit for a value."""

    label: str
    value: str
    limit: str
    is_met: bool

    def __str__(self) -> str:
        verdict = "MISSED"
        if self.is_met:
            verdict = "met"
        return f"{self.label}: {self.value}, the bar is {self.limit}: {verdict}"

    def as_dict(self) -> dict[str, Any]:
        """Return the bar for JSON."""
        return {
            "what": self.label,
            "found": self.value,
            "bar": self.limit,
            "passed": self.is_met,
        }


@dataclass(frozen=True)
class Findings:
    """Result of one measure."""

    measure: str
    """Name on the command line."""
    title: str
    sentences: tuple[str, ...]
    """The most important first."""
    sections: tuple[Section, ...]
    rows: Sequence[Mapping[str, Any]]
    """Data for JSON: numbers with all digits, None for an unknown value."""
    bars: tuple[Bar, ...] = ()
    extra: Mapping[str, Any] = field(default_factory=dict)
    """Further JSON beside `rows`: settings, totals, versions."""

    @property
    def has_passed(self) -> bool:
        """Return whether all bars are met."""
        return all(bar.is_met for bar in self.bars)

    def as_dict(self) -> dict[str, Any]:
        """Return the findings for JSON."""
        return {
            "measure": self.measure,
            **self.extra,
            "rows": list(self.rows),
            "bars": [bar.as_dict() for bar in self.bars],
            "passed": self.has_passed,
        }


def as_json(findings: Findings) -> str:
    """Return the output of `--json`. Raise ValueError for an infinite number."""
    text = json.dumps(
        findings.as_dict(),
        indent=1,
        ensure_ascii=False,
        allow_nan=False,
        default=str,
    )
    return text + "\n"


def text(findings: Findings) -> str:
    """Return the output for a terminal."""
    lines = [findings.title, "", *_wrap(findings.sentences)]
    for section in findings.sections:
        lines += ["", section.title, *_wrap(section.sentences)]
        for table in section.tables:
            lines.append("")
            if table.title:
                lines.append(table.title)
            lines += columns(table)
            lines += _wrap([table.note])
    if findings.bars:
        lines += ["", *map(str, findings.bars)]
    return "\n".join(lines) + "\n"


def columns(table: Table) -> list[str]:
    """Return the lines of a table with equal widths: words on the left, numbers on the
    right.
    """
    rows = [table.heads, *table.rows]
    widths = []
    for k in range(len(table.heads)):
        widths.append(max(len(row[k]) for row in rows))
    head, *lines = [_align(row, widths, table.numeric) for row in rows]
    rule = "  ".join("-" * width for width in widths)
    return [head, rule, *lines]


def _align(row: Sequence[str], widths: Sequence[int], numeric: Sequence[bool]) -> str:
    """Return the line of a row."""
    cells = []
    for cell, width, is_number in zip(row, widths, numeric, strict=True):
        cells.append(cell.rjust(width) if is_number else cell.ljust(width))
    return "  ".join(cells).rstrip()


def is_numeric(cell: str) -> bool:
    """Return whether a cell is a number, a share, an interval, or empty.

    >>> is_numeric("105.7"), is_numeric("-"), is_numeric("12 of 13"), is_numeric("[3.1, 4.5]"), is_numeric("ball")
    (True, True, True, True, False)
    """
    return cell in ("", "-") or cell.lstrip("+-<>≈[±")[:1].isdigit()


def number(value: float | None, form: str = ".2f") -> str:
    """Return a cell; "-" for None.

    >>> number(0.83333, ".3f"), number(None)
    ('0.833', '-')
    """
    if value is None:
        return "-"
    return f"{value:{form}}"


def interval(low: float | None, high: float | None) -> str:
    """Return `[low, high]`, or "-"."""
    if low is None or high is None:
        return "-"
    return f"[{low:.2f}, {high:.2f}]"


def _wrap(sentences: Sequence[str]) -> list[str]:
    lines = []
    for sentence in sentences:
        lines += textwrap.wrap(sentence, COLUMNS)
    return lines


# ---- the page


def check_folder(folder: Path | None) -> None:
    """Raise InputError if no page can be written."""
    if folder is not None:
        check_writable(folder)


def write_page(
    findings: Findings,
    folder: Path,
    command: Sequence[str],
    report_backup: Callable[[Path], None] = lambda backup: None,
) -> Path:
    """Write `index.html` and `result.json` over those of an earlier run, and return the page's path.

    A page of another origin is moved to `index.html~`, and `report_backup` is called with that path.
    """
    check_folder(folder)
    folder.mkdir(parents=True, exist_ok=True)
    if (folder / PAGE).exists() and not (folder / RESULT).exists():
        back_up(folder / PAGE, report_backup)
    write_atomic(folder / PAGE, html(findings, command).encode())
    write_atomic(folder / RESULT, as_json(findings).encode())
    return folder / PAGE


def html(findings: Findings, command: Sequence[str]) -> str:
    """Return the page; it loads nothing from a network."""
    page: str = template("findings.html.j2").render(
        title=findings.title,
        measure=findings.measure,
        sentences=findings.sentences,
        bars=findings.bars,
        sections=findings.sections,
        command=shlex.join(command),
        version=__version__,
    )
    return page
