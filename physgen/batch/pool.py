"""Scene files -> output folders, several at a time in processes; a failed one does not stop the others."""

from __future__ import annotations

import signal
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from physgen import pipeline
from physgen.configured import plan
from physgen.crew import Plan
from physgen.problems import InputError, Problem
from physgen.report.traces import clear, leave, trace_of
from physgen.report.video import Format
from physgen.whole import meant

if TYPE_CHECKING:
    from concurrent.futures import Future, ProcessPoolExecutor


@dataclass(frozen=True)
class Refiner:
    """Whose weights refine, and on what, as the command said it."""

    setting: str = ""
    """`NAME[:WEIGHTS]`."""
    config: Path | None = None
    """In place of the files physgen.toml."""
    device: str | None = None

    def plan(self) -> Plan:
        """With what the files say. Raises InputError."""
        told = plan(config=self.config, device=self.device)
        said = told.choices.get("refine")
        if not self.setting or (
            said is not None and said.name == self.setting
        ):  # a bare name: the file has its weights
            return told
        return plan([f"refine={self.setting}"], config=self.config, device=self.device)


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
    chaos: bool = False
    device: str = "cpu"
    refiner: Refiner = Refiner()
    cached: bool = True
    page: pipeline.Page = pipeline.Page.FULL
    single_file: bool = False


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
            ask_chaos=job.chaos,
            device=job.device,
            refiners=_refiners(job.refiner),
            cached=job.cached,
            page=job.page,
            single_file=job.single_file,
            progress=progress,
            warn=warnings.append,
        )
    except InputError as error:
        return Done(job, None, (*warnings, *error.problems))
    except (OSError, MemoryError) as error:
        return Done(job, None, (*warnings, _failure(job, error)))
    return Done(job, folder, tuple(warnings))


_REFINERS: dict[Refiner, pipeline.Refiners] = {}
"""Of this process: models are loaded once, not for every clip."""


def _refiners(who: Refiner) -> pipeline.Refiners:
    if who not in _REFINERS:
        _REFINERS[who] = pipeline.Refiners(who.plan)
    return _REFINERS[who]


def _failure(job: Job, error: BaseException) -> Problem:
    """The machine's fault rather than the scene's, as one line."""
    if isinstance(error, OSError):
        where = f"{meant(str(error.filename))}: " if error.filename else ""
        return InputError.of(job.path, "", f"failed: {where}{error.strerror or error}", "").problems[0]
    said = "ran out of memory" if isinstance(error, MemoryError) else "failed: its process died"
    return InputError.of(job.path, "", said, "try fewer --jobs or a smaller scene").problems[0]


def ended(done: Done, out: Path, gallery: bool) -> None:
    """A clip that is there takes its earlier failure away; one that failed leaves a trace for the `gallery` of `out`.

    What cannot be written is not: the problems were told.
    """
    from physgen.report.page import failed_page

    job = done.job
    with suppress(InputError, OSError):
        name = pipeline.output_name(job.path, job.variant)
        if done.folder is not None:
            clear(out, name)
        elif gallery:
            try:
                text = Path(job.path).read_text(encoding="utf-8")
            except (OSError, ValueError):
                text = ""
            page = failed_page(name, done.problems, job.command, text, job.path)
            leave(out, trace_of(name, job.path, job.variant, job.overrides, job.command, done.problems), page)


def run_all(jobs: Sequence[Job], workers: int, watch: Callable[[Job], pipeline.Progress]) -> Iterator[Done]:
    """Results in the order of the jobs, whatever finishes first."""
    if workers <= 1 or len(jobs) <= 1:
        for job in jobs:
            yield run(job, watch(job))
        return
    from concurrent.futures.process import BrokenProcessPool  # 30 ms that a single clip need not wait for

    with _pool(min(workers, len(jobs))) as pool:
        futures: list[Future[Done]] = [pool.submit(run, job) for job in jobs]
        for job, future in zip(jobs, futures, strict=True):
            try:
                yield future.result()
            except BrokenProcessPool as error:
                yield Done(job, None, (_failure(job, error),))


@contextmanager
def _pool(workers: int) -> Iterator[ProcessPoolExecutor]:
    """Workers leave Ctrl-C to this process: it ends them, and they clear away what they were writing."""
    from concurrent.futures import ProcessPoolExecutor
    from multiprocessing import active_children, get_context

    pool = ProcessPoolExecutor(workers, mp_context=get_context("spawn"), initializer=_obey)
    try:
        yield pool
    except BaseException:
        for worker in active_children():
            worker.terminate()
        raise
    finally:
        pool.shutdown(cancel_futures=True)


def _obey() -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, lambda number, frame: sys.exit(1))
