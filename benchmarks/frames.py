"""What a frame costs: CPU ms a frame and a further object, encoding beside drawing, cold starts, memory at 1080p.

Scenes are drawn by formula: balls with shadows on a table, seen from above, all of them moving.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from unittest.mock import patch

import cv2
import numpy as np
from pymunk._chipmunk_cffi import ffi as CFFI  # noqa: N812 - constants here
from pymunk._chipmunk_cffi import lib as CHIPMUNK  # noqa: N812

from physgen import pipeline
from physgen.export import video
from physgen.geometry.shadows import ShadowSetting, Silhouette, shadow_darkness
from physgen.maps import Percepts, write_assets
from physgen.photometry import DistantLight, encode_u8, sphere_normals
from physgen.render.stage import Stage
from physgen.simulate.trajectory import Trajectory

LIGHT = DistantLight((-0.45, -0.35, 0.82), 0.75, 0.35)
BARS = {
    "frame": 8.0, "object": 0.1, "beside": 1.5, "cold": 1.1, "memory": 600.0, "paper": 10.0, "solver": 3.0,
}  # fmt: skip
"""ms, ms, times the wall time of encoding alone, s, MiB, times as fast, times the solver's own time."""
PAPER = {"pool": 23.3, "domino": 12.7, "pig_ball": 10.3}
"""Wall s of the paper's code, 16 frames, without diffusion, on two cores without a GPU."""
REPEAT = 3


def table(
    folder: Path, size: tuple[int, int], spots: Sequence[tuple[float, float, float]]
) -> Path:
    """A scene of balls at (x, y, radius) px on green cloth, with its maps; they all set off in different directions."""
    width, height = size
    noise = np.random.default_rng(1).normal(0, 0.02, (height, width, 1))
    cloth = np.clip(
        np.array([0.03, 0.2, 0.08])
        * (1 + cv2.GaussianBlur(noise, (0, 0), 1.0)[..., None] * 3),
        0,
        1,
    )
    light, labels = cloth.copy(), np.zeros((height, width), np.uint16)
    setting = ShadowSetting(LIGHT, 3.0, True, 0.07, np.inf, size)
    yy, xx = np.mgrid[:height, :width]
    lines = [
        "physgen: 1", "image: photo.png", "assets: photo.assets",
        "world: {view: top, duration: 1, table: {friction: 0.05}}",
        f"light: {{direction: {list(LIGHT.direction)}, intensity: {LIGHT.intensity}, ambient: {LIGHT.ambient}}}",
        "objects:",
    ]  # fmt: skip
    for x, y, r in spots:
        cover = np.clip(r + 0.5 - np.hypot(xx - x, yy - y), 0, 1).astype(np.float32)
        found = shadow_darkness(
            Silhouette(cover, (0, 0), (x, y), r, 2 * r, None), setting
        )
        assert found is not None
        (x0, y0, x1, y1), dark = found
        light[y0:y1, x0:x1] *= np.exp(-dark)[..., None]
    shadowed = encode_u8(light)
    for k, (x, y, r) in enumerate(spots):
        cover = np.clip(r + 0.5 - np.hypot(xx - x, yy - y), 0, 1)[..., None]
        normals, _ = sphere_normals(height, width, (x, y), r)
        paint = np.array([0.7, 0.15 + 0.5 * (k % 3) / 2, 0.1]) * (
            0.6 + 0.4 * (np.sin(xx / 3 + k) > 0)[..., None]
        )
        light = light * (1 - cover) + cover * paint * LIGHT.shade(normals)[..., None]
        labels[cover[..., 0] >= 0.5] = k + 1
        angle = 2.4 * k
        speed = [
            round(float(90 * np.cos(angle)), 1),
            round(float(90 * np.sin(angle)), 1),
        ]
        shape = f"circle: {{center: [{x}, {y}], radius: {r}}}"
        lines.append(
            f"  ball-{k}: {{mask: {k + 1}, shape: {{{shape}}}, solid: sphere, mass: 100, velocity: {speed}}}"
        )
    folder.mkdir(parents=True, exist_ok=True)
    photo = encode_u8(light)
    cv2.imwrite(str(folder / "photo.png"), photo[..., ::-1])
    write_assets(
        Percepts(
            rgb=photo, labels=labels, coverage=(labels > 0).astype(np.float32), background=shadowed,
            clean=encode_u8(cloth), depth=None, normals=None, albedo=None, shading=None,
        ),
        folder / "photo.assets",
    )  # fmt: skip
    path = folder / "scene.yaml"
    path.write_text("\n".join(lines) + "\n")
    return path


def grid(
    size: tuple[int, int], count: int, radius: float
) -> list[tuple[float, float, float]]:
    """So many balls, evenly apart."""
    columns = int(np.ceil(np.sqrt(count * size[0] / size[1])))
    rows = -(-count // columns)
    return [
        (
            round((k % columns + 0.5) * size[0] / columns, 1),
            round((k // columns + 0.5) * size[1] / rows, 1),
            radius,
        )
        for k in range(count)
    ]


def staged(path: Path, frames: int) -> tuple[Stage, Trajectory, int]:
    """Stage, trajectory and px of object boxes."""
    scene = pipeline.load(path, [f"render.frames={frames}"])
    maps = pipeline.percepts(scene)
    compiled = pipeline.compile(scene, maps)
    stage = pipeline.stage(scene, compiled, maps)
    boxes = sum(
        int(np.prod(np.ptp(np.argwhere(sprite.coverage >= 0.5), axis=0) + 1))
        for sprite in stage.sprites
    )
    return stage, pipeline.simulate(compiled.world), boxes


def drawing(stage: Stage, trajectory: Trajectory) -> float:
    """CPU ms a frame, the least of some runs; relighting and shadows on, nothing encoded."""
    least = np.inf
    for _ in range(REPEAT):
        before = time.process_time()
        for _ in pipeline.render(stage, trajectory):
            pass
        least = min(least, time.process_time() - before)
    return 1000 * least / len(trajectory.times)


def beside(
    stage: Stage, trajectory: Trajectory, size: tuple[int, int]
) -> tuple[float, float]:
    """Wall s of encoding frames that are there, and of drawing them meanwhile; each the least of some runs."""
    frames = [frame.rgb for frame in pipeline.render(stage, trajectory)]
    alone = both = np.inf
    for _ in range(REPEAT):
        with tempfile.TemporaryDirectory() as out:
            before = time.perf_counter()
            with video.open_video(Path(out), video.Format.MP4, size, 30) as write:
                for rgb in frames:
                    write(rgb)
            alone = min(alone, time.perf_counter() - before)
            before = time.perf_counter()
            with (
                video.open_video(Path(out), video.Format.MP4, size, 30) as write,
                video.encode_in_thread([write]) as put,
            ):
                for frame in pipeline.render(stage, trajectory):
                    put(frame.rgb)
            both = min(both, time.perf_counter() - before)
    return alone, both


def cold(path: Path, frames: int, folder: Path) -> tuple[float, float]:
    """Wall s of one `physgen render --format mp4` in a process of its own, the least of some, and MiB at its peak.

    Python keeps compiled files beside the sources, as it does unless told otherwise.
    """
    least = np.inf
    environment = {
        key: value
        for key, value in os.environ.items()
        if key != "PYTHONDONTWRITEBYTECODE"
    }
    bundled = path.name == "scene.yaml"
    for _ in range(REPEAT):
        command = [
            sys.executable,
            "-m",
            "physgen",
            "render",
            str(path),
            "-o",
            str(folder / "out"),
        ]
        command += (
            ["--set", "world.duration=2"] if bundled else []
        )  # its story may be longer
        before = time.perf_counter()
        subprocess.run(
            [
                *command,
                "--no-cache",
                "--format",
                "mp4",
                "--set",
                f"render.frames={frames}",
            ],
            check=True,
            capture_output=True,
            env=environment,
        )
        least = min(least, time.perf_counter() - before)
    name = path.parent.name if bundled else path.stem
    timing = json.loads((folder / "out" / name / "timing.json").read_text())
    return least, timing["peak_memory_mib"]


class TimedSolver:
    """Chipmunk's functions, the step among them timed."""

    def __init__(self) -> None:
        self.seconds = 0.0

    def __getattr__(self, name: str) -> Any:
        return getattr(CHIPMUNK, name)

    def cpSpaceStep(self, space: Any, h: float) -> None:  # noqa: N802 - Chipmunk's name
        begun = time.thread_time()
        CHIPMUNK.cpSpaceStep(space, h)
        self.seconds += time.thread_time() - begun


READERS = SimpleNamespace(
    new=CFFI.new,
    buffer=CFFI.buffer,
    addressof=lambda _, name: CFFI.addressof(CHIPMUNK, name),
)
"""CFFI, which takes addresses from Chipmunk itself alone."""


def beside_solver(path: Path) -> float:
    """CPU time of `simulate` over that of Chipmunk's own steps in it; the least of some runs, each timed alone."""
    scene = pipeline.load(path)
    world = pipeline.compile(scene, pipeline.percepts(scene)).world
    whole = solver = np.inf
    for _ in range(REPEAT):
        begun = time.thread_time()
        pipeline.simulate(world)
        whole, timed = min(whole, time.thread_time() - begun), TimedSolver()
        with (
            patch("physgen.simulate.space.lib", timed),
            patch("physgen.simulate.space.ffi", READERS),
        ):
            pipeline.simulate(world)
        solver = min(solver, timed.seconds)
    return whole / solver


def workload() -> float:
    """Wall s of fixed NumPy and OpenCV work, the least of some runs: how fast a machine is."""
    picture = np.random.default_rng(0).random((1024, 1024, 3)).astype(np.float32)
    least = np.inf
    for _ in range(REPEAT):
        begun = time.perf_counter()
        for _ in range(10):
            cv2.remap(
                picture,
                picture[..., 0] * 1000,
                picture[..., 1] * 1000,
                cv2.INTER_LINEAR,
            )
            np.sqrt(cv2.GaussianBlur(picture, (0, 0), 3)).sum()
            np.linalg.svd(picture[:200, :200, 0])
        least = min(least, time.perf_counter() - begun)
    return least


def frames(
    scenes: dict[str, Path], bundled: Sequence[Path], folder: Path
) -> list[dict]:
    """Rows of measure, scene, figure and bar; `scenes` are measured too, as they are."""
    rows: list[dict] = []

    def row(measure: str, scene: str, found: float, bar: str = "") -> None:
        rows.append(
            {
                "measure": measure,
                "scene": scene,
                "found": round(found, 3),
                "bar": BARS.get(bar),
            }
        )

    sixteen = table(folder / "sixteen", (512, 512), grid((512, 512), 16, 30.5))
    for name, path in {"16 balls": sixteen, **scenes}.items():
        stage, trajectory, boxes = staged(path, 120)
        bar = "frame" if 50_000 < boxes < 70_000 else ""
        row(
            "drawing, CPU ms a frame",
            f"{name}, {boxes:,} px of boxes",
            drawing(stage, trajectory),
            bar,
        )
        size = (stage.background.shape[1], stage.background.shape[0])
        alone, both = beside(stage, trajectory, size)
        row(
            "encoding alone, wall ms a frame",
            name,
            1000 * alone / len(trajectory.times),
        )
        row("drawing while encoding, times as long", name, both / alone, "beside")
    costs = []
    counts = (1, 25, 50, 100, 200)
    for count in counts:
        path = table(
            folder / f"small-{count}", (512, 512), grid((512, 512), count, 8.0)
        )
        stage, trajectory, _ = staged(path, 40)
        costs.append(drawing(stage, trajectory))
        row("drawing, CPU ms a frame", f"{count} small balls", costs[-1])
    row(
        "each further small object, CPU ms",
        "1 to 200",
        float(np.polyfit(counts, costs, 1)[0]),
        "object",
    )
    for name, path in {"16 balls": sixteen, **scenes}.items():
        wall, _ = cold(path, 16, folder)
        row("cold render, 16 frames, wall s", name, wall, "cold")
        if name in PAPER:
            row(
                "cold render, times as fast as the paper's code",
                name,
                PAPER[name] / wall,
                "paper",
            )
    row("fixed NumPy and OpenCV work, wall s", "", workload())
    for path in [*bundled, *(scenes[name] for name in PAPER if name in scenes)]:
        name = path.parent.name if path.name == "scene.yaml" else path.stem
        row(
            "simulate, times the solver's own time", name, beside_solver(path), "solver"
        )
    large = table(folder / "large", (1920, 1080), grid((1920, 1080), 12, 90.0))
    for count in (30, 120):
        _, memory = cold(large, count, folder)
        row("memory at 1920 x 1080, MiB", f"12 balls, {count} frames", memory, "memory")
    return rows
