"""A batch that is killed 50 times at random moments, run again each time, against the same batch never killed.

    python benchmarks/run.py kills           # some minutes; the log goes to benchmarks/results/kills.json

SIGKILL goes to the process that hands out the work, to one of its two workers, or to all of them at once. After each
kill every clip under its final name is read whole; at the end bytes are compared, and what was left over is counted.
"""

from __future__ import annotations

import hashlib
import json
import os
import random
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from batch import SMALL, physgen, sets, variants

KILLS, CLIPS = 50, 60
WHO = ("parent", "worker", "all")


def started(scene: Path, out: Path) -> subprocess.Popen[bytes]:
    flags = ["--variant", "all", "--report", "none", "--jobs", "2", *sets(*SMALL)]
    return subprocess.Popen(
        physgen("render", str(scene), "-o", str(out), *flags),
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        start_new_session=True,
        env={**os.environ, "XDG_CACHE_HOME": str(scene.parent / "cache")},
    )


def whole(out: Path) -> tuple[int, int]:
    """Clips under their final names, and how many of these are not what their manifests say."""
    count = damaged = 0
    for manifest in out.glob("*/manifest.json"):
        if not manifest.parent.name.startswith("."):
            files = json.loads(manifest.read_text())["files"]
            same = (
                hashlib.sha256((manifest.parent / name).read_bytes()).hexdigest() == sha
                for name, sha in files.items()
            )
            count, damaged = count + 1, damaged + (not all(same))
    return count, damaged


def leftovers(folder: Path) -> int:
    return sum(path.name.endswith((".part", ".old")) for path in folder.rglob(".*"))


def sums(out: Path) -> dict[str, str]:
    """Of all videos and motions; and what manifests say, without times."""
    found = {}
    for path in sorted(out.glob("*/*")):
        data = path.read_bytes()
        if path.name == "manifest.json":
            told = json.loads(data)
            data = json.dumps(
                [told[key] for key in ("frames", "samples", "files", "inputs", "mark")]
            ).encode()
        found[path.relative_to(out).as_posix()] = hashlib.sha256(data).hexdigest()
    return found


def workers(parent: int) -> list[int]:
    try:
        return list(
            map(int, Path(f"/proc/{parent}/task/{parent}/children").read_text().split())
        )
    except OSError:
        return []


def kills(home: Path, times: int = KILLS) -> list[dict]:
    chance = random.Random(7)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        scene = variants(folder, CLIPS)
        never, out = folder / "never", folder / "out"
        assert started(scene, never).wait() == 0
        log = []
        for number in range(times):
            run, who = started(scene, out), WHO[number % len(WHO)]
            moment = chance.uniform(0.5, 6.0)
            time.sleep(moment)
            crew = workers(run.pid)
            if run.poll() is not None:
                who = "none: it was done"
            elif who == "all":
                os.killpg(run.pid, signal.SIGKILL)
            elif who == "worker" and len(crew) > 1:
                os.kill(chance.choice(crew[1:]), signal.SIGKILL)
                time.sleep(0.5)  # it goes on with another
                run.kill()
            else:
                run.kill()
            run.wait()
            time.sleep(0.7)  # workers whose parent is gone end by themselves
            count, damaged = whole(out)
            log.append(
                {
                    "after": round(moment, 2),
                    "killed": who,
                    "whole": count,
                    "damaged": damaged,
                    "left": leftovers(folder),
                }
            )
            if count > CLIPS * 0.9:  # begin anew: every kill shall meet work under way
                for manifest in chance.sample(
                    sorted(out.glob("*/manifest.json")), CLIPS * 3 // 4
                ):
                    for file in manifest.parent.iterdir():
                        file.unlink()
                    manifest.parent.rmdir()
        last = started(scene, out)
        assert last.wait() == 0
        end = {
            "kills": times,
            "clips": len(list(out.glob("*/manifest.json"))),
            "same": sums(out) == sums(never),
            "left": leftovers(folder),
            "most_left": max(row["left"] for row in log),
        }
        return [end, *log]


if __name__ == "__main__":
    print(
        json.dumps(
            kills(Path(), int(sys.argv[1]) if len(sys.argv) > 1 else KILLS), indent=1
        )
    )
