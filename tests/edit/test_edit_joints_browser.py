"""Ropes, rails and limits of pins made by hand in a real browser."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from desk import Desk

from physgen import pipeline

pytestmark = pytest.mark.slow

SCENE = """\
physgen: 1
size: [480, 320]
world: {pixels_per_meter: 100, gravity: [0, 980], duration: 2}
objects:
  ball: {shape: {circle: {center: [120, 120], radius: 16}}, mass: 50}
  hook: {shape: {box: {center: [180, 40], size: [30, 20]}}, motion: static}
  rod: {shape: {box: {center: [320, 100], size: [100, 12]}}, mass: 80}
"""


def use(desk: Desk, kind: str) -> None:
    """Choose the tool for joints and the kind of joint."""
    desk.tool("joint")
    desk.page.click(f".strip:not([hidden]) [data-value={kind}]")


def joint(desk: Desk, name: str) -> dict[str, Any] | None:
    """Return a joint of the scene as the page shows it."""
    desk.settled()
    found: dict[str, Any] | None = (desk.state["scene"].get("joints") or {}).get(name)
    return found


def reads(desk: Desk, folder: Path) -> pipeline.Scene:
    """Return the scene that the text of the page describes."""
    path = folder / "copy.yaml"
    path.write_text(desk.text, encoding="utf-8")
    return pipeline.load(path)


def test_two_clicks_tie_two_objects(desk: Desk, tmp_path: Path) -> None:
    before = desk.text
    use(desk, "rope")
    desk.click((120, 120))
    assert joint(desk, "rope") is None
    desk.click((180, 40))
    rope = joint(desk, "rope")
    assert rope is not None
    assert rope["objects"] == ["ball", "hook"]
    assert rope["rope"] == [[120, 120], [180, 40]]
    assert "rope: [[120, 120], [180, 40]]" in desk.text
    (read,) = reads(desk, tmp_path).joints
    assert read.objects == ("ball", "hook")
    away = np.hypot(*(desk.way("ball")[:, :2] - (180, 40)).T)
    assert away.max() == pytest.approx(100, abs=0.1)
    assert desk.way("ball")[:, 0].max() > 170  # it swings
    desk.page.keyboard.press("Control+z")
    assert joint(desk, "rope") is None
    assert desk.text == before
    assert desk.errors == []


def test_click_off_objects_ties_no_rope(desk: Desk) -> None:
    use(desk, "rope")
    desk.click((60, 250))
    desk.click((180, 40))
    desk.page.keyboard.press("Escape")
    desk.click((320, 100))
    assert joint(desk, "rope") is None


def test_object_slides_along_axis_that_was_dragged(desk: Desk, tmp_path: Path) -> None:
    use(desk, "slider")
    desk.drag((120, 120), (160, 150), (220, 180))
    slider = joint(desk, "slider")
    assert slider is not None
    assert slider["slider"] == [[120, 120], [220, 180]]
    assert "slider: [[120, 120], [220, 180]]" in desk.text
    assert reads(desk, tmp_path).joints[0].objects == ("ball",)
    way = desk.way("ball")[:, :2] - (120, 120)
    assert np.abs(way @ (60, -100)).max() < 1  # along the rail
    assert way[-1] == pytest.approx([100, 60], abs=0.5)  # to its end
    drive = desk.page.locator('[data-row="joints.slider.drive"] input')
    drive.fill("-40")
    desk.page.keyboard.press("Enter")
    slider = joint(desk, "slider")
    assert slider is not None
    assert slider["drive"] == -40
    assert desk.grave() == []
    assert desk.errors == []


def test_limits_of_a_pin_by_numbers_and_handles(desk: Desk, tmp_path: Path) -> None:
    use(desk, "pivot")
    desk.click((280, 100))
    desk.settled()
    desk.page.click("text=Limit its angle")
    pin = joint(desk, "pin")
    assert pin is not None
    assert pin["limits"] == [-45, 45]
    assert "limits: [-45, 45]" in desk.text
    assert desk.page.locator("text=Limit its angle").count() == 0
    numbers = desk.page.locator('[data-row="joints.pin.limits.1"] input')
    numbers.fill("30")
    desk.page.keyboard.press("Enter")
    pin = joint(desk, "pin")
    assert pin is not None
    assert pin["limits"] == [-45, 30]
    angle = np.degrees(desk.poses()["rod"][:, 2])
    assert angle.max() == pytest.approx(30, abs=0.1)  # it hangs at its limit
    # the handle of the largest angle, from 30 to 60 degrees below the rod
    desk.tool("move")
    unit = desk.page.evaluate("() => window.editor.stage.unit")
    turn = np.radians(np.array([30, 45, 60]))
    ring = np.stack([280 + 52 * unit * np.cos(turn), 100 + 52 * unit * np.sin(turn)])
    desk.drag(*ring.T.tolist())
    pin = joint(desk, "pin")
    assert pin is not None
    assert pin["limits"][0] == -45
    assert pin["limits"][1] == pytest.approx(60, abs=2)
    assert desk.grave() == []
    desk.page.keyboard.press("Control+z")
    pin = joint(desk, "pin")
    assert pin is not None
    assert pin["limits"] == [-45, 30]
    assert reads(desk, tmp_path).joints[0].limits is not None
    desk.page.locator('[data-row="joints.pin.limits.0"] .back').click()
    pin = joint(desk, "pin")
    assert pin is not None
    assert pin.get("limits") is None
    assert "limits" not in desk.text
    assert desk.errors == []
