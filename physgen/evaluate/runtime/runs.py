"""Run records -> the times of every stage: manifests of clips, and what perceiving with models left in the assets."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import isfinite
from pathlib import Path
from typing import Any

from physgen.batch.clips import MANIFEST, checked_folders, find_clips
from physgen.environment import Machine
from physgen.problems import InputError, Place, Problem, Severity, Warn, ignore_warning

PERCEIVED = "perceived.json"
MOST = 20
"""Manifests without times that are told of."""


@dataclass(frozen=True)
class Time:
    """What a stage took."""

    wall: float
    """s."""
    cpu: float | None
    """s of all threads; None: not recorded."""


@dataclass(frozen=True)
class Run:
    """One clip, or one photo that was perceived."""

    name: str
    stages: Mapping[str, Time]
    """As the record calls them; steps of perceiving by their role, with `perceive ` before it."""
    machine: str
    device: str = "cpu"
    """What drew, or ran models."""
    versions: Mapping[str, str] = field(default_factory=dict)
    frames: int = 0
    size: tuple[int, int] = (0, 0)
    """Width and height of the video, px."""
    models: tuple[str, ...] = ()
    """Backends, others than the core's own, by `role=name`."""


def read_runs(roots: Sequence[Path], warn: Warn = ignore_warning) -> list[Run]:
    """Every clip below `roots` that tells its times; `warn` hears of others. Raises InputError where none does."""
    found: list[Run] = []
    left: list[Problem] = []
    for clip in find_clips(checked_folders(roots)):
        run = None if clip.told is None else _run(clip.name, clip.folder, clip.told)
        if run is not None:
            found.append(run)
            continue
        expected = "cannot be read" if clip.told is None else "tells no times of its stages"
        place = Place(str(clip.folder / MANIFEST))
        left.append(Problem(place, "", "", expected, "make the clip again: physgen render", Severity.WARNING))
    if not found:
        if left:
            raise InputError(replace(problem, severity=Severity.ERROR) for problem in left[:MOST])
        fix = "name folders that physgen render or sweep made, or add --measure"
        raise InputError.of(", ".join(map(str, roots)), "", "holds no clips", fix)
    for problem in left[:MOST]:
        warn(problem)
    return found


def _run(name: str, folder: Path, told: Mapping[str, Any]) -> Run | None:
    try:
        stages = {
            stage: Time(float(times["wall"]), float(times["cpu"])) for stage, times in told["stages"].items()
        }
    except (KeyError, TypeError, ValueError, AttributeError):
        return None
    if not stages or not all(isfinite(one.wall) and one.wall >= 0 for one in stages.values()):
        return None
    platform = told.get("platform") or {}
    seen, models = _perceived(folder, told)
    refine = told.get("refine") or {}
    if refine.get("backend") not in (None, "none"):
        models = (*models, f"refine={refine['backend']}")
    video = told.get("video") or {}
    size = video.get("size") or (0, 0)
    return Run(
        name=name,
        stages=stages | seen,
        machine=_machine(platform),
        device=str(refine.get("device") or told.get("device") or "cpu"),
        versions={str(k): str(v) for k, v in (told.get("versions") or {}).items()},
        frames=len(told.get("frames") or ()),
        size=(int(size[0]), int(size[1])),
        models=models,
    )


def _machine(platform: Mapping[str, Any]) -> str:
    """As the manifest names it; older manifests do not tell the processor."""
    if "processor" not in platform:
        kind = " ".join(str(platform[key]) for key in ("machine", "system") if platform.get(key))
        return f"{kind or 'unknown'}, model not recorded"
    known = {key: platform.get(key) for key in ("machine", "system", "processor", "cores", "memory_gib")}
    return str(Machine(**known))  # type: ignore[arg-type]


def _perceived(folder: Path, told: Mapping[str, Any]) -> tuple[dict[str, Time], tuple[str, ...]]:
    """Steps of perceiving, where models had a part in it and the scene is still where it was."""
    assets = (told.get("document") or {}).get("assets")
    source = told.get("source")
    if not assets or not source or "://" in str(source):
        return {}, ()
    file = (folder / str(source)).parent / str(assets) / PERCEIVED
    try:
        steps = json.loads(file.read_text(encoding="utf-8"))["steps"]
        times: dict[str, Time] = {}
        for step in steps:
            name = f"perceive {step['role']}"
            times[name] = Time(times.get(name, Time(0, None)).wall + float(step["seconds"]), None)
        models = tuple(
            dict.fromkeys(f"{step['role']}={step['backend']}" for step in steps if step.get("weights"))
        )
    except (OSError, ValueError, KeyError, TypeError):
        return {}, ()
    return times, models
