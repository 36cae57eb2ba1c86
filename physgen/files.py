"""Atomic file writes, file stamps, and the files that are installed with physgen."""

from __future__ import annotations

import os
import platform
import re
import shutil
from collections.abc import Callable, Mapping
from contextlib import suppress
from functools import cache
from hashlib import sha256
from pathlib import Path

from physgen.messages import Message
from physgen.problems import OutputError, Place

EXIF_ORIENTATION = 0x0112
"""Tag of how a camera was held; 1 is upright."""
SCENE_FORMATS = ("PNG", "JPEG", "WEBP")
"""What a scene may name as its photo."""
FORMATS = (*SCENE_FORMATS, "BMP", "TIFF", "GIF", "PPM", "AVIF", "HEIF", "JXL")
"""What perceive reads, the last two by the extra `phone`: none of Pillow's readers that call other programs."""


_PACKAGE = Path(__file__).resolve().parent
_ROOTS = (_PACKAGE / "_data", _PACKAGE.parent)


MOST_PIXELS = 2_000_000
"""Of a photo that stays in memory with its maps, or in a cache; a larger one is released once sprites are cut out."""


def resource(*parts: str) -> Path:
    """Return the path of a file below `schemas/` or `templates/`.

    >>> resource("schemas", "scene-1.schema.json").name
    'scene-1.schema.json'
    """
    for root in _ROOTS:
        path = root.joinpath(*parts)
        if path.exists():
            return path
    raise FileNotFoundError(
        f"physgen was installed without {'/'.join(parts)}; install it again"
    )


def install(extra: str) -> str:
    """Return the command that installs an extra, for a clone or for an installed physgen."""
    root = _PACKAGE.parent
    is_clone = (root / "pyproject.toml").is_file()
    source = f'-e "{os.path.relpath(root)}' if is_clone else '"physgen'
    return f'pip install {source}[{extra}]"'


def cache_folder(environment: Mapping[str, str] = os.environ) -> Path:
    """Return the folder of results that can be made again.

    Raises RuntimeError if there is no home folder.
    """
    cache = environment.get("XDG_CACHE_HOME", "")
    # A relative path is invalid there (XDG base directory specification).
    folder = Path(cache) if os.path.isabs(cache) else Path.home() / ".cache"
    return folder / "physgen"


_PARTIAL = re.compile(r"\.(?P<name>[^/]+)\.\d+(-[0-9a-f]+)?\.part$")


Stamp = tuple[int, int, int, int]


def file_stamp(path: Path) -> Stamp:
    """Return times, size and inode of a file, which change when it is written.

    Zeros if there is no file.
    """
    try:
        status = os.stat(path)
    except (OSError, ValueError):
        return 0, 0, 0, 0
    return status.st_mtime_ns, status.st_ctime_ns, status.st_size, status.st_ino


def partial(path: Path, kind: str = "part") -> Path:
    """Return this process's own name beside `path`, on the same file system, which machines may share."""
    return path.with_name(f".{path.name}.{os.getpid()}-{machine_id()}.{kind}")


@cache
def machine_id() -> str:
    """Return an id of the machine or container: processes of two may have the same number."""
    parts = [platform.node()]
    with suppress(OSError):
        parts.append(str(os.stat("/proc/self/ns/pid").st_ino))
        parts.append(Path("/etc/machine-id").read_text(encoding="utf-8"))
    return sha256("\n".join(parts).encode()).hexdigest()[:8]


def check_writable(folder: Path) -> None:
    """Write and remove a byte in an output folder, or where it would be created.

    Permission bits say too little: root ignores them, and a mount may be read-only or
    full. Raises OutputError.
    """
    existing = folder
    while not os.path.lexists(existing) and existing != existing.parent:
        existing = existing.parent
    if not existing.is_dir():
        problem = Message.OUTPUT_IS_FILE.problem(Place(str(existing)))
        raise OutputError([problem])
    probe = partial(existing / "physgen")
    try:
        try:
            probe.write_bytes(b"\0")
        finally:
            probe.unlink(missing_ok=True)
    except OSError as error:
        reason = (error.strerror or str(error)).lower()
        unwritable = Message.OUTPUT_UNWRITABLE
        problem = unwritable.problem(Place(str(folder)), reason=reason)
        raise OutputError([problem]) from None


def check_text_names(*paths: Path | None) -> None:
    """Check that a scene file can contain these names. Raises InputError.

    File systems accept any bytes as a name; scene files are UTF-8.
    """
    for path in paths:
        try:
            str(path).encode()
        except UnicodeEncodeError:
            raise Message.NAME_NOT_UTF8.error(str(path)) from None


def final_name(path: str) -> str:
    """Return the final name of a partial file.

    >>> final_name("out/.a.npz.123-0a1b2c3d.part")
    'out/a.npz'
    """
    return _PARTIAL.sub(r"\g<name>", path)


def write_atomic(path: Path, data: bytes, *, durable: bool = False) -> None:
    """Write beside, then rename; on any error nothing is left and the old file is as it was.

    `durable`: through to the disk, with the old permissions; links are followed.
    """
    path = Path(os.path.realpath(path)) if durable else path
    partial_path = partial(path)
    try:
        with partial_path.open("wb") as stream:
            stream.write(data)
            if durable:
                stream.flush()
                os.fsync(stream.fileno())
                with suppress(OSError):  # a new file has no old permissions
                    shutil.copymode(path, partial_path)
        partial_path.replace(path)
    except BaseException:
        with suppress(OSError):
            partial_path.unlink()
        raise


def write_with_backup(
    path: Path,
    data: bytes,
    keep: Callable[[Path], None] = lambda kept: None,
    is_replaceable: Callable[[Path], bool] = lambda backup: False,
) -> None:
    """Write as `write_atomic`; back up an existing file that differs, as `back_up`."""
    partial_path = partial(path)
    try:
        partial_path.write_bytes(data)
        if path.is_file() and path.read_bytes() != data:
            back_up(path, keep, is_replaceable)
        partial_path.replace(path)
    except BaseException:
        with suppress(OSError):
            partial_path.unlink()
        raise


def free_folder(path: Path) -> tuple[Path, Path | None]:
    """Return the first free folder `NAME.assets`, `NAME-2.assets`, ... beside a scene, and the last existing one."""
    existing, folder, number = None, path.with_name(f"{path.stem}.assets"), 1
    while folder.exists():
        number += 1
        existing, folder = folder, path.with_name(f"{path.stem}-{number}.assets")
    return folder, existing


BACKUP = re.compile(r"(?P<name>.+)~\d*")
"""Name of a backup: `NAME~`, `NAME~2`, ..."""


def back_up(
    path: Path,
    keep: Callable[[Path], None] = lambda kept: None,
    is_replaceable: Callable[[Path], bool] = lambda backup: False,
) -> None:
    """Move an existing file to its `backup_path`, and call `keep` with that."""
    if path.is_file():
        backup = backup_path(path, is_replaceable)
        path.replace(backup)
        keep(backup)


def backup_path(
    path: Path, is_replaceable: Callable[[Path], bool] = lambda backup: False
) -> Path:
    """Return the first of `NAME~`, `NAME~2`, ... that is free or may be replaced."""
    backup, number = path.with_name(f"{path.name}~"), 1
    while os.path.lexists(backup) and not is_replaceable(backup):
        number += 1
        backup = path.with_name(f"{path.name}~{number}")
    return backup
