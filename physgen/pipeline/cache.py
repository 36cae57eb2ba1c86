"""The store of stage results on disk, kept between runs and shared by processes.

An entry is one file under its key, written beside and renamed, with a checksum: a file that was cut short or damaged
counts as missing. An entry is read whole, so removing it disturbs no reader. The least recently used entries go first.
"""

from __future__ import annotations

import errno
import os
import re
import shutil
import time
import zlib
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

from physgen.files import write_atomic
from physgen.problems import InputError, Place, Problem, Severity, Warn, ignore_warning

SUFFIX = ".entry"
NO_LOCKS = (errno.ENOLCK, errno.ENOTSUP, errno.EOPNOTSUPP, errno.ENOSYS)
"""What file systems without locks answer."""
MAGIC = b"physgen1"
"""The first bytes of an entry; a checksum of 4 bytes and the data follow."""
MOST_BYTES = 5_000_000_000
"""Of all entries, unless `PHYSGEN_CACHE_BYTES` names another bound."""
SHRINK_TO = 0.9
"""Share of the bound that is left after a clean-up, so that the next entry does not cause another."""
LOOK_AFTER = 0.01
"""Share of the bound that is added before all entries are listed again: listing takes long where there are many."""
GROWN = ".grown"
"""File with the count of bytes added since the entries were listed."""
ABANDONED = 86400.0
"""s after which a partial file counts as left by a killed process."""
_BYTES = re.compile(r"(?P<number>\d+(\.\d*)?(e\d+)?) ?(?P<unit>[kMGT]?)B?", re.IGNORECASE)


@dataclass(frozen=True)
class Entry:
    """One stored result."""

    key: str
    bytes: int
    used: float
    """s since 1970: when it was last read, or written."""

    @property
    def stage(self) -> str:
        """The stage whose result it is."""
        return self.key.rpartition("-")[0]


@dataclass(frozen=True)
class Freed:
    """What a clean-up removed."""

    entries: int
    bytes: int


class Store:
    """Entries below a folder; only `clear` raises OSError where that folder cannot be read or written."""

    def __init__(self, root: Path, most_bytes: int = MOST_BYTES, warn: Warn = ignore_warning) -> None:
        self.root, self.most_bytes = root, most_bytes
        self._warn, self._warned = warn, False

    def read(self, key: str) -> bytes | None:
        """The data of an entry; None where it is missing or damaged."""
        path = self.root / f"{key}{SUFFIX}"
        try:
            content = path.read_bytes()
        except OSError:
            return None
        head = len(MAGIC) + 4
        if content[:head] == MAGIC + _checksum(content[head:]):
            with suppress(OSError):  # a folder that can only be read, or an entry that is removed now
                os.utime(path)
            return content[head:]
        with suppress(OSError):
            path.unlink()
        return None

    def write(self, key: str, data: bytes) -> None:
        """Store an entry; the user is warned once where that fails."""
        if not self.most_bytes:
            return
        if len(data) > self.most_bytes:
            expected = f"are more than the {self.most_bytes:,} that are kept"
            self._tell(f"{len(data):,} bytes of one result", expected, "raise PHYSGEN_CACHE_BYTES")
            return
        try:
            self.root.mkdir(parents=True, exist_ok=True, mode=0o700)  # photos may be private
            write_atomic(self.root / f"{key}{SUFFIX}", MAGIC + _checksum(data) + data)
            with self._locked():
                if self._due(len(data)):
                    self._shrink(self.most_bytes, int(SHRINK_TO * self.most_bytes))
        except OSError as error:
            fix = "set XDG_CACHE_HOME to a folder that can be written, or free some space"
            found = f"({error.strerror or error})"
            self._tell(found, "cannot be written: the next run computes all again", fix)

    def sizes(self) -> list[Entry]:
        """All entries, the least recently used first."""
        found = []
        for path in self.root.glob(f"*{SUFFIX}"):
            with suppress(OSError):  # another process may remove it now
                status = path.stat()
                found.append(Entry(path.name.removesuffix(SUFFIX), status.st_size, status.st_mtime))
        return sorted(found, key=lambda entry: (entry.used, entry.key))

    def clear(self) -> Freed:
        """Remove all entries. Raises OSError."""
        if not self.root.is_dir():
            return Freed(0, 0)
        with self._locked():
            return self._shrink(-1, -1)

    @contextmanager
    def _locked(self) -> Iterator[None]:
        """Holds the store's lock; without one where the file system has none, as two processes may both clear up."""
        from filelock import FileLock  # not before an entry is written: its import takes 20 ms

        lock = FileLock(self.root / ".lock")
        try:
            lock.acquire()
        except NotImplementedError:
            pass
        except OSError as error:
            if error.errno not in NO_LOCKS:
                raise
        try:
            yield
        finally:
            lock.release()

    def _due(self, grown: int) -> bool:
        """Whether it is time to list the entries, after `grown` bytes more."""
        counter = self.root / GROWN
        try:
            since = int(counter.read_text()) + grown
        except (OSError, ValueError):  # never listed yet
            since = self.most_bytes
        due = since >= LOOK_AFTER * self.most_bytes
        counter.write_text("0" if due else str(since))
        return due

    def _shrink(self, most: int, least: int) -> Freed:
        """Where there are more than `most` bytes, remove entries until `least` are left; partial files go, too."""
        for path in self.root.iterdir():
            if path.is_dir():  # an entry of an earlier layout
                shutil.rmtree(path, ignore_errors=True)
            elif path.suffix == ".part":
                with suppress(FileNotFoundError):  # it was renamed now
                    if path.stat().st_mtime < time.time() - ABANDONED:
                        path.unlink()
        entries = self.sizes()
        left = total = sum(entry.bytes for entry in entries)
        count = 0
        for entry in entries if total > most else ():
            if left <= least:
                break
            (self.root / f"{entry.key}{SUFFIX}").unlink(missing_ok=True)
            left, count = left - entry.bytes, count + 1
        return Freed(count, total - left)

    def _tell(self, found: str, expected: str, fix: str) -> None:
        if not self._warned:
            self._warned = True
            self._warn(Problem(Place(str(self.root)), "", found, expected, fix, Severity.WARNING))


def open_store(environment: Mapping[str, str] = os.environ, warn: Warn = ignore_warning) -> Store:
    """The store of stage results, at the place and with the bound that the environment names. Raises InputError."""
    home = environment.get("XDG_CACHE_HOME", "")
    try:
        folder = Path(home) if os.path.isabs(home) else Path.home() / ".cache"
    except RuntimeError:  # no home folder: the user is warned when something is to be kept
        folder = Path(os.devnull)
    most = MOST_BYTES
    if text := environment.get("PHYSGEN_CACHE_BYTES", ""):
        match = _BYTES.fullmatch(text.strip())
        if match is None:
            fix = "write e.g. 20e9 or 20GB; 0 keeps nothing"
            raise InputError.of("PHYSGEN_CACHE_BYTES", f'"{text}"', "is not a number of bytes", fix)
        power = " KMGT".index(match["unit"].upper() or " ")
        most = int(min(float(match["number"]) * 1000.0**power, 1e18))
    return Store(folder / "physgen" / "stages", most, warn)


def _checksum(data: bytes) -> bytes:
    return zlib.crc32(data).to_bytes(4, "big")
