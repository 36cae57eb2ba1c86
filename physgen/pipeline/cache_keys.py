"""Keys of results in memory and of clips on disk: hashes of all their inputs."""

from __future__ import annotations

import json
import os
import platform
from collections.abc import Mapping, Sequence
from dataclasses import fields, is_dataclass
from enum import Enum
from functools import cache
from hashlib import sha256
from math import inf
from typing import Any

import numpy as np

import physgen
from physgen.compile.world import World
from physgen.report.record import versions

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
    "sound",
)
"""Packages whose code makes clips and their pages."""


def key(stage: str, *parts: Any) -> str:
    """Return `stage` and the SHA-256 of `parts`.

    `parts` are plain data, arrays, dataclasses and enumerations; the order of
    dictionary keys has no effect. Raises TypeError for other classes, ValueError for
    NaN.
    """
    text = json.dumps(
        list(map(_to_plain_data, parts)),
        sort_keys=True,
        ensure_ascii=False,
        allow_nan=False,
    )
    return f"{stage}-{sha256(text.encode()).hexdigest()}"


def motion_key(world: World) -> str:
    """Return the key of a world's motion at the times of its frames, in this
    process.
    """
    return key("motion", world)


def _source_files(package_root: str, rooms: Sequence[str]) -> list[str]:
    """Return the sorted paths of Python files in the folder and in its packages `rooms`.

    Raises ValueError for an unknown package.
    """
    paths = [entry.path for entry in os.scandir(package_root)]
    for room in rooms:
        if not os.path.isdir(os.path.join(package_root, room)):
            raise ValueError(f"physgen has no room {room}")
        # os.walk takes half the time of Path.rglob.
        for folder, _, names in os.walk(os.path.join(package_root, room)):
            paths += [os.path.join(folder, name) for name in names]
    return sorted(path for path in paths if path.endswith(".py"))


@cache
def code_version(rooms: Sequence[str]) -> dict[str, str]:
    """Return the versions of all code with influence on results.

    These are physgen's sources in its folder and in the packages `rooms`, Python, the
    libraries, and the machine. Computed once per process. Raises ValueError for an
    unknown package.
    """
    package_root = os.path.dirname(physgen.__file__)
    digest = sha256()
    for path in _source_files(package_root, rooms):
        with open(path, "rb") as file:
            text = file.read()
        digest.update(f"{path[len(package_root) :]} {len(text)}\n".encode() + text)
    # PyAV only encodes the computed frames: `RenderOptions.mark` has its version.
    libraries = {}
    for name, number in versions().items():
        if name != "av":
            libraries[name] = number
    return {**libraries, "machine": platform.machine(), "sources": digest.hexdigest()}


def _to_plain_data(value: Any) -> Any:
    """Convert a value to JSON data; equal numbers give equal data, whatever
    their type.
    """
    if value is None or isinstance(value, (str, bool)):
        return value
    if isinstance(value, Enum):
        return value.value
    if isinstance(value, (int, float)):
        if value in (inf, -inf):
            return {"": str(value)}
        # Adding 0.0 turns -0.0 into 0.0. Larger integers are not exact as floats.
        if abs(value) < 2**53:
            return float(value) + 0.0
        return value
    # A hash of the bytes stands for an array, with type and size, since equal bytes may
    # be other numbers.
    if isinstance(value, np.ndarray):
        data = np.ascontiguousarray(value)
        return {
            "": "array",
            "type": data.dtype.str,
            "size": data.shape,
            "data": sha256(data.data).hexdigest(),
        }
    # The name of the class is part of the key: two classes with equal fields are
    # different values.
    if is_dataclass(value) and not isinstance(value, type):
        kind = type(value).__name__
        return {"": kind} | {
            field.name: _to_plain_data(getattr(value, field.name))
            for field in fields(value)
        }
    if isinstance(value, Mapping):
        return {str(name): _to_plain_data(part) for name, part in value.items()}
    if isinstance(value, (list, tuple)):
        return list(map(_to_plain_data, value))
    raise TypeError(f"{type(value).__name__} is not plain data")
