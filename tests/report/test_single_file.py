"""A report that carries its film: moved alone to another folder, it opens, asks for nothing, and plays in step."""

from __future__ import annotations

import base64
import re
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from browser import FALL, at, fallen, middle, opened
from pytest import approx

from physgen import pipeline
from physgen.export.video import Format
from physgen.report.films import embedded_film, linked_film

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
    film = embedded_film(tmp_path, ["frames", "video.gif", "video.webp"], 30, "name")
    assert film.source == "data:image/webp;base64," + base64.b64encode(b"film").decode()
    assert (film.plays, film.name) == (False, "name.webp")
