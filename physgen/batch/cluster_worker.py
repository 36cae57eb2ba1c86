"""What runs on a Dask worker: receive a job, make its clip in a child process, return the result."""

from __future__ import annotations

import os
import pickle
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from multiprocessing import Pipe
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

from physgen.batch.remote import is_url
from physgen.batch.resume import CODE
from physgen.batch.run import Done, Job, at_hand, failed, local_copy, own_folder, run, run_remote
from physgen.batch.workers import GRACE, LostError, reason, serve
from physgen.files import Stamp, file_stamp, write_atomic
from physgen.pipeline.cache_keys import code_version
from physgen.problems import InputError
from physgen.report.record import versions

# ----------------------------------------------------------------------
# What this process would make clips with -> a few words of text by name, equal where its clips are equal.

Versions = Mapping[str, str]


def here() -> Versions:
    """Versions of physgen, its sources, Python, libraries and the kind of processor; worked out once a process."""
    return {**code_version((*CODE, "batch")), **versions()}


def other(worker: str, theirs: Versions) -> InputError:
    """A worker would make other bytes."""
    ours = here()
    names = [name for name in dict.fromkeys((*ours, *theirs)) if ours.get(name) != theirs.get(name)]
    if names == ["sources"]:
        ours, theirs = ({"sources": v.get("sources", "")[:12]} for v in (ours, theirs))
    elif "sources" in names:
        names.remove("sources")  # told by what else differs

    def told(of: Versions) -> str:
        return ", ".join(f"{name} {of.get(name, 'none')}" for name in names)

    expected = f"has {told(theirs)}, and here is {told(ours)}: its clips would not be the same"
    return InputError.of("--cluster", f"worker {worker}", expected, "install the same on both")


# ----------------------------------------------------------------------
# An errand from the user's machine -> its answer: the clip where it belongs, or what the worker misses to
# make it.
#
# A worker that sees the user's folders makes the clip as the user's machine would, in the same folder with
# the same
# words. One that does not is sent the scene, or sends the clip back.


@dataclass(frozen=True)
class Errand:
    """A clip to make, and how to tell whether folders are the user's."""

    job: Job
    """`here` says what the clip is called where a file of it is sent."""
    folder: str
    """The user's working folder."""
    scene: Stamp | None
    """Of the scene's file as the user sees it; None for a URL, and where the scene is sent."""
    token: str | None
    """A file in the folder of results; None for a URL, and where the clip is to be sent back."""
    back: bool = False
    """Whether the clip is to be sent back."""


@dataclass(frozen=True)
class Answer:
    """How an errand went; or why it was not begun."""

    done: Done | None = None
    files: Mapping[str, bytes] | None = None
    """Of the clip, by their names in its folder, where it is sent back."""
    versions: Versions | None = None
    """Of a worker that would make other clips."""
    scene_unseen: bool = False
    folder_unseen: bool = False


def answered(asked: tuple[Versions, bytes, str | None]) -> bytes:
    """What a hand does with what `hands.run_errands` was given: versions, errand, and the path of a pack."""
    versions, errand, pack = asked
    if versions != here():
        return pickle.dumps(Answer(versions=here()))
    return pickle.dumps(_answered(pickle.loads(errand), pack))


def _answered(errand: Errand, pack: str | None) -> Answer:
    job = errand.job
    if os.path.isabs(errand.folder) and (errand.scene or errand.token):
        with suppress(OSError):
            os.chdir(errand.folder)
    scene_unseen = errand.scene is not None and file_stamp(Path(job.path)) != errand.scene
    folder_unseen = errand.token is not None and not Path(job.out, errand.token).is_file()
    if scene_unseen or folder_unseen:
        return Answer(scene_unseen=scene_unseen, folder_unseen=folder_unseen)
    if pack is None and not errand.back:
        return Answer(run(job))
    try:
        scene = pack or local_copy(job.path, job.overrides, job.variant)
        if not errand.back:
            if is_url(job.out):
                return Answer(run_remote(job, scene=scene))
            return Answer(run(at_hand(job, scene, job.out)))
        with own_folder() as out:
            done = run(at_hand(job, scene, str(out)))
            return Answer(done, _files(out / job.called))
    except (InputError, OSError) as error:
        return Answer(failed(job, error))


def _files(folder: Path) -> dict[str, bytes] | None:
    if not folder.is_dir():
        return None
    return {p.relative_to(folder).as_posix(): p.read_bytes() for p in folder.rglob("*") if p.is_file()}


def with_names(job: Job) -> Job:
    """With all that a worker cannot know of it: for one that is sent the scene, or sends the clip."""
    return at_hand(replace(job, refiner=job.refiner.settled()), "", "")


# ----------------------------------------------------------------------
# An errand on a Dask worker -> its answer, made by a process of the worker's own.
#
# Clips that kill their process take no worker along, workers of several threads make several clips at a time,
# and what is
# no more wanted is ended at once. Answers pass as bytes: the worker itself need not know what they mean.

TRIES = 3
"""Times that an errand is begun: whatever kills its process thrice is the errand itself."""
LOOK = 0.1
"""s between looks whether it is still wanted."""
IDLE = 30.0
"""s after which a process that has nothing to do goes: others may use the worker, too."""
MOST_PACKS = 32
"""Scenes on the worker's disk that were sent to it, and more where many are at hand at once."""
IN_USE = 600.0
"""s for which a scene stays that a process may be about to read."""


def run_errands(
    versions: Mapping[str, str], errands: Sequence[bytes], pack: bytes | None, key: str, kind: str
) -> list[bytes | LostError]:
    """What the client submits; a LostError stands for the answer to an errand that killed its process each time.

    `pack` is a scene that the worker does not see, `key` what it is known by. Processes of one `kind` share what they
    have loaded.
    """
    from distributed import get_worker

    worker = get_worker()
    task = worker.get_current_task()

    def wanted() -> bool:
        state = worker.state.tasks.get(task)
        return state is not None and state.state in ("executing", "long-running")

    path = None if pack is None else str(_on_disk(Path(worker.local_directory, "physgen"), key, pack))
    answers: list[bytes | LostError] = []
    for errand in errands:
        try:
            answers.append(_CREW.ask(kind, (versions, errand, path), wanted))
        except LostError as error:
            answers.append(error)
            if not wanted():
                break
    return answers


def same(pack: bytes) -> bytes:
    """A task whose result is what it was given: unlike scattered data, it is there again when its worker is lost."""
    return pack


def _on_disk(folder: Path, key: str, pack: bytes) -> Path:
    """The pack's file, written once; those that were used longest ago go."""
    path = folder / f"{key}.physgen"
    with _PACKS:
        if path.exists():
            os.utime(path)
            return path
        folder.mkdir(parents=True, exist_ok=True)
        write_atomic(path, pack)
        kept = sorted(folder.glob("*.physgen"), key=lambda file: file.stat().st_mtime)
        late = time.time() - IN_USE
        for old in kept[:-MOST_PACKS]:
            if old.stat().st_mtime < late:
                old.unlink(missing_ok=True)
    return path


class Hand:
    """A process that does one errand after the other."""

    def __init__(self) -> None:
        self._line, theirs = Pipe()
        code = (
            f"import sys; sys.path[:] = {[name or os.getcwd() for name in sys.path]!r}\n"
            f"from physgen.batch.cluster_worker import begin; begin({theirs.fileno()}, {os.getpid()})"
        )
        # a worker's process may have no children of multiprocessing's; a session of its own: Ctrl-C is the client's
        self._process = subprocess.Popen(
            [sys.executable, "-c", code],
            stdin=subprocess.DEVNULL,
            pass_fds=[theirs.fileno()],
            start_new_session=True,
        )
        theirs.close()
        self.since = time.monotonic()
        """When it had nothing more to do."""

    def ask(self, item: Any, wanted: Callable[[], bool]) -> Any:
        """Its answer. Raises what the work raised, or LostError where the process died or is no more wanted."""
        try:
            self._line.send(item)
            while not self._line.poll(LOOK):
                if not wanted():
                    self.end()
                    raise LostError("is no more wanted")
            result, error = self._line.recv()
        except (EOFError, OSError):
            self._line.close()
            self.end()
            raise LostError(reason(self._process.returncode)) from None
        self.since = time.monotonic()
        if error is not None:
            raise error
        return result

    def dismiss(self) -> None:
        """One that has nothing to do goes by itself when nobody is on the line."""
        self._line.close()

    def end(self) -> None:
        """Told to stop where it is at something, and killed where it does not listen."""
        if not self._line.closed:
            self._line.close()
            self._process.terminate()
        try:
            self._process.wait(GRACE)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()


class Crew:
    """The processes of one worker."""

    def __init__(self) -> None:
        self._idle: dict[str, list[Hand]] = {}
        self._lock = threading.Lock()
        self._watched = False

    def ask(self, kind: str, item: Any, wanted: Callable[[], bool]) -> Any:
        """The answer of one of them, begun where all are busy. Raises as `Hand.ask`."""
        lost = LostError("is no more wanted")
        for _ in range(TRIES):
            hand = self._free(kind)
            try:
                answer = hand.ask(item, wanted)
            except LostError as error:
                lost = error
                if not wanted():
                    break
                continue
            except Exception:
                self._put_back(kind, hand)
                raise
            self._put_back(kind, hand)
            return answer
        raise lost

    def end(self) -> None:
        """All that have nothing to do."""
        with self._lock:
            gone = [hand for hands in self._idle.values() for hand in hands]
            self._idle.clear()
        for hand in gone:
            hand.dismiss()
        for hand in gone:
            hand.end()

    def _free(self, kind: str) -> Hand:
        """The one that was busy last: others may go."""
        with self._lock:
            if self._idle.get(kind):
                return self._idle[kind].pop()
        return Hand()

    def _put_back(self, kind: str, hand: Hand) -> None:
        with self._lock:
            self._idle.setdefault(kind, []).append(hand)
            if not self._watched:
                self._watched = True
                threading.Thread(target=self._send_home, daemon=True).start()

    def _send_home(self) -> None:
        """Ends those that have had nothing to do for long, until there are none."""
        while True:
            time.sleep(IDLE / 10)
            with self._lock:
                until = time.monotonic() - IDLE
                gone = [hand for hands in self._idle.values() for hand in hands if hand.since < until]
                for hands in self._idle.values():
                    hands[:] = [hand for hand in hands if hand not in gone]
                self._watched = any(self._idle.values())
                going_on = self._watched
            for hand in gone:
                hand.dismiss()
                hand.end()  # nobody else waits for the process
            if not going_on:
                return


_CREW = Crew()
_PACKS = threading.Lock()


def begin(number: int, worker: int) -> None:
    """The life of a hand: `number` is that of its end of the line, `worker` that of the process that asks."""

    serve(Connection(number), answered, worker)


def end_all() -> None:
    """Of a worker in this process: those of its hands that have nothing to do."""
    _CREW.end()
