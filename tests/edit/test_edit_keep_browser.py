"""What is kept, in a real browser: a server killed, a second window, a file written elsewhere."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from desk import Desk, seated

from physgen.pipeline import load

pytestmark = pytest.mark.slow

SCENE = """\
# a scene with remarks
physgen: 1
size: [320, 240]
world:
  duration: 0.5   # short
objects:
  # the one that flies
  ball:
    shape: {circle: {center: [60, 50], radius: 18}}
    mass: 50    # spaces as somebody likes them
  box:
    shape: {box: {center: [220, 200], size: [40, 40]}}
    mass: 200
boundaries: {floor: {segment: [[0, 220], [320, 220]]}}   # kept in one line
"""


def edit(desk: Desk, path: str, value: object, *, wait: bool = True) -> None:
    """An edit as the page's panels make it."""
    desk.page.evaluate(
        "([path, value]) => { window.editor.edit([{set: path.split('.'), value}], `set ${path}`); }",
        [path, value],
    )
    if wait:
        desk.settled()


def banner(desk: Desk, name: str) -> str:
    desk.page.wait_for_selector(f"[data-banner={name}]")
    return str(desk.page.inner_text(f"[data-banner={name}] p"))


def gone(desk: Desk, name: str) -> None:
    desk.page.wait_for_selector(f"[data-banner={name}]", state="detached")


def until(desk: Desk, what: str) -> None:
    """Wait for what is said of the State `s`."""
    desk.page.wait_for_function(
        f"() => {{ const s = window.editor.state; return {what}; }}"
    )


def words(desk: Desk, said: str) -> None:
    """Wait for what stands beside the file's name."""
    desk.page.wait_for_function(
        "said => document.querySelector('[data-part=saved]').textContent === said",
        arg=said,
    )


def answer(desk: Desk, value: str) -> None:
    """To the dialog that is open."""
    desk.page.click(f"dialog[open] [data-value={value}]")


def test_a_killed_server_is_named_and_all_that_it_answered_is_kept(
    browser: Any, killable: Callable[..., Any], scene: Path
) -> None:
    served = killable(scene)
    with seated(browser, served.address) as desk:
        edit(desk, "objects.ball.mass", 75)
        served.kill()
        assert "physgen edit" in banner(desk, "link")
        edit(desk, "objects.box.mass", 300)  # refused, and said so
        desk.page.wait_for_selector("[data-part=alarm] >> text=does not answer")
        again = killable(scene)
        other = Desk(desk.page.context.new_page())
        other.page.goto(again.address)
        other.ready()
        assert "not saved" in banner(other, "recovered")
        assert other.state["text"] == SCENE.replace("mass: 50 ", "mass: 75 ")
        other.page.click("[data-banner=recovered] >> text=Back to the saved file")
        until(other, "s.file.saved")
        assert other.state["text"] == SCENE


def test_leaving_with_work_that_is_not_saved_asks(desk: Desk) -> None:
    asked: list[str] = []
    desk.page.on("dialog", lambda d: (asked.append(d.type), d.dismiss()))
    desk.page.click("#tab-yaml")
    edit(desk, "objects.ball.mass", 75)
    words(desk, "saved as draft")
    desk.page.close(run_before_unload=True)
    desk.page.wait_for_timeout(200)
    assert asked == ["beforeunload"]
    desk.page.keyboard.press("Control+s")
    until(desk, "s.file.saved")
    words(desk, "saved")
    with desk.page.expect_event("close"):
        desk.page.close(run_before_unload=True)
    assert asked == ["beforeunload"]


def test_what_another_program_writes_is_taken_or_asked_about(
    desk: Desk, scene: Path
) -> None:
    # nothing was done here: it is taken as it is
    theirs = SCENE.replace("duration: 0.5", "duration: 0.7")
    scene.write_text(theirs, encoding="utf-8")
    assert "its text is shown now" in banner(desk, "taken")
    until(desk, "s.scene.world.duration === 0.7 && s.file.saved")
    assert desk.state["undo"] == "changed by another program"
    # both changed it: asked, and the one that was not taken stays in the history
    edit(desk, "objects.box.mass", 300)
    scene.write_text(theirs.replace("mass: 200", "mass: 250"), encoding="utf-8")
    assert "while you edited it" in banner(desk, "outside")
    desk.page.click("text=Choose …")
    desk.page.wait_for_selector("dialog[open]")
    assert desk.grave("dialog") == []
    desk.page.keyboard.press("Escape")  # not now
    assert "mass: 250" in scene.read_text(encoding="utf-8")
    desk.page.click("text=Choose …")
    answer(desk, "theirs")
    until(desk, "s.scene.objects.box.mass === 250 && s.file.outside === null")
    desk.page.click("[data-part=undo]")
    until(desk, "s.scene.objects.box.mass === 300")
    desk.page.keyboard.press("Control+s")
    until(desk, "s.file.saved")
    assert "mass: 300" in scene.read_text(encoding="utf-8")
    # gone altogether
    scene.unlink()
    assert "no longer in its folder" in banner(desk, "outside")
    desk.page.click('[data-banner=outside] button:text-is("Save")')
    until(desk, "s.file.saved && s.file.outside === null")
    assert "mass: 300" in scene.read_text(encoding="utf-8")
    assert desk.errors == []


def test_variants_are_tabs(desk: Desk, scene: Path) -> None:
    """What is done in one is written there, and the scene itself stays."""

    def named(text: str) -> None:
        desk.page.fill("dialog[open] input", text)
        desk.page.keyboard.press("Enter")

    def tabs() -> list[str]:
        return list(
            desk.page.eval_on_selector_all(
                ".variant-tab", "all => all.map(t => t.textContent)"
            )
        )

    desk.page.click("[aria-label='New variant']")
    assert desk.grave("dialog") == []
    named("2 much")
    assert "starts with a letter" in desk.page.inner_text("dialog [role=alert]")
    named("heavy")
    until(desk, "s.variant === 'heavy'")
    desk.settled()
    edit(desk, "objects.ball.mass", 500)
    assert "variants:\n  heavy" in desk.state["text"]
    assert "mass: 50 " in desk.state["text"]
    assert desk.state["scene"]["objects"]["ball"]["mass"] == 500
    desk.page.click("[aria-label='This variant']")
    desk.page.click("text=Duplicate …")
    named("heavier")
    until(desk, "s.variant === 'heavier'")
    desk.settled()
    edit(desk, "objects.ball.mass", 900)
    desk.page.keyboard.press("Control+s")
    until(desk, "s.file.saved")
    desk.settled()
    assert desk.state["variant"] == "heavier", "saving does not leave it"
    desk.page.focus(".variant-tab[aria-selected=true]")
    desk.page.keyboard.press("F2")
    named("lead")
    until(desk, "s.variant === 'lead'")
    assert tabs() == ["scene", "heavy", "lead"]
    desk.page.focus(".variant-tab[aria-selected=true]")
    for want in ("heavy", None):
        desk.page.keyboard.press("ArrowLeft")
        desk.page.wait_for_function("want => window.editor.variant === want", arg=want)
    until(desk, "s.scene.objects.ball.mass === 50")
    desk.page.keyboard.press("End")
    desk.page.wait_for_function("() => window.editor.variant === 'lead'")
    desk.page.keyboard.press("Delete")
    answer(desk, "true")
    desk.page.wait_for_function("() => window.editor.state.variants.join() === 'heavy'")
    desk.settled()
    desk.page.keyboard.press("Control+s")
    until(desk, "s.file.saved")
    assert desk.errors == []
    assert load(scene, variant="heavy").objects[0].mass == 500
    assert load(scene).objects[0].mass == 50
    assert scene.read_text(encoding="utf-8").startswith(SCENE)
