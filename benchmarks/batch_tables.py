"""What `batch` and `kills` found -> their parts of docs/benchmarks.md."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from typing import Any

Row = dict[str, Any]


def batch_table(rows: Sequence[Row]) -> list[str]:
    """Throughput, what a clip costs beside its stages, a second run, memory, Ctrl-C."""
    found = {name: part for row in rows for name, part in row.items()}
    one, two, ratio = found["throughput"]
    beside, stopped = found["beside"], found["stopped"]
    stages = ", ".join(f"{name} {ms:g}" for name, ms in beside["stages"].items())
    ways = [[row["jobs"], row["rate"], row["cpu"]] for row in (one, two)]
    again, parent = [], []
    if "again" in found:  # parts that have not been run are left out
        again = _prose(
            f"A run that finds all of {found['again']['clips']} clips there: {found['again']['wall']} s, its gallery",
            "included (the bar is 5).",
        )
    if "parent" in found:
        parent = [
            "Memory of the process that hands out the work, at its peak, for sweeps of a tiny scene:",
            "",
            *_table(["clips", "MiB"], [[row["clips"], row["mib"]] for row in found["parent"]]),
        ]
    return [
        "## Batches",
        "",
        *_prose(
            f"{one['clips']} variants of a bundled scene, 16 frames of 256 px, with one process and with two,",
            "in turns; all between the command and the gallery of its clips counts.",
        ),
        "",
        *_table(["processes", "clips a second", "CPU, s a clip"], ways),
        "",
        *_prose(
            f"Two make {ratio['ratio']} times as many clips as one (turn by turn",
            f"{', '.join(map(str, ratio['turns']))}; the bar is 1.8); CPU a clip is {ratio['more']} times that of one",
            "(the bar is 1.1).",
        ),
        "",
        *_prose(
            f"In one process a clip takes {beside['whole']} ms of CPU, of which {beside['beside']} ms are no stage's",
            f"(the bar is 5): {stages}.",
        ),
        "",
        *(line for part in (again, parent) if part for line in (*part, "")),
        *_prose(
            f"Ctrl-C, {stopped['times']} times, while two processes draw: {stopped['median']} s to the end in the",
            f"middle, {stopped['most']} s at most (the bar is 2).",
        ),
    ]


def kills_table(rows: Sequence[Row]) -> list[str]:
    """How a batch ended that was killed again and again."""
    end, log = rows[0], rows[1:]
    return [
        "## Killed, and run again",
        "",
        *_prose(
            f"A batch of {end['clips']} clips, killed (SIGKILL) {end['kills']} times at random moments and run again",
            f"until it was whole. Its clips are {'the same' if end['same'] else 'NOT THE SAME'}, byte for byte, as",
            f"those of a run never killed; {end['left'] or 'nothing'} half-written is left in the end,",
            f"{end['most_left']} files at most after a kill.",
        ),
        "",
        *_table(
            ["after, s", "killed", "clips whole then", "damaged", "half-written left"],
            [[row[key] for key in ("after", "killed", "whole", "damaged", "left")] for row in log],
        ),
    ]


def _prose(*parts: str) -> list[str]:
    return textwrap.wrap(" ".join(parts), 116)


def _table(heads: Sequence[str], rows: Sequence[Sequence[Any]]) -> list[str]:
    lines = [heads, ["---"] * len(heads), *rows]
    return ["|".join(["", *(f" {cell} " for cell in line), ""]).replace(" --- ", "---") for line in lines]
