"""The tools of the editor's page while it opens, by keys, and on objects that are known."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from browser import PHONE
from desk import WIDE, Desk, seated, watched

pytestmark = pytest.mark.slow

NAME, CENTRE = "red-ball", (140.97, 105.94)
OTHER, OTHER_CENTRE = "foam-ball", (317.5, 107.2)
SEGMENTED = 240_000
"""ms: the first point of a photo segments all of it."""
WAYS = ("box", "point", "brush", "eraser", "polygon", "split", "merge", "new")


@pytest.fixture
def scene(copied: Callable[[str], Path]) -> Path:
    return copied("rubber-balls")


@pytest.fixture
def opening(browser: Any, served: Any) -> Iterator[tuple[Desk, list[Any]]]:
    """A page whose state does not come before the test lets it through."""
    waiting: list[Any] = []
    context = browser.new_context(viewport=WIDE, reduced_motion="reduce")
    context.route("**/api/state*", lambda route: waiting.append(route))
    context.add_init_script("localStorage.setItem('physgen-edit-hint', 'seen')")
    desk = Desk(context.new_page())
    watched(desk)
    try:
        desk.page.goto(served.address)
        desk.page.wait_for_selector("[data-tool=mask]")
        yield desk, waiting
    finally:
        context.close()


def test_tools_wait_while_scene_opens(opening: tuple[Desk, list[Any]]) -> None:
    desk, waiting = opening
    tools = desk.page.eval_on_selector_all(
        "[data-tool]", "tools => tools.map(tool => tool.dataset.tool)"
    )
    for tool in tools:
        desk.tool(tool)
        desk.page.mouse.move(500, 400)
        desk.page.mouse.down()
        desk.page.mouse.move(560, 430)
        desk.page.mouse.up()
        shown = desk.page.inner_text("body")
        assert "error" not in shown.lower(), tool
    assert tools[-1] == "mask"
    early = desk.page.inner_text("#mask-words")
    desk.page.wait_for_function("() => true")
    while waiting:
        waiting.pop().continue_()
    desk.page.context.unroute("**/api/state*")
    desk.ready()
    assert desk.page.inner_text("#mask-words") != early
    assert desk.state["undo"] is None
    assert desk.errors == []


def test_digits_choose_ways_wherever_focus_is(desk: Desk) -> None:
    desk.tool("mask")
    for number, way in enumerate(WAYS, 1):
        desk.page.keyboard.press(str(number))
        assert desk.page.get_attribute(f"[data-way={way}]", "aria-checked") == "true"
    desk.choose(NAME)
    desk.page.focus(".mask-label input")
    desk.page.keyboard.press("1")
    assert desk.page.get_attribute("[data-way=new]", "aria-checked") == "true"
    assert desk.page.input_value(".mask-label input").endswith("1")
    desk.tool("push")
    desk.page.keyboard.press("2")
    desk.tool("mask")
    assert desk.page.get_attribute("[data-way=new]", "aria-checked") == "true"


@pytest.mark.parametrize("viewport", [WIDE, PHONE], ids=["desk", "phone"])
def test_point_on_known_object_chooses_it(
    browser: Any, served: Any, viewport: dict[str, int]
) -> None:
    with seated(browser, served.address, viewport=viewport) as desk:
        names = list(yaml.safe_load(served.scene.read_text())["objects"])
        assert {NAME, OTHER} <= set(names)
        desk.tool("mask")
        desk.page.click("[data-way=point]")
        desk.click(CENTRE)
        desk.page.wait_for_function(
            "name => document.body.dataset.cover === name", arg=NAME
        )
        assert NAME in desk.page.inner_text("[data-part=status]")
        assert desk.page.is_visible("[data-part=status]")
        desk.click(OTHER_CENTRE)
        desk.page.wait_for_function(
            "name => document.body.dataset.cover === name", arg=OTHER
        )
        assert desk.state["undo"] is None, "no mask was changed"
        desk.click(OTHER_CENTRE)
        desk.page.wait_for_function(
            "() => window.editor.state.undo && !document.querySelector('.mask-strip.busy')",
            timeout=SEGMENTED,
        )
        desk.settled()
        assert OTHER in desk.page.inner_text("[data-part=status]")
        assert OTHER in desk.state["undo"]
        assert list(desk.state["scene"]["objects"]) == names
        desk.page.evaluate("() => window.editor.say('wrong', 'error')")
        assert desk.page.is_visible("[data-part=alarm]")
        desk.tool("push")
        desk.page.evaluate("() => window.editor.say('right')")
        assert desk.page.is_visible("[data-part=status]")
        assert desk.errors == []


def test_objects_stay_when_view_changes(desk: Desk) -> None:
    """Without the walls that the file has, as perception finds none from above."""
    size = np.array(desk.page.evaluate("() => window.editor.stage.size()"))
    moves = [{"remove": ["boundaries", k]} for k in desk.state["scene"]["boundaries"]]
    moves += [
        {"set": ["objects", k, "velocity"], "value": [0, 0]}
        for k in desk.state["scene"]["objects"]
    ]
    moves.append({"set": ["forces"], "value": []})
    for view in ("top", "side", "top", "side"):
        if moves:
            desk.page.evaluate("ops => window.editor.edit(ops, 'bare')", moves)
            desk.settled()
        moves = []
        desk.panel("world")
        desk.page.select_option("#panel-world select >> nth=0", view)
        desk.page.wait_for_function(
            "view => window.editor.state.scene.world.view === view", arg=view
        )
        desk.settled()
        for name, path in desk.poses().items():
            assert ((path[-1, :2] > 0) & (path[-1, :2] < size)).all(), (view, name)
    assert "support" in desk.page.inner_text("[data-part=status]")
    assert desk.errors == []
