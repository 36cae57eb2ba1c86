"""Save scene files: hashes of written scenes, backups, unused assets.

An assets folder holds `written.json` with the hashes of the scenes that physgen wrote
for it, and checksums of its own files. An unchanged backup or folder may be replaced or
removed. Anything else is the user's and stays.
"""

from __future__ import annotations

import json
import re
import shutil
from collections.abc import Callable, Collection, Iterator, Mapping
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
"""File in assets: `scenes`, SHA-256 of texts, and `files`, CRC-32 by name."""
MOST_TEXTS = 50
"""Maximum number of stored hashes: more than anybody makes backups."""
TEXT_SUFFIXES = (*SUFFIXES, ".json", ".physgen")
"""Suffixes of files that may name an assets folder from another folder."""
MOST_FILES = 2_000
"""Maximum number of files to search for the name of assets. With more files, the assets
count as used.
"""


def save_scene(
    path: Path, data: bytes, keep: Callable[[Path], None] = lambda backup: None
) -> None:
    """Write a scene atomically. Keep an existing file with other content as `NAME~`.

    An unchanged backup of physgen is replaced, and its assets are removed unless they
    were changed or another scene names them. If a user edited the backup, the next one
    is `NAME~2`. `keep` is called with the backup.
    """
    # Find the assets of the replaced backup before it is gone.
    backup = backup_path(path, is_written_scene)
    if backup.is_file():
        replaced_assets = assets_of(backup)
    else:
        replaced_assets = None
    backups: list[Path] = []
    write_with_backup(path, data, backups.append, is_written_scene)
    note_scene(path, data)
    if backups and replaced_assets is not None and is_unused_folder(replaced_assets):
        shutil.rmtree(replaced_assets, ignore_errors=True)
    for one in backups:
        keep(one)


def assets_of(scene: Path) -> Path | None:
    """Return the existing assets folder of a scene or a backup, if any."""
    try:
        with scene.open("rb") as stream:
            data = stream.read(Limit.BYTES.most + 1)
    except OSError:
        return None
    return named_assets(data, scene.parent)


def named_assets(data: bytes, folder: Path) -> Path | None:
    """Return the existing assets folder in a scene's text, relative to `folder`, if
    any.
    """
    assets = _named_path(data, "assets", folder)
    if assets is not None and assets.is_dir():
        return assets
    return None


def named_photo(data: bytes, folder: Path) -> Path | None:
    """Return the existing photo in a scene's text, relative to `folder`, if any."""
    photo = _named_path(data, "image", folder)
    if photo is not None and photo.is_file():
        return photo
    return None


def _named_path(data: bytes, key: str, folder: Path) -> Path | None:
    """Return the path at a key of a scene's text, if it is below `folder`."""
    # Read one line only: a whole scene takes seconds, and may be damaged.
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
    # A scene must not lead to the removal of files outside its folder.
    if path.resolve().is_relative_to(folder.resolve()):
        return path
    return None


def note_scene(path: Path, data: bytes) -> None:
    """Record in the assets of a scene that physgen wrote this text."""
    assets = named_assets(data, path.parent)
    if assets is None:
        return
    record = read_record(assets / WRITTEN_FILE)
    digest = sha256(data).hexdigest()
    others = []
    for text in _texts(record):
        if text != digest:
            others.append(text)
    # The newest hash is last, and the oldest are dropped.
    record["scenes"] = [*others, digest][-MOST_TEXTS:]
    # Without a record, backups only live longer.
    with suppress(OSError):
        _write_record(assets, record)


def note_files(assets: Path, names: Collection[str]) -> None:
    """Record the checksums of new files of physgen in an assets folder."""
    record = read_record(assets / WRITTEN_FILE)
    files = [assets / name for name in sorted(names)]
    record["files"] = {
        file.name: crc32(file.read_bytes()) for file in files if file.is_file()
    }
    _write_record(assets, record)


def note_copies(source: Path, assets: Path) -> None:
    """Record the files that physgen copied from another folder.

    Record nothing if the user changed the other folder: then a part of the new files is
    the user's.
    """
    if is_written_folder(source):
        note_files(assets, {file.name for file in assets.iterdir()} - {WRITTEN_FILE})


def _write_record(assets: Path, record: dict[str, Any]) -> None:
    data = json.dumps(record, ensure_ascii=False, sort_keys=True)
    write_atomic(assets / WRITTEN_FILE, data.encode() + b"\n")


def _texts(record: dict[str, Any]) -> list[str]:
    """Return the hashes of the scenes, or nothing for a damaged record."""
    texts = record.get("scenes")
    if isinstance(texts, list):
        return list(map(str, texts))
    return []


def is_written_scene(path: Path) -> bool:
    """Return whether a scene or a backup is unchanged since physgen wrote it."""
    if path.is_file() and not path.is_symlink():
        assets = assets_of(path)
    else:
        assets = None
    if assets is None:
        return False
    digest = sha256(path.read_bytes()).hexdigest()
    return digest in _texts(read_record(assets / WRITTEN_FILE))


def is_written_folder(assets: Path) -> bool:
    """Return whether an assets folder contains only unchanged files of physgen."""
    checksums = _checksums(assets)
    # A link or a folder without a record is the user's.
    if assets.is_symlink() or not checksums:
        return False
    unlisted_names = {WRITTEN_FILE}
    # Earlier versions kept the checksums in this file, which cannot contain its own.
    if RECORD not in checksums:
        unlisted_names.add(RECORD)
    for file in assets.iterdir():
        if file.name in unlisted_names:
            continue
        # A cache can be made again, and its files have no checksums.
        if file.name == CACHE_FOLDER and file.is_dir() and not file.is_symlink():
            continue
        if not _has_checksum(file, checksums):
            return False
    return True


def _has_checksum(file: Path, checksums: Mapping[str, Any]) -> bool:
    """Return whether a path is a file with its recorded CRC-32."""
    if file.is_symlink() or not file.is_file() or file.name not in checksums:
        return False
    return bool(crc32(file.read_bytes()) == checksums[file.name])


def _checksums(assets: Path) -> dict[str, Any]:
    """Return the recorded CRC-32 of each file of an assets folder."""
    files = read_record(assets / WRITTEN_FILE).get("files")
    # An earlier version of physgen wrote the folder.
    if not isinstance(files, dict):
        files = read_record(assets / RECORD).get("files")
    if isinstance(files, dict):
        return files
    return {}


def is_unused_folder(assets: Path, ignored_files: Collection[Path] = ()) -> bool:
    """Return whether an assets folder is unchanged, and no file names it.

    All files in its folder count, also copies and backups of scenes, and scenes in the
    folders below and in the parent folder, except the files in `ignored_files`.
    """
    try:
        if not is_written_folder(assets):
            return False
        files = list(islice(_files_that_may_name(assets), MOST_FILES + 1))
        # When in doubt, keep the assets.
        if len(files) > MOST_FILES:
            return False
        return not any(
            _names_folder(file.read_bytes(), assets.name)
            for file in files
            if file not in ignored_files
        )
    except OSError:
        # An unreadable file may name it.
        return False


def _names_folder(data: bytes, name: str) -> bool:
    """Return whether the bytes of a file may name a folder.

    YAML and JSON can escape non-ASCII letters in several ways, so that each backslash
    counts as such a letter.
    """
    return name.encode() in data or (not name.isascii() and b"\\" in data)


def _files_that_may_name(assets: Path) -> Iterator[Path]:
    """Yield the files that may be scenes, or copies or drafts of scenes, with
    `assets`.
    """
    home = assets.parent
    yield from filter(_is_small_file, home.iterdir())
    for path in home.rglob("*"):
        is_inside = path.is_relative_to(assets)
        is_scene = path.suffix.lower() in TEXT_SUFFIXES
        if path.parent != home and is_scene and not is_inside and _is_small_file(path):
            yield path
    # `extends` reaches scenes in sibling folders and in the parent.
    for path in home.resolve().parent.iterdir():
        is_backup = BACKUP.fullmatch(path.name) is not None
        is_scene = path.suffix.lower() in SUFFIXES or is_backup
        if is_scene and _is_small_file(path):
            yield path


def _is_small_file(path: Path) -> bool:
    """Return whether a path is a file within the size limit of scenes."""
    return path.is_file() and path.stat().st_size <= Limit.BYTES.most


# ---- unused files


class UnusedKind(Enum):
    """The kind of an unused file or folder."""

    BACKUP = "backup"
    """An earlier version of a scene, written by physgen."""
    ASSETS = "assets"
    """A folder of maps without a scene."""
    PARTIAL = "partial"
    """A file of a killed process."""
    CACHE = "cache"
    """Decoded maps and sprites, or answers of models, which can be made again."""


@dataclass(frozen=True)
class UnusedPath:
    """A file or folder of physgen without a further use."""

    path: Path
    kind: UnusedKind

    @property
    def size(self) -> int:
        """Return the bytes of the file, or of all files in the folder."""
        if not self.path.is_dir():
            return self.path.lstat().st_size
        files = []
        for file in self.path.rglob("*"):
            if file.is_file():
                files.append(file)
        return sum(file.lstat().st_size for file in files)

    def remove(self) -> None:
        """Remove the file, or the folder with its content. Raise OSError."""
        if self.path.is_dir():
            shutil.rmtree(self.path)
        else:
            self.path.unlink(missing_ok=True)


def unused_backups(folder: Path) -> list[Path]:
    """Return the unchanged backups of physgen in a folder.

    Keep the last copy of a scene: without the scene itself, its backups are in use.
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
    """Return the unchanged assets folders without a scene.

    `backups` are about to be removed, and do not count.
    """
    folders = sorted(path for path in folder.glob("*.assets") if path.is_dir())
    return [path for path in folders if is_unused_folder(path, backups)]


def caches_of_assets(folder: Path) -> list[Path]:
    """Return the caches in the assets folders of a folder."""
    caches = sorted(folder.glob(f"*.assets/{CACHE_FOLDER}"))
    of_assets = []
    for path in caches:
        if path.is_dir() and not path.is_symlink():
            of_assets.append(path)
    return of_assets
