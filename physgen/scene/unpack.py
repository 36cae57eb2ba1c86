"""Reads a pack, which is untrusted input, into a folder: all of its files or none.

A pack is a zip. Its first member, `pack.json`, names the scene; the others are scene files and pictures. Its headers
are not trusted: names are checked before anything is written, sizes while it is read.
"""

from __future__ import annotations

import io
import json
import stat
import struct
import zipfile
import zlib
from collections.abc import Container, Iterator
from pathlib import Path

from physgen.files import new_folder
from physgen.problems import InputError, Limit
from physgen.scene.files import DATA, RefusedError, image_size
from physgen.text import quoted

SUFFIX = ".physgen"
CONTENTS = "pack.json"
"""The first member: which of the others is the scene."""
VERSION = 1
SCENES = (".yaml", ".yml")
MAGIC = b"PK\x03\x04"
LISTED = b"PK\x01\x02"
"""Begins each entry of a zip's list of its members."""

MAX_NAME_BYTES = 1000
"""Of a name with its folders."""
MAX_CONTENTS = 2**16
"""Bytes of the contents page."""
BLOCK = 2**20
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


def is_plain(name: str) -> bool:
    """Whether the name of a file or a folder leads straight down below any folder."""
    plain = name.isprintable() and "\\" not in name and name[1:2] != ":"
    parts = name.split("/")
    short = len(name.encode()) <= MAX_NAME_BYTES and all(len(p.encode()) <= Limit.NAME.most for p in parts)
    return plain and short and not any(part in ("", ".", "..") for part in parts)


def read_pack(path: Path) -> bytes:
    """The bytes of a pack's file. Raises InputError, or OSError where the machine fails."""
    if not path.exists():
        raise InputError.of(str(path), "", "no such file", OTHER)
    if not is_pack(path):
        raise InputError.of(str(path), "", "is no pack", OTHER)
    if path.stat().st_size > Limit.PACK.most:
        raise InputError.of(str(path), "", Limit.PACK.expected, OTHER)
    return path.read_bytes()


def unpack_to(data: bytes, folder: Path, name: str = "the pack") -> Path:
    """Writes a pack's files into `folder`, which is new or empty; returns the path of the scene file there.

    `name` is what messages call the pack. Raises InputError with one problem, and leaves no file then.
    """
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise InputError.of(str(folder), "", "is there already, and not empty", "name another folder with -o")
    with _archive(data, name) as archive:
        infos = _checked(archive, name)
        scene = _scene(archive, {info.filename for info in infos}, name)
        with new_folder(folder) as beside:
            _write(archive, infos, beside, name)
    return folder / scene


def _write(archive: zipfile.ZipFile, infos: list[zipfile.ZipInfo], folder: Path, name: str) -> None:
    left = Limit.PACK.most
    for info in infos:
        target = folder / info.filename
        is_text = info.filename.endswith(SCENES) or target.name in DATA
        try:
            (target if info.is_dir() else target.parent).mkdir(parents=True, exist_ok=True)
            if info.is_dir():
                continue
            out = target.open("xb")
        except (FileExistsError, NotADirectoryError):  # on some disks, names in other cases are the same
            raise InputError.of(name, quoted(info.filename), "is there twice", AGAIN) from None
        with out:
            for block in _blocks(archive, info, (Limit.BYTES if is_text else Limit.PICTURE).most, left, name):
                left -= len(block)
                out.write(block)
        try:  # what is no scene file must be a picture that a scene may show; no pixel is decoded
            _ = is_text or image_size(target)
        except RefusedError as error:
            raise InputError.of(name, quoted(info.filename), error.expected, AGAIN) from None


def _archive(data: bytes, name: str) -> zipfile.ZipFile:
    """The zip, its list of members read; refused where that is too long."""
    if not data.startswith(MAGIC):
        raise InputError.of(name, "", "is no pack", OTHER)
    if data.count(LISTED) > 2 * Limit.FILES.most:
        raise InputError.of(name, "", f"lists more than {Limit.FILES.amount}", OTHER)
    try:
        return zipfile.ZipFile(io.BytesIO(data))
    except DAMAGED:
        raise InputError.of(name, "", "is damaged: its list of files cannot be read", AGAIN) from None


def _checked(archive: zipfile.ZipFile, name: str) -> list[zipfile.ZipInfo]:
    """The members besides the contents page, checked by names alone."""
    infos = archive.infolist()
    if len(infos) > Limit.FILES.most + 1:
        raise InputError.of(name, f"{len(infos):,} files", Limit.FILES.expected, OTHER)
    for info in infos:
        if (found := _fault(info)) is not None:
            raise InputError.of(name, quoted(info.orig_filename), found, AGAIN)
    if CONTENTS not in archive.namelist():
        raise InputError.of(name, "", f"is a zip, but no pack: it has no {CONTENTS}", OTHER)
    return [info for info in infos if info.filename != CONTENTS]


def _fault(info: zipfile.ZipInfo) -> str | None:
    """What is wrong with a member by its entry."""
    # zipfile cuts a name at a zero byte
    if info.filename != info.orig_filename or not is_plain(info.filename.removesuffix("/")):
        return "is no plain name that leads straight down"
    if stat.S_IFMT(info.external_attr >> 16) not in (0, stat.S_IFDIR if info.is_dir() else stat.S_IFREG):
        return "is a link or no plain file"
    if info.flag_bits & ENCRYPTED or info.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
        return "is encrypted, or compressed in another way than a pack's files"
    return None


def _scene(archive: zipfile.ZipFile, names: Container[str], name: str) -> str:
    """Name of the scene file, by the contents page."""
    info = archive.getinfo(CONTENTS)
    page = b"".join(_blocks(archive, info, MAX_CONTENTS, Limit.PACK.most, name))
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
                    raise InputError.of(name, "", Limit.PACK.expected, OTHER)
                yield block
    except DAMAGED:
        raise InputError.of(name, quoted(info.filename), "is damaged", AGAIN) from None
