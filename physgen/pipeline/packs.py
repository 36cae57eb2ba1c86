"""Scene files inside packs: a pack is unpacked once per process, to a temporary folder."""

from __future__ import annotations

import os
import shutil
from collections import OrderedDict
from itertools import count
from pathlib import Path

from physgen.files import Stamp, file_stamp
from physgen.problems import name_folder
from physgen.report.folders import process_folder
from physgen.scene.unpack import is_pack

MAX_UNPACKED = 64
"""Packs that a process has unpacked at a time."""

_UNPACKED: OrderedDict[tuple[str, Stamp], tuple[Path, Path]] = OrderedDict()
"""Absolute path and stamp of a pack -> the folder with its files, and its scene file."""
_NUMBERS = count()


def scene_file(path: str | Path) -> Path:
    """The path itself for a scene file; for a pack, the path of its unpacked scene file.

    Messages name the pack. Raises InputError for a zip that is no pack.
    """
    path = Path(path)
    if not is_pack(path):
        return path
    from physgen.scene.unpack import read_pack, unpack_to

    key, name = (os.path.abspath(path), file_stamp(path)), str(path)
    if key not in _UNPACKED or not _UNPACKED[key][1].is_file():
        folder = process_folder() / f"pack-{next(_NUMBERS)}"
        _UNPACKED[key] = folder, unpack_to(read_pack(path), folder, name)
    _UNPACKED.move_to_end(key)
    while len(_UNPACKED) > MAX_UNPACKED:
        shutil.rmtree(_UNPACKED.popitem(last=False)[1][0], ignore_errors=True)
    folder, scene = _UNPACKED[key]
    name_folder(folder, name)
    return scene
