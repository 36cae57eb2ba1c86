"""The rows of the physics scorecard -> their scores, in one process or several."""

from __future__ import annotations

import signal
import tempfile
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from contextlib import contextmanager
from dataclasses import dataclass
from multiprocessing import get_context
from pathlib import Path

from physgen import pipeline
from physgen.evaluate import (
    barriers,
    conserved,
    energy,
    falling,
    forces,
    impacts,
    joints,
    rolling,
    sliding,
    stacks,
    tabletop,
)
from physgen.evaluate.row import DRAWS, Row
from physgen.evaluate.score import DEFAULT_STEPS, RowScore, score
from physgen.evaluate.trial import Done, run_draw, scene_file, scene_of, write_scenes
from physgen.problems import InputError

ROWS: tuple[Row, ...] = tuple(
    sorted(
        (
            row
            for group in (
                falling, sliding, rolling, impacts, conserved, barriers, tabletop, stacks, forces, joints, energy,
            )
            for row in group.ROWS
        ),
        key=lambda row: row.number,
    )
)  # fmt: skip
"""Every row by its number: 1 to 27 are those of the project's list of closed forms."""

STEPS = (240, 480, 960, 1920)
"""Steps a second at which the first draw shows how its error shrinks."""


def examples() -> Iterator[tuple[str, str]]:
    """File name and text of every scene of the first draws: what scenes/physics/ holds."""
    for row in ROWS:
        for case in row.draw(0):
            yield scene_file(row, case, 0), scene_of(row, case)


def choose(numbers: Sequence[int]) -> tuple[Row, ...]:
    """The rows of those numbers, all for none; raises InputError for a number that no row has."""
    known = {row.number: row for row in ROWS}
    for number in numbers:
        if number not in known:
            raise InputError.of("--rows", str(number), "is no row", f"choose from 1 to {max(known)}")
    return tuple(row for number, row in known.items() if not numbers or number in numbers)


@dataclass(frozen=True)
class _Job:
    row: int
    draw: int
    steps: int | None
    folder: Path


def evaluate(
    rows: Sequence[Row],
    draws: int = DRAWS,
    steps: Sequence[int] = STEPS,
    workers: int = 1,
    keep: Path | None = None,
    progress: pipeline.Progress = pipeline.silent,
    kept: pipeline.Keep = lambda path: None,
) -> list[RowScore]:
    """Run the rows; the result is the same for any number of workers.

    `steps` are those of the convergence columns, none to leave them out. With `keep`, the scene files stay in that
    folder; `kept` is told of files that stood in the way.
    """
    with _folder(keep) as folder:
        for row in rows:
            for index in range(draws):
                write_scenes(row, index, folder, kept)
        jobs = [_Job(row.number, index, None, folder) for row in rows for index in range(draws)]
        jobs += [_Job(row.number, 0, rate, folder) for row in rows for rate in steps if rate != DEFAULT_STEPS]
        jobs.sort(key=_cost, reverse=True)
        done = dict(_run_all(jobs, workers, progress))
    return [
        score(row, draws, steps, {(j.draw, j.steps): d for j, d in done.items() if j.row == row.number})
        for row in rows
    ]


@contextmanager
def _folder(keep: Path | None) -> Iterator[Path]:
    if keep is not None:
        if keep.exists() and not keep.is_dir():
            raise InputError.of(str(keep), "", "is a file", "name a folder with -o")
        keep.mkdir(parents=True, exist_ok=True)
        yield keep
        return
    with tempfile.TemporaryDirectory(prefix="physgen-") as folder:
        yield Path(folder)


def _cost(job: _Job) -> float:
    """Roughly how long a job takes: long ones go first, so that no worker is left with one at the end."""
    row = _row(job.row)
    return sum(
        float(case.scene["world"]["duration"])
        * len(case.scene["objects"])
        * len(case.variants)
        * (job.steps or DEFAULT_STEPS)
        for case in row.draw(job.draw)
    )


def _row(number: int) -> Row:
    return next(row for row in ROWS if row.number == number)


def _run(job: _Job) -> Done:
    return run_draw(_row(job.row), job.draw, job.folder, job.steps)


def _run_all(jobs: Sequence[_Job], workers: int, progress: pipeline.Progress) -> Iterator[tuple[_Job, Done]]:
    if workers <= 1 or len(jobs) <= 1:
        for count, job in enumerate(jobs, 1):
            yield job, _run(job)
            progress("evaluate", count, len(jobs))
        return
    pool = ProcessPoolExecutor(min(workers, len(jobs)), mp_context=get_context("spawn"), initializer=_obey)
    with pool:
        try:
            futures = {pool.submit(_run, job): job for job in jobs}
            for count, future in enumerate(as_completed(futures), 1):
                yield futures[future], future.result()
                progress("evaluate", count, len(jobs))
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            raise


def _obey() -> None:
    """Workers leave Ctrl-C to the process that started them."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
