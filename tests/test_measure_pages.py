"""Pages of the paper's measures come from committed JSON, and tell what it tells."""

from __future__ import annotations

import json
from math import exp, log
from pathlib import Path
from statistics import median

ROOT = Path(__file__).resolve().parent.parent


def test_masses_on_the_page_are_those_of_its_rows() -> None:
    """The share that the page tells, counted again from the answers and the shipped table."""
    from physgen.evaluate.properties import SHIPPED, read_table

    kept = json.loads((ROOT / "benchmarks" / "results" / "properties.json").read_text())["rows"][0]["found"]
    true = {item.name: item.mass for item in read_table(SHIPPED).weighed}
    near = sum(abs(kept["answers"][name]["mass"] / mass - 1) <= 0.3 for name, mass in true.items())
    assert f"{near} of {len(true)} masses to within 30 %" in (ROOT / "docs" / "properties.md").read_text()


def test_how_far_off_the_ablations_masses_are_is_what_the_json_of_properties_says() -> None:
    kept = json.loads((ROOT / "benchmarks" / "results" / "properties.json").read_text())["rows"][0]["found"]
    kinds = sorted(kept["studio"], key=lambda one: -abs(log(one["told_mass"] / one["true_mass"])))
    half = exp(median(abs(log(one["told_mass"] / one["true_mass"])) for one in kinds))
    page = " ".join((ROOT / "docs" / "fid.md").read_text().split())
    assert f"Of the {len(kinds)} kinds of objects" in page
    assert (
        f"half are within a factor of {half:.2f}; the elephant is the fourth worst, the ball the thirteenth"
        in page
    )
    assert [(kinds[k]["scene"], kinds[k]["label"]) for k in (3, 12)] == [
        ("shelf", "wooden elephant"),
        ("shelf", "leather ball"),
    ]
