"""From page to video, in a real browser: progress, stop, the result, and a command that makes the same bytes."""

from __future__ import annotations

import shlex
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from desk import NARROW, Desk, seated

from physgen.cli.main import main

pytestmark = pytest.mark.slow

SCENE = """\
physgen: 1
size: [160, 120]
world: {duration: 0.4}
objects:
  ball: {shape: {circle: {center: [40, 30], radius: 12}}, mass: 50, velocity: [60, 0]}
boundaries: {floor: {segment: [[0, 110], [160, 110]]}}
variants:
  fast: {objects.ball.velocity: [200, 0]}
"""


@pytest.fixture
def scene(tmp_path: Path) -> Path:
    (tmp_path / "scene.yaml").write_text(SCENE, encoding="utf-8")
    return tmp_path / "scene.yaml"


def status(desk: Desk) -> Any:
    return desk.page.evaluate("() => window.editor.request('GET', '/api/render')")


def test_a_variant_is_rendered_and_the_copied_command_makes_the_same(
    browser: Any, serving: Callable[..., Any], scene: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    served = serving(scene, output=tmp_path / "page")
    with seated(browser, served.address, permissions=["clipboard-read", "clipboard-write"]) as desk:
        desk.panel("render")
        desk.page.uncheck(".render-which input[value='']")
        assert desk.page.is_disabled(".render .main"), "nothing is chosen"
        desk.page.check(".render-which input[value=fast]")
        desk.page.wait_for_function(
            "() => document.querySelector('[data-part=command]').textContent.includes('--variant fast')"
        )
        desk.page.evaluate(
            "() => window.editor.edit([{set: ['objects', 'ball', 'mass'], value: 75}], 'heavier')"
        )
        desk.settled()
        desk.page.click(".render .main")
        desk.page.wait_for_selector(".render-results video")
        assert desk.state["file"]["saved"], "what is rendered is what the file says"
        assert "mass: 75" in scene.read_text(encoding="utf-8")
        desk.page.wait_for_function("() => document.querySelector('video').readyState >= 2")
        size = "() => { const v = document.querySelector('video'); return [v.videoWidth, v.videoHeight]; }"
        assert desk.page.evaluate(size) == [160, 120]
        desk.page.click(".render-command-row button")
        command = shlex.split(desk.page.evaluate("() => navigator.clipboard.readText()"))
        with desk.page.context.expect_page() as waiting:
            desk.page.click("text=Report")
        waiting.value.wait_for_selector("#player[data-ready]")
        assert desk.grave("#panel-render") == []
        assert desk.errors == []
    made = next((tmp_path / "page").rglob("video.mp4")).read_bytes()
    command[command.index("-o") + 1] = str(tmp_path / "told")
    assert command[:2] == ["physgen", "render"]
    assert main(command[1:]) == 0
    capsys.readouterr()
    assert next((tmp_path / "told").rglob("video.mp4")).read_bytes() == made


def test_what_is_rendered_waits_for_what_was_done(
    browser: Any, serving: Callable[..., Any], scene: Path
) -> None:
    edits: list[Any] = []
    orders: list[dict[str, Any]] = []

    def asked(route: Any) -> None:
        if route.request.url.endswith("/api/edit"):
            edits.append(route)
        elif route.request.url.endswith("/api/render") and route.request.method == "POST":
            orders.append(route.request.post_data_json)
            stale = {"version": 9} if len(orders) == 1 else {}  # somebody else was quicker
            told = {"error": {"message": "not today", "fix": ""}, "problems": [], **stale}
            route.fulfill(status=409, json=told)
        else:
            route.continue_()

    with seated(browser, serving(scene).address, held=("**/api/**", asked)) as desk:
        desk.panel("render")
        desk.page.evaluate(
            "() => { window.editor.edit([{set: ['objects', 'ball', 'mass'], value: 75}], 'heavier'); }"
        )
        while not edits:
            desk.page.wait_for_timeout(20)
        desk.page.click(".render .main")
        desk.page.wait_for_timeout(300)
        assert desk.page.is_disabled(".render .main")
        assert orders == []
        edits[0].continue_()
        desk.page.wait_for_selector("text=not today")
        assert [order["version"] for order in orders] == [2, 2]
        assert desk.state["version"] == 2
        assert desk.page.is_enabled(".render .main")


def test_a_long_render_tells_how_far_it_is_and_is_stopped(
    browser: Any, serving: Callable[..., Any], scene: Path, tmp_path: Path
) -> None:
    long = SCENE.replace("duration: 0.4", "duration: 4") + "render: {fps: 1000, supersample: 4}\n"
    scene.write_text(long, encoding="utf-8")
    served = serving(scene, output=tmp_path / "page")
    with seated(browser, served.address) as desk:
        desk.panel("render")
        desk.page.click(".render .main")
        desk.page.wait_for_selector(".render-running progress[value]")
        assert desk.page.is_disabled(".render .main"), "one at a time"
        assert desk.page.inner_text("#tab-render").endswith("%")
        assert desk.grave("#panel-render") == []
        desk.page.click("text=Stop")
        desk.page.wait_for_selector(".render-running", state="hidden")
        assert status(desk)["state"] == "stopped"
        assert desk.page.is_enabled(".render .main")
        assert not list((tmp_path / "page").rglob("video.mp4")), "no half of a video"
        assert desk.errors == []


def test_a_file_with_an_error_is_not_rendered(browser: Any, serving: Callable[..., Any], scene: Path) -> None:
    scene.write_text(SCENE.replace("mass: 50", "mass: heavy"), encoding="utf-8")
    how = {"viewport": NARROW, "has_touch": True, "is_mobile": True, "color_scheme": "dark"}
    with seated(browser, serving(scene).address, **how) as desk:
        desk.panel("render")
        assert desk.page.is_disabled(".render .main")
        assert "errors" in str(desk.page.get_attribute(".render .main", "title"))
        assert desk.page.evaluate("() => document.documentElement.scrollWidth <= innerWidth")
        desk.panel("todo")
        top = "() => document.querySelector('#panel-todo').getBoundingClientRect().top < 0.6 * innerHeight"
        assert desk.page.evaluate(top), "below the photo, and brought up"
        desk.page.click(".todo-item.error .todo-what")
        assert desk.page.evaluate("() => window.editor.panel") == "yaml", "it leads to its line"
