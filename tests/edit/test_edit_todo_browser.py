"""What the photo left in doubt, in a real browser: first what is least sure, each with its fix; done ones go."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from desk import seated

from physgen.pipeline import load

pytestmark = pytest.mark.slow

SCENE = """\
physgen: 1
size: [320, 240]
world: {duration: 0.5}
objects:
  ball:
    shape: {circle: {center: [60, 50], radius: 18}}
    mass: 50
    from:
      mass: table 0.4   # a guess
  box:
    shape: {box: {center: [220, 200], size: [40, 40]}}
    mass: 200
    friction: 0.3
    from: {mass: scales 0.9, friction: table 0.2}
boundaries: {floor: {segment: [[0, 220], [320, 220]]}}
"""


def test_doubts_are_a_list_that_gets_shorter(
    browser: Any, serving: Callable[..., Any], tmp_path: Path
) -> None:
    scene = tmp_path / "scene.yaml"
    scene.write_text(SCENE, encoding="utf-8")
    served = serving(scene)
    with seated(browser, served.address) as desk:
        rows = desk.page.locator(".todo-item.doubt")
        desk.panel("todo")
        assert rows.evaluate_all("all => all.map(row => row.dataset.object)") == ["box", "ball"]
        assert "friction" in rows.first.inner_text()
        assert "mass" not in rows.first.inner_text(), "0.9 is sure enough"
        assert str(desk.page.inner_text("#tab-todo")).split()[-1] == str(len(desk.state["todo"]))
        rows.last.locator(".todo-what").click()
        assert desk.page.evaluate("() => window.editor.selected.name") == "ball"
        desk.page.evaluate("() => window.editor.select('box')")
        rows.first.locator(".act").focus()
        desk.page.keyboard.press("Enter")
        desk.page.wait_for_function("() => document.querySelectorAll('.todo-item.doubt').length === 1")
        desk.settled()
        assert desk.page.evaluate("() => document.activeElement.closest('.todo') !== null"), "on to the next"
        assert desk.page.evaluate("() => window.editor.state.todo[0].object") == "ball"
        rows.first.locator(".act").click()
        desk.page.wait_for_function("() => !document.querySelector('.todo-item.doubt')")
        desk.page.keyboard.press("Control+s")
        desk.page.wait_for_function("() => window.editor.state.file.saved")
        assert desk.errors == []
    ball, box = load(scene).objects
    assert (ball.mass, box.mass, box.friction) == (50, 200, 0.3), "the numbers stay"
    assert not ball.provenance
    assert set(box.provenance) <= {"mass"}
