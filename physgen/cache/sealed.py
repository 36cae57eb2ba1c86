"""Folder -> its index, with sizes and sums of all files; and whether they are still as they were."""

from __future__ import annotations

import json
import zlib
from pathlib import Path

INDEX = "index.json"
VERSION = 1


def seal(folder: Path, but: str) -> None:
    """Write the index of all files but those called `but`. Raises OSError."""
    files = {
        path.relative_to(folder).as_posix(): _sum(path)
        for path in sorted(folder.rglob("*"))
        if path.is_file() and path.name != but
    }
    (folder / INDEX).write_text(json.dumps({"cache": VERSION, "files": files}), encoding="utf-8")


def whole(folder: Path) -> bool:
    """Whether all files are there as they were sealed."""
    try:
        index = json.loads((folder / INDEX).read_bytes())
        return index["cache"] == VERSION and all(_sum(folder / n) == s for n, s in index["files"].items())
    except (OSError, ValueError, KeyError, TypeError, AttributeError, RecursionError):
        return False


def size_of(folder: Path) -> int:
    """Bytes of its files; raises OSError where one goes meanwhile."""
    return sum(path.stat().st_size for path in folder.rglob("*") if path.is_file())


def _sum(path: Path) -> list[int]:
    """Bytes of a file, and their CRC-32."""
    size = check = 0
    with path.open("rb") as file:
        while block := file.read(2**20):
            size, check = size + len(block), zlib.crc32(block, check)
    return [size, check]
