"""What killed runs leave beside finished results -> gone, and what they had moved aside -> back in its place.

Who fills a folder holds a lock on it, which ends with the process however that ends. Where a file system knows no such
locks, as some shared ones, a leftover goes when it is a day old; so does one of another machine, whose locks may not be
seen here.
"""

from __future__ import annotations

import fcntl
import os
import re
import shutil
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from physgen.whole import machine

_LEFT = re.compile(r"\.(?P<name>.+)\.(?P<process>\d{1,10})-(?P<machine>[0-9a-f]{8})\.(?P<kind>part|old)")
FRESH = 0.5
"""s for which a file without a lock is left alone: whoever writes it may be on another machine."""
MINUTE, DAY = 60.0, 86400.0
"""s after which the number of a process that is gone may be another's."""
_SWEPT: set[Path] = set()


@contextmanager
def in_use(folder: Path) -> Iterator[None]:
    """While the block runs, nobody clears the folder away."""
    lock = None
    with suppress(OSError):
        lock = os.open(folder, os.O_RDONLY)
        fcntl.flock(lock, fcntl.LOCK_EX)  # who clears up may hold it for an instant
    try:
        yield
    finally:
        if lock is not None:
            os.close(lock)


@contextmanager
def cleared(out: Path) -> Iterator[None]:
    """Where the block is left early, what its processes were ended over is cleared away."""
    try:
        yield
    except BaseException:
        sweep(out)
        raise


def sweep_once(out: Path) -> None:
    """As `sweep`, the first time that this process asks: listing a folder of 100,000 clips takes long."""
    if out.resolve() not in _SWEPT:
        _SWEPT.add(out.resolve())
        sweep(out)


def sweep(out: Path) -> None:
    """Clear away what processes that are gone left in `out`."""
    try:
        with os.scandir(out) as entries:
            left = [(entry, match) for entry in entries if (match := _LEFT.fullmatch(entry.name))]
    except OSError:
        return
    for entry, match in sorted(left, key=lambda pair: pair[0].name):
        with suppress(OSError):  # another process may be at it, too
            path, final = Path(entry.path), out / match["name"]
            folder = entry.is_dir(follow_symlinks=False)
            age = time.time() - entry.stat(follow_symlinks=False).st_ctime
            away = match["machine"] != machine()
            dead = age > DAY if away else not _lives(int(match["process"]))
            gone = dead and age > FRESH
            if match["kind"] == "old" and folder and gone:
                if final.exists():
                    shutil.rmtree(path, ignore_errors=True)
                else:
                    path.rename(final)
            elif (
                match["kind"] == "part"
                and folder
                and _is_free(path, dead or (age > MINUTE and not away), age)
            ):
                shutil.rmtree(path, ignore_errors=True)
            elif match["kind"] == "part" and not folder and gone:
                path.unlink(missing_ok=True)


def _is_free(folder: Path, left: bool, age: float) -> bool:
    """Whether nobody fills it, though it looks `left`."""
    lock = os.open(folder, os.O_RDONLY)
    try:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        return left
    except BlockingIOError:
        return False
    except OSError:
        return left and age > DAY
    finally:
        os.close(lock)


def _lives(process: int) -> bool:
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except OSError:
        pass
    return True
