"""Keys of cached results: hashes of everything that they depend on."""

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
from pathlib import Path
from typing import Any

import numpy as np

import physgen
from physgen.compile.world import World
from physgen.report.record import file_hash, versions
from physgen.scene.files import MAPS
from physgen.scene.scene import Scene

ROOMS = ("compile", "geometry", "perceive", "pipeline", "render", "scene", "simulate")
"""Packages whose code makes unrefined frames; `perceive` fills what objects leave behind."""
AFTERWARDS = {
    "Scene": {"name", "folder", "image", "assets", "refine", "places", "document", "variants", "files", "record"},
    "Render": {"overlay", "play"},
    "Object": {"label", "provenance", "prompt"},
    "Light": {"provenance"},
}  # fmt: skip
"""What a scene says that no unrefined frame shows. The photo and its maps count by their bytes, not by their names."""
FORMAT = 3
"""Counted up when an entry of frames is laid out in another way."""


def key(stage: str, *parts: Any) -> str:
    """`stage` and the SHA-256 of `parts`: plain data, arrays, dataclasses, enumerations; order of keys does not count.

    Raises TypeError for anything else, ValueError for what is no number.
    """
    text = json.dumps([_plain(part) for part in parts], sort_keys=True, ensure_ascii=False, allow_nan=False)
    return f"{stage}-{sha256(text.encode()).hexdigest()}"


def motion_key(world: World) -> str:
    """The key of a world's motion at the times of its frames, in this process."""
    return key("motion", world)


def guidance_key(scene: Scene, inputs: Mapping[str, str]) -> str:
    """The key of a scene's unrefined frames in the order of the motion.

    `inputs`: SHA-256 of the files that were read, by path relative to the scene's folder, see `report.record.inputs`.
    Neither `refine` counts nor what is drawn after it, nor the order of playing, nor anything of the file but what it
    means.
    """
    folder = scene.folder.resolve()

    def digest(file: Path) -> str:
        name = Path(os.path.relpath(file.resolve(), folder)).as_posix()
        return inputs[name] if name in inputs else file_hash(file)

    files = {} if scene.image is None else {"image": digest(scene.image)}
    if scene.image is not None and scene.assets is not None:
        paths = {name: scene.assets / f"{name}.png" for name in MAPS}
        files |= {name: digest(path) for name, path in paths.items() if path.is_file()}
    return key("guidance", FORMAT, code_version(ROOMS), files, scene)


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
        for folder, _, names in os.walk(os.path.join(home, room)):  # half the time of Path.rglob
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
        named = {
            field.name: _plain(getattr(value, field.name))
            for field in fields(value)
            if field.name not in AFTERWARDS.get(kind, ())
        }
        return {"": kind, **named}
    if isinstance(value, Mapping):
        return {str(name): _plain(part) for name, part in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(part) for part in value]
    raise TypeError(f"{type(value).__name__} is not plain data")
