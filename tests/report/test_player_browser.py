"""The player in a real browser: pixels read back, the video in step, keys, layers, fingers."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from browser import LANDS, V, ball, fallen, middle, opened, report
from pytest import approx

from physgen import pipeline
from physgen.export.video import Format

pytestmark = pytest.mark.slow

# ---- it opens, and it moves as it should ---------------------------------------------------------------------------


def test_it_opens_from_disk_and_asks_for_nothing_else(
    browser: Any, pages: Path
) -> None:
    with opened(browser, report(pages, "fall")) as seen:
        own = (pages / "fall").as_uri() + "/"
        assert {
            url.removeprefix(own) for url in seen.asked if not url.startswith("data:")
        } == {
            "report.html",
            "video.mp4",
        }
        assert seen.errors == []


def test_things_are_drawn_where_they_are(browser: Any, pages: Path) -> None:
    """A falling ball, between frames too: x = x0 + v t, y = y0 + g t² / 2."""
    with opened(browser, report(pages, "fall")) as seen:
        colour, start = ball(seen)
        for time in np.linspace(0.013, LANDS - 0.02, 7):
            shown = seen.seek(float(time))
            assert shown == approx(time, abs=1e-5)
            assert start + middle(seen.pixels(), colour, (320, 400)) == approx(
                fallen(shown), abs=0.2
            )


def test_playing_moves_it_there(browser: Any, pages: Path) -> None:
    with opened(browser, report(pages, "fall")) as seen:
        colour, start = ball(seen)
        seen.page.select_option("[data-part=rate]", "0.25")
        seen.page.click("[data-part=play]")
        seen.page.wait_for_function(
            "() => +document.getElementById('player').dataset.time > 0.1"
        )
        assert seen.playing
        assert seen.page.get_attribute("[data-part=play]", "aria-label") == "Pause"
        seen.page.click("[data-part=play]")
        seen.drawn()
        assert not seen.playing
        assert start + middle(seen.pixels(), colour, (320, 400)) == approx(
            fallen(seen.time), abs=0.2
        )


@pytest.mark.parametrize(("name", "fps", "order"), [
    ("fall", 30, list(range(45))),
    ("back", 30, list(range(44, -1, -1))),
    ("there", 20, list(range(60)) + list(range(58, -1, -1))),
])  # fmt: skip
def test_the_video_shows_the_same_moment(
    browser: Any, pages: Path, name: str, fps: int, order: list[int]
) -> None:
    """Whichever way it runs, the video stands at the frame of the moment that the player shows."""
    step = 1.5 / len(set(order))
    with opened(browser, report(pages, name), preview=False) as seen:
        assert seen.page.is_visible("video")
        assert not seen.page.is_visible("canvas")
        seen.page.wait_for_function(
            "() => document.querySelector('video').readyState >= 2"
        )
        for sample in (0, 7, len(set(order)) - 1):
            seen.seek(sample * step)
            seen.page.wait_for_function(
                "() => { const v = document.querySelector('video'); return !v.seeking; }"
            )
            at_video = seen.page.evaluate(
                "() => document.querySelector('video').currentTime"
            )
            assert order[int(at_video * fps)] == sample
        seen.page.click("[data-part=first]")
        seen.page.click("[data-part=play]")
        seen.page.wait_for_function(
            "() => { const v = document.querySelector('video'); return !v.paused && v.currentTime > 0.2; }"
        )


def test_video_and_preview_run_by_one_clock(browser: Any, pages: Path) -> None:
    """While both play, the preview shows the frame that the browser presents, or the one beside it."""
    with opened(browser, report(pages, "fall"), preview=False) as seen:
        seen.page.click("button[data-view=both]")
        seen.page.wait_for_function(
            "() => document.querySelector('video').readyState >= 2"
        )
        seen.page.click("[data-part=play]")
        off = seen.page.evaluate("""() => new Promise((done) => {
            const video = document.querySelector("video"), root = document.getElementById("player"), found = [];
            const look = (now, { mediaTime }) => requestAnimationFrame(() => {
              found.push(Math.abs(+root.dataset.time - mediaTime) * 30);
              if (found.length < 40) video.requestVideoFrameCallback(look); else done(found);
            });
            video.requestVideoFrameCallback(look);
        })""")
        assert seen.playing
        # Where the video starts again, the difference is larger than 40 frames. A busy
        # browser drops single frames.
        late = [one for one in off if 1.01 <= one < 40]
        assert len(late) <= 2
        assert np.median(off) < 0.01


def test_a_break_looks_as_the_renderer_draws_it(
    browser: Any, bundled: Path, tmp_path: Path
) -> None:
    """Balls that roll in space, shadows that go with them: nearly what the video shows, frame for frame."""
    file, edits = (
        bundled / "billiards" / "scene.yaml",
        ["world.duration=0.5", "render.motion_blur=0"],
    )
    scene = pipeline.load(file, edits)
    folder = pipeline.render_scene(
        file, tmp_path, overrides=edits, formats=[Format.PNG]
    )
    radius = 20
    with opened(browser, folder / "report.html") as seen:
        for sample in (4, 9, 14):
            shown = seen.seek(sample / 30)
            pixels = seen.pixels()[..., :3]
            true = cv2.cvtColor(
                cv2.imread(str(folder / "frames" / f"{sample:05}.png")),
                cv2.COLOR_BGR2RGB,
            )
            true = cv2.resize(
                true, pixels.shape[1::-1], interpolation=cv2.INTER_AREA
            ).astype(np.float64)
            assert np.abs(pixels - true).mean() < 3
            large = pixels.shape[1] / scene.size[0]
            run = pipeline.simulate(
                pipeline.compile(scene, pipeline.percepts(scene)).world
            )
            assert run.times[sample] == approx(shown, abs=1e-6)
            off = []
            for x, y in run.poses[sample, :, :2]:
                rows, columns = np.indices(pixels.shape[:2])
                ball = (
                    np.hypot(
                        (columns + 0.5) / large - 0.5 - x,
                        (rows + 0.5) / large - 0.5 - y,
                    )
                    < 0.9 * radius
                )
                off.append(np.abs(pixels - true)[ball].mean())
            assert np.median(off) < 12
            assert max(off) < 30


# ---- hands -----------------------------------------------------------------------------------------------------------


def test_keys(browser: Any, pages: Path) -> None:
    frame = 1 / 30
    with opened(browser, report(pages, "fall")) as seen:
        press = seen.page.keyboard.press
        for key, time in (
            (".", frame),
            (".", 2 * frame),
            (",", frame),
            ("End", 44 * frame),
            ("Home", 0.0),
        ):
            press(key)
            assert seen.time == approx(time, abs=2e-6), key
        press("ArrowRight")
        assert seen.time == approx(4.4 * frame, abs=1e-5)
        press(" ")
        assert seen.playing
        press(" ")
        assert not seen.playing
        rate = "() => +document.querySelector('[data-part=rate]').value"
        press("[")
        assert seen.page.evaluate(rate) == 0.5
        press("]")
        assert seen.page.evaluate(rate) == 1
        seen.page.focus("[data-part=seek]")
        press("Home")
        press("ArrowRight")
        assert seen.time == approx(frame, abs=2e-6), "on the slider an arrow is a frame"


@pytest.mark.parametrize(
    "layer",
    [
        "outlines",
        "pieces",
        "boundaries",
        "velocities",
        "forces",
        "contacts",
        "trails",
        "ids",
    ],
)
def test_a_layer_is_drawn_and_goes(browser: Any, pages: Path, layer: str) -> None:
    """What is drawn lies where its thing is, and without it the picture is the same again."""
    with opened(browser, report(pages, "fall")) as seen:
        now = seen.seek(LANDS + 0.01)
        button = f"[data-layer={layer}]"
        before = seen.pixels()
        assert seen.page.get_attribute(button, "aria-pressed") == "false"
        seen.page.click(button)
        seen.drawn()
        assert seen.page.get_attribute(button, "aria-pressed") == "true"
        changed = (np.abs(seen.pixels() - before).max(axis=2) > 40) * 1.0
        large = before.shape[1] / 320
        x, y = 60 + V * now, 380 - 18
        reach = 70 if layer == "forces" else 30
        box = {
            "boundaries": (0, 320, 374, 386),
            "pieces": (205, 275, 315, 385),
            "trails": (55, x + 3, 45, 385),
        }.get(layer, (x - reach, x + reach, y - reach, y + reach))
        x0, x1, y0, y1 = (max(0, int((v + 0.5) * large)) for v in box)
        assert changed[y0:y1, x0:x1].sum() > 40
        seen.page.click(button)
        seen.drawn()
        assert np.array_equal(seen.pixels(), before)
