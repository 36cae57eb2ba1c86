"""Seconds a stage and peak memory of `physgen perceive`, by the photo's size; each run is a process of its own."""

from __future__ import annotations

import json
import sys
import tempfile
import time
from pathlib import Path
from subprocess import run

import cv2

ROOT = Path(__file__).resolve().parents[1]
PHOTOS = ("kitchen", "billiards")
SIZES = ((512, 512), (3840, 2160))
"""px; photos are stretched to them."""


def perceiving(folder: Path) -> list[dict]:
    rows = []
    for name in PHOTOS:
        for size in SIZES:
            photo = folder / f"{name}-{size[0]}.png"
            rgb = cv2.imread(str(ROOT / "scenes" / name / "photo.png"))
            cv2.imwrite(str(photo), cv2.resize(rgb, size, interpolation=cv2.INTER_CUBIC))
            out = run(
                [sys.executable, __file__, str(photo)], check=True, capture_output=True, text=True
            ).stdout
            rows.append({"photo": name, "width": size[0], "height": size[1], **json.loads(out)})
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
            progress=lambda stage, done, most: marks.append((stage, time.perf_counter())),
        )
        end = time.perf_counter()
        objects = len(load(scene).objects)
    stages = {"read": round(marks[0][1] - start, 2)}
    for (stage, at), after in zip(marks, [at for _, at in marks[1:]] + [end], strict=True):
        stages[stage] = round(stages.get(stage, 0.0) + after - at, 2)
    status = Path("/proc/self/status").read_text().split("VmHWM:")[1]
    return {"objects": objects, "stages": stages, "memory": round(int(status.split()[0]) / 1024)}


if __name__ == "__main__":
    print(json.dumps(timed(Path(sys.argv[1]))))
