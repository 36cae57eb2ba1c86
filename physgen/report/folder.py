"""An output folder that appears under its final name only when everything in it is written."""

from __future__ import annotations

import glob
import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from physgen.whole import partial


@contextmanager
def whole_folder(final: Path) -> Iterator[Path]:
    """A fresh folder beside `final`, renamed to it at the end; removed, and `final` left as it was, on any error."""
    final.parent.mkdir(parents=True, exist_ok=True)
    _sweep(final)
    beside = partial(final)
    shutil.rmtree(beside, ignore_errors=True)
    beside.mkdir()
    old = final.with_name(f".{final.name}.{os.getpid()}.old")
    try:
        yield beside
        if final.exists():
            final.rename(old)
        beside.rename(final)
    except BaseException:
        shutil.rmtree(beside, ignore_errors=True)
        if old.exists() and not final.exists():
            old.rename(final)
        raise
    shutil.rmtree(old, ignore_errors=True)


def _sweep(final: Path) -> None:
    """Clear away what runs that were killed have left beside `final`; the folder they moved aside comes back."""
    for left in sorted(final.parent.glob(f".{glob.escape(final.name)}.*")):
        number, _, kind = left.name.removeprefix(f".{final.name}.").partition(".")
        if not number.isdecimal() or kind not in ("part", "old") or _lives(int(number)):
            continue
        if kind == "old" and not final.exists():
            left.rename(final)
        else:
            shutil.rmtree(left, ignore_errors=True)


def _lives(process: int) -> bool:
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except OSError:
        pass
    return True
