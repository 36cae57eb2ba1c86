"""A report that carries its film: moved alone to another folder, it opens, asks for nothing, and plays in step."""

from __future__ import annotations

import base64
import io
import re
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from browser import FALL, at, fallen, middle, opened
from PIL import Image
from pytest import approx

from physgen import pipeline
from physgen.cli.main import main
from physgen.export.video import Format
from physgen.report.films import embedded_film, linked_film, size_warning

SIZE = (320, 400)
SHORT = FALL.replace("duration: 1.5", "duration: 0.6")


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


def asked(seen: Any) -> list[str]:
    return [url for url in seen.asked if not url.startswith(("data:", "blob:"))]


def filmed(seen: Any) -> np.ndarray:
    """(H, W, 3) what the film shows now."""
    size, codes = seen.page.evaluate(
        "async () => { const v = document.querySelector('[data-part=film]');"
        " for (let k = 0; v.seeking && k < 100; k += 1) await new Promise(done => setTimeout(done, 20));"
        " const c = document.createElement('canvas'); c.width = v.videoWidth || v.naturalWidth;"
        " c.height = v.videoHeight || v.naturalHeight; const pen = c.getContext('2d'); pen.drawImage(v, 0, 0);"
        " const d = pen.getImageData(0, 0, c.width, c.height).data; let s = '';"
        " for (let k = 0; k < d.length; k += 32768) s += String.fromCharCode(...d.subarray(k, k + 32768));"
        " return [[c.height, c.width], s]; }"
    )
    return np.frombuffer(codes.encode("latin-1"), np.uint8).reshape(*size, 4)[..., :3].astype(np.float64)


@pytest.mark.parametrize("name", ["mp4", "png"])
def test_alone_it_plays_in_step(browser: Any, alone: Path, name: str) -> None:
    """The film's ball, too, is where balls fall to; frames of a folder come as a video."""
    page = alone / f"{name}.html"
    with opened(browser, page) as seen:
        seen.page.wait_for_function("() => document.querySelector('video').readyState >= 2")
        seen.seek(0)
        colour = at(filmed(seen), 60, 57, SIZE)
        for frame in (0, 6, 14, 17):
            shown = seen.seek(frame / 30)
            found = middle(filmed(seen), colour, SIZE)
            if frame == 0:
                start = np.array(fallen(0)) - found
            assert start + found == approx(fallen(shown), abs=1.5), frame
        seen.page.click("[data-part=play]")
        seen.page.wait_for_function("() => !document.querySelector('video').paused")
        assert seen.page.is_visible("video")
        assert not seen.page.is_visible("[data-part=missing]")
        assert seen.page.is_visible("[data-part=save]")
        assert seen.page.get_attribute("[data-part=save]", "download") == "fall.mp4"
        assert asked(seen) == [page.as_uri()]
        assert seen.errors == []


@pytest.mark.parametrize("name", ["gif", "webp"])
def test_pictures_that_move_are_carried_as_they_are(browser: Any, alone: Path, name: str) -> None:
    page = alone / f"{name}.html"
    with opened(browser, page) as seen:
        seen.page.wait_for_function("() => document.querySelector('[data-part=film]').naturalWidth === 320")
        assert seen.page.get_attribute("[data-part=save]", "download") == f"fall.{name}"
        assert asked(seen) == [page.as_uri()]
        assert seen.errors == []
    text = page.read_text()
    data = re.search(rf'src="data:image/{name};base64,([^"]+)" data-part="film"', text)[1]
    with Image.open(io.BytesIO(base64.b64decode(data))) as film:
        assert film.n_frames == 18


def test_without_scripts_it_can_be_played(browser: Any, alone: Path) -> None:
    with opened(browser, alone / "mp4.html", ready=False, java_script_enabled=False) as seen:
        assert seen.page.is_visible("video[controls]")
        assert asked(seen) == [(alone / "mp4.html").as_uri()]


def test_the_page_names_nothing_beside_it(alone: Path) -> None:
    for page in alone.glob("*.html"):
        named = re.findall(r'(?:src|href)="([^"]{0,40})', page.read_text())
        assert [name for name in named if not name.startswith(("data:", "#"))] == [], page.name


def test_frames_beside_the_page_go_in_step(browser: Any, tmp_path: Path) -> None:
    (tmp_path / "fall.yaml").write_text(SHORT, encoding="utf-8")
    folder = pipeline.render_scene(tmp_path / "fall.yaml", tmp_path / "out", formats=[Format.PNG])
    with opened(browser, folder / "report.html") as seen:
        for frame in (3, 11, 0):
            seen.seek(frame / 30)
            seen.page.wait_for_function(
                "name => document.querySelector('[data-part=film]').src.endsWith(name)",
                arg=f"/frames/{frame:05}.png",
            )
        assert seen.errors == []


def test_the_best_film_is_shown(tmp_path: Path) -> None:
    for name in ("video.gif", "video.webp", "video.mp4"):
        (tmp_path / name).write_bytes(b"film")
    assert linked_film(tmp_path, ["video.gif", "frames", "video.mp4"]).source == "video.mp4"
    assert linked_film(tmp_path, ["frames", "video.gif"]).name == "video.gif"
    assert linked_film(tmp_path, ["frames"]).source == "frames/00000.png"
    film = embedded_film(tmp_path, ["frames", "video.gif", "video.webp"], 30, "name")
    assert film.source == "data:image/webp;base64," + base64.b64encode(b"film").decode()
    assert (film.plays, film.name) == (False, "name.webp")


def test_it_needs_a_page(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "fall.yaml").write_text(SHORT, encoding="utf-8")
    command = ["render", str(tmp_path / "fall.yaml"), "-o", str(tmp_path / "out"), "--single-file"]
    assert main([*command, "--report", "none"]) == 2
    assert "--single-file: needs a page" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()
    assert main([*command, "--report", "plain"]) == 0
    assert '<video src="data:video/mp4;base64,' in (tmp_path / "out" / "fall" / "report.html").read_text()


def test_what_no_mailbox_takes_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    page = tmp_path / "report.html"
    page.write_bytes(b" " * 2_000)
    assert size_warning(page, "less") is None
    monkeypatch.setattr("physgen.report.films.MAILED", 1_000)
    assert "few mailboxes" in str(size_warning(page, "less"))
