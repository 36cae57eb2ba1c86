"""The editor's page in a real browser, with hands: what a person does there, in px of the photo."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from browser import grave, launched

__all__ = ["Desk", "launched", "seated"]

WIDE = {"width": 1440, "height": 900}
Point = Sequence[float]
QUIET = ("Failed to load resource", "net::ERR")
"""What a browser says by itself of an answer that is no, or of a server that is gone."""


@dataclass
class Desk:
    """A window of the editor, and what it complained of."""

    page: Any
    errors: list[str] = field(default_factory=list)
    asked: list[str] = field(default_factory=list)

    def ready(self) -> None:
        """Wait until the scene is there, after it was opened or loaded again."""
        self.page.wait_for_selector("body[data-ready]")
        self.page.evaluate(
            "async () => { window.editor = (await import('/static/edit/app.js')).editor; }"
        )
        self.drawn()

    @property
    def state(self) -> dict[str, Any]:
        """The State that the page shows, without what is large."""
        found: dict[str, Any] = self.page.evaluate(
            "() => { const { motion, ...rest } = window.editor.state; return rest; }"
        )
        return found

    def settled(self) -> None:
        """Wait until nothing that was done is on its way."""
        self.page.wait_for_function(
            "() => !window.editor.pending && !window.editor.typing()"
        )
        self.drawn()

    def drawn(self) -> None:
        self.page.evaluate(
            "() => new Promise(done => requestAnimationFrame(() => requestAnimationFrame(done)))"
        )

    def way(self, name: str) -> np.ndarray:
        """(T, 3) px, px, s of a body's centre, as the page shows it once all is simulated."""
        self.page.evaluate("() => window.editor.watched")
        rows = self.page.evaluate(
            "name => { const { run } = window.editor.player, b = run.motion.bodies[run.index.get(name)];"
            " return [...run.motion.times].map((t, k) => [b.x[k], b.y[k], t]); }",
            name,
        )
        return np.array(rows)

    def poses(self) -> dict[str, np.ndarray]:
        """(T, 3) px, px, rad of each body at the video's frames, as the page has them."""
        self.page.evaluate("() => window.editor.watched")
        found = self.page.evaluate(
            "() => { const { data } = window.editor.player.own;"
            " return data.bodies.map(b => [b.name, data.frames.map(k => [b.x[k], b.y[k], b.a[k]])]); }"
        )
        return {name: np.array(rows) for name, rows in found}

    def at(self, point: Point) -> tuple[float, float]:
        """A point of the photo -> one of the window."""
        x, y = self.page.evaluate(
            "p => { const b = document.querySelector('[data-part=over]').getBoundingClientRect();"
            " const [x, y] = window.editor.stage.screen(p); return [x + b.left, y + b.top]; }",
            list(point),
        )
        return float(x), float(y)

    def drag(self, *points: Point, held: str | None = None, steps: int = 6) -> None:
        """Press at the first, go by way of the others, let go at the last."""
        mouse, keys = self.page.mouse, self.page.keyboard
        if held:
            keys.down(held)
        mouse.move(*self.at(points[0]))
        mouse.down()
        for point in points[1:]:
            mouse.move(*self.at(point), steps=steps)
        mouse.up()
        if held:
            keys.up(held)

    def click(self, point: Point) -> None:
        self.page.mouse.click(*self.at(point))

    def choose(self, name: str) -> None:
        self.page.evaluate("name => window.editor.select(name)", name)

    def tool(self, name: str) -> None:
        self.page.click(f"[data-tool={name}]")

    def panel(self, name: str) -> None:
        self.page.click(f"#tab-{name}")

    @property
    def text(self) -> str:
        """What stands in the YAML panel."""
        return str(self.page.input_value("[data-part=yaml]"))

    def put_caret(self, before: str, *, after: int = 0) -> None:
        """Into the YAML panel, where `before` begins first, and so many letters on."""
        self.page.evaluate(
            "([text, on]) => { const f = document.querySelector('[data-part=yaml]');"
            " const at = f.value.indexOf(text) + on; f.focus(); f.setSelectionRange(at, at); }",
            [before, after],
        )

    def grave(self, selector: str = "body") -> list[str]:
        """What axe finds seriously wrong below a selector."""
        return grave(self.page, selector)


@contextmanager
def seated(
    browser: Any,
    address: str,
    *,
    hint: bool = False,
    held: tuple[str, Any] | None = None,
    **how: Any,
) -> Iterator[Desk]:
    """The page at an address with its token, in a fresh context, ready; nothing moves by itself.

    `held`: requests to such an address go through a function, which may let them wait.
    """
    context = browser.new_context(
        **{"viewport": WIDE, "reduced_motion": "reduce", **how}
    )
    if held is not None:
        context.route(*held)
    if not hint:
        context.add_init_script("localStorage.setItem('physgen-edit-hint', 'seen')")
    context.set_default_timeout(30_000)
    desk = Desk(context.new_page())
    watched(desk)
    try:
        desk.page.goto(address)
        desk.ready()
        yield desk
    finally:
        context.close()


def watched(desk: Desk) -> None:
    """Keep what the page complains of, and what it asks for."""
    page = desk.page
    loud = lambda m: m.type == "error" and not any(q in m.text for q in QUIET)  # noqa: E731
    page.on("console", lambda m: desk.errors.append(m.text) if loud(m) else None)
    page.on("pageerror", lambda error: desk.errors.append(str(error)))
    page.on("request", lambda request: desk.asked.append(request.url))
