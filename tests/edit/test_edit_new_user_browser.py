"""Tasks of a new user of the editor: change masses, hide and lock objects, find a contact, look closer."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import cv2
import numpy as np
import pytest
from browser import PHONE
from desk import Desk, seated
from served import Served

from physgen import pipeline
from physgen.export.video import Format
from physgen.pipeline.clip import RenderOptions

pytestmark = pytest.mark.slow

SCENE = """\
physgen: 1
size: [320, 240]
world: {pixels_per_meter: 100, duration: 1.0}
objects:
  ball: {shape: {circle: {center: [60, 60], radius: 20}}, mass: 50, velocity: [90, 0]}
  block: {shape: {box: {center: [220, 190], size: [40, 60]}}, mass: 200}
  crate: {shape: {box: {center: [280, 190], size: [30, 60]}}, mass: 300}
boundaries:
  floor: {segment: [[-500, 220], [980, 220]]}
forces:
  - {object: crate, force: [1000, 0], start: 0.2, duration: 0.3}
"""
TOP = """\
physgen: 1
size: [320, 240]
world: {view: top, pixels_per_meter: 100, duration: 0.5}
objects:
  ball: {shape: {circle: {center: [60, 60], radius: 20}}, velocity: [90, 0]}
"""


def entry(desk: Desk, name: str) -> Any:
    return desk.page.locator(f".objects li[data-name={name}]")


def test_a_mass_is_changed_by_dragging_its_number(desk: Desk) -> None:
    entry(desk, "ball").get_by_role("button", name="ball").first.click()
    field = desk.page.locator('[data-row="objects.ball.mass"] input')
    box = field.bounding_box()
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    desk.page.mouse.move(x, y)
    desk.page.mouse.down()
    desk.page.mouse.move(x + 40, y, steps=5)
    desk.page.mouse.up()
    desk.settled()
    mass = desk.state["scene"]["objects"]["ball"]["mass"]
    assert mass > 50
    assert float(field.input_value()) == mass
    assert desk.state["undo"].startswith("ball mass")
    field.click()
    assert field.evaluate("e => e === document.activeElement"), "a click types"
    assert desk.errors == []


def test_several_objects_get_a_mass_at_once(desk: Desk) -> None:
    desk.page.get_by_label("Choose ball with others").check()
    desk.page.get_by_label("Choose crate with others").check()
    desk.page.get_by_label("mass of 2 objects").fill("75")
    desk.page.keyboard.press("Enter")
    desk.settled()
    masses = {n: o["mass"] for n, o in desk.state["scene"]["objects"].items()}
    assert masses == {"ball": 75, "block": 200, "crate": 75}
    assert desk.grave() == []
    assert desk.errors == []


def test_hidden_and_locked_objects_are_left_alone(desk: Desk) -> None:
    """A locked object is not taken by the pointer; a hidden one is not drawn either. The file stays as it is."""
    text = desk.state["text"]
    desk.tool("move")
    entry(desk, "block").get_by_role("button", name="Lock block").click()
    desk.click((220, 190))
    assert desk.page.evaluate("() => window.editor.selected") is None
    desk.click((60, 60))
    assert desk.page.evaluate("() => window.editor.selected.name") == "ball"
    desk.choose("")
    desk.page.evaluate("() => window.editor.choose(null)")
    pixel = (
        "() => { const c = document.querySelector('[data-part=scene]'), k = c.width / 320;"
        " return [...c.getContext('2d').getImageData(60 * k, 60 * k, 1, 1).data]; }"
    )
    before = desk.page.evaluate(pixel)
    entry(desk, "ball").get_by_role("button", name="Hide ball").click()
    desk.drawn()
    assert desk.page.evaluate(pixel) != before
    assert desk.state["text"] == text


def test_the_slider_has_marks_and_frames(desk: Desk) -> None:
    """The ball's first contact is where its fall says: t = sqrt(2 h / g)."""
    desk.page.evaluate("() => window.editor.watched")
    marks = desk.page.locator("[data-part=marks]")
    assert int(marks.get_attribute("data-forces")) == 1
    shares = desk.page.evaluate(
        "() => [...document.querySelectorAll('.marks .contact')].map(e => parseFloat(e.style.left) / 100)"
    )
    end = desk.page.evaluate("() => window.editor.player.run.end")
    lands = np.sqrt(2 * (220 - 20 - 60) / 980)
    assert min(abs(np.array(shares) * end - lands)) < 0.02
    assert desk.page.inner_text("[data-part=frames]") == "30"
    desk.page.evaluate("() => window.editor.player.step(3)")
    assert desk.page.inner_text("[data-part=frame]") == "4"


def test_the_title_is_the_folder_s(desk: Desk, served: Served) -> None:
    assert desk.page.inner_text("[data-part=name]") == served.scene.parent.name


def test_no_dial_of_gravity_from_above(
    browser: Any, serving: Callable[..., Served], tmp_path: Any
) -> None:
    (tmp_path / "table.yaml").write_text(TOP)
    with seated(browser, serving(tmp_path / "table.yaml").address) as desk:
        desk.panel("world")
        assert desk.page.locator("[data-part=dial]").count() == 0
        assert desk.page.inner_text("[data-part=name]") == "table"
        assert desk.errors == []


def test_on_a_phone_photo_and_player_stay_in_view(browser: Any, served: Served) -> None:
    with seated(browser, served.address, viewport=PHONE) as desk:
        panel = desk.page.locator(".panel:visible")
        panel.evaluate("e => { e.scrollTop = e.scrollHeight; }")
        for part in ("scene", "play", "seek"):
            box = desk.page.locator(f"[data-part={part}]").bounding_box()
            assert box["y"] >= 0, part
            assert box["y"] + box["height"] <= PHONE["height"], part
        wide = desk.page.evaluate("() => document.documentElement.scrollWidth")
        assert wide == PHONE["width"]


def test_the_frame_is_that_of_the_video(
    served: Served, desk: Desk, tmp_path: Any
) -> None:
    """The frame that the page shows equals the one that `physgen render` writes, blur included."""
    desk.page.evaluate("() => window.editor.watched")
    desk.page.evaluate("() => window.editor.player.step(7)")
    desk.page.keyboard.press("q")
    final = desk.page.locator("[data-part=final]")
    final.wait_for(state="visible")
    state = served.look()
    got = served.client.get(
        f"/api/frame/{state['picture']}",
        params={"motion": state["motion"]["key"], "number": 7},
    )
    seen = cv2.imdecode(np.frombuffer(got.content, np.uint8), cv2.IMREAD_COLOR)
    options = RenderOptions(formats=(Format.PNG,))
    folder = pipeline.render_scene(served.scene, tmp_path / "out", options)
    written = cv2.imread(str(folder / "frames" / "00007.png"))
    np.testing.assert_array_equal(seen, written)
    desk.page.keyboard.press(".")
    assert not final.is_visible()
    assert desk.errors == []
