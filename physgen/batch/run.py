"""Make clips: one job in this process, or many in several processes."""

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

from physgen import pipeline, report
from physgen.batch.outcomes import outcomes
from physgen.batch.resume import clip_mark, recorded_warnings, unchanged_clip
from physgen.batch.workers import LostError
from physgen.export.video_formats import NO_ROOM, Format
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
    """The model for refinement, as on the command line."""

    setting: str = ""
    """`NAME[:WEIGHTS]`."""
    # Replaces the user's own physgen.toml.
    config: Path | None = None

    def plan(self) -> Plan:
        """Return the plan with the configuration files. Raise InputError."""
        plan = load_plan(config=self.config)
        choice = plan.choices.get("refine")
        # The configuration file may have the weights of the same model.
        if not self.setting or (choice is not None and choice.name == self.setting):
            return plan
        return load_plan([f"refine={self.setting}"], config=self.config)

    def identity(self) -> str:
        """Return a text of the model and its settings. A new text means a new
        render.
        """
        try:
            plan = self.plan()
            choice = plan.choices.get("refine")
            if choice is None:
                model = None
            else:
                model = (choice.name, choice.weights, file_stamp(Path(choice.weights)))
            return repr((model, plan.device, plan.dtype, plan.options))
        except InputError as error:
            # The refinement of a clip reports this error.
            return str(error)


DEFAULT_OPTIONS = pipeline.RenderOptions()
DEFAULT_REFINER = Refiner()


@dataclass(frozen=True)
class Job:
    """A clip to make."""

    # Path, as the user wrote it.
    scene: str
    options: pipeline.RenderOptions = DEFAULT_OPTIONS
    out: str = "out"
    """The output folder."""
    refiner: Refiner = DEFAULT_REFINER
    # Objects with their own outcomes; None if outcomes are not needed.
    tracked_names: tuple[str, ...] | None = None
    pictures: bool = False
    """True if the process also makes the clip's pictures for the gallery of `out`."""
    video: Path | None = None
    """A second path for the video, beside the clip's folder."""

    @property
    def name(self) -> str:
        """Return the name of the clip's folder. Raise InputError for an unusable scene
        name.
        """
        return self.options.name or pipeline.output_name(
            self.scene, self.options.variant
        )

    @property
    def folder(self) -> Path:
        """Return the clip's folder. Raise InputError."""
        return Path(self.out) / self.name

    @property
    def mark(self) -> str:
        """Return a text for the options of the clip, the refining model and the
        code.
        """
        draw_seed = 0
        if self.options.draws:
            draw_seed = self.options.draw_seed
        # These options do not change the clip; the models count through their identity.
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
    """The result state of a job."""

    MADE = "made"
    UNCHANGED = "unchanged"
    """A complete clip of the same inputs and options exists."""
    FAILED = "failed"


@dataclass(frozen=True)
class JobResult:
    """The result of a job: a folder and warnings, or errors without a folder."""

    job: Job
    folder: Path | None
    problems: tuple[Problem, ...] = ()
    state: State = State.FAILED
    seconds: float = 0.0
    disk_full: bool = False
    can_write: bool = True
    """False if the output folder does not accept clips."""
    # The result of `batch.outcomes.outcomes`.
    outcomes: Mapping[str, Cell] | None = None


def run(job: Job, progress: pipeline.Progress = pipeline.silent) -> JobResult:
    """Make a clip in this process, unless it exists unchanged."""
    if job.video is None:
        result = _run(job, progress)
    else:
        result = _run_to_file(job, job.video, progress)
    if result.folder is None or job.tracked_names is None:
        return result
    try:
        trajectory = read_trajectory(result.folder / "trajectory.npz")
        return replace(result, outcomes=outcomes(trajectory, job.tracked_names))
    except (OSError, ValueError, KeyError) as error:
        # Another command replaces the folder.
        return report_failure(job, error, result.problems, result.seconds)


def _run_to_file(job: Job, video: Path, progress: pipeline.Progress) -> JobResult:
    """Make a clip, and copy its video to a file.

    Keep an existing file as `NAME~` unless an earlier run of this clip wrote it.
    """
    name = Format(video.suffix.lower().removeprefix(".")).file
    # Read the old manifest now, since the run replaces it.
    earlier = read_manifest(job.folder).get("files", {}).get(name)
    source = job.folder / name
    # The stamp shows whether the run wrote the video, even if it failed later.
    stamp = file_stamp(source)
    result = _run(job, progress)
    is_new = source.is_file() and file_stamp(source) != stamp
    if result.folder is None and not is_new:
        return result
    # Without a folder but with a new file, only another format failed.
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
    """Return the warning about a renamed file."""
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
            # A moved scene has the same hashes, but the manifest would name its old
            # place.
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
        report.gallery.keep_pictures(folder, Path(job.out) / "index.html")
    return JobResult(
        job, folder, tuple(warnings), State.MADE, time.perf_counter() - start_time
    )


@cache
def _stages() -> pipeline.Stages:
    """Return the stages of this process, with results from earlier clips."""
    return pipeline.Stages(reads_assets_cache=True)


@cache
def _refiners(refiner: Refiner) -> pipeline.Refiners:
    """Return the models for refinement. A process loads each once."""
    return pipeline.Refiners(refiner.plan)


def report_failure(
    job: Job, error: Exception, warnings: Sequence[Problem] = (), seconds: float = 0.0
) -> JobResult:
    """Return the result of a job after an exception."""
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
    """Return the failure of a clip and the fix, for an error outside the user's
    input.
    """
    if isinstance(error, OSError):
        file_text = ""
        if error.filename:
            file_text = f"{final_name(str(error.filename))}: "
        return f"failed: {file_text}{error.strerror or error}", ""

    if isinstance(error, MemoryError | LostError):
        if isinstance(error, MemoryError):
            reason = "ran out of memory"
        else:
            reason = f"failed: {error}"
        return reason, "try fewer --jobs or a smaller scene"
    # The last frame of a traceback is the line of the fault.
    frames = traceback.extract_tb(error.__traceback__)[-1:]
    line_text = "".join(
        f" in {Path(frame.filename).name}:{frame.lineno}" for frame in frames
    )
    return (
        f"failed: {type(error).__name__}{line_text}: {error}",
        "this is a fault of physgen's: please report it",
    )


def record_failure(result: JobResult, out: Path, gallery: bool) -> None:
    """Write the record of a failure for the gallery of `out`, or remove the record of
    an earlier one after success.

    Ignore errors of the record, because the problems were printed.
    """
    job = result.job
    with suppress(InputError, OSError):
        if result.folder is not None:
            remove_failure(out, job.name)
        # A typo or a pipe would leave a record without a scene.
        elif gallery and Path(job.scene).is_file():
            options = job.options
            clip_inputs = job.scene, options.variant, options.overrides, options.command
            write_failure(out, job.name, *clip_inputs, result.problems)
