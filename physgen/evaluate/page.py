"""What a measure found -> a folder with a page in the report's style and the same as JSON. Everything is escaped."""

from __future__ import annotations

import base64
import json
import shlex
from collections.abc import Callable, Sequence
from pathlib import Path

from physgen import __version__
from physgen.evaluate.findings import Figure, Findings, Table, numeric
from physgen.files import back_up, write_atomic
from physgen.problems import InputError
from physgen.report.html import template

PAGE, RESULT = "index.html", "result.json"


def check_folder(folder: Path | None) -> None:
    """Raises InputError where no page can go, before anything is measured."""
    if folder is not None and folder.exists() and not folder.is_dir():
        raise InputError.of("-o", f'"{folder}"', "is a file", "name a folder with -o")


def write_page(
    findings: Findings, folder: Path, command: Sequence[str], keep: Callable[[Path], None] = lambda kept: None
) -> Path:
    """`index.html`, which holds its pictures, and `result.json`; those of an earlier run are replaced.

    A page that is not ours is set aside as `index.html~`, and `keep` is told of it. Returns the page's path.
    """
    check_folder(folder)
    folder.mkdir(parents=True, exist_ok=True)
    if (folder / PAGE).exists() and not (folder / RESULT).exists():
        back_up(folder / PAGE, keep)
    write_atomic(folder / PAGE, html(findings, command).encode())
    data = json.dumps(findings.as_dict(), indent=1, ensure_ascii=False, allow_nan=False)
    write_atomic(folder / RESULT, data.encode())
    return folder / PAGE


def html(findings: Findings, command: Sequence[str]) -> str:
    """The page: asks nothing of any network."""
    sections = [
        {
            "title": section.title,
            "sentences": section.sentences,
            "parts": [_figure(part) if isinstance(part, Figure) else _table(part) for part in section.parts],
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


def _table(table: Table) -> dict[str, object]:
    right = [all(numeric(row[k]) for row in table.rows) for k in range(len(table.heads))]
    return {"table": table, "right": right}


def _figure(figure: Figure) -> dict[str, object]:
    if isinstance(figure.picture, str):
        kind, data = "svg+xml", figure.picture.encode()
    else:
        kind, data = "png" if figure.picture[:4] == b"\x89PNG" else "jpeg", figure.picture
    return {"source": f"data:image/{kind};base64,{base64.b64encode(data).decode()}", "about": figure.about}
