"""Path of a scene or a pack -> path of the scene file, a pack's own among its files in a folder of the cache.

That folder is named by the pack's bytes, checked each time it is opened, and held as long as the process may read it.
"""

from __future__ import annotations

import atexit
import hashlib
import os
import tempfile
from collections import OrderedDict
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from physgen.files import Stamp, file_stamp
from physgen.problems import call
from physgen.scene.pack_format import is_pack

if TYPE_CHECKING:
    from physgen.pipeline.cache import Store


MOST_HELD = 64
"""Packs that a process holds at a time: each costs it an open file."""
FILES, SCENE = "files", "scene.txt"
"""Of an entry of the cache: what was in the pack, and the name of the scene among it."""


class _Held(NamedTuple):
    """What a pack was unpacked to."""

    stack: ExitStack
    """Keeps it there."""
    files: Path
    """Folder of all that was in it."""
    scene: Path


_KNOWN: dict[str, tuple[Stamp, str]] = {}
"""Absolute path of a pack -> when it was written, and the key of its entry."""
_HELD: OrderedDict[tuple[str, str], _Held] = OrderedDict()


def scene_file(path: str | Path, called: str | None = None) -> Path:
    """The same path for a scene file; messages tell of a pack as it is `called`, by its path unless that is given.

    Raises InputError for a zip that is no pack.
    """
    path = Path(path)
    if not is_pack(path):
        return path
    from physgen.scene.unpack import read_pack

    name, stamp = os.path.abspath(path), file_stamp(path)
    told, key = _KNOWN.get(name, (None, ""))
    data = b""
    if told != stamp:
        data = read_pack(path)
        key = pack_key(data)
    found = scene_in(key, lambda: data or read_pack(path), called or str(path))
    _KNOWN[name] = stamp, key
    return found


def pack_key(data: bytes) -> str:
    """What the bytes of a pack are known by."""
    return f"pack-{hashlib.sha256(data).hexdigest()[:32]}"


def scene_in(key: str, data: Callable[[], bytes], name: str) -> Path:
    """The scene file of the pack of that key, unpacked from its `data` unless it is there. Raises InputError."""
    from physgen.pipeline.cache import open_store

    store = open_store()
    held = _HELD.pop((str(store.root), key), None)
    if held is None and not _HELD:
        atexit.register(_let_go)
    if held is None or not held.scene.is_file():
        held = _opened(store, key, data, name)
    _HELD[str(store.root), key] = held
    while len(_HELD) > MOST_HELD:
        _HELD.popitem(last=False)[1].stack.close()
    call(held.files, name)
    return held.scene


def _let_go() -> None:
    """While there still is somebody to close files."""
    while _HELD:
        _HELD.popitem()[1].stack.close()


def _opened(store: Store, key: str, data: Callable[[], bytes], name: str) -> _Held:
    """In the cache, or where nothing is kept in a folder of this process."""
    with ExitStack() as stack:
        folder = stack.enter_context(store.find(key))
        if folder is None:
            _kept(store, key, data(), name)
            folder = stack.enter_context(store.find(key))
        if folder is not None:
            files = folder / FILES
            scene = files / (folder / SCENE).read_text(encoding="utf-8")
        else:
            files = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="physgen-")), FILES)
            from physgen.scene.unpack import unpack_to

            scene = unpack_to(data(), files, name)
        return _Held(stack.pop_all(), files, scene)


def _kept(store: Store, key: str, data: bytes, name: str) -> None:
    """Unpacks it into the cache, where that can be written."""
    from physgen.scene.unpack import unpack_to

    with store.fill(key) as filling:
        if filling is None:
            return
        try:
            scene = unpack_to(data, filling.folder / FILES, name)
            inside = scene.relative_to(filling.folder / FILES).as_posix()
            (filling.folder / SCENE).write_text(inside, encoding="utf-8")
        except OSError as error:
            filling.give_up(error)
