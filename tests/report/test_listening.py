"""Sound on pages: the report's section and the page to listen to."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from browser import grave, opened, overflowing

from physgen.pipeline import render_scene
from physgen.report.gallery import write_gallery

SCENE = """
physgen: 1
size: [96, 64]
world: {view: side, duration: 0.6, pixels_per_meter: 400}
objects:
  ball: {shape: {circle: {center: [40, 20], radius: 8}}, label: "steel <ball>", mass: 20, solid: sphere}
boundaries:
  floor: {polyline: [[0, 56], [96, 56]]}
"""


@pytest.fixture(scope="module")
def clips(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A clip with sound, one without, and their gallery."""
    home = tmp_path_factory.mktemp("clips")
    (home / "loud.yaml").write_text(SCENE + "render: {sound: true}\n")
    (home / "mute.yaml").write_text(SCENE)
    for name in ("loud", "mute"):
        render_scene(home / f"{name}.yaml", home / "out")
    write_gallery([home / "out"], home / "out" / "index.html")
    return home / "out"


def test_listening_page_has_only_clips_with_sound(clips: Path) -> None:
    page = (clips / "index.listen.html").read_text()
    assert 'src="loud/video.mp4"' in page
    assert "mute/video.mp4" not in page
    assert "steel &lt;ball&gt; hits floor" in page
    assert 'href="index.listen.html"' in (clips / "index.html").read_text()


def test_gallery_without_sound_has_no_listening_page(clips: Path) -> None:
    index = clips / "mute" / "gallery.html"
    write_gallery([clips], index)
    assert (clips / "mute" / "gallery.listen.html").exists()
    write_gallery([clips / "mute"], index)
    assert not (clips / "mute" / "gallery.listen.html").exists()
    assert "index.listen.html" not in index.read_text()


def test_report_has_a_section_of_sound(clips: Path) -> None:
    assert 'id="sound"' in (clips / "loud" / "report.html").read_text()
    assert 'id="sound"' not in (clips / "mute" / "report.html").read_text()


@pytest.mark.slow
@pytest.mark.parametrize("width", [1280, 390])
def test_listening_page_in_a_browser(browser: Any, clips: Path, width: int) -> None:
    viewport = {"width": width, "height": 800}
    page = clips / "index.listen.html"
    with opened(browser, page, ready=False, viewport=viewport) as seen:
        video = seen.page.locator("video")
        assert video.evaluate("v => v.muted")
        video.evaluate("v => { v.textTracks[0].mode = 'showing'; }")
        seen.page.wait_for_function(
            "() => document.querySelector('video').textTracks[0].cues?.length > 0"
        )
        assert grave(seen.page) == []
        assert overflowing(seen.page) == []
        assert seen.errors == []


def test_foreign_file_of_the_name_is_kept(clips: Path) -> None:
    foreign = clips / "album.listen.html"
    foreign.write_text("mine")
    write_gallery([clips], clips / "album.html")
    assert foreign.read_text() == "mine"
    assert "album.listen.html" not in (clips / "album.html").read_text()
