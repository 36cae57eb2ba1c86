"""A photo that is saved while its clip is made: no other run takes these frames for those of the new photo."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from physgen import pipeline, registry
from physgen.pipeline.cache import open_store
from physgen.registry import Backend
from physgen.report import record

SCENE = """\
physgen: 1
image: photo.png
assets: .
world: {duration: 0.2}
objects: {ball: {mask: 1, velocity: [60, 0]}}
render: {fps: 20}
refine: {backend: exact, steps: 4, stop: 1}
"""


@pytest.fixture(autouse=True)
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    row = Backend("refine", "exact", "gaussian:made", "Gaussian data.", takes_setup=True)
    monkeypatch.setattr(registry, "BACKENDS", (*registry.BACKENDS, row))
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    home = tmp_path / "scene"
    home.mkdir()
    (home / "scene.yaml").write_text(SCENE)
    mask = np.zeros((48, 64), np.uint8)
    cv2.circle(mask, (20, 20), 8, 1, -1)
    cv2.imwrite(str(home / "masks.png"), mask)
    save(home, 90)
    return home


def save(home: Path, level: int) -> None:
    cv2.imwrite(str(home / "photo.png"), np.full((48, 64, 3), level, np.uint8))


def frames(home: Path, **how: bool) -> list[str]:
    folder = pipeline.render_scene(home / "scene.yaml", home.parent / "out", **how)
    told = json.loads((folder / "manifest.json").read_text())
    return list(told["unrefined"])


def test_no_run_takes_them_for_those_of_the_new_photo(home: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    inputs = record.inputs
    levels = [200]

    def late(*arguments: Any) -> dict[str, str]:
        """Somebody has just saved another photo: it was read, and is hashed now."""
        if levels:
            save(home, levels.pop())
        return inputs(*arguments)

    monkeypatch.setattr(record, "inputs", late)
    old = frames(home)
    assert not [entry for entry in open_store().sizes() if entry.stage == "guidance"]
    new = frames(home)
    assert new != old
    assert new == frames(home) == frames(home, cached=False)
    assert [entry for entry in open_store().sizes() if entry.stage == "guidance"]
