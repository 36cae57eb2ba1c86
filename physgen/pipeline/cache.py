"""The on-disk store of stage results, shared by processes; least recently used entries are removed."""

from __future__ import annotations

import errno
import fcntl
import json
import os
import re
import shutil
import tempfile
import time
import zlib
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from enum import IntFlag
from pathlib import Path
from uuid import uuid4

from physgen.problems import InputError, Place, Problem, Severity, Warn, ignore_warning

# ----------------------------------------------------------------------
# Locks on files of the store, which end with the process however that ends; and what stands for them
# elsewhere.
#
# `flock` works on local disks, and on NFS where its lock service runs. Where a file system knows no locks,
# nobody can
# tell whether a file is in use: what was touched within a day is held to be.

LEASE, LOCK = "lease", ".lock"
"""Of an entry, and of the store."""
NONE = {errno.ENOLCK, errno.ENOTSUP, errno.EOPNOTSUPP, errno.ENOSYS}
"""What a file system says that knows no locks."""
DAY = 86400.0
"""s."""


class LockMode(IntFlag):
    """Of a lock that is asked for."""

    SHARED = fcntl.LOCK_SH
    """With others who read."""
    ALONE = fcntl.LOCK_EX
    NOW = fcntl.LOCK_NB
    """Not waiting for others."""


def lock_file(descriptor: int, how: LockMode) -> bool:
    """Whether the file is locked from now on until it is closed; False where there are no locks.

    Raises OSError, BlockingIOError among them where somebody else holds it.
    """
    try:
        fcntl.flock(descriptor, how)
    except OSError as error:
        if error.errno in NONE:
            return False
        raise
    return True


def check_unused(lease: int) -> None:
    """Nobody uses what the lease stands for, as far as can be told. Raises BlockingIOError where somebody does."""
    if not lock_file(lease, LockMode.ALONE | LockMode.NOW) and time.time() - os.fstat(lease).st_mtime < DAY:
        raise BlockingIOError(errno.EWOULDBLOCK, "may be in use")


@contextmanager
def exclusive_lock(root: Path) -> Iterator[None]:
    """Alone, among all processes, with what a store's folder lists; without locks, with anybody. Raises OSError."""
    lock = os.open(root / LOCK, os.O_CREAT | os.O_RDWR, 0o600)
    try:
        lock_file(lock, LockMode.ALONE)
        yield
    finally:
        os.close(lock)


# ----------------------------------------------------------------------
# Folder -> its index, with sizes and sums of all files; and whether they are still as they were.

INDEX = "index.json"
VERSION = 1


def seal(folder: Path, but: str) -> None:
    """Write the index of all files but those called `but`. Raises OSError."""
    files = {
        path.relative_to(folder).as_posix(): _sum(path)
        for path in sorted(folder.rglob("*"))
        if path.is_file() and path.name != but
    }
    (folder / INDEX).write_text(json.dumps({"cache": VERSION, "files": files}), encoding="utf-8")


def is_sealed(folder: Path) -> bool:
    """Whether all files are there as they were sealed."""
    try:
        index = json.loads((folder / INDEX).read_bytes())
        return index["cache"] == VERSION and all(_sum(folder / n) == s for n, s in index["files"].items())
    except (OSError, ValueError, KeyError, TypeError, AttributeError, RecursionError):
        return False


def size_of(folder: Path) -> int:
    """Bytes of its files; raises OSError where one goes meanwhile."""
    return sum(path.stat().st_size for path in folder.rglob("*") if path.is_file())


def _sum(path: Path) -> list[int]:
    """Bytes of a file, and their CRC-32."""
    size = check = 0
    with path.open("rb") as file:
        while block := file.read(2**20):
            size, check = size + len(block), zlib.crc32(block, check)
    return [size, check]


# ----------------------------------------------------------------------
# A store's folder -> what is kept in it; and the least recently used entries, and what killed runs left,
# gone.


@dataclass(frozen=True)
class Entry:
    """One that is kept."""

    key: str
    bytes: int
    used: float
    """s since 1970: when it was last read, or made."""

    @property
    def stage(self) -> str:
        """Whose result it is."""
        return self.key.rpartition("-")[0]


@dataclass(frozen=True)
class Freed:
    """What was removed."""

    entries: int
    bytes: int
    """Of entries, and of what killed processes left."""
    held: int
    """Entries that stay because a process reads them."""


def entries(root: Path) -> list[Entry]:
    """All of them, the least recently used first; none where the folder cannot be read."""
    found = []
    try:
        folders = [path for path in root.iterdir() if path.is_dir() and not path.name.startswith(".")]
    except OSError:
        return []
    for folder in folders:
        with suppress(OSError):  # another process may remove it now
            lease = folder / LEASE
            used = (lease if lease.exists() else folder).stat().st_mtime
            found.append(Entry(folder.name, size_of(folder), used))
    return sorted(found, key=lambda entry: (entry.used, entry.key))


def shrink(root: Path, most: int, least: int | None = None) -> Freed:
    """Where there are more than `most` bytes, entries go, the least recently used first, until `least` are left.

    Remains go too. Raises OSError.
    """
    with exclusive_lock(root):
        gained = sweep(root)
        kept = entries(root)
        left = sum(entry.bytes for entry in kept)
        gone = held = 0
        bound = most if least is None or left <= most else least
        for entry in kept:
            if left <= bound:
                break
            if not remove(root, entry.key):
                held += 1
                continue
            gone += 1
            left -= entry.bytes
            gained += entry.bytes
    return Freed(gone, gained, held)


def remove(root: Path, key: str) -> bool:
    """Whether the entry is gone; one that a process reads stays. All removing is done alone."""
    folder = root / key
    try:
        lease = os.open(folder / LEASE, os.O_CREAT | os.O_RDWR, 0o600)
    except FileNotFoundError:
        return True
    try:
        check_unused(lease)
        aside = root / f".{key}.{uuid4().hex[:8]}.part"  # swept, should we be killed now
        folder.rename(aside)
    except BlockingIOError:
        return False
    finally:
        os.close(lease)
    shutil.rmtree(aside, ignore_errors=True)
    return True


def sweep(root: Path) -> int:
    """Bytes freed by clearing away what killed processes left; done alone."""
    gained = 0
    for left in root.glob(".*.part"):
        with suppress(OSError):  # among them: whoever fills it lives
            lease = os.open(left / LEASE, os.O_CREAT | os.O_RDWR, 0o600)
            try:
                check_unused(lease)
                gained += size_of(left)
                shutil.rmtree(left, ignore_errors=True)
            finally:
                os.close(lease)
    return gained


# ----------------------------------------------------------------------
# Key -> folder of an entry, on disk between runs, for many processes at once; the least recently used go
# first.
#
# An entry is a folder under its key. It is filled under another name and renamed when it is whole, with sizes
# and sums of
# its files, so that what was cut short or damaged counts as not there. Who reads or fills one holds a lock on
# its `lease`
# (see `locks`); only folders whose lease nobody holds are removed.

MOST_BYTES = 5_000_000_000
"""Of all entries, unless `PHYSGEN_CACHE_BYTES` says otherwise."""
ROOM = 0.9
"""Of what may be kept, that is left when there is too much: else each entry more would have all of them listed."""
SHARE = 100
"""A hundredth of what may be kept is added before the eldest entries are looked for."""
GROWN = ".grown"
"""File that tells how many bytes were added since."""
_SWEPT: set[Path] = set()
"""Stores from which this process has cleared away what killed ones left."""
_BYTES = re.compile(r"(?P<number>\d+(\.\d*)?(e\d+)?) ?(?P<unit>[kMGT]?)B?", re.IGNORECASE)


class Filling:
    """A folder that becomes an entry, unless it is given up."""

    def __init__(self, folder: Path, warn: Callable[[OSError], None]) -> None:
        self.folder, self._warn = folder, warn
        self.kept = True

    def drop(self) -> None:
        """It is not to be kept: what it takes is freed now."""
        self.kept = False
        shutil.rmtree(self.folder, ignore_errors=True)

    def give_up(self, error: OSError) -> None:
        """It could not be written: it is dropped, the user is told, and nobody fails."""
        self.drop()
        self._warn(error)


class Store:
    """Entries below a folder; none of its methods but `clear` fails because that folder cannot be read or written."""

    def __init__(self, root: Path, most_bytes: int = MOST_BYTES, warn: Warn = ignore_warning) -> None:
        self.root, self.most_bytes = root, most_bytes
        self._warn, self._told = warn, False

    @contextmanager
    def find(self, key: str) -> Iterator[Path | None]:
        """The entry's folder, which stays as long as the block runs; None where there is none that is whole."""
        lease = self._leased(key)
        try:
            yield None if lease is None else self.root / key
        finally:
            if lease is not None:
                os.close(lease)

    @contextmanager
    def fill(self, key: str) -> Iterator[Filling | None]:
        """A folder to write to, which is the entry when the block ends; None where nothing is to be kept, and, the user
        told, where it cannot be.

        Whatever the block raises is raised, and nothing is kept. Where another process was faster, its entry stays.
        """
        if not self.most_bytes:
            yield None
            return
        try:
            folder, lease = self._begun(key)
        except OSError as error:
            self._unkept(error)
            yield None
            return
        try:
            filling = Filling(folder, self._unkept)
            yield filling
            grown = 0
            if filling.kept:
                try:
                    grown = self._finish(folder, key)
                except OSError as error:
                    self._unkept(error)
        finally:
            shutil.rmtree(folder, ignore_errors=True)
            os.close(lease)
        with suppress(OSError):
            if grown and self._due(grown):
                self._shrink(self.most_bytes, int(ROOM * self.most_bytes))

    def sizes(self) -> list[Entry]:
        """All entries, the least recently used first."""
        return entries(self.root)

    def clear(self) -> Freed:
        """Remove all that no process uses. Raises OSError."""
        return self._shrink(-1) if self.root.is_dir() else Freed(0, 0, 0)

    def _leased(self, key: str) -> int | None:
        """A descriptor of the entry's lease, held with others who read it; None where it is not whole."""
        folder = self.root / key
        try:
            lease = os.open(folder / LEASE, os.O_RDONLY)
        except OSError:
            self._discard(key)
            return None
        try:
            lock_file(lease, LockMode.SHARED | LockMode.NOW)
            if os.fstat(lease).st_ino != os.stat(folder / LEASE).st_ino:  # removed, and made anew, meanwhile
                raise FileNotFoundError(folder)
        except OSError:
            os.close(lease)
            return None
        if not is_sealed(folder):
            os.close(lease)
            self._discard(key)
            return None
        with suppress(OSError):  # a folder that can only be read
            os.utime(lease)
        return lease

    def _discard(self, key: str) -> None:
        """What is not whole goes, if there is anything."""
        if (self.root / key).is_dir():
            with suppress(OSError), exclusive_lock(self.root):
                remove(self.root, key)

    def _begun(self, key: str) -> tuple[Path, int]:
        """A folder of our own, and its lease, which nobody else has."""
        self.root.mkdir(parents=True, exist_ok=True, mode=0o700)  # photos may be private
        with exclusive_lock(self.root):
            if self.root not in _SWEPT:
                _SWEPT.add(self.root)
                sweep(self.root)
            folder = Path(tempfile.mkdtemp(prefix=f".{key}.", suffix=".part", dir=self.root))
            try:
                lease = os.open(folder / LEASE, os.O_CREAT | os.O_RDWR, 0o600)
                lock_file(lease, LockMode.ALONE)
            except OSError:
                shutil.rmtree(folder, ignore_errors=True)
                raise
        return folder, lease

    def _due(self, grown: int) -> bool:
        """Whether so many bytes more make it time to look for what is too much: looking means listing every entry."""
        with exclusive_lock(self.root):
            counter = self.root / GROWN
            try:
                since = int(counter.read_text()) + grown
            except (OSError, ValueError):  # nobody has looked yet
                since = self.most_bytes
            due = since * SHARE >= self.most_bytes
            counter.write_text("0" if due else str(since))
        return due

    def _finish(self, folder: Path, key: str) -> int:
        """Bytes of the entry; 0 where it is none."""
        if (size := size_of(folder)) > self.most_bytes:
            found = f"{size:,} bytes of one result"
            fix = "raise PHYSGEN_CACHE_BYTES"
            self._tell(found, f"are more than the {self.most_bytes:,} that are kept", fix)
            return 0
        seal(folder, LEASE)
        os.utime(folder / LEASE)
        with exclusive_lock(self.root):
            if (self.root / key).exists():
                return 0
            try:
                folder.rename(self.root / key)
            except OSError:
                if (self.root / key).is_dir():  # without locks, another process may be faster now
                    return 0
                raise
        return size

    def _shrink(self, most: int, least: int | None = None) -> Freed:
        return shrink(self.root, most, least)

    def _unkept(self, error: OSError) -> None:
        found = f"({error.strerror or error})"
        fix = "set XDG_CACHE_HOME to a folder that can be written, or free some space"
        self._tell(found, "cannot be written: the next run computes all again", fix)

    def _tell(self, found: str, expected: str, fix: str) -> None:
        """Once."""
        if not self._told:
            self._told = True
            self._warn(Problem(Place(str(self.root)), "", found, expected, fix, Severity.WARNING))


def open_store(environment: Mapping[str, str] = os.environ, warn: Warn = ignore_warning) -> Store:
    """The store of stages' results, where and as large as the environment says. Raises InputError."""
    home = environment.get("XDG_CACHE_HOME", "")
    try:
        folder = Path(home) if os.path.isabs(home) else Path.home() / ".cache"
    except RuntimeError:  # nobody's home: told of when something is to be kept
        folder = Path(os.devnull)
    most = MOST_BYTES
    if said := environment.get("PHYSGEN_CACHE_BYTES", ""):
        match = _BYTES.fullmatch(said.strip())
        if match is None:
            fix = "write e.g. 20e9 or 20GB; 0 keeps nothing"
            raise InputError.of("PHYSGEN_CACHE_BYTES", f'"{said}"', "is not a number of bytes", fix)
        power = " KMGT".index(match["unit"].upper() or " ")
        most = int(min(float(match["number"]) * 1000.0**power, 1e18))
    return Store(folder / "physgen" / "stages", most, warn)
