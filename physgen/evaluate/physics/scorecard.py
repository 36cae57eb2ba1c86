"""What the rows of closed forms are made of, and how they are run.

A row states one closed form, the scenes that test it, and the largest error that passes. Its scenes are drawn with
seeded parameters and run by the public path. `Track` and `Run` give readable access to the motion of a body.
"""

from __future__ import annotations

import signal
import sys
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from enum import Enum
from math import inf, isfinite, nan
from multiprocessing import get_context
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from physgen import pipeline
from physgen.compile.world import Body, World
from physgen.evaluate.measure import Bar, Findings, Section, Table
from physgen.files import write_atomic
from physgen.problems import InputError
from physgen.scene.write import scene_text
from physgen.simulate.trajectory import Trajectory

Array = NDArray[np.float64]
Document = dict[str, Any]
"""A scene as plain data, as the YAML file holds it."""
Errors = Mapping[str, float]
"""Name of a measure -> error, in the measure's unit."""
Simulate = Callable[[World, float], Trajectory]
"""World and sampling rate (1/s) -> motion from t = 0 to the world's end."""

DRAWS = 5
"""Random draws of each row."""
STEPS = (240, 480, 960, 1920)
"""1/s: engine steps at which the first draw shows convergence."""
DEFAULT_STEPS = 960
"""1/s: engine steps of a scene that sets none."""


class Unit(Enum):
    """Unit of an error."""

    PART = "part"
    """Fraction of the exact value; shown in percent."""
    PX = "px"
    DEGREES = "degrees"
    SWITCH = "switch"
    """0: as required, 1: not."""


@dataclass(frozen=True)
class Measure:
    """One error of a row, and the largest value that passes."""

    name: str
    bar: float
    unit: Unit = Unit.PART


@dataclass(frozen=True)
class Track:
    """Motion of one body at T times."""

    times: Array
    """(T,) s."""
    poses: Array
    """(T, 3): x px, y px, angle rad since t = 0."""
    velocities: Array
    """(T, 3): px/s, px/s, rad/s."""

    @property
    def x(self) -> Array:
        return self.poses[:, 0]

    @property
    def y(self) -> Array:
        return self.poses[:, 1]

    @property
    def angle(self) -> Array:
        return self.poses[:, 2]

    @property
    def at(self) -> Array:
        return self.poses[:, :2]

    @property
    def moved(self) -> Array:
        """(T, 2) px since t = 0."""
        return self.poses[:, :2] - self.poses[0, :2]

    @property
    def velocity(self) -> Array:
        return self.velocities[:, :2]

    @property
    def speed(self) -> Array:
        return np.asarray(np.hypot(*self.velocity.T))

    @property
    def spin(self) -> Array:
        return self.velocities[:, 2]

    def sample(self, time: float) -> int:
        """Index of the last sample that is not after `time` (s)."""
        return int(np.searchsorted(self.times, time + 1e-9, side="right")) - 1


@dataclass(frozen=True)
class Run:
    """A world and its motion, by any engine that simulated this world."""

    world: World
    trajectory: Trajectory

    def track(self, name: str) -> Track:
        """Motion of one object."""
        k = self.trajectory.names.index(name)
        return Track(
            self.trajectory.times,
            self.trajectory.poses[:, k],
            self.trajectory.velocities[:, k],
        )

    def body(self, name: str) -> Body:
        """Mass, moment and shape of one object."""
        return next(body for body in self.world.bodies if body.name == name)

    def impulse(self, on: str, of: str, begin: float, end: float) -> Array:
        """(2,) g·px/s that `of` gave `on` after the sample at `begin` up to the one at `end` (s)."""
        contacts, times = self.trajectory.contacts, self.trajectory.times
        a, b = contacts.surfaces.index(on), contacts.surfaces.index(of)
        rows, given = contacts.impulse_rows, contacts.impulses
        inside = (times[rows[:, 0]] > begin + 1e-9) & (times[rows[:, 0]] < end + 1e-9)
        first = inside & (rows[:, 1] == a) & (rows[:, 2] == b)
        second = inside & (rows[:, 1] == b) & (rows[:, 2] == a)
        return np.asarray(
            given[first].sum(axis=0) - given[second].sum(axis=0), np.float64
        )


@dataclass(frozen=True)
class Case:
    """One scene and its measurement."""

    scene: Document
    measure: Callable[..., Errors]
    """Takes one `Run` for each entry of `variants`."""
    label: str = ""
    """Distinguishes the cases of one draw; part of the file's name."""
    variants: tuple[str | None, ...] = (None,)
    """Variants of the scene that are run, None for the scene itself."""
    rate: float = 240.0
    """1/s: samples. Divides every rate of steps, so that samples fall on steps."""


@dataclass(frozen=True)
class Row:
    """One closed form."""

    number: int
    name: str
    """Short, for files: `free-fall`."""
    title: str
    closed_form: str
    ranges: str
    """What the draws vary, and between which limits."""
    why: str
    """How the error is counted, why the bar is where it is, and the source."""
    measures: tuple[Measure, ...]
    cases: Callable[[Draw], Sequence[Case]]

    def draw(self, index: int) -> Sequence[Case]:
        """Cases of one random draw, the same on every call."""
        return self.cases(Draw(self.number, index))


def choose(rows: Sequence[Row], numbers: Sequence[int]) -> tuple[Row, ...]:
    """The rows with those numbers, all for none. Raises InputError for a number that no row has."""
    known = {row.number: row for row in rows}
    for number in numbers:
        if number not in known:
            raise InputError.of(
                "--rows", str(number), "is no row", f"choose from 1 to {max(known)}"
            )
    return tuple(
        row for number, row in known.items() if not numbers or number in numbers
    )


class Draw:
    """One seeded draw of a row's parameters, rounded so that the scene file shows them in full.

    `index` selects among a row's named cases; more draws than five go through them again.
    """

    def __init__(self, row: int, index: int) -> None:
        self.index = index % DRAWS
        self._rng = np.random.default_rng((20241, row, index))

    def number(self, low: float, high: float, digits: int = 2) -> float:
        return round(float(self._rng.uniform(low, high)), digits)

    def count(self, low: int, high: int) -> int:
        return int(self._rng.integers(low, high + 1))

    def sign(self) -> int:
        return 1 if self._rng.random() < 0.5 else -1

    def angle(self) -> float:
        """rad; a whole number of degrees."""
        return float(np.radians(int(self._rng.integers(0, 360))))

    def mass(self) -> float:
        """20 to 500 g."""
        return self.number(20, 500, 0)


def worst(errors: Sequence[float]) -> float:
    """The largest; NaN where any is NaN."""
    return float(np.max(errors))


# ---- running -----------------------------------------------------------------------------------------------------


def scene_file(row: Row, case: Case, index: int) -> str:
    """Name of a case's file: `03-bounce.yaml`, `16-pyramid-lifted-draw-5.yaml`; the first draw has no number."""
    parts = (
        f"{row.number:02d}",
        row.name,
        case.label,
        f"draw-{index + 1}" if index else "",
    )
    return "-".join(part for part in parts if part) + ".yaml"


def scene_of(row: Row, case: Case) -> str:
    """Text of the case's scene file, with the closed form and the bar above it."""
    bars = ", ".join(f"{measure.name} {bar_text(measure)}" for measure in row.measures)
    title = f"{row.title} ({case.label})" if case.label else row.title
    header = f"Row {row.number} of the physics scorecard: {title}\n{row.closed_form}\nbar: {bars}"
    return scene_text(case.scene, header=header)


def write_scenes(row: Row, index: int, folder: Path) -> None:
    """Scene files of one draw."""
    for case in row.draw(index):
        write_atomic(
            folder / scene_file(row, case, index), scene_of(row, case).encode()
        )


@dataclass(frozen=True)
class Worst:
    """The largest error of one measure over some cases."""

    error: float
    """Infinite where a scene could not be run."""
    where: str
    """`draw 3`, `draw 5, lifted`."""

    @property
    def size(self) -> float:
        """For comparison: NaN counts as the largest."""
        return self.error if isfinite(self.error) else inf


@dataclass(frozen=True)
class Done:
    """Result of one draw."""

    errors: Mapping[str, Worst]
    """By measure, of those that any case takes."""
    problems: tuple[str, ...]
    """Why a case could not be run."""


def run_draw(
    row: Row,
    index: int,
    folder: Path,
    steps: float | None = None,
    simulate: Simulate = pipeline.simulate,
) -> Done:
    """One draw of a row, from its files in `folder`; `steps` a second override the scene's."""
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
            problems += [
                str(problem).replace(f"{folder}/", "") for problem in error.problems
            ]
            errors = {measure.name: inf for measure in row.measures}
        for name, value in errors.items():
            larger = Worst(float(value), where)
            found[name] = max(found.get(name, larger), larger, key=lambda one: one.size)
    return Done(found, tuple(problems))


class _Job(NamedTuple):
    row: int
    draw: int
    steps: int | None
    folder: Path


def _run(job: _Job) -> Done:
    # the package, which imports this module, has the rows: functions are not sent to processes
    rows = sys.modules["physgen.evaluate.physics"].ROWS
    row = next(row for row in rows if row.number == job.row)
    return run_draw(row, job.draw, job.folder, job.steps)


def evaluate(
    rows: Sequence[Row],
    draws: int = DRAWS,
    steps: Sequence[int] = STEPS,
    workers: int = 1,
    keep: Path | None = None,
    progress: pipeline.Progress = pipeline.silent,
) -> list[dict[str, Any]]:
    """One record a row, as JSON has it; the same for any number of workers.

    `steps` are those of the convergence columns, none to leave them out. With `keep`, scene files stay there.
    """
    if keep is not None and keep.exists() and not keep.is_dir():
        raise InputError.of(str(keep), "", "is a file", "name a folder with -o")
    with tempfile.TemporaryDirectory(prefix="physgen-") as scratch:
        folder = keep or Path(scratch)
        folder.mkdir(parents=True, exist_ok=True)
        jobs = []
        for row in rows:
            for index in range(draws):
                write_scenes(row, index, folder)
                jobs.append(_Job(row.number, index, None, folder))
            jobs += [
                _Job(row.number, 0, rate, folder)
                for rate in steps
                if rate != DEFAULT_STEPS
            ]
        done: dict[int, dict[tuple[int, int | None], Done]] = {
            row.number: {} for row in rows
        }
        for count, (job, found) in enumerate(
            zip(jobs, _run_all(jobs, workers), strict=True), 1
        ):
            done[job.row][job.draw, job.steps] = found
            progress("evaluate", count, len(jobs))
    return [record(row, draws, steps, done[row.number]) for row in rows]


def _run_all(jobs: Sequence[_Job], workers: int) -> Iterator[Done]:
    if workers <= 1 or len(jobs) <= 1:
        yield from map(_run, jobs)
        return
    with ProcessPoolExecutor(
        min(workers, len(jobs)), get_context("spawn"), _ignore_interrupts
    ) as pool:
        try:
            yield from pool.map(_run, jobs)
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            raise


def _ignore_interrupts() -> None:
    """Workers leave Ctrl-C to the process that started them."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)


# ---- result ------------------------------------------------------------------------------------------------------


def record(
    row: Row,
    draws: int,
    steps: Sequence[int],
    done: Mapping[tuple[int, int | None], Done],
) -> dict[str, Any]:
    """A row's line as JSON, from results by draw and steps a second (None: the default)."""
    measures = []
    for measure in row.measures:
        taken = [
            one
            for k in range(draws)
            if (one := done[k, None].errors.get(measure.name)) is not None
        ]
        largest = max(
            taken, key=lambda one: one.size, default=Worst(nan, "never measured")
        )
        first = {
            rate: done[0, None if rate == DEFAULT_STEPS else rate].errors
            for rate in steps
        }
        measures.append(
            {
                "name": measure.name,
                "unit": measure.unit.value,
                "bar": measure.bar,
                "error": _rounded(largest.error),
                "worst": largest.where,
                "passed": largest.error <= measure.bar,  # NaN passes no bar
                "convergence": {
                    str(rate): _rounded(errors[measure.name].error)
                    for rate, errors in first.items()
                    if measure.name in errors
                },
            }
        )
    problems = dict.fromkeys(
        problem for k in range(draws) for problem in done[k, None].problems
    )
    return {
        "row": row.number,
        "name": row.name,
        "title": row.title,
        "closed_form": row.closed_form,
        "draws": row.ranges,
        "why": row.why,
        "scenes": [scene_file(row, case, 0) for case in row.draw(0)],
        "passed": all(measure["passed"] for measure in measures),
        "measures": measures,
        "problems": list(problems),
    }


def _rounded(error: float) -> float | None:
    return float(f"{error:.3g}") if isfinite(error) else None


def bar_text(measure: Measure) -> str:
    """A bar with its unit."""
    return (
        "as stated"
        if measure.unit is Unit.SWITCH
        else quantity(measure.bar, measure.unit.value)
    )


def quantity(value: float | None, unit: str) -> str:
    """An error or a bar with its unit: percent, pixels, degrees, or whether it is as required.

    >>> quantity(0.00123, "part"), quantity(3e-12, "part"), quantity(0.5, "px"), quantity(1.0, "switch")
    ('0.12 %', '< 1e-6 %', '0.5 px', 'no')
    """
    if value is None:
        return "none"
    if unit == "switch":
        return "no" if value else "yes"
    number, sign = (value * 100, "%") if unit == "part" else (value, unit)
    if number and abs(number) < 1e-6:
        return f"< 1e-6 {sign}"
    return f"{number:.2g} {sign}" if abs(number) < 100 else f"{number:.0f} {sign}"


def findings(rows: Sequence[Mapping[str, Any]]) -> Findings:
    """A table with one line for each measure of each row."""
    rates = sorted(
        {
            rate
            for row in rows
            for one in row["measures"]
            for rate in one["convergence"]
        },
        key=float,
    )
    lines = []
    for row in rows:
        for k, one in enumerate(row["measures"]):
            unit = one["unit"]
            bar = "as stated" if unit == "switch" else quantity(one["bar"], unit)
            first = (str(row["row"]), row["title"]) if k == 0 else ("", "")
            label = f"{one['name']}: {bar}" if len(row["measures"]) > 1 else bar
            steps = (quantity(one["convergence"].get(rate), unit) for rate in rates)
            verdict = "pass" if one["passed"] else "FAIL"
            lines.append((*first, label, quantity(one["error"], unit), verdict, *steps))
    heads = (
        "row",
        "closed form",
        "bar",
        "worst error",
        "verdict",
        *(f"at {rate}/s" for rate in rates),
    )
    problems = tuple(
        f"row {row['row']}: {problem}" for row in rows for problem in row["problems"]
    )
    passed = sum(row["passed"] for row in rows)
    count = f"{passed} of {len(rows)}"
    section = Section("Closed forms", problems, (Table(heads, tuple(lines)),))
    pass_bar = Bar("rows that pass", count, f"{len(rows)}", passed == len(rows))
    title = "Motion against closed forms"
    return Findings(
        "physics", title, (f"{count} rows pass.",), (section,), rows, (pass_bar,)
    )
