"""Times of the stages, from the records of clips (manifest.json, perceived.json), beside the paper's table.

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
from physgen.problems import InputError, Place, Problem, Severity, Warn, ignore_warning
from physgen.report.record import TIMING
from physgen.scene.files import RECORD, read_record

MOST_PROBLEMS = 20
"""Manifests without times that are named."""
PAPER = 180
"""s: "around 3 minute for a single generation", on an A40."""


@dataclass(frozen=True)
class Part:
    """One column of the paper's table."""

    name: str
    paper: float | None
    """s on an A40 (appendix, runtime analysis); None: not in the paper."""
    stages: tuple[str, ...]
    """Our stages that do the same."""


ELSE = (
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
    Part("perception: all else", None, tuple(f"perceive {role}" for role in ELSE)),
    Part("simulation", 5, ("compile", "simulate", "expose")),
    Part("render", 60, ("cut out", "render", "cover")),
    Part("refinement", 35, ("load model", "refine")),
    Part("reading, encoding, report", None, ("load", "encode", "report")),
)
ORDER = [stage for part in PARTS for stage in part.stages]

Time = tuple[float, float]
"""s of wall time, and of CPU time of all threads, NaN where that is not recorded."""


def total(times: Sequence[Time]) -> Time:
    return sum(wall for wall, _ in times), sum(cpu for _, cpu in times)


@dataclass(frozen=True)
class Run:
    """One clip, or one photo that was perceived and rendered."""

    name: str
    stages: Mapping[str, Time]
    """By the record's names; steps of perceiving by their role, after `perceive `."""
    machine: str
    """With the device that rendered or ran models, where that is not the CPU."""
    models: tuple[str, ...] = ()
    """Backends with downloaded models, as `role=name`."""

    @property
    def perceived(self) -> bool:
        return any(stage.startswith("perceive ") for stage in self.stages)


# ---- records -----------------------------------------------------------------------------------------------------


def read_runs(roots: Sequence[Path], warn: Warn = ignore_warning) -> list[Run]:
    """Every clip below `roots` that records its times; `warn` is called for others. Raises InputError without any."""
    found: list[Run] = []
    left: list[Problem] = []
    for clip in find_clips(checked_folders(roots)):
        run = (
            None
            if clip.manifest is None
            else _run(clip.name, clip.folder, clip.manifest)
        )
        if run is not None:
            found.append(run)
            continue
        expected = (
            "cannot be read" if clip.manifest is None else "has no times of its stages"
        )
        place = Place(str(clip.folder / MANIFEST))
        left.append(
            Problem(
                place,
                "",
                "",
                expected,
                "make the clip again: physgen render",
                Severity.WARNING,
            )
        )
    if not found:
        if left:
            raise InputError(
                replace(problem, severity=Severity.ERROR)
                for problem in left[:MOST_PROBLEMS]
            )
        fix = "name folders that physgen render or sweep made"
        raise InputError.of(", ".join(map(str, roots)), "", "holds no clips", fix)
    for problem in left[:MOST_PROBLEMS]:
        warn(problem)
    return found


def _run(name: str, folder: Path, record: Mapping[str, Any]) -> Run | None:
    """None where the clip has no times."""
    try:
        apart = folder / TIMING
        times = (json.loads(apart.read_bytes()) if apart.is_file() else record)[
            "stages"
        ]
        stages = {
            key: (float(one["wall"]), float(one["cpu"])) for key, one in times.items()
        }
    except (OSError, KeyError, TypeError, ValueError, AttributeError):
        return None
    if not stages or not all(
        isfinite(wall) and wall >= 0 for wall, _ in stages.values()
    ):
        return None
    seen, models = _perceived(folder, record)
    refine, known = record.get("refine") or {}, record.get("platform") or {}
    if refine.get("backend") not in (None, "none"):
        models = (*models, f"refine={refine['backend']}")
    keys = ("machine", "system", "processor", "cores", "memory_gib")
    machine = (
        str(Machine(**{key: known[key] for key in keys}))
        if "processor" in known
        else "not recorded"
    )
    device = str(refine.get("device") or record.get("device") or "cpu")
    return Run(
        name,
        stages | seen,
        machine if device == "cpu" else f"{machine}; {device}",
        models,
    )


def _perceived(
    folder: Path, record: Mapping[str, Any]
) -> tuple[dict[str, Time], tuple[str, ...]]:
    """Steps of perceiving, where models took part and the scene is still in its place."""
    assets, source = (
        (record.get("document") or {}).get("assets"),
        str(record.get("source") or "://"),
    )
    if not assets or "://" in source:
        return {}, ()
    times: dict[str, Time] = {}
    try:
        steps = read_record((folder / source).parent / str(assets) / RECORD)["steps"]
        for step in steps:
            stage = f"perceive {step['role']}"
            times[stage] = total(
                [times.get(stage, (0.0, np.nan)), (float(step["seconds"]), np.nan)]
            )
        models = dict.fromkeys(
            f"{step['role']}={step['backend']}" for step in steps if step.get("weights")
        )
    except (OSError, ValueError, KeyError, TypeError):
        return {}, ()
    return times, tuple(models)


@cache
def gpu() -> str:
    """The GPU's model and memory, from nvidia-smi; `""` where there is none."""
    command = ["nvidia-smi", "--query-gpu=name,memory.total", "--format=csv,noheader"]
    with suppress(OSError, subprocess.SubprocessError):
        done = subprocess.run(
            command, capture_output=True, text=True, timeout=10, check=True
        )
        return "; ".join(
            line.strip() for line in done.stdout.splitlines() if line.strip()
        )
    return ""


# ---- report ------------------------------------------------------------------------------------------------------

HEADS = ("runs", "wall", "from", "to", "CPU")
NOTE = (
    "Seconds; medians over runs, and the least and the most. CPU: of all threads. Whole runs: from photo to video, or "
    "from scene to video where perceiving is not recorded. The paper's parts sum to 180 s."
)
CACHED = "What an earlier run left in the cache counts as long as reading it took: --no-cache runs it."


def spread(times: Sequence[Time]) -> dict[str, Any]:
    """Of one time or more, s; the CPU's is None where one is not recorded.

    >>> spread([(1.0, 2.0), (3.0, 2.0), (2.0, 9.0)])
    {'runs': 3, 'wall': 2.0, 'wall_least': 1.0, 'wall_most': 3.0, 'cpu': 2.0}
    """
    walls, cpu = (
        [wall for wall, _ in times],
        float(np.median([cpu for _, cpu in times])),
    )
    found = {
        "wall": float(np.median(walls)),
        "wall_least": min(walls),
        "wall_most": max(walls),
    }
    return {"runs": len(times), **found, "cpu": cpu if isfinite(cpu) else None}


def _cells(row: Mapping[str, Any]) -> list[str]:
    return [
        str(row["runs"]),
        *(
            number(row[key], ".3f")
            for key in ("wall", "wall_least", "wall_most", "cpu")
        ),
    ]


def findings(runs: Sequence[Run], here: str) -> Findings:
    """Of one run or more; `here` names this machine and its GPU."""
    machines = list(dict.fromkeys(run.machine for run in runs))
    sections, rows = [], []
    for machine in machines:
        mine = [run for run in runs if run.machine == machine]
        after = "" if len(machines) == 1 else f": {machine}"
        parts, stages = _by_part(mine), _by_stage(mine)
        whole, paper = _whole(mine), f"{_paper_time(mine):g} of {PAPER}"
        lines = [
            (one["name"], *_cells(one), number(one["paper"], "g")) for one in parts
        ]
        lines.append(("whole runs", *_cells(whole), paper))
        by_part = Table(("part", *HEADS, "the paper, A40"), tuple(lines), note=NOTE)
        by_stage = Table(
            ("stage", *HEADS),
            tuple((one["name"], *_cells(one)) for one in stages),
            note=CACHED,
        )
        sections += [
            Section(f"By the paper's parts{after}", (), (by_part,)),
            Section(f"Every stage{after}", (), (by_stage,)),
        ]
        rows += [{"machine": machine, **row} for row in (*parts, *stages)]
    more = {
        "machines": machines,
        "here": here,
        "runs": [
            {
                "name": run.name,
                "machine": run.machine,
                "models": list(run.models),
                "stages": {key: spread([one]) for key, one in run.stages.items()},
            }
            for run in runs
        ],
        "paper": {part.name: part.paper for part in PARTS if part.paper is not None}
        | {"all": PAPER},
    }
    sentences = (_summary(runs), f"Run on {'; and on '.join(machines)}.", _models(runs))
    return Findings(
        "runtime",
        "Runtime, stage by stage",
        sentences,
        tuple(sections),
        rows,
        more=more,
    )


def _by_part(runs: Sequence[Run]) -> list[dict[str, Any]]:
    rows = []
    for part in (*PARTS, Part("asked for besides", None, ())):
        own = [
            [
                t
                for s, t in run.stages.items()
                if s in (part.stages or set(run.stages) - set(ORDER))
            ]
            for run in runs
        ]
        if times := [total(some) for some in own if some]:
            rows.append(
                {
                    "kind": "part",
                    "name": part.name,
                    **spread(times),
                    "paper": part.paper,
                }
            )
    return rows


def _by_stage(runs: Sequence[Run]) -> list[dict[str, Any]]:
    seen = dict.fromkeys(stage for run in runs for stage in run.stages)
    names = sorted(
        seen, key=lambda stage: ORDER.index(stage) if stage in ORDER else len(ORDER)
    )
    found = {
        name: spread([run.stages[name] for run in runs if name in run.stages])
        for name in names
    }
    return [
        {"kind": "stage", "name": name, **one, "paper": None}
        for name, one in found.items()
    ]


def _whole(runs: Sequence[Run]) -> dict[str, Any]:
    """Of runs with recorded perceiving, where there are any: the others began with a scene."""
    full = [run for run in runs if run.perceived] or runs
    return spread([total(list(run.stages.values())) for run in full])


def _paper_time(runs: Sequence[Run]) -> float:
    """s that the paper's table has for the parts of these runs."""
    there = {stage for run in runs for stage in run.stages}
    return sum(
        part.paper
        for part in PARTS
        if part.paper is not None and there & set(part.stages)
    )


def _summary(runs: Sequence[Run]) -> str:
    whole, perceived = _whole(runs), any(run.perceived for run in runs)
    did = ["perceiving"] if perceived else []
    did += ["simulating, rendering and encoding"]
    did += ["refining"] if any("refine" in run.stages for run in runs) else []
    count = f"{whole['runs']} runs" if whole["runs"] > 1 else "One run"
    paper = (
        "3 minutes, on an A40 with GPT-4V"
        if perceived
        else f"{_paper_time(runs):g} s for these parts, on an A40"
    )
    return (
        f"{count}, {' and '.join(did)}: {whole['wall']:.3f} s of wall time ({whole['wall_least']:.3f} to "
        f"{whole['wall_most']:.3f}) in the median. The paper: {paper}."
    )


def _models(runs: Sequence[Run]) -> str:
    models = sorted({model for run in runs for model in run.models})
    nothing = "No downloaded models took part: the offline steps do what the paper does with them."
    return f"Models: {', '.join(models)}." if models else nothing
