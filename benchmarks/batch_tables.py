"""What `batch` and `kills` found -> their parts of docs/benchmarks.md."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from layout import prose, table

Row = dict[str, Any]


def batch_table(rows: Sequence[Row]) -> list[str]:
    """Throughput, what a clip costs beside its stages, a second run, memory, Ctrl-C."""
    found = {name: part for row in rows for name, part in row.items()}
    one, two, ratio = found["throughput"]
    beside, stopped = found["beside"], found["stopped"]
    ways = [
        [row["jobs"], f"{row['rate']:.1f}", f"{row['cpu']:.2f}"] for row in (one, two)
    ]
    again, parent = [], []
    if "again" in found:  # parts that have not been run are left out
        again = prose(
            f"A run that finds all of {found['again']['clips']} clips complete: {found['again']['wall']} s,",
            "its gallery included (the bar is 5).",
        )
    if "parent" in found:
        parent = prose(
            "Peak memory of the process that hands out the work:",
            ", ".join(
                f"{row['mib']:.0f} MiB for {row['clips']:,} clips"
                for row in found["parent"]
            )
            + ".",
        )
    return [
        *prose(
            f"{one['clips']} variants of a bundled scene, 16 frames of 256 px, with one process and with two,",
            "in turns; all between the command and the gallery of its clips counts.",
        ),
        "",
        *table(["processes", "clips a second", "CPU, s a clip"], ways),
        "",
        *prose(
            f"Two make {ratio['ratio']:.2f} times as many clips as one (the bar is 1.8); CPU a clip is",
            f"{ratio['more']:.2f} times that of one (the bar is 1.1).",
        ),
        "",
        *prose(
            f"In one process a clip takes {beside['whole']:.0f} ms of CPU, of which {beside['beside']} ms are outside",
            "the stages (the bar is 5).",
        ),
        "",
        *(line for part in (again, parent) if part for line in (*part, "")),
        *prose(
            f"Ctrl-C, {stopped['times']} times, while two processes draw: {stopped['median']} s to the end in the",
            f"middle, {stopped['most']} s at most (the bar is 2).",
        ),
    ]


def kills_table(rows: Sequence[Row]) -> list[str]:
    """How a batch ended that was killed repeatedly."""
    end = rows[0]
    return prose(
        f"A batch of {end['clips']} clips, killed (SIGKILL) {end['kills']} times and started again until it was",
        f"complete. Its clips are {'the same' if end['same'] else 'NOT THE SAME'}, byte for byte, as those of a run",
        "never killed;",
        f"{end['left'] or 'no'} partial files are left, {end['most_left']} at most after a kill.",
    )


def attack_table(rows: Sequence[Row]) -> list[str]:
    """What the campaign of hostile inputs found."""

    def total(key: str, *kinds: str) -> int:
        return sum(round(row[key]) for row in rows if not kinds or row["kind"] in kinds)

    seeds, scenes = len({row["seed"] for row in rows}), total("inputs", "scenes")
    mistakes, photos = total("inputs", "mistakes"), total("inputs", "odd-photos")
    interrupted = total("inputs", "interrupted")
    others = total("inputs") - scenes - mistakes - photos - interrupted
    return prose(
        f"{seeds} seeds: {scenes:,} mutated scenes, {mistakes:,} scenes with mistakes made by hand,",
        f"{photos:,} photos of odd kinds, {others:,} other inputs, {interrupted} interrupted renders.",
        f"Faults, as `benchmarks/attack.py` lists them: {total('faulty') or 'none'}.",
        f"{total('refused'):,} commands refused their input,",
        f"with at most {max(row['refused_mib'] for row in rows)} MiB.",
        f"The slowest took {max(row['slowest'] for row in rows):.1f} s of CPU, the largest",
        f"{max(row['peak_mib'] for row in rows)} MiB.",
    )
