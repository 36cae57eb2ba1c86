"""The store of stage results on disk, kept between runs and shared by processes.

An entry is one file under its key, written beside and renamed, with a checksum: a file that was cut short or damaged
counts as missing. An entry is read whole, so removing it disturbs no reader. The least recently used entries go first.
"""

from __future__ import annotations

import os
import re
import time
import zlib
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from physgen.files import cache_folder, partial
from physgen.problems import InputError, Place, Problem, Severity, Warn, ignore_warning

SUFFIX = ".entry"
MAGIC = b"physgen1"
"""The first bytes of an entry; a checksum of 4 bytes and the data follow."""
MOST_BYTES = 5_000_000_000
"""Of all entries, unless `PHYSGEN_CACHE_BYTES` names another bound."""
SHRINK_TO = 0.9
"""Share of the bound that is left after a clean-up, so that the next entry does not cause another."""
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


class Store:
    """Entries below a folder."""

    def __init__(self, root: Path, most_bytes: int = MOST_BYTES, warn: Warn = ignore_warning) -> None:
        self.root, self.most_bytes = root, most_bytes
        self._warn, self._warned = warn, False

    def read(self, key: str) -> memoryview | None:
        """The data of an entry; None where it is missing or damaged."""
        path = self.root / f"{key}{SUFFIX}"
        try:
            content = path.read_bytes()
        except OSError:
            return None
        head = len(MAGIC) + 4
        data = memoryview(content)[head:]
        if content[:head] == MAGIC + zlib.crc32(data).to_bytes(4, "big"):
            with suppress(OSError):  # a folder that can only be read, or an entry that is removed now
                os.utime(path)
            return data
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
        path = self.root / f"{key}{SUFFIX}"
        beside = partial(path)
        try:
            self.root.mkdir(parents=True, exist_ok=True, mode=0o700)  # photos may be private
            with beside.open("wb") as file:
                file.writelines((MAGIC, zlib.crc32(data).to_bytes(4, "big"), data))
            beside.replace(path)
            self._shrink()
        except OSError as error:
            fix = "set XDG_CACHE_HOME to a folder that can be written, or free some space"
            found = f"({error.strerror or error})"
            self._tell(found, "cannot be written: the next run computes all again", fix)
        finally:
            with suppress(OSError):
                beside.unlink(missing_ok=True)

    def sizes(self) -> list[Entry]:
        """All entries, the least recently used first."""
        found = []
        for path in self.root.glob(f"*{SUFFIX}"):
            with suppress(OSError):  # another process may remove it now
                status = path.stat()
                found.append(Entry(path.name.removesuffix(SUFFIX), status.st_size, status.st_mtime))
        return sorted(found, key=lambda entry: (entry.used, entry.key))

    def _shrink(self) -> None:
        """Where there are more bytes than the bound, remove entries until there is room; partial files go, too."""
        for path in self.root.glob(".*.part"):
            with suppress(FileNotFoundError):  # it was renamed now
                if path.stat().st_mtime < time.time() - ABANDONED:
                    path.unlink()
        entries = self.sizes()
        left = total = sum(entry.bytes for entry in entries)
        for entry in entries if total > self.most_bytes else ():
            if left <= int(SHRINK_TO * self.most_bytes):
                break
            (self.root / f"{entry.key}{SUFFIX}").unlink(missing_ok=True)
            left -= entry.bytes

    def _tell(self, found: str, expected: str, fix: str) -> None:
        if not self._warned:
            self._warned = True
            self._warn(Problem(Place(str(self.root)), "", found, expected, fix, Severity.WARNING))


def open_store(environment: Mapping[str, str] = os.environ, warn: Warn = ignore_warning) -> Store:
    """The store of stage results, at the place and with the bound that the environment names. Raises InputError."""
    try:
        folder = cache_folder(environment)
    except RuntimeError:  # no home folder: the user is warned when something is to be kept
        folder = Path(os.devnull, "physgen")
    most = MOST_BYTES
    if text := environment.get("PHYSGEN_CACHE_BYTES", ""):
        match = _BYTES.fullmatch(text.strip())
        if match is None:
            fix = "write e.g. 20e9 or 20GB; 0 keeps nothing"
            raise InputError.of("PHYSGEN_CACHE_BYTES", f'"{text}"', "is not a number of bytes", fix)
        power = " KMGT".index(match["unit"].upper() or " ")
        most = int(min(float(match["number"]) * 1000.0**power, 1e18))
    return Store(folder / "stages", most, warn)
