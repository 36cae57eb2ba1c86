"""Format of packs: names, sizes and the contents page."""

from __future__ import annotations

import json
import stat
import unicodedata
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

SUFFIX = ".physgen"
CONTENTS = "pack.json"
"""The first member: which of the others is the scene."""
VERSION = 1
SCENES = (".yaml", ".yml")

MOST_FILES = 10_000
MOST_FOLDERS = 10_000
"""Distinct ones that the names lead through."""
DEEPEST = 32
"""Parts of a name: folders one in another, and a file."""
LONGEST, LONGEST_PART = 1024, 255
"""Bytes of a name, and of what stands between two strokes in it."""
MOST_CONTENTS = 2**16
"""Bytes of the contents page."""
MOST_PICTURE = 800 * 2**20
"""Bytes of a file of a picture: 100 megapixels of 4 channels of 16 bits, not compressed."""
MOST_WHOLE = 2 * 2**30
"""Bytes of all files together, and of the pack."""
MAGIC = b"PK\x03\x04"


@dataclass(frozen=True)
class Fault:
    """Why a file cannot be in a pack."""

    name: str
    expected: str
    fix: str


def is_pack(path: Path) -> bool:
    """Whether a file is one by its ending, or a zip by its first bytes."""
    try:
        if not stat.S_ISREG(path.stat().st_mode):
            return False
        with path.open("rb") as file:
            return path.suffix == SUFFIX or file.read(len(MAGIC)) == MAGIC
    except (OSError, ValueError):
        return False


def is_ours(path: Path) -> bool:
    """Whether a file is a pack as we write them: a zip whose first member is the contents page."""
    if not is_pack(path):
        return False
    try:
        with path.open("rb") as file:
            begin = file.read(30 + len(CONTENTS))
    except OSError:
        return False
    return begin.startswith(MAGIC) and begin[30:] == CONTENTS.encode()


def contents(scene: str) -> bytes:
    """The contents page of a pack whose scene file is called `scene` in it."""
    return (json.dumps({"pack": VERSION, "scene": scene}, ensure_ascii=False) + "\n").encode("utf-8")


def fault_of(name: str) -> Fault | None:
    """What is wrong with the name of a file or a folder: it must mean the same below any folder, on any system."""
    if not name or not name.isprintable():
        return Fault(name, "has a name with characters that cannot be shown", "rename it")
    parts = name.split("/")
    if len(name.encode()) > LONGEST or max(len(part.encode()) for part in parts) > LONGEST_PART:
        return Fault(name, "has too long a name", "rename it")
    if len(parts) > DEEPEST:
        return Fault(name, f"lies more than {DEEPEST} folders deep", "move it up")
    if name.startswith("/") or name[1:2] == ":":
        return Fault(name, "is an absolute name", "names in a pack are relative")
    if "\\" in name:
        return Fault(name, "has a backslash in its name", "rename it")
    if any(part in ("", ".", "..") for part in parts):
        return Fault(name, "leads out of its folder, or round about", "names in a pack lead straight down")
    return None


def clash_of(names: Iterable[str]) -> Fault | None:
    """Two names that some file systems take for one, a file that stands where another needs a folder, or the name with
    which folders are too many.

    Names of folders end with a stroke.
    """
    taken: dict[str, tuple[str, bool]] = {}
    folders: set[str] = set()
    for name in names:
        whole = PurePosixPath(name)
        for path in (whole, *whole.parents[:-1]):
            is_file, text = path == whole and not name.endswith("/"), str(path)
            if text in folders and not is_file:  # and so are those above it
                break
            key = unicodedata.normalize("NFC", text).casefold()
            other, was_file = taken.setdefault(key, (text, is_file))
            if other != text:
                expected = f"differs from {other} in capitals or accents alone, which some disks take for one"
                return Fault(text, expected, "rename one of the two")
            if was_file != is_file:
                return Fault(text, "is a file, and a folder too", "rename one of the two")
            if not is_file:
                folders.add(text)
            if len(folders) > MOST_FOLDERS:
                return Fault(
                    text, f"is one folder more than the {MOST_FOLDERS:,} of a pack", "pack fewer variants"
                )
    return None
