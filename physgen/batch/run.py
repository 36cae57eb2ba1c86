"""Make clips: run one job here, or many in several processes; scenes and folders may be remote."""

from __future__ import annotations

import json
import os
import time
import traceback
from collections.abc import Callable, Generator, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from enum import Enum
from functools import cache
from pathlib import Path
from typing import Any

from physgen import pipeline
from physgen.batch.outcomes import outcomes
from physgen.batch.remote import RemoteFolder, is_url, open_folder, url_below
from physgen.batch.remote_scene import fetch_scene
from physgen.batch.resume import clip_mark, recorded_warnings, unchanged_clip, unchanged_inputs
from physgen.batch.workers import LostError, run_parallel
from physgen.export.video import NO_ROOM
from physgen.files import file_stamp, final_name
from physgen.problems import InputError, Problem
from physgen.registry import Plan, load_plan
from physgen.report.clips import failure_of, remove_failure, write_failure
from physgen.report.folders import temporary_folder
from physgen.report.record import source_of
from physgen.simulate.trajectory import read_trajectory
from physgen.tables import Cell

MANIFEST = "manifest.json"
SENDING = ".sending.json"
"""Names of a remote clip's files while it is replaced: what a killed run left is known by it."""
MAX_FETCHED_BYTES = 200_000_000
"""Of a manifest or a trajectory."""


@dataclass(frozen=True)
class Refiner:
    """Which model refines frames, as the command line names it."""

    setting: str = ""
    """`NAME[:WEIGHTS]`."""
    config: Path | None = None
    """In place of the files physgen.toml."""
    device: str | None = None

    def plan(self) -> Plan:
        """With the configuration files. Raises InputError."""
        plan = load_plan(config=self.config, device=self.device)
        choice = plan.choices.get("refine")
        if not self.setting or (
            choice is not None and choice.name == self.setting
        ):  # the file has its weights
            return plan
        return load_plan([f"refine={self.setting}"], config=self.config, device=self.device)

    def identity(self) -> str:
        """Changes where clips have to be made again."""
        try:
            plan = self.plan()
            choice = plan.choices.get("refine")
            model = (
                None if choice is None else (choice.name, choice.weights, file_stamp(Path(choice.weights)))
            )
            return repr((model, plan.device, plan.dtype, plan.options))
        except InputError as error:  # reported where a clip is refined
            return str(error)


DEFAULT_OPTIONS = pipeline.RenderOptions()
DEFAULT_REFINER = Refiner()


@dataclass(frozen=True)
class Job:
    """One clip to make."""

    scene: str
    """As the user names it: a path or a URL; of a local copy, its path."""
    options: pipeline.RenderOptions = DEFAULT_OPTIONS
    out: str = "out"
    """The folder of results, likewise."""
    refiner: Refiner = DEFAULT_REFINER
    tracked: tuple[str, ...] | None = None
    """Objects with outcomes of their own; None: no outcomes are needed."""
    pictures: bool = False
    """Whether the process that makes the clip also makes its pictures for the gallery of `out`."""

    @property
    def name(self) -> str:
        """Of the clip's folder. Raises InputError where the scene's name cannot be one."""
        return self.options.name or pipeline.output_name(self.scene, self.options.variant)

    @property
    def folder(self) -> Path:
        """The clip's; of a remote one, only its name is meaningful. Raises InputError."""
        return Path(self.out) / self.name

    @property
    def shown(self) -> str:
        """The scene as messages name it."""
        return self.options.origin.path if self.options.origin else self.scene

    @property
    def is_remote(self) -> bool:
        """Whether the scene has to be fetched, or the clip to be sent."""
        return is_url(self.scene) or is_url(self.out)

    @property
    def mark(self) -> str:
        """Identifies all options of the clip, the refining model, and the code."""
        device = pipeline.drawn_by(self.options.device)
        draw_seed = self.options.draw_seed if self.options.draws else 0
        options = replace(
            self.options, command=(), cached=True, device=device, allow_outside=False, draw_seed=draw_seed
        )
        return self.options.mark or clip_mark(options, self.refiner.identity())

    def with_local(self, scene: str, out: str) -> Job:
        """The job for a process that reads the scene from `scene` and makes the clip in `out`."""
        if is_url(self.scene):
            origin = pipeline.SceneOrigin(self.scene, self.scene)
        elif is_url(self.out):
            origin = pipeline.SceneOrigin(str(Path(self.scene)), os.path.abspath(self.scene))
        else:
            origin = pipeline.SceneOrigin(str(Path(self.scene)), source_of(Path(self.scene), self.folder))
        options = replace(self.options, name=self.name, mark=self.mark, origin=self.options.origin or origin)
        return replace(self, scene=scene, out=out, options=options, pictures=False)


class State(Enum):
    """How a job ended."""

    MADE = "made"
    UNCHANGED = "unchanged"
    """A complete clip of the same inputs and options was there."""
    FAILED = "failed"


@dataclass(frozen=True)
class Done:
    """Result of a job: a folder and warnings, or errors and no folder."""

    job: Job
    folder: Path | None
    problems: tuple[Problem, ...] = ()
    state: State = State.FAILED
    seconds: float = 0.0
    disk_full: bool = False
    outcomes: Mapping[str, Cell] | None = None
    """See `batch.outcomes.outcomes`."""

    @property
    def where(self) -> str | None:
        """The clip's folder as the user knows it."""
        if self.folder is None:
            return None
        return url_below(self.job.out, self.folder.name) if is_url(self.job.out) else str(self.folder)


def run_all(
    jobs: Iterable[Job], workers: int, watch: Callable[[Job], pipeline.Progress]
) -> Generator[Done, None, None]:
    """Results in the order of the jobs, which are pulled as needed; `watch` shows the progress of one that runs here.

    A caller that stops early must close the generator, which ends the processes.
    """
    if workers <= 1:
        yield from (run(job, watch(job)) for job in jobs)
    else:
        yield from run_parallel(run, jobs, workers, failed)


def run(job: Job, progress: pipeline.Progress = pipeline.silent) -> Done:
    """Makes one clip in this process, unless it exists unchanged."""
    done = run_remote(job, progress) if job.is_remote else _run_local(job, progress)
    if done.folder is None or done.outcomes is not None:
        return done
    return with_outcomes(done, done.folder / "trajectory.npz")


def _run_local(job: Job, progress: pipeline.Progress) -> Done:
    begun = time.perf_counter()
    warnings: list[Problem] = []
    try:
        options = replace(job.options, name=job.name, mark=job.mark)
        if options.cached:
            manifest = unchanged_clip(job.folder, job.mark, pipeline.scene_file(job.scene), hash_of)
            is_copy = options.origin is not None
            if manifest and (is_copy or manifest["source"] == source_of(Path(job.scene), job.folder)):
                return Done(job, job.folder, tuple(recorded_warnings(manifest)), State.UNCHANGED)
        folder = pipeline.render_scene(
            job.scene,
            job.out,
            options,
            refiners=_refiners(job.refiner),
            stages=_warm(),
            progress=progress,
            warn=warnings.append,
        )
    except Exception as error:
        return failed(job, error, warnings, time.perf_counter() - begun)
    if job.pictures:
        from physgen.report.gallery import keep_pictures

        keep_pictures(folder, Path(job.out) / "index.html")
    return Done(job, folder, tuple(warnings), State.MADE, time.perf_counter() - begun)


@cache
def _warm() -> pipeline.Stages:
    """What this process keeps from one clip for the next."""
    return pipeline.Stages()


@cache
def _refiners(refiner: Refiner) -> pipeline.Refiners:
    """Models are loaded once per process."""
    return pipeline.Refiners(refiner.plan)


def hash_of(file: Path) -> str:
    """SHA-256, computed once by this process. Raises OSError."""
    return _warm().hash(file)


def with_outcomes(done: Done, trajectory: Path) -> Done:
    """With the outcomes that the job asks for, if any."""
    if done.job.tracked is None:
        return done
    try:
        return replace(done, outcomes=outcomes(read_trajectory(trajectory), done.job.tracked))
    except (OSError, ValueError, KeyError) as error:  # another command replaces it
        return failed(done.job, error, done.problems, done.seconds)


def failed(job: Job, error: Exception, warnings: Sequence[Problem] = (), seconds: float = 0.0) -> Done:
    """The result of a job that raised `error`."""
    if isinstance(error, InputError):
        problems: Sequence[Problem] = list(error.problems)
    else:
        found, fix = _describe_failure(error)
        problems = list(InputError.of(job.shown, "", found, fix).problems)
    disk_full = isinstance(error, OSError) and error.errno in NO_ROOM
    return Done(job, None, (*warnings, *problems), seconds=seconds, disk_full=disk_full)


def _describe_failure(error: Exception) -> tuple[str, str]:
    """What failed other than the input, and the fix."""
    if isinstance(error, OSError):
        where = f"{final_name(str(error.filename))}: " if error.filename else ""
        return f"failed: {where}{error.strerror or error}", ""
    if isinstance(error, MemoryError | LostError):
        found = "ran out of memory" if isinstance(error, MemoryError) else f"failed: {error}"
        return found, "try fewer --jobs or a smaller scene"
    frames = traceback.extract_tb(error.__traceback__)[-1:]
    at = "".join(f" in {Path(frame.filename).name}:{frame.lineno}" for frame in frames)
    return f"failed: {type(error).__name__}{at}: {error}", "this is a fault of physgen's: please report it"


def record_failure(done: Done, out: Path, gallery: bool) -> None:
    """Removes the record of an earlier failure, or writes that of this one for the `gallery` of `out`.

    A record that cannot be written is left out: the problems were printed.
    """
    from physgen.report.page import failed_page

    job = done.job
    with suppress(InputError, OSError):
        if done.folder is not None:
            remove_failure(out, job.name)
        elif gallery and (is_url(job.scene) or Path(job.scene).is_file()):  # neither a typo nor a pipe
            try:
                text = Path(job.scene).read_text(encoding="utf-8")
            except (OSError, ValueError):
                text = ""
            options = job.options
            page = failed_page(job.name, done.problems, options.command, text, job.scene)
            write_failure(
                out,
                failure_of(
                    job.name, job.scene, options.variant, options.overrides, options.command, done.problems
                ),
                page,
            )


# Remote clips: an object store has no rename, so a clip's manifest is removed before its files change and written
# after the last of them. A clip without manifest does not exist.


def run_remote(job: Job, progress: pipeline.Progress = pipeline.silent) -> Done:
    """Makes one clip, unless it exists, from a copy of its scene."""
    try:
        scene = local_copy(job.scene, job.options.overrides)
        if not is_url(job.out):
            return with_user_names(run(job.with_local(scene, job.out), progress), job)
        remote = open_folder(job.out).below(job.name)
        if unchanged := unchanged_remote(job, remote, scene):
            return unchanged
        with temporary_folder() as out:
            done = with_user_names(run(job.with_local(scene, str(out)), progress), job, str(out))
            send_clip(out / job.name, remote, done)
            return done
    except (InputError, OSError) as error:
        return failed(job, error)


def local_copy(path: str, overrides: Sequence[str] = ()) -> str:
    """A path where a scene can be read: its own, or that of a fetched copy. Raises InputError or OSError."""
    return str(fetch_scene(path, overrides)) if is_url(path) else path


def with_user_names(done: Done, job: Job, out: str = "") -> Done:
    """The result of a local copy of `job`, which was made in the folder `out`, in terms of the job."""

    def renamed(text: str) -> str:
        return text.replace(out, job.out) if out else text

    problems = tuple(
        replace(p, place=p.place._replace(file=renamed(p.place.file)), expected=renamed(p.expected))
        for p in done.problems
    )
    folder = None if done.folder is None else job.folder
    return replace(done, job=job, folder=folder, problems=problems)


def unchanged_remote(job: Job, remote: RemoteFolder, scene: str) -> Done | None:
    """The result for a remote clip that exists unchanged. Raises OSError where it cannot be reached.

    Its files are compared by size, which is known without reading them.
    """
    manifest = _read_manifest(remote)
    if not job.options.cached or manifest is None:
        return None
    try:
        if not unchanged_inputs(manifest, job.mark, pipeline.scene_file(scene), hash_of):
            return None
        expected: Mapping[str, int] = manifest["sizes"]
        files = remote.files()
        sizes = {name: files[name] for name in files.keys() & expected.keys()}
        if expected.keys() != manifest["files"].keys() or sizes != expected:
            return None
        done = Done(job, job.folder, tuple(recorded_warnings(manifest)), State.UNCHANGED)
    except (ValueError, KeyError, TypeError, AttributeError):
        return None
    except OSError as error:
        if error.filename is not None and is_url(str(error.filename)):
            raise
        return None  # an input that is gone
    if job.tracked is None:
        return done
    with temporary_folder() as folder:
        file = folder / "trajectory.npz"
        remote.fetch(file.name, file, MAX_FETCHED_BYTES)
        return with_outcomes(done, file)


def _read_manifest(remote: RemoteFolder, name: str = MANIFEST) -> dict[str, Any] | None:
    try:
        manifest = json.loads(remote.read(name, MAX_FETCHED_BYTES) or b"")
        return manifest if isinstance(manifest, dict) else None
    except ValueError:
        return None


def is_refined(manifest: Mapping[str, Any] | None) -> bool:
    """Whether a manifest is of a refined clip, which may have taken hours."""
    return bool(manifest and manifest.get("refine") and manifest.get("frames"))


def send_clip(folder: Path, remote: RemoteFolder, done: Done) -> None:
    """Replaces a remote clip by a local one, if there is one; a failed one does not replace a refined clip.

    Raises InputError where physgen did not write what is there, and OSError where it cannot be written.
    """
    old_manifest = _read_manifest(remote)
    if not folder.is_dir() or (done.folder is None and is_refined(old_manifest)):
        return
    files = {path.relative_to(folder).as_posix(): path for path in folder.rglob("*") if path.is_file()}
    manifest = files.pop(MANIFEST)
    old = remote.files()
    interrupted = _read_manifest(remote, SENDING) or {}
    ours = {MANIFEST, SENDING, *(old_manifest or {}).get("files", ()), *interrupted.get("sending", ())}
    if strange := sorted(old.keys() - ours):
        found = ", ".join(strange[:3]) + (", ..." if len(strange) > 3 else "")
        expected = f"would be replaced, and holds {found}, which physgen did not make"
        raise InputError.of(remote.url, "", expected, "move it out, or choose another folder with -o")
    names = sorted({*files, *(old.keys() - {MANIFEST, SENDING})})
    remote.write(SENDING, json.dumps({"sending": names}).encode())
    remote.remove([MANIFEST] if MANIFEST in old else [])
    remote.send(files)
    remote.remove([name for name in old if name not in (*files, MANIFEST, SENDING)])
    remote.write(MANIFEST, manifest.read_bytes())
    remote.remove([SENDING])
