"""What notebooks show, asked for by IPython itself, read by other readers."""

from __future__ import annotations

import base64
import re
import xml.etree.ElementTree as ET
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from IPython.core.formatters import DisplayFormatter

from physgen import pipeline
from physgen.pipeline import notebook

SVG = "{http://www.w3.org/2000/svg}"
EVIL = '<script>alert("1")</script>&'
LESSON = f"""\
physgen: 1
size: [160, 120]
world: {{duration: 0.5, gravity: [0, 0]}}
objects:
  ball: {{shape: {{circle: {{center: [40, 85], radius: 15}}}}, mass: 100, velocity: [100, 0], label: {EVIL!r}}}
  crate: {{shape: {{box: {{center: [130, 40], size: [30, 40]}}}}, mass: 200}}
boundaries:
  floor: {{segment: [[-100, 110], [300, 110]]}}
render: {{fps: 24}}
"""


class Reader(HTMLParser):
    """Elements, and the text of titles."""

    def __init__(self, html: str) -> None:
        super().__init__()
        self.found: list[tuple[str, dict[str, str | None]]] = []
        self.words = ""
        self.feed(html)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.found.append((tag, dict(attrs)))

    def handle_data(self, data: str) -> None:
        self.words += data

    def of(self, tag: str) -> list[dict[str, str | None]]:
        return [attributes for name, attributes in self.found if name == tag]


@pytest.fixture
def lesson(tmp_path: Path) -> Path:
    path = tmp_path / "lesson.yaml"
    path.write_text(LESSON)
    return path


def shown(thing: Any) -> str:
    data, _ = DisplayFormatter().format(thing)
    assert isinstance(data["text/html"], str)
    return data["text/html"]


def test_a_cell_shows_a_scene_with_its_shapes_where_they_are(lesson: Path) -> None:
    html = shown(pipeline.load(lesson))
    reader = Reader(html)
    assert not reader.of("script")
    assert EVIL in reader.words  # as a title, in letters
    root = ET.fromstring(re.search("<svg.*</svg>", html, re.S)[0])
    outlines = [path for path in root.iter(f"{SVG}path") if path.find(f"{SVG}title") is not None]
    ball, crate = (
        np.array(re.findall(r"([-\d.]+),([-\d.]+)", path.get("d")), float) for path in outlines[:2]
    )
    assert np.allclose(ball.mean(axis=0), [40, 85], atol=0.1)
    assert np.allclose(np.hypot(*(ball - [40, 85]).T), 15, atol=0.1)
    assert np.allclose(crate.min(axis=0), [115, 20])
    arrow = np.array(re.findall(r"([-\d.]+),([-\d.]+)", outlines[2].get("d")), float)
    assert outlines[2].find(f"{SVG}title").text == "ball: 100, 0 px/s"
    assert np.ptp(arrow[:, 0]) == pytest.approx(0.14 * 200, abs=0.1)  # the longest: a part of the diagonal


def test_a_bundled_photo_is_in_the_cell(bundled: Path) -> None:
    reader = Reader(shown(pipeline.load(bundled / "dominoes/scene.yaml")))
    [image] = reader.of("image")
    data = base64.b64decode(image["href"].removeprefix("data:image/jpeg;base64,"))
    assert data[:3] == b"\xff\xd8\xff"
    assert len(data) < 120_000
    assert "dominoes" in reader.words


def test_worlds_and_trajectories_show_themselves(lesson: Path) -> None:
    compiled = pipeline.compile(pipeline.load(lesson), None)
    assert shown(compiled) == shown(compiled.world)
    trajectory = pipeline.simulate(compiled.world)
    html = shown(trajectory)
    root = ET.fromstring(re.search("<svg.*</svg>", html, re.S)[0])
    [line] = root.iter(f"{SVG}polyline")  # the crate lies still
    path = np.array(re.findall(r"([-\d.]+),([-\d.]+)", line.get("points")), float)
    assert np.allclose(path[0], [40, 85], atol=0.01)
    assert np.allclose(path[-1], [40 + 100 * trajectory.times[-1], 85], atol=0.6)
    assert "ball" in Reader(html).words


def test_a_scene_whose_photo_has_gone_says_so(tmp_path: Path, bundled: Path) -> None:
    from PIL import Image

    Image.new("RGB", (64, 48)).save(tmp_path / "photo.png")
    path = tmp_path / "lesson.yaml"
    path.write_text("physgen: 1\nimage: photo.png\nobjects: {}\n")
    scene = pipeline.load(path)
    (tmp_path / "photo.png").unlink()
    assert "photo.png" in Reader(shown(scene)).words


def test_a_clip_plays_in_its_cell(lesson: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = pipeline.render_scene(lesson, tmp_path / "out put")
    monkeypatch.chdir(tmp_path)
    reader = Reader(shown(notebook.show(folder)))
    [video], [link] = reader.of("video"), reader.of("a")
    assert base64.b64decode(video["src"].partition(",")[2]) == (folder / "video.mp4").read_bytes()
    assert link["href"] == "out%20put/lesson/report.html"
    monkeypatch.setattr(notebook, "INLINE", 10)
    [video] = Reader(shown(notebook.show(folder))).of("video")
    assert video["src"] == "out%20put/lesson/video.mp4"
