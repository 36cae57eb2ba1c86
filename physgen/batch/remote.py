"""Remote folders by fsspec: recognise URLs, list, read and write files.

The command line imports this module at its start, so that other modules are imported where they are needed.
"""

from __future__ import annotations

import errno
import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

from physgen.problems import InputError

LOCAL = ("file", "local")
PRIVATE = ("memory",)
"""Protocols of places that only one process sees."""
STORES = ("s3", "s3a", "gs", "gcs", "az", "abfs", "abfss", "adl", "oss", "hf")
"""Protocols of places without folders."""
LIBRARIES = {
    **dict.fromkeys(("s3", "s3a"), "s3fs"),
    **dict.fromkeys(("gs", "gcs"), "gcsfs"),
    **dict.fromkeys(("az", "abfs", "abfss"), "adlfs"),
    **dict.fromkeys(("http", "https"), "aiohttp"),
    **dict.fromkeys(("sftp", "ssh"), "paramiko"),
}
"""What to install for a protocol."""
INSTALL = "pip install 'physgen[remote]'"
BLOCK = 2**20
"""Bytes that are copied at a time."""
_URL = re.compile(r"(?P<protocol>[a-zA-Z][a-zA-Z0-9+.-]+)://")


def protocol(text: str) -> str:
    """In lower case; empty for a path.

    >>> protocol("S3://films/pool"), protocol("c://pool"), protocol("out")
    ('s3', '', '')
    """
    match = _URL.match(text)
    return match["protocol"].lower() if match else ""


def is_url(text: str) -> bool:
    """Whether it names a place by a protocol."""
    return bool(protocol(text))


def is_private(text: str) -> bool:
    """Whether it names a place that no other process can see."""
    return protocol(text) in PRIVATE


def plain(text: str) -> str:
    """The path of a `file://` URL; any other text unchanged. Raises InputError for another machine's.

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
    """The URL of `name` in a folder.

    >>> url_below("s3://films/", "pool"), url_below("memory://", "pool")
    ('s3://films/pool', 'memory://pool')
    """
    return f"{url}{name}" if url.endswith("://") else f"{url.rstrip('/')}/{name}"


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
        """The bytes of a file, at most `most` and one more; None where it does not exist."""
        with self._os_errors(name):
            try:
                with self.fs.open(self._at(name), "rb") as file:
                    return bytes(file.read(most + 1))
            except (FileNotFoundError, IsADirectoryError):
                return None

    def fetch(self, name: str, path: Path, most: int) -> bool:
        """Copies a file of at most `most` bytes to `path`; returns whether there is such a file."""
        left = most
        with self._os_errors(name):
            try:
                with self.fs.open(self._at(name), "rb") as file, path.open("wb") as out:
                    while left >= 0 and (block := file.read(min(BLOCK, left + 1))):
                        left -= len(block)
                        out.write(block)
            except (FileNotFoundError, IsADirectoryError):
                left = -1
        if left < 0:
            path.unlink(missing_ok=True)
        return left >= 0

    def files(self) -> dict[str, int]:
        """All files in and below it, and their bytes, by relative name; none where it does not exist.

        Names that lead out of a folder, or that some file systems cannot hold, are left out: a store allows any name.
        """
        with self._os_errors(""):
            self.fs.invalidate_cache()
            try:
                found: Mapping[str, Mapping[str, Any]] = self.fs.find(self.root, detail=True)
            except FileNotFoundError:
                return {}
            start = len(self.root.rstrip("/")) + 1
            return {
                path[start:]: int(info.get("size") or 0)
                for path, info in found.items()
                if path[start:] and _is_safe(path[start:])
            }

    def top(self) -> list[str]:
        """Names of the files and folders in it; none where it does not exist."""
        with self._os_errors(""):
            self.fs.invalidate_cache()
            try:
                paths = self.fs.ls(self.root, detail=False)
            except FileNotFoundError:
                return []
            names = [str(path).rstrip("/").rpartition("/")[2] for path in paths]
            return list(filter(_is_safe, names))

    def write(self, name: str, data: bytes) -> None:
        """Writes a file, which appears complete."""
        with self._os_errors(name):
            try:
                self.fs.pipe_file(self._at(name), data)
            except FileNotFoundError:
                if protocol(self.url) in STORES:  # a missing bucket is not made
                    raise
                self.fs.makedirs(self._at(name).rpartition("/")[0], exist_ok=True)
                self.fs.pipe_file(self._at(name), data)

    def send(self, files: Mapping[str, Path]) -> None:
        """Copies local files to their names here, several at a time."""
        if files:
            with self._os_errors(""):
                self.fs.put([str(path) for path in files.values()], [self._at(name) for name in files])

    def remove(self, names: list[str]) -> None:
        """Removes files, those that exist."""
        with self._os_errors(""):
            for name in names:
                with suppress(FileNotFoundError):
                    self.fs.rm_file(self._at(name))

    def _at(self, name: str) -> str:
        return f"{self.root.rstrip('/')}/{name}" if name else self.root

    @contextmanager
    def _os_errors(self, name: str) -> Iterator[None]:
        """Turns the errors of file systems, which are of many kinds, into OSError with the URL."""
        url = url_below(self.url, name) if name else self.url
        try:
            yield
        except OSError as error:
            raise OSError(error.errno or errno.EIO, error.strerror or str(error), url) from error
        except Exception as error:
            raise OSError(errno.EIO, f"{type(error).__name__}: {error}", url) from error


def _is_safe(name: str) -> bool:
    """Whether a name stays within its folder and can be a file's everywhere."""
    from physgen.scene.unpack import fault_of

    return fault_of(name) is None


@lru_cache(64)
def open_folder(url: str) -> RemoteFolder:
    """The folder of a URL, whether it exists or not. Raises InputError where its protocol is not known."""
    kind = protocol(url)
    library = LIBRARIES.get(kind, "")
    try:
        from fsspec.core import url_to_fs
    except ImportError:
        found = "is a URL, and fsspec, which reads those, is not installed"
        raise InputError.of(url, "", found, f"{INSTALL} {library}".rstrip()) from None
    try:
        fs, root = url_to_fs(url)
    except ImportError:
        found = f"needs a library for {kind}:// that is not installed"
        raise InputError.of(url, "", found, f"pip install {library or kind}") from None
    except Exception as error:  # an unknown protocol, or wrong settings
        reason = str(error).split("\n")[0].rstrip(".")
        fix = "write a path, or a URL of a protocol that fsspec knows, e.g. s3://bucket/folder"
        raise InputError.of(url, "", f"cannot be opened ({reason})", fix) from None
    return RemoteFolder(url, fs, str(root))
