"""Scene files as physgen writes them: hashes of what it wrote, backups, unused assets.

An assets folder holds `written.json` with the hashes of the scenes that physgen wrote for
it, and checksums of its own files. A backup or a folder that is still as it was written
may be replaced or removed; anything else is the user's and stays.
"""

from __future__ import annotations

import json
import re
import shutil
from collections.abc import Callable, Collection, Iterator
from contextlib import suppress
from dataclasses import dataclass
from enum import Enum
from hashlib import sha256
from itertools import islice
from pathlib import Path
from typing import Any
from zlib import crc32

import yaml

from physgen.files import BACKUP, backup_path, write_atomic, write_with_backup
from physgen.problems import Limit
from physgen.scene.files import CACHE_FOLDER, RECORD, SUFFIXES, read_record

WRITTEN_FILE = "written.json"
"""Of an assets folder: `scenes`, SHA-256 of texts, and `files`, CRC-32 by name."""
MOST_TEXTS = 50
"""Hashes of scenes that are kept: more than anybody makes backups."""
TEXT_SUFFIXES = (*SUFFIXES, ".json", ".physgen")
"""Endings of files that may name an assets folder from another folder."""
MOST_FILES = 2_000
"""Files below a folder that are searched for the name of its assets; with more of
them, the assets count as used."""


def save_scene(
    path: Path, data: bytes, keep: Callable[[Path], None] = lambda backup: None
) -> None:
    """Write a scene atomically; keep an existing file that differs as `NAME~`.

    A backup that is exactly as physgen wrote it is replaced, and its assets are removed
    unless they were changed or another scene names them; the next backup of a file that
    a user edited is `NAME~2`. `keep` is called with the backup.
    """
    backup = backup_path(path, is_written_scene)
    replaced_assets = assets_of(backup) if backup.is_file() else None
    backups: list[Path] = []
    write_with_backup(path, data, backups.append, is_written_scene)
    note_scene(path, data)
    if backups and replaced_assets is not None and is_unused(replaced_assets):
        shutil.rmtree(replaced_assets, ignore_errors=True)
    for one in backups:
        keep(one)


def assets_of(scene: Path) -> Path | None:
    """Return the existing assets folder that a scene or a backup names, if any."""
    try:
        with scene.open("rb") as stream:
            data = stream.read(Limit.BYTES.most + 1)
    except OSError:
        return None
    return named_assets(data, scene.parent)


def named_assets(data: bytes, folder: Path) -> Path | None:
    """Return the existing folder that the text of a scene in `folder` names, if any."""
    assets = _named_path(data, "assets", folder)
    return assets if assets is not None and assets.is_dir() else None


def named_photo(data: bytes, folder: Path) -> Path | None:
    """Return the existing photo that the text of a scene in `folder` names, if any."""
    photo = _named_path(data, "image", folder)
    return photo if photo is not None and photo.is_file() else None


def _named_path(data: bytes, key: str, folder: Path) -> Path | None:
    """Return the path below `folder` that a line of a scene's text names, if any."""
    # one line is read: a whole scene takes seconds, and may be damaged
    line = re.search(rb"^%s:.*$" % key.encode(), data, re.MULTILINE)
    if line is None or len(data) > Limit.BYTES.most:
        return None
    try:
        name = yaml.safe_load(line[0])[key]
    except (yaml.YAMLError, ValueError):
        return None
    if not isinstance(name, str) or "\0" in name:
        return None
    path = folder / name
    return path if path.resolve().is_relative_to(folder.resolve()) else None


def note_scene(path: Path, data: bytes) -> None:
    """Record in the assets of a scene that physgen wrote this text."""
    assets = named_assets(data, path.parent)
    if assets is None:
        return
    record = read_record(assets / WRITTEN_FILE)
    digest = sha256(data).hexdigest()
    others = [text for text in _texts(record) if text != digest]
    record["scenes"] = [*others, digest][-MOST_TEXTS:]
    with suppress(OSError):  # without a record, backups are only kept for longer
        _write_record(assets, record)


def note_files(assets: Path, names: Collection[str]) -> None:
    """Record the checksums of files of an assets folder that physgen just wrote."""
    record = read_record(assets / WRITTEN_FILE)
    files = [assets / name for name in sorted(names)]
    record["files"] = {
        file.name: crc32(file.read_bytes()) for file in files if file.is_file()
    }
    _write_record(assets, record)


def note_copies(source: Path, assets: Path) -> None:
    """Record the files of a folder that physgen made of another one.

    Nothing is recorded if the user changed the other one: the new files are then in part
    the user's.
    """
    if is_written_folder(source):
        note_files(assets, {file.name for file in assets.iterdir()} - {WRITTEN_FILE})


def _write_record(assets: Path, record: dict[str, Any]) -> None:
    data = json.dumps(record, ensure_ascii=False, sort_keys=True)
    write_atomic(assets / WRITTEN_FILE, data.encode() + b"\n")


def _texts(record: dict[str, Any]) -> list[str]:
    """Return the hashes of the scenes; none if the record is damaged."""
    texts = record.get("scenes")
    return [str(text) for text in texts] if isinstance(texts, list) else []


def is_written_scene(path: Path) -> bool:
    """Return whether a scene or a backup is exactly as physgen wrote it."""
    assets = assets_of(path) if path.is_file() and not path.is_symlink() else None
    if assets is None:
        return False
    digest = sha256(path.read_bytes()).hexdigest()
    return digest in _texts(read_record(assets / WRITTEN_FILE))


def is_written_folder(assets: Path) -> bool:
    """Return whether an assets folder holds nothing but what physgen wrote."""
    checksums = _checksums(assets)
    if assets.is_symlink() or not checksums:
        return False
    for file in assets.iterdir():
        if file.name == WRITTEN_FILE or (
            file.name == RECORD and RECORD not in checksums
        ):
            continue
        if file.name == CACHE_FOLDER and file.is_dir() and not file.is_symlink():
            continue
        if file.is_symlink() or not file.is_file() or file.name not in checksums:
            return False
        if crc32(file.read_bytes()) != checksums[file.name]:
            return False
    return True


def _checksums(assets: Path) -> dict[str, Any]:
    """Return the recorded CRC-32 of each file of an assets folder."""
    files = read_record(assets / WRITTEN_FILE).get("files")
    if not isinstance(files, dict):  # an earlier version of physgen wrote the folder
        files = read_record(assets / RECORD).get("files")
    return files if isinstance(files, dict) else {}


def is_unused(assets: Path, ignored: Collection[Path] = ()) -> bool:
    """Return whether an assets folder is as physgen wrote it, and no file names it.

    All files in its folder count, copies and backups of scenes among them, and scenes
    in the folders below and in the one above, except the files in `ignored`.
    """
    try:
        if not is_written_folder(assets):
            return False
        files = list(islice(_files_that_may_name(assets), MOST_FILES + 1))
        if len(files) > MOST_FILES:
            return False
        return not any(
            _names_folder(file.read_bytes(), assets.name)
            for file in files
            if file not in ignored
        )
    except OSError:  # a file that cannot be read may name it
        return False


def _names_folder(data: bytes, name: str) -> bool:
    """Return whether the bytes of a file may name a folder.

    YAML and JSON can write other than ASCII letters as escapes in several ways, so each
    backslash counts as such a letter.
    """
    return name.encode() in data or (not name.isascii() and b"\\" in data)


def _files_that_may_name(assets: Path) -> Iterator[Path]:
    """Yield the files that may be scenes, or copies or drafts of scenes, with `assets`."""
    home = assets.parent
    for path in home.iterdir():
        if _is_small_file(path):
            yield path
    for path in home.rglob("*"):
        is_inside = path.is_relative_to(assets)
        is_scene = path.suffix.lower() in TEXT_SUFFIXES
        if path.parent != home and is_scene and not is_inside and _is_small_file(path):
            yield path
    for path in home.resolve().parent.iterdir():
        is_backup = BACKUP.fullmatch(path.name) is not None
        is_scene = path.suffix.lower() in SUFFIXES or is_backup
        if is_scene and _is_small_file(path):
            yield path


def _is_small_file(path: Path) -> bool:
    """Return whether a path is a file that is not too large for a scene."""
    return path.is_file() and path.stat().st_size <= Limit.BYTES.most


# ---- what is no longer used


class UnusedKind(Enum):
    """Why a file or folder is no longer used."""

    BACKUP = "backup"
    """An earlier version of a scene that physgen wrote."""
    ASSETS = "assets"
    """A folder of maps that no scene names."""
    PARTIAL = "partial"
    """Left by a process that was killed."""
    CACHE = "cache"
    """Decoded maps and sprites, or answers of models, which can be made again."""


@dataclass(frozen=True)
class UnusedPath:
    """A file or folder that physgen made, and that nothing uses any more."""

    path: Path
    kind: UnusedKind

    @property
    def size(self) -> int:
        """Return the bytes of the file, or of all files in the folder."""
        if not self.path.is_dir():
            return self.path.lstat().st_size
        files = [file for file in self.path.rglob("*") if file.is_file()]
        return sum(file.lstat().st_size for file in files)

    def remove(self) -> None:
        """Remove the file, or the folder with all that is in it. Raises OSError."""
        if self.path.is_dir():
            shutil.rmtree(self.path)
        else:
            self.path.unlink(missing_ok=True)


def unused_backups(folder: Path) -> list[Path]:
    """Return the backups in a folder that are as physgen wrote them.

    The last copy of a scene is not among them: the scene itself has to be there.
    """
    backups = []
    for path in sorted(folder.iterdir()):
        match = BACKUP.fullmatch(path.name)
        if match is None or not path.with_name(match["name"]).is_file():
            continue
        if is_written_scene(path):
            backups.append(path)
    return backups


def unused_assets(folder: Path, backups: Collection[Path] = ()) -> list[Path]:
    """Return the assets folders that physgen wrote and that no scene names.

    `backups` are about to be removed, and do not count.
    """
    folders = sorted(path for path in folder.glob("*.assets") if path.is_dir())
    return [path for path in folders if is_unused(path, backups)]


def caches_of_assets(folder: Path) -> list[Path]:
    """Return the caches in the assets folders of a folder."""
    caches = sorted(folder.glob(f"*.assets/{CACHE_FOLDER}"))
    return [path for path in caches if path.is_dir() and not path.is_symlink()]
