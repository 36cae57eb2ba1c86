"""benchmarks/results/batch.json and cluster.json -> docs/scale.md: what a million clips on a thousand cores cost.

    python benchmarks/scale.py               # writes the page; a test fails when it differs from the figures

Nothing here was run on a thousand cores: it is what was measured on two, times what it takes.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from physgen.batch.workers import AHEAD

RESULTS = Path(__file__).resolve().parent / "results"
PAGE = RESULTS.parents[1] / "docs" / "scale.md"
CLIPS, CORES = 10**6, 1000
BY_CLIP = ("video.mp4", "trajectory.npz", "manifest.json", "a row of sweep.csv")
"""What every clip of a sweep leaves with `--report none`."""

HEAD = """\
# A million clips on a thousand cores

Written by `python benchmarks/scale.py` from `benchmarks/results/batch.json` and `cluster.json`; do not edit. No one
has run this here: it is what two cores took, times what it takes, for a million variants of a bundled scene (nine
dominoes), 16 frames of 256 px each, `--report none`, on a Dask cluster of 1,000 workers of one core that share the
folder of results.
"""
MISSING = """
The figures are not measured yet: `python benchmarks/run.py batch cluster` does, in some 40 minutes on an idle machine.
"""


def result(name: str) -> dict[str, Any]:
    """The parts of a benchmark by their names; none where it has not been run."""
    path = RESULTS / f"{name}.json"
    if not path.exists():
        return {}
    return {part: told for row in json.loads(path.read_text())["rows"] for part, told in row.items()}


def figures(batch: Mapping[str, Any], cluster: Mapping[str, Any]) -> dict[str, Any]:
    """What the page tells; times in s, sizes in bytes, of all clips together."""
    one, two, _ = batch["throughput"]
    (dask,) = (row for row in cluster["local"] if row["way"] == "dask")
    share = dask["rate"][1]  # of the throughput of processes, the median of turns
    core = two["rate"] / two["jobs"] * share  # clips a second
    # s of the process that hands out
    handing = cluster["handing"] / 1000
    sizes = {row["file"]: row["bytes"] for row in batch["sizes"]}
    drawing, handed = CLIPS / (core * CORES), CLIPS * handing
    return {
        "core": core,
        "cpu": two["cpu"] * CLIPS,
        "more": two["cpu"] / one["cpu"],
        "handing": handing,
        "drawing": drawing,
        "handed": handed,
        "wall": max(drawing, handed),
        "busy": int(handing**-1 / core),
        "sizes": sizes,
        "bytes": sum(sizes[name] for name in BY_CLIP) * CLIPS,
        "parent": [(row["clips"], row["mib"]) for row in batch.get("parent", ())],
        "again": batch["again"]["wall"] / batch["again"]["clips"] * CLIPS if "again" in batch else None,
    }


def page() -> str:
    batch, cluster = result("batch"), result("cluster")
    if not {"throughput", "sizes"} <= batch.keys() or not {"local", "handing"} <= cluster.keys():
        return HEAD + MISSING
    return HEAD + _told(figures(batch, cluster))


def _told(f: Mapping[str, Any]) -> str:
    bound = "the process that hands out" if f["handed"] > f["drawing"] else "drawing"
    rows = [
        ("drawing, all cores at it", time(f["drawing"]), f"{f['core']:.3g} clips a second and core"),
        (
            "handing out, one process",
            time(f["handed"]),
            f"{1000 * f['handing']:.3g} ms of CPU a clip",
        ),
        ("**the run takes**", f"**{time(f['wall'])}**", f"the longer of the two: {bound}"),
        ("CPU of all cores", time(f["cpu"]), ""),
    ]
    if f["again"] is not None:
        whence = "two processes compare files with their hashes"
        rows.append(("the same command again, nothing to do", time(f["again"]), whence))
    sizes = [(name, f"{size:,}", data(size * CLIPS)) for name, size in f["sizes"].items()]
    held = [f"{mib:g} MiB at {clips:,} clips" for clips, mib in f["parent"]]
    return "\n".join(
        [
            "",
            "## Hours",
            "",
            "| | takes | from |",
            "| --- | ---: | --- |",
            *(f"| {what} | {took} | {whence} |" for what, took, whence in rows),
            "",
            "Handing out was measured with the loops of scheduler and workers in the same process: it takes less.",
            "One process that hands out keeps some",
            f"{f['busy']:,} cores busy with clips as short as these; clips that take ten times as long, ten times as",
            "many cores. Beyond that, share a sweep among several runs, each with its own folder and scheduler: draws",
            "depend on `--seed` and their number alone. Worker processes start once, in some seconds.",
            "",
            "## Bytes",
            "",
            f"A clip leaves three files in a folder of its own, and a row of `sweep.csv`: {data(f['bytes'])},",
            f"and {4 * CLIPS:,} names for the file system, in one folder of {CLIPS:,}. `index.html` shows 20,000",
            "clips at most, so there is none, and no pictures for it.",
            "",
            "| file | bytes a clip | of all |",
            "| --- | ---: | ---: |",
            *(f"| {' | '.join(row)} |" for row in sizes),
            "",
            "Reports, and pictures for a gallery, are here for comparison: no such run makes any.",
            "",
            "## Load",
            "",
            f"No more than {AHEAD} clips a worker are ahead of the oldest unfinished one, {AHEAD * CORES:,} here, so",
            "neither the scheduler nor the process that hands out holds more than these, however many there are.",
            *([f"Measured, with two processes: {', '.join(held)}."] if held else []),
            f"The scheduler sees one task a clip: {CLIPS / f['wall']:.3g} a second.",
            "",
        ]
    )


def time(seconds: float) -> str:
    """In the unit that tells it.

    >>> [time(s) for s in (12.34, 600, 5400, 3.6e6)]
    ['12 s', '10 min', '1.5 h', '1,000 h']
    """
    if seconds < 120:
        return f"{seconds:.0f} s"
    if seconds < 3600:
        return f"{seconds / 60:.0f} min"
    return f"{seconds / 3600:.3g} h" if seconds < 360_000 else f"{seconds / 3600:,.0f} h"


def data(size: float) -> str:
    """Bytes in the unit that tells them.

    >>> [data(n) for n in (950, 12_345, 2.5e9, 3e13)]
    ['950 B', '12.3 kB', '2.5 GB', '30 TB']
    """
    for unit in ("B", "kB", "MB", "GB"):
        if size < 1000:
            return f"{size:.3g} {unit}"
        size /= 1000
    return f"{size:.3g} TB"


if __name__ == "__main__":
    PAGE.write_text(page())
