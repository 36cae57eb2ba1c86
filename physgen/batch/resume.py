"""Decide whether a clip on disk is complete and was made of the same inputs. If so, it
is not made again.

The manifest of a clip holds a mark of all options and of the code, and the hashes of
the input and output files.
"""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Mapping, Sequence
from functools import cache
from hashlib import sha256
from pathlib import Path
from typing import Any

import physgen
from physgen.files import resource
from physgen.pipeline.cache_keys import CODE, code_version, key
from physgen.problems import Place, Problem, Severity
from physgen.report.record import versions
from physgen.scene.files import DATA


def clip_mark(*options: Any) -> str:
    """Return the hash of a clip's options, as plain data, and of the code. The input
    files are not part of it.
    """
    return key("clip", code_version(CODE), _data_version(), versions(), *options)


@cache
def _data_version() -> str:
    """Return the SHA-256 of the package data: schema, templates, tables."""
    digest = sha256()
    package = Path(physgen.__file__).parent
    package_data = []
    for path in package.rglob("*"):
        if path.suffix in (".yaml", ".json"):
            package_data.append(path)
    shipped_data = [
        path
        for folder in ("schemas", "templates")
        for path in Path(str(resource(folder))).rglob("*")
    ]
    for path in sorted(
        path for path in (*package_data, *shipped_data) if path.is_file()
    ):
        digest.update(f"{path.name} ".encode() + path.read_bytes())
    return digest.hexdigest()


def unchanged_clip(
    folder: Path, mark: str, scene: Path, digest: Callable[[Path], str]
) -> Mapping[str, Any] | None:
    """Return the manifest of the clip in `folder`, or None if it is missing, damaged,
    or made of other inputs.

    `scene` is its scene file; `digest` returns a file's SHA-256.
    """
    try:
        manifest: Mapping[str, Any] = json.loads(
            (folder / "manifest.json").read_bytes()
        )
        if not unchanged_inputs(manifest, mark, scene, digest):
            return None
        for name, sha in manifest["files"].items():
            # Reading a pipe never ends, so that only regular files are read.
            file = folder / name
            if not file.is_file() or sha256(file.read_bytes()).hexdigest() != sha:
                return None
        return manifest
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        return None


def unchanged_inputs(
    manifest: Mapping[str, Any], mark: str, scene: Path, digest: Callable[[Path], str]
) -> bool:
    """Return whether the clip would have the same inputs, options and code now.

    Raise OSError, ValueError, KeyError, TypeError or AttributeError for a damaged
    manifest or a missing input.
    """
    if manifest["manifest"] != 1 or manifest["mark"] != mark or not manifest["frames"]:
        return False
    home = scene.parent.resolve()
    inputs: Mapping[str, str] = manifest["inputs"]
    document = manifest["document"]
    input_files = [scene, *([home / document["image"]] if "image" in document else [])]
    # Manifests name the targets of links: a link may have another target now.
    if any(_relative(home, path) not in inputs for path in input_files):
        return False
    if any(
        digest(Path(os.path.normpath(home / name))) != sha
        for name, sha in inputs.items()
    ):
        return False
    # A new map in the assets also changes the clip.
    return not set(_maps(home, document)) - inputs.keys()


def _maps(home: Path, document: Mapping[str, Any]) -> Sequence[str]:
    """Return the maps and records of the assets folder, as manifests name them."""
    if "image" not in document or "assets" not in document:
        return ()
    folder = os.path.realpath(home / document["assets"])
    map_files = []
    for entry in os.scandir(folder):
        if entry.name.endswith(".png") or entry.name in DATA:
            map_files.append(entry)
    return [_relative(home, Path(entry.path)) for entry in map_files]


def _relative(home: Path, path: Path) -> str:
    """Return a path as manifests name it: the target of links, relative to the scene's
    folder.
    """
    return Path(os.path.relpath(os.path.realpath(path), home)).as_posix()


def recorded_warnings(manifest: Mapping[str, Any]) -> list[Problem]:
    """Return the warnings of the earlier run."""
    warnings = []
    for data in manifest["warnings"]:
        place = Place(str(data["file"]), int(data["line"]), int(data["column"]))
        path, value_text, expected, fix = (
            str(data[name]) for name in ("path", "found", "expected", "fix")
        )
        code = str(data.get("code", ""))
        warning = Problem(
            place, path, value_text, expected, fix, Severity.WARNING, code=code
        )
        warnings.append(warning)
    return warnings
