"""A real browser for tests: Debian's Chromium, driven by Playwright, with everything that it complains of kept."""

from __future__ import annotations

import io
from base64 import b64decode
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from install_browser import describe_installation, find_browser

DESK = {"width": 1280, "height": 900}
PHONE = {"width": 390, "height": 844}
LOOKS: dict[str, dict[str, Any]] = {
    "1280": {"viewport": DESK},
    "390": {"viewport": PHONE},
    "dark": {"viewport": DESK, "color_scheme": "dark"},
}
"""Of golden pictures."""


def browser_path() -> str:
    """Return the path of the browser. Fail with the way to install it if there is none."""
    path = find_browser()
    assert path is not None, f"this test needs a browser: {describe_installation()}"
    return path


@contextmanager
def launched() -> Iterator[Any]:
    """A headless browser; no sandbox, since CI's root has none."""
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(
            executable_path=browser_path(), args=["--no-sandbox"]
        )
        try:
            yield browser
        finally:
            browser.close()


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
"""Of a ball that falls, px/s² and px/s; `LANDS` is when it does, s."""
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
    velocity: [60, 700]
    from: {mass: table 0.4, elasticity: table 0.3, label: clip 0.3}
  b:
    label: "صندوق خشبي قديم جدا من خشب الأبنوس المطعم بالعاج والصدف"
    shape: {box: {center: [240, 200], size: [60, 50]}}
  c:
    label: 非常长的标签用来检查中文换行和溢出的情况是否正常工作没有空格
    shape: {box: {center: [400, 200], size: [60, 50]}}
  d: {label: 🎱🧱👩‍👩‍👧‍👦🏳️‍🌈🎱🧱👩‍👩‍👧‍👦🏳️‍🌈🎱🧱👩‍👩‍👧‍👦🏳️‍🌈, shape: {circle: {center: [160, 60], radius: 12}}}
boundaries:
  floor: {segment: [[-100, 280], [600, 280]]}
light: {direction: [0.3, -0.6, 0.74], from: shadows 0.3}
variants:
  heavy: {objects.b.mass: 900}
"""


@dataclass
class Opened:
    """A page, and what it said and asked for while it was open."""

    page: Any
    errors: list[str] = field(default_factory=list)
    asked: list[str] = field(default_factory=list)

    def seek(self, time: float) -> float:
        """Set the slider; returns the time that is shown, s."""
        self.page.evaluate(
            "t => { const s = document.querySelector('[data-part=seek]');"
            " s.value = t; s.dispatchEvent(new Event('input', {bubbles: true})); }",
            time,
        )
        self.drawn()
        return self.time

    def drawn(self) -> None:
        """Wait until what was asked for is on the canvas."""
        self.page.evaluate(
            "() => new Promise(done => requestAnimationFrame(() => requestAnimationFrame(done)))"
        )

    @property
    def time(self) -> float:
        return float(
            self.page.evaluate("() => +document.getElementById('player').dataset.time")
        )

    @property
    def playing(self) -> bool:
        return bool(
            self.page.evaluate(
                "() => document.getElementById('player').dataset.playing === 'true'"
            )
        )

    def pixels(self) -> np.ndarray:
        """(h, w, 4) of the canvas, read back."""
        size, codes = self.page.evaluate(
            "() => { const c = document.querySelector('canvas');"
            " const d = c.getContext('2d').getImageData(0, 0, c.width, c.height).data; let s = '';"
            " for (let k = 0; k < d.length; k += 32768) s += String.fromCharCode(...d.subarray(k, k + 32768));"
            " return [[c.height, c.width], s]; }"
        )
        return (
            np.frombuffer(codes.encode("latin-1"), np.uint8)
            .reshape(*size, 4)
            .astype(np.float64)
        )


@contextmanager
def opened(
    browser: Any, file: Path, *, ready: bool = True, preview: bool = True, **how: Any
) -> Iterator[Opened]:
    """A page from disk, in a fresh context; nothing moves by itself unless `reduced_motion` says otherwise.

    A report shows its preview, which tests read, unless told otherwise.
    """
    context = browser.new_context(
        **{"viewport": DESK, "reduced_motion": "reduce", **how}
    )
    page = context.new_page()
    seen = Opened(page)
    page.on(
        "console", lambda m: seen.errors.append(m.text) if m.type == "error" else None
    )
    page.on("pageerror", lambda error: seen.errors.append(str(error)))
    page.on("request", lambda request: seen.asked.append(request.url))
    try:
        page.goto(file.as_uri())
        if ready:
            page.wait_for_selector("#player[data-ready]")
            if preview and page.locator("button[data-view=preview]").count():
                page.click("button[data-view=preview]")
        yield seen
    finally:
        context.close()


GRAVE = ("serious", "critical")
OUTSIDE = """() => [...document.querySelectorAll('body *')]
  .filter(e => !e.closest('.scroll, .top nav, .sheet, pre, svg, .unseen, .skip, [hidden], script, option'))
  .filter(e => [...e.childNodes].some(n => n.nodeType === 3 && n.textContent.trim()))
  .filter(e => { const b = e.getBoundingClientRect(); return b.width && (b.right > innerWidth + 1 || b.left < -1); })
  .map(e => e.outerHTML.slice(0, 120))"""
"""Elements with text of their own that reach beyond the page, but in tables and listings that scroll."""


def grave(page: Any, selector: str = "body") -> list[str]:
    """What axe finds seriously wrong below a selector."""
    from axe_playwright_python.sync_playwright import Axe

    found = Axe().run(page, context=selector).response["violations"]
    return [
        f"{row['id']}: {row['nodes'][0]['html'][:160]}"
        for row in found
        if row["impact"] in GRAVE
    ]


def overflowing(page: Any) -> list[str]:
    """Texts that leave the page, and its width where it is wider than the window."""
    wide = page.evaluate("() => [innerWidth, document.documentElement.scrollWidth]")
    return [
        *page.evaluate(OUTSIDE),
        *([] if wide[0] == wide[1] else [f"{wide[1]} px wide"]),
    ]


def unfolded(page: Any) -> None:
    """Open all that can be folded out."""
    for summary in page.locator("summary:visible").all():
        if summary.evaluate("s => !s.parentElement.open"):
            summary.click()


def report(pages: Path, name: str) -> Path:
    return pages / name / "report.html"


def middle(pixels: np.ndarray, colour: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """(x, y) px of the photo: the middle of all pixels that look like `colour`, of a thing that does not turn."""
    near = np.abs(pixels[..., :3] - colour).max(axis=2) < 12
    assert near.any()
    rows, columns = np.nonzero(near)
    return (np.array([columns.mean(), rows.mean()]) + 0.5) * size[0] / pixels.shape[
        1
    ] - 0.5


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


def picture(uri: str) -> np.ndarray:
    """(h, w, 4) of a data URI."""
    from PIL import Image

    return np.asarray(
        Image.open(io.BytesIO(b64decode(uri.partition(",")[2]))).convert("RGBA"),
        np.float64,
    )


def lay(canvas: np.ndarray, row: dict[str, Any]) -> None:
    """A cut-out or a shadow on a canvas (H, W, 3), as browsers do: coverage times colour codes."""
    left, top, wide, high = (
        round(v + e) for v, e in zip(row["box"], (0.5, 0.5, 0, 0), strict=True)
    )
    drawn = cv2.resize(
        picture(row["src"]), (wide, high), interpolation=cv2.INTER_LINEAR
    )
    y0, x0, y1, x1 = (
        max(top, 0),
        max(left, 0),
        min(top + high, len(canvas)),
        min(left + wide, canvas.shape[1]),
    )
    part = drawn[y0 - top : y1 - top, x0 - left : x1 - left]
    alpha = part[..., 3:] / 255
    canvas[y0:y1, x0:x1] = alpha * part[..., :3] + (1 - alpha) * canvas[y0:y1, x0:x1]


CELL, COARSEST = 8, 16
"""Px that a cell of a golden picture averages, and the most levels that it may differ by: letters that are smoothed
otherwise pass, and a part that has moved by 24 px fails (both are tested)."""


def looks_like(seen: Any, golden: Path, *, renew: bool = False) -> str:
    """ "" where the whole page looks like a golden picture, else what differs; what a machine decides is left out."""
    from PIL import Image, ImageFilter

    shot = Image.open(
        io.BytesIO(seen.screenshot(full_page=True, animations="disabled"))
    ).convert("RGB")
    size = -(-shot.width // CELL), -(-shot.height // CELL)
    small = shot.resize(size, Image.Resampling.BOX)
    if renew:
        golden.parent.mkdir(exist_ok=True)
        small.save(golden, lossless=True)
    true = Image.open(golden).convert("RGB")
    if abs(true.height - small.height) > 1 or true.width != small.width:
        return f"{golden.name}: {size} cells, not {true.size}"
    both = np.stack(
        [
            np.asarray(one.filter(ImageFilter.BoxBlur(1)), float)[
                : min(true.height, small.height)
            ]
            for one in (small, true)
        ]
    )
    off = np.abs(both[0] - both[1]).max(axis=2)
    row, column = np.unravel_index(off.argmax(), off.shape)
    worst = off[row, column]
    place = f"{column * CELL}, {row * CELL} px"
    return (
        ""
        if worst <= COARSEST
        else f"{golden.name}: off by {worst:.0f} levels at {place}"
    )
