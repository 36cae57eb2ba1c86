"""Times of stages over many runs -> the paper's table, ours beside it, and every stage by itself."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from statistics import median
from typing import TYPE_CHECKING, Any

from physgen.evaluate.measure import Figure, Findings, Section, Table
from physgen.evaluate.runtime.runs import Run, Time

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from physgen.report.plots.style import Palette


MOST_SIZES = 3
"""Sizes of videos that are told one by one."""


@dataclass(frozen=True)
class Part:
    """One column of the paper's table."""

    name: str
    paper: float | None
    """s on an A40 (appendix, runtime analysis); None: the paper has none of it, or tells no time."""
    stages: tuple[str, ...]
    """Ours that do the same."""


ELSE = ("depth", "normals", "intrinsic", "light", "matte", "shadow", "boundary", "files")
PARTS = (
    Part("perception: objects", 50, ("perceive categories", "perceive segment")),
    Part("perception: names, physics", 10, ("perceive label", "perceive physics")),
    Part("perception: background", 20, ("perceive inpaint",)),
    Part(
        "perception: all else",
        None,
        tuple(f"perceive {role}" for role in ELSE),
    ),
    Part("simulation", 5, ("compile", "simulate", "expose")),
    Part("render", 60, ("cut out", "render", "cover")),
    Part("refinement", 35, ("load model", "refine")),
    Part("reading, encoding, report", None, ("load", "encode", "report", "keep")),
)  # fmt: skip
REST = Part("asked for besides", None, ())
"""Stages that nobody needs for a clip: labels, neighbours, draws."""
PAPER = 180
"""s: "around 3 minute for a single generation", on an A40."""


@dataclass(frozen=True)
class Spread:
    """Of a time over runs, s."""

    count: int
    middle: float
    least: float
    most: float
    cpu: float | None
    """Median."""


def spread(times: Sequence[Time]) -> Spread | None:
    """None of none.

    >>> spread([Time(1, 2), Time(3, 2), Time(2, 9)])
    Spread(count=3, middle=2, least=1, most=3, cpu=2)
    """
    if not times:
        return None
    walls, cpus = [one.wall for one in times], [one.cpu for one in times if one.cpu is not None]
    cpu = median(cpus) if len(cpus) == len(times) else None
    return Spread(len(times), median(walls), min(walls), max(walls), cpu)


def parts_of(run: Run) -> Iterator[tuple[Part, Time]]:
    """What each part took in one run; those of which it has nothing are left out."""
    left = dict(run.stages)
    for part in (*PARTS, REST):
        mine = (
            [left.pop(stage) for stage in part.stages if stage in left]
            if part.stages
            else list(left.values())
        )
        if mine:
            cpus = [one.cpu for one in mine]
            yield (
                part,
                Time(
                    sum(one.wall for one in mine),
                    None if None in cpus else sum(cpu for cpu in cpus if cpu is not None),
                ),
            )


def findings(runs: Sequence[Run], here: str) -> Findings:
    """Of one run or more; `here` names this machine and its GPU."""
    machines = list(dict.fromkeys(_where(run) for run in runs))
    sections, rows = [], []
    for machine in machines:
        mine = [run for run in runs if _where(run) == machine]
        by_part = _by_part(mine)
        title = "By the paper's parts" if len(machines) == 1 else f"By the paper's parts: {machine}"
        sections.append(Section(title, (), (_parts(by_part, mine),)))
        stages = _by_stage(mine)
        sections.append(
            Section(
                "Every stage" if len(machines) == 1 else f"Every stage: {machine}", (), (_stages(stages),)
            )
        )
        rows += [_row(machine, "part", part.name, found, part.paper) for part, found in by_part.items()]
        rows += [_row(machine, "stage", stage, found, None) for stage, found in stages.items()]
    more = {
        "machines": machines,
        "here": here,
        "runs": [_told(run) for run in runs],
        "paper": {part.name: part.paper for part in PARTS if part.paper is not None} | {"all": PAPER},
    }
    told = tuple(_sentences(runs, machines, here))
    return Findings("runtime", "Runtime, stage by stage", told, tuple(sections), rows, (), more)


def plot(runs: Sequence[Run]) -> Figure:
    """Medians of the parts as bars, ours and the paper's, on a logarithmic axis."""
    from physgen.evaluate.measure import plotted

    found = {part: one for part, one in _by_part(runs).items() if one.middle > 0}

    def draw(axes: Axes, palette: Palette) -> None:
        names = [part.name for part in found]
        high = range(len(names))
        middles = [one.middle for one in found.values()]
        least = min(one.least or one.middle for one in found.values())
        axes.barh([k - 0.19 for k in high], middles, 0.36, color=palette.blue, label="median of these runs")
        for k, one in zip(high, found.values(), strict=True):
            axes.plot([max(one.least, 1e-4), one.most], [k - 0.19] * 2, color=palette.ink, linewidth=0.8)
        paper = [(k, part.paper) for k, part in zip(high, found, strict=True) if part.paper is not None]
        axes.barh(
            [k + 0.19 for k, _ in paper],
            [s for _, s in paper],
            0.36,
            color=palette.faint,
            label="the paper, A40",
        )
        axes.set_yticks(list(high), names)
        axes.set(xscale="log", xlim=(max(min(least, *middles) / 2, 1e-4), 200), xlabel="wall time (s)")
        axes.xaxis.set_major_formatter(lambda value, _: f"{value:g}")
        axes.invert_yaxis()
        axes.legend(loc="lower right", bbox_to_anchor=(1, 1), ncols=2)
        axes.set_position((0.3, 0.14, 0.66, 0.74))  # names need room

    about = "Wall time of each part: medians of these runs and their ranges, and the paper's; the axis is logarithmic."
    return plotted(draw, about, 140, 75)


def _where(run: Run) -> str:
    return run.machine if run.device == "cpu" else f"{run.machine}; {run.device}"


def _by_part(runs: Sequence[Run]) -> dict[Part, Spread]:
    times: dict[Part, list[Time]] = {part: [] for part in (*PARTS, REST)}
    for run in runs:
        for part, spent in parts_of(run):
            times[part].append(spent)
    return {part: found for part, each in times.items() if (found := spread(each)) is not None}


def _by_stage(runs: Sequence[Run]) -> dict[str, Spread]:
    order = [stage for part in PARTS for stage in part.stages]
    seen = dict.fromkeys(stage for run in runs for stage in run.stages)
    names = sorted(seen, key=lambda stage: order.index(stage) if stage in order else len(order))
    each = {name: [run.stages[name] for run in runs if name in run.stages] for name in names}
    return {name: found for name, times in each.items() if (found := spread(times)) is not None}


def _parts(found: Mapping[Part, Spread], runs: Sequence[Run]) -> Table:
    rows = [
        (part.name, *_cells(one), "-" if part.paper is None else f"{part.paper:g}")
        for part, one in found.items()
    ]
    whole = spread([_sum(run) for run in _complete(runs)])
    assert whole is not None
    rows.append(
        ("whole runs", *_cells(whole), f"{PAPER} or so" if _seen(runs) else f"{_theirs(runs):g} of {PAPER}")
    )
    note = (
        "Seconds; medians over runs, and the least and the most. CPU: of all threads. Whole runs: from photo to video, "
        "or from scene to video where nobody recorded perceiving. The paper's parts sum to 180 s; "
        "its text says 1 minute for perception, its table 80 s."
    )
    return Table(("part", "runs", "wall", "from", "to", "CPU", "the paper, A40"), tuple(rows), note=note)


def _seen(runs: Sequence[Run]) -> bool:
    """Whether any run's perceiving is recorded."""
    return any(stage.startswith("perceive ") for run in runs for stage in run.stages)


def _theirs(runs: Sequence[Run]) -> float:
    """s that the paper's table has for the parts of these runs."""
    there = {part for run in runs for part, _ in parts_of(run)}
    return sum(part.paper for part in PARTS if part.paper is not None and part in there)


def _complete(runs: Sequence[Run]) -> Sequence[Run]:
    """Those whose perceiving is recorded, where there are any: the others began with a scene."""
    return [run for run in runs if any(stage.startswith("perceive ") for stage in run.stages)] or runs


def _sum(run: Run) -> Time:
    cpus = [one.cpu for one in run.stages.values()]
    cpu = None if None in cpus else sum(cpu for cpu in cpus if cpu is not None)
    return Time(sum(one.wall for one in run.stages.values()), cpu)


def _stages(found: Mapping[str, Spread]) -> Table:
    rows = tuple((name, *_cells(one)) for name, one in found.items())
    note = "What an earlier run left in the cache counts as long as reading it took: --no-cache runs it."
    return Table(("stage", "runs", "wall", "from", "to", "CPU"), rows, note=note)


def _cells(one: Spread) -> tuple[str, str, str, str, str]:
    cpu = "-" if one.cpu is None else _seconds(one.cpu)
    return str(one.count), _seconds(one.middle), _seconds(one.least), _seconds(one.most), cpu


def _seconds(time: float) -> str:
    """To a millisecond, or a tenth of a second.

    >>> _seconds(0.01234), _seconds(12.345)
    ('0.012', '12.3')
    """
    return f"{time:.3f}" if time < 10 else f"{time:.1f}"


def _sentences(runs: Sequence[Run], machines: Sequence[str], here: str) -> Iterator[str]:
    full = _complete(runs)
    whole = spread([_sum(run) for run in full])
    assert whole is not None
    seen = _seen(runs)
    refined = any("refine" in run.stages for run in full)
    did = [
        "perceiving" if seen else "", "simulating, rendering and encoding", "refining" if refined else ""
    ]  # fmt: skip
    count = f"{len(full)} runs" if len(full) > 1 else "One run"
    same = _theirs(full)
    parts = f"{same:g} s for these parts, on an A40" if same else "has no time of these parts"
    theirs = "3 minutes, on an A40 with GPT-4V" if seen else parts
    yield (
        f"{count}, {' and '.join(part for part in did if part)}: {_seconds(whole.middle)} s of wall time "
        f"({_seconds(whole.least)} to {_seconds(whole.most)}) in the median. The paper: {theirs}."
    )
    yield f"Run on {'; and on '.join(machines)}."
    if any("not recorded" in machine for machine in machines):
        yield f"This machine, where the records are read, is {here}."
    if models := sorted({model for run in runs for model in run.models}):
        yield f"Models: {', '.join(models)}."
    else:
        yield "No downloaded models had a part: the offline steps do what the paper does with them."
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
    if kinds := sorted(
        {", ".join(f"{k} {v}" for k, v in run.versions.items()) for run in runs if run.versions}
    ):
        yield f"Versions: {'; '.join(kinds)}."


def _row(machine: str, kind: str, name: str, found: Spread, paper: float | None) -> dict[str, Any]:
    return {
        "machine": machine, "kind": kind, "name": name, "runs": found.count, "wall": found.middle,
        "wall_least": found.least, "wall_most": found.most, "cpu": found.cpu, "paper": paper,
    }  # fmt: skip


def _told(run: Run) -> dict[str, Any]:
    return {
        "name": run.name, "machine": run.machine, "device": run.device, "frames": run.frames, "size": list(run.size),
        "models": list(run.models), "versions": dict(run.versions),
        "stages": {stage: {"wall": one.wall, "cpu": one.cpu} for stage, one in run.stages.items()},
    }  # fmt: skip
