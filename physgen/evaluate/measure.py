"""Result of a measure, and its form as terminal text, JSON and a page.

A measure returns one `Findings`: sentences, tables, the bars to be met, and the same as data. Numbers in
tables are texts; `rows` holds them in full. What is not known is "-" in tables and None in data, never NaN.
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
"""Stage, steps done, steps in all."""
PAGE, RESULT = "index.html", "result.json"
COLUMNS = 100
"""Of a terminal that a sentence may take."""


@dataclass(frozen=True)
class Table:
    """Rows of texts under their heads."""

    heads: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    title: str = ""
    note: str = ""

    @property
    def numeric(self) -> list[bool]:
        """By column: whether all cells are numbers, which belong to the right."""
        return [
            all(numeric(row[k]) for row in self.rows) for k in range(len(self.heads))
        ]


@dataclass(frozen=True)
class Section:
    """A titled part of the page."""

    title: str
    sentences: tuple[str, ...] = ()
    tables: tuple[Table, ...] = ()


@dataclass(frozen=True)
class Bar:
    """A value to be reached, and whether it was."""

    what: str
    found: str
    bar: str
    met: bool

    def __str__(self) -> str:
        return f"{self.what}: {self.found}, the bar is {self.bar}: {'met' if self.met else 'MISSED'}"


@dataclass(frozen=True)
class Findings:
    """Result of one measure."""

    measure: str  # its name on the command line
    title: str
    sentences: tuple[str, ...]  # the most important first
    sections: tuple[Section, ...]
    rows: Sequence[
        Mapping[str, Any]
    ]  # as JSON: numbers in full, None where nothing is known
    bars: tuple[Bar, ...] = ()
    more: Mapping[str, Any] = field(default_factory=dict)
    """Beside `rows` in the JSON: settings, totals, versions."""

    @property
    def passed(self) -> bool:
        return all(bar.met for bar in self.bars)

    def as_dict(self) -> dict[str, Any]:
        """As data."""
        bars = [
            {"what": b.what, "found": b.found, "bar": b.bar, "passed": b.met}
            for b in self.bars
        ]
        rows = {"rows": list(self.rows), "bars": bars, "passed": self.passed}
        return {"measure": self.measure, **self.more, **rows}


def as_json(findings: Findings) -> str:
    """What `--json` prints. Raises ValueError for a number that is not finite."""
    return (
        json.dumps(
            findings.as_dict(),
            indent=1,
            ensure_ascii=False,
            allow_nan=False,
            default=str,
        )
        + "\n"
    )


def text(findings: Findings) -> str:
    """For a terminal."""
    lines = [findings.title, "", *_wrapped(findings.sentences)]
    for section in findings.sections:
        lines += ["", section.title, *_wrapped(section.sentences)]
        for table in section.tables:
            lines += [
                "",
                *([table.title] if table.title else []),
                *columns(table),
                *_wrapped([table.note]),
            ]
    if findings.bars:
        lines += ["", *map(str, findings.bars)]
    return "\n".join(lines) + "\n"


def columns(table: Table) -> list[str]:
    """Lines of one width: words to the left, numbers to the right."""
    lines = [table.heads, *table.rows]
    widths = [max(len(line[k]) for line in lines) for k in range(len(table.heads))]
    aligned = [
        "  ".join(
            cell.rjust(wide) if right else cell.ljust(wide)
            for cell, wide, right in zip(line, widths, table.numeric, strict=True)
        ).rstrip()
        for line in lines
    ]
    return [aligned[0], "  ".join("-" * wide for wide in widths), *aligned[1:]]


def numeric(cell: str) -> bool:
    """Whether a cell is a number, a share, an interval, or empty.

    >>> numeric("105.7"), numeric("-"), numeric("12 of 13"), numeric("[3.1, 4.5]"), numeric("billiard ball")
    (True, True, True, True, False)
    """
    return cell in ("", "-") or cell.lstrip("+-<>≈[±")[:1].isdigit()


def number(value: float | None, form: str = ".2f") -> str:
    """A cell; "-" for None.

    >>> number(0.83333, ".3f"), number(None)
    ('0.833', '-')
    """
    return "-" if value is None else f"{value:{form}}"


def interval(low: float | None, high: float | None) -> str:
    """`[low, high]`, or "-"."""
    return "-" if low is None or high is None else f"[{low:.2f}, {high:.2f}]"


def _wrapped(sentences: Sequence[str]) -> list[str]:
    return [line for sentence in sentences for line in textwrap.wrap(sentence, COLUMNS)]


# ---- the page ----------------------------------------------------------------------------------------------------


def check_folder(folder: Path | None) -> None:
    """Raises InputError where no page can be written."""
    if folder is not None:
        check_writable(folder)


def write_page(
    findings: Findings,
    folder: Path,
    command: Sequence[str],
    keep: Callable[[Path], None] = lambda kept: None,
) -> Path:
    """`index.html` and `result.json`; those of an earlier run are replaced.

    A page of another origin is set aside as `index.html~`, and `keep` is called with it. Returns the page's path.
    """
    check_folder(folder)
    folder.mkdir(parents=True, exist_ok=True)
    if (folder / PAGE).exists() and not (folder / RESULT).exists():
        back_up(folder / PAGE, keep)
    write_atomic(folder / PAGE, html(findings, command).encode())
    write_atomic(folder / RESULT, as_json(findings).encode())
    return folder / PAGE


def html(findings: Findings, command: Sequence[str]) -> str:
    """The page; it loads nothing from a network."""
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
