"""An output folder that appears under its final name only when everything in it is written."""

from __future__ import annotations

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
