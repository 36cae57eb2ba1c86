"""The parts of the rows of closed forms, and their runs.

A row has one closed form, test scenes, and the largest passing error. Its scenes have
seeded random parameters and run by the public path. `Track` and `Run` give readable
access to the motion of a body.
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
from physgen.messages import Message
from physgen.problems import InputError
from physgen.scene.write import scene_text
from physgen.simulate.trajectory import Trajectory

Array = NDArray[np.float64]
Document = dict[str, Any]
"""A scene as plain data, as in the YAML file."""
Errors = Mapping[str, float]
"""Name of a measure -> error, in the measure's unit."""
Simulate = Callable[[World, float], Trajectory]
"""World and sampling rate (1/s) -> motion from t = 0 to the world's end."""

DRAWS = 5
"""Random draws of each row."""
STEPS = (240, 480, 960, 1920)
"""Engine steps of the first draw for convergence, 1/s."""
DEFAULT_STEPS = 960
"""Default engine steps of a scene, 1/s."""
TIME_TOLERANCE = 1e-9
"""Rounding error of sample times, s."""
SEED = 20241
"""Seed of all draws."""


class Unit(Enum):
    """Unit of an error."""

    PART = "part"
    """Fraction of the exact value, in percent on the page."""
    PX = "px"
    DEGREES = "degrees"
    SWITCH = "switch"
    """0 for a fulfilled requirement, otherwise 1."""


@dataclass(frozen=True)
class Measure:
    """One error of a row, and its largest passing value."""

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
    def positions(self) -> Array:
        """Return the positions, (T, 2) px."""
        return self.poses[:, :2]

    @property
    def displacements(self) -> Array:
        """Return the displacements since t = 0, (T, 2) px."""
        return self.poses[:, :2] - self.poses[0, :2]

    @property
    def velocity(self) -> Array:
        """Return the velocities, (T, 2) px/s."""
        return self.velocities[:, :2]

    @property
    def speed(self) -> Array:
        """Return the speeds, (T,) px/s."""
        return np.asarray(np.hypot(*self.velocity.T))

    @property
    def spin(self) -> Array:
        """Return the angular velocities, (T,) rad/s."""
        return self.velocities[:, 2]

    def sample(self, time: float) -> int:
        """Return the index of the last sample at or before `time` (s)."""
        return int(np.searchsorted(self.times, time + TIME_TOLERANCE, side="right")) - 1


@dataclass(frozen=True)
class Run:
    """A world and its motion, from any engine."""

    world: World
    trajectory: Trajectory

    def track(self, name: str) -> Track:
        """Return the motion of one object."""
        k = self.trajectory.names.index(name)
        return Track(
            self.trajectory.times,
            self.trajectory.poses[:, k],
            self.trajectory.velocities[:, k],
        )

    def body(self, name: str) -> Body:
        """Return mass, moment and shape of one object."""
        return next(body for body in self.world.bodies if body.name == name)

    def impulse(self, receiver: str, giver: str, begin: float, end: float) -> Array:
        """Return the impulse (2,) g·px/s of one surface on another, after the
        sample at `begin` (s) up to `end` (s).
        """
        contacts = self.trajectory.contacts
        first = contacts.surfaces.index(receiver)
        second = contacts.surfaces.index(giver)
        samples, surfaces, partners = contacts.impulse_rows.T
        times = self.trajectory.times[samples]
        # Both directions of a pair are recorded with opposite signs.
        is_after = times > begin + TIME_TOLERANCE
        is_before = times < end + TIME_TOLERANCE
        is_inside = is_after & is_before
        is_forward = is_inside & (surfaces == first) & (partners == second)
        is_backward = is_inside & (surfaces == second) & (partners == first)
        forward = contacts.impulses[is_forward].sum(axis=0)
        backward = contacts.impulses[is_backward].sum(axis=0)
        return np.asarray(forward - backward, np.float64)


@dataclass(frozen=True)
class Case:
    """One scene and its measurement."""

    scene: Document
    measure: Callable[..., Errors]
    """Takes one `Run` for each entry of `variants`, and returns the errors."""
    label: str = ""
    """Distinguishes the cases of one draw; part of the file's name."""
    variants: tuple[str | None, ...] = (None,)
    """Variants of the scene to run, None for the scene itself."""
    rate: float = 240.0
    """Sampling rate, 1/s. It divides every rate of steps, so that samples fall on
    steps.
    """


@dataclass(frozen=True)
class Row:
    """One closed form."""

    number: int
    name: str
    """Short name for files: `free-fall`."""
    title: str
    closed_form: str
    ranges: str
    """The parameters of the draws, and their limits."""
    reason: str
    """The definition of the error, the reason of the bar, and the source."""
    measures: tuple[Measure, ...]
    cases: Callable[[Draw], Sequence[Case]]

    def draw(self, index: int) -> Sequence[Case]:
        """Return the cases of one random draw, the same on every call."""
        return self.cases(Draw(self.number, index))


def choose(rows: Sequence[Row], numbers: Sequence[int]) -> tuple[Row, ...]:
    """Return the rows with these numbers, or all rows. Raise InputError for an unknown
    number.
    """
    if not numbers:
        return tuple(rows)
    known_numbers = [row.number for row in rows]
    for number in numbers:
        if number not in known_numbers:
            raise Message.UNKNOWN_ROW.error(
                "--rows", str(number), last=max(known_numbers)
            )
    return tuple(row for row in rows if row.number in numbers)


class Draw:
    """One seeded draw of a row's parameters, rounded so that the scene file has all
    their digits.

    `index` selects among a row's named cases. After the fifth draw, the cases start
    again.
    """

    def __init__(self, row: int, index: int) -> None:
        self.index = index % DRAWS
        # Each draw of each row has its own numbers, so that a new row changes no other.
        self._rng = np.random.default_rng((SEED, row, index))

    def number(self, low: float, high: float, digits: int = 2) -> float:
        """Return a uniform random number, rounded to digits."""
        return round(float(self._rng.uniform(low, high)), digits)

    def count(self, low: int, high: int) -> int:
        """Return a random integer from `low` to `high`."""
        return int(self._rng.integers(low, high + 1))

    def sign(self) -> int:
        """Return 1 or -1."""
        if self._rng.random() < 0.5:
            return 1
        return -1

    def angle(self) -> float:
        """Return an angle of an integer number of degrees, rad."""
        return float(np.radians(int(self._rng.integers(0, 360))))

    def mass(self) -> float:
        """Return a mass of 20 to 500 g."""
        return self.number(20, 500, 0)


def worst(errors: Sequence[float]) -> float:
    """Return the largest error; NaN if any is NaN."""
    return float(np.max(errors))


# ---- running


def scene_file(row: Row, case: Case, index: int) -> str:
    """Return the name of a case's file.

    Examples are `03-bounce.yaml` and `16-pyramid-lifted-draw-5.yaml`; the first draw has no number.
    """
    parts = [f"{row.number:02d}", row.name]
    if case.label:
        parts.append(case.label)
    if index:
        parts.append(f"draw-{index + 1}")
    return "-".join(parts) + ".yaml"


def scene_of(row: Row, case: Case) -> str:
    """Return the text of the case's scene file, with the closed form and the
    bar above it.
    """
    bars = ", ".join(f"{measure.name} {bar_text(measure)}" for measure in row.measures)
    if case.label:
        title = f"{row.title} ({case.label})"
    else:
        title = row.title
    header = f"Row {row.number} of the physics scorecard: {title}\n{row.closed_form}\nbar: {bars}"
    return scene_text(case.scene, header=header)


def write_scenes(row: Row, index: int, folder: Path) -> None:
    """Write the scene files of one draw."""
    for case in row.draw(index):
        path = folder / scene_file(row, case, index)
        write_atomic(path, scene_of(row, case).encode())


@dataclass(frozen=True)
class LargestError:
    """The largest error of one measure over some cases."""

    error: float
    """Infinite if a scene failed to run."""
    place: str
    """`draw 3`, `draw 5, lifted`."""

    @property
    def size(self) -> float:
        """Return the error for comparison. NaN counts as the largest."""
        if isfinite(self.error):
            return self.error
        return inf


@dataclass(frozen=True)
class DrawResult:
    """Result of one draw."""

    errors: Mapping[str, LargestError]
    """Largest errors by measure."""
    problems: tuple[str, ...]
    """Reasons of failed cases."""


def run_draw(
    row: Row,
    index: int,
    folder: Path,
    steps: float | None = None,
    simulate: Simulate = pipeline.simulate,
) -> DrawResult:
    """Return the result of one draw, from its files in `folder`; `steps` a
    second override the scene's.
    """
    if steps is None:
        overrides = []
    else:
        overrides = [f"world.steps_per_second={steps}"]
    largest: dict[str, LargestError] = {}
    problems: list[str] = []
    for case in row.draw(index):
        path = folder / scene_file(row, case, index)
        try:
            runs = _run_variants(case, path, overrides, simulate)
            errors = case.measure(*runs)
        # A scene that cannot be simulated is an infinite error, not a missing one.
        except InputError as error:
            for problem in error.problems:
                problems.append(str(problem).replace(f"{folder}/", ""))
            errors = {measure.name: inf for measure in row.measures}
        place = f"draw {index + 1}"
        if case.label:
            place = f"{place}, {case.label}"
        for name, value in errors.items():
            # The place of the largest error leads to the scene to look at.
            candidate = LargestError(float(value), place)
            if name not in largest or candidate.size > largest[name].size:
                largest[name] = candidate
    return DrawResult(largest, tuple(problems))


def _run_variants(
    case: Case, path: Path, overrides: Sequence[str], simulate: Simulate
) -> list[Run]:
    """Return one run for each variant of a case."""
    runs = []
    for variant in case.variants:
        scene = pipeline.load(path, overrides, variant)
        world = pipeline.compile(scene, None).world
        runs.append(Run(world, simulate(world, case.rate)))
    return runs


class _Job(NamedTuple):
    """One draw of one row, for a separate process."""

    row: int
    draw: int
    steps: int | None
    """Steps per second; None for the scene's own."""
    folder: Path


def _run_job(job: _Job) -> DrawResult:
    # Functions cannot be sent to processes: the job has a number, and the package has the
    # rows. The package imports this module, so that an import here would be a cycle.
    rows = sys.modules["physgen.evaluate.physics"].ROWS
    row = next(row for row in rows if row.number == job.row)
    return run_draw(row, job.draw, job.folder, job.steps)


_Results = dict[tuple[int, int | None], DrawResult]
"""Results of one row, by draw and steps per second (None: the default)."""


def evaluate(
    rows: Sequence[Row],
    draws: int = DRAWS,
    steps: Sequence[int] = STEPS,
    workers: int = 1,
    keep: Path | None = None,
    progress: pipeline.Progress = pipeline.silent,
) -> list[dict[str, Any]]:
    """Return one record per row, in the form of the JSON; the same for any number of
    workers.

    `steps` are those of the convergence columns. With `keep`, scene files stay there.
    """
    if keep is not None and keep.exists() and not keep.is_dir():
        raise Message.OUTPUT_IS_FILE.error(str(keep))
    results: dict[int, _Results] = {row.number: {} for row in rows}
    with tempfile.TemporaryDirectory(prefix="physgen-") as scratch:
        folder = keep or Path(scratch)
        folder.mkdir(parents=True, exist_ok=True)
        jobs = []
        for row in rows:
            for index in range(draws):
                write_scenes(row, index, folder)
            jobs += _jobs_of_row(row, draws, steps, folder)
        outcomes = zip(jobs, _run_jobs(jobs, workers), strict=True)
        for count, (job, result) in enumerate(outcomes, 1):
            results[job.row][job.draw, job.steps] = result
            progress("evaluate", count, len(jobs))
    return [record(row, draws, steps, results[row.number]) for row in rows]


def _jobs_of_row(
    row: Row, draws: int, steps: Sequence[int], folder: Path
) -> list[_Job]:
    """Return the jobs of all draws, and of the first draw with other steps."""
    jobs = [_Job(row.number, index, None, folder) for index in range(draws)]
    for rate in steps:
        if rate != DEFAULT_STEPS:
            jobs.append(_Job(row.number, 0, rate, folder))
    return jobs


def _run_jobs(jobs: Sequence[_Job], workers: int) -> Iterator[DrawResult]:
    """Yield the results in the order of the jobs."""
    if workers <= 1 or len(jobs) <= 1:
        yield from map(_run_job, jobs)
        return
    processes = min(workers, len(jobs))
    # A forked process could inherit a lock of the libraries' threads.
    context = get_context("spawn")
    with ProcessPoolExecutor(processes, context, _ignore_interrupts) as pool:
        try:
            yield from pool.map(_run_job, jobs)
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            raise


def _ignore_interrupts() -> None:
    """Leave Ctrl-C to the parent process."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)


# ---- result


def record(
    row: Row,
    draws: int,
    steps: Sequence[int],
    results: Mapping[tuple[int, int | None], DrawResult],
) -> dict[str, Any]:
    """Return a row's record for JSON, from results by draw and steps per second (None:
    the default).
    """
    draw_results = [results[index, None] for index in range(draws)]
    first_results = {}
    for rate in steps:
        if rate == DEFAULT_STEPS:
            key = None
        else:
            key = rate
        first_results[rate] = results[0, key]
    measures = []
    for measure in row.measures:
        measures.append(_record_measure(measure, draw_results, first_results))
    problems: list[str] = []
    for result in draw_results:
        problems += result.problems
    return {
        "row": row.number,
        "name": row.name,
        "title": row.title,
        "closed_form": row.closed_form,
        "draws": row.ranges,
        "why": row.reason,
        "scenes": [scene_file(row, case, 0) for case in row.draw(0)],
        "passed": all(measure["passed"] for measure in measures),
        "measures": measures,
        "problems": list(dict.fromkeys(problems)),
    }


def _record_measure(
    measure: Measure,
    draw_results: Sequence[DrawResult],
    first_results: Mapping[int, DrawResult],
) -> dict[str, Any]:
    """Return the record of one measure, from all draws, and from the first draw by
    steps per second.
    """
    largest = LargestError(nan, "never measured")
    for result in draw_results:
        error = result.errors.get(measure.name)
        if error is None:
            continue
        if largest.place == "never measured" or error.size > largest.size:
            largest = error
    convergence = {}
    for rate, result in first_results.items():
        if measure.name in result.errors:
            convergence[str(rate)] = _round_error(result.errors[measure.name].error)
    return {
        "name": measure.name,
        "unit": measure.unit.value,
        "bar": measure.bar,
        "error": _round_error(largest.error),
        "worst": largest.place,
        # NaN passes no bar.
        "passed": largest.error <= measure.bar,
        "convergence": convergence,
    }


def _round_error(error: float) -> float | None:
    if isfinite(error):
        return float(f"{error:.3g}")
    return None


def bar_text(measure: Measure) -> str:
    """Return a bar with its unit."""
    if measure.unit is Unit.SWITCH:
        return "as stated"
    return quantity(measure.bar, measure.unit.value)


def quantity(value: float | None, unit: str) -> str:
    """Return an error or a bar with its unit: percent, pixels, degrees, or yes and no.

    >>> quantity(0.00123, "part"), quantity(3e-12, "part"), quantity(0.5, "px"), quantity(1.0, "switch")
    ('0.12 %', '< 1e-6 %', '0.5 px', 'no')
    """
    if value is None:
        return "none"
    if unit == "switch":
        if value:
            return "no"
        return "yes"
    number, sign = value, unit
    if unit == "part":
        number, sign = value * 100, "%"
    if number and abs(number) < 1e-6:
        return f"< 1e-6 {sign}"
    if abs(number) < 100:
        return f"{number:.2g} {sign}"
    return f"{number:.0f} {sign}"


def findings(rows: Sequence[Mapping[str, Any]]) -> Findings:
    """Return a table with one line for each measure of each row."""
    rates = _convergence_rates(rows)
    lines: list[tuple[str, ...]] = []
    problems = []
    for row in rows:
        lines += _lines_of_row(row, rates)
        problems += [f"row {row['row']}: {problem}" for problem in row["problems"]]
    heads = ("row", "closed form", "bar", "worst error", "verdict")
    step_heads = (f"at {rate}/s" for rate in rates)
    table = Table((*heads, *step_heads), tuple(lines))
    section = Section("Closed forms", tuple(problems), (table,))
    passes = sum(row["passed"] for row in rows)
    count = f"{passes} of {len(rows)}"
    return Findings(
        measure="physics",
        title="Motion against closed forms",
        sentences=(f"{count} rows pass.",),
        sections=(section,),
        rows=rows,
        bars=(Bar("rows that pass", count, f"{len(rows)}", passes == len(rows)),),
    )


def _convergence_rates(rows: Sequence[Mapping[str, Any]]) -> list[str]:
    """Return the steps per second of any measure, in rising order."""
    rates: set[str] = set()
    for row in rows:
        for measure in row["measures"]:
            rates.update(measure["convergence"])
    return sorted(rates, key=float)


def _lines_of_row(
    row: Mapping[str, Any], rates: Sequence[str]
) -> list[tuple[str, ...]]:
    """Return the lines of the table for one row. Only the first line has number and
    title.
    """
    lines = []
    number_and_title = (str(row["row"]), row["title"])
    for measure in row["measures"]:
        unit = measure["unit"]
        if unit == "switch":
            bar = "as stated"
        else:
            bar = quantity(measure["bar"], unit)
        if len(row["measures"]) > 1:
            bar = f"{measure['name']}: {bar}"
        error = quantity(measure["error"], unit)
        verdict = "FAIL"
        if measure["passed"]:
            verdict = "pass"
        steps = (quantity(measure["convergence"].get(rate), unit) for rate in rates)
        lines.append((*number_and_title, bar, error, verdict, *steps))
        number_and_title = ("", "")
    return lines
