"""Times of the stages, from the records of clips or from runs made now, beside the paper's table."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import isfinite
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

from physgen import pipeline
from physgen.batch.clips import MANIFEST, checked_folders, find_clips
from physgen.environment import Machine, this_machine
from physgen.evaluate.measure import Figure, Findings, Progress, Section, Table, plotted
from physgen.problems import InputError, Place, Problem, Severity, Warn, ignore_warning
from physgen.registry import Backends
from physgen.report.record import versions

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from physgen.report.plots.style import Palette

PERCEIVED = "perceived.json"
MOST_PROBLEMS = 20
"""Manifests without times that are named."""
MOST_SIZES = 3
"""Sizes of videos that are listed."""
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


ELSE = ("depth", "normals", "intrinsic", "light", "matte", "shadow", "boundary", "files")
PARTS = (
    Part("perception: objects", 50, ("perceive categories", "perceive segment")),
    Part("perception: names, physics", 10, ("perceive label", "perceive physics")),
    Part("perception: background", 20, ("perceive inpaint",)),
    Part("perception: all else", None, tuple(f"perceive {role}" for role in ELSE)),
    Part("simulation", 5, ("compile", "simulate", "expose")),
    Part("render", 60, ("cut out", "render", "cover")),
    Part("refinement", 35, ("load model", "refine")),
    Part("reading, encoding, report", None, ("load", "encode", "report", "keep")),
)
REST = Part("asked for besides", None, ())
"""All other stages: labels, neighbours, draws."""


@dataclass(frozen=True)
class Time:
    """Of a stage, s."""

    wall: float
    cpu: float | None
    """Of all threads; None: not recorded."""


def total(times: Sequence[Time]) -> Time:
    cpus = [one.cpu for one in times if one.cpu is not None]
    return Time(sum(one.wall for one in times), sum(cpus) if len(cpus) == len(times) else None)


@dataclass(frozen=True)
class Run:
    """One clip, or one photo that was perceived."""

    name: str
    stages: Mapping[str, Time]
    """By the record's names; steps of perceiving by their role, after `perceive `."""
    machine: str
    device: str = "cpu"
    """What rendered, or ran models."""
    versions: Mapping[str, str] = field(default_factory=dict)
    frames: int = 0
    size: tuple[int, int] = (0, 0)
    """Width and height of the video, px."""
    models: tuple[str, ...] = ()
    """Backends with downloaded models, as `role=name`."""

    @property
    def place(self) -> str:
        """Machine and device."""
        return self.machine if self.device == "cpu" else f"{self.machine}; {self.device}"

    @property
    def perceived(self) -> bool:
        return any(stage.startswith("perceive ") for stage in self.stages)


# ---- records -----------------------------------------------------------------------------------------------------


def read_runs(roots: Sequence[Path], warn: Warn = ignore_warning) -> list[Run]:
    """Every clip below `roots` that records its times; `warn` is called for others. Raises InputError without any."""
    found: list[Run] = []
    left: list[Problem] = []
    for clip in find_clips(checked_folders(roots)):
        run = None if clip.manifest is None else _run(clip.name, clip.folder, clip.manifest)
        if run is not None:
            found.append(run)
            continue
        expected = "cannot be read" if clip.manifest is None else "has no times of its stages"
        place = Place(str(clip.folder / MANIFEST))
        left.append(Problem(place, "", "", expected, "make the clip again: physgen render", Severity.WARNING))
    if not found:
        if left:
            raise InputError(replace(problem, severity=Severity.ERROR) for problem in left[:MOST_PROBLEMS])
        fix = "name folders that physgen render or sweep made, or add --measure"
        raise InputError.of(", ".join(map(str, roots)), "", "holds no clips", fix)
    for problem in left[:MOST_PROBLEMS]:
        warn(problem)
    return found


def _run(name: str, folder: Path, record: Mapping[str, Any]) -> Run | None:
    try:
        stages = {key: Time(float(one["wall"]), float(one["cpu"])) for key, one in record["stages"].items()}
    except (KeyError, TypeError, ValueError, AttributeError):
        return None
    if not stages or not all(isfinite(one.wall) and one.wall >= 0 for one in stages.values()):
        return None
    seen, models = _perceived(folder, record)
    refine, video = record.get("refine") or {}, record.get("video") or {}
    if refine.get("backend") not in (None, "none"):
        models = (*models, f"refine={refine['backend']}")
    width, height = video.get("size") or (0, 0)
    return Run(
        name=name,
        stages=stages | seen,
        machine=_machine(record.get("platform") or {}),
        device=str(refine.get("device") or record.get("device") or "cpu"),
        versions={str(key): str(value) for key, value in (record.get("versions") or {}).items()},
        frames=len(record.get("frames") or ()),
        size=(int(width), int(height)),
        models=models,
    )


def _machine(platform: Mapping[str, Any]) -> str:
    """As the manifest names it; older manifests have no processor."""
    if "processor" not in platform:
        kind = " ".join(str(platform[key]) for key in ("machine", "system") if platform.get(key))
        return f"{kind or 'unknown'}, model not recorded"
    known = {key: platform.get(key) for key in ("machine", "system", "processor", "cores", "memory_gib")}
    return str(Machine(**known))  # type: ignore[arg-type]


def _perceived(folder: Path, record: Mapping[str, Any]) -> tuple[dict[str, Time], tuple[str, ...]]:
    """Steps of perceiving, where models took part and the scene is still in its place."""
    assets = (record.get("document") or {}).get("assets")
    source = record.get("source")
    if not assets or not source or "://" in str(source):
        return {}, ()
    file = (folder / str(source)).parent / str(assets) / PERCEIVED
    try:
        steps = json.loads(file.read_text(encoding="utf-8"))["steps"]
        times: dict[str, Time] = {}
        for step in steps:
            name = f"perceive {step['role']}"
            times[name] = Time(times.get(name, Time(0, None)).wall + float(step["seconds"]), None)
        models = dict.fromkeys(f"{step['role']}={step['backend']}" for step in steps if step.get("weights"))
    except (OSError, ValueError, KeyError, TypeError):
        return {}, ()
    return times, tuple(models)


class TimedBackends(Backends):
    """Backends that also record the CPU time of each role."""

    def __init__(self) -> None:
        super().__init__()
        self.cpu: list[float] = []

    def run(self, role: str, use: Callable[[Any], Any]) -> Any:
        """As `Backends.run`."""
        begun = time.process_time()
        try:
            return super().run(role, use)
        finally:
            self.cpu.append(time.process_time() - begun)


def measure(photo: Path, repeat: int, progress: Progress) -> list[Run]:
    """`repeat` runs made now, offline; the first includes imports. Raises InputError for a bad photo."""
    if not photo.is_file():
        fix = "name a photo: --measure photo.jpg"
        raise InputError.of("--measure", f'"{photo}"', "is no photo", fix)
    runs = []
    for k in range(repeat):
        with TemporaryDirectory(prefix="physgen-runtime-") as folder:
            progress("perceive", k, repeat)
            stages = _timed_perceiving(photo, Path(folder) / "scene.yaml")
            progress("render", k, repeat)
            clip = pipeline.render_scene(Path(folder) / "scene.yaml", Path(folder) / "out", cached=False)
            record = json.loads((clip / MANIFEST).read_text(encoding="utf-8"))
        stages |= {key: Time(one["wall"], one["cpu"]) for key, one in record["stages"].items()}
        width, height = record["video"]["size"]
        machine, frames = str(this_machine()), len(record["frames"])
        name = f"{photo.stem} {k + 1}"
        runs.append(Run(name, stages, machine, record["device"], versions(), frames, (width, height)))
    return runs


def _timed_perceiving(photo: Path, scene: Path) -> dict[str, Time]:
    backends = TimedBackends()
    wall, cpu = time.perf_counter(), time.process_time()
    pipeline.perceive(photo, scene, crew=backends)
    wall, cpu = time.perf_counter() - wall, time.process_time() - cpu
    stages: dict[str, Time] = {}
    for step, spent in zip(backends.steps, backends.cpu, strict=True):
        before = stages.get(f"perceive {step.role}", Time(0, 0))
        stages[f"perceive {step.role}"] = total([before, Time(step.seconds, spent)])
    known = total(list(stages.values()))
    stages["perceive files"] = Time(max(wall - known.wall, 0.0), max(cpu - (known.cpu or 0), 0.0))
    return stages


# ---- report ------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Spread:
    """Of a time over runs, s."""

    count: int
    middle: float
    least: float
    most: float
    cpu: float | None
    """Median."""

    def cells(self) -> tuple[str, str, str, str, str]:
        cpu = "-" if self.cpu is None else _seconds(self.cpu)
        return str(self.count), _seconds(self.middle), _seconds(self.least), _seconds(self.most), cpu

    def row(self, machine: str, kind: str, name: str, paper: float | None) -> dict[str, Any]:
        return {
            "machine": machine, "kind": kind, "name": name, "runs": self.count, "wall": self.middle,
            "wall_least": self.least, "wall_most": self.most, "cpu": self.cpu, "paper": paper,
        }  # fmt: skip


def spread(times: Sequence[Time]) -> Spread:
    """Of one time or more.

    >>> spread([Time(1, 2), Time(3, 2), Time(2, 9)])
    Spread(count=3, middle=2, least=1, most=3, cpu=2)
    """
    walls, cpus = [one.wall for one in times], [one.cpu for one in times if one.cpu is not None]
    cpu = median(cpus) if len(cpus) == len(times) else None
    return Spread(len(times), median(walls), min(walls), max(walls), cpu)


def parts_of(run: Run) -> Iterator[tuple[Part, Time]]:
    """Time of each part that one run has."""
    left = dict(run.stages)
    for part in PARTS:
        mine = [left.pop(stage) for stage in part.stages if stage in left]
        if mine:
            yield part, total(mine)
    if left:
        yield REST, total(list(left.values()))


def findings(runs: Sequence[Run], here: str) -> Findings:
    """Of one run or more; `here` names this machine and its GPU."""
    machines = list(dict.fromkeys(run.place for run in runs))
    sections, rows = [], []
    for machine in machines:
        mine = [run for run in runs if run.place == machine]
        after = "" if len(machines) == 1 else f": {machine}"
        parts, stages = _by_part(mine), _by_stage(mine)
        sections.append(Section(f"By the paper's parts{after}", (), (_part_table(parts, mine),)))
        note = "What an earlier run left in the cache counts as long as reading it took: --no-cache runs it."
        lines = tuple((name, *found.cells()) for name, found in stages.items())
        table = Table(("stage", "runs", "wall", "from", "to", "CPU"), lines, note=note)
        sections.append(Section(f"Every stage{after}", (), (table,)))
        rows += [found.row(machine, "part", part.name, part.paper) for part, found in parts.items()]
        rows += [found.row(machine, "stage", stage, None) for stage, found in stages.items()]
    more = {
        "machines": machines,
        "here": here,
        "runs": [_record(run) for run in runs],
        "paper": {part.name: part.paper for part in PARTS if part.paper is not None} | {"all": PAPER},
    }
    sentences = tuple(_sentences(runs, machines, here))
    return Findings("runtime", "Runtime, stage by stage", sentences, tuple(sections), rows, (), more)


def _by_part(runs: Sequence[Run]) -> dict[Part, Spread]:
    times: dict[Part, list[Time]] = {part: [] for part in (*PARTS, REST)}
    for run in runs:
        for part, spent in parts_of(run):
            times[part].append(spent)
    return {part: spread(each) for part, each in times.items() if each}


def _by_stage(runs: Sequence[Run]) -> dict[str, Spread]:
    order = [stage for part in PARTS for stage in part.stages]
    seen = dict.fromkeys(stage for run in runs for stage in run.stages)
    names = sorted(seen, key=lambda stage: order.index(stage) if stage in order else len(order))
    return {name: spread([run.stages[name] for run in runs if name in run.stages]) for name in names}


def _part_table(found: Mapping[Part, Spread], runs: Sequence[Run]) -> Table:
    rows = [
        (part.name, *one.cells(), "-" if part.paper is None else f"{part.paper:g}")
        for part, one in found.items()
    ]
    paper = f"{PAPER} or so" if any(run.perceived for run in runs) else f"{_paper_time(runs):g} of {PAPER}"
    rows.append(("whole runs", *_whole(runs).cells(), paper))
    note = (
        "Seconds; medians over runs, and the least and the most. CPU: of all threads. Whole runs: from photo to video, "
        "or from scene to video where perceiving is not recorded. The paper's parts sum to 180 s; its text says 1 "
        "minute for perception, its table 80 s."
    )
    return Table(("part", "runs", "wall", "from", "to", "CPU", "the paper, A40"), tuple(rows), note=note)


def _complete(runs: Sequence[Run]) -> Sequence[Run]:
    """Runs with recorded perceiving, where there are any: the others began with a scene."""
    return [run for run in runs if run.perceived] or runs


def _whole(runs: Sequence[Run]) -> Spread:
    return spread([total(list(run.stages.values())) for run in _complete(runs)])


def _paper_time(runs: Sequence[Run]) -> float:
    """s that the paper's table has for the parts of these runs."""
    there = {part for run in runs for part, _ in parts_of(run)}
    return sum(part.paper for part in PARTS if part.paper is not None and part in there)


def _seconds(value: float) -> str:
    return f"{value:.3f}" if value < 10 else f"{value:.1f}"


def _sentences(runs: Sequence[Run], machines: Sequence[str], here: str) -> Iterator[str]:
    full, whole = _complete(runs), _whole(runs)
    seen = any(run.perceived for run in runs)
    did = ["perceiving"] if seen else []
    did.append("simulating, rendering and encoding")
    did += ["refining"] if any("refine" in run.stages for run in full) else []
    count = f"{len(full)} runs" if len(full) > 1 else "One run"
    same = _paper_time(full)
    parts = f"{same:g} s for these parts, on an A40" if same else "has no time of these parts"
    paper = "3 minutes, on an A40 with GPT-4V" if seen else parts
    yield (
        f"{count}, {' and '.join(did)}: {_seconds(whole.middle)} s of wall time ({_seconds(whole.least)} to "
        f"{_seconds(whole.most)}) in the median. The paper: {paper}."
    )
    yield f"Run on {'; and on '.join(machines)}."
    if any("not recorded" in machine for machine in machines):
        yield f"This machine, where the records are read, is {here}."
    if models := sorted({model for run in runs for model in run.models}):
        yield f"Models: {', '.join(models)}."
    else:
        yield "No downloaded models took part: the offline steps do what the paper does with them."
    if not seen:
        yield (
            "How long perceiving took is recorded where models did it (perceived.json among a scene's assets): not in "
            "these. --measure times it."
        )
    frames, sizes = sorted({run.frames for run in runs}), sorted({run.size for run in runs})
    some = f"{frames[0]}" if len(frames) == 1 else f"{frames[0]} to {frames[-1]}"
    several = [f"{wide} x {high}" for wide, high in sizes]
    size = " and ".join(several) if len(several) <= MOST_SIZES else f"{several[0]} to {several[-1]}"
    yield f"Clips of {some} frames, {size} px; the paper's have 16 frames of 512 x 512."
    kinds = {
        ", ".join(f"{key} {value}" for key, value in run.versions.items()) for run in runs if run.versions
    }
    if kinds:
        yield f"Versions: {'; '.join(sorted(kinds))}."


def _record(run: Run) -> dict[str, Any]:
    return {
        "name": run.name, "machine": run.machine, "device": run.device, "frames": run.frames, "size": list(run.size),
        "models": list(run.models), "versions": dict(run.versions),
        "stages": {stage: {"wall": one.wall, "cpu": one.cpu} for stage, one in run.stages.items()},
    }  # fmt: skip


def plot(runs: Sequence[Run]) -> Figure:
    """Medians of the parts as bars, ours and the paper's, on a logarithmic axis."""
    found = {part: one for part, one in _by_part(runs).items() if one.middle > 0}

    def draw(axes: Axes, palette: Palette) -> None:
        least = min(one.least or one.middle for one in found.values())
        for k, (part, one) in enumerate(found.items()):
            first = k == 0
            axes.barh(
                k - 0.19,
                one.middle,
                0.36,
                color=palette.blue,
                label="median of these runs" if first else None,
            )
            axes.plot([max(one.least, 1e-4), one.most], [k - 0.19] * 2, color=palette.ink, linewidth=0.8)
            if part.paper is not None:
                axes.barh(k + 0.19, part.paper, 0.36, color=palette.faint)
        axes.barh(0, 0, color=palette.faint, label="the paper, A40")
        axes.set_yticks(range(len(found)), [part.name for part in found])
        axes.set(xscale="log", xlim=(max(least / 2, 1e-4), 200), xlabel="wall time (s)")
        axes.xaxis.set_major_formatter(lambda value, _: f"{value:g}")
        axes.invert_yaxis()
        axes.legend(loc="lower right", bbox_to_anchor=(1, 1), ncols=2)
        axes.set_position((0.3, 0.14, 0.66, 0.74))  # names need room

    about = "Wall time of each part: medians of these runs and their ranges, and the paper's; the axis is logarithmic."
    return plotted(draw, about, 140, 75)
