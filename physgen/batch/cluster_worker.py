"""What runs on a Dask worker: receive a job, make its clip in a child process, return the result.

Clips are made in child processes, so that a clip that kills its process leaves the worker alive, a worker of several
threads makes several clips at a time, and a cancelled clip is ended at once. Tasks and answers pass as bytes: a worker
with another version of physgen must not unpickle them before the versions are compared.

A worker that sees the user's folders makes the clip in place. One that does not is sent the scene, or returns the
files of the clip.
"""

from __future__ import annotations

import os
import pickle
import threading
import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from physgen.batch.remote import is_url
from physgen.batch.resume import CODE
from physgen.batch.run import Done, Job, failed, local_copy, own_folder, run, run_remote
from physgen.batch.workers import Child, LostError, end_children
from physgen.files import Stamp, file_stamp, write_atomic
from physgen.pipeline.cache_keys import code_version
from physgen.problems import InputError
from physgen.report.record import versions

TRIES = 3
"""How often a clip is begun on one worker: what kills its process that often is the clip itself."""
CANCEL_CHECK = 0.1
"""s between checks whether a task is still wanted."""
IDLE = 30.0
"""s after which idle child processes end, since others may use the worker, too."""
MAX_PACKS = 32
"""Scenes on the worker's disk that were sent to it."""
PACK_IN_USE = 600.0
"""s for which a scene is kept that a process may be about to read."""

Versions = Mapping[str, str]


@cache
def own_versions() -> Versions:
    """Versions of the code, libraries and processor; clips are equal where these are."""
    return {**code_version((*CODE, "batch")), **versions()}


@dataclass(frozen=True)
class Task:
    """A clip to make, and how to recognise whether folders are the user's."""

    job: Job
    folder: str
    """The user's working folder."""
    scene_stamp: Stamp | None
    """Of the scene's file as the user sees it; None for a URL, and where the scene is sent."""
    token: str | None
    """A file in the folder of results; None for a URL, and where the clip is sent back."""
    send_back: bool = False


@dataclass(frozen=True)
class Answer:
    """The result of a task, or why it was not begun."""

    done: Done | None = None
    files: Mapping[str, bytes] | None = None
    """Of the clip, by name, where it is sent back."""
    versions: Versions | None = None
    """Of a worker whose clips would differ."""
    scene_missing: bool = False
    folder_missing: bool = False


def run_task(expected: Versions, task: bytes, pack: bytes | None, key: str) -> bytes | LostError:
    """What the client submits: a pickled Answer; a LostError where the clip killed its process each time.

    `pack` is a scene that the worker does not see, `key` identifies its content.
    """
    from distributed import get_worker

    worker = get_worker()
    name = worker.get_current_task()

    def wanted() -> bool:
        state = worker.state.tasks.get(name)
        return state is not None and state.state in ("executing", "long-running")

    path = None if pack is None else str(_write_pack(Path(worker.local_directory, "physgen"), key, pack))
    try:
        return CHILDREN.ask((expected, task, path), wanted)
    except LostError as error:
        return error


def _write_pack(folder: Path, key: str, pack: bytes) -> Path:
    """The pack's file, written once; those that were used longest ago are removed."""
    path = folder / f"{key}.physgen"
    with _PACK_LOCK:
        if path.exists():
            os.utime(path)
            return path
        folder.mkdir(parents=True, exist_ok=True)
        write_atomic(path, pack)
        kept = sorted(folder.glob("*.physgen"), key=lambda file: file.stat().st_mtime)
        for old in kept[:-MAX_PACKS]:
            if old.stat().st_mtime < time.time() - PACK_IN_USE:
                old.unlink(missing_ok=True)
    return path


def answer(request: tuple[Versions, bytes, str | None]) -> bytes:
    """What a child process does with the versions of the client, a pickled Task, and the path of a pack."""
    expected, task, pack = request
    if expected != own_versions():
        return pickle.dumps(Answer(versions=own_versions()))
    return pickle.dumps(_make(pickle.loads(task), pack))


def _make(task: Task, pack: str | None) -> Answer:
    job = task.job
    if os.path.isabs(task.folder) and (task.scene_stamp or task.token):
        with suppress(OSError):
            os.chdir(task.folder)
    scene_missing = task.scene_stamp is not None and file_stamp(Path(job.scene)) != task.scene_stamp
    folder_missing = task.token is not None and not Path(job.out, task.token).is_file()
    if scene_missing or folder_missing:
        return Answer(scene_missing=scene_missing, folder_missing=folder_missing)
    if pack is None and not task.send_back:
        return Answer(run(job))
    try:
        scene = pack or local_copy(job.scene, job.options.overrides, job.options.variant)
        if task.send_back:
            with own_folder() as out:
                done = run(job.with_local(scene, str(out)))
                return Answer(done, _files(out / job.name))
        return Answer(
            run_remote(job, scene=scene) if is_url(job.out) else run(job.with_local(scene, job.out))
        )
    except (InputError, OSError) as error:
        return Answer(failed(job, error))


def _files(folder: Path) -> dict[str, bytes]:
    return {p.relative_to(folder).as_posix(): p.read_bytes() for p in folder.rglob("*") if p.is_file()}


class Children:
    """The child processes of one worker; each is used by one thread at a time."""

    def __init__(self) -> None:
        self._idle: list[tuple[float, Child]] = []
        """With the time since which each is idle."""
        self._lock = threading.Lock()

    def ask(self, request: object, wanted: Callable[[], bool]) -> bytes:
        """The answer of a child. Raises LostError where it died each time, or is not wanted any more."""
        lost = LostError("is not wanted any more")
        for _ in range(TRIES):
            with self._lock:
                child = self._idle.pop()[1] if self._idle else Child(answer)
            child.number = 0
            child.send(request)
            try:
                while not child.line.poll(CANCEL_CHECK):
                    if not wanted():
                        end_children([child])
                        raise lost
                result: bytes = child.receive()
            except LostError as error:
                if error is lost:
                    raise
                lost = error
                continue
            child.number = None
            with self._lock:
                self._idle.append((time.monotonic(), child))
            timer = threading.Timer(IDLE, self.end, [IDLE])
            timer.daemon = True
            timer.start()
            return result
        raise lost

    def end(self, idle: float = 0.0) -> None:
        """Ends the children that have been idle for so many seconds."""
        with self._lock:
            until = time.monotonic() - idle
            ending = [child for since, child in self._idle if since <= until]
            self._idle = [(since, child) for since, child in self._idle if since > until]
        end_children(ending)


CHILDREN = Children()
_PACK_LOCK = threading.Lock()
