"""The scene file beside its picture, in a real browser: typed, marked where it is wrong, undone, edited elsewhere."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from desk import Desk

from physgen.pipeline import load

pytestmark = pytest.mark.slow

SCENE = """\
# kept as it is
physgen: 1
size: [320, 240]
world: {duration: 0.5}   # short
objects:
  ball:
    shape: {circle: {center: [60, 50], radius: 18}}
    mass: 50
  "box-1":  # a box
    shape: {box: {center: [220, 200], size: [40, 40]}}
    mass: 200
boundaries:
  floor: {segment: [[0, 220], [320, 220]]}
variants:
  heavy: {objects.ball.mass: 500}
"""


def marks(desk: Desk, kind: str) -> list[int]:
    """Lines whose numbers are marked so."""
    found = desk.page.eval_on_selector_all(
        f".yaml-number.{kind}", "all => all.map(n => +n.textContent)"
    )
    return [int(line) for line in found]


def caret(desk: Desk) -> int:
    return int(
        desk.page.evaluate(
            "() => document.querySelector('[data-part=yaml]').selectionStart"
        )
    )


def test_what_is_typed_is_applied_and_marked_where_it_is_wrong(
    desk: Desk, served: Any
) -> None:
    desk.panel("yaml")
    assert desk.text == SCENE
    desk.put_caret("mass: 50", after=len("mass: "))
    for _ in "50":
        desk.page.keyboard.press("Delete")
    desk.page.keyboard.type("heavy")
    desk.page.wait_for_selector(".yaml-number.wrong")
    line = SCENE.splitlines().index("    mass: 50") + 1
    assert marks(desk, "wrong") == [line]
    told = desk.page.inner_text(".yaml-problems")
    assert f"line {line}" in told
    assert '"heavy" is not a number' in told
    assert "write grams" in told
    assert desk.page.get_attribute("[data-part=yaml]", "aria-invalid") == "true"
    assert caret(desk) == SCENE.index("mass: 50") + len("mass: heavy"), (
        "the caret stays where it was"
    )
    # the wave is under the word, to the pixel that the browser gives its letters
    word, wave = desk.page.evaluate(
        "() => { const wave = document.querySelector('.wave'), row = wave.parentElement, r = new Range();"
        " const w = document.createTreeWalker(row, NodeFilter.SHOW_TEXT); let n; let k = -1;"
        " while ((n = w.nextNode())) { k = n.data.indexOf('heavy'); if (k >= 0) break; }"
        " r.setStart(n, k); r.setEnd(n, k + 5);"
        " const [a, b] = [r.getBoundingClientRect(), wave.getBoundingClientRect()];"
        " return [[a.left, a.right], [b.left, b.right]]; }"
    )
    assert abs(word[0] - wave[0]) < 1.5
    assert abs(word[1] - wave[1]) < 1.5
    # the other way round: from the list to the place
    desk.page.click("[data-part=yaml]", position={"x": 60, "y": 10})
    desk.page.click(".yaml-problems button")
    assert caret(desk) == SCENE.index("mass: 50") + len("mass: ")
    for _ in "heavy":
        desk.page.keyboard.press("Delete")
    desk.page.keyboard.type("75")
    desk.page.wait_for_function("() => !document.querySelector('.yaml-number.wrong')")
    desk.settled()
    assert desk.state["scene"]["objects"]["ball"]["mass"] == 75
    assert (
        served.look()["text"] == SCENE.replace("mass: 50\n", "mass: 75\n") == desk.text
    )
    assert desk.errors == []


def kept(desk: Desk, held: list[Any], letters: str) -> None:
    """Letters are typed, and on their way once this returns: `held` has their request."""
    desk.page.keyboard.type(letters)
    while not held:
        desk.page.wait_for_timeout(20)


def test_edits_from_elsewhere_come_into_the_text_and_leave_what_is_typed(
    desk: Desk, served: Any, scene: Path
) -> None:
    desk.panel("yaml")
    desk.put_caret("mass: 200", after=len("mass: 200"))
    desk.page.evaluate(
        "() => window.editor.edit([{set: ['objects', 'ball', 'velocity'], value: [30, 0]}], 'push')"
    )
    desk.settled()
    assert "    velocity: [30, 0]\n" in desk.text
    assert caret(desk) == desk.text.index("mass: 200") + len("mass: 200"), (
        "it moved with its line"
    )
    # somebody else edits one line while another is typed: both stand
    served.look()
    desk.page.keyboard.type("0")
    served.edit({"set": ["world", "duration"], "value": 0.75})
    desk.page.wait_for_function(
        "() => /duration: 0.75/.test(window.editor.state.text) && /mass: 2000/.test(window.editor.state.text)"
    )
    desk.settled()
    text = served.look()["text"]
    assert text == desk.text
    assert open_scene_text(scene, text).world.duration == 0.75
    assert open_scene_text(scene, text).objects[1].mass == 2000
    assert text.splitlines()[0] == "# kept as it is"
    assert "# short" in text
    assert "# a box" in text


def open_scene_text(scene: Path, text: str) -> Any:
    """What the core reads of a text: another reader than the editor's."""
    other = scene.with_name("other.yaml")
    other.write_text(text, encoding="utf-8")
    return load(other)


def test_the_chosen_objects_lines_are_marked_both_ways(desk: Desk) -> None:
    desk.panel("yaml")
    desk.choose("ball")
    desk.drawn()
    assert marks(desk, "chosen") == [6, 7, 8]
    desk.put_caret('"box-1"', after=3)
    desk.page.keyboard.press("ArrowRight")
    assert desk.page.evaluate("() => window.editor.selected") == {
        "kind": "object",
        "name": "box-1",
    }
    desk.drawn()
    assert marks(desk, "chosen") == [9, 10, 11]
