"""What it is like to work with, in a real browser: tabs stay, keys wait their turn, things come back to be pushed."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from desk import Desk, seated

pytestmark = pytest.mark.slow

SCENE = """\
physgen: 1
size: [480, 320]
world: {pixels_per_meter: 100, gravity: [0, 400], duration: 0.5}
objects:
  ball:
    shape: {circle: {center: [120, 80], radius: 20}}
    mass: 50
boundaries:
  floor: {segment: [[-500, 300], [980, 300]]}
variants:
  fast: {objects.ball.velocity: [300, 0]}
"""


@pytest.fixture
def scene(tmp_path: Path) -> Path:
    (tmp_path / "scene.yaml").write_text(SCENE, encoding="utf-8")
    return tmp_path / "scene.yaml"


@pytest.fixture
def disc(tmp_path: Path) -> Path:
    """A small photo of a disc, with its mask."""
    assets = tmp_path / "photo.assets"
    assets.mkdir()
    photo = np.random.default_rng(1).normal(200, 2, (180, 240, 3)).clip(0, 255).astype(np.uint8)
    masks = np.zeros((180, 240), np.uint16)
    cv2.circle(photo, (120, 90), 40, (40, 60, 160), -1)
    cv2.circle(masks, (120, 90), 40, 1, -1)  # type: ignore[call-overload]
    cv2.imwrite(str(tmp_path / "photo.png"), photo)
    cv2.imwrite(str(assets / "masks.png"), masks)
    (tmp_path / "scene.yaml").write_text(
        "physgen: 1\nimage: photo.png\nassets: photo.assets\nobjects: {disc: {mask: 1, mass: 20}}\n"
    )
    return tmp_path / "scene.yaml"


def held_back(desk: Desk, path: str) -> None:
    """What the page asks for there waits until `window.release()`."""
    desk.page.evaluate(
        """path => {
            const through = window.fetch;
            let open; const gate = new Promise(done => { open = done; });
            window.asked = [];
            window.release = () => { open(); window.fetch = through; };
            window.fetch = async (to, options) => {
                if (to.startsWith(path)) { window.asked.push(to); await gate; }
                return through(to, options);
            };
        }""",
        path,
    )


def said(desk: Desk, part: str = "status") -> str:
    return str(desk.page.inner_text(f"[data-part={part}]"))


def test_what_is_asked_while_a_correction_is_worked_out_waits_and_is_said_to(
    browser: Any, serving: Callable[..., Any], disc: Path
) -> None:
    served = serving(disc)
    with seated(browser, served.address) as desk:
        desk.choose("disc")
        desk.tool("mask")
        desk.page.click("[data-way=eraser]")
        desk.page.wait_for_function("() => document.body.dataset.cover === 'disc'")
        text = desk.state["text"]
        held_back(desk, "/api/mask")
        desk.drag((110, 60), (130, 60))  # the first, which is worked out
        desk.drag((110, 120), (130, 120))
        assert "picture has followed" in said(desk)
        desk.page.wait_for_function("() => window.editor.pending === 2")
        assert desk.page.is_enabled("[data-part=undo]")
        desk.page.keyboard.press("Control+z")
        desk.page.wait_for_function("() => window.editor.pending === 3")
        assert said(desk) == "Undone once the picture has followed"
        desk.page.evaluate("() => window.release()")
        desk.settled()
        # the second is taken back, the first stands
        assert desk.state["undo"] is not None
        assert desk.state["redo"] is not None
        assert "Undone" in said(desk)
        mask = served.client.get("/api/mask", params={"object": "disc"}).content
        pixels = cv2.imdecode(np.frombuffer(mask, np.uint8), cv2.IMREAD_GRAYSCALE)
        assert pixels[60, 120] == 0
        assert pixels[120, 120] == 255
        desk.page.click("[data-part=undo]")
        desk.settled()
        assert desk.state["undo"] is None
        assert desk.state["text"] == text
        assert not desk.page.is_enabled("[data-part=undo]")
        assert desk.errors == []


def test_after_a_push_it_plays_once_and_is_back_where_it_can_be_pushed_again(
    browser: Any, serving: Callable[..., Any], scene: Path
) -> None:
    with seated(browser, serving(scene).address, reduced_motion="no-preference") as desk:
        desk.drag((120, 80), (150, 80))
        desk.page.wait_for_function("() => window.editor.player.playing && window.editor.player.time > 0.2")
        # a push at once, where the photo has the thing: it is grabbed there
        first = desk.state["scene"]["objects"]["ball"]["velocity"]
        desk.drag((120, 80), (120, 50))
        desk.settled()
        second = desk.state["scene"]["objects"]["ball"]["velocity"]
        assert second[1] < 0 <= second[0] < first[0]
        # left alone it plays to its end, once, and goes back
        desk.page.wait_for_function("() => window.editor.player.time > 0.4")
        desk.page.wait_for_function("() => !window.editor.player.showing && !window.editor.player.playing")
        assert desk.page.evaluate("() => window.editor.player.time") == 0
        assert desk.page.get_attribute("[data-part=loop]", "aria-pressed") == "true"
        # who plays it has it played again and again, as Loop says
        desk.page.click("[data-part=play]")
        desk.page.wait_for_function("() => window.editor.player.time > 0.4")
        desk.page.wait_for_function("() => window.editor.player.playing && window.editor.player.time < 0.2")
        assert desk.errors == []
