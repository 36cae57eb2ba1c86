"""Reads a pack, which is untrusted input, into a folder: all of its files or none.

A pack is a zip. Its first member, `pack.json`, names the scene; the others are scene files and pictures. Its headers
are not trusted: names are checked before anything is written, sizes while it is read.
"""

from __future__ import annotations

import io
import json
import os
import shutil
import stat
import struct
import unicodedata
import zipfile
import zlib
from collections.abc import Container, Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path, PurePosixPath

from physgen.files import partial
from physgen.problems import InputError
from physgen.scene.document import MAX_BYTES
from physgen.scene.files import RefusedError, image_size
from physgen.text import quoted

SUFFIX = ".physgen"
CONTENTS = "pack.json"
"""The first member: which of the others is the scene."""
VERSION = 1
SCENES = (".yaml", ".yml")
MAGIC = b"PK\x03\x04"

MAX_FILES = 2_000
MAX_DEPTH = 16
"""Parts of a name: folders one in another, and a file."""
MAX_NAME_BYTES, MAX_PART_BYTES = 1024, 255
"""Of a name, and of what stands between two strokes in it."""
MAX_CONTENTS = 2**16
"""Bytes of the contents page."""
MAX_PICTURE = 800 * 2**20
"""Bytes of a file of a picture: 100 megapixels of 4 channels of 16 bits, not compressed."""
MAX_TOTAL = 2 * 2**30
"""Bytes of all files together, and of the pack."""
MAX_DIRECTORY = 200 * MAX_FILES
"""Bytes of a zip's list of its members: read whole before any is looked at."""
BLOCK = 2**20
END = struct.Struct("<4s4H2IH")
"""The record that ends a zip."""
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


def is_pack(path: Path) -> bool:
    """Whether a file is one by its ending, or a zip by its first bytes."""
    try:
        if not stat.S_ISREG(path.stat().st_mode):
            return False
        with path.open("rb") as file:
            return path.suffix == SUFFIX or file.read(len(MAGIC)) == MAGIC
    except (OSError, ValueError):
        return False


def is_ours(path: Path) -> bool:
    """Whether a file begins as `physgen pack` writes it."""
    with path.open("rb") as file:
        head = file.read(30 + len(CONTENTS))  # a zip's local header, then the name of its first member
    return head.startswith(MAGIC) and head[30:] == CONTENTS.encode()


def fault_of(name: str) -> tuple[str, str] | None:
    """What is wrong with the name of a file or a folder, and the fix: it must mean the same below any folder."""
    if not name or not name.isprintable():
        return "has a name with characters that cannot be shown", "rename it"
    parts = name.split("/")
    if len(name.encode()) > MAX_NAME_BYTES or max(len(part.encode()) for part in parts) > MAX_PART_BYTES:
        return "has too long a name", "rename it"
    if len(parts) > MAX_DEPTH:
        return f"lies more than {MAX_DEPTH} folders deep", "move it up"
    if name.startswith("/") or name[1:2] == ":":
        return "is an absolute name", "names in a pack are relative"
    if "\\" in name:
        return "has a backslash in its name", "rename it"
    if any(part in ("", ".", "..") for part in parts):
        return "leads out of its folder, or round about", "names in a pack lead straight down"
    return None


def clash_of(names: Iterable[str]) -> tuple[str, str] | None:
    """A name that some file systems take for another one, or of a file where another needs a folder; and why.

    Names of folders end with a stroke.
    """
    taken: dict[str, tuple[str, bool]] = {}
    for name in names:
        whole = PurePosixPath(name)
        for path in (whole, *whole.parents[:-1]):
            is_file, text = path == whole and not name.endswith("/"), str(path)
            other, was_file = taken.setdefault(unicodedata.normalize("NFC", text).casefold(), (text, is_file))
            if other != text:
                return (
                    text,
                    f"differs from {other} in capitals or accents alone, which some disks take for one",
                )
            if was_file != is_file:
                return text, "is a file, and a folder too"
    return None


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
            if status.st_size > MAX_TOTAL:
                raise InputError.of(str(path), "", f"is larger than {MAX_TOTAL >> 30} GiB", OTHER)
            return begin + file.read(MAX_TOTAL)
    except FileNotFoundError:
        raise InputError.of(str(path), "", "no such file", OTHER) from None
    except IsADirectoryError:
        raise InputError.of(str(path), "", "is a folder", OTHER) from None


def _at_once(path: str, flags: int) -> int:
    """Opens a pipe without waiting for a writer."""
    return os.open(path, flags | getattr(os, "O_NONBLOCK", 0))


def unpack_to(data: bytes, folder: Path, name: str = "the pack") -> Path:
    """Writes a pack's files into `folder`, which is new or empty; returns the path of the scene file there.

    `name` is what messages call the pack. Raises InputError with one problem, and leaves nothing then.
    """
    archive = _archive(data, name)
    infos = _checked(archive, name)
    scene = _scene(archive, {info.filename for info in infos}, name)
    with archive, _filled(folder) as beside:
        left = MAX_TOTAL
        for info in infos:
            target = beside / info.filename
            if info.is_dir():
                target.mkdir(parents=True, exist_ok=True)
                continue
            target.parent.mkdir(parents=True, exist_ok=True)
            is_scene = info.filename.endswith(SCENES)
            with target.open("wb") as out:
                for block in _blocks(archive, info, MAX_BYTES if is_scene else MAX_PICTURE, left, name):
                    left -= len(block)
                    out.write(block)
            if not is_scene:
                _check_picture(target, info.filename, name)
    return folder / scene


def _archive(data: bytes, name: str) -> zipfile.ZipFile:
    """The zip, its list of members read; refused where that is too long, or is not where it belongs."""
    if not data.startswith(MAGIC):
        raise InputError.of(name, "", "is no pack", OTHER)
    if len(data) < END.size or not data[-END.size :].startswith(b"PK\x05\x06"):
        raise InputError.of(name, "", "is cut short, or has something behind its end", AGAIN)
    size = END.unpack(data[-END.size :])[5]
    if size > MAX_DIRECTORY or data[-END.size - 20 :].startswith(b"PK\x06\x07"):
        raise InputError.of(name, "", f"lists more files than the {MAX_FILES:,} of a pack", OTHER)
    try:
        return zipfile.ZipFile(io.BytesIO(data))
    except DAMAGED:
        raise InputError.of(name, "", "is damaged: its list of files cannot be read", AGAIN) from None


def _checked(archive: zipfile.ZipFile, name: str) -> list[zipfile.ZipInfo]:
    """The members besides the contents page, checked by names alone."""
    infos = archive.infolist()
    if len(infos) > MAX_FILES + 1:
        raise InputError.of(name, f"{len(infos):,} files", f"are over the {MAX_FILES:,} of a pack", OTHER)
    names: dict[str, None] = {}
    for info in infos:
        if (found := _fault(info, names)) is not None:
            raise InputError.of(name, quoted(info.orig_filename), found, AGAIN)
        names[info.filename] = None
    if (clash := clash_of(names)) is not None:
        raise InputError.of(name, quoted(clash[0]), clash[1], AGAIN)
    if CONTENTS not in names:
        raise InputError.of(name, "", f"is a zip, but no pack: it has no {CONTENTS}", OTHER)
    return [info for info in infos if info.filename != CONTENTS]


def _fault(info: zipfile.ZipInfo, before: Container[str]) -> str | None:
    """What is wrong with a member by its entry, and by the names `before` it."""
    kind = stat.S_IFMT(info.external_attr >> 16)
    fault = fault_of(info.filename[:-1] if info.is_dir() else info.filename)
    if info.filename != info.orig_filename:  # zipfile cuts a name at a zero byte
        return "has a second name, or a zero byte in its name"
    if fault is not None:
        return fault[0]
    if info.filename in before:
        return "is there twice"
    if kind not in (0, stat.S_IFDIR if info.is_dir() else stat.S_IFREG):
        return "is a link" if kind == stat.S_IFLNK else "is no plain file"
    if info.flag_bits & ENCRYPTED:
        return "is encrypted"
    if info.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
        return "is compressed in another way than a pack's files"
    return None


def _scene(archive: zipfile.ZipFile, names: Container[str], name: str) -> str:
    """Name of the scene file, by the contents page."""
    info = archive.getinfo(CONTENTS)
    page = b"".join(_blocks(archive, info, MAX_CONTENTS, MAX_TOTAL, name))
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
                    size = f"{most >> 20} MiB" if most >= 2**20 else f"{most >> 10} kiB"
                    expected = f"is larger than {size}"
                    raise InputError.of(name, quoted(info.filename), expected, "keep pixels in pictures")
                if total > left:
                    raise InputError.of(name, "", f"holds more than {MAX_TOTAL >> 30} GiB", OTHER)
                yield block
    except DAMAGED:
        raise InputError.of(name, quoted(info.filename), "is damaged", AGAIN) from None


def _check_picture(path: Path, member: str, name: str) -> None:
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
    beside = partial(final)
    new = [path for path in beside.parents if not path.exists()]
    beside.parent.mkdir(parents=True, exist_ok=True)
    beside.mkdir()
    try:
        yield beside
        for part in beside.iterdir() if there else ():  # the folder may be in use
            part.rename(final / part.name)
        beside.rmdir() if there else beside.rename(final)
    except BaseException:
        shutil.rmtree(beside, ignore_errors=True)
        with suppress(OSError):
            for path in new:
                path.rmdir()
        raise
