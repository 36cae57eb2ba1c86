"""`physgen perceive`: seconds a stage and peak memory, by the photo's size; and what first clips show."""

from __future__ import annotations

import json
import os
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from subprocess import run
from typing import Any

import cv2
import numpy as np
import yaml

from physgen.simulate.trajectory import read_trajectory

ROOT = Path(__file__).resolve().parents[1]
PHOTOS = ("kitchen", "billiards")
SIZES = ((512, 512), (3840, 2160))
"""px; photos are stretched to them."""
SIDES = (512, 1024, 1600, 3840)
"""px: longer sides of the photos whose stages are measured."""
BASELINE = "PHYSGEN_BASELINE"
"""Environment variable: a checkout whose stages are measured beside those of this one."""
ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"), "1")


def perceiving(folder: Path) -> list[dict]:
    rows = []
    for name in PHOTOS:
        for size in SIZES:
            photo = folder / f"{name}-{size[0]}.png"
            rgb = cv2.imread(str(ROOT / "scenes" / name / "photo.png"))
            cv2.imwrite(
                str(photo), cv2.resize(rgb, size, interpolation=cv2.INTER_CUBIC)
            )
            out = run(
                [sys.executable, __file__, str(photo)],
                check=True,
                capture_output=True,
                text=True,
            ).stdout
            rows.append(
                {"photo": name, "width": size[0], "height": size[1], **json.loads(out)}
            )
    return rows


def timed(photo: Path) -> dict:
    """Wall seconds of each stage of one run, the number of objects, and MiB of memory at the peak."""
    from physgen import pipeline
    from physgen.scene.load import load

    marks: list[tuple[str, float]] = []
    with tempfile.TemporaryDirectory() as folder:
        scene = Path(folder) / "scene.yaml"
        start = time.perf_counter()
        pipeline.perceive(
            photo,
            scene,
            side=4096,
            progress=lambda stage, done, most: marks.append(
                (stage, time.perf_counter())
            ),
        )
        end = time.perf_counter()
        objects = len(load(scene).objects)
    stages = {"read": round(marks[0][1] - start, 2)}
    for (stage, at), after in zip(
        marks, [at for _, at in marks[1:]] + [end], strict=True
    ):
        stages[stage] = round(stages.get(stage, 0.0) + after - at, 2)
    status = Path("/proc/self/status").read_text().split("VmHWM:")[1]
    return {
        "objects": objects,
        "stages": stages,
        "memory": round(int(status.split()[0]) / 1024),
    }


def stage_costs(folder: Path) -> list[dict]:
    """CPU seconds of each stage by the photo's size; beside those of `BASELINE`, if it is set."""
    checkouts = {"now": str(ROOT)}
    if baseline := os.environ.get(BASELINE):
        checkouts["before"] = baseline
    rows = []
    for name in PHOTOS:
        rgb = cv2.imread(str(ROOT / "scenes" / name / "photo.png"))
        for side in SIDES:
            photo = folder / f"{name}-{side}.png"
            scale = side / max(rgb.shape[:2])
            way = cv2.INTER_AREA if scale < 1 else cv2.INTER_CUBIC
            resized = cv2.resize(rgb, None, fx=scale, fy=scale, interpolation=way)
            cv2.imwrite(str(photo), resized)
            for code, checkout in checkouts.items():
                environment = os.environ | ONE_THREAD | {"PYTHONPATH": checkout}
                command = [sys.executable, __file__, str(photo), "--stages"]
                out = run(
                    command,
                    check=True,
                    capture_output=True,
                    text=True,
                    env=environment,
                ).stdout
                row = {"photo": name, "side": side, "code": code}
                rows.append(row | json.loads(out))
    return rows


def staged(photo: Path) -> dict:
    """CPU seconds of one run, of its roles and its first motion, and MiB of memory at the peak."""
    from physgen import pipeline
    from physgen.pipeline import perceiving as stages
    from physgen.registry import Backends

    cv2.setNumThreads(1)
    costs: dict[str, float] = {}

    def measured(name: str, call: Callable[..., Any], *arguments: Any) -> Any:
        start = time.thread_time()
        try:
            return call(*arguments)
        finally:
            seconds = time.thread_time() - start
            costs[name] = round(costs.get(name, 0.0) + seconds, 2)

    run_role, start_motion = Backends.run, stages.start_motion
    Backends.run = lambda crew, role, use: measured(role, run_role, crew, role, use)
    stages.start_motion = lambda *given: measured("push", start_motion, *given)
    with tempfile.TemporaryDirectory() as folder:
        start = time.process_time()
        pipeline.perceive(photo, Path(folder) / "scene.yaml", side=4096)
        cpu = time.process_time() - start
    status = Path("/proc/self/status").read_text().split("VmHWM:")[1]
    memory = round(int(status.split()[0]) / 1024)
    return {"cpu": round(cpu, 2), "memory": memory, "stages": costs}


def first_clips(folder: Path) -> list[dict]:
    """`perceive`, then `render`: what moves, also with `--still`, and how long the file is; bundled photos, peers'."""
    photos = {
        path.parent.name: path for path in sorted((ROOT / "scenes").glob("*/photo.png"))
    }
    if peers := os.environ.get("PHYSGEN_PEER_SCENES"):
        photos |= {
            f"peer-{path.parent.name}": path
            for path in sorted(Path(peers).glob("*/original.png"))
        }
    rows = []
    for name, photo in photos.items():
        row: dict = {"photo": name}
        for key, flags in (("moved", []), ("still", ["--still"])):
            scene = folder / key / f"{name}.yaml"
            scene.parent.mkdir(exist_ok=True)
            for command in (
                ["perceive", str(photo), "-o", str(scene), *flags],
                ["render", str(scene), "--preview", "-o", str(folder / key)],
            ):
                run(
                    [sys.executable, "-m", "physgen", *command],
                    check=True,
                    capture_output=True,
                )
            loaded = read_trajectory(folder / key / name / "trajectory.npz")
            off = np.hypot(
                *np.moveaxis(loaded.poses[..., :2] - loaded.poses[:1, :, :2], -1, 0)
            )
            row[key] = round(float(off.max(initial=0.0)), 2)
        document = yaml.safe_load((folder / "moved" / f"{name}.yaml").read_text())
        first, last = (
            _line_of(folder / "moved" / f"{name}.yaml", key)
            for key in ("objects", "boundaries")
        )
        row |= {"objects": len(document["objects"]), "lines": last - first - 1}
        rows.append(row)
    return rows


def _line_of(scene: Path, key: str) -> int:
    return next(
        k
        for k, line in enumerate(scene.read_text().splitlines())
        if line.startswith(f"{key}:")
    )


if __name__ == "__main__":
    measure = staged if "--stages" in sys.argv else timed
    print(json.dumps(measure(Path(sys.argv[1]))))
