"""Boundaries, joints and fields drawn on the photo in a real browser, and things picked up and put elsewhere."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from desk import Desk, seated
from served import simulated

pytestmark = pytest.mark.slow

SCENE = """\
physgen: 1
size: [480, 320]
world: {pixels_per_meter: 100, gravity: [0, 980], duration: 1.5}
objects:
  ball:
    shape: {circle: {center: [120, 80], radius: 20}}
    mass: 50
    elasticity: 0.2
  block:
    shape: {box: {center: [360, 130], size: [40, 60]}}
    mass: 200
  wedge:
    shape: {polygon: [[220, 100], [260, 100], [240, 70]]}
    mass: 30
"""


def test_what_falls_lands_on_a_floor_that_was_drawn(desk: Desk) -> None:
    assert desk.way("ball")[-1, 1] > 900  # nothing holds it
    desk.tool("wall")
    desk.drag((30, 281), (200, 280), (450, 280))
    desk.settled()
    ((name, floor),) = desk.state["scene"]["boundaries"].items()
    (x0, y0), (_x1, y1) = floor["segment"]
    assert name == "floor"
    assert y0 == y1 == pytest.approx(281, abs=1)
    assert desk.way("ball")[-1, 1] == pytest.approx(y0 - 20, abs=0.5)
    # dragged by an end it becomes a slope, and the ball rolls down it
    desk.tool("move")
    desk.drag((x0, y0), (x0, y0 - 60))
    desk.settled()
    assert desk.state["scene"]["boundaries"]["floor"]["segment"][0][1] == pytest.approx(
        y0 - 60, abs=1
    )
    assert desk.way("ball")[-1, 0] > 200
    # all of it, by its middle
    desk.drag((430, 278), (430, 298))
    desk.settled()
    moved = desk.state["scene"]["boundaries"]["floor"]["segment"]
    assert moved[1][1] == pytest.approx(y1 + 20, abs=1.5)
    desk.page.keyboard.press("Delete")
    desk.settled()
    assert not desk.state["scene"]["boundaries"]
    assert desk.errors == []


def test_things_are_picked_up_turned_and_put_elsewhere(desk: Desk) -> None:
    desk.tool("move")
    desk.drag((120, 80), (150, 120), (180, 150))
    desk.settled()
    objects = desk.state["scene"]["objects"]
    assert objects["ball"]["shape"]["circle"]["center"] == pytest.approx(
        [180, 150], abs=1
    )
    assert desk.way("ball")[0, :2] == pytest.approx([180, 150], abs=1)
    desk.drag((240, 90), (240, 190))
    desk.settled()
    np.testing.assert_allclose(
        desk.state["scene"]["objects"]["wedge"]["shape"]["polygon"],
        [[220, 200], [260, 200], [240, 170]],
        atol=1,
    )
    desk.click((360, 130))
    knob = desk.page.evaluate(
        "() => 130 - window.editor.state.derived.objects.block.reach - 26 * window.editor.stage.unit"
    )
    desk.drag((360, knob), (400, knob + 10), (360 + 130 - knob, 130))
    desk.settled()
    assert desk.state["scene"]["objects"]["block"]["shape"]["box"][
        "angle"
    ] == pytest.approx(90, abs=2)
    assert desk.errors == []


def colour(desk: Desk, point: tuple[float, float]) -> np.ndarray:
    """Mean sRGB of 5 x 5 pixels of what is shown around a point of the photo."""
    pixels = desk.page.evaluate(
        "([x, y]) => { const c = document.querySelector('[data-part=scene]');"
        " const s = c.width / window.editor.stage.size()[0];"
        " return [...c.getContext('2d').getImageData((x + 0.5) * s - 2, (y + 0.5) * s - 2, 5, 5).data]; }",
        list(point),
    )
    return np.array(pixels, float).reshape(-1, 4)[:, :3].mean(axis=0)


def test_what_a_photo_shows_is_put_elsewhere_with_its_picture(
    browser: Any, serving: Callable[..., Any], tmp_path: Path
) -> None:
    served = serving("kitchen")
    with seated(browser, served.address) as desk:
        blue = (74.55, 260.0)  # the carton's lid, and 110 px up beside the orange
        desk.page.wait_for_function("() => window.editor.stage.drawn()")
        desk.drawn()
        was = colour(desk, blue)
        desk.tool("move")
        desk.drag((74.55, 323.53), (140, 260), (224.55, 213.53))
        desk.settled()
        x, y, *turn = desk.state["scene"]["objects"]["carton"]["place"]
        assert (x, y) == pytest.approx((224.55, 213.53), abs=1)
        assert not turn
        assert desk.state["scene"]["objects"]["carton"]["shape"]["box"]["center"] == [
            74.55,
            323.53,
        ]
        desk.page.wait_for_function("() => window.editor.stage.drawn()")
        desk.drawn()
        np.testing.assert_allclose(
            colour(desk, (blue[0] + x - 74.55, blue[1] + y - 323.53)), was, atol=12
        )
        assert (
            np.abs(colour(desk, blue) - was).max() > 40
        )  # what is behind is seen where it was
        desk.page.click("[data-part=save]")
        desk.page.wait_for_function(
            "() => window.editor.state.file.saved && !window.editor.pending"
        )
        said = simulated(served.scene)
        np.testing.assert_array_equal(
            desk.poses()["carton"], said.poses[:, said.names.index("carton")]
        )
        assert desk.errors == []


def test_a_spring_holds_and_a_wind_blows(desk: Desk) -> None:
    desk.tool("joint")
    desk.page.click(".strip:not([hidden]) [data-value=spring]")
    desk.drag((120, 80), (120, 30))
    desk.settled()
    spring = desk.state["scene"]["joints"]["spring"]
    assert spring["objects"] == ["ball"]
    assert spring["spring"][1] == pytest.approx([120, 30], abs=1)
    seen = desk.way("ball")
    assert seen[:, 1].max() < 200  # it hangs
    # about where its weight stretches it by m g / k
    sag = 50 * 980 / spring["stiffness"]
    assert seen[:, 1].mean() == pytest.approx(80 + sag, abs=10)
    desk.page.click(".strip:not([hidden]) [data-value=pivot]")
    desk.click((360, 110))
    desk.settled()
    assert desk.state["scene"]["joints"]["pin"]["pivot"] == pytest.approx(
        [360, 110], abs=1
    )
    assert desk.way("block")[:, 1].max() < 170
    desk.tool("field")
    desk.drag((60, 200), (160, 200))
    desk.settled()
    wind = desk.state["scene"]["fields"]["wind"]
    assert wind["wind"][0] > 0
    assert wind["wind"][1] == 0
    assert wind["drag"] > 0
    assert desk.way("wedge")[-1, 0] > desk.way("wedge")[0, 0] + 20
    desk.page.locator('[data-row="joints.spring.stiffness"]').wait_for(state="detached")
    desk.page.evaluate("() => window.editor.choose({kind: 'joint', name: 'spring'})")
    desk.page.locator('[data-row="joints.spring.stiffness"] input').fill("5000")
    desk.page.keyboard.press("Enter")
    desk.settled()
    assert desk.state["scene"]["joints"]["spring"]["stiffness"] == 5000
    assert desk.errors == []
