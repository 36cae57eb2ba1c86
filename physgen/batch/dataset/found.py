"""Folders -> the clips below them, one after the other, each with what its manifest tells."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from physgen.problems import InputError
from physgen.report.folder import seems_clip
from physgen.scene.words import natural

MANIFEST = "manifest.json"


class Found(NamedTuple):
    """A clip's folder."""

    folder: Path
    name: str
    """Its path from above the folder that was named, with `/`: what the clip is called after."""
    told: Mapping[str, Any] | None
    """The manifest; None: it cannot be read."""


def checked(roots: Sequence[Path]) -> list[Path]:
    """Folders that are there, none of them within another. Raises InputError."""
    problems = []
    for root in roots:
        if not root.is_dir():
            fix = "name folders that were rendered or exported into"
            problems += InputError.of(str(root), "", "is no folder", fix).problems
    real = {root: root.resolve() for root in roots}
    for n, root in enumerate(roots):
        for other in roots[:n]:
            if real[root].is_relative_to(real[other]) or real[other].is_relative_to(real[root]):
                expected = f"and {other} hold the same clips"
                problems += InputError.of(str(root), "", expected, "name only one of them").problems
    if problems:
        raise InputError(problems)
    return list(roots)


def clips(roots: Sequence[Path]) -> Iterator[Found]:
    """In the order of `roots`, and in each in the natural order of names; one folder's names are held at a time.

    Folders whose names begin with a dot are passed over, and so is what lies in a clip's.
    """
    for root in roots:
        yield from _below(root, root.resolve().name)


def _below(folder: Path, name: str) -> Iterator[Found]:
    try:
        with os.scandir(folder) as entries:
            inside = [(entry.name, entry.is_dir()) for entry in entries if not entry.name.startswith(".")]
    except PermissionError:
        return
    if (MANIFEST, False) in inside:
        told = _told(folder / MANIFEST)
        if told is None or (told.get("manifest") == 1 and "samples" in told):
            yield Found(folder, name, told)
            return
    if (MANIFEST, False) not in inside and seems_clip(name for name, _ in inside):
        yield Found(folder, name, None)
        return
    for below in sorted((name for name, is_folder in inside if is_folder), key=natural):
        if not _leads_up(folder / below):
            yield from _below(folder / below, f"{name}/{below}")


def _leads_up(folder: Path) -> bool:
    """Whether it is a link to a folder that it lies in: what is there has been found, and there is no end to it."""
    return folder.is_symlink() and folder.parent.resolve().is_relative_to(folder.resolve())


def _told(path: Path) -> Mapping[str, Any] | None:
    """Web pages have a file of that name, too; None: nobody can read it, and it may be ours."""
    try:
        data = json.loads(path.read_bytes())
    except (OSError, ValueError, RecursionError):
        return None
    return data if isinstance(data, dict) else {}
