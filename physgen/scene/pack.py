"""Writes a pack: one file with the scene, what it extends, its photo and its maps."""

from __future__ import annotations

import io
import json
import os
import posixpath
import zipfile
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

from physgen.problems import InputError, Limit, Place, Problem
from physgen.scene.document import Node, children
from physgen.scene.files import ASSETS, DATA, beside, read_scene, with_bases
from physgen.scene.load import load, scene_name
from physgen.scene.overlay import apply, edits_of_variant, variants_of
from physgen.scene.unpack import CONTENTS, VERSION, is_plain
from physgen.text import shown

EPOCH = (1980, 1, 1, 0, 0, 0)
"""The first moment that a zip can hold."""


def pack_scene(path: str | os.PathLike[str]) -> bytes:
    """The pack of a scene file; the same scene gives the same bytes, wherever it lies and whenever it is packed.

    Files that its variants name come along. Raises InputError with every problem of the scene, or one of packing.
    """
    try:
        load(path)
    except InputError as error:  # a pack has no place for files outside the scene's folder
        hint = ", or use --allow-outside"
        raise InputError(replace(p, fix=p.fix.removesuffix(hint)) for p in error.problems) from None
    file = Path(os.fspath(path))
    home = Path(os.path.abspath(file)).parent
    top = home.name or scene_name(file) or "scene"
    scenes = {f"{top}/{file.name}": file}
    files: dict[str, Path | None] = {}
    node, base = read_scene(file, str(file)), file
    while (link := children(node).get("extends")) is not None:
        base = link.source.folder / str(link.value)
        scenes[_name(link, home, top)] = base
        node = read_scene(base, beside(node.source.name, str(link.value)))
    root = with_bases(read_scene(file, str(file)), file, False)
    for key, named in pictures_named(root):
        name = _name(named, home, top)
        if key == "image":
            files[name] = named.source.folder / str(named.value)
            continue
        folder = named.source.folder / str(named.value)
        maps = {f"{name}/{file}": folder / file for file in ASSETS}
        there: dict[str, Path | None] = {member: path for member, path in maps.items() if path.is_file()}
        files |= there or {f"{name}/": None}
    return _written(file, next(iter(scenes)), scenes, files)


def pictures_named(root: Node) -> Iterator[tuple[str, Node]]:
    """Every `image` and `assets` of the scene and its variants: key and value."""
    trees = [root]
    for _, variant in variants_of(root):
        tree = root
        for edit in edits_of_variant(variant, ""):
            tree = apply(tree, edit)
        trees.append(tree)
    seen: set[Node] = set()
    for tree in trees:
        for key in ("image", "assets"):
            node = children(tree).get(key)
            if node is not None and node not in seen:
                seen.add(node)
                yield key, node


def _name(node: Node, home: Path, top: str) -> str:
    """Where the file that a value names stands in the pack. Raises InputError where it has no place."""
    value = str(node.value)
    full = os.path.normpath(node.source.folder / value)
    name = posixpath.normpath(posixpath.join(top, Path(os.path.relpath(full, home)).as_posix()))
    parts = [part for part in value.split("/") if part not in ("", ".")]
    up = next((k for k, part in enumerate(parts) if part != ".."), len(parts))
    if ".." in parts[up:]:  # `a/../b` needs a folder `a`, which may not come along
        found, fix = "leads round about", "write the straight path"
        raise InputError([Problem(node.place, "", shown(value), found, fix)])
    if not is_plain(name):
        found = "is no plain name that leads straight down"
        raise InputError([Problem(node.place, "", repr(name), found, "rename it")])
    return name


def _written(file: Path, scene: str, scenes: dict[str, Path], files: dict[str, Path | None]) -> bytes:
    """The bytes of the pack: the scene first, then what it extends, then pictures."""
    members = [scene, *sorted(scenes.keys() - {scene}), *sorted(files)]
    if len(members) > Limit.FILES.most:
        raise Limit.FILES.error(Place(str(file)), found=f"{len(members):,} files")
    out, left = io.BytesIO(), Limit.PACK.most
    page = json.dumps({"pack": VERSION, "scene": scene}, ensure_ascii=False) + "\n"
    with zipfile.ZipFile(out, "w") as archive:
        archive.writestr(_entry(CONTENTS), page.encode("utf-8"))
        for member in members:
            path = scenes.get(member) or files[member]
            is_text = member in scenes or posixpath.basename(member) in DATA
            data = b"" if path is None else _bytes(path, Limit.BYTES if is_text else Limit.PICTURE)
            left -= len(data)
            if left < 0:
                raise Limit.PACK.error(Place(str(file)))
            archive.writestr(_entry(member), data)
    return out.getvalue()


def _entry(name: str) -> zipfile.ZipInfo:
    """A member of the zip; its attributes are the same for all files."""
    entry = zipfile.ZipInfo(name, EPOCH)
    entry.create_system = 3  # Unix, wherever it is packed
    entry.external_attr = (0o40755 << 16 | 0x10) if name.endswith("/") else 0o100644 << 16
    return entry


def _bytes(path: Path, limit: Limit) -> bytes:
    with path.open("rb") as file:
        data = file.read(limit.most + 1)
    if len(data) > limit.most:
        raise limit.error(Place(str(path)))
    return data
