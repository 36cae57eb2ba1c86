"""Make clips: run one job here, or many in several processes."""

from __future__ import annotations

import time
import traceback
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from enum import Enum
from functools import cache
from hashlib import sha256
from pathlib import Path

from physgen import pipeline
from physgen.batch.outcomes import outcomes
from physgen.batch.resume import clip_mark, recorded_warnings, unchanged_clip
from physgen.export.video import NO_ROOM, Format
from physgen.files import file_stamp, final_name, write_atomic, write_with_backup
from physgen.messages import Message
from physgen.problems import InputError, OutputError, Place, Problem
from physgen.registry import Plan, load_plan
from physgen.report.clips import remove_failure, write_failure
from physgen.report.folders import read_manifest
from physgen.report.record import source_of
from physgen.simulate.trajectory import read_trajectory
from physgen.tables import Cell


@dataclass(frozen=True)
class Refiner:
    """Which model refines frames, as the command line names it."""

    setting: str = ""
    """`NAME[:WEIGHTS]`."""
    config: Path | None = None  # in place of the user's own physgen.toml

    def plan(self) -> Plan:
        """Return the plan with the configuration files. Raise InputError."""
        plan = load_plan(config=self.config)
        choice = plan.choices.get("refine")
        if not self.setting or (
            choice is not None and choice.name == self.setting
        ):  # the file has its weights
            return plan
        return load_plan([f"refine={self.setting}"], config=self.config)

    def identity(self) -> str:
        """Return a text that changes when clips have to be made again."""
        try:
            plan = self.plan()
            choice = plan.choices.get("refine")
            model = (
                None
                if choice is None
                else (choice.name, choice.weights, file_stamp(Path(choice.weights)))
            )
            return repr((model, plan.device, plan.dtype, plan.options))
        except InputError as error:  # reported where a clip is refined
            return str(error)


DEFAULT_OPTIONS = pipeline.RenderOptions()
DEFAULT_REFINER = Refiner()


@dataclass(frozen=True)
class Job:
    """One clip to make."""

    scene: str  # its path, as the user names it
    options: pipeline.RenderOptions = DEFAULT_OPTIONS
    out: str = "out"
    """The folder of results."""
    refiner: Refiner = DEFAULT_REFINER
    tracked: tuple[str, ...] | None = (
        None  # objects with outcomes of their own; None: no outcomes are needed
    )
    pictures: bool = False
    """Whether the process that makes the clip also makes its pictures for the gallery of `out`."""
    video: Path | None = None
    """File that the video is copied to, beside the clip's folder."""

    @property
    def name(self) -> str:
        """Return the name of the clip's folder. Raise InputError if the scene's name cannot be one."""
        return self.options.name or pipeline.output_name(
            self.scene, self.options.variant
        )

    @property
    def folder(self) -> Path:
        """Return the clip's folder. Raise InputError."""
        return Path(self.out) / self.name

    @property
    def mark(self) -> str:
        """Return a text that identifies the options of the clip, the refining model and the code."""
        draw_seed = self.options.draw_seed if self.options.draws else 0
        options = replace(
            self.options,
            command=(),
            models=(),
            cached=True,
            allow_outside=False,
            draw_seed=draw_seed,
        )
        return self.options.mark or clip_mark(options, self.refiner.identity())


class State(Enum):
    """How a job ended."""

    MADE = "made"
    UNCHANGED = "unchanged"
    """A complete clip of the same inputs and options was there."""
    FAILED = "failed"


@dataclass(frozen=True)
class JobResult:
    """Result of a job: a folder and warnings, or errors and no folder."""

    job: Job
    folder: Path | None
    problems: tuple[Problem, ...] = ()
    state: State = State.FAILED
    seconds: float = 0.0
    disk_full: bool = False
    can_write: bool = True
    """False if no clip can be written into the output folder."""
    outcomes: Mapping[str, Cell] | None = None  # see `batch.outcomes.outcomes`


def run(job: Job, progress: pipeline.Progress = pipeline.silent) -> JobResult:
    """Makes one clip in this process, unless it exists unchanged."""
    if job.video is None:
        result = _run(job, progress)
    else:
        result = _run_to_file(job, job.video, progress)
    if result.folder is None or job.tracked is None:
        return result
    try:
        trajectory = read_trajectory(result.folder / "trajectory.npz")
        return replace(result, outcomes=outcomes(trajectory, job.tracked))
    except (OSError, ValueError, KeyError) as error:  # another command replaces it
        return report_failure(job, error, result.problems, result.seconds)


def _run_to_file(job: Job, video: Path, progress: pipeline.Progress) -> JobResult:
    """Make one clip, and copy its video to a file.

    A file there is kept as `NAME~` unless an earlier run of this clip wrote it.
    """
    name = Format(video.suffix.lower().removeprefix(".")).file
    earlier = read_manifest(job.folder).get("files", {}).get(name)
    source = job.folder / name
    stamp = file_stamp(source)
    result = _run(job, progress)
    is_new = source.is_file() and file_stamp(source) != stamp
    if result.folder is None and not is_new:
        return result
    # without a folder but with a new file, only another format failed
    backups: list[Path] = []
    try:
        data = source.read_bytes()
        if video.is_file() and sha256(video.read_bytes()).hexdigest() == earlier:
            write_atomic(video, data)
        else:
            write_with_backup(video, data, backups.append)
    except OSError as error:
        return report_failure(job, error, result.problems, result.seconds)
    warnings = [_backup_warning(video, path) for path in backups]
    return replace(result, problems=(*result.problems, *warnings))


def _backup_warning(path: Path, backup: Path) -> Problem:
    """Return the warning that a file at `path` was renamed."""
    previous = Message.FILE_KEPT
    return previous.warning(
        Place(str(path)), "", "the previous file", backup=backup.name
    )


def _run(job: Job, progress: pipeline.Progress) -> JobResult:
    start_time = time.perf_counter()
    warnings: list[Problem] = []
    try:
        options = replace(job.options, name=job.name, mark=job.mark)
        if options.cached:
            manifest = unchanged_clip(
                job.folder, job.mark, Path(job.scene), _stages().hash
            )
            if manifest and manifest["source"] == source_of(
                Path(job.scene), job.folder
            ):
                return JobResult(
                    job, job.folder, tuple(recorded_warnings(manifest)), State.UNCHANGED
                )
        folder = pipeline.render_scene(
            job.scene,
            job.out,
            options,
            refiners=_refiners(job.refiner),
            stages=_stages(),
            progress=progress,
            warn=warnings.append,
        )
    except Exception as error:
        return report_failure(job, error, warnings, time.perf_counter() - start_time)
    if job.pictures:
        from physgen.report.gallery import keep_pictures

        keep_pictures(folder, Path(job.out) / "index.html")
    return JobResult(
        job, folder, tuple(warnings), State.MADE, time.perf_counter() - start_time
    )


@cache
def _stages() -> pipeline.Stages:
    """Return the stages that this process keeps from one clip for the next."""
    return pipeline.Stages(reads_assets_cache=True)


@cache
def _refiners(refiner: Refiner) -> pipeline.Refiners:
    """Return the models for refinement, which a process loads once."""
    return pipeline.Refiners(refiner.plan)


def report_failure(
    job: Job, error: Exception, warnings: Sequence[Problem] = (), seconds: float = 0.0
) -> JobResult:
    """Return the result of a job that raised `error`."""
    if isinstance(error, InputError):
        problems: Sequence[Problem] = list(error.problems)
    else:
        failure, fix = describe_failure(error)
        message = Message.JOB_FAILED
        problems = [message.problem(Place(job.scene), failure=failure, fix=fix)]
    disk_full = isinstance(error, OSError) and error.errno in NO_ROOM
    can_write = not isinstance(error, OutputError)
    return JobResult(
        job,
        None,
        (*warnings, *problems),
        seconds=seconds,
        disk_full=disk_full,
        can_write=can_write,
    )


def describe_failure(error: Exception) -> tuple[str, str]:
    """Return the failure of a clip that its input did not cause, and the fix."""
    if isinstance(error, OSError):
        file_text = f"{final_name(str(error.filename))}: " if error.filename else ""
        return f"failed: {file_text}{error.strerror or error}", ""
    from physgen.batch.workers import LostError

    if isinstance(error, MemoryError | LostError):
        reason = (
            "ran out of memory"
            if isinstance(error, MemoryError)
            else f"failed: {error}"
        )
        return reason, "try fewer --jobs or a smaller scene"
    frames = traceback.extract_tb(error.__traceback__)[-1:]
    line_text = "".join(
        f" in {Path(frame.filename).name}:{frame.lineno}" for frame in frames
    )
    return (
        f"failed: {type(error).__name__}{line_text}: {error}",
        "this is a fault of physgen's: please report it",
    )


def record_failure(done: JobResult, out: Path, gallery: bool) -> None:
    """Removes the record of an earlier failure, or writes that of this one for the `gallery` of `out`.

    A record that cannot be written is left out: the problems were printed.
    """
    job = done.job
    with suppress(InputError, OSError):
        if done.folder is not None:
            remove_failure(out, job.name)
        elif gallery and Path(job.scene).is_file():  # neither a typo nor a pipe
            options = job.options
            clip_inputs = job.scene, options.variant, options.overrides, options.command
            write_failure(out, job.name, *clip_inputs, done.problems)
