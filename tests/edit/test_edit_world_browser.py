"""The panels and keys of the editor, in a real browser: gravity, scale, light, materials; all without a mouse, too."""

from __future__ import annotations

import numpy as np
import pytest
from desk import Desk

pytestmark = pytest.mark.slow

SCENE = """\
physgen: 1
size: [480, 320]
world: {pixels_per_meter: 100, duration: 1.0}
objects:
  ball:
    label: rubber ball
    shape: {circle: {center: [120, 80], radius: 20}}
    solid: sphere
    mass: 50
    from: {mass: table 0.4, friction: clip 0.9}
  block:
    shape: {box: {center: [360, 270], size: [40, 60]}}
    mass: 200
boundaries:
  floor: {segment: [[-500, 300], [980, 300]]}
light: {direction: [0, -0.6, 0.8], from: shadows 0.3}
"""


def fill(desk: Desk, path: str, *values: str) -> None:
    """Type into a row of a panel, and leave it."""
    inputs = desk.page.locator(f'[data-row="{path}"] input')
    for k, value in enumerate(values):
        inputs.nth(k).fill(value)
        inputs.nth(k).press("Enter")
    desk.settled()


def test_the_dial_turns_gravity_and_things_fall_that_way(desk: Desk) -> None:
    desk.panel("world")
    box = desk.page.locator("[data-part=dial]").bounding_box()
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    desk.page.mouse.move(x, y + 30)
    desk.page.mouse.down()
    desk.page.mouse.move(x - 20, y + 20, steps=4)
    desk.page.mouse.move(x - 30, y, steps=4)
    desk.page.mouse.up()
    desk.settled()
    assert desk.state["scene"]["world"]["gravity"] == [-980, 0]
    x0, y0, _ = desk.way("ball")[0]
    seen = desk.way("ball")
    early = seen[seen[:, 2] < 0.3]
    np.testing.assert_allclose(early[:, 0], x0 - 980 * early[:, 2] ** 2 / 2, atol=0.6)
    np.testing.assert_allclose(early[:, 1], y0, atol=1e-6)
    desk.page.get_by_role("button", name="Moon").click()
    desk.settled()
    assert desk.state["scene"]["world"]["gravity"] == [-162, 0]
    desk.page.locator("[data-part=dial]").focus()
    for _ in range(18):
        desk.page.keyboard.press("ArrowRight")
    desk.settled()
    assert desk.state["scene"]["world"]["gravity"] == pytest.approx([0, 162], abs=0.5)
    desk.page.keyboard.press("Control+z")  # the keys were one step
    desk.settled()
    assert desk.state["scene"]["world"]["gravity"] == [-162, 0]
    assert desk.errors == []


def test_numbers_are_typed_refused_where_they_cannot_be_and_taken_back(
    desk: Desk,
) -> None:
    desk.choose("ball")
    assert "40 % sure" in desk.page.inner_text('[data-row="objects.ball.mass"]')
    fill(desk, "objects.ball.mass", "120,5")  # a comma, as some write it
    ball = desk.state["scene"]["objects"]["ball"]
    assert ball["mass"] == 120.5
    assert ball["from"] == {"friction": "clip 0.9"}
    version = desk.state["version"]
    fill(desk, "objects.ball.elasticity", "15")
    assert "0 to 10" in desk.page.inner_text('[data-row="objects.ball.elasticity"]')
    assert desk.state["version"] == version
    desk.page.locator('[data-row="objects.ball.elasticity"] input').press("Escape")
    fill(desk, "objects.ball.friction", "0.9")
    assert "from" not in desk.state["text"].partition("boundaries")[0]
    desk.page.locator('[data-row="objects.ball.friction"] button').click()
    desk.settled()
    assert (
        desk.state["scene"]["objects"]["ball"]["friction"] == 0.5
    )  # the schema's default
    fill(desk, "objects.ball.velocity", "30", "-40")
    assert "0.5 m/s" in desk.page.inner_text('[data-row="objects.ball.velocity"]')
    fill(desk, "objects.ball.(name)", "bouncer")
    assert list(desk.state["scene"]["objects"]) == ["bouncer", "block"]
    assert desk.page.inner_text("#panel-object h2") == "bouncer"


def test_a_material_brings_its_friction_and_the_mass_of_a_sphere(desk: Desk) -> None:
    desk.choose("ball")
    select = desk.page.locator('[data-row="objects.ball.(material)"] select')
    select.select_option("steel")
    desk.settled()
    ball = desk.state["scene"]["objects"]["ball"]
    steel = next(
        m
        for m in desk.page.evaluate("() => window.editor.materials")
        if m["name"] == "steel"
    )
    assert [ball[key] for key in ("friction", "elasticity", "rolling")] == [
        steel[key] for key in ("friction", "elasticity", "rolling")
    ]
    # 4/3 pi (20 cm)³, for 100 px are 1 m
    assert ball["mass"] == pytest.approx(
        steel["density"] * 4 / 3 * np.pi * 20**3, rel=0.005
    )
    assert select.input_value() == "steel"


def test_the_scale_by_a_length_drawn_on_the_photo(desk: Desk) -> None:
    desk.tool("measure")
    desk.drag((340, 240), (340, 270), (340, 300))
    desk.page.get_by_label("Its true length").fill("24")
    desk.page.get_by_role("button", name="Set the scale").click()
    desk.settled()
    assert desk.state["scene"]["world"]["pixels_per_meter"] == pytest.approx(
        60 / 0.24, rel=0.02
    )
    # gravity was not written, so it follows: 9.8 m/s²
    seen = desk.way("ball")
    scale = desk.state["scene"]["world"]["pixels_per_meter"]
    early = seen[seen[:, 2] < 0.2]
    np.testing.assert_allclose(
        early[:, 1], 80 + 9.8 * scale * early[:, 2] ** 2 / 2, atol=1.5
    )


def test_the_light_is_a_sphere_that_is_dragged(desk: Desk) -> None:
    box = desk.page.locator("button.light").bounding_box()
    x, y, r = (
        box["x"] + box["width"] / 2,
        box["y"] + box["height"] / 2,
        box["width"] / 2,
    )
    desk.page.mouse.move(x, y)
    desk.page.mouse.down()
    desk.page.mouse.move(x - 0.6 * r, y, steps=4)
    desk.page.mouse.up()
    desk.settled()
    light = desk.state["scene"]["light"]
    assert light["direction"] == pytest.approx([-0.6, 0, 0.8], abs=0.03)
    assert "from" not in light
    before = light["direction"][1]
    desk.page.locator("button.light").press("ArrowUp")
    desk.settled()
    assert desk.state["scene"]["light"]["direction"][1] < before


def test_keys_alone_choose_push_play_and_undo(desk: Desk) -> None:
    keys = desk.page.keyboard
    desk.page.locator("[data-part=over]").focus()
    keys.press("Tab")
    assert (
        desk.page.evaluate("() => document.activeElement.textContent")
        == "ball, rubber ball"
    )
    keys.press("Enter")
    for _ in range(3):
        keys.press("ArrowRight")
    keys.press("ArrowUp")
    desk.settled()
    vx, vy = desk.state["scene"]["objects"]["ball"]["velocity"]
    assert vx == pytest.approx(-3 * vy)
    assert vy < 0
    keys.press("]")
    desk.settled()
    assert desk.state["scene"]["objects"]["ball"]["spin"] == 45
    keys.press("v")
    keys.press("ArrowDown")
    keys.press("Shift+ArrowDown")
    desk.settled()
    x, y = desk.state["scene"]["objects"]["ball"]["shape"]["circle"]["center"]
    assert x == 120
    assert y > 80
    for _ in range(3):
        keys.press("Control+z")
    desk.settled()
    assert desk.state["text"] == SCENE
    keys.press("Shift+O")
    assert desk.page.get_attribute("[data-layer=outlines]", "aria-pressed") == "false"
    keys.press("?")
    assert desk.page.locator("dialog[open]").count() == 1
    keys.press("Escape")
    assert desk.page.locator("dialog[open]").count() == 0
    keys.press("F6")
    assert desk.page.evaluate("() => document.activeElement.id") == "panels"
    assert desk.errors == []
