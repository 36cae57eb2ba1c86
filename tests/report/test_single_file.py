"""A report that carries its film: moved alone to another folder, it opens and asks for nothing."""

from __future__ import annotations

import base64
import re
import shutil
from pathlib import Path
from typing import Any

import pytest
from browser import FALL, opened

from physgen import pipeline
from physgen.export.video import Format
from physgen.report.films import embedded_film, linked_film

SHORT = FALL.replace("duration: 1.5", "duration: 0.2")


@pytest.fixture(scope="module")
def alone(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """`NAME.html` of each format, each moved away from its folder."""
    home = tmp_path_factory.mktemp("alone")
    (home / "fall.yaml").write_text(SHORT, encoding="utf-8")
    for kind in Format:
        folder = pipeline.render_scene(
            home / "fall.yaml", home / f"out-{kind.value}", formats=[kind], single_file=True
        )
        shutil.move(folder / "report.html", home / f"{kind.value}.html")
        shutil.rmtree(folder.parent)
    return home


def test_alone_it_opens_and_asks_for_nothing(browser: Any, alone: Path) -> None:
    page = alone / "mp4.html"
    with opened(browser, page) as seen:
        seen.page.wait_for_function("() => document.querySelector('video').readyState >= 2")
        assert not seen.page.is_visible("[data-part=missing]")
        assert seen.page.get_attribute("[data-part=save]", "download") == "fall.mp4"
        assert [url for url in seen.asked if not url.startswith(("data:", "blob:"))] == [page.as_uri()]
        assert seen.errors == []


def test_the_page_names_nothing_beside_it(alone: Path) -> None:
    for page in alone.glob("*.html"):
        named = re.findall(r'(?:src|href)="([^"]{0,40})', page.read_text())
        assert [name for name in named if not name.startswith(("data:", "#"))] == [], page.name


def test_the_best_film_is_shown(tmp_path: Path) -> None:
    for name in ("video.gif", "video.webp", "video.mp4"):
        (tmp_path / name).write_bytes(b"film")
    assert linked_film(tmp_path, ["video.gif", "frames", "video.mp4"]).source == "video.mp4"
    assert linked_film(tmp_path, ["frames", "video.gif"]).name == "video.gif"
    assert linked_film(tmp_path, ["frames"]).source == "frames/00000.png"
    film = embedded_film(tmp_path, ["frames", "video.gif", "video.webp"], "name")
    assert film.source == "data:image/webp;base64," + base64.b64encode(b"film").decode()
    assert (film.plays, film.name) == (False, "name.webp")
