"""Fetch a remote scene with the files that it names.

A scene is untrusted wherever it comes from: only files that a local scene might read are fetched, so nothing above the
folder that holds the scene's folder, and no larger files than are allowed there.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from itertools import count
from pathlib import Path

from physgen.batch.remote import RemoteFolder, open_folder
from physgen.problems import InputError
from physgen.report.folders import process_folder
from physgen.scene.document import MAX_BYTES, Node, children
from physgen.scene.files import MAPS, MAX_EXTENDS, SUFFIXES, RefusedError, confined, read_scene, with_bases
from physgen.scene.pack import pictures_named
from physgen.scene.unpack import MAX_PICTURE

_FETCHED: dict[tuple[str, tuple[str, ...]], Path] = {}
"""URL and overrides that name files -> local file of the scene."""
_NUMBERS = count()


def fetch_scene(url: str, overrides: Sequence[str] = ()) -> Path:
    """The scene's file in a local folder, fetched once by a process, with the files that `overrides` name.

    Raises InputError with what is wrong with the scene, OSError where the place cannot be reached.
    """
    scene = url, file_overrides(overrides)
    if scene not in _FETCHED:
        folder = process_folder() / f"scene-{next(_NUMBERS)}"
        _FETCHED[scene] = _fetch(url, scene[1], folder)
    return _FETCHED[scene]


def file_overrides(overrides: Sequence[str]) -> tuple[str, ...]:
    """Those that name files.

    >>> file_overrides(["image=b.png", "objects.ball.mass=3", "variants.dark.assets=dark"])
    ('image=b.png', 'variants.dark.assets=dark')
    """
    return tuple(
        text for text in overrides if text.partition("=")[0].rpartition(".")[2] in ("image", "assets")
    )


def _fetch(url: str, overrides: Sequence[str], folder: Path) -> Path:
    """Copies the scene and its files below `folder`, with the same relative paths. Raises InputError."""
    parent, _, name = url.rpartition("/")
    above, _, home = parent.rpartition("/")
    if not name.lower().endswith(SUFFIXES):
        raise InputError.of(url, "", "is not a scene file", "name a .yaml file")
    if not home or above.endswith(":/"):  # it lies in the bucket itself
        above, home = parent if parent.endswith("/") else f"{parent}/", ""
    copies = _Copies(open_folder(above), folder / "root")
    top = Path(home, name)
    if not copies.bring(top, MAX_BYTES):
        found = "no such file, or one of more than 8 MiB"
        raise InputError.of(url, "", found, "write the URL of a scene file")
    node = read_scene(copies.root / top, url)
    for _ in range(MAX_EXTENDS):
        link = children(node).get("extends")
        path = None if link is None else _allowed_path(link, copies.root)
        if path is None or path.suffix.lower() not in SUFFIXES:
            break  # an error is reported when all is read
        if not copies.bring(path.relative_to(copies.root), MAX_BYTES):
            break
        node = read_scene(path, str(path))
    file = copies.root / top
    root = with_bases(read_scene(file, url), file, False)
    for key, named in pictures_named(root, overrides, root.source):
        path = _allowed_path(named, named.source.folder)
        for wanted in () if path is None else _pictures(key, path.relative_to(copies.root)):
            copies.bring(wanted, MAX_PICTURE)
    return file


def _allowed_path(node: Node, within: Path) -> Path | None:
    """The path that a value names below `within`; None where it names none, which is reported later."""
    if not isinstance(node.value, str) or not node.value:
        return None
    try:
        path = confined(node.value, node.source.folder, within, False)
    except RefusedError:
        return None
    return Path(os.path.normpath(path))


def _pictures(key: str, path: Path) -> Iterator[Path]:
    if key == "image":
        yield path
    else:
        yield from (path / f"{name}.png" for name in MAPS)


class _Copies:
    """Local copies of remote files, each fetched once."""

    def __init__(self, source: RemoteFolder, root: Path) -> None:
        self._source, self.root = source, root
        self._fetched: dict[Path, bool] = {}

    def bring(self, name: Path, most: int) -> bool:
        """Whether there is such a file, of at most `most` bytes."""
        if name not in self._fetched:
            target = self.root / name
            target.parent.mkdir(parents=True, exist_ok=True)
            self._fetched[name] = self._source.fetch(name.as_posix(), target, most)
        return self._fetched[name]
