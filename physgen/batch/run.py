"""Make clips: run one job here, or many in several processes; scenes and folders may be remote."""

from __future__ import annotations

import json
import os
import tempfile
import time
import traceback
from collections.abc import Callable, Generator, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field, replace
from enum import Enum
from functools import cache
from pathlib import Path
from shutil import rmtree
from typing import Any
from uuid import uuid4

from physgen import pipeline
from physgen.batch.outcomes import outcomes
from physgen.batch.remote import RemoteFolder, is_url, open_folder, url_below
from physgen.batch.remote_scene import fetch_scene
from physgen.batch.resume import finished, made_of_the_same, mark
from physgen.batch.resume import warnings as warned
from physgen.batch.workers import LostError, run_parallel
from physgen.export.video import NO_ROOM, Format
from physgen.files import file_stamp, final_name, partial
from physgen.problems import InputError, Problem
from physgen.registry import Plan, load_plan
from physgen.report.clips import failure_of, remove_failure, write_failure
from physgen.report.folders import lock_folder, remove_leftovers_once
from physgen.report.record import source_of
from physgen.simulate.trajectory import read_trajectory
from physgen.tables import Cell

# ----------------------------------------------------------------------
# What a command says of the model that refines -> the plan that it and the files make, in any process.


@dataclass(frozen=True)
class Refiner:
    """Whose weights refine, and on what, as the command said it."""

    setting: str = ""
    """`NAME[:WEIGHTS]`."""
    config: Path | None = None
    """In place of the files physgen.toml."""
    device: str | None = None
    planned: Plan | tuple[Problem, ...] | None = field(default=None, compare=False, repr=False)
    """What the files said to the command, or what is wrong with them, for a process that does not read them."""
    said: str = ""
    """The same as text, by which processes know it."""

    def plan(self) -> Plan:
        """With what the files say. Raises InputError."""
        if isinstance(self.planned, Plan):
            return self.planned
        if self.planned is not None:
            raise InputError(self.planned)
        told = load_plan(config=self.config, device=self.device)
        said = told.choices.get("refine")
        if not self.setting or (
            said is not None and said.name == self.setting
        ):  # a bare name: the file has its weights
            return told
        return load_plan([f"refine={self.setting}"], config=self.config, device=self.device)

    def settled(self) -> Refiner:
        """The same where files say something else, or nothing; worked out once a process."""
        return _settled(self)

    @property
    def told(self) -> str:
        """Who would refine, as text: where it changes, clips are made again."""
        try:
            told = self.plan()
            who = told.choices.get("refine")
            chosen = None if who is None else (who.name, who.weights, file_stamp(Path(who.weights)))
            return repr((chosen, told.device, told.dtype, told.options))
        except InputError as error:  # told of where a clip is to be refined
            return str(error)


NOBODY = Refiner()
"""A command that says nothing of it."""


@cache
def _settled(who: Refiner) -> Refiner:
    try:
        planned: Plan | tuple[Problem, ...] = who.plan()
    except InputError as error:
        planned = tuple(error.problems)
    return replace(who, planned=planned, said=repr(planned))


# ----------------------------------------------------------------------
# Scene files -> output folders, several at a time in processes; a failed one does not stop the others.


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
    known: pipeline.SceneOrigin


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
        return run_remote(job, progress)
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
        where = f"{final_name(str(error.filename))}: " if error.filename else ""
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
            remove_failure(out, name)
        elif gallery and (is_url(job.path) or Path(job.path).is_file()):  # no typo, and no pipe
            try:
                text = Path(job.path).read_text(encoding="utf-8")
            except (OSError, ValueError):
                text = ""
            page = failed_page(name, done.problems, job.command, text, job.path)
            write_failure(
                out, failure_of(name, job.path, job.variant, job.overrides, job.command, done.problems), page
            )


def run_all(
    jobs: Iterable[Job], workers: int, watch: Callable[[Job], pipeline.Progress]
) -> Generator[Done, None, None]:
    """Results in the order of the jobs, whatever finishes first; `watch` tells how far one is that runs alone.

    Jobs are pulled as they are begun. Whoever stops early must close the iterator, which ends the processes.
    """
    if workers <= 1:
        yield from (run(job, watch(job)) for job in jobs)
    else:
        yield from run_parallel(run, jobs, workers, failed)


# ----------------------------------------------------------------------
# A job whose scene or folder is a URL -> the clip there: the scene fetched, the clip made here, and sent
# whole.
#
# An object store knows no rename: a clip's manifest goes away before its files change and comes back after
# the last of
# them, so that a clip without manifest is not there. While files change, `.sending.json` names them, so that
# what a
# killed run left is known for ours.

MANIFEST, SENDING = "manifest.json", ".sending.json"
MOST_MANIFEST = 200_000_000
"""Bytes."""


def run_remote(job: Job, progress: pipeline.Progress = pipeline.silent, scene: str | None = None) -> Done:
    """One clip, unless it is there; of a copy of its `scene`, where there is one already."""
    try:
        scene = scene or local_copy(job.path, job.overrides, job.variant)
        if not is_url(job.out):
            return as_known(run(at_hand(job, scene, job.out), progress), job)
        there = open_folder(job.out).below(job.called)
        if job.cached and (told := finished_there(there, job.mark, scene)) is not None:
            return unchanged_there(job, there, told)
        with own_folder() as out:
            done = as_known(run(at_hand(job, scene, str(out)), progress), job)
            made = out / job.called
            if made.is_dir() and not (done.folder is None and is_refined(there)):
                send(made, there)
            return done
    except (InputError, OSError) as error:
        return failed(job, error)


def unchanged_there(job: Job, there: RemoteFolder, told: Mapping[str, Any]) -> Done:
    """A clip that is there, as its manifest tells, with its outcomes if they are asked for."""
    done = Done(job, job.folder, tuple(warned(told)), State.UNCHANGED)
    if job.tracked is None:
        return done
    with own_folder() as folder:
        file = folder / "trajectory.npz"
        there.fetch(file.name, file, MOST_MANIFEST)
        return with_outcomes(done, file)


def local_copy(path: str, overrides: Sequence[str] = (), variant: str | None = None) -> str:
    """A path under which a scene can be read: its own, or that of a copy. Raises InputError or OSError."""
    return str(fetch_scene(path, overrides, variant)) if is_url(path) else path


def at_hand(job: Job, scene: str, out: str) -> Job:
    """The job for a process that has the scene as `scene` and makes the clip in `out`."""
    shown = job.path if is_url(job.path) else str(Path(job.path))
    known = job.here.known if job.here else pipeline.SceneOrigin(shown, _source(job))
    return replace(job, here=Here(scene, out, job.called, job.mark, known))


def _source(job: Job) -> str:
    """Relative to the clip's folder, as in any manifest, unless one of both is a URL."""
    if is_url(job.path):
        return job.path
    return os.path.abspath(job.path) if is_url(job.out) else source_of(Path(job.path), job.folder)


def as_known(done: Done, job: Job) -> Done:
    """What became of the job at hand, told of the job as the user has it."""
    out = done.job.here.out if done.job.here else ""

    def said(text: str) -> str:
        return text.replace(out, job.out) if out else text

    problems = tuple(
        replace(at, place=at.place._replace(file=said(at.place.file)), expected=said(at.expected))
        for at in done.problems
    )
    folder = None if done.folder is None else job.folder
    return replace(done, job=job, folder=folder, problems=problems)


def finished_there(there: RemoteFolder, mark: str, scene: str) -> Mapping[str, Any] | None:
    """As `finished.finished`, of a distant clip: its files count by sizes, which are known without reading them."""
    data = there.read(MANIFEST, MOST_MANIFEST)
    if data is None:
        return None
    try:
        told = made_of_the_same(data, mark, pipeline.scene_file(scene), hash_of)
        if told is None:
            return None
        expected: Mapping[str, int] = told["sizes"]
        files = there.files()
        sizes = {name: files[name].size for name in files.keys() & expected.keys()}
        whole = expected.keys() == told["files"].keys() and SENDING not in files
        return told if whole and sizes == expected else None
    except (ValueError, KeyError, TypeError, AttributeError):
        return None
    except OSError as error:
        if error.filename is not None and is_url(str(error.filename)):
            raise
        return None  # an input that is gone


def is_refined(there: RemoteFolder) -> bool:
    """Whether an earlier run left a refined clip there: hours of work may be in it."""
    try:
        told = json.loads(there.read(MANIFEST, MOST_MANIFEST) or b"")
        return bool(told["refine"] and told["frames"])
    except (ValueError, KeyError, TypeError):
        return False


def send(folder: Path, there: RemoteFolder) -> None:
    """A clip's folder, whole. Raises InputError where something else is there, OSError where it cannot be written."""
    files = {path.relative_to(folder).as_posix(): path for path in folder.rglob("*") if path.is_file()}
    manifest = files.pop(MANIFEST)
    old = there.files()
    ours = {MANIFEST, SENDING, *_named(there, MANIFEST, "files"), *_named(there, SENDING, "sending")}
    if strange := sorted(old.keys() - ours):
        found = ", ".join(strange[:3]) + (", ..." if len(strange) > 3 else "")
        expected = f"would be replaced, and holds {found}, which physgen did not make"
        raise InputError.of(there.url, "", expected, "move it out, or choose another folder with -o")
    names = sorted({*files, *(old.keys() - {MANIFEST, SENDING})})
    there.write(SENDING, json.dumps({"sending": names}).encode())
    there.remove([name for name in (MANIFEST,) if name in old])
    there.send(files)
    there.remove([name for name in old if name not in (*files, MANIFEST, SENDING)])
    there.write(MANIFEST, manifest.read_bytes())
    there.remove([SENDING])


def _named(there: RemoteFolder, file: str, key: str) -> set[str]:
    """Files that a manifest, or the list of a run that was killed, names; none where there is none."""
    try:
        told = json.loads(there.read(file, MOST_MANIFEST) or b"")
        return {str(name) for name in told[key]}
    except (ValueError, KeyError, TypeError):
        return set()


@contextmanager
def own_folder() -> Iterator[Path]:
    """A folder for this process alone, which is gone when the block ends; what killed ones left is gone, too."""
    home = Path(tempfile.gettempdir(), f"physgen-{os.getuid()}")
    home.mkdir(mode=0o700, exist_ok=True)
    if home.stat().st_uid != os.getuid() or home.is_symlink():  # somebody was here first
        with tempfile.TemporaryDirectory(prefix="physgen-") as folder:
            yield Path(folder)
        return
    remove_leftovers_once(home)
    beside = partial(home / uuid4().hex)
    beside.mkdir()
    with lock_folder(beside):
        try:
            yield beside
        finally:
            rmtree(beside, ignore_errors=True)
