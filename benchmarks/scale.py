"""benchmarks/results/batch.json and cluster.json -> what a million clips on a thousand cores would cost.

Nothing here was run on a thousand cores: it is what was measured on two, times what it takes.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from layout import prose, table

from physgen.batch.workers import AHEAD

RESULTS = Path(__file__).resolve().parent / "results"
CLIPS, CORES = 10**6, 1000
BY_CLIP = ("video.mp4", "trajectory.npz", "manifest.json", "a row of sweep.csv")
"""What every clip of a sweep leaves with `--report none`."""


def result(name: str) -> dict[str, Any]:
    """The parts of a benchmark by their names; none where it has not been run."""
    path = RESULTS / f"{name}.json"
    if not path.exists():
        return {}
    return {part: told for row in json.loads(path.read_text())["rows"] for part, told in row.items()}


def figures(batch: Mapping[str, Any], cluster: Mapping[str, Any]) -> dict[str, Any]:
    """What the table shows; times in s, sizes in bytes, of all clips together."""
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


def table_of(rows: list[dict[str, Any]]) -> list[str]:
    """Of the rows of `batch`, and of the cluster's result."""
    f = figures({part: found for row in rows for part, found in row.items()}, result("cluster"))
    sizes = "; ".join(f"{name} {data(size)}" for name, size in f["sizes"].items())
    body = [
        ["drawing, all cores", time(f["drawing"]), f"{f['core']:.3g} clips a second and core"],
        ["handing out, one process", time(f["handed"]), f"{1000 * f['handing']:.3g} ms of CPU a clip"],
        ["**the run**", f"**{time(f['wall'])}**", "the longer of the two"],
        ["CPU of all cores", time(f["cpu"]), ""],
        ["files", data(f["bytes"]), f"four for each clip, with `--report none`: {', '.join(BY_CLIP)}"],
    ]
    if f["again"] is not None:
        body.append(
            ["the same command again", time(f["again"]), "two processes compare files with their hashes"]
        )
    return [
        *prose(
            "Estimated from what was measured on two cores, never run: variants of nine dominoes, 16 frames of 256 px.",
            f"One process that hands out keeps some {f['busy']:,} cores busy with clips this short; share a larger",
            "sweep among several runs, since draws depend on `--seed` and their number alone. At most",
            f"{AHEAD} clips a worker are ahead of the oldest unfinished one.",
        ),
        "",
        *table(["", "takes", "from"], body),
        "",
        *prose(f"Bytes a clip: {sizes}."),
    ]


def time(seconds: float) -> str:
    """In a suitable unit.

    >>> [time(s) for s in (12.34, 600, 5400, 3.6e6)]
    ['12 s', '10 min', '1.5 h', '1,000 h']
    """
    if seconds < 120:
        return f"{seconds:.0f} s"
    if seconds < 3600:
        return f"{seconds / 60:.0f} min"
    return f"{seconds / 3600:.3g} h" if seconds < 360_000 else f"{seconds / 3600:,.0f} h"


def data(size: float) -> str:
    """Bytes in a suitable unit.

    >>> [data(n) for n in (950, 12_345, 2.5e9, 3e13)]
    ['950 B', '12.3 kB', '2.5 GB', '30 TB']
    """
    for unit in ("B", "kB", "MB", "GB"):
        if size < 1000:
            return f"{size:.3g} {unit}"
        size /= 1000
    return f"{size:.3g} TB"
