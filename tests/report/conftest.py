"""Pages as `physgen render` leaves them."""

from __future__ import annotations

from pathlib import Path

import pytest
from browser import FALL, LONG

from physgen import pipeline


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
        more = (
            {"variant": "heavy", "overrides": ["objects.c.friction=0.9"]}
            if name == "long"
            else {}
        )
        more |= {"draws": 6} if name == "long" else {}
        pipeline.render_scene(home / f"{name}.yaml", home / "out", **more)
    return home / "out"
