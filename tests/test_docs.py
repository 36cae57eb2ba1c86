"""Figures in docs come from committed JSON, and nothing committed knows the machine it was made on."""

from __future__ import annotations

import importlib
import json
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent


def test_benchmark_page_is_what_its_json_says() -> None:
    code = "import sys; sys.path.insert(0, 'benchmarks'); import tables; sys.stdout.write(tables.page())"
    run = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True)
    assert (ROOT / "docs" / "benchmarks.md").read_text() == run.stdout


def test_latency_of_the_editor_is_what_its_json_says(monkeypatch: pytest.MonkeyPatch) -> None:
    """The last part of docs/editing.md; `python benchmarks/run.py editor` writes both."""
    monkeypatch.syspath_prepend(str(ROOT / "benchmarks"))
    editor = importlib.import_module("editor")
    text = editor.PAGE.read_text(encoding="utf-8")
    assert text == editor.page(text, json.loads((editor.RESULTS / "editor.json").read_text()))


def test_scale_page_is_what_its_json_says() -> None:
    code = "import sys; sys.path.insert(0, 'benchmarks'); import scale; sys.stdout.write(scale.page())"
    run = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True)
    assert (ROOT / "docs" / "scale.md").read_text() == run.stdout


def test_scale_page_reckons_with_what_was_measured(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(ROOT / "benchmarks"))
    import scale

    batch = {
        "throughput": [{"jobs": 1, "rate": 5.5, "cpu": 0.18}, {"jobs": 2, "rate": 10.0, "cpu": 0.2}, {}],
        "sizes": [{"file": name, "bytes": 1000 * k} for k, name in enumerate((*scale.BY_CLIP, "other"), 1)],
        "parent": [{"clips": 100, "mib": 60.0}, {"clips": 10_000, "mib": 61.5}],
        "again": {"clips": 1000, "wall": 4.0},
    }
    cluster = {
        "local": [{"way": "processes", "rate": [1, 1, 1]}, {"way": "dask", "rate": [0.8, 0.9, 1]}],
        "handing": 3.0,
    }
    found = scale.figures(batch, cluster)
    assert found["drawing"] == pytest.approx(10**6 / (1000 * 10 / 2 * 0.9))  # s
    assert found["wall"] == found["handed"] == pytest.approx(10**6 * 0.003)
    assert found["busy"] == 74  # 333 clips a second go out, each core makes 4.5
    assert found["bytes"] == 10**6 * (1000 + 2000 + 3000 + 4000)
    told = scale._told(found)
    for text in ("| 4 min |", "| **50 min** |", "| 55.6 h |", "10 GB", "| 1.11 h |"):
        assert text in told, text


def test_fidelity_page_is_what_its_json_says() -> None:
    code = "import sys; sys.path.insert(0, 'benchmarks'); import tables; sys.stdout.write(tables.fidelity_page())"
    run = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True)
    assert (ROOT / "docs" / "fidelity.md").read_text() == run.stdout


def test_plausibility_page_is_what_its_json_says() -> None:
    code = "import sys; sys.path.insert(0, 'benchmarks'); import tables; sys.stdout.write(tables.plausibility_page())"
    run = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True)
    assert (ROOT / "docs" / "plausibility.md").read_text() == run.stdout


def test_materials_page_is_what_the_table_says() -> None:
    code = "import sys; sys.path.insert(0, 'benchmarks'); import tables; sys.stdout.write(tables.materials_page())"
    run = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True)
    assert (ROOT / "docs" / "materials.md").read_text() == run.stdout


def test_readme_links_lead_somewhere() -> None:
    import re

    for page in (ROOT / "README.md", *(ROOT / "docs").glob("*.md")):
        for link in re.findall(r"\]\(([^)#:]+)\)", page.read_text()):
            assert (page.parent / link).exists(), f"{page.name} -> {link}"
