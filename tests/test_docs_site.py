"""The site of docs/: built strictly, then opened in a browser: nothing is clipped, nothing comes from elsewhere."""

from __future__ import annotations

import os
import subprocess
import sys
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from threading import Thread
from typing import Any

import pytest
from browser import DESK, LOOKS, PHONE, looks_like

ROOT = Path(__file__).resolve().parent.parent


class Quiet(SimpleHTTPRequestHandler):
    def log_message(self, format: str, *args: object) -> None:
        pass


@pytest.mark.slow
def test_the_site_is_whole_on_a_desk_and_a_phone(
    tmp_path: Path, browser: Any, pytestconfig: pytest.Config
) -> None:
    """And its front page looks as it did."""
    command = [
        sys.executable,
        "-m",
        "mkdocs",
        "build",
        "--quiet",
        "--strict",
        "--site-dir",
        str(tmp_path),
    ]
    built = subprocess.run(
        command,
        cwd=ROOT,
        capture_output=True,
        text=True,
        env=os.environ | {"NO_MKDOCS_2_WARNING": "1"},
    )
    assert built.returncode == 0, built.stderr
    server = ThreadingHTTPServer(
        ("127.0.0.1", 0), partial(Quiet, directory=str(tmp_path))
    )
    Thread(target=server.serve_forever, daemon=True).start()
    base = f"http://127.0.0.1:{server.server_port}/"
    complaints: list[str] = []
    try:
        for size in (DESK, PHONE):
            page = browser.new_page(viewport=size)
            page.on(
                "request",
                lambda one: one.url.startswith(base) or complaints.append(one.url),
            )
            page.on(
                "console",
                lambda one: one.type == "error" and complaints.append(one.text),
            )
            for source in sorted((ROOT / "docs").glob("*.md")):
                page.goto(f"{base}{source.stem}.html")
                if page.evaluate("document.documentElement.scrollWidth > innerWidth"):
                    complaints.append(f"{source.name} is wider than {size['width']} px")
                hidden = page.evaluate(
                    "[...document.querySelectorAll('pre code')].filter(e => e.scrollWidth > e.clientWidth)"
                    ".map(e => e.textContent)"
                )
                complaints.extend(
                    f"{source.name}: {text[:60]} is cut off" for text in hidden
                )
            page.close()
        for look, how in LOOKS.items():
            page = browser.new_page(**how)
            page.goto(f"{base}index.html", wait_until="networkidle")
            page.add_style_tag(content="img { visibility: hidden; }")  # it moves
            golden = ROOT / "tests" / "golden_pages" / f"docs-{look}.webp"
            complaints.append(
                looks_like(page, golden, renew=pytestconfig.getoption("force_regen"))
            )
            page.close()
        page = browser.new_page(viewport=DESK)
        page.on(
            "request",
            lambda one: one.url.startswith("file:") or complaints.append(one.url),
        )
        page.goto((tmp_path / "index.html").as_uri(), wait_until="load")
        page.wait_for_selector("[data-md-component=search-query]", state="attached")
        page.keyboard.press("/")
        page.wait_for_selector("[data-md-component=search-query]:focus")
        page.keyboard.type("elasticity", delay=50)
        page.wait_for_selector(
            ".md-search-result__item"
        )  # found from disk, without a server
        page.close()
    finally:
        server.shutdown()
    assert [one for one in complaints if one] == []
    assert "render_scene" in (tmp_path / "python.html").read_text(encoding="utf-8")
