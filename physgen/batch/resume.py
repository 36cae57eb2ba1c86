"""Decide whether a clip on disk is complete and made of the same inputs, so that it need not be made again."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Mapping, Sequence
from functools import cache
from hashlib import sha256
from pathlib import Path
from typing import Any

from physgen.problems import Place, Problem, Severity

CODE = (
    "compile",
    "export",
    "geometry",
    "perceive",
    "pipeline",
    "refine",
    "render",
    "report",
    "scene",
    "simulate",
)
"""Rooms whose code makes clips and their pages."""


def mark(*asked: Any) -> str:
    """Of what a command asks of a clip, as plain data, and of the code that makes it; not of files that are read."""
    from physgen.pipeline.cache_keys import code_version, key
    from physgen.report.record import versions

    return key("clip", code_version(CODE), data_version(), versions(), *asked)


@cache
def data_version() -> str:
    """SHA-256 of all that comes with the code: schema, templates, tables, networks; worked out once a process."""
    import physgen
    from physgen.files import resource

    found = sha256()
    package = Path(physgen.__file__).parent
    beside = [path for path in package.rglob("*") if path.suffix in (".yaml", ".json", ".onnx")]
    shipped = [path for folder in ("schemas", "templates") for path in Path(str(resource(folder))).rglob("*")]
    for path in sorted(path for path in (*beside, *shipped) if path.is_file()):
        found.update(f"{path.name} ".encode() + path.read_bytes())
    return found.hexdigest()


def finished(folder: Path, mark: str, scene: Path, digest: Callable[[Path], str]) -> Mapping[str, Any] | None:
    """The manifest of the clip in `folder`, None where it is not there, is damaged, or was made of something else.

    `scene` is the file of its scene; `digest` gives a file's SHA-256.
    """
    try:
        told = made_of_the_same((folder / "manifest.json").read_bytes(), mark, scene, digest)
        if told is None or any(_unlike(folder / name, sha) for name, sha in told["files"].items()):
            return None
        return told
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        return None


def made_of_the_same(
    manifest: bytes, mark: str, scene: Path, digest: Callable[[Path], str]
) -> Mapping[str, Any] | None:
    """What a clip's manifest tells, None where the clip was made of something else.

    Raises OSError, ValueError, KeyError, TypeError or AttributeError where it is none, or an input cannot be read.
    """
    told: Mapping[str, Any] = json.loads(manifest)
    if told["manifest"] != 1 or told["mark"] != mark or not told["frames"]:
        return None
    home = scene.parent.resolve()
    inputs: Mapping[str, str] = told["inputs"]
    led_to = [scene, *([home / told["document"]["image"]] if "image" in told["document"] else [])]
    if any(_beside(home, path) not in inputs for path in led_to):  # a link that leads elsewhere now
        return None
    if any(digest(Path(os.path.normpath(home / name))) != sha for name, sha in inputs.items()):
        return None
    return None if set(_maps(home, told["document"])) - inputs.keys() else told


def _maps(home: Path, document: Mapping[str, Any]) -> Sequence[str]:
    """Those that are there now: one that is new changes the clip, too."""
    if "image" not in document or "assets" not in document:
        return ()
    folder = os.path.realpath(home / document["assets"])
    return [_beside(home, Path(entry.path)) for entry in os.scandir(folder) if entry.name.endswith(".png")]


def _beside(home: Path, path: Path) -> str:
    """As manifests name files: where it leads to, relative to the scene's folder."""
    return Path(os.path.relpath(os.path.realpath(path), home)).as_posix()


def _unlike(file: Path, sha: str) -> bool:
    return not file.is_file() or sha256(file.read_bytes()).hexdigest() != sha  # a pipe never ends


def warnings(told: Mapping[str, Any]) -> list[Problem]:
    """What was odd about a clip when it was made; told again when it is found."""
    found = []
    for said in told["warnings"]:
        place = Place(str(said["file"]), int(said["line"]), int(said["column"]))
        path, what, expected, fix = (str(said[name]) for name in ("path", "found", "expected", "fix"))
        found.append(Problem(place, path, what, expected, fix, Severity.WARNING))
    return found
