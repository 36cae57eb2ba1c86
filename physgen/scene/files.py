"""Resolve paths in a scene file to readable files. A scene file is untrusted input.

The image and the assets of a file must be below its own folder. `extends` may also name
a file in a sibling folder, below the parent folder of the opened scene. Symbolic links
are resolved first. `--allow-outside` lifts both rules.
"""

from __future__ import annotations

import json
import os
import stat
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from difflib import get_close_matches
from glob import glob
from itertools import repeat
from math import inf, isclose, isfinite
from pathlib import Path
from typing import Any

from physgen.files import SCENE_FORMATS, Stamp, file_stamp
from physgen.messages import Message, did_you_mean
from physgen.problems import InputError, Limit, RefusedError
from physgen.scene.document import Node, Source, decode, read
from physgen.scene.overlay import merge
from physgen.text import shown

SUFFIXES = (".yaml", ".yml")
MAPS = (
    "masks",
    "coverage",
    "background",
    "clean",
    "shadows",
    "depth",
    "normals",
    "albedo",
    "shading",
)
"""Names of the maps `NAME.png` in an assets folder."""
OUTLINES = "outlines.json"
"""File in assets: id in masks.png -> CRC-32 of its pixels, and a shape as in scene
files.
"""
RECORD = "perceived.json"
"""File in assets: the backend of each step of perception, and the written values."""
CACHE_FOLDER = "cache"
"""Folder in assets: decoded maps and sprites, which may be removed."""
OVERVIEW = "overview.png"
"""File in assets: a picture of the perceived objects for people. No program
reads it.
"""
DATA = (OUTLINES, RECORD)
ASSETS = (*(f"{name}.png" for name in MAPS), *DATA)


def resolve_confined(
    path_text: str,
    folder: Path,
    limit_folder: Path,
    allow_outside: bool,
    folder_name: str = "the scene's folder",
) -> Path:
    """Return the path of `path_text` in `folder`. Raise RefusedError for a path outside
    `limit_folder`.
    """
    # The operating system refuses such names with an exception of Python.
    if "\0" in path_text:
        raise Message.NOT_IN_PATH.refusal()
    if max(len(os.fsencode(part)) for part in path_text.split("/")) > Limit.NAME.most:
        raise Limit.NAME.refusal()
    path = folder / path_text
    if allow_outside:
        return path
    # Windows paths too, so that a file means the same on every system.
    if os.path.isabs(path_text) or path_text[1:3] in (":\\", ":/"):
        raise Message.PATH_ABSOLUTE.refusal(folder=folder_name)
    try:
        # Links are resolved first: a link inside the folder may lead outside.
        real = os.path.realpath(path)
        root = os.path.realpath(limit_folder)
    except (OSError, ValueError):
        raise Message.PATH_BROKEN.refusal() from None
    if os.path.commonpath([real, root]) != root:
        raise Message.PATH_OUTSIDE.refusal(folder=folder_name)
    return path


def read_scene(path: Path, name: str) -> Node:
    """Return the tree of one file; `name` is its path for messages. Raise
    InputError.
    """
    data = scene_bytes(path, name)
    return read(decode(data, name), Source(name, Path(os.path.abspath(path)).parent))


def scene_bytes(path: Path, name: str) -> bytes:
    """Read a file, up to one byte more than the limit. Raise InputError."""
    try:
        # A named pipe may block for ever. The shell's `<(...)` is a pipe below /proc.
        if stat.S_ISFIFO(os.stat(path).st_mode) and not os.path.realpath(
            path
        ).startswith("/proc/"):
            raise Message.IS_PIPE.error(name)
        with open(path, "rb") as stream:
            # One byte more tells a file at the limit from a larger one.
            return stream.read(Limit.BYTES.most + 1)
    except IsADirectoryError:
        raise Message.IS_FOLDER.error(name) from None
    except FileNotFoundError:
        fix = similar(name, path, SUFFIXES, "write the path of a scene file")
        raise Message.NO_SUCH_FILE.error(name, fix=fix) from None
    except (OSError, ValueError) as error:
        reason = "the path is no path"
        if isinstance(error, OSError) and error.strerror:
            reason = error.strerror
        raise Message.CANNOT_READ.error(name, reason=reason.lower()) from None


def read_record(path: Path) -> dict[str, Any]:
    """Return a `perceived.json`, or an empty mapping for an unreadable one: it only
    distinguishes perception's numbers from the user's.
    """
    try:
        record = json.loads(scene_bytes(path, RECORD))
    except (InputError, ValueError, RecursionError):
        return {}
    if isinstance(record, dict):
        return record
    return {}


def read_recorded(assets: Path | None, key: str) -> dict[str, Any]:
    """Return one mapping of the record of these assets, or an empty one."""
    if assets is None:
        record_value = None
    else:
        record_value = read_record(assets / RECORD).get(key)
    if isinstance(record_value, dict):
        return record_value
    return {}


def read_bases(
    root: Node, file: Path, allow_outside: bool, files: dict[Path, Stamp] | None = None
) -> list[Node]:
    """Return the trees of a file and of its bases, `root` first.

    Add the files to `files`. Raise InputError.
    """
    # Bases may be in sibling folders: the limit is the parent folder of the opened
    # file.
    home = root.source.folder.parent
    chain = [root]
    visited_paths = {os.path.realpath(file)}
    while True:
        top = chain[-1]
        assert isinstance(top.value, dict)
        link = top.value.get("extends")
        if link is None:
            break
        base = _base(
            link,
            home,
            allow_outside,
            len(chain),
            visited_paths,
            {} if files is None else files,
        )
        chain.append(base)
    return chain


def merge_bases(chain: Sequence[Node]) -> Node:
    """Return the merged tree of extended files, without `extends`."""
    tree = chain[-1]
    # From the last base to the opened file, whose values win.
    for extension in reversed(chain[:-1]):
        tree = merge(tree, extension)
    assert isinstance(tree.value, dict)
    return tree.with_value(
        {key: child for key, child in tree.value.items() if key != "extends"}
    )


def _base(
    link: Node,
    home: Path,
    allow_outside: bool,
    depth: int,
    visited_paths: set[str],
    files: dict[Path, Stamp],
) -> Node:
    """Return the tree of the file at `extends`."""

    def refused(refusal: RefusedError) -> InputError:
        return InputError([refusal.problem(link.place, "extends", shown(link.value))])

    # The checks go from cheap to costly, and none of them opens a file that lies
    # outside the permitted folder.
    if not isinstance(link.value, str) or not link.value:
        raise refused(Message.EXTENDS_NOT_PATH.refusal())
    if depth > Limit.EXTENDS.most:
        raise refused(Limit.EXTENDS.refusal())
    try:
        path = resolve_confined(
            link.value,
            link.source.folder,
            home,
            allow_outside,
            "the folder above the scene's",
        )
    except RefusedError as error:
        raise refused(error) from None
    if path.suffix.lower() not in SUFFIXES:
        raise refused(Message.NOT_SCENE_FILE.refusal())
    real = os.path.realpath(path)
    # Real paths find a cycle through links too.
    if real in visited_paths:
        raise refused(Message.EXTENDS_ITSELF.refusal())
    visited_paths.add(real)
    try:
        mode = os.stat(path).st_mode
    except (OSError, ValueError):
        fix = "write the path of a scene file, relative to this one"
        fix = similar(link.value, path, SUFFIXES, fix, visited_paths)
        raise refused(Message.DOES_NOT_EXIST.refusal(fix=fix)) from None
    if not stat.S_ISREG(mode):
        raise refused(Message.EXTENDS_NOT_FILE.refusal())
    # The stamp is taken before reading, so that a save in between is noticed.
    files[path] = file_stamp(path)
    return read_scene(path, name_relative(link.source.name, link.value))


def name_relative(name: str, path_text: str) -> str:
    """Return the name of a path in the file `name`.

    >>> name_relative("pool/scene.yaml", "../base/scene.yaml")
    'base/scene.yaml'
    """
    return os.path.normpath(os.path.join(os.path.dirname(name), path_text))


def similar(
    path_text: str,
    path: Path,
    ends: tuple[str, ...],
    fix: str,
    besides: Collection[str] = (),
) -> str:
    """Return the fix for a missing `path`: a similar name in its folder with one of the
    `ends` (/ for a folder), or `fix`.
    """
    folder = path.parent
    parent_folder = os.path.dirname(path_text.rstrip("/"))
    names = sorted((*glob("*", root_dir=folder), *glob("*/", root_dir=folder)))
    names = [
        n
        for n in names
        if n.lower().endswith(ends) and os.path.realpath(folder / n) not in besides
    ]
    # Only names in the same folder: a search elsewhere would reveal names of other
    # files.
    close = get_close_matches(path.name, names, 1)
    if not close:
        return fix
    return did_you_mean(os.path.join(parent_folder, close[0].rstrip("/")))


def image_size(path: Path, path_text: str) -> tuple[int, int]:
    """Return the width and height of an image from its header, without decoding pixels.

    `path_text` is the path in the scene. Raise RefusedError.
    """
    from physgen.photos import open_picture, orientation

    if not (path.is_file() or path.is_dir()):
        fix = "write the path of an image, relative to this file"
        fix = similar(path_text, path, (".png", ".jpg", ".jpeg", ".webp"), fix)
        raise Message.DOES_NOT_EXIST.refusal(fix=fix)
    try:
        with open_picture(path, SCENE_FORMATS) as image:
            size, turn = image.size, orientation(image)
    except InputError as error:
        raise error.problems[0].refusal() from None
    # Maps belong to the stored pixels, without the rotation in EXIF.
    if turn != 1:
        raise Message.PICTURE_TURNED.refusal()
    return size


WRITTEN = 1e-5
"""Maximum relative difference of equal numbers. Scenes are written with six digits or
more.
"""


@dataclass(frozen=True)
class Record:
    """The record of perception from `perceived.json` in the assets; empty if
    unknown.
    """

    objects: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    """By id in masks.png: an object's entry with its `from`. Older versions wrote it by
    name, without `from`.
    """
    world: Mapping[str, Any] = field(default_factory=dict)
    maps: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    """Meaning of 0 and 65535 in depth.png and shading.png."""
    comments: frozenset[str] = frozenset()
    """Comments of perception in the file. Any other comment is the user's."""

    @property
    def scale(self) -> float | None:
        """Return the scale behind the values, px/m, or None if unknown."""
        value = self.world.get("pixels_per_meter")
        is_scale = isinstance(value, int | float) and 0 < value < inf
        return float(value) if is_scale else None  # type: ignore[arg-type]

    def entry(self, name: str, item_data: Mapping[str, Any]) -> Mapping[str, Any]:
        """Return the recorded entry of an object with the current data `item_data`."""
        return (
            self.objects.get(str(item_data.get("mask"))) or self.objects.get(name) or {}
        )

    def sources(
        self, item_data: Mapping[str, Any], full_data: Mapping[str, Any], name: str
    ) -> dict[str, str]:
        """Return `from` of an object: its own, or the recorded one, without values that
        the user has changed.

        `item_data` is the object's data in the file, in numbers; `full_data` also has defaults.
        """
        wrote = self.entry(name, item_data)
        if "from" in item_data:
            sources = item_data["from"]
        else:
            sources = wrote.get("from")
        # A value that differs from the recorded one is the user's.
        return {
            key: text
            for key, text in (sources.items() if isinstance(sources, Mapping) else ())
            if isinstance(text, str)
            and (key not in wrote or equal(full_data.get(key), wrote[key]))
        }


UNKNOWN = Record()


def read_written_record(path: Path) -> Record:
    """Return the record at a path. Leave out malformed parts."""
    record = read_record(path)
    try:
        # Earlier versions wrote `values`.
        entries = record.get("objects") or record.get("values") or {}
        objects = {}
        for key, entry in entries.items():
            if isinstance(entry, dict):
                objects[key] = entry
        maps = _map_ends(record.get("maps", {}))
        world = _world_record(record.get("world", {}))
        comments = frozenset(map(str, record.get("comments", ())))
        return Record(objects, world, maps, comments)
    except (ValueError, TypeError, AttributeError, OverflowError):
        return Record()


def _map_ends(record: Mapping[str, Any]) -> dict[str, tuple[float, float]]:
    """Return the lowest and the highest value of each map; leave out wrong ones."""
    ends = {}
    for name, (low, high) in record.items():
        ends[name] = float(low), float(high)
    return {
        name: (low, high)
        for name, (low, high) in ends.items()
        if isfinite(low) and isfinite(high) and low < high
    }


def _world_record(record: Mapping[str, Any]) -> dict[str, Any]:
    """Return the record of the world; its boundaries must be mappings."""
    world = {}
    for key, value in record.items():
        if key != "boundaries":
            world[key] = value
    walls = record.get("boundaries")
    if not isinstance(walls, dict):
        return world
    if all(isinstance(wall, dict) for wall in walls.values()):
        world["boundaries"] = walls
    return world


def equal(first: object, second: object, tolerance: float = WRITTEN) -> bool:
    """Return whether two values are equal. Numbers may differ by the unwritten digits,
    or by `tolerance`.
    """
    if isinstance(first, Mapping) and isinstance(second, Mapping):
        if first.keys() != second.keys():
            return False
        return all(equal(first[key], second[key], tolerance) for key in first)
    if isinstance(first, list | tuple) and isinstance(second, list | tuple):
        return _equal_lists(first, second, tolerance)
    if isinstance(first, int | float) and isinstance(second, int | float):
        return isclose(first, second, rel_tol=WRITTEN, abs_tol=tolerance)
    return first == second


def _equal_lists(
    first: Sequence[object], second: Sequence[object], tolerance: float
) -> bool:
    if len(first) != len(second):
        return False
    return all(map(equal, first, second, repeat(tolerance)))
