"""What `plausible` found -> its part of docs/benchmarks.md."""

from __future__ import annotations

from pathlib import Path

from layout import prose, table

from physgen.evaluate.plausibility.judge import EVEN

from .confusion import findings
from .run import SEEDS
from .trial import HELD_OUT


def section(rows: list[dict]) -> list[str]:
    """Right and wrong clips, then scenes."""
    counted = [row for row in rows if row.get("tracker") in TRACKERS]
    found = findings(counted, range(HELD_OUT, HELD_OUT + SEEDS))
    lines = prose(
        *found.sentences,
        "physgen: random scenes of nine kinds, and the same with one body changed midway. Closed form: balls on",
        "parabolas, by a program that shares nothing with the engine. The judge knows neither walls nor pushes.",
        "Tracks are exact, or have normal noise.",
    )
    for one in (one for section in found.sections[:2] for one in section.tables):
        lines += ["", *table(one.heads, one.rows)]
    scenes = [row for row in rows if "scene" in row]
    is_wrong = [row["score"] is not None and row["score"] < EVEN for row in scenes]
    wrong = sum(is_wrong)
    names = [
        Path(row["scene"]).stem
        for row, fails in zip(scenes, is_wrong, strict=True)
        if fails
    ]
    listing = f" ({', '.join(names)})" if names else ""
    unasked = sum(row["score"] is None for row in scenes)
    studio = _studio([row for row in rows if "studio" in row])
    return [
        *lines,
        "",
        *prose(
            f"Of the {len(scenes)} bundled scenes and variants {len(scenes) - wrong - unasked} are called right,",
            f"{wrong} wrong{listing}. {studio}",
        ),
    ]


TRACKERS = ("exact", "1 px")
"""Shown of all in the JSON."""


def _studio(rows: list[dict]) -> str:
    clips, wrong = (sum(row[key] for row in rows) for key in ("clips", "called_wrong"))
    least = min(row["least"] for row in rows if row["least"] is not None)
    return (
        f"The studio's truth, 12 to 14 frames of eight scenes and 8 frames of each "
        f"of 50 clips of one: {wrong} of {clips} are called wrong, the least score is {least:.2f}."
    )
