"""Keys of results that a process keeps, and of clips on disk: hashes of everything that they depend on."""

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
    """`stage` and the SHA-256 of `parts`: plain data, arrays, dataclasses, enumerations; order of keys does not count.

    Raises TypeError for anything else, ValueError for what is no number.
    """
    text = json.dumps(
        [_plain(part) for part in parts],
        sort_keys=True,
        ensure_ascii=False,
        allow_nan=False,
    )
    return f"{stage}-{sha256(text.encode()).hexdigest()}"


def motion_key(world: World) -> str:
    """The key of a world's motion at the times of its frames, in this process."""
    return key("motion", world)


@cache
def code_version(rooms: Sequence[str]) -> dict[str, str]:
    """Versions of what computes: physgen's sources in its folder and in those of `rooms`, Python, libraries, machine.

    Worked out once a process. Raises ValueError for a room that is none.
    """
    home = os.path.dirname(physgen.__file__)
    sources = [entry.path for entry in os.scandir(home)]
    for room in rooms:
        if not os.path.isdir(os.path.join(home, room)):
            raise ValueError(f"physgen has no room {room}")
        for folder, _, names in os.walk(
            os.path.join(home, room)
        ):  # half the time of Path.rglob
            sources += [os.path.join(folder, name) for name in names]
    found = sha256()
    for path in sorted(path for path in sources if path.endswith(".py")):
        with open(path, "rb") as file:
            text = file.read()
        found.update(f"{path[len(home) :]} {len(text)}\n".encode() + text)
    libraries = {
        name: number for name, number in versions().items() if name != "av"
    }  # it only encodes: see `mark`
    return {**libraries, "machine": platform.machine(), "sources": found.hexdigest()}


def _plain(value: Any) -> Any:
    """As JSON data; numbers that are equal are alike, however they were written."""
    if value is None or isinstance(value, (str, bool)):
        return value
    if isinstance(value, Enum):
        return value.value
    if isinstance(value, (int, float)):
        if value in (inf, -inf):
            return {"": str(value)}
        return float(value) + 0.0 if abs(value) < 2**53 else value
    if isinstance(value, np.ndarray):
        data = np.ascontiguousarray(value)
        return {
            "": "array",
            "type": data.dtype.str,
            "size": data.shape,
            "data": sha256(data.data).hexdigest(),
        }
    if is_dataclass(value) and not isinstance(value, type):
        kind = type(value).__name__
        return {"": kind} | {
            field.name: _plain(getattr(value, field.name)) for field in fields(value)
        }
    if isinstance(value, Mapping):
        return {str(name): _plain(part) for name, part in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(part) for part in value]
    raise TypeError(f"{type(value).__name__} is not plain data")
