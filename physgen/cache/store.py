"""Key -> folder of an entry, on disk between runs, for many processes at once; the least recently used go first.

An entry is a folder under its key. It is filled under another name and renamed when it is whole, with sizes and sums of
its files, so that what was cut short or damaged counts as not there. Who reads or fills one holds a lock on its `lease`
(see `locks`); only folders whose lease nobody holds are removed.
"""

from __future__ import annotations

import os
import re
import shutil
import tempfile
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path

from physgen.cache.clearing import Entry, Freed, entries, remove, shrink, sweep
from physgen.cache.locks import LEASE, How, alone, held
from physgen.cache.sealed import seal, size_of, whole
from physgen.problems import InputError, Place, Problem, Severity, Warn, unheard

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

    def __init__(self, root: Path, most_bytes: int = MOST_BYTES, warn: Warn = unheard) -> None:
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
            held(lease, How.SHARED | How.NOW)
            if os.fstat(lease).st_ino != os.stat(folder / LEASE).st_ino:  # removed, and made anew, meanwhile
                raise FileNotFoundError(folder)
        except OSError:
            os.close(lease)
            return None
        if not whole(folder):
            os.close(lease)
            self._discard(key)
            return None
        with suppress(OSError):  # a folder that can only be read
            os.utime(lease)
        return lease

    def _discard(self, key: str) -> None:
        """What is not whole goes, if there is anything."""
        if (self.root / key).is_dir():
            with suppress(OSError), alone(self.root):
                remove(self.root, key)

    def _begun(self, key: str) -> tuple[Path, int]:
        """A folder of our own, and its lease, which nobody else has."""
        self.root.mkdir(parents=True, exist_ok=True, mode=0o700)  # photos may be private
        with alone(self.root):
            if self.root not in _SWEPT:
                _SWEPT.add(self.root)
                sweep(self.root)
            folder = Path(tempfile.mkdtemp(prefix=f".{key}.", suffix=".part", dir=self.root))
            try:
                lease = os.open(folder / LEASE, os.O_CREAT | os.O_RDWR, 0o600)
                held(lease, How.ALONE)
            except OSError:
                shutil.rmtree(folder, ignore_errors=True)
                raise
        return folder, lease

    def _due(self, grown: int) -> bool:
        """Whether so many bytes more make it time to look for what is too much: looking means listing every entry."""
        with alone(self.root):
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
        with alone(self.root):
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


def opened(environment: Mapping[str, str] = os.environ, warn: Warn = unheard) -> Store:
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
