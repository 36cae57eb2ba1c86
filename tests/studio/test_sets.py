"""The studio's sets write the bundled scene files: an edit of either is made in both."""

import importlib
import json
import re
import sys
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType
from typing import Any
from unittest.mock import MagicMock

import numpy as np
import pytest
import yaml

ROOT = Path(__file__).resolve().parents[2]
SETS = sorted(path.stem for path in (ROOT / "studio/sets").glob("[a-z]*.py"))
ROUNDING = 1e-5
"""Relative difference of numbers: an older writer cut the digits of large pushes off."""


class Motion:
    """A stand-in for Mitsuba's transform; only the composition of matrices matters."""

    def __init__(self, matrix: Any = None) -> None:
        self.matrix = np.eye(4) if matrix is None else np.asarray(matrix, float)

    def __matmul__(self, other: "Motion") -> "Motion":
        return Motion(self.matrix @ other.matrix)

    def translate(self, vector: Any) -> "Motion":
        matrix = np.eye(4)
        matrix[:3, 3] = vector
        return Motion(self.matrix @ matrix)

    def scale(self, factors: Any) -> "Motion":
        return Motion(self.matrix @ np.diag([*np.broadcast_to(factors, 3), 1.0]))

    def rotate(self, axis: Any, degrees: float) -> "Motion":
        x, y, z = np.asarray(axis, float) / np.linalg.norm(axis)
        cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
        angle = np.radians(degrees)
        matrix = np.eye(4)
        matrix[:3, :3] += np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross
        return Motion(self.matrix @ matrix)

    def look_at(self, **_: Any) -> "Motion":
        return Motion(self.matrix)


@pytest.fixture
def studio_modules(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Let the studio be imported without Mitsuba, which is not installed for tests."""
    optics = ModuleType("optics")
    optics.__dict__.update(T=Motion, mi=MagicMock(), dr=MagicMock())
    before = set(sys.modules)
    monkeypatch.setitem(sys.modules, "optics", optics)
    monkeypatch.syspath_prepend(ROOT / "studio")
    monkeypatch.syspath_prepend(ROOT / "studio/sets")
    yield
    for name in set(sys.modules) - before:
        file = getattr(sys.modules[name], "__file__", None)
        if file and Path(file).is_relative_to(ROOT / "studio"):
            del sys.modules[name]


def flatten(value: Any, path: str = "") -> dict[str, Any]:
    """Return the leaves of a document by path; empty containers are leaves."""
    if isinstance(value, dict) and value:
        items = [(f"{path}.{key}", inner) for key, inner in value.items()]
    elif isinstance(value, list) and value:
        items = [(f"{path}[{k}]", inner) for k, inner in enumerate(value)]
    else:
        return {path: value}
    leaves: dict[str, Any] = {}
    for inner_path, inner in items:
        leaves |= flatten(inner, inner_path)
    return leaves


def compare(written: Any, expected: Any) -> None:
    """Compare two documents: numbers up to rounding, all else exactly."""
    leaves, expected_leaves = flatten(written), flatten(expected)
    assert leaves.keys() == expected_leaves.keys()
    for path, value in expected_leaves.items():
        if isinstance(value, (int, float)) and not isinstance(value, bool):
            assert leaves[path] == pytest.approx(value, rel=ROUNDING), path
        else:
            assert leaves[path] == value, path


def comments(text: str) -> list[str]:
    return re.findall(r"(?:^|\s)# *(.*)", text, re.MULTILINE)


@pytest.mark.slow
@pytest.mark.parametrize("name", SETS)
def test_set_writes_its_scene_file(name: str, studio_modules: None) -> None:
    """Values and comments are equal. Line breaks and the order of keys are not compared:
    the scene files were wrapped at another width and have edits by hand.
    """
    stage = importlib.import_module(name).stage()
    probe, story = importlib.import_module("probe"), importlib.import_module("story")
    records = importlib.import_module("records")
    truth = json.loads((ROOT / f"studio/truth/{stage.name}/truth.json").read_text())
    text = story.text(stage, probe.Light(**truth["light"]))
    scene = (ROOT / f"scenes/{stage.name}/scene.yaml").read_text()
    assert comments(text) == comments(scene)
    compare(yaml.safe_load(text), yaml.safe_load(scene))
    facts = records.facts(stage, stage.camera, records.Quality(**truth["rays"]))
    compare(facts["objects"], truth["objects"])
    compare(facts["boundaries"], truth["boundaries"])
