"""Bytes -> a file that holds them even when the power goes: beside, to the disk, then renamed; its rights stay."""

from __future__ import annotations

import os
import stat
from contextlib import suppress
from pathlib import Path

from physgen.whole import partial


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
