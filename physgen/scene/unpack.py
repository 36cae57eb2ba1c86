"""Reads a pack, which is untrusted input, into a folder: all of its files or none.

Its headers are not trusted: names are checked before anything is written, sizes while it is read.
"""

from __future__ import annotations

import io
import json
import os
import re
import shutil
import stat
import struct
import zipfile
import zlib
from collections.abc import Container, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from physgen.files import partial, resource, write_atomic
from physgen.problems import InputError
from physgen.scene.document import MAX_BYTES
from physgen.scene.files import RefusedError, image_size
from physgen.scene.pack_format import (
    CONTENTS,
    MAGIC,
    MOST_CONTENTS,
    MOST_FILES,
    MOST_PICTURE,
    MOST_WHOLE,
    SCENES,
    VERSION,
    clash_of,
    fault_of,
)
from physgen.text import quoted

SCHEMA = "scene-1.schema.json"
_LINE = re.compile(rb"\A(\xef\xbb\xbf)?(# yaml-language-server: \$schema=)([^\s:]+)([ \t]*\r?\n)")


def with_schema(folder: Path) -> None:
    """For every scene file below it whose line leads to no file: the schema where it says, or else beside the scene.

    Lines that name a URL are left alone, and so is what lies outside the folder. Raises OSError.
    """
    home = folder.resolve()
    for path in sorted(p for p in folder.rglob("*") if p.suffix in SCENES and p.is_file()):
        data = path.read_bytes()
        line = _LINE.match(data)
        if line is None:
            continue
        named = line[3].decode("utf-8", "replace")
        schema = (path.parent / named).resolve()
        if schema.is_relative_to(home) and schema.is_file():
            continue
        if not (schema.is_relative_to(home) and schema.name == SCHEMA):
            schema = path.parent / SCHEMA
            write_atomic(path, data[: line.start(3)] + SCHEMA.encode() + data[line.end(3) :])
        schema.parent.mkdir(parents=True, exist_ok=True)
        if not schema.exists():
            write_atomic(schema, resource("schemas", SCHEMA).read_bytes())


BLOCK = 2**20
END = struct.Struct("<4s4H2IH")
"""The record that ends a zip."""
MOST_DIRECTORY = 200 * MOST_FILES
"""Bytes of a zip's list of its members: read whole before any is looked at."""
AGAIN = "pack the scene again"
OTHER = "name a file that physgen pack wrote"
ENCRYPTED = 1
DAMAGED = (
    zipfile.BadZipFile,
    zlib.error,
    EOFError,
    struct.error,
    ValueError,
    RuntimeError,
    NotImplementedError,
)
"""What reading a zip raises where it is none."""


def read_pack(path: Path) -> bytes:
    """The bytes of a pack's file; of what is none no more than the first ones are read.

    Raises InputError, or OSError where the machine fails.
    """
    try:
        with open(path, "rb", opener=_at_once) as file:
            status = os.fstat(file.fileno())
            if not stat.S_ISREG(status.st_mode):
                raise InputError.of(str(path), "", "is no plain file", OTHER)
            begin = file.read(len(MAGIC))
            if begin != MAGIC:
                raise InputError.of(str(path), "", "is no pack", OTHER)
            large = status.st_size > MOST_WHOLE
            data = b"" if large else begin + file.read(MOST_WHOLE + 1 - len(begin))
    except FileNotFoundError:
        raise InputError.of(str(path), "", "no such file", OTHER) from None
    except IsADirectoryError:
        raise InputError.of(str(path), "", "is a folder", OTHER) from None
    if large or len(data) > MOST_WHOLE:
        raise InputError.of(str(path), "", f"is larger than {MOST_WHOLE >> 30} GiB", OTHER)
    return data


def _at_once(path: str, flags: int) -> int:
    """Opens a pipe without waiting for a writer."""
    return os.open(path, flags | getattr(os, "O_NONBLOCK", 0))


def unpack_to(data: bytes, folder: Path, name: str = "the pack") -> Path:
    """Writes a pack's files into `folder`, which is new or empty; returns the path of the scene file there.

    `name` is what messages call the pack. Raises InputError with one problem, and leaves nothing then.
    """
    members = _opened(data, name)
    with members.archive as archive, _filled(folder) as beside:
        left = MOST_WHOLE
        for info in members.files:
            target = beside / info.filename
            if info.is_dir():
                target.mkdir(parents=True, exist_ok=True)
                continue
            target.parent.mkdir(parents=True, exist_ok=True)
            is_scene = info.filename.endswith(SCENES)
            with target.open("wb") as out:
                for block in _blocks(archive, info, MAX_BYTES if is_scene else MOST_PICTURE, left, name):
                    left -= len(block)
                    out.write(block)
            if not is_scene:
                _picture(target, info.filename, name)
    return folder / members.scene


class _Members:
    """What a pack holds, checked by names alone."""

    def __init__(self, archive: zipfile.ZipFile, files: list[zipfile.ZipInfo], scene: str) -> None:
        self.archive, self.files, self.scene = archive, files, scene


def _opened(data: bytes, name: str) -> _Members:
    archive = _archive(data, name)
    infos = archive.infolist()
    if len(infos) > MOST_FILES + 1:
        raise InputError.of(name, f"{len(infos):,} files", f"are over the {MOST_FILES:,} of a pack", OTHER)
    names: dict[str, None] = {}
    for info in infos:
        _judge(info, names, name)
        names[info.filename] = None
    if (clash := clash_of(names)) is not None:
        raise InputError.of(name, quoted(clash.name), clash.expected, AGAIN)
    if CONTENTS not in names:
        raise InputError.of(name, "", f"is a zip, but no pack: it has no {CONTENTS}", OTHER)
    scene = _scene(archive, names, name)
    return _Members(archive, [info for info in infos if info.filename != CONTENTS], scene)


def _archive(data: bytes, name: str) -> zipfile.ZipFile:
    """The zip, its list of members read; refused where that is too long, or is not where it belongs."""
    if not data.startswith(MAGIC):
        raise InputError.of(name, "", "is no pack", OTHER)
    if len(data) < END.size or not data[-END.size :].startswith(b"PK\x05\x06"):
        raise InputError.of(name, "", "is cut short, or has something behind its end", AGAIN)
    size = END.unpack(data[-END.size :])[5]
    if size > MOST_DIRECTORY or data[-END.size - 20 :].startswith(b"PK\x06\x07"):
        raise InputError.of(name, "", f"lists more files than the {MOST_FILES:,} of a pack", OTHER)
    try:
        return zipfile.ZipFile(io.BytesIO(data))
    except DAMAGED:
        raise InputError.of(name, "", "is damaged: its list of files cannot be read", AGAIN) from None


def _judge(info: zipfile.ZipInfo, before: Container[str], name: str) -> None:
    """Refuses a member by what its entry says, and by the names `before` it."""

    def refused(expected: str, fix: str = AGAIN) -> InputError:
        return InputError.of(name, quoted(info.orig_filename), expected, fix)

    if info.filename != info.orig_filename:  # zipfile cuts a name at a zero byte
        raise refused("has a second name, or a zero byte in its name")
    if (fault := fault_of(info.filename[:-1] if info.is_dir() else info.filename)) is not None:
        raise refused(fault.expected)
    if info.filename in before:
        raise refused("is there twice")
    kind = stat.S_IFMT(info.external_attr >> 16)
    if kind not in (0, stat.S_IFDIR if info.is_dir() else stat.S_IFREG):
        what = "a link" if kind == stat.S_IFLNK else "no plain file"
        raise refused(f"is {what}")
    if info.flag_bits & ENCRYPTED:
        raise refused("is encrypted")
    if info.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
        raise refused(
            "is compressed in another way than a pack's files", "pack the scene again, or zip it plainly"
        )


def _scene(archive: zipfile.ZipFile, names: Container[str], name: str) -> str:
    """Name of the scene file, by the contents page."""
    info = archive.getinfo(CONTENTS)
    page = b"".join(_blocks(archive, info, MOST_CONTENTS, MOST_WHOLE, name))
    try:
        contents_page = json.loads(page)
        version, scene = contents_page["pack"], contents_page["scene"]
    except (ValueError, TypeError, KeyError, RecursionError):
        raise InputError.of(name, CONTENTS, "cannot be understood", AGAIN) from None
    if version != VERSION:
        found = quoted(str(version), "")
        raise InputError.of(name, f"version {found}", "is not one that this physgen reads", "update physgen")
    if not isinstance(scene, str) or scene not in names or not scene.endswith(SCENES) or "/" not in scene:
        expected = "is no scene file in a folder of the pack"
        raise InputError.of(name, quoted(str(scene)), f"{expected}, though {CONTENTS} says so", AGAIN)
    return scene


def _blocks(
    archive: zipfile.ZipFile, info: zipfile.ZipInfo, most: int, left: int, name: str
) -> Iterator[bytes]:
    """The bytes of a member, never more than `most`, nor than are `left` for all."""
    total = 0
    try:
        with archive.open(info) as member:
            while block := member.read(min(BLOCK, most - total + 1)):
                total += len(block)
                if total > most:
                    expected = f"is larger than {_size(most)}"
                    raise InputError.of(name, quoted(info.filename), expected, "keep pixels in pictures")
                if total > left:
                    raise InputError.of(name, "", f"holds more than {MOST_WHOLE >> 30} GiB", OTHER)
                yield block
    except DAMAGED:
        raise InputError.of(name, quoted(info.filename), "is damaged", AGAIN) from None


def _size(most: int) -> str:
    return f"{most >> 20} MiB" if most >= 2**20 else f"{most >> 10} kiB"


def _picture(path: Path, member: str, name: str) -> None:
    """Refuses what is neither a scene file nor a picture that a scene may show; no pixel is decoded."""
    try:
        image_size(path)
    except RefusedError as error:
        what = "is neither a scene file nor a picture" if "not an image" in error.expected else error.expected
        raise InputError.of(name, quoted(member), what, AGAIN) from None


@contextmanager
def _filled(folder: Path) -> Iterator[Path]:
    """A fresh folder, whose files are in `folder` when the block ends; on any error nothing is left of them."""
    final = Path(os.path.abspath(folder))
    there = final.exists()
    if there and not final.is_dir():
        raise InputError.of(str(folder), "", "is a file", "name a folder with -o")
    if there and any(final.iterdir()):
        raise InputError.of(str(folder), "", "is there already, and not empty", "name another folder with -o")
    beside = partial(final / "unpacked" if there else final)
    new = [path for path in beside.parents if not path.exists()]
    beside.parent.mkdir(parents=True, exist_ok=True)
    beside.mkdir()
    moved: list[Path] = []
    try:
        yield beside
        if not there:
            beside.rename(final)
        for part in sorted(beside.iterdir()) if there else ():  # the folder may be in use
            moved.append(part.rename(final / part.name))
    except BaseException:
        for path in (beside, *moved):
            shutil.rmtree(path, ignore_errors=True)
        with suppress(OSError):
            for path in new:
                path.rmdir()
        raise
    shutil.rmtree(beside, ignore_errors=True)
