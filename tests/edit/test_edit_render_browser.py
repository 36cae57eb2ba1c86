"""From page to video, in a real browser: progress, stop, the result, and a command that makes the same bytes."""

from __future__ import annotations

import shlex
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from desk import seated

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


def test_a_variant_is_rendered_and_the_copied_command_makes_the_same(
    browser: Any,
    serving: Callable[..., Any],
    scene: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    served = serving(scene, output=tmp_path / "page")
    with seated(
        browser, served.address, permissions=["clipboard-read", "clipboard-write"]
    ) as desk:
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
        desk.page.wait_for_function(
            "() => document.querySelector('video').readyState >= 2"
        )
        size = "() => { const v = document.querySelector('video'); return [v.videoWidth, v.videoHeight]; }"
        assert desk.page.evaluate(size) == [160, 120]
        desk.page.click(".render-command-row button")
        command = shlex.split(
            desk.page.evaluate("() => navigator.clipboard.readText()")
        )
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
