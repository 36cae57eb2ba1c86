"""A folder whose sweep.json was harmed, as by a power cut -> which of its files a sweep of ours wrote.

A file that holds nothing is nobody's loss. Any other is ours only where clips of the sweep that is asked for, or the
heading of its table, lie beside it; what is whole and somebody else's is never among them.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

from physgen.batch.sweep import Sweep

ASKED, TABLE, PARQUET = "sweep.json", "sweep.csv", "sweep.parquet"
BLOCK = 2**16
MOST = 2**24
"""Bytes of a manifest or of a sweep.json that are read."""
HEADING = b"number,name,variant,folder,"
"""That a table of ours begins with."""
MOST_LOOKED = 1000
"""Folders beside it that are looked into."""


def harmed_files(folder: Path, sweep: Sweep) -> tuple[str, ...]:
    """Names of those that may be made anew; none where `sweep.json` is not there, or is somebody's and whole."""
    path = folder / ASKED
    if not path.is_file() or not (is_blank(path) or _cut(path)):
        return ()
    table = folder / TABLE
    headed = any(_begins(file, HEADING) for file in (table, folder / "sweep.part.csv"))
    ours = headed or any(_is_clip(place, sweep) for place in _places(folder))
    found = [ASKED] if ours or is_blank(path) else []
    found += [TABLE] if _begins(table, HEADING) or is_blank(table) else []
    parquet = folder / PARQUET
    found += [PARQUET] if is_blank(parquet) or (ours and _begins(parquet, b"PAR1")) else []
    return tuple(found)


def is_blank(path: Path) -> bool:
    """Whether a file has no bytes but zeros: what some disks leave of one whose bytes they never had."""
    if not path.is_file():
        return False
    with path.open("rb") as file:
        return not any(block.strip(b"\0") for block in iter(lambda: file.read(BLOCK), b""))


def _cut(path: Path) -> bool:
    """Whether it is not JSON, or not to its end."""
    try:
        json.loads(path.read_bytes() if path.stat().st_size <= MOST else b"0")
    except (ValueError, RecursionError):
        return True
    return False


def _begins(path: Path, begin: bytes) -> bool:
    if not path.is_file():
        return False
    with path.open("rb") as file:
        return file.read(len(begin)) == begin


def _places(folder: Path) -> Iterator[Path]:
    for count, place in enumerate(folder.iterdir()):
        if count == MOST_LOOKED:
            return
        if place.is_dir():
            yield place


def _is_clip(place: Path, sweep: Sweep) -> bool:
    """Whether it has the name and the manifest of a clip of the sweep."""
    path = place / "manifest.json"
    if sweep.find(place.name) is None or not path.is_file() or path.stat().st_size > MOST:
        return False
    try:
        told = json.loads(path.read_bytes())
    except (ValueError, RecursionError):
        return False
    return isinstance(told, dict) and told.get("manifest") == 1 and "samples" in told
