"""Compare times of stages, from the records of clips (manifest.json, perceived.json),
with the paper's table.

Clips of different machines are never mixed.
"""

from __future__ import annotations

import json
import subprocess
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cache
from math import isfinite
from pathlib import Path
from typing import Any

import numpy as np

from physgen.batch.clips import MANIFEST, checked_folders, find_clips
from physgen.environment import Machine
from physgen.evaluate.measure import Findings, Section, Table, number
from physgen.messages import Message
from physgen.problems import InputError, Place, Problem, Severity, Warn, ignore_warning
from physgen.report.record import TIMING
from physgen.scene.files import RECORD, read_record

MAX_PROBLEMS = 20
"""Maximum number of named manifests without times."""
PAPER = 180
""""around 3 minute for a single generation", on an A40, s."""


@dataclass(frozen=True)
class Part:
    """One column of the paper's table."""

    name: str
    paper: float | None
    """Time on an A40 (appendix, runtime analysis), s; None if not in the paper."""
    stages: tuple[str, ...]
    """Our stages for the same work."""


OTHER_ROLES = (
    "depth",
    "normals",
    "intrinsic",
    "light",
    "matte",
    "shadow",
    "boundary",
    "files",
)
PARTS = (
    Part("perception: objects", 50, ("perceive categories", "perceive segment")),
    Part("perception: names, physics", 10, ("perceive label", "perceive physics")),
    Part("perception: background", 20, ("perceive inpaint",)),
    Part(
        "perception: all else", None, tuple(f"perceive {role}" for role in OTHER_ROLES)
    ),
    Part("simulation", 5, ("compile", "simulate", "expose")),
    Part("render", 60, ("cut out", "render", "cover")),
    Part("refinement", 35, ("load model", "refine")),
    Part("reading, encoding, report", None, ("load", "encode", "report")),
)
ORDER = [stage for part in PARTS for stage in part.stages]

Time = tuple[float, float]
"""Wall time and CPU time of all threads, s; NaN for an unrecorded one."""


def total(times: Sequence[Time]) -> Time:
    """Return the sum of times."""
    return sum(wall for wall, _ in times), sum(cpu for _, cpu in times)


@dataclass(frozen=True)
class Run:
    """One clip, or one perceived and rendered photo."""

    name: str
    stages: Mapping[str, Time]
    """Times by the record's names. Steps of perception have their role after `perceive
    `.
    """
    machine: str
    """Machine, with the device for rendering or models, unless it is the CPU."""
    models: tuple[str, ...] = ()
    """Backends with downloaded models, as `role=name`."""

    @property
    def has_perception(self) -> bool:
        """Return whether the steps of perception are recorded."""
        return any(stage.startswith("perceive ") for stage in self.stages)


# ---- records


def read_runs(roots: Sequence[Path], warn: Warn = ignore_warning) -> list[Run]:
    """Return every clip with recorded times below `roots`; `warn` is called for others.

    Raise InputError if there are none.
    """
    runs: list[Run] = []
    problems: list[Problem] = []
    for clip in find_clips(checked_folders(roots)):
        message = Message.MANIFEST_UNREADABLE
        if clip.manifest is not None:
            message = Message.STAGE_TIMES_MISSING
            run = _run(clip.name, clip.folder, clip.manifest)
            if run is not None:
                runs.append(run)
                continue
        problems.append(message.warning(Place(str(clip.folder / MANIFEST))))
    del problems[MAX_PROBLEMS:]
    if runs:
        for problem in problems:
            warn(problem)
        return runs
    if problems:
        raise InputError(
            replace(problem, severity=Severity.ERROR) for problem in problems
        )
    raise Message.FOLDERS_WITHOUT_CLIPS.error(", ".join(map(str, roots)))


def _run(name: str, folder: Path, record: Mapping[str, Any]) -> Run | None:
    """Return the run of a clip, or None without times."""
    stages = _read_stages(folder, record)
    if not stages:
        return None
    perception_times, models = _read_perception(folder, record)
    refinement = record.get("refine") or {}
    if refinement.get("backend") not in (None, "none"):
        models = (*models, f"refine={refinement['backend']}")
    machine = _machine(record.get("platform") or {})
    device = str(refinement.get("device") or record.get("device") or "cpu")
    if device != "cpu":
        machine = f"{machine}; {device}"
    return Run(name, stages | perception_times, machine, models)


def _read_stages(folder: Path, record: Mapping[str, Any]) -> dict[str, Time]:
    """Return the times of a clip's stages, or nothing for missing or wrong ones."""
    stages = {}
    try:
        path = folder / TIMING
        if path.is_file():
            record = json.loads(path.read_bytes())
        for key, times in record["stages"].items():
            stages[key] = (float(times["wall"]), float(times["cpu"]))
    except (OSError, KeyError, TypeError, ValueError, AttributeError):
        return {}
    for wall, _ in stages.values():
        if not isfinite(wall) or wall < 0:
            return {}
    return stages


MACHINE_KEYS = ("machine", "system", "processor", "cores", "memory_gib")


def _machine(platform: Mapping[str, Any]) -> str:
    """Return the machine of a record in words."""
    if "processor" not in platform:
        return "not recorded"
    return str(Machine(**{key: platform[key] for key in MACHINE_KEYS}))


def _read_perception(
    folder: Path, record: Mapping[str, Any]
) -> tuple[dict[str, Time], tuple[str, ...]]:
    """Return the times of the steps of perception, and their models, or nothing for a
    moved scene.
    """
    assets = (record.get("document") or {}).get("assets")
    source = str(record.get("source") or "://")
    if not assets or "://" in source:
        return {}, ()
    times: dict[str, Time] = {}
    models: dict[str, None] = {}
    try:
        steps = read_record((folder / source).parent / str(assets) / RECORD)["steps"]
        for step in steps:
            # A role may run more than once. The record of perception has no CPU times.
            stage = f"perceive {step['role']}"
            step_time = (float(step["seconds"]), np.nan)
            times[stage] = total([times.get(stage, (0.0, np.nan)), step_time])
        for step in steps:
            if step.get("weights"):
                models[f"{step['role']}={step['backend']}"] = None
    except (OSError, ValueError, KeyError, TypeError):
        return {}, ()
    return times, tuple(models)


@cache
def gpu() -> str:
    """Return the GPU's model and memory from nvidia-smi, or `""` without a GPU."""
    command = ["nvidia-smi", "--query-gpu=name,memory.total", "--format=csv,noheader"]
    with suppress(OSError, subprocess.SubprocessError):
        process = subprocess.run(
            command, capture_output=True, text=True, timeout=10, check=True
        )
        lines = [line.strip() for line in process.stdout.splitlines()]
        return "; ".join(line for line in lines if line)
    return ""


# ---- report

HEADS = ("runs", "wall", "from", "to", "CPU")
NOTE = (
    "Seconds; medians over runs, and the least and the most. CPU: of all threads. Whole runs: from photo to video, or "
    "from scene to video where perceiving is not recorded. The paper's parts sum to 180 s."
)
CACHE_NOTE = "What an earlier run left in the cache counts as long as reading it took: --no-cache runs it."
OTHER_PART = "asked for besides"
"""Name of all stages outside the paper's parts."""


def spread(times: Sequence[Time]) -> dict[str, Any]:
    """Return median and range of one or more times, s. The CPU's is None if one is not
    recorded.

    >>> spread([(1.0, 2.0), (3.0, 2.0), (2.0, 9.0)])
    {'runs': 3, 'wall': 2.0, 'wall_least': 1.0, 'wall_most': 3.0, 'cpu': 2.0}
    """
    wall_times = [wall for wall, _ in times]
    cpu_time = float(np.median([cpu for _, cpu in times]))
    return {
        "runs": len(times),
        "wall": float(np.median(wall_times)),
        "wall_least": min(wall_times),
        "wall_most": max(wall_times),
        "cpu": cpu_time if isfinite(cpu_time) else None,
    }


def _cells(row: Mapping[str, Any]) -> list[str]:
    keys = ("wall", "wall_least", "wall_most", "cpu")
    return [str(row["runs"]), *(number(row[key], ".3f") for key in keys)]


def findings(runs: Sequence[Run], this_machine: str) -> Findings:
    """Return the findings of one run or more; `this_machine` names this machine and its
    GPU.
    """
    # Times of different machines are not comparable: each machine has its own tables.
    machines = list(dict.fromkeys(run.machine for run in runs))
    sections: list[Section] = []
    rows: list[dict[str, Any]] = []
    for machine in machines:
        machine_runs = []
        for run in runs:
            if run.machine == machine:
                machine_runs.append(run)
        parts, stages = _by_part(machine_runs), _by_stage(machine_runs)
        if len(machines) == 1:
            suffix = ""
        else:
            suffix = f": {machine}"
        part_table = _part_table(machine_runs, parts)
        stage_table = _stage_table(stages)
        sections += [
            Section(f"By the paper's parts{suffix}", (), (part_table,)),
            Section(f"Every stage{suffix}", (), (stage_table,)),
        ]
        rows += [{"machine": machine, **row} for row in (*parts, *stages)]
    paper: dict[str, float] = {}
    for part in PARTS:
        if part.paper is not None:
            paper[part.name] = part.paper
    return Findings(
        measure="runtime",
        title="Runtime, stage by stage",
        sentences=(
            _summary(runs),
            f"Run on {'; and on '.join(machines)}.",
            _models(runs),
        ),
        sections=tuple(sections),
        rows=rows,
        extra={
            "machines": machines,
            "here": this_machine,
            "runs": list(map(_run_record, runs)),
            "paper": {**paper, "all": PAPER},
        },
    )


def _run_record(run: Run) -> dict[str, Any]:
    return {
        "name": run.name,
        "machine": run.machine,
        "models": list(run.models),
        "stages": {key: spread([time]) for key, time in run.stages.items()},
    }


def _part_table(runs: Sequence[Run], parts: Sequence[Mapping[str, Any]]) -> Table:
    lines = []
    for row in parts:
        lines.append((row["name"], *_cells(row), number(row["paper"], "g")))
    paper = f"{_paper_time(runs):g} of {PAPER}"
    lines.append(("whole runs", *_cells(_select_whole_runs(runs)), paper))
    heads = ("part", *HEADS, "the paper, A40")
    return Table(heads, tuple(lines), note=NOTE)


def _stage_table(stages: Sequence[Mapping[str, Any]]) -> Table:
    lines = tuple((row["name"], *_cells(row)) for row in stages)
    return Table(("stage", *HEADS), lines, note=CACHE_NOTE)


def _by_part(runs: Sequence[Run]) -> list[dict[str, Any]]:
    """Return the times of each part of the paper's table, and of all other stages."""
    rows = []
    for part in (*PARTS, Part(OTHER_PART, None, ())):
        totals = []
        for run in runs:
            stages = part.stages or set(run.stages) - set(ORDER)
            times = []
            for stage, time in run.stages.items():
                if stage in stages:
                    times.append(time)
            if times:
                totals.append(total(times))
        if totals:
            row = {"kind": "part", "name": part.name, **spread(totals)}
            rows.append({**row, "paper": part.paper})
    return rows


def _by_stage(runs: Sequence[Run]) -> list[dict[str, Any]]:
    """Return the times of each stage, in the order of the paper's table."""
    names: dict[str, None] = {}
    for run in runs:
        names.update(dict.fromkeys(run.stages))
    rows = []
    for name in sorted(names, key=_place_of_stage):
        times = []
        for run in runs:
            if name in run.stages:
                times.append(run.stages[name])
        row = {"kind": "stage", "name": name, **spread(times)}
        rows.append({**row, "paper": None})
    return rows


def _place_of_stage(stage: str) -> int:
    if stage in ORDER:
        return ORDER.index(stage)
    return len(ORDER)


def _select_whole_runs(runs: Sequence[Run]) -> dict[str, Any]:
    """Return the times of runs with recorded perception, if any. Other runs began with
    a scene.
    """
    whole_runs = [run for run in runs if run.has_perception] or runs
    return spread([total(list(run.stages.values())) for run in whole_runs])


def _paper_time(runs: Sequence[Run]) -> float:
    """Return the time of the paper's table for the parts of these runs, s."""
    stages: set[str] = set()
    for run in runs:
        stages.update(run.stages)
    time = 0.0
    for part in PARTS:
        if part.paper is not None and stages & set(part.stages):
            time += part.paper
    return time


def _summary(runs: Sequence[Run]) -> str:
    """Return the sentence on whole runs."""
    whole = _select_whole_runs(runs)
    steps = ["simulating, rendering and encoding"]
    paper = f"{_paper_time(runs):g} s for these parts, on an A40"
    if any(run.has_perception for run in runs):
        steps.insert(0, "perceiving")
        paper = "3 minutes, on an A40 with GPT-4V"
    if any("refine" in run.stages for run in runs):
        steps.append("refining")
    count = "One run"
    if whole["runs"] > 1:
        count = f"{whole['runs']} runs"
    return (
        f"{count}, {' and '.join(steps)}: {whole['wall']:.3f} s of wall time ({whole['wall_least']:.3f} to "
        f"{whole['wall_most']:.3f}) in the median. The paper: {paper}."
    )


def _models(runs: Sequence[Run]) -> str:
    """Return the sentence on models."""
    models = sorted({model for run in runs for model in run.models})
    if models:
        return f"Models: {', '.join(models)}."
    return "No downloaded models took part: the offline steps do what the paper does with them."
