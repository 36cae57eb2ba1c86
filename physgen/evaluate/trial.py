"""One draw of a row -> its scene files, run by the public path -> its errors."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from math import inf, isfinite
from pathlib import Path

from physgen import pipeline
from physgen.compile.world import World
from physgen.evaluate.row import Case, Measure, Row, Run, Unit
from physgen.problems import InputError
from physgen.scene.write import scene_text
from physgen.simulate.trajectory import Trajectory
from physgen.whole import write_kept

Simulate = Callable[[World, float], Trajectory]
"""A world and a rate of samples (1/s) -> motion from t = 0 to the world's end; ours, or a rival's."""


def scene_file(row: Row, case: Case, index: int) -> str:
    """Name of a case's file: `03-bounce.yaml`, `16-pyramid-lifted-draw-5.yaml`; the first draw needs no number."""
    parts = (f"{row.number:02d}", row.name, case.label, f"draw-{index + 1}" if index else "")
    return "-".join(part for part in parts if part) + ".yaml"


def scene_of(row: Row, case: Case) -> str:
    """The case's scene file, with the closed form and the bar above it."""
    bars = ", ".join(f"{measure.name} {bar_text(measure)}" for measure in row.measures)
    title = f"{row.title} ({case.label})" if case.label else row.title
    header = f"Row {row.number} of the physics scorecard: {title}\n{row.closed_form}\nbar: {bars}"
    return scene_text(case.scene, header=header)


def write_scenes(row: Row, index: int, folder: Path, kept: pipeline.Keep = lambda path: None) -> None:
    """The scene files of one draw; `kept` is told of files that stood in the way."""
    for case in row.draw(index):
        write_kept(folder / scene_file(row, case, index), scene_of(row, case).encode(), kept)


def bar_text(measure: Measure) -> str:
    """A bar with its unit."""
    match measure.unit:
        case Unit.PART:
            return f"{measure.bar * 100:g} %"
        case Unit.SWITCH:
            return "as stated"
        case _:
            return f"{measure.bar:g} {measure.unit.value}"


@dataclass(frozen=True)
class Worst:
    """The largest error of one measure over some cases."""

    error: float
    """Infinite where a scene could not be run."""
    where: str
    """`draw 3`, `draw 5, lifted`."""

    @property
    def size(self) -> float:
        """For comparison: what is no number is worse than any."""
        return self.error if isfinite(self.error) else inf


@dataclass(frozen=True)
class Done:
    """What one draw gave."""

    errors: Mapping[str, Worst]
    """By the measure's name; a measure that none of the draw's cases takes is left out."""
    problems: tuple[str, ...]
    """Why a case could not be run."""


def run_draw(
    row: Row, index: int, folder: Path, steps: float | None = None, simulate: Simulate = pipeline.simulate
) -> Done:
    """One draw of a row, from its files in `folder`; `steps` a second overrides the scene's."""
    overrides = [] if steps is None else [f"world.steps_per_second={steps}"]
    found: dict[str, Worst] = {}
    problems: list[str] = []
    for case in row.draw(index):
        file = folder / scene_file(row, case, index)
        where = ", ".join(part for part in (f"draw {index + 1}", case.label) if part)
        try:
            runs = []
            for variant in case.variants:
                scene = pipeline.load(file, overrides, variant)
                world = pipeline.compile(scene, None).world
                runs.append(Run(world, simulate(world, case.rate)))
            errors = case.measure(*runs)
        except InputError as error:
            problems += [str(problem).replace(f"{folder}/", "") for problem in error.problems]
            errors = {measure.name: inf for measure in row.measures}
        for name, value in errors.items():
            larger = Worst(float(value), where)
            found[name] = max(found.get(name, larger), larger, key=lambda worst: worst.size)
    return Done(found, tuple(problems))
