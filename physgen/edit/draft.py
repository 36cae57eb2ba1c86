"""The draft folder beside a scene: every state is written there before it is answered, by one editor at a time.

`.NAME.editing/` holds `draft.json` with all states, copies of maps that were corrected (`maps-1`, ...), and where the
editor listens. It is removed when the editor ends with everything saved; the next editor continues one that is left.
"""

from __future__ import annotations

import fcntl
import json
import os
import re
import shutil
import stat
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

from physgen.edit.history import History, State
from physgen.files import partial
from physgen.problems import InputError

FORMAT = 2
"""Of draft.json. Format 1 was a journal, journal.jsonl: such a folder is set aside, never overwritten."""


def draft_folder(path: Path) -> Path:
    """The draft folder of a scene file."""
    real = Path(os.path.realpath(path))
    return real.with_name(f".{real.name}.editing")


class BusyError(Exception):
    """Another editor has the scene."""


class Draft:
    """The draft folder of one scene, held by this process alone. Raises BusyError, InputError."""

    def __init__(self, path: Path) -> None:
        self.folder = draft_folder(path)
        self.set_aside: Path | None = None
        """The new name of a folder that was found and is not a draft of this editor."""
        self._address: tuple[int, str, str] | None = None
        self._last_maps = 0
        try:
            self._lock = self._make_folder()
            if not self._is_readable():  # of another version, say
                self._move_aside()
                os.close(self._lock)
                self._lock = self._make_folder()
        except OSError as error:
            reason = (error.strerror or str(error)).lower()
            fix = "copy the scene to a folder that you may write to"
            raise InputError.of(str(path), "", f"cannot have a draft beside it: {reason}", fix) from None

    @property
    def file(self) -> Path:
        """The states."""
        return self.folder / "draft.json"

    def _make_folder(self) -> int:
        """Make the folder, or take over one of this user, and lock it. Raises BusyError, OSError."""
        if os.path.lexists(self.folder) and not _is_ours(self.folder):
            self._move_aside()
        self.folder.mkdir(mode=0o700, exist_ok=True)
        inode = os.stat(self.folder).st_ino  # a copy that was moved here has another
        write_durably(self.folder / "owner", str(inode).encode())
        lock = os.open(self.folder / "lock", os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            os.close(lock)
            raise BusyError from None
        return lock

    def _is_readable(self) -> bool:
        """Whether its states can be read, or there are none yet."""
        if (self.folder / "journal.jsonl").exists():
            return False
        try:
            found = _read_json(self.file)
            History.from_data(found["history"])
            State(**found["saved"])
            return found["format"] == FORMAT and isinstance(found["ids"], list) and "saving" in found
        except FileNotFoundError:
            return True
        except (OSError, ValueError, KeyError, TypeError):
            return False

    def _move_aside(self) -> None:
        count = 1
        while os.path.lexists(aside := self.folder.with_name(f"{self.folder.name}~{count}")):
            count += 1
        self.folder.rename(aside)
        self.set_aside = aside

    # States

    def load(self) -> dict[str, Any] | None:
        """What `store` wrote last; None where there is nothing."""
        try:
            return dict(_read_json(self.file))
        except FileNotFoundError:
            return None

    def store(self, data: Mapping[str, Any]) -> None:
        """Write all states to the disk; the old ones stay until the new ones are complete. Raises OSError."""
        if self.is_gone():
            self._renew()
        data = {"format": FORMAT, **data}
        write_durably(self.file, json.dumps(data, separators=(",", ":")).encode())

    def is_gone(self) -> bool:
        """Whether another program removed the folder."""
        return os.fstat(self._lock).st_nlink == 0 or not self.folder.is_dir()

    def _renew(self) -> None:
        """Make the folder again. Raises OSError."""
        lock = self._make_folder()
        os.close(self._lock)
        self._lock = lock
        if self._address is not None:
            self.listens(*self._address)

    # Maps

    def maps(self, number: int) -> Path:
        """The folder of a copy of the maps."""
        return self.folder / f"maps-{number}"

    def new_maps(self) -> int:
        """A number that no copy has yet, and that was not returned before."""
        found = (re.fullmatch(r"maps-(\d+)", path.name) for path in self.folder.iterdir())
        self._last_maps = 1 + max(self._last_maps, *(int(match[1]) for match in found if match), 0)
        return self._last_maps

    def keep_maps(self, folder: Path) -> None:
        """Write a new copy through to the disk, before a state refers to it."""
        for path in (*folder.iterdir(), folder, self.folder):
            sync(path)

    def forget_maps(self, kept: set[int]) -> None:
        """Remove the copies that no state refers to."""
        for path in self.folder.glob("maps-*"):
            number = path.name.removeprefix("maps-")
            if number.isdecimal() and int(number) not in kept:
                shutil.rmtree(path, ignore_errors=True)

    # Where the editor listens

    def last_address(self) -> dict[str, Any]:
        """Port, token and address of the editor before."""
        return _address_in(self.folder)

    def listens(self, port: int, token: str, address: str) -> None:
        """Write where this editor listens, readable by its user alone."""
        self._address = port, token, address
        file = self.folder / "server.json"
        with suppress(OSError):
            file.unlink()
        number = os.open(file, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o600)
        with open(number, "w", encoding="utf-8") as stream:
            json.dump({"port": port, "token": token, "address": address}, stream)

    def close(self, keep: bool) -> None:
        """Release the folder, and remove it unless it is to be kept."""
        if not keep:
            shutil.rmtree(self.folder, ignore_errors=True)
            sync(self.folder.parent)
        with suppress(OSError):
            os.close(self._lock)


def _read_json(file: Path) -> Any:
    return json.loads(file.read_bytes())


def _is_ours(folder: Path) -> bool:
    """Whether an editor of this user made the folder where it is."""
    try:
        found = os.lstat(folder)
        owner = (folder / "owner").read_text()
    except (OSError, ValueError):
        return False
    own = stat.S_ISDIR(found.st_mode) and found.st_uid == os.getuid() and not found.st_mode & 0o077
    return own and owner == str(found.st_ino)


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
        address = _address_in(folder).get("address")
        return address if isinstance(address, str) else None
    finally:
        os.close(number)
    return None


def _address_in(folder: Path) -> dict[str, Any]:
    try:
        found = _read_json(folder / "server.json")
    except (OSError, ValueError):
        return {}
    return found if isinstance(found, dict) else {}


def write_durably(path: Path, data: bytes) -> None:
    """Write a file completely or not at all, through to the disk, with its old permissions; follows links.

    Raises OSError.
    """
    path = Path(os.path.realpath(path))
    beside = partial(path)
    flags = os.O_WRONLY | os.O_CREAT | os.O_TRUNC | os.O_CLOEXEC
    try:
        with open(os.open(beside, flags, 0o666), "wb") as stream:
            with suppress(OSError):  # a new file has no old permissions, and not all can be given again
                old = os.stat(path)
                os.fchmod(stream.fileno(), stat.S_IMODE(old.st_mode))
                os.fchown(stream.fileno(), old.st_uid, old.st_gid)
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
    """Write a file, or the names in a folder, through to the disk."""
    with suppress(OSError):
        number = os.open(path, os.O_RDONLY | os.O_CLOEXEC)
        try:
            os.fsync(number)
        finally:
            os.close(number)
