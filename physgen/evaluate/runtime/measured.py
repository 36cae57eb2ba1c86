"""A photo -> runs made now, offline: perceived and rendered, each stage timed."""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from physgen import pipeline
from physgen.environment import this_machine
from physgen.evaluate.runtime.runs import Run, Time
from physgen.problems import InputError
from physgen.registry import Backends
from physgen.report.record import versions

Progress = Callable[[str, int, int], None]


class TimedCrew(Backends):
    """A crew that also tells the processor's time of each role."""

    def __init__(self) -> None:
        super().__init__()
        self.cpu: list[float] = []

    def run(self, role: str, use: Callable[[Any], Any]) -> Any:
        """As every crew's."""
        begun = time.process_time()
        try:
            return super().run(role, use)
        finally:
            self.cpu.append(time.process_time() - begun)


def measure(photo: Path, repeat: int, progress: Progress) -> list[Run]:
    """`repeat` runs; the first also pays for what is imported and read once. Raises InputError for a bad photo."""
    if not photo.is_file():
        fix = "name a photo: --measure photo.jpg"
        raise InputError.of("--measure", f'"{photo}"', "is no photo", fix)
    runs = []
    for k in range(repeat):
        with TemporaryDirectory(prefix="physgen-runtime-") as folder:
            runs.append(_once(photo, Path(folder), f"{photo.stem} {k + 1}", k, repeat, progress))
    return runs


def _once(photo: Path, folder: Path, name: str, index: int, repeat: int, progress: Progress) -> Run:
    scene = folder / "scene.yaml"
    crew = TimedCrew()
    progress("perceive", index, repeat)
    wall, cpu = time.perf_counter(), time.process_time()
    pipeline.perceive(photo, scene, crew=crew)
    stages: dict[str, Time] = {}
    for step, spent in zip(crew.steps, crew.cpu, strict=True):
        before = stages.get(f"perceive {step.role}", Time(0, 0))
        stages[f"perceive {step.role}"] = Time(before.wall + step.seconds, (before.cpu or 0) + spent)
    left = time.perf_counter() - wall - sum(one.wall for one in stages.values())
    unspent = time.process_time() - cpu - sum(one.cpu or 0 for one in stages.values())
    stages["perceive files"] = Time(max(left, 0.0), max(unspent, 0.0))
    progress("render", index, repeat)
    clip = pipeline.render_scene(scene, folder / "out", cached=False)
    told = json.loads((clip / "manifest.json").read_text(encoding="utf-8"))
    stages |= {key: Time(one["wall"], one["cpu"]) for key, one in told["stages"].items()}
    size = told["video"]["size"]
    return Run(
        name, stages, str(this_machine()), told["device"], versions(), len(told["frames"]), (size[0], size[1])
    )
