"""benchmarks/results/fid.json -> the figures in docs/fid.md; a test fails when they differ.

python benchmarks/fid_page.py
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from statistics import median

ROOT = Path(__file__).resolve().parents[1]
RESULT = ROOT / "benchmarks/results/fid.json"
PAGE = ROOT / "docs/fid.md"
MARKS = "<!-- figures: benchmarks/fid.py -->", "<!-- end -->"
KINDS = {"image": "Image-FID", "motion": "Motion-FID"}
NAMES = {
    "estimated": "estimated from the photo",
    "masses given": "estimated, true masses given",
    "all given": "all physics of objects given",
    "anew": "random, anew for every clip",
    "held": "random, held for all clips",
}
HEADS = "push", "physics", "Image-FID, bank", "95 %", "Motion-FID, bank", "95 %"


def tables(result: dict) -> Iterator[str]:
    """Distances, what is farther than what, and the estimates behind them."""
    rows = {row["method"]: row for row in result["rows"]}
    yield _line(HEADS)
    yield _line(["---"] * 2 + ["---:"] * 4)
    for way in ("impulse", "speed"):
        for name in ("estimated", "masses given", "all given"):
            yield _line([way, NAMES[name], *_one(rows[f"{name}, {way}"])])
        for name, group in _random(rows, way).items():
            yield _line([way, NAMES[name], *_many(group)])
    yield _line(["impulse", "the true scene file", *_one(rows["true scene"])])
    yield _line(["none", "the photo, still", *_one(rows["still"])])
    halves = rows["halves"]
    cells = [_number(halves["image_fid"]), "-", _number(halves["motion_fid"]), "-"]
    yield _line(["", "one half of the filmed clips, against the other", *cells])
    yield ""
    yield from _order(rows)
    yield ""
    yield from _guesses(rows["guesses"]["true_and_estimated"])
    yield ""
    yield f"Measured on {result['machine']}."


def _random(rows: dict, way: str) -> dict[str, list[dict]]:
    found: dict[str, list[dict]] = {"anew": [], "held": []}
    for name, row in rows.items():
        if name.startswith("random") and name.endswith(f", {way}"):
            found["held" if " held," in name else "anew"].append(row)
    return found


def _one(row: dict) -> list[str]:
    cells = []
    for kind in KINDS:
        low, high = row[f"{kind}_fid_95"]
        cells += [_number(row[f"{kind}_fid"]), f"{_number(low)} to {_number(high)}"]
    return cells


def _many(rows: list[dict]) -> list[str]:
    """The middle one of the seeds; for an interval, the least and the most."""

    def middle(key: str) -> str:
        return _number(median(row[key] for row in rows))

    cells = []
    for kind in KINDS:
        values = [row[f"{kind}_fid"] for row in rows]
        cells += [middle(f"{kind}_fid"), f"seeds: {_number(min(values))} to {_number(max(values))}"]
    return cells


def _order(rows: dict) -> Iterator[str]:
    """In how many seeds random physics is farther, and in how many beyond its interval, either way."""
    yield _line(["push", "random physics, against", *(f"{k}: farther in" for k in KINDS.values()),
                 *(f"{k}: surely farther, surely nearer" for k in KINDS.values())])  # fmt: skip
    yield _line(["---", "---"] + ["---:"] * 4)
    for way in ("impulse", "speed"):
        for drawn, group in _random(rows, way).items():
            for other in ("estimated", "masses given", "all given"):
                farther, surely = [], []
                for kind in KINDS:
                    more = [row["farther_than"][other][kind] for row in group]
                    farther.append(f"{sum(one['by'] > 0 for one in more)} of {len(more)} seeds")
                    far, near = (sum(one["95"][0] > 0 for one in more), sum(one["95"][1] < 0 for one in more))
                    surely.append(f"{far}, {near}")
                yield _line([way, f"{NAMES[drawn]}; {NAMES[other]}", *farther, *surely])


def _guesses(found: dict) -> Iterator[str]:
    yield _line(
        [
            "object",
            "mass, g: true",
            "estimated",
            "friction: true",
            "estimated",
            "elasticity: true",
            "estimated",
        ]
    )
    yield _line(["---"] + ["---:"] * 6)
    for name, one in found.items():
        yield _line(
            [name, *(f"{value:g}" for key in ("mass", "friction", "elasticity") for value in one[key])]
        )


def _number(value: float) -> str:
    return f"{value:.3g}"


def _line(cells: list[str] | tuple[str, ...]) -> str:
    return "| " + " | ".join(cells) + " |"


def page(text: str, result: dict) -> str:
    """The page with the figures that the results give."""
    before, _, rest = text.partition(MARKS[0])
    _, _, after = rest.partition(MARKS[1])
    return f"{before}{MARKS[0]}\n\n" + "\n".join(tables(result)) + f"\n\n{MARKS[1]}{after}"


if __name__ == "__main__":
    PAGE.write_text(page(PAGE.read_text(), json.loads(RESULT.read_text())))
