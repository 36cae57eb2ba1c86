"""Run `clean`: list files of physgen without a use, and remove them."""

from __future__ import annotations

import argparse
import re
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from physgen import report, scene
from physgen.cli.arguments import Command, Parser
from physgen.cli.output import OK, print_error, print_json, print_line
from physgen.files import cache_folder
from physgen.messages import Message

if TYPE_CHECKING:
    from physgen.scene.saving import UnusedPath

KILOBYTE = 1000
"""Bytes, as file managers count."""


def clean(options: argparse.Namespace) -> int:
    by_place: dict[Path, UnusedPath] = {}
    for path in options.paths or [Path()]:
        for item in _find_unused(path):
            # A path may be reached twice, by a folder and by a scene in it: count it
            # once.
            place = item.path.parent.resolve() / item.path.name
            by_place.setdefault(place, item)
    unused_files = list(by_place.values())
    if options.cache:
        unused_files += _cache()
    # Sizes are unknown after the removal.
    sizes = [item.size for item in unused_files]
    if options.yes:
        for item in unused_files:
            item.remove()
    if options.json:
        rows = [
            {"path": str(item.path), "kind": item.kind.value, "bytes": size}
            for item, size in zip(unused_files, sizes, strict=True)
        ]
        is_removed = bool(options.yes)
        print_json({"unused": rows, "bytes": sum(sizes), "removed": is_removed})
    else:
        _print_table(unused_files, sizes, options.yes)
    return OK


def _find_unused(path: Path) -> list[UnusedPath]:
    """Return the unused paths of a folder or of one scene. Raise InputError."""
    if path.is_dir():
        return _find_unused_in_folder(path)
    if not path.is_file():
        raise Message.NOTHING_TO_CLEAN.error(str(path))
    # A second perception of a photo makes `NAME-2.assets`.
    family = re.compile(rf"{re.escape(path.stem)}(-\d+)?\.assets")
    backup = re.compile(rf"{re.escape(path.name)}~\d*")
    folder = _find_unused_in_folder(path.parent, backup)
    own_assets = scene.saving.assets_of(path)
    backups = [item for item in folder if backup.fullmatch(item.path.name)]
    # A removed backup also frees its assets.
    named_assets = {scene.saving.assets_of(item.path) for item in backups}

    def belongs_to_scene(item: UnusedPath) -> bool:
        name = item.path.name
        if item in backups or item.path in named_assets:
            return True
        if (
            item.kind is scene.saving.UnusedKind.CACHE
            and item.path.parent == own_assets
        ):
            return True
        return bool(family.fullmatch(name)) or name.startswith(f".{path.name}.")

    return list(filter(belongs_to_scene, folder))


def _find_unused_in_folder(
    folder: Path, backup_names: re.Pattern[str] | None = None
) -> list[UnusedPath]:
    """Return the unused paths of a folder; of its backups, those with matching
    names.
    """
    backups = []
    for path in scene.saving.unused_backups(folder):
        if backup_names is None or backup_names.fullmatch(path.name):
            backups.append(path)
    assets = scene.saving.unused_assets(folder, backups)
    # Assets include their cache: count it once.
    caches = []
    for one in scene.saving.caches_of_assets(folder):
        if one.parent not in assets:
            caches.append(one)
    # Unused assets are removed as a whole: partial files inside them would count twice.
    partials = _partials(folder)
    for item in folder.glob("*.assets"):
        if item not in assets:
            partials += _partials(item)
    paths_by_kind = {
        scene.saving.UnusedKind.BACKUP: backups,
        scene.saving.UnusedKind.ASSETS: assets,
        scene.saving.UnusedKind.PARTIAL: partials,
        scene.saving.UnusedKind.CACHE: caches,
    }
    unused_paths = []
    for kind, paths in paths_by_kind.items():
        for path in paths:
            unused_paths.append(scene.saving.UnusedPath(path, kind))
    return unused_paths


def _partials(folder: Path) -> list[Path]:
    return report.folders.unused_leftovers(folder)


def _cache() -> list[UnusedPath]:
    folder = cache_folder()
    if folder.is_dir():
        return [scene.saving.UnusedPath(folder, scene.saving.UnusedKind.CACHE)]
    return []


def _print_table(
    unused_paths: Sequence[UnusedPath], sizes: Sequence[int], is_removed: bool
) -> None:
    width = max((len(str(item.path)) for item in unused_paths), default=0)
    for item, size in zip(unused_paths, sizes, strict=True):
        print_line(f"{item.path!s:<{width}}  {item.kind.value:<7}  {_size_text(size)}")
    total = f"{len(unused_paths)}, {_size_text(sum(sizes))}"
    if not unused_paths:
        print_error("nothing is unused")
    elif is_removed:
        print_error(f"removed: {total}")
    else:
        print_error(f"unused: {total}; --yes removes them")


def _size_text(size: float) -> str:
    """Return a number of bytes with a unit, in three digits or fewer."""
    for unit in ("B", "kB", "MB"):
        if size < KILOBYTE:
            return f"{size:.3g} {unit}"
        size /= KILOBYTE
    return f"{size:.3g} GB"


def add(parser: Parser) -> None:
    help_text = "scene files, or folders; default: the current folder"
    parser.add_argument("paths", metavar="PATH", type=Path, nargs="*", help=help_text)
    parser.flag("--yes", "remove what is listed")
    parser.flag("--cache", "the cache of model answers, too")
    parser.flag("--json", "print as JSON")


CLEAN = Command(
    "clean",
    "Lists backups, assets and partial files that physgen made and nothing uses.",
    "physgen clean scene.yaml --yes",
    add,
    clean,
    is_order_free=True,
)
