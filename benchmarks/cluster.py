"""A Dask cluster against processes: the same clips, in turns; what handing a clip out costs; a worker killed midway.

    python benchmarks/run.py cluster         # some 15 minutes on an idle machine
    python benchmarks/cluster.py killed      # a part of it, printed

Clips are those of batch.py: variants of a bundled scene, 16 frames of 256 px.
"""

from __future__ import annotations

import json
import os
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from statistics import median

from batch import SMALL, TINY, physgen, sets, timed, variants
from distributed import LocalCluster

from physgen.batch import cluster as farm
from physgen.batch.run import Job
from physgen.pipeline import Page, RenderOptions, load

CLIPS, TURNS = 100, 5
WAYS = ("processes", "dask")


def local(clips: int = CLIPS, turns: int = TURNS) -> list[dict]:
    """Wall and CPU seconds of a run with two processes and with two local workers; ratios of each turn's two."""
    taken: dict[str, list[tuple[float, float]]] = {way: [] for way in WAYS}
    with tempfile.TemporaryDirectory() as name, workers(Path(name), 2) as (file, _):
        folder = Path(name)
        for turn in range(turns):
            scene = variants(folder / str(turn), clips)
            made = len(load(scene).variants) + 1
            for way in WAYS if turn % 2 else WAYS[::-1]:
                flags = ["--variant", "all", "--report", "none", "--jobs", "2", "--no-cache", *sets(*SMALL)]
                flags += ["--cluster", f"dask={file}"] if way == "dask" else []
                command = physgen("render", str(scene), "-o", str(folder / "out"), *flags)
                taken[way].append(timed(command, folder / "cache"))
                shutil.rmtree(folder / "out")
    rows = []
    for way, runs in taken.items():
        walls, cpus = [w for w, _ in runs], [c for _, c in runs]
        rates = sorted(p / w for (p, _), (w, _) in zip(taken["processes"], runs, strict=True))
        loads = sorted(c / p for (_, p), (_, c) in zip(taken["processes"], runs, strict=True))
        rows.append(
            {
                "way": way,
                "clips": made,
                "wall": round(median(walls), 1),
                "cpu": round(median(cpus), 1),
                "rate": [round(value, 3) for value in (rates[0], median(rates), rates[-1])],
                "load": [round(value, 3) for value in (loads[0], median(loads), loads[-1])],
            }
        )
    return rows


def handing(clips: int = 400) -> float:
    """CPU ms a clip of the process that hands out, with client, scheduler and workers' loops in it."""
    run = subprocess.run(
        [sys.executable, "-c", f"import cluster; cluster.handed({clips})"],
        check=True, capture_output=True, text=True, cwd=Path(__file__).parent,
    )  # fmt: skip
    return float(run.stdout)


def handed(clips: int) -> None:
    """Prints it; of clips that are hardly any work, without what starting takes."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "tiny.yaml").write_text(TINY)
        jobs = [
            Job(
                str(folder / "tiny.yaml"),
                RenderOptions(overrides=(f"objects.ball.mass={k + 1}",), page=Page.NONE, name=f"c{k}"),
                str(folder / "out"),
            )
            for k in range(clips)
        ]
        begun = 0.0
        with LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as local:
            for number, done in enumerate(farm.run_on_cluster(f"dask={local.scheduler_address}", jobs)):
                assert done.folder is not None
                if number == clips // 4:
                    begun = _own()
        print(round(1000 * (_own() - begun) / (clips - clips // 4 - 1), 2))


def _own() -> float:
    used = resource.getrusage(resource.RUSAGE_SELF)
    return used.ru_utime + used.ru_stime


@contextmanager
def workers(folder: Path, count: int) -> Iterator[tuple[Path, list[subprocess.Popen[bytes]]]]:
    """A scheduler as `dask scheduler` starts it, and workers; its file and theirs processes."""
    file = folder / "scheduler.json"
    python, quiet = [sys.executable, "-m"], {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    scheduler = subprocess.Popen(
        [*python, "distributed.cli.dask_scheduler", "--port", "0", "--no-dashboard", "--scheduler-file", str(file)],
        cwd=folder, **quiet,
    )  # fmt: skip
    command = [*python, "distributed.cli.dask_worker", "--scheduler-file", str(file), "--nthreads", "1"]
    crew = [
        subprocess.Popen([*command, "--no-nanny", "--no-dashboard"], cwd=folder, **quiet)
        for _ in range(count)
    ]
    try:
        while not file.exists():
            time.sleep(0.05)
        yield file, crew
    finally:
        for process in (*crew, scheduler):
            process.kill()
            process.wait()


def killed(clips: int = 60, after: int = 15) -> dict:
    """Two workers of a scheduler, of which one is killed after so many clips; compared with a local run."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        scene = variants(folder, clips)
        flags = [str(scene), "--variant", "all", "--report", "none", "--no-cache", "--json", *sets(*SMALL)]
        timed(physgen("render", *flags, "-o", str(folder / "never")), folder / "cache")
        with workers(folder, 2) as (file, crew):
            run = subprocess.Popen(
                physgen("render", *flags, "-o", str(folder / "killed"), "--cluster", f"dask={file}"),
                stdout=subprocess.PIPE, text=True, env={**os.environ, "XDG_CACHE_HOME": str(folder / "cache")},
            )  # fmt: skip
            assert run.stdout is not None
            lines = []
            for line in run.stdout:
                lines.append(json.loads(line))
                if len(lines) == after:
                    crew[0].send_signal(signal.SIGKILL)
            assert run.wait() == 0
        *_, last = lines
        files = [p.relative_to(folder / "never") for p in (folder / "never").rglob("*")]
        files = [p for p in files if p.suffix in (".mp4", ".npz")]
        equal = 0
        with suppress(FileNotFoundError):
            equal = sum(
                (folder / "never" / p).read_bytes() == (folder / "killed" / p).read_bytes() for p in files
            )
        left = [p.name for p in (folder / "killed").iterdir() if p.name.startswith(".")]
    there = last["made"] + last["unchanged"]
    return {
        "clips": last["clips"],
        "after": after,
        "there": there,
        "files": len(files),
        "equal": equal,
        "left": len(left),
    }


def cluster(folder: Path) -> list[dict]:
    return [{"local": local()}, {"handing": handing()}, {"killed": killed()}]


if __name__ == "__main__":
    for part in sys.argv[1:]:
        print(json.dumps(globals()[part](), indent=1))
