"""Scene files inside packs: a pack is unpacked once per process, to a temporary folder."""

from __future__ import annotations

import hashlib
import os
from collections import OrderedDict
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory

from physgen.files import Stamp, file_stamp
from physgen.problems import name_folder
from physgen.scene.pack_format import is_pack

MOST_UNPACKED = 64
"""Packs that a process has unpacked at a time."""

_KEYS: dict[str, tuple[Stamp, str]] = {}
"""Absolute path of a pack -> its time stamp and its key."""
_UNPACKED: OrderedDict[str, tuple[TemporaryDirectory[str], Path]] = OrderedDict()
"""Key of a pack -> the folder with its files, and its scene file."""


def scene_file(path: str | Path, called: str | None = None) -> Path:
    """The path itself for a scene file; for a pack, the path of its unpacked scene file.

    Messages name a pack `called`, or its path. Raises InputError for a zip that is no pack.
    """
    path = Path(path)
    if not is_pack(path):
        return path
    from physgen.scene.unpack import read_pack

    name, stamp = os.path.abspath(path), file_stamp(path)
    known, key = _KEYS.get(name, (None, ""))
    data = b""
    if known != stamp:
        data = read_pack(path)
        key = pack_key(data)
    found = scene_in(key, lambda: data or read_pack(path), called or str(path))
    _KEYS[name] = stamp, key
    return found


def pack_key(data: bytes) -> str:
    """Identifies a pack by its bytes."""
    return f"pack-{hashlib.sha256(data).hexdigest()[:32]}"


def scene_in(key: str, data: Callable[[], bytes], name: str) -> Path:
    """The scene file of the pack with that key, unpacked from its `data` where needed. Raises InputError."""
    from physgen.scene.unpack import unpack_to

    if key not in _UNPACKED or not _UNPACKED[key][1].is_file():
        folder = TemporaryDirectory(prefix="physgen-")
        _UNPACKED[key] = folder, unpack_to(data(), Path(folder.name, "files"), name)
    _UNPACKED.move_to_end(key)
    while len(_UNPACKED) > MOST_UNPACKED:
        _UNPACKED.popitem(last=False)[1][0].cleanup()
    folder, scene = _UNPACKED[key]
    name_folder(Path(folder.name, "files"), name)
    return scene
