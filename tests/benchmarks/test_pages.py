"""Figures of docs/benchmarks.md that are worked out from several results."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

RESULTS = Path(__file__).resolve().parents[2] / "benchmarks" / "results"


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


def test_masses_on_the_page_are_those_of_its_rows() -> None:
    """The share on the page, counted again from the answers and the shipped table."""
    import accuracy
    from properties import SHIPPED, read_table

    kept = json.loads((RESULTS / "properties.json").read_text())["rows"][0]["found"]
    true = {item.name: item.mass for item in read_table(SHIPPED).weighed}
    near = sum(abs(kept["answers"][name]["mass"] / mass - 1) <= 0.3 for name, mass in true.items())
    assert f"{near} of {len(true)} masses to within 30 %" in accuracy.page()
