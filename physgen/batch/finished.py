"""A clip to be made -> whether it is there already, made of the same, whole and undamaged: then nothing is to be done.

The manifest of a clip holds a mark of all that the command asked of it, and of the code; and the hashes of the files
that it was made from, and of those that it consists of.
"""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from physgen.problems import Place, Problem, Severity

CODE = (
    "cache", "clips", "compile", "export", "outline", "perceive", "percepts", "pipeline", "refine", "render", "report",
    "scene", "shadow", "simulate",
)  # fmt: skip
"""Rooms whose code makes clips and their pages."""


def mark(*asked: Any) -> str:
    """Of what a command asks of a clip, as plain data, and of the code that makes it; not of files that are read."""
    from physgen.cache.keys import code_version, key

    return key("clip", code_version(CODE), *asked)


def finished(folder: Path, mark: str, scene: Path, digest: Callable[[Path], str]) -> Mapping[str, Any] | None:
    """The manifest of the clip in `folder`, None where it is not there, is damaged, or was made of something else.

    `scene` is the file of its scene; `digest` gives a file's SHA-256.
    """
    try:
        told: Mapping[str, Any] = json.loads((folder / "manifest.json").read_bytes())
        if told["manifest"] != 1 or told["mark"] != mark or not told["frames"]:
            return None
        home = scene.parent.resolve()
        inputs: Mapping[str, str] = told["inputs"]
        if any(digest(Path(os.path.normpath(home / name))) != sha for name, sha in inputs.items()):
            return None
        if set(_maps(home, told["document"])) - inputs.keys():
            return None
        files: Mapping[str, str] = told["files"]
        if any(_unlike(folder / name, sha) for name, sha in files.items()):
            return None
        return told
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        return None


def _maps(home: Path, document: Mapping[str, Any]) -> Sequence[str]:
    """Those that are there now: one that is new changes the clip, too."""
    if "image" not in document or "assets" not in document:
        return ()
    folder = os.path.realpath(home / document["assets"])
    names = (entry.path for entry in os.scandir(folder) if entry.name.endswith(".png"))
    return [Path(os.path.relpath(os.path.realpath(name), home)).as_posix() for name in names]


def _unlike(file: Path, sha: str) -> bool:
    from hashlib import sha256

    return sha256(file.read_bytes()).hexdigest() != sha


def warnings(told: Mapping[str, Any]) -> list[Problem]:
    """What was odd about a clip when it was made; told again when it is found."""
    found = []
    for said in told["warnings"]:
        place = Place(str(said["file"]), int(said["line"]), int(said["column"]))
        path, what, expected, fix = (str(said[name]) for name in ("path", "found", "expected", "fix"))
        found.append(Problem(place, path, what, expected, fix, Severity.WARNING))
    return found
