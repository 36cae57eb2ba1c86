"""Figures in docs come from committed JSON, and nothing committed knows the machine it was made on."""

from __future__ import annotations

import importlib
import json
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent


@pytest.mark.parametrize(
    ("page", "module", "arguments"),
    [
        ("benchmarks", "tables.page", ()),
        ("scale", "scale.page", ()),
        ("fidelity", "tables.fidelity_page", ()),
        ("plausibility", "tables.plausibility_page", ()),
        ("materials", "tables.materials_page", ()),
        ("physics", "tables.physics_page", ()),
        ("how-good", "how_good.page", ()),
        ("properties", "paper.page", ("properties",)),
        ("controllability", "paper.page", ("controllability",)),
        ("runtime", "paper.page", ("runtime",)),
    ],
)
def test_a_page_is_what_its_json_says(page: str, module: str, arguments: tuple[str, ...]) -> None:
    name, _, function = module.partition(".")
    made = getattr(importlib.import_module(name), function)(*arguments)
    assert (ROOT / "docs" / f"{page}.md").read_text(encoding="utf-8") == made


@pytest.mark.parametrize(("module", "result"), [("editor", "editor"), ("fid_page", "fid"), ("sureness", "")])
def test_figures_within_a_page_are_what_its_json_says(module: str, result: str) -> None:
    """`python benchmarks/run.py` writes both."""
    made = importlib.import_module(module)
    kept = ROOT / "benchmarks" / "results" / f"{result}.json" if result else made.RESULT
    text = made.PAGE.read_text(encoding="utf-8")
    assert made.page(text, json.loads(kept.read_text())) == text


def test_scale_page_reckons_with_what_was_measured() -> None:
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


def test_readme_links_lead_somewhere() -> None:
    import re

    for page in (ROOT / "README.md", *(ROOT / "docs").glob("*.md")):
        for link in re.findall(r"\]\(([^)#:]+)\)", page.read_text()):
            assert (page.parent / link).exists(), f"{page.name} -> {link}"
