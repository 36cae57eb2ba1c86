"""A store's folder -> what is kept in it; and the least recently used entries, and what killed runs left, gone."""

from __future__ import annotations

import os
import shutil
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from uuid import uuid4

from physgen.cache.locks import LEASE, alone, freed
from physgen.cache.sealed import size_of


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
    with alone(root):
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
        freed(lease)
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
                freed(lease)
                gained += size_of(left)
                shutil.rmtree(left, ignore_errors=True)
            finally:
                os.close(lease)
    return gained
