"""Simulated studies of two methods that are alike -> how often a difference is found all the same; rows, and a table.

python benchmarks/run.py study
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from physgen.evaluate.ratings import Draws, pairs

PAGE = Path(__file__).resolve().parent.parent / "docs" / "study.md"
MARKS = "<!-- figures: benchmarks/alarms.py -->", "<!-- end -->"
STUDIES = 1000
LEVEL = 0.05
CASES = {
    "people's taste alone": (0.5, 0.1),
    "videos alone": (0.1, 0.5),
    "both alike": (0.5, 0.5),
    "neither": (0.0, 0.0),
}
"""What differs besides chance: standard deviations, points, by which each rater, and each video, favours a method."""
CHANCE = 0.7
"""Points by which one answer is off."""
SIZES = ((12, 12), (14, 15))
"""Raters and videos; the second as in the paper."""


def study(folder: Path) -> list[dict]:
    """How many of the studies find p below 0.05: by raters, by videos, and by the larger of both."""
    random, rows = np.random.default_rng(13), []
    for raters, videos in SIZES:
        draws = Draws(raters, videos)
        for name, (taste, luck) in CASES.items():
            found = {"raters": 0, "videos": 0, "both": 0}
            for _ in range(STUDIES):
                raw = (
                    3
                    + random.normal(0, taste, (raters, 2, 1))
                    + random.normal(0, luck, (1, 2, videos))
                    + random.normal(0, CHANCE, (raters, 2, videos))
                )
                pair = pairs(np.clip(np.round(raw), 1, 5).astype(np.int64), draws)[0]
                told = {"raters": pair.by_raters, "videos": pair.by_videos, "both": pair.p}
                for key, p in told.items():
                    found[key] += p is not None and p < LEVEL
            rows.append(
                {"raters": raters, "videos": videos, "differs": name, "studies": STUDIES, "alarms": found}
            )
    return rows


def page(text: str, result: dict) -> str:
    """docs/study.md with its table from the JSON."""
    begin, end = MARKS
    heads = "| raters, videos | what differs | p by raters alone | p by videos alone | the larger of both |"
    lines = [heads, "| --- | --- | ---: | ---: | ---: |"]
    for row in result["rows"]:
        shares = (
            f"{100 * row['alarms'][key] / row['studies']:.1f} %" for key in ("raters", "videos", "both")
        )
        lines.append(f"| {row['raters']}, {row['videos']} | {row['differs']} | {' | '.join(shares)} |")
    body = "\n".join([begin, "", *lines, "", end])
    return re.sub(f"{re.escape(begin)}.*?{re.escape(end)}", lambda _: body, text, flags=re.S)
