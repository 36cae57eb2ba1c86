"""Many clips: throughput with one and two processes, what each costs beside its stages, a second run, memory.

    python benchmarks/run.py batch           # some 25 minutes on an idle machine
    python benchmarks/batch.py throughput    # a part of it, kept with the others

Clips are variants of a bundled scene, 16 frames of 256 px; runs with one and with two processes take turns.
"""

from __future__ import annotations

import json
import os
import platform
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from statistics import median

from physgen.batch.run import Job, run
from physgen.pipeline import Page, RenderOptions

ROOT = Path(__file__).resolve().parent.parent
SCENE = ROOT / "scenes" / "dominoes" / "scene.yaml"
SMALL = ("render.size=[256,144]", "world.duration=0.5333", "render.frames=16")
CLIPS, TURNS = 1000, 4
TINY = """\
physgen: 1
size: [32, 24]
world: {duration: 0.1}
objects:
  ball: {shape: {circle: {center: [12, 12], radius: 5}}}
render: {fps: 20}
"""
PEAK = """\
import sys
from physgen.cli.main import main
code = main(sys.argv[1:])
print(open("/proc/self/status").read().split("VmHWM:")[1].split()[0], file=sys.stderr)
sys.exit(code)
"""
"""Runs the command line in a process of its own and tells its peak memory, KiB."""


def variants(folder: Path, clips: int) -> Path:
    """A scene file that extends the bundled one, with as many variants, each with another push."""
    edits = {f"v{k:04d}": {"forces[0].force": [30000 + k, 0]} for k in range(clips)}
    shutil.copytree(SCENE.parent, folder / "dominoes", dirs_exist_ok=True)
    path = folder / "many" / "many.yaml"
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("extends: ../dominoes/scene.yaml\nvariants: " + json.dumps(edits))
    return path


def sets(*edits: str) -> list[str]:
    return [part for edit in edits for part in ("--set", edit)]


def timed(command: list[str], home: Path) -> tuple[float, float]:
    """Wall and CPU seconds of a command and all its processes."""
    before, begun = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    subprocess.run(
        command,
        check=True,
        stdout=subprocess.DEVNULL,
        env={**os.environ, "XDG_CACHE_HOME": str(home)},
    )
    wall, after = (
        time.perf_counter() - begun,
        resource.getrusage(resource.RUSAGE_CHILDREN),
    )
    return wall, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def physgen(*arguments: str) -> list[str]:
    return [sys.executable, "-m", "physgen", *arguments]


def throughput(clips: int = CLIPS) -> list[dict]:
    """Clips a second and CPU seconds a clip with 1 and 2 processes."""
    taken: dict[int, list[tuple[float, float]]] = {1: [], 2: []}
    share = clips // TURNS
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for turn in range(TURNS):
            scene = variants(folder / str(turn), share)
            for jobs in (1, 2) if turn % 2 else (2, 1):
                out = folder / "out"
                flags = [
                    "--variant",
                    "all",
                    "--report",
                    "none",
                    "--jobs",
                    str(jobs),
                    "--no-cache",
                    *sets(*SMALL),
                ]
                taken[jobs].append(
                    timed(
                        physgen("render", str(scene), "-o", str(out), *flags),
                        folder / "cache",
                    )
                )
                shutil.rmtree(out)
    made = TURNS * (share + 1)
    rows = []
    for jobs, turns in taken.items():
        wall, cpu = sum(w for w, _ in turns), sum(c for _, c in turns)
        rows.append(
            {
                "jobs": jobs,
                "clips": made,
                "rate": round(made / wall, 3),
                "cpu": round(cpu / made, 4),
            }
        )
    one, two = rows
    rates = [
        round(alone / both, 2)
        for (alone, _), (both, _) in zip(taken[1], taken[2], strict=True)
    ]
    ratio, more = two["rate"] / one["rate"], two["cpu"] / one["cpu"]
    return [*rows, {"ratio": round(ratio, 3), "turns": rates, "more": round(more, 3)}]


def beside(clips: int = 60) -> dict:
    """ms of CPU a clip, stage by stage, and what is no stage's; in this process, after the first clip."""
    with tempfile.TemporaryDirectory() as name:
        out = Path(name)
        jobs = [
            Job(
                str(SCENE),
                RenderOptions(
                    overrides=(*SMALL, f"forces[0].force=[{30000 + k}, 0]"),
                    command=("physgen",),
                    page=Page.NONE,
                    name=f"c{k}",
                    cached=False,
                ),
                str(out),
            )
            for k in range(clips + 1)
        ]
        assert run(jobs[0]).folder is not None
        begun = time.process_time()
        for job in jobs[1:]:
            assert run(job).folder is not None
        whole = (time.process_time() - begun) / clips
        stages: dict[str, float] = {}
        for job in jobs[1:]:
            for stage, took in json.loads((job.folder / "timing.json").read_text())[
                "stages"
            ].items():
                stages[stage] = stages.get(stage, 0.0) + took["cpu"] / clips
    return {
        "whole": round(1000 * whole, 2),
        "stages": {stage: round(1000 * took, 2) for stage, took in stages.items()},
        "beside": round(1000 * (whole - sum(stages.values())), 2),
    }


def again(clips: int = CLIPS) -> dict:
    """Seconds of a run that finds all clips, the page of all included."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        scene = variants(folder, clips)
        flags = [
            "--variant",
            "all",
            "--report",
            "none",
            "--jobs",
            "2",
            *sets(*SMALL[:1], "render.frames=2"),
        ]
        command = physgen("render", str(scene), "-o", str(folder / "out"), *flags)
        timed(command, folder / "cache")
        walls = [timed(command, folder / "cache") for _ in range(3)]
    return {
        "clips": clips + 1,
        "wall": round(median(w for w, _ in walls), 2),
        "cpu": round(median(c for _, c in walls), 2),
    }


def parent(counts: tuple[int, ...] = (100, 1000, 10000)) -> list[dict]:
    """MiB that the process that hands out the work takes at most."""
    rows = []
    for count in counts:
        with tempfile.TemporaryDirectory() as name:
            folder = Path(name)
            (folder / "tiny.yaml").write_text(TINY)
            command = [
                sys.executable,
                "-c",
                PEAK,
                "sweep",
                str(folder / "tiny.yaml"),
                f"objects.ball.mass=1:100:{count}",
            ]
            flags = ["-o", str(folder / "out"), "--report", "none", "--jobs", "2"]
            done = subprocess.run(
                [*command, *flags],
                check=True,
                capture_output=True,
                text=True,
                cwd=folder,
            )
            rows.append(
                {"clips": count, "mib": round(int(done.stderr.split()[-1]) / 1024, 1)}
            )
    return rows


def sizes(clips: int = 8) -> list[dict]:
    """Bytes a clip, file by file, the mean of some; reports and pictures of a gallery, too."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        flags = [f"forces[0].force[0]=30000:{29999 + clips}:{clips}", *sets(*SMALL)]

        def mean(out: str, *files: str) -> int:
            found = [path for file in files for path in (folder / out).glob(file)]
            return round(sum(path.stat().st_size for path in found) / clips)

        for report in ("none", "full"):
            command = physgen(
                "sweep",
                str(SCENE),
                *flags,
                "-o",
                str(folder / report),
                "--report",
                report,
            )
            timed(command, folder / "cache")
        lines = (folder / "none" / "sweep.csv").read_bytes().splitlines(keepends=True)
        told = {
            name: mean("none", f"*/{name}")
            for name in ("video.mp4", "trajectory.npz", "manifest.json")
        }
        told |= {
            "a row of sweep.csv": round(sum(map(len, lines[1:])) / clips),
            "report.html": mean("full", "*/report.html"),
            "pictures for a gallery": mean("none", "index.files/*"),
            "its part of index.html": mean("none", "index.html"),
        }
    return [{"file": file, "bytes": size} for file, size in told.items()]


def stopped(times: int = 10) -> dict:
    """Seconds from Ctrl-C to the end of two processes that draw."""
    took = []
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        scene = variants(folder, 50)
        for number in range(times):
            out = folder / str(number)
            flags = [
                "--variant",
                "all",
                "--report",
                "none",
                "--jobs",
                "2",
                "--no-cache",
            ]
            process = subprocess.Popen(
                physgen("render", str(scene), "-o", str(out), *flags),
                stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, start_new_session=True,
            )  # fmt: skip
            while not list(out.glob(".*.part")):
                time.sleep(0.02)
            time.sleep(0.3 + 0.17 * number)
            begun = time.perf_counter()
            os.killpg(process.pid, signal.SIGINT)
            assert process.wait() == 130
            took.append(time.perf_counter() - begun)
            assert not list(out.glob(".*.part"))
    return {
        "times": times,
        "median": round(median(took), 2),
        "most": round(max(took), 2),
    }


def batch(folder: Path) -> list[dict]:
    return [
        {"throughput": throughput()},
        {"beside": beside()},
        {"again": again()},
        {"parent": parent()},
        {"stopped": stopped()},
        {"sizes": sizes()},
    ]


def kept(name: str) -> None:
    """One part measured anew, in the committed results of all."""
    path = ROOT / "benchmarks" / "results" / "batch.json"
    result = json.loads(path.read_text()) if path.exists() else {"rows": []}
    machine = f"{os.cpu_count()} cores, {platform.machine()}, Python {platform.python_version()}"
    rows = [row for row in result["rows"] if name not in row] + [
        {name: globals()[name]()}
    ]
    path.write_text(json.dumps({"machine": machine, "rows": rows}, indent=1) + "\n")


if __name__ == "__main__":
    for part in sys.argv[1:]:
        kept(part)
