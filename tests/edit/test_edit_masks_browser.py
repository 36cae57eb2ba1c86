"""Masks put right in a real browser, held against the studio's truth and against the geometry of what was drawn."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import yaml
from desk import Desk, seated
from numpy.typing import NDArray

from physgen.pipeline import load

pytestmark = pytest.mark.slow

SCENE = "rubber-balls"
BALL, MASK, CENTRE, RADIUS = "red-ball", 2, (140.97, 105.94), 24.93
"""One of its balls; the studio knows it to the pixel."""
Bits = NDArray[np.bool_]


@pytest.fixture
def scene(copied: Callable[[str], Path]) -> Path:
    return copied(SCENE)


def stored(scene: Path, number: int = MASK) -> Bits:
    """Of the maps on disk."""
    assets = yaml.safe_load(scene.read_text())["assets"]
    labels = cv2.imread(str(scene.parent / assets / "masks.png"), cv2.IMREAD_UNCHANGED)
    return np.asarray(labels == number)


def shown(served: Any, name: str = BALL) -> Bits:
    """What the page is given of a mask."""
    answer = served.client.get("/api/mask", params={"object": name})
    assert answer.status_code == 200, answer.text
    return np.asarray(
        cv2.imdecode(np.frombuffer(answer.content, np.uint8), cv2.IMREAD_GRAYSCALE)
        > 127
    )


def overlap(one: Bits, other: Bits) -> float:
    return float((one & other).sum() / (one | other).sum())


def masking(desk: Desk, way: str, name: str | None = BALL) -> None:
    desk.page.evaluate(
        "name => window.editor.choose(name && {kind: 'object', name})", name
    )
    if desk.page.get_attribute("[data-tool=mask]", "aria-pressed") != "true":
        desk.tool("mask")
    desk.page.click(f"[data-way={way}]")
    if name:  # its pixels are there
        desk.page.wait_for_function(
            "name => document.body.dataset.cover === name", arg=name
        )
    desk.drawn()


def done(desk: Desk) -> None:
    desk.page.wait_for_function("() => !document.querySelector('.mask-strip.busy')")
    desk.settled()


def sized(desk: Desk, radius: int) -> None:
    """The brush."""
    desk.page.evaluate(
        "r => { const s = document.querySelector('.mask-size input'); s.value = r;"
        " s.dispatchEvent(new Event('input', {bubbles: true})); }",
        radius,
    )


def along(
    a: tuple[float, float],
    b: tuple[float, float],
    radius: float,
    shape: tuple[int, ...],
) -> Bits:
    """Pixels whose middle is within a radius of a line between two points."""
    y, x = np.mgrid[: shape[0], : shape[1]].astype(float)
    d = np.subtract(b, a)
    t = np.clip(((x - a[0]) * d[0] + (y - a[1]) * d[1]) / max(d @ d, 1e-12), 0, 1)
    return np.asarray(np.hypot(x - a[0] - t * d[0], y - a[1] - t * d[1]) <= radius)


def test_a_box_puts_a_wrong_mask_right(
    browser: Any, serving: Callable[..., Any], scene: Path
) -> None:
    """Half of a ball was found; after a loose box its mask is the studio's, in the page, on disk and in the shape."""
    truth = stored(scene)
    labels = cv2.imread(
        str(scene.parent / "photo.assets" / "masks.png"), cv2.IMREAD_UNCHANGED
    )
    half = truth & (np.arange(truth.shape[1]) > CENTRE[0])
    labels[truth & ~half] = 0
    cv2.imwrite(str(scene.parent / "photo.assets" / "masks.png"), labels)
    served = serving(scene)
    assert overlap(shown(served), truth) < 0.55
    with seated(browser, served.address) as desk:
        masking(desk, "box")
        x, y = CENTRE
        desk.drag((x - 31, y - 29), (x + 33, y + 30))
        done(desk)
        assert overlap(shown(served), truth) > 0.94
        desk.page.click("[data-part=undo]")
        desk.settled()
        assert (shown(served) == half).all()
        desk.page.click("[data-part=redo]")
        desk.settled()
        assert (stored(scene) == half).all(), "not saved yet"
        desk.page.keyboard.press("Control+s")
        desk.page.wait_for_function("() => window.editor.state.file.saved")
        assert desk.errors == []
    assert overlap(stored(scene), truth) > 0.94
    ball = next(item for item in load(scene).objects if item.name == BALL)
    assert ball.mass == 95, "set by hand, so it stays"
    assert "label: red rubber ball" in scene.read_text(encoding="utf-8")


def test_a_click_chooses_and_a_label_gives_the_keys_back(desk: Desk) -> None:
    """What was set by hand stays under another label, which is said; the keys are the tools' again after Enter."""
    masking(desk, "box", None)
    desk.click(CENTRE)
    assert desk.page.evaluate("() => window.editor.selected") == {
        "kind": "object",
        "name": BALL,
    }
    desk.page.fill(".mask-label input", "steel ball")
    desk.page.press(".mask-label input", "Enter")
    done(desk)
    assert "its numbers are unchanged" in desk.page.inner_text("[data-part=status]")
    assert desk.page.inner_text("#panel-object .about") == "steel ball"
    desk.page.keyboard.press("4")
    assert desk.page.get_attribute("[data-way=eraser]", "aria-checked") == "true"
    assert desk.state["scene"]["objects"][BALL]["label"] == "steel ball"
    assert desk.errors == []


def test_brush_and_eraser_take_what_they_touch(desk: Desk, served: Any) -> None:
    before = shown(served)
    x, y = (round(value) for value in CENTRE)
    masking(desk, "eraser")
    sized(desk, 5)
    a, b = (x - 12, y + 10), (x + 16, y + 10)
    desk.drag(a, b)
    done(desk)
    gone = before & ~shown(served)
    want = along(a, b, 5, before.shape) & before
    assert overlap(gone, want) > 0.93, "a mouse is exact to a pixel of the screen"
    desk.page.click("[data-way=brush]")
    desk.drag(a, b)
    done(desk)
    assert (shown(served) & before).sum() > before.sum() - 12
    # by keys: the cursor begins in the middle, so what is wiped is known to the pixel
    desk.page.keyboard.press("4")
    for _ in range(2):
        desk.page.keyboard.press("[")
    assert desk.page.inner_text(".mask-size output") == "6 px"
    now = shown(served)
    at = desk.page.evaluate(
        "name => window.editor.state.derived.objects[name].centre.map(Math.round)", BALL
    )
    desk.page.evaluate("() => window.editor.useTool('push')")
    desk.page.keyboard.press("m")
    desk.page.wait_for_function(
        "name => document.body.dataset.cover === name", arg=BALL
    )
    desk.page.keyboard.press("Space")
    for _ in range(8):
        desk.page.keyboard.press("ArrowRight")
    desk.page.keyboard.press("Space")
    done(desk)
    gone = now & ~shown(served)
    assert (gone == (along(tuple(at), (at[0] + 8, at[1]), 3, now.shape) & now)).all()
    assert desk.errors == []
