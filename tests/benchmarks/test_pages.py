"""Figures of docs/benchmarks.md that are worked out from several results."""

from __future__ import annotations

import json
from pathlib import Path

RESULTS = Path(__file__).resolve().parents[2] / "benchmarks" / "results"


def test_masses_on_the_page_are_those_of_its_rows() -> None:
    """The share on the page, counted again from the answers and the shipped table."""
    import accuracy

    from physgen.evaluate.properties import SHIPPED, read_table

    kept = json.loads((RESULTS / "properties.json").read_text())["rows"][0]["found"]
    true = {item.name: item.mass for item in read_table(SHIPPED).items_with_mass}
    near = sum(
        abs(kept["answers"][name]["mass"] / mass - 1) <= 0.3
        for name, mass in true.items()
    )
    assert f"{near} of {len(true)} masses to within 30 %" in accuracy.page()


def test_results_name_the_scenes_and_variants_that_exist() -> None:
    from plausibility.run import ROOT, bundled_clips

    rows = json.loads((RESULTS / "plausibility.json").read_text())["rows"]
    named = {(row["scene"], row["variant"]) for row in rows if "scene" in row}
    assert named == {
        (str(path.relative_to(ROOT)), variant) for path, variant in bundled_clips()
    }
