"""Remote folders by fsspec: recognise URLs, list, read and write files."""

from __future__ import annotations

import errno
import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import datetime
from functools import lru_cache
from pathlib import Path
from typing import Any

from physgen.problems import InputError
from physgen.scene.pack_format import fault_of

# ----------------------------------------------------------------------
# Texts that name scenes and folders -> whether they are URLs, and what those are called; nothing is opened.

_URL = re.compile(r"(?P<protocol>[a-zA-Z][a-zA-Z0-9+.-]+)://")
LOCAL = ("file", "local")
PRIVATE = ("memory",)
"""Protocols of places that only one process sees."""


def protocol(text: str) -> str:
    """In small letters; empty for a path.

    >>> protocol("S3://films/pool"), protocol("c://pool"), protocol("out")
    ('s3', '', '')
    """
    match = _URL.match(text)
    return match["protocol"].lower() if match else ""


def is_url(text: str) -> bool:
    """Whether it names a place by a protocol."""
    return bool(protocol(text))


def is_private(text: str) -> bool:
    """Whether it is a place that no other process can see."""
    return protocol(text) in PRIVATE


def plain(text: str) -> str:
    """The path that a `file://` URL means; any other text as it is. Raises InputError for another machine's.

    >>> plain("file:///tmp/a%20b"), plain("s3://films"), plain("out")
    ('/tmp/a b', 's3://films', 'out')
    """
    if protocol(text) not in LOCAL:
        return text
    from urllib.parse import unquote, urlsplit

    parts = urlsplit(text)
    if parts.netloc not in ("", "localhost"):
        fix = f"for a path on this machine, write {parts.scheme}:///{parts.netloc}{parts.path}"
        raise InputError.of(text, "", "names a file of another machine", fix)
    return unquote(parts.path)


def url_below(url: str, name: str) -> str:
    """The URL of what is called `name` in a folder.

    >>> url_below("s3://films/", "pool"), url_below("memory://", "pool")
    ('s3://films/pool', 'memory://pool')
    """
    return f"{url}{name}" if url.endswith("://") else f"{url.rstrip('/')}/{name}"


# ----------------------------------------------------------------------
# URLs of folders -> the files there, by fsspec, which nothing else imports.

STORES = ("s3", "s3a", "gs", "gcs", "az", "abfs", "abfss", "adl", "oss", "hf")
"""Protocols of places without folders."""
INSTALL = "pip install 'physgen[remote]'"
BLOCK = 2**20


@dataclass(frozen=True)
class RemoteFile:
    """What a place says of a file."""

    size: int
    """Bytes."""
    time: float
    """When it was written, s since 1970; 0 where the place does not say."""


def _time(told: Mapping[str, Any]) -> float:
    """Libraries have a word each for when a file was written."""
    for word in ("LastModified", "last_modified", "updated", "mtime", "created"):
        said = told.get(word)
        if isinstance(said, str):
            try:
                said = datetime.fromisoformat(said)
            except ValueError:
                continue
        if isinstance(said, datetime):
            return said.timestamp()
        if isinstance(said, (int, float)):
            return float(said)
    return 0.0


@dataclass(frozen=True)
class RemoteFolder:
    """A folder behind a URL. Every method raises OSError where it cannot be reached."""

    url: str
    fs: Any
    """The file system of fsspec."""
    root: str
    """The folder's name there."""

    def below(self, name: str) -> RemoteFolder:
        """A folder in it."""
        return RemoteFolder(url_below(self.url, name), self.fs, self._at(name))

    def read(self, name: str, most: int) -> bytes | None:
        """The bytes of a file, `most` and one more at most; None where there is none."""
        with self._asked(name):
            try:
                with self.fs.open(self._at(name), "rb") as file:
                    return bytes(file.read(most + 1))
            except (FileNotFoundError, IsADirectoryError):
                return None

    def fetch(self, name: str, path: Path, most: int) -> bool:
        """Copies a file to `path`, where it is `most` bytes long; whether there is one of that size."""
        with self._asked(name):
            try:
                with self.fs.open(self._at(name), "rb") as file, path.open("wb") as out:
                    left = most
                    while block := file.read(min(BLOCK, left + 1)):
                        left -= len(block)
                        if left < 0:
                            break
                        out.write(block)
            except (FileNotFoundError, IsADirectoryError):
                path.unlink(missing_ok=True)
                return False
        if left < 0:
            path.unlink()
        return left >= 0

    def files(self) -> dict[str, RemoteFile]:
        """What is known of each file in or below it without reading any; none where there is no such folder.

        A store may have files of any name: those are left out that lead out of a folder, or mean another on some disk.
        """
        with self._asked(""):
            self.fs.invalidate_cache()
            try:
                found: Mapping[str, Mapping[str, Any]] = self.fs.find(self.root, detail=True)
            except FileNotFoundError:
                return {}
            start = len(self.root.rstrip("/")) + 1
            return {
                path[start:]: RemoteFile(int(told.get("size") or 0), _time(told))
                for path, told in found.items()
                if path[start:] and fault_of(path[start:]) is None
            }

    def top(self) -> list[str]:
        """Names of what is in it; none where there is no such folder."""
        with self._asked(""):
            self.fs.invalidate_cache()
            try:
                listed = self.fs.ls(self.root, detail=False)
                names = [str(path).rstrip("/").rpartition("/")[2] for path in listed]
                return [name for name in names if fault_of(name) is None]
            except FileNotFoundError:
                return []

    def write(self, name: str, data: bytes) -> None:
        """A file that is whole at once, as object stores do it."""
        with self._asked(name):
            try:
                self.fs.pipe_file(self._at(name), data)
            except FileNotFoundError:
                if protocol(self.url) in STORES:  # a bucket that is not there is not ours to make
                    raise
                self.fs.makedirs(self._at(name).rpartition("/")[0], exist_ok=True)
                self.fs.pipe_file(self._at(name), data)

    def send(self, files: Mapping[str, Path]) -> None:
        """Files by their names there, several at a time where the place can take them so."""
        if files:
            with self._asked(""):
                self.fs.put([str(path) for path in files.values()], [self._at(name) for name in files])

    def remove(self, names: list[str]) -> None:
        """Files that are there."""
        with self._asked(""):
            for name in names:
                with _unless_gone():
                    self.fs.rm_file(self._at(name))

    def _at(self, name: str) -> str:
        return f"{self.root.rstrip('/')}/{name}" if name else self.root

    @contextmanager
    def _asked(self, name: str) -> Iterator[None]:
        """Libraries of stores raise errors of many kinds."""
        url = url_below(self.url, name) if name else self.url
        try:
            yield
        except OSError as error:
            raise OSError(error.errno or errno.EIO, error.strerror or str(error), url) from error
        except Exception as error:
            raise OSError(errno.EIO, f"{type(error).__name__}: {error}", url) from error


@contextmanager
def _unless_gone() -> Iterator[None]:
    try:
        yield
    except FileNotFoundError:
        return


@lru_cache(64)
def open_folder(url: str) -> RemoteFolder:
    """The folder that a URL names, whether it is there or not. Raises InputError where nobody knows its protocol."""
    kind = protocol(url)
    try:
        from fsspec.core import url_to_fs
    except ImportError:
        fix = f"{INSTALL}{_library(kind, ' ')}"
        raise InputError.of(
            url, "", "is a URL, and fsspec, which reads those, is not installed", fix
        ) from None
    try:
        fs, root = url_to_fs(url)
    except ImportError as error:
        fix = _library(kind, "pip install ") or f"{error}"
        expected = f"needs a library for {kind}:// that is not installed"
        raise InputError.of(url, "", expected, fix) from None
    except ValueError as error:
        fix = "write a path, or a URL of a protocol that fsspec knows, e.g. s3://bucket/folder"
        found = str(error).split("\n")[0].rstrip(".")
        raise InputError.of(url, "", f"cannot be opened ({found})", fix) from None
    except Exception as error:  # what is wrong with its settings
        fix = "see that library's documentation on settings and credentials"
        raise InputError.of(url, "", f"cannot be opened ({type(error).__name__}: {error})", fix) from None
    return RemoteFolder(url, fs, str(root))


def _library(kind: str, before: str) -> str:
    """What to install for a protocol, behind `before`; empty where fsspec itself reads it or nobody knows."""
    known = {"s3": "s3fs", "s3a": "s3fs", "gs": "gcsfs", "gcs": "gcsfs", "az": "adlfs", "abfs": "adlfs"}
    known |= {"abfss": "adlfs", "http": "aiohttp", "https": "aiohttp", "sftp": "paramiko", "ssh": "paramiko"}
    return f"{before}{known[kind]}" if kind in known else ""
