"""Scene files -> output folders, several at a time in processes; a failed one does not stop the others."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ProcessPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from multiprocessing import get_context
from pathlib import Path

from physgen import pipeline
from physgen.problems import InputError, Problem
from physgen.report.video import Format


@dataclass(frozen=True)
class Job:
    """One clip to make."""

    path: str
    out: str
    overrides: tuple[str, ...]
    variant: str | None
    allow_outside: bool
    formats: tuple[Format, ...]
    command: tuple[str, ...]


@dataclass(frozen=True)
class Done:
    """How a job ended: a folder, and the warnings on the way; or no folder, and the errors."""

    job: Job
    folder: Path | None
    problems: tuple[Problem, ...] = ()


def run(job: Job, progress: pipeline.Progress = pipeline.silent) -> Done:
    """One clip in this process."""
    warnings: list[Problem] = []
    try:
        folder = pipeline.render_scene(
            job.path,
            job.out,
            overrides=job.overrides,
            variant=job.variant,
            allow_outside=job.allow_outside,
            formats=job.formats,
            command=job.command,
            progress=progress,
            warn=warnings.append,
        )
    except InputError as error:
        return Done(job, None, (*warnings, *error.problems))
    return Done(job, folder, tuple(warnings))


def run_all(jobs: Sequence[Job], workers: int, watch: Callable[[Job], pipeline.Progress]) -> Iterator[Done]:
    """Results in the order of the jobs, whatever finishes first."""
    if workers <= 1 or len(jobs) <= 1:
        for job in jobs:
            yield run(job, watch(job))
        return
    with _pool(workers) as pool:
        futures: list[Future[Done]] = [pool.submit(run, job) for job in jobs]
        for future in futures:
            yield future.result()


@contextmanager
def _pool(workers: int) -> Iterator[ProcessPoolExecutor]:
    pool = ProcessPoolExecutor(workers, mp_context=get_context("spawn"))
    try:
        yield pool
    finally:
        pool.shutdown(cancel_futures=True)
