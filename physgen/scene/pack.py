"""Writes a pack: one file with the scene, what it extends, its photo and its maps."""

from __future__ import annotations

import io
import os
import posixpath
import zipfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import NoReturn

from physgen.problems import InputError, Place, Problem, Severity, Warn, ignore_warning
from physgen.scene.document import MAX_BYTES, Node, Source, children
from physgen.scene.files import MAPS, read_scene, with_bases
from physgen.scene.load import load, scene_name
from physgen.scene.overlay import apply, edit_of_flag, edits_of_variant, variants_of
from physgen.scene.pack_format import (
    CONTENTS,
    MOST_FILES,
    MOST_PICTURE,
    MOST_WHOLE,
    clash_of,
    contents,
    fault_of,
)
from physgen.scene.write import rewritten
from physgen.text import shown

ELSEWHERE = "elsewhere"
"""Folder of what lay outside the scene's own."""
EPOCH = (1980, 1, 1, 0, 0, 0)
"""The first moment that a zip can tell."""


def pack_scene(
    path: str | os.PathLike[str],
    overrides: Sequence[str] = (),
    allow_outside: bool = False,
    warn: Warn = ignore_warning,
    variant: str | None = None,
) -> bytes:
    """The pack of a scene file; the same scene gives the same bytes, wherever it lies and whenever it is packed.

    Files that its variants or `KEY=VALUE` overrides name come along; overrides are not written down. With
    `allow_outside`, files from outside the scene's folder come along, too, and the pack does not need it; `warn` gets
    each path that had to be changed. Raises InputError with every problem of the scene, or of that
    `variant` of it, or one of packing.
    """
    load(path, overrides, variant, allow_outside)
    file = Path(os.fspath(path))
    layout = _Layout(file, warn)
    root = layout.scenes(allow_outside)
    for node in pictures_named(root, overrides, layout.home):
        layout.add(node)
    return layout.written()


def pictures_named(root: Node, overrides: Sequence[str], source: Source) -> Iterator[tuple[str, Node]]:
    """Every `image` and `assets` of the scene, its variants and the flags: key and value."""
    trees = [root]
    for _, variant in variants_of(root):
        tree = root
        for edit in edits_of_variant(variant, ""):
            tree = apply(tree, edit)
        trees.append(tree)
    if overrides:
        tree = root
        for text in overrides:
            tree = apply(tree, edit_of_flag(text, source))
        trees.append(tree)
    seen: set[Node] = set()
    for tree in trees:
        for key in ("image", "assets"):
            node = children(tree).get(key)
            if node is not None and node not in seen:
                seen.add(node)
                yield key, node


@dataclass
class _Layout:
    """Where every file stands in the pack."""

    file: Path
    warn: Warn
    home: Source = field(init=False)
    """The scene file's."""
    scene: str = field(init=False)
    """Its name in the pack."""
    files: dict[str, Path | None] = field(default_factory=dict)
    """Name in the pack -> the file; None for a folder without files."""
    _texts: dict[str, bytes] = field(default_factory=dict)
    """Of scene files, by name in the pack."""
    _at: dict[Source, str] = field(default_factory=dict)
    """Where a scene file stands in the pack."""
    _anew: dict[str, list[tuple[Node, str]]] = field(default_factory=dict)
    """Values to write anew, by name of the file in the pack."""
    _moved: dict[tuple[str, str], str] = field(default_factory=dict)
    """Scene file and what it names -> where that stands from there, of what had no place."""
    _count: int = 0

    def __post_init__(self) -> None:
        self.home = Source(str(self.file), Path(os.path.abspath(self.file)).parent)
        self.scene = f"{self.home.folder.name or scene_name(self.file) or 'scene'}/{self.file.name}"

    def scenes(self, allow_outside: bool) -> Node:
        """Places the scene file and all that it extends; returns the whole tree."""
        node = read_scene(self.file, str(self.file))
        root, path, name, source = node, self.file, self.scene, self.home
        while True:
            self._put(name, path, node)
            self._at[source] = name
            self._texts[name] = _bytes(path, MAX_BYTES, str(path))
            link = children(node).get("extends")
            if link is None:
                return with_bases(root, self.file, allow_outside)
            path = source.folder / str(link.value)
            wish = self._lexical(link)
            name = self._fitting([wish], [path], link, wish is not None)[0]
            shown_as = os.path.normpath(os.path.join(os.path.dirname(source.name), str(link.value)))
            node = read_scene(path, shown_as)
            source = Source(shown_as, Path(os.path.abspath(path)).parent)

    def add(self, named: tuple[str, Node]) -> None:
        """Places a photo, or all maps of a folder."""
        key, node = named
        path = node.source.folder / str(node.value)
        wish = self._lexical(node)
        beneath = wish is not None and self._beneath(wish, node)
        if key == "image":
            (name,) = self._fitting([wish], [path], node, beneath)
            self._put(name, path, node)
            return
        maps = [path / f"{name}.png" for name in MAPS if (path / f"{name}.png").is_file()]
        wishes = [None if wish is None else posixpath.join(wish, file.name) for file in maps]
        folder = self._fitting([*wishes, wish], [*maps, path], node, beneath)[-1]
        for file in maps:
            self._put(f"{folder}/{file.name}", file, node)
        if not maps:
            self.files.setdefault(f"{folder}/", None)

    def _home_of(self, node: Node) -> str:
        """Name of the scene file that holds a value; the opened one's for a flag."""
        return self._at.get(node.source, self.scene)

    def _lexical(self, node: Node) -> str | None:
        """Where a path leads from where its file stands in the pack; None where it leads nowhere or round about."""
        value = str(node.value)
        if os.path.isabs(value):
            return None
        parts = [part for part in value.split("/") if part not in ("", ".")]
        up = next((k for k, part in enumerate(parts) if part != ".."), len(parts))
        wish = posixpath.normpath(posixpath.join(posixpath.dirname(self._home_of(node)), *parts))
        # `a/../b` needs a folder `a`, which may not come along
        return None if ".." in parts[up:] or wish.split("/")[0] in ("..", ".") else wish

    def _beneath(self, wish: str, node: Node) -> bool:
        """Whether it is below the folder of the file that names it."""
        return f"{wish}/".startswith(posixpath.dirname(self._home_of(node)) + "/")

    def _fitting(
        self, wishes: Sequence[str | None], paths: Sequence[Path], node: Node, fits: bool
    ) -> list[str]:
        """Names for files: as wished where that works without leave to go outside, else in a folder of their own."""
        free = all(
            wish is None or self.files.get(wish) is None or _same(self.files[wish], path)
            for wish, path in zip(wishes, paths, strict=True)
        )
        if fits and free:
            return [wish for wish in wishes if wish is not None]
        if not node.line:
            expected = "lies outside the scene's folder, and a flag is not packed"
            self._refuse(node.place, shown(node.value), expected, "write it in the scene file")
        home = self._home_of(node)
        target = self._elsewhere(home, paths[-1])
        self._anew.setdefault(home, []).append((node, target))
        found, fix = shown(node.value), f'the pack has it as "{target}", and says so there'
        expected = "lies where a pack has no place"
        self.warn(Problem(node.place, "", found, expected, fix, Severity.WARNING))
        whole = posixpath.join(posixpath.dirname(home), target)
        return [*(f"{whole}/{path.name}" for path in paths[:-1]), whole]

    def _elsewhere(self, home: str, path: Path) -> str:
        """A name in a folder of its own, relative to the scene file `home`; the same for the same file."""
        real = os.path.realpath(path)
        while (home, real) not in self._moved:
            self._count += 1
            near = posixpath.join(posixpath.dirname(home), ELSEWHERE, str(self._count), "")
            if not any(name.startswith(near) for name in self.files):
                self._moved[home, real] = f"{ELSEWHERE}/{self._count}/{os.path.basename(real) or 'maps'}"
        return self._moved[home, real]

    def _put(self, name: str, path: Path, node: Node) -> None:
        if (fault := fault_of(name)) is not None:
            self._refuse(node.place, repr(fault.name), fault.expected, fault.fix)
        self.files[name] = path

    def _refuse(self, place: Place, found: str, expected: str, fix: str) -> NoReturn:
        raise InputError([Problem(place, "", found, expected, fix)])

    def written(self) -> bytes:
        """The bytes of the pack."""
        name = str(self.file)
        if (fault := clash_of(self.files)) is not None:
            raise InputError.of(name, fault.name, fault.expected, fault.fix)
        if len(self.files) > MOST_FILES:
            found = f"{len(self.files):,} files"
            raise InputError.of(name, found, f"are over the {MOST_FILES:,} of a pack", "pack fewer variants")
        out, left = io.BytesIO(), MOST_WHOLE
        with zipfile.ZipFile(out, "w") as archive:
            archive.writestr(_entry(CONTENTS), contents(self.scene))
            for member in sorted(self.files, key=self._order):
                data = self._data(member, left)
                left -= len(data)
                archive.writestr(_entry(member), data)
        return out.getvalue()

    def _order(self, member: str) -> tuple[int, str]:
        """The scene first, then what it extends, then pictures."""
        return (0 if member == self.scene else 1 if member in self._texts else 2), member

    def _data(self, member: str, left: int) -> bytes:
        path = self.files[member]
        if path is None:
            return b""
        if member in self._texts:
            data = rewritten(self._texts[member], self._anew.get(member, ()))
        else:
            data = _bytes(path, MOST_PICTURE, str(path))
        if len(data) > left:
            raise InputError.of(
                str(self.file), "", f"needs more than {MOST_WHOLE >> 30} GiB", "make its photo smaller"
            )
        return data


def _entry(name: str) -> zipfile.ZipInfo:
    """A member of the zip; its attributes are the same for all files."""
    entry = zipfile.ZipInfo(name, EPOCH)
    entry.create_system = 3  # Unix, wherever it is packed
    entry.external_attr = (0o40755 << 16 | 0x10) if name.endswith("/") else 0o100644 << 16
    return entry


def _bytes(path: Path, most: int, name: str) -> bytes:
    with path.open("rb") as file:
        data = file.read(most + 1)
    if len(data) > most:
        raise InputError.of(name, "", f"is larger than {most >> 20} MiB", "make it smaller")
    return data


def _same(one: Path | None, other: Path) -> bool:
    return one is not None and os.path.realpath(one) == os.path.realpath(other)
