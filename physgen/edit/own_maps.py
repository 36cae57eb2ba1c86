"""Maps of a draft -> the folder that the scene reads, and back again where not all could be written."""

from __future__ import annotations

import os
import shutil
from pathlib import Path

from physgen.edit.durable import sync, write_durably
from physgen.edit.marked import marked
from physgen.edit.refusing import impossible
from physgen.scene.files import MAPS, RefusedError, confined
from physgen.whole import stamped


def folder_of(text: str, home: Path, allow_outside: bool) -> Path | None:
    """The folder that a text names for its maps. Raises EditError where no scene may read there."""
    node = marked(text).child("assets")
    if node is None or not isinstance(node.value, str):
        return None
    try:
        folder = confined(node.value, home, home, allow_outside)
    except RefusedError as error:
        raise impossible(f"assets {error.expected}, so its maps are not written", error.fix) from None
    for name in MAPS:
        if (folder / f"{name}.png").is_symlink():
            raise impossible(
                f"{name}.png is a link to a file elsewhere", "put a copy in its place, then save"
            )
    return folder


def stamps(folder: Path | None) -> dict[str, tuple[int, int, int]]:
    """What tells that one of its maps was written: time, size and number; a link to it changes none of them."""
    if folder is None:
        return {}
    told = {name: stamped(folder / f"{name}.png") for name in MAPS}
    return {name: (time, size, number) for name, (time, _, size, number) in told.items()}


def has_maps(folder: Path) -> bool:
    """Whether there are any."""
    return any(os.path.lexists(folder / f"{name}.png") for name in MAPS)


def set_aside(folder: Path | None, into: Path) -> None:
    """A copy of the maps, whole or not at all; one that is there stays."""
    if into.is_dir():
        return
    beside = into.with_name(f"{into.name}.part")
    shutil.rmtree(beside, ignore_errors=True)
    beside.mkdir()
    for name in MAPS if folder is not None else ():
        file = (folder or into) / f"{name}.png"
        if file.is_file():
            shutil.copyfile(file, beside / file.name)
            sync(beside / file.name)
    sync(beside)
    beside.rename(into)
    sync(into.parent)


def install(source: Path, folder: Path) -> None:
    """The maps of `source` and no others in `folder`, each whole. Raises OSError."""
    folder.mkdir(exist_ok=True)
    for name in MAPS:
        made, file = source / f"{name}.png", folder / f"{name}.png"
        if made.is_file():
            data = made.read_bytes()
            if not (file.is_file() and file.read_bytes() == data):
                write_durably(file, data)
        elif os.path.lexists(file):
            file.unlink()


def same(one: Path, other: Path | None) -> bool:
    """Whether two folders hold the same maps."""
    for name in MAPS:
        files = [folder / f"{name}.png" for folder in (one, other) if folder is not None]
        held = [file.read_bytes() if file.is_file() else None for file in files]
        if len({*held, *([None] if other is None else [])}) > 1:
            return False
    return True
