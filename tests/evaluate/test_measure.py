"""What a measure found, told to a terminal, as Markdown, as JSON and as a page."""

from __future__ import annotations

import json
from html.parser import HTMLParser
from math import nan
from pathlib import Path

import pytest

from physgen.evaluate.measure import (
    Bar,
    Findings,
    Section,
    Table,
    as_json,
    text,
    write_page,
)
from physgen.problems import InputError

RUDE = '<script>alert("x")</script> & |'


def found(met: bool = True, value: float = 1.5) -> Findings:
    table = Table(
        ("method", "distance"),
        (("ours", "105.7"), (RUDE, "-")),
        note="The paper: 105.70.",
    )
    sections = (Section("Distances", (RUDE,), (table,)),)
    bars = (Bar("order", "30.2", "36.6", met),)
    return Findings(
        "fid", "Frames", ("One.",), sections, [{"method": "ours", "value": value}], bars
    )


class Reader(HTMLParser):
    """Scripts and cells."""

    def __init__(self, page: str) -> None:
        super().__init__()
        self.scripts: list[str] = []
        self.cells: list[str] = []
        self._inside = ""
        self.feed(page)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self._inside = tag
        if tag in ("td", "th"):
            self.cells.append("")

    def handle_data(self, data: str) -> None:
        if self._inside == "script":
            self.scripts.append(data)
        if self._inside in ("td", "th") and self.cells:
            self.cells[-1] += data.strip()


def test_a_page_holds_all_and_nothing_runs(tmp_path: Path) -> None:
    page = write_page(
        found(), tmp_path / "new" / "page", ["physgen", "evaluate", "fid", "a b"]
    )
    read = Reader(page.read_text())
    assert read.cells == ["method", "distance", "ours", "105.7", RUDE, "-"]
    assert not any("alert" in script for script in read.scripts)
    assert "physgen evaluate fid &#39;a b&#39;" in page.read_text()
    assert json.loads((page.parent / "result.json").read_text()) == found().as_dict()


def test_a_page_of_somebody_else_is_kept(tmp_path: Path) -> None:
    (tmp_path / "index.html").write_text("mine")
    kept: list[Path] = []
    write_page(found(), tmp_path, ["physgen"], kept.append)
    write_page(found(), tmp_path, ["physgen"], kept.append)
    assert kept == [tmp_path / "index.html~"]
    assert (tmp_path / "index.html~").read_text() == "mine"
    assert sorted(p.name for p in tmp_path.iterdir()) == [
        "index.html",
        "index.html~",
        "result.json",
    ]


def test_a_file_is_no_folder(tmp_path: Path) -> None:
    (tmp_path / "x").write_text("")
    with pytest.raises(InputError, match="is a file"):
        write_page(found(), tmp_path / "x", ["physgen"])


def test_a_missed_bar_is_said_everywhere() -> None:
    assert found().has_passed
    assert not found(met=False).has_passed
    assert "MISSED" in text(found(met=False))
    assert found(met=False).as_dict()["passed"] is False


def test_no_number_is_no_result() -> None:
    with pytest.raises(ValueError, match="not JSON compliant"):
        as_json(found(value=nan))
