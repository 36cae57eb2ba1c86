"""The draft folder beside a scene: a journal of every state, written before it is answered; one editor at a time."""

from __future__ import annotations

import fcntl
import json
import os
import re
import shutil
import stat
import time
from collections.abc import Mapping
from concurrent.futures import Future, ThreadPoolExecutor, wait
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Any

from physgen.edit.history import History, State, difference, patched
from physgen.files import partial
from physgen.problems import InputError

# ----------------------------------------------------------------------
# Bytes -> a file that holds them even when the power goes: beside, to the disk, then renamed; its rights
# stay.


def write_durably(path: Path, data: bytes) -> None:
    """The whole of it or nothing; behind a link, what it leads to. Raises OSError."""
    path = Path(os.path.realpath(path))
    beside = partial(path)
    try:
        with open(
            os.open(beside, os.O_WRONLY | os.O_CREAT | os.O_TRUNC | os.O_CLOEXEC, 0o666), "wb"
        ) as stream:
            with suppress(OSError):  # a new file has none yet, and of another's we may not have them all
                told = os.stat(path)
                os.fchmod(stream.fileno(), stat.S_IMODE(told.st_mode))
                os.fchown(stream.fileno(), told.st_uid, told.st_gid)
            stream.write(data)
            stream.flush()
            os.fsync(stream.fileno())
        beside.replace(path)
    except BaseException:
        with suppress(OSError):
            beside.unlink()
        raise
    sync(path.parent)


def sync(path: Path) -> None:
    """What a file holds is on the disk; of a folder, the names in it."""
    with suppress(OSError):
        number = os.open(path, os.O_RDONLY | os.O_CLOEXEC)
        try:
            os.fsync(number)
        finally:
            os.close(number)


# ----------------------------------------------------------------------
# The lines of a journal -> the states that it tells of, up to the first line that is none or does not fit.

FORMAT = 1


@dataclass
class Found:
    """What a journal holds."""

    history: History
    saved: State
    """What the file held last."""
    good: int
    """Bytes that were taken; what follows was cut short, or is of no use."""
    newest: str | None = None
    """Id of the newest request."""
    saving: State | None = None
    """What was being written when the editor ended: maps, and perhaps the text."""


def replayed(data: bytes) -> Found | None:
    """None where there is nothing to go on with."""
    lines = data.splitlines(keepends=True)
    first = _line(lines[0]) if lines else None
    if first is None or first.get("journal") != FORMAT or not isinstance(first.get("text"), str):
        return None
    saved = State(first["text"], first.get("maps", 0))
    found = Found(History(saved), saved, len(lines[0]))
    for raw in lines[1:]:
        line = _line(raw)
        if line is None or not _taken(found, line):
            break
        found.good += len(raw)
    return found


def _line(raw: bytes) -> dict[str, Any] | None:
    try:
        line = json.loads(raw)
    except ValueError:
        return None
    return line if raw.endswith(b"\n") and isinstance(line, dict) else None


def _taken(found: Found, line: dict[str, Any]) -> bool:
    """Whether a line fits to what was before; then it is done."""
    history = found.history
    try:
        match line["do"]:
            case "push":
                text = patched(history.now.text, line["text"])
                state = State(text, line["maps"], line["what"], line["tag"], line["id"], line["time"])
                history.push(state)
                found.newest = state.id or found.newest
            case "step" if history.can(line["by"]):
                history.step(line["by"])
                found.newest = line["id"] or found.newest
            case "saving":
                found.saving = history.now
            case "base":
                found.saved = State(patched(history.now.text, line["text"]), line["maps"])
                found.saving = None
                history.end_step()
            case _:
                return False
        history.version = max(history.version, line.get("version", 0))
    except (KeyError, TypeError, ValueError):
        return False
    return True


# ----------------------------------------------------------------------
# The draft folder beside a scene: every state on the disk before it is answered, one editor at a time.
#
# `.NAME.editing/` holds `journal.jsonl`, copies of maps that were corrected (`maps-1`, ...), and where the
# editor
# listens. It goes when the editor ends saved; one that is found is gone on with.


def draft_folder(path: Path) -> Path:
    """Of a scene file."""
    real = Path(os.path.realpath(path))
    return real.with_name(f".{real.name}.editing")


class BusyError(Exception):
    """Another editor has the scene."""


class Draft:
    """One scene's draft folder, held by this process alone. Raises BusyError, InputError."""

    def __init__(self, path: Path) -> None:
        self.folder = draft_folder(path)
        self.strange: Path | None = None
        """Where a folder of that name was put that no editor of this folder made: it came with the scene."""
        try:
            self._make()
            self._lock = os.open(self.folder / "lock", os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)
        except OSError as error:
            reason = (error.strerror or str(error)).lower()
            fix = "copy the scene to a folder that you may write to"
            raise InputError.of(str(path), "", f"cannot have a draft beside it: {reason}", fix) from None
        try:
            fcntl.flock(self._lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            os.close(self._lock)
            raise BusyError from None
        self._journal: int | None = None
        self._disk = ThreadPoolExecutor(1, "journal")
        self._settling: Future[None] | None = None
        self._place: tuple[int, str, str] | None = None
        self._maps = 0
        self._lost = False

    def _make(self) -> None:
        """The folder, known by its number on the disk: one that was copied or unpacked here has another."""
        if os.path.lexists(self.folder) and not _is_ours(self.folder):
            count = 1
            while os.path.lexists(aside := self.folder.with_name(f"{self.folder.name}~{count}")):
                count += 1
            self.folder.rename(aside)
            self.strange = aside
        self.folder.mkdir(mode=0o700, exist_ok=True)
        write_durably(self.folder / "owner", str(os.stat(self.folder).st_ino).encode())

    @property
    def file(self) -> Path:
        """The journal."""
        return self.folder / "journal.jsonl"

    # What is written

    def begin(self, state: State) -> None:
        """A new journal, of a file that holds this."""
        for old in self.folder.glob("maps-*"):
            if not state.maps:
                shutil.rmtree(old)
        self._shut()
        told = {"journal": FORMAT, "text": state.text, "maps": state.maps, "time": time.time()}
        write_durably(self.file, _journal_line(told))
        self.go_on()

    def is_gone(self) -> bool:
        """Whether somebody removed the folder: what is written then is nowhere."""
        return self._journal is None or self._lost or os.fstat(self._journal).st_nlink == 0

    def renew(self, history: History, saved: State) -> None:
        """The folder anew, with all states. Raises OSError."""
        self._shut()
        self._make()
        lock = os.open(self.folder / "lock", os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)
        if os.path.sameopenfile(lock, self._lock):
            os.close(lock)
        else:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            os.close(self._lock)
            self._lock = lock
        states, at = history.states()
        self.begin(states[0])
        for before, state in pairwise(states):
            self.push(before, replace(state, tag=None), 0)
        for _ in range(len(states) - 1 - at):
            self.step(-1, 0, None)
        self.base(states[at], saved, history.version)
        self._lost = False
        if self._place is not None:
            self.listens(*self._place)

    def go_on(self) -> None:
        """Further lines go behind those that are there."""
        self._journal = os.open(self.file, os.O_WRONLY | os.O_APPEND | os.O_CLOEXEC)

    def note(self, line: Mapping[str, Any]) -> None:
        """One line, on the disk once `settle` returns. Raises OSError; then nothing was noted."""
        assert self._journal is not None
        data = _journal_line({"time": round(time.time(), 3), **line})
        size = os.fstat(self._journal).st_size
        try:
            written = os.write(self._journal, data)
            while written < len(data):
                written += os.write(self._journal, data[written:])
        except OSError:
            with suppress(OSError):
                os.ftruncate(self._journal, size)
            raise
        self._settling = self._disk.submit(os.fsync, self._journal)

    def settle(self) -> None:
        """All that was noted is on the disk when this returns. Raises OSError: then it is lost until `renew`."""
        if self._settling is not None:
            try:
                self._settling.result()
            except OSError:
                self._settling, self._lost = None, True
                raise

    def push(self, before: State, state: State, version: int) -> None:
        """A new state."""
        change = difference(before.text, state.text)
        told = {"maps": state.maps, "what": state.what, "tag": state.tag, "id": state.id, "time": state.time}
        self.note({"do": "push", "version": version, **told, "text": change})

    def step(self, by: int, version: int, said: str | None) -> None:
        """Undo or redo."""
        self.note({"do": "step", "by": by, "version": version, "id": said})

    def saving(self) -> None:
        """Maps of the present state are about to be written over those of the scene."""
        self.note({"do": "saving"})
        self.settle()

    def base(self, now: State, saved: State, version: int) -> None:
        """What the file holds now."""
        change = difference(now.text, saved.text)
        self.note({"do": "base", "text": change, "maps": saved.maps, "version": version})

    # What is found

    def recovered(self) -> Found | None:
        """The states; None where there is nothing to go on with. Of what cannot be taken a copy stays aside."""
        try:
            data = self.file.read_bytes()
        except OSError:
            return None
        found = replayed(data)
        if found is not None and found.good < len(data):
            with open(self.folder / "journal.bad", "ab") as stream:
                stream.write(data[found.good :])
            os.truncate(self.file, found.good)
        return found

    # Maps

    def maps(self, number: int) -> Path:
        """The folder of a copy of the maps."""
        return self.folder / f"maps-{number}"

    def new_maps(self) -> int:
        """A number that no copy has, or was promised, yet."""
        found = (re.fullmatch(r"maps-(\d+)", path.name) for path in self.folder.iterdir())
        self._maps = 1 + max(self._maps, *(int(match[1]) for match in found if match), 0)
        return self._maps

    def keep_maps(self, folder: Path) -> None:
        """A new copy is on the disk, before a state tells of it."""
        for path in (*folder.iterdir(), folder, self.folder):
            sync(path)

    def forget_maps(self, kept: set[int]) -> None:
        """Copies that no state has any more."""
        for path in self.folder.glob("maps-*"):
            number = path.name.removeprefix("maps-")
            if number.isdecimal() and int(number) not in kept:
                shutil.rmtree(path, ignore_errors=True)

    # Where the editor listens

    def place(self) -> dict[str, Any]:
        """Where the one before listened."""
        return _told(self.folder)

    def listens(self, port: int, token: str, address: str) -> None:
        """Tell the next one; nobody else may read it."""
        self._place = port, token, address
        file = self.folder / "server.json"
        with suppress(OSError):
            file.unlink()
        number = os.open(file, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o600)
        with open(number, "w", encoding="utf-8") as stream:
            json.dump({"port": port, "token": token, "address": address}, stream)

    def close(self, keep: bool) -> None:
        """Let go of it, and with all in it unless it is to be kept."""
        self._shut()
        self._disk.shutdown()
        if not keep:
            shutil.rmtree(self.folder, ignore_errors=True)
            sync(self.folder.parent)
        with suppress(OSError):
            os.close(self._lock)

    def _shut(self) -> None:
        if self._journal is not None:
            wait([self._settling] if self._settling else [])
            os.close(self._journal)
            self._journal = None


def _is_ours(folder: Path) -> bool:
    """Whether an editor of this user made the folder where it is: nothing in it is from strangers then."""
    try:
        told = os.lstat(folder)
        said = (folder / "owner").read_text()
    except (OSError, ValueError):
        return False
    own = stat.S_ISDIR(told.st_mode) and told.st_uid == os.getuid() and not told.st_mode & 0o077
    return own and said == str(told.st_ino)


def running_at(path: Path) -> str | None:
    """Address of the editor that has a scene open; None where there is none."""
    folder = draft_folder(path)
    if not _is_ours(folder):
        return None
    try:
        number = os.open(folder / "lock", os.O_RDWR | os.O_CLOEXEC)
    except OSError:
        return None
    try:
        fcntl.flock(number, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        address = _told(folder).get("address")
        return address if isinstance(address, str) else None
    finally:
        os.close(number)
    return None


def _told(folder: Path) -> dict[str, Any]:
    try:
        told = json.loads((folder / "server.json").read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
    return told if isinstance(told, dict) else {}


def _journal_line(told: Mapping[str, Any]) -> bytes:
    return json.dumps(told, ensure_ascii=True, separators=(",", ":")).encode() + b"\n"
