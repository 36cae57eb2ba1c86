"""The report's page in a real browser, opened from disk: pixels read back, keys, toggles, charts, who it is for."""

from __future__ import annotations

import re
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from browser import PHONE, launched, opened
from pytest import approx

from physgen import pipeline
from physgen.problems import InputError
from physgen.render.touches import between
from physgen.report.page import PARTS, failed_page
from physgen.report.video import Format
from physgen.resources import resource

G, V = 600.0, 40.0
FALL = f"""\
physgen: 1
size: [320, 400]
world: {{pixels_per_meter: 200, gravity: [0, {G:g}], duration: 1.5}}
objects:
  ball:
    shape: {{circle: {{center: [60, 50], radius: 18}}}}
    mass: 50
    elasticity: 0.8
    friction: 0
    velocity: [{V:g}, 0]
  block:
    label: </script><script>window.broken = 1</script><img src=x onerror="window.broken = 2">
    shape: {{box: {{center: [240, 350], size: [60, 60]}}}}
    mass: 200
  rung: {{shape: {{box: {{center: [250, 120], size: [80, 10]}}}}, motion: static}}
boundaries:
  floor: {{segment: [[-1000, 380], [1000, 380]], elasticity: 0.8, friction: 0.4}}
"""
LANDS = float(np.sqrt(2 * (380 - 18 - 50) / G))
LONG = """\
physgen: 1
size: [480, 300]
world: {duration: 0.5}
objects:
  a-name-as-long-as-names-may-be-with-sixty-four-letters-in-it-all:
    label: Donaudampfschifffahrtsgesellschaftskapitänsmützenabzeichenverleihungsurkunde
    shape: {circle: {center: [80, 60], radius: 22}}
    mass: 120
    from: {mass: table 0.4, label: clip 0.3}
  b:
    label: "صندوق خشبي قديم جدا من خشب الأبنوس المطعم بالعاج والصدف"
    shape: {box: {center: [240, 200], size: [60, 50]}}
  c:
    label: 非常长的标签用来检查中文换行和溢出的情况是否正常工作没有空格
    shape: {box: {center: [400, 200], size: [60, 50]}}
  d: {label: 🎱🧱👩‍👩‍👧‍👦🏳️‍🌈🎱🧱👩‍👩‍👧‍👦🏳️‍🌈🎱🧱👩‍👩‍👧‍👦🏳️‍🌈, shape: {circle: {center: [160, 60], radius: 12}}}
boundaries:
  floor: {segment: [[-100, 280], [600, 280]]}
variants:
  heavy: {objects.b.mass: 900}
"""


OUTSIDE = """() => [...document.querySelectorAll('body *')]
  .filter(e => !e.closest('.scroll, pre, svg, .unseen, .skip, [hidden], script'))
  .filter(e => [...e.childNodes].some(n => n.nodeType === 3 && n.textContent.trim()))
  .filter(e => { const b = e.getBoundingClientRect(); return b.width && (b.right > innerWidth + 1 || b.left < -1); })
  .map(e => e.outerHTML.slice(0, 120))"""
"""Elements with text of their own that reach beyond the page."""


@pytest.fixture(scope="session")
def browser() -> Iterator[Any]:
    with launched() as running:
        yield running


@pytest.fixture(scope="session")
def pages(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folders `fall`, `back`, `there`, `long-heavy`, `empty` and `one` as `physgen render` leaves them."""
    home = tmp_path_factory.mktemp("pages")
    texts = {
        "fall": FALL,
        "back": FALL + "render: {play: backward}\n",
        "there": FALL + "render: {play: there-and-back, slow: 2, fps: 20}\n",
        "empty": "physgen: 1\nsize: [160, 120]\nobjects: {}\n",
        "one": FALL + "render: {frames: 1}\n",
        "long": LONG,
    }
    for name, text in texts.items():
        (home / f"{name}.yaml").write_text(text, encoding="utf-8")
        more = {"variant": "heavy", "overrides": ["objects.c.friction=0.9"]} if name == "long" else {}
        pipeline.render_scene(home / f"{name}.yaml", home / "out", ask_chaos=name == "long", **more)
    return home / "out"


def report(pages: Path, name: str) -> Path:
    return pages / name / "report.html"


def middle(pixels: np.ndarray, colour: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """(x, y) px of the photo: the middle of all pixels that look like `colour`, of a thing that does not turn."""
    near = np.abs(pixels[..., :3] - colour).max(axis=2) < 12
    assert near.any()
    rows, columns = np.nonzero(near)
    return (np.array([columns.mean(), rows.mean()]) + 0.5) * size[0] / pixels.shape[1] - 0.5


def at(pixels: np.ndarray, x: float, y: float, size: tuple[int, int]) -> np.ndarray:
    """The colour that is drawn at a place of the photo."""
    large = pixels.shape[1] / size[0]
    return pixels[int((y + 0.5) * large), int((x + 0.5) * large), :3]


def ball(seen: Any) -> tuple[np.ndarray, np.ndarray]:
    """Its colour, and how far its centre is from the middle of that colour: its spoke has another."""
    seen.seek(0)
    colour = at(seen.pixels(), 60, 57, (320, 400))
    return colour, np.array(fallen(0)) - middle(seen.pixels(), colour, (320, 400))


def fallen(time: float) -> tuple[float, float]:
    """Where the ball is before it lands."""
    return 60 + V * time, 50 + G * time**2 / 2


# ---- it opens, and it moves as it should ---------------------------------------------------------------------------


def test_it_opens_from_disk_and_asks_for_nothing_else(browser: Any, pages: Path) -> None:
    with opened(browser, report(pages, "fall")) as seen:
        own = (pages / "fall").as_uri() + "/"
        assert {url.removeprefix(own) for url in seen.asked if not url.startswith("data:")} == {
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
            assert start + middle(seen.pixels(), colour, (320, 400)) == approx(fallen(shown), abs=0.2)


def test_playing_moves_it_there(browser: Any, pages: Path) -> None:
    with opened(browser, report(pages, "fall")) as seen:
        colour, start = ball(seen)
        seen.page.select_option("[data-part=rate]", "0.25")
        seen.page.click("[data-part=play]")
        seen.page.wait_for_function("() => +document.getElementById('player').dataset.time > 0.1")
        assert seen.playing
        assert seen.page.get_attribute("[data-part=play]", "aria-label") == "Pause"
        seen.page.click("[data-part=play]")
        seen.drawn()
        assert not seen.playing
        assert start + middle(seen.pixels(), colour, (320, 400)) == approx(fallen(seen.time), abs=0.2)


def test_it_plays_by_itself_only_where_motion_is_welcome(browser: Any, pages: Path) -> None:
    with opened(browser, report(pages, "fall"), reduced_motion="no-preference") as seen:
        seen.page.wait_for_function("() => +document.getElementById('player').dataset.time > 0")
        assert seen.playing
    with opened(browser, report(pages, "fall")) as seen:
        assert not seen.playing
        assert seen.time == 0


def test_it_goes_round_or_stops_at_the_end(browser: Any, pages: Path) -> None:
    with opened(browser, report(pages, "fall")) as seen:
        seen.page.select_option("[data-part=rate]", "2")
        seen.page.click("[data-part=loop]")
        seen.page.click("[data-part=play]")
        seen.page.wait_for_function("() => document.getElementById('player').dataset.playing === 'false'")
        assert seen.time == approx(44 / 30, abs=1e-4), "the last of 45 frames"
        seen.page.click("[data-part=loop]")
        seen.page.click("[data-part=play]")
        seen.page.wait_for_function("() => +document.getElementById('player').dataset.time < 1")
        seen.page.wait_for_function("() => +document.getElementById('player').dataset.time > 1.2")
        seen.page.wait_for_function("() => +document.getElementById('player').dataset.time < 1")
        assert seen.playing


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
    with opened(browser, report(pages, name)) as seen:
        seen.page.wait_for_function("() => document.querySelector('video').readyState >= 2")
        for sample in (0, 7, len(set(order)) - 1):
            seen.seek(sample * step)
            seen.page.wait_for_function(
                "() => { const v = document.querySelector('video'); return !v.seeking; }"
            )
            at_video = seen.page.evaluate("() => document.querySelector('video').currentTime")
            assert order[int(at_video * fps)] == sample
        seen.page.click("[data-part=first]")
        seen.page.click("[data-part=play]")
        seen.page.wait_for_function(
            "() => { const v = document.querySelector('video'); return !v.paused && v.currentTime > 0.2; }"
        )


def test_a_break_looks_as_the_renderer_draws_it(browser: Any, bundled: Path, tmp_path: Path) -> None:
    """Balls that roll in space, shadows that go with them: nearly what the video shows, frame for frame."""
    scene = pipeline.load(bundled / "billiards" / "scene.yaml", ["world.duration=0.5"])
    folder = pipeline.render_scene(
        bundled / "billiards" / "scene.yaml", tmp_path, overrides=["world.duration=0.5"], formats=[Format.PNG]
    )
    radius = 20
    with opened(browser, folder / "report.html") as seen:
        for sample in (4, 9, 14):
            shown = seen.seek(sample / 30)
            pixels = seen.pixels()[..., :3]
            true = cv2.cvtColor(cv2.imread(str(folder / "frames" / f"{sample:05}.png")), cv2.COLOR_BGR2RGB)
            true = cv2.resize(true, pixels.shape[1::-1], interpolation=cv2.INTER_AREA).astype(np.float64)
            assert np.abs(pixels - true).mean() < 3
            large = pixels.shape[1] / scene.size[0]
            run = pipeline.simulate(pipeline.compile(scene, pipeline.percepts(scene)).world)
            assert run.times[sample] == approx(shown, abs=1e-6)
            off = []
            for x, y in run.poses[sample, :, :2]:
                rows, columns = np.indices(pixels.shape[:2])
                ball = (
                    np.hypot((columns + 0.5) / large - 0.5 - x, (rows + 0.5) / large - 0.5 - y) < 0.9 * radius
                )
                off.append(np.abs(pixels - true)[ball].mean())
            assert np.median(off) < 12
            assert max(off) < 30


# ---- hands -----------------------------------------------------------------------------------------------------------


def test_keys(browser: Any, pages: Path) -> None:
    frame = 1 / 30
    with opened(browser, report(pages, "fall")) as seen:
        press = seen.page.keyboard.press
        for key, time in ((".", frame), (".", 2 * frame), (",", frame), ("End", 44 * frame), ("Home", 0.0)):
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


def test_letters_can_be_switched_off(browser: Any, pages: Path) -> None:
    with opened(browser, report(pages, "fall")) as seen:
        on = "() => document.querySelector('[data-layer=outlines]').getAttribute('aria-pressed')"
        seen.page.click(".keys summary")
        seen.page.uncheck("[data-part=keys]")
        seen.page.keyboard.press("o")
        assert seen.page.evaluate(on) == "false"
        seen.page.check("[data-part=keys]")
        seen.page.keyboard.press("o")
        assert seen.page.evaluate(on) == "true"


def test_all_can_be_reached_by_tab(browser: Any, pages: Path) -> None:
    with opened(browser, report(pages, "fall")) as seen:
        reached = set()
        for _ in range(80):
            seen.page.keyboard.press("Tab")
            reached.add(
                seen.page.evaluate(
                    "() => { const e = document.activeElement; return e.dataset.part || e.dataset.layer || ''; }"
                )
            )
        assert {"first", "back", "play", "next", "last", "seek", "rate", "loop", "outlines", "all"} <= reached


@pytest.mark.parametrize(
    "layer", ["outlines", "pieces", "boundaries", "velocities", "forces", "contacts", "trails", "ids"]
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


def test_a_finger_plays_and_scrubs(browser: Any, pages: Path) -> None:
    how = {"viewport": PHONE, "has_touch": True, "is_mobile": True, "device_scale_factor": 2}
    with opened(browser, report(pages, "fall"), **how) as seen:
        box = seen.page.locator("canvas").bounding_box()
        seen.page.touchscreen.tap(box["x"] + 50, box["y"] + 50)
        assert seen.playing
        seen.page.touchscreen.tap(box["x"] + 50, box["y"] + 50)
        assert not seen.playing
        bar = seen.page.locator("[data-part=seek]").bounding_box()
        seen.page.touchscreen.tap(bar["x"] + bar["width"] / 2, bar["y"] + bar["height"] / 2)
        assert seen.time == approx(44 / 60, abs=0.05)
        assert seen.pixels().shape[1] == approx(2 * box["width"], abs=2), "as sharp as the screen"


# ---- charts ----------------------------------------------------------------------------------------------------------


def readout(seen: Any, chart: int) -> dict[str, str]:
    rows = seen.page.evaluate(
        "n => [...document.querySelectorAll('.chart')[n].querySelectorAll('.readout > div')]"
        ".map(d => [d.querySelector('dt').textContent, d.querySelector('dd').childNodes[0].textContent])",
        chart,
    )
    return dict(rows)


def number(text: str) -> float:
    return float(text.split(" ")[0].replace("−", "-"))


def test_charts_tell_what_nature_does(browser: Any, pages: Path) -> None:
    """Of a ball that falls: v² = vx² + (g t)²; energy goes from potential to kinetic; momentum is m v."""
    t = 0.8
    with opened(browser, report(pages, "fall")) as seen:
        seen.seek(t)
        seen.page.wait_for_timeout(120)
        speed, height = readout(seen, 3), readout(seen, 4)
        assert number(speed["ball"]) == approx(np.hypot(V, G * t) / 200, rel=6e-3)
        assert speed["ball"].endswith(" m/s")
        assert number(height["ball"]) == approx((399.5 - fallen(t)[1]) / 200, rel=6e-3)
        energy = readout(seen, 1)
        joule = 1000 * 200**2
        kinetic = 0.5 * 50 * (V**2 + (G * t) ** 2) / joule
        assert {v.split(" ")[1] for v in energy.values()} == {"mJ"}
        assert number(energy["kinetic"]) / 1000 == approx(kinetic, rel=6e-3)
        assert number(energy["kinetic"]) + number(energy["potential"]) == approx(
            1000 * (0.5 * 50 * V**2 + 50 * G * (380 - 18 - 50)) / joule, rel=0.02
        )
        assert number(readout(seen, 2)["to the right"]) == approx(50 * V / (1000 * 200) * 1000, rel=6e-3)


def test_hovering_reads_and_a_click_seeks(browser: Any, pages: Path) -> None:
    with opened(browser, report(pages, "fall")) as seen:
        plot = seen.page.locator(".chart .plot").nth(3)
        plot.scroll_into_view_if_needed()
        box = plot.bounding_box()
        x = box["x"] + 56 + (box["width"] - 66) * 0.4
        seen.page.mouse.move(x, box["y"] + 40)
        told = seen.page.text_content("[data-part=when]")
        hovered = float(re.search(r"[\d.]+", told)[0])
        assert told.startswith("hovering")
        assert hovered == approx(0.4 * 44 / 30, abs=0.01)
        assert number(readout(seen, 3)["ball"]) == approx(np.hypot(V, G * hovered) / 200, rel=0.01)
        assert seen.time == 0
        seen.page.mouse.click(x, box["y"] + 40)
        assert seen.time == approx(hovered, abs=2e-3)
        seen.page.mouse.move(5, 5)
        assert seen.page.text_content("[data-part=when]").startswith("at ")


def test_objects_are_chosen(browser: Any, pages: Path) -> None:
    with opened(browser, report(pages, "fall")) as seen:
        lines = "() => document.querySelectorAll('.chart')[3].querySelectorAll('.line').length"
        seen.page.click("[data-part=all]")
        assert seen.page.evaluate(lines) == 3
        seen.page.click("[data-part=objects] button:has-text('ball')")
        assert seen.page.evaluate(lines) == 2
        assert "ball" not in readout(seen, 3)


def test_the_table_of_contacts_seeks(browser: Any, pages: Path) -> None:
    with opened(browser, report(pages, "fall")) as seen:
        seen.page.click("summary:has-text('Contacts')")
        row = (
            seen.page.locator("tr", has=seen.page.locator("bdi", has_text="ball"))
            .filter(has_text="floor")
            .first
        )
        row.locator("button").click()
        assert seen.time == approx(LANDS, abs=2e-3)


# ---- whoever reads it, whatever is in it -----------------------------------------------------------------------------


def test_a_label_is_text(browser: Any, pages: Path) -> None:
    with opened(browser, report(pages, "fall")) as seen:
        assert seen.page.evaluate("() => window.broken") is None
        assert "<script>window.broken = 1</script>" in seen.page.inner_text("#parameters")
        assert seen.errors == []


@pytest.mark.parametrize("name", ["empty", "one", "long-heavy"])
def test_other_scenes_work(browser: Any, pages: Path, name: str) -> None:
    with opened(browser, report(pages, name)) as seen:
        for key in (".", "End", " ", "o", "v", "t", "c", "i"):
            seen.page.keyboard.press(key)
        seen.drawn()
        assert seen.errors == []
        assert seen.page.is_visible("canvas")


def test_a_failed_scene_has_a_page(browser: Any, tmp_path: Path) -> None:
    (tmp_path / "bad.yaml").write_text(
        "physgen: 1\nsize: [10, 10]\nobjects: {a: {shape: auto, mass: <b>heavy</b>}}\n"
    )
    with pytest.raises(InputError) as caught:
        pipeline.load(tmp_path / "bad.yaml")
    text = (tmp_path / "bad.yaml").read_text()
    page = failed_page("bad", caught.value.problems, ["physgen", "render", "bad.yaml"], text)
    (tmp_path / "report.html").write_text(page, encoding="utf-8")
    with opened(browser, tmp_path / "report.html", ready=False) as seen:
        told = seen.page.inner_text("main")
        assert '"<b>heavy</b>" is not a number' in told
        assert seen.errors == []
        assert [u for u in seen.asked if not u.startswith(("file:", "data:"))] == []


def test_without_its_video_the_page_still_plays(browser: Any, pages: Path, tmp_path: Path) -> None:
    """As it comes by mail: the file alone."""
    shutil.copy(report(pages, "fall"), tmp_path / "report.html")
    with opened(browser, tmp_path / "report.html") as seen:
        seen.page.wait_for_selector("[data-part=missing]:visible")
        colour, start = ball(seen)
        shown = seen.seek(0.5)
        assert start + middle(seen.pixels(), colour, (320, 400)) == approx(fallen(shown), abs=0.2)
        assert [error for error in seen.errors if "ERR_FILE_NOT_FOUND" not in error] == []


def test_without_scripts_the_picture_the_video_and_the_tables_stay(browser: Any, pages: Path) -> None:
    with opened(browser, report(pages, "fall"), ready=False, java_script_enabled=False) as seen:
        for what in ("svg.photo", "video[controls]", "table.parameters", "noscript p"):
            assert seen.page.is_visible(what), what
        for what in ("canvas", "[data-part=play]", "#physics"):
            assert not seen.page.is_visible(what), what


@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("name", ["long-heavy", "fall"])
def test_axe_finds_nothing_serious(browser: Any, pages: Path, name: str, scheme: str) -> None:
    from axe_playwright_python.sync_playwright import Axe

    with opened(browser, report(pages, name), color_scheme=scheme) as seen:
        for summary in seen.page.locator("summary").all():
            summary.click()
        seen.page.wait_for_timeout(100)
        found = Axe().run(seen.page).response["violations"]
        serious = [
            (v["id"], [node["html"][:120] for node in v["nodes"]][:3])
            for v in found
            if v["impact"] in ("serious", "critical")
        ]
        assert serious == []


@pytest.mark.parametrize("width", [360, 390, 768, 1280])
@pytest.mark.parametrize("name", ["long-heavy", "fall"])
def test_nothing_flows_over(browser: Any, pages: Path, name: str, width: int) -> None:
    """No text leaves the page or is cut off by its box, but in tables and listings that scroll."""
    phone = {"has_touch": True, "is_mobile": True} if width < 500 else {}
    with opened(browser, report(pages, name), viewport={"width": width, "height": 800}, **phone) as seen:
        for summary in seen.page.locator("summary:visible").all():
            summary.click()
        assert seen.page.evaluate("() => [innerWidth, document.documentElement.scrollWidth]") == [
            width,
            width,
        ]
        out = seen.page.evaluate(OUTSIDE)
        assert out == []


def test_contacts_are_where_the_renderer_finds_them(browser: Any, tmp_path: Path) -> None:
    """The script's geometry beside the renderer's, over many poses of many shapes."""
    text = """\
physgen: 1
size: [200, 200]
objects:
  a: {shape: {circle: {center: [50, 50], radius: 12}}}
  b: {shape: {circle: {center: [90, 60], radius: 20}}}
  c: {shape: {box: {center: [150, 60], size: [40, 20], angle: 20}}}
  d: {shape: {polygon: [[60, 120], [100, 110], [120, 150], [80, 170]]}}
boundaries:
  w: {polyline: [[10, 190], [100, 180], [190, 195]]}
"""
    (tmp_path / "scene.yaml").write_text(text)
    world = pipeline.compile(pipeline.load(tmp_path / "scene.yaml"), None).world
    data = {"walls": [{"chains": [chain.tolist() for chain in wall.chains]} for wall in world.walls]}
    bodies = [
        {"rings": [ring.tolist() for ring in body.rings]}
        | ({} if body.radius is None else {"radius": body.radius})
        for body in world.bodies
    ]
    random = np.random.default_rng(3)
    cases, expected = [], []
    for _ in range(60):
        poses = np.column_stack([random.uniform(20, 180, (4, 2)), random.uniform(-4, 4, 4)])
        first, second = sorted(random.choice(5, 2, replace=False).tolist())
        points, gap = between(world, poses, first, second)
        cases.append([[{"x": x, "y": y, "a": a} for x, y, a in poses.tolist()], first, second])
        expected.append((gap, points.mean(axis=0)))
    parts = [
        resource("templates", "player", f"{part}.js").read_text()
        for part in PARTS
        if part in ("motion", "touch")
    ]
    script = "([data, bodies, cases]) => {" + "\n".join(parts)
    script += "return cases.map(([poses, one, two]) => touching(data, bodies, poses, one, two)); }"
    page = browser.new_page()
    found = page.evaluate(script, [data, bodies, cases])
    page.close()
    for got, (gap, point) in zip(found, expected, strict=True):
        assert got["gap"] == approx(gap, abs=1e-9)
        assert np.mean(got["points"], axis=0) == approx(point, abs=1e-6)
