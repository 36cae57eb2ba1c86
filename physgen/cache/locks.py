"""Locks on files of the store, which end with the process however that ends; and what stands for them elsewhere.

`flock` works on local disks, and on NFS where its lock service runs. Where a file system knows no locks, nobody can
tell whether a file is in use: what was touched within a day is held to be.
"""

from __future__ import annotations

import errno
import fcntl
import os
import time
from collections.abc import Iterator
from contextlib import contextmanager
from enum import IntFlag
from pathlib import Path

LEASE, LOCK = "lease", ".lock"
"""Of an entry, and of the store."""
NONE = {errno.ENOLCK, errno.ENOTSUP, errno.EOPNOTSUPP, errno.ENOSYS}
"""What a file system says that knows no locks."""
DAY = 86400.0
"""s."""


class How(IntFlag):
    """Of a lock that is asked for."""

    SHARED = fcntl.LOCK_SH
    """With others who read."""
    ALONE = fcntl.LOCK_EX
    NOW = fcntl.LOCK_NB
    """Not waiting for others."""


def held(descriptor: int, how: How) -> bool:
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


def freed(lease: int) -> None:
    """Nobody uses what the lease stands for, as far as can be told. Raises BlockingIOError where somebody does."""
    if not held(lease, How.ALONE | How.NOW) and time.time() - os.fstat(lease).st_mtime < DAY:
        raise BlockingIOError(errno.EWOULDBLOCK, "may be in use")


@contextmanager
def alone(root: Path) -> Iterator[None]:
    """Alone, among all processes, with what a store's folder lists; without locks, with anybody. Raises OSError."""
    lock = os.open(root / LOCK, os.O_CREAT | os.O_RDWR, 0o600)
    try:
        held(lock, How.ALONE)
        yield
    finally:
        os.close(lock)
