"""Scene files -> output folders, several at a time in processes; a failed one does not stop the others."""

from __future__ import annotations

import time
import traceback
from collections.abc import Callable, Generator, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from enum import Enum
from functools import cache
from pathlib import Path

from physgen import pipeline
from physgen.batch.columns import Cell
from physgen.batch.finished import finished, mark
from physgen.batch.finished import warnings as warned
from physgen.batch.outcomes import outcomes
from physgen.batch.refiner import NOBODY, Refiner
from physgen.batch.workers import LostError, spread
from physgen.problems import InputError, Problem
from physgen.report.record import source_of
from physgen.report.traces import clear, leave, trace_of
from physgen.report.video import NO_ROOM, Format
from physgen.simulate.trajectory import read_trajectory
from physgen.urls import is_url, url_below
from physgen.whole import meant


@dataclass(frozen=True)
class Here:
    """Where a clip's scene and folder are to the process that makes it, and what that process cannot know of them."""

    scene: str
    """A scene file or a pack."""
    out: str
    """A folder with nothing but this process's in it."""
    name: str
    """Of the clip's folder."""
    mark: str
    known: pipeline.Known


@dataclass(frozen=True)
class Job:
    """One clip to make."""

    path: str
    """The scene as the user names it: a path or a URL."""
    out: str
    """The folder of results as the user names it: a path or a URL."""
    overrides: tuple[str, ...]
    variant: str | None
    allow_outside: bool
    formats: tuple[Format, ...]
    command: tuple[str, ...]
    chaos: bool = False
    device: str = "cpu"
    refiner: Refiner = NOBODY
    cached: bool = True
    page: pipeline.Page = pipeline.Page.FULL
    name: str | None = None
    """Of its folder; None: the scene's, with the variant's behind it."""
    tracked: tuple[str, ...] | None = None
    """Objects whose outcomes are asked for, beside those of all together; None: nobody asked for any."""
    export: tuple[str, ...] = ()
    """Formats of its ground truth."""
    single_file: bool = False
    draws: int = 0
    """Of what is uncertain; see `render_scene`."""
    draw_seed: int = 0
    here: Here | None = None
    """Where it is made of copies."""
    pictured: bool = False
    """Whether a gallery of `out` follows, whose pictures of the clip are made where the clip is: by many at a time."""

    @property
    def called(self) -> str:
        """The name of the clip's folder. Raises InputError where that cannot be one."""
        return self.here.name if self.here else self.name or pipeline.output_name(self.path, self.variant)

    @property
    def folder(self) -> Path:
        """Where the clip goes; of a URL, only the name is one. Raises InputError where that cannot be one."""
        return Path(self.here.out if self.here else self.out) / self.called

    @property
    def scene(self) -> Path:
        """Where its scene is read. Raises InputError for a file that is neither a scene nor a pack."""
        return pipeline.scene_file(self.here.scene if self.here else self.path)

    @property
    def is_far(self) -> bool:
        """Whether this process has yet to bring the scene here, or the clip to where it belongs."""
        return self.here is None and (is_url(self.path) or is_url(self.out))

    @property
    def mark(self) -> str:
        """Of all that is asked of the clip, of the models that may refine it, and of the code."""
        if self.here is not None:
            return self.here.mark
        asked = (self.overrides, self.variant, self.name, self.formats, self.chaos, self.page)
        fan = (self.draws, self.draw_seed) if self.draws else ()
        return mark(
            *asked, pipeline.drawn_by(self.device), self.single_file, self.export, self.refiner.told, *fan
        )


class State(Enum):
    """How a job ended."""

    MADE = "made"
    UNCHANGED = "unchanged"
    """The clip was there, made of the same."""
    FAILED = "failed"


@dataclass(frozen=True)
class Done:
    """How a job ended: a folder, and the warnings on the way; or no folder, and the errors."""

    job: Job
    folder: Path | None
    problems: tuple[Problem, ...] = ()
    state: State = State.FAILED
    seconds: float = 0.0
    full: bool = False
    """There is no room left for any clip."""
    outcomes: Mapping[str, Cell] | None = None
    """What became of it; see `batch.outcomes.outcomes`."""

    @property
    def where(self) -> str | None:
        """The clip's folder as the user knows it."""
        if self.folder is None:
            return None
        return url_below(self.job.out, self.folder.name) if is_url(self.job.out) else str(self.folder)


def run(job: Job, progress: pipeline.Progress = pipeline.silent) -> Done:
    """One clip in this process, unless it is there."""
    done = _made(job, progress)
    if job.tracked is None or done.folder is None or done.outcomes is not None:
        return done
    return with_outcomes(done, done.folder / "trajectory.npz")


def with_outcomes(done: Done, trajectory: Path) -> Done:
    """With those that the job asks for, if any."""
    if done.job.tracked is None:
        return done
    try:
        told = outcomes(read_trajectory(trajectory), done.job.tracked)
    except (OSError, ValueError, KeyError) as error:  # another command replaces it
        return failed(done.job, error, done.problems, done.seconds)
    return replace(done, outcomes=told)


def _made(job: Job, progress: pipeline.Progress) -> Done:
    if job.is_far:
        from physgen.batch.far import run_far

        return run_far(job, progress)
    begun = time.perf_counter()
    warm = _warm()
    warnings: list[Problem] = []
    try:
        if job.cached:
            told = finished(job.folder, job.mark, job.scene, hash_of)
            if told is not None and (job.here or told["source"] == source_of(Path(job.path), job.folder)):
                return Done(job, job.folder, tuple(warned(told)), State.UNCHANGED)
        folder = pipeline.render_scene(
            job.here.scene if job.here else job.path,
            job.folder.parent,
            overrides=job.overrides,
            variant=job.variant,
            name=job.called,
            mark=job.mark,
            allow_outside=job.allow_outside,
            formats=job.formats,
            command=job.command,
            ask_chaos=job.chaos,
            draws=job.draws,
            draw_seed=job.draw_seed,
            device=job.device,
            refiners=_refiners(job.refiner),
            cached=job.cached,
            page=job.page,
            export=job.export,
            known=job.here.known if job.here else None,
            warm=warm,
            single_file=job.single_file,
            progress=progress,
            warn=warnings.append,
        )
    except Exception as error:
        return failed(job, error, warnings, time.perf_counter() - begun)
    if job.pictured and job.here is None:
        from physgen.report.gallery import keep_pictures

        keep_pictures(folder, Path(job.out) / "index.html")
    return Done(job, folder, tuple(warnings), State.MADE, time.perf_counter() - begun)


def failed(
    job: Job,
    error: Exception,
    warnings: Sequence[Problem] = (),
    seconds: float = 0.0,
) -> Done:
    """A clip that came to nothing, and why."""
    problems = error.problems if isinstance(error, InputError) else [_failure(job, error)]
    full = isinstance(error, OSError) and error.errno in NO_ROOM
    return Done(job, None, (*warnings, *problems), seconds=seconds, full=full)


def hash_of(file: Path) -> str:
    """SHA-256, worked out once by this process. Raises OSError."""
    return _warm().hash(file)


_REFINERS: dict[Refiner, pipeline.Refiners] = {}
"""Of this process: models are loaded once, not for every clip."""


@cache
def _warm() -> pipeline.Warm:
    """Of this process: what one clip leaves at hand for the next."""
    return pipeline.Warm()


def _refiners(who: Refiner) -> pipeline.Refiners:
    if who not in _REFINERS:
        _REFINERS[who] = pipeline.Refiners(who.plan)
    return _REFINERS[who]


def _failure(job: Job, error: BaseException) -> Problem:
    """The machine's fault rather than the scene's, as one line."""
    if isinstance(error, OSError):
        where = f"{meant(str(error.filename))}: " if error.filename else ""
        return InputError.of(job.path, "", f"failed: {where}{error.strerror or error}", "").problems[0]
    if not isinstance(error, MemoryError | LostError):
        frames = traceback.extract_tb(error.__traceback__)[-1:]
        at = "".join(f" in {Path(frame.filename).name}:{frame.lineno}" for frame in frames)
        said = f"failed: {type(error).__name__}{at}: {error}"
        return InputError.of(job.path, "", said, "this is a fault of physgen's: please report it").problems[0]
    said = "ran out of memory" if isinstance(error, MemoryError) else f"failed: {error}"
    return InputError.of(job.path, "", said, "try fewer --jobs or a smaller scene").problems[0]


def ended(done: Done, out: Path, gallery: bool) -> None:
    """A clip that is there takes its earlier failure away; one that failed leaves a trace for the `gallery` of `out`.

    What cannot be written is not: the problems were told.
    """
    from physgen.report.page import failed_page

    job = done.job
    with suppress(InputError, OSError):
        name = job.folder.name
        if done.folder is not None:
            clear(out, name)
        elif gallery and (is_url(job.path) or Path(job.path).is_file()):  # no typo, and no pipe
            try:
                text = Path(job.path).read_text(encoding="utf-8")
            except (OSError, ValueError):
                text = ""
            page = failed_page(name, done.problems, job.command, text, job.path)
            leave(out, trace_of(name, job.path, job.variant, job.overrides, job.command, done.problems), page)


def run_all(
    jobs: Iterable[Job], workers: int, watch: Callable[[Job], pipeline.Progress]
) -> Generator[Done, None, None]:
    """Results in the order of the jobs, whatever finishes first; `watch` tells how far one is that runs alone.

    Jobs are pulled as they are begun. Whoever stops early must close the iterator, which ends the processes.
    """
    if workers <= 1:
        yield from (run(job, watch(job)) for job in jobs)
    else:
        yield from spread(run, jobs, workers, failed)
