"""A real browser for tests: Debian's Chromium, driven by Playwright, with everything that it complains of kept."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
DESK = {"width": 1280, "height": 900}
PHONE = {"width": 390, "height": 844}


def chromium() -> str:
    """Where it is; the message of what to do where it is not."""
    found = os.environ.get("PHYSGEN_CHROMIUM") or next(filter(None, map(shutil.which, NAMES)), None)
    assert found, (
        "tests of the report need Chromium: apt-get install chromium, or set PHYSGEN_CHROMIUM to its path"
    )
    return found


@contextmanager
def launched() -> Iterator[Any]:
    """A headless browser; no sandbox, since CI's root has none."""
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=chromium(), args=["--no-sandbox"])
        try:
            yield browser
        finally:
            browser.close()


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
        return float(self.page.evaluate("() => +document.getElementById('player').dataset.time"))

    @property
    def playing(self) -> bool:
        return bool(self.page.evaluate("() => document.getElementById('player').dataset.playing === 'true'"))

    def pixels(self) -> np.ndarray:
        """(h, w, 4) of the canvas, read back."""
        size, codes = self.page.evaluate(
            "() => { const c = document.querySelector('canvas');"
            " const d = c.getContext('2d').getImageData(0, 0, c.width, c.height).data; let s = '';"
            " for (let k = 0; k < d.length; k += 32768) s += String.fromCharCode(...d.subarray(k, k + 32768));"
            " return [[c.height, c.width], s]; }"
        )
        return np.frombuffer(codes.encode("latin-1"), np.uint8).reshape(*size, 4).astype(np.float64)


@contextmanager
def opened(browser: Any, file: Path, *, ready: bool = True, **how: Any) -> Iterator[Opened]:
    """A page from disk, in a fresh context; nothing moves by itself unless `reduced_motion` says otherwise."""
    context = browser.new_context(**{"viewport": DESK, "reduced_motion": "reduce", **how})
    page = context.new_page()
    seen = Opened(page)
    page.on("console", lambda m: seen.errors.append(m.text) if m.type == "error" else None)
    page.on("pageerror", lambda error: seen.errors.append(str(error)))
    page.on("request", lambda request: seen.asked.append(request.url))
    try:
        page.goto(file.as_uri())
        if ready:
            page.wait_for_selector("#player[data-ready]")
        yield seen
    finally:
        context.close()
