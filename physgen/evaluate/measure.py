"""Result of a measure, and its form as terminal text, Markdown, JSON and a page with plots.

A measure returns one `Findings`: sentences, tables, figures, the bars to be met, and the same as data. Numbers in
tables are texts; `rows` holds them in full. What is not known is "-" in tables and None in data, never NaN.
"""

from __future__ import annotations

import base64
import json
import shlex
import textwrap
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen import __version__
from physgen.files import back_up, write_atomic
from physgen.problems import InputError
from physgen.report.html import template
from physgen.report.plot_style import (
    DPI,
    MM,
    PALETTE,
    Palette,
    add_axes,
    figure_bytes,
    new_figure,
    plot_settings,
    require_matplotlib,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes


Progress = Callable[[str, int, int], None]
"""Stage, steps done, steps in all."""
PAGE, RESULT = "index.html", "result.json"


@dataclass(frozen=True)
class Look:
    """Of results in a terminal and on a page."""

    columns: int = 100
    """Of a terminal that a sentence may take."""
    quality: int = 88
    """JPEG quality of pictures in a page."""
    margins: tuple[float, float, float, float] = (15.0, 4.0, 11.0, 4.0)
    """mm around the axes of a plot: left, right, below, above."""


LOOK = Look()


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
        return [all(numeric(row[k]) for row in self.rows) for k in range(len(self.heads))]


@dataclass(frozen=True)
class Figure:
    """A plot or picture, for the page alone."""

    picture: str | bytes
    """SVG as text, or PNG or JPEG as bytes."""
    about: str
    """Caption and alternative text."""


@dataclass(frozen=True)
class Section:
    """A titled part of the page."""

    title: str
    sentences: tuple[str, ...] = ()
    parts: tuple[Table | Figure, ...] = ()


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

    measure: str
    """Its name on the command line."""
    title: str
    sentences: tuple[str, ...]
    """The most important first."""
    sections: tuple[Section, ...]
    rows: Sequence[Mapping[str, Any]]
    """As JSON: numbers in full, None where nothing is known."""
    bars: tuple[Bar, ...] = ()
    more: Mapping[str, Any] = field(default_factory=dict)
    """Beside `rows` in the JSON: settings, totals, versions."""

    @property
    def passed(self) -> bool:
        return all(bar.met for bar in self.bars)

    def as_dict(self) -> dict[str, Any]:
        """As data."""
        bars = [{"what": b.what, "found": b.found, "bar": b.bar, "passed": b.met} for b in self.bars]
        rows = {"rows": list(self.rows), "bars": bars, "passed": self.passed}
        return {"measure": self.measure, **self.more, **rows}

    def with_figure(self, figure: Figure) -> Findings:
        """With a section of its own for the figure, at the end."""
        return replace(self, sections=(*self.sections, Section("Figure", (), (figure,))))


def as_json(findings: Findings) -> str:
    """What `--json` prints. Raises ValueError for a number that is not finite."""
    return json.dumps(findings.as_dict(), indent=1, ensure_ascii=False, allow_nan=False, default=str) + "\n"


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


def interval(low: float | None, high: float | None, form: str = ".2f") -> str:
    """`[low, high]`, or "-"."""
    return "-" if low is None or high is None else f"[{low:{form}}, {high:{form}}]"


def counted(count: int, what: str) -> str:
    """`1 rater`, `2 raters`."""
    return f"{count} {what}{'' if count == 1 else 's'}"


def _wrapped(sentences: Sequence[str]) -> list[str]:
    return [line for sentence in sentences for line in textwrap.wrap(sentence, LOOK.columns)]


def _row(cells: Sequence[str]) -> str:
    return "|".join(["", *(f" {cell} ".replace("|", "\\|") for cell in cells), ""])


# ---- the page ----------------------------------------------------------------------------------------------------


def check_folder(folder: Path | None, plots: bool = False) -> None:
    """Raises InputError where no page can be written, or where matplotlib is missing for its `plots`."""
    if folder is None:
        return
    if folder.exists() and not folder.is_dir():
        raise InputError.of("-o", f'"{folder}"', "is a file", "name a folder with -o")
    if plots:
        require_matplotlib()


def write_page(
    findings: Findings, folder: Path, command: Sequence[str], keep: Callable[[Path], None] = lambda kept: None
) -> Path:
    """`index.html`, which holds its pictures, and `result.json`; those of an earlier run are replaced.

    A page of another origin is set aside as `index.html~`, and `keep` is called with it. Returns the page's path.
    """
    check_folder(folder)
    return write_files(findings, html(findings, command), folder, keep)


def write_files(findings: Findings, page: str, folder: Path, keep: Callable[[Path], None]) -> Path:
    """The page and `result.json` in `folder`."""
    folder.mkdir(parents=True, exist_ok=True)
    if (folder / PAGE).exists() and not (folder / RESULT).exists():
        back_up(folder / PAGE, keep)
    write_atomic(folder / PAGE, page.encode())
    write_atomic(folder / RESULT, as_json(findings).encode())
    return folder / PAGE


def html(findings: Findings, command: Sequence[str]) -> str:
    """The page; it loads nothing from a network."""
    sections = [
        {
            "title": section.title,
            "sentences": section.sentences,
            "parts": [
                {"table": part, "right": part.numeric}
                if isinstance(part, Table)
                else {"source": _data_uri(part.picture), "about": part.about}
                for part in section.parts
            ],
        }
        for section in findings.sections
    ]
    page: str = template("findings.html.j2").render(
        title=findings.title,
        measure=findings.measure,
        sentences=findings.sentences,
        bars=findings.bars,
        sections=sections,
        command=shlex.join(command),
        version=__version__,
    )
    return page


def _data_uri(picture: str | bytes) -> str:
    if isinstance(picture, str):
        kind, data = "svg+xml", picture.encode()
    else:
        kind, data = "png" if picture[:4] == b"\x89PNG" else "jpeg", picture
    return f"data:image/{kind};base64,{base64.b64encode(data).decode()}"


def photo(rgb: NDArray[np.uint8], about: str) -> Figure:
    """A picture (H, W, 3) sRGB as a figure."""
    bgr = np.ascontiguousarray(rgb[..., ::-1])
    _, data = cv2.imencode(".jpg", bgr, [cv2.IMWRITE_JPEG_QUALITY, LOOK.quality])
    return Figure(bytes(data), about)


def plotted(
    draw: Callable[[Axes, Palette], None], about: str, width: float = 150.0, height: float = 75.0
) -> Figure:
    """An SVG plot, `width` x `height` mm, the same bytes on every run. Raises InputError without matplotlib."""
    require_matplotlib()
    with plot_settings():
        figure = new_figure(width / MM, height / MM, dpi=DPI)
        left, right, below, above = LOOK.margins
        place = (left, below, width - left - right, height - below - above)
        draw(add_axes(figure, *(side / MM for side in place)), PALETTE)
    return Figure(figure_bytes(figure, "svg", about).decode(), about)
