"""Push it and watch, in a real browser: what is dragged is written, and the motion is that of `physgen simulate`."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from browser import LOOKS, looks_like
from desk import Desk, seated
from served import simulated

pytestmark = pytest.mark.slow

GOLDEN = Path(__file__).parent.parent / "golden_pages"

G = 400.0
SCENE = f"""\
# thrown by hand
physgen: 1
size: [480, 320]
world: {{pixels_per_meter: 100, gravity: [0, {G:g}], duration: 1.0}}
objects:
  ball:  # it falls
    shape: {{circle: {{center: [120, 80], radius: 20}}}}
    mass: 50
    elasticity: 0.7
    from: {{mass: table 0.4, velocity: guess 0.2}}
  block:
    shape: {{box: {{center: [360, 270], size: [40, 60]}}}}
    mass: 200
boundaries:
  floor: {{segment: [[-500, 300], [980, 300]], friction: 0.4}}
forces:
  - {{object: block, impulse: [-2000, 0]}}
"""


def saved(desk: Desk, scene: Path) -> dict[str, Any]:
    """The file, after Save."""
    desk.settled()
    desk.page.click("[data-part=save]")
    desk.page.wait_for_function(
        "() => window.editor.state.file.saved && !window.editor.pending"
    )
    return dict(yaml.safe_load(scene.read_text(encoding="utf-8")))


def agreeing(desk: Desk, scene: Path) -> dict[str, np.ndarray]:
    """Poses of the page, which are those of the command to the bit."""
    shown, run = desk.poses(), simulated(scene)
    assert shown.keys() == set(run.names)
    for k, name in enumerate(run.names):
        np.testing.assert_array_equal(shown[name], run.poses[:, k])
    return shown


def test_a_dragged_arrow_is_the_velocity_and_the_page_shows_the_true_motion(
    desk: Desk, scene: Path
) -> None:
    desk.drag((120, 80), (160, 60), (200, 40))
    desk.settled()
    vx, vy = desk.state["scene"]["objects"]["ball"]["velocity"]
    # as the arrow: as far right as it was dragged for each pixel as far up
    assert vx > 0
    assert vy == pytest.approx(-vx / 2, rel=0.06)
    file = saved(desk, scene)
    assert file["objects"]["ball"]["velocity"] == [vx, vy]
    assert file["objects"]["ball"]["from"] == {
        "mass": "table 0.4"
    }  # a hand edit says nothing
    assert "# it falls" in scene.read_text()
    assert "# thrown by hand" in scene.read_text()
    shown = agreeing(desk, scene)
    # before it lands, a parabola
    t = np.arange(4) / 30
    np.testing.assert_allclose(shown["ball"][:4, 0], 120 + vx * t, atol=1e-6)
    np.testing.assert_allclose(
        shown["ball"][:4, 1], 80 + vy * t + G * t**2 / 2, atol=0.2
    )
    assert desk.errors == []


def test_impulse_force_and_spin(desk: Desk, scene: Path) -> None:
    desk.drag((120, 80), (170, 80), held="Shift")
    desk.settled()
    impulse = desk.state["scene"]["forces"][1]
    assert impulse["object"] == "ball"
    assert impulse["impulse"][0] > 0
    assert impulse["impulse"][1] == 0
    assert "at" not in impulse  # pressed at its centre
    desk.drag((360, 250), (360, 200), held="Alt")
    desk.settled()
    force = desk.state["scene"]["forces"][2]
    assert force["object"] == "block"
    assert force["force"][1] < 0
    assert force["duration"] == 0.2
    assert force["at"] == pytest.approx([360, 250], abs=1.5)
    x, y = desk.page.evaluate(
        "() => { const p = window.editor.stage.poseOf('block', 0);"
        " return [p.x, p.y - window.editor.state.derived.objects.block.reach - 26 * window.editor.stage.unit]; }"
    )
    desk.drag((x, y), (x + 30, y + 8), (x + 45, y + 30))
    desk.settled()
    assert desk.state["scene"]["objects"]["block"]["spin"] > 0  # +x towards +y
    # the impulse that the file had is replaced, not joined by another
    desk.drag((360, 270), (320, 270), held="Shift")
    desk.settled()
    forces = desk.state["scene"]["forces"]
    assert len(forces) == 3
    assert forces[0]["impulse"][0] != -2000
    saved(desk, scene)
    agreeing(desk, scene)


def test_each_drag_is_one_step_back_and_an_arrow_can_be_changed_by_its_tip(
    desk: Desk,
) -> None:
    text = desk.state["text"]
    desk.drag((120, 80), (180, 80), steps=12)
    desk.settled()
    first = desk.state["scene"]["objects"]["ball"]["velocity"]
    desk.drag((180, 80), (180, 110))  # the tip is where the pointer let go
    desk.settled()
    second = desk.state["scene"]["objects"]["ball"]["velocity"]
    assert second[0] == pytest.approx(first[0], rel=0.05)
    assert second[1] > 0
    desk.page.keyboard.press("Control+z")
    desk.settled()
    assert desk.state["scene"]["objects"]["ball"]["velocity"] == first
    desk.page.keyboard.press("Control+z")
    desk.settled()
    assert desk.state["text"] == text
    assert desk.state["undo"] is None
    desk.page.keyboard.press("Control+y")
    desk.settled()
    assert desk.state["scene"]["objects"]["ball"]["velocity"] == first


@pytest.mark.parametrize("look", LOOKS)
def test_nothing_lies_over_the_photo(
    browser: Any,
    serving: Callable[..., Any],
    scene: Path,
    look: str,
    pytestconfig: pytest.Config,
) -> None:
    """Messages, warnings and controls cover no object, first steps lie over the canvas; the page looks as it did."""
    with seated(browser, serving(scene).address, hint=True, **LOOKS[look]) as desk:
        desk.page.evaluate(
            "() => { window.editor.say('Nothing', 'error'); document.querySelector('.stale').hidden = false; }"
        )
        desk.page.evaluate("() => window.editor.watched")  # all is simulated
        desk.drawn()
        photo = desk.page.locator("[data-part=scene]").bounding_box()
        seen = []
        assert desk.page.locator(".stage > .hint").is_visible()
        for part in (".alarm", ".stale", ".zoom", ".light", ".strip"):
            for box in filter(
                None, (one.bounding_box() for one in desk.page.locator(part).all())
            ):
                seen.append(part)
                apart = [
                    box[at] + box[size] <= photo[at]
                    or photo[at] + photo[size] <= box[at]
                    for at, size in (("x", "width"), ("y", "height"))
                ]
                assert any(apart), f"{part} lies over the photo"
        assert {".alarm", ".stale", ".zoom", ".strip"} <= set(seen)
        names = desk.page.evaluate(
            "() => [...document.querySelectorAll('button, summary, select, input')].filter(e => e.offsetParent)"
            ".filter(e => !e.innerText?.trim() && !e.title && !e.labels?.length && !e.getAttribute('aria-label'))"
            ".map(e => e.outerHTML)"
        )
        assert names == [], "controls without a name"
        desk.page.evaluate(
            "() => { document.querySelector('[data-part=name]').textContent = 'scene'; }"
        )
        assert (
            looks_like(
                desk.page,
                GOLDEN / f"editor-{look}.webp",
                renew=pytestconfig.getoption("force_regen"),
            )
            == ""
        )
