"""Data sets of very many tiny clips: what planning and writing shards costs a clip, and the memory that it takes.

    python benchmarks/dataset_shards.py                # 1,000 and 10,000 clips
    python benchmarks/dataset_shards.py 100000

One clip with labels is made; the others are other names of the same files, with manifests of their own.
"""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

from physgen import pipeline

SCENE = """\
physgen: 1
size: [48, 32]
world: {duration: 0.4, gravity: [0, 0]}
objects:
  ball: {shape: {circle: {center: [12, 16], radius: 6}}, mass: 100, velocity: [60, 0]}
render: {fps: 20}
"""
FORMATS = ("events", "mot")
COUNTS = (1_000, 10_000)
IN_A_FOLDER = 1_000
LINKS = 30_000
"""Names of one file: disks allow no more than so many."""


def datasets(folder: Path, counts: Sequence[int] = COUNTS) -> list[dict]:
    """Of each number of clips: ms a clip when shards are written and when they are there, and MiB at the most."""
    scene = folder / "tiny.yaml"
    scene.write_text(SCENE, encoding="utf-8")
    clip = pipeline.render_scene(scene, folder / "one", page=pipeline.Page.NONE, export=FORMATS)
    rows = []
    for count in counts:
        many = folder / f"clips-{count}"
        _copied(clip, many, count)
        out = folder / f"data-{count}"
        written, again = (_gathered(many, out) for _ in range(2))
        shards = list(out.glob("*/shard-*.tar"))
        rows.append(
            {
                "clips": count,
                "files": count * sum(path.is_file() for path in clip.rglob("*")),
                "shards": len(shards),
                "mb": round(sum(path.stat().st_size for path in shards) / 1e6, 1),
                "written": round(1000 * written["cpu"] / count, 3),
                "unchanged": round(1000 * again["cpu"] / count, 3),
                "mib": round(max(written["mib"], again["mib"]), 1),
                "idle_mib": round(written["idle"], 1),
            }
        )
    return rows


def _copied(clip: Path, many: Path, count: int) -> None:
    """Clips as a sweep leaves them, so many in a folder."""
    files = [path.relative_to(clip) for path in clip.rglob("*") if path.is_file()]
    folders = [path.relative_to(clip) for path in clip.rglob("*") if path.is_dir()]
    for k in range(count):
        if k and k % LINKS == 0:
            clip = Path(shutil.copytree(clip, many.parent / f"{many.name}-{k}"))
        home = many / f"{k // IN_A_FOLDER:03d}" / f"{k:06d},mass={k}"
        home.mkdir(parents=True)
        for name in folders:
            (home / name).mkdir()
        for name in files:
            os.link(clip / name, home / name)


def _gathered(clips: Path, out: Path) -> dict[str, float]:
    """In a process of its own."""
    command = [sys.executable, __file__, "--gather", str(clips), str(out)]
    return json.loads(subprocess.run(command, check=True, capture_output=True, text=True).stdout)


def _gather(clips: Path, out: Path) -> dict[str, float]:
    from physgen.batch.dataset import DatasetOptions, gather, read_splits

    idle, begun = _mib(), time.process_time()
    asked = DatasetOptions("webdataset", read_splits("train=1", seed=0))
    gather([clips], out, asked, ["benchmark"], warn=lambda problem: sys.exit(str(problem)))
    return {"cpu": time.process_time() - begun, "mib": _mib(), "idle": idle}


def _mib() -> float:
    """The most that this process has held; `ru_maxrss` would tell of the one that started it, too."""
    (line,) = (row for row in Path("/proc/self/status").read_text().splitlines() if row.startswith("VmHWM"))
    return int(line.split()[1]) / 1024


if __name__ == "__main__":
    if sys.argv[1:2] == ["--gather"]:
        print(json.dumps(_gather(Path(sys.argv[2]), Path(sys.argv[3]))))
    else:
        with tempfile.TemporaryDirectory() as home:
            for row in datasets(Path(home), [int(text) for text in sys.argv[1:]] or COUNTS):
                print(row)
