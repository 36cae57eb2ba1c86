"""Notebooks of docs/ run, and show what they showed."""

from __future__ import annotations

import importlib.util
import json
import os
import re
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).resolve().parent.parent
NOTEBOOKS = sorted((ROOT / "docs" / "notebooks").glob("*.ipynb"))
MOST_BYTES = 60_000
"""Of a notebook with its outputs."""
RERUN = ("1 clip, unchanged",)
"""Lines of a second run, which finds the clips of the first."""


def texts(cells: Sequence[dict[str, Any]]) -> list[list[str]]:
    """What each cell of code prints and returns, and the kinds of pictures that it shows."""
    found = []
    for cell in cells:
        if cell["cell_type"] != "code":
            continue
        shown = []
        for output in cell["outputs"]:
            assert output["output_type"] != "error"
            if output.get("name") == "stderr":  # what libraries say of the machine
                continue
            kinds = output.get("data", {"stream": output.get("text")})
            for kind, data in sorted(kinds.items()):
                is_text = kind in ("stream", "text/plain")
                shown.append("".join(data) if is_text else kind)
        lines = "".join(shown).splitlines()
        found.append([line for line in lines if line not in RERUN])
    return found


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_has_its_outputs_and_is_small(path: Path) -> None:
    assert path.stat().st_size < MOST_BYTES
    cells = json.loads(path.read_text())["cells"]
    assert any(texts(cells))
    assert not re.search(r"/(home|root|tmp|work)/", path.read_text())


def test_there_are_three_notebooks() -> None:
    assert [path.stem for path in NOTEBOOKS] == ["first-clip", "labels", "sweep"]


@pytest.mark.slow
@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_shows_what_it_showed(
    path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(ROOT), *sys.path]))
    spec = importlib.util.spec_from_file_location("run", path.parent / "run.py")
    assert spec is not None
    assert spec.loader is not None
    runner = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(runner)
    cells = runner.executed(path)["cells"]
    assert texts(cells) == texts(json.loads(path.read_text())["cells"])
