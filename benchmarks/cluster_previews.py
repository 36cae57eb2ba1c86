"""Many tiny previews on a Dask cluster of this machine: cost a clip and memory of the process that hands out.

    python benchmarks/run.py cluster                    # 10,000 clips; some 10 minutes on an idle machine
    python benchmarks/cluster_previews.py --clips 2000 --limit 300

A run that reaches its limit, s, is interrupted and reports the clips that it made.
"""

from __future__ import annotations

import argparse
import json
import os
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

from layout import prose, table

from physgen.environment import this_machine

RESULTS = Path(__file__).resolve().parent / "results" / "cluster.json"
SCENE = """\
physgen: 1
size: [32, 24]
world: {duration: 0.1}
objects:
  ball: {shape: {circle: {center: [12, 12], radius: 5}}}
render: {fps: 20}
"""
CLIPS, WORKERS, SAMPLES = 10_000, 2, 10
LIMIT = 3600.0
"""s that a run may take."""
TICKS = os.sysconf("SC_CLK_TCK")


def cpu_seconds(process: int) -> float:
    """CPU of a process without its children, s."""
    fields = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / TICKS


def memory_mib(process: int) -> float:
    """Memory that a process holds."""
    for line in Path(f"/proc/{process}/status").read_text().splitlines():
        if line.startswith("VmRSS:"):
            return int(line.split()[1]) / 1024
    return 0.0


def previews(folder: Path, clips: int, limit: float, way: list[str]) -> dict[str, Any]:
    """Make the clips, and watch the process that hands them out."""
    (folder / "tiny.yaml").write_text(SCENE)
    sweep = ["sweep", "tiny.yaml", f"objects.ball.mass=1:{clips}:{clips}"]
    flags = ["--preview", "-o", "out", *way]
    run = subprocess.Popen(
        [sys.executable, "-m", "physgen", *sweep, *flags],
        cwd=folder,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
    )
    assert run.stdout is not None
    share = clips // SAMPLES
    samples, first, last = [], 0.0, 0
    start = time.monotonic()
    for made, _ in enumerate(run.stdout, 1):
        if made == share // 10:  # what starts is not counted
            first = cpu_seconds(run.pid)
        if made % share == 0 and made <= clips:
            row = {"clips": made, "mib": round(memory_mib(run.pid), 1)}
            samples.append({**row, "cpu": cpu_seconds(run.pid)})
            print(samples[-1], flush=True)
            last = made
        if time.monotonic() - start > limit and samples:
            run.send_signal(signal.SIGINT)
            break
    run.stdout.close()
    run.wait()
    counted = last - share // 10
    return {
        "asked": clips,
        "clips": last,
        "workers": WORKERS,
        "client": round(1000 * (samples[-1]["cpu"] - first) / counted, 2),
        "wall": round(time.monotonic() - start),
        "memory": [{"clips": row["clips"], "mib": row["mib"]} for row in samples],
    }


def measured(clips: int = CLIPS, limit: float = LIMIT) -> list[dict[str, Any]]:
    """Run the benchmark."""
    with tempfile.TemporaryDirectory() as name:
        return [previews(Path(name), clips, limit, ["--cluster", f"local:{WORKERS}"])]


def cluster(folder: Path) -> list[dict[str, Any]]:
    """The rows of `run.py`."""
    return measured()


def cluster_table(rows: list[dict[str, Any]]) -> list[str]:
    """The part of docs/benchmarks.md."""
    row = rows[0]
    memory = [[f"{part['clips']:,}", f"{part['mib']:.0f}"] for part in row["memory"]]
    return [
        *prose(
            f"{row['clips']:,} of {row['asked']:,} tiny previews, 2 frames of 32 px, on a Dask cluster of",
            f"{row['workers']} processes of this machine, in {row['wall']} s beside other work. The process that hands",
            f"out, with client, scheduler and the table, takes {row['client']} ms of CPU a clip (the bar is 10).",
        ),
        "",
        *table(["clips", "memory of the client, MiB"], memory),
    ]


def main() -> None:
    """Run it by itself, and write its results."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--clips", type=int, default=CLIPS)
    parser.add_argument("--limit", type=float, default=LIMIT)
    options = parser.parse_args()
    machine = this_machine()
    text = f"{machine.cores} cores, {machine.machine}, Python {sys.version.split()[0]}"
    rows = measured(options.clips, options.limit)
    RESULTS.write_text(json.dumps({"machine": text, "rows": rows}, indent=1))
    print(json.dumps(rows, indent=1))


if __name__ == "__main__":
    main()
