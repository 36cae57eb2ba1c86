"""Find clips on disk and read their manifests."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

from physgen.problems import InputError
from physgen.report.folders import looks_like_clip
from physgen.text import natural

# ----------------------------------------------------------------------
# Folders -> the clips below them, one after the other, each with what its manifest tells.

MANIFEST = "manifest.json"


class FoundClip(NamedTuple):
    """A clip's folder."""

    folder: Path
    name: str
    """Its path from above the folder that was named, with `/`: what the clip is called after."""
    told: Mapping[str, Any] | None
    """The manifest; None: it cannot be read."""


def checked_folders(roots: Sequence[Path]) -> list[Path]:
    """Folders that are there, none of them within another. Raises InputError."""
    problems = []
    for root in roots:
        if not root.is_dir():
            fix = "name folders that were rendered or exported into"
            problems += InputError.of(str(root), "", "is no folder", fix).problems
    real = {root: root.resolve() for root in roots}
    for n, root in enumerate(roots):
        for other in roots[:n]:
            if real[root].is_relative_to(real[other]) or real[other].is_relative_to(real[root]):
                expected = f"and {other} hold the same clips"
                problems += InputError.of(str(root), "", expected, "name only one of them").problems
    if problems:
        raise InputError(problems)
    return list(roots)


def find_clips(roots: Sequence[Path]) -> Iterator[FoundClip]:
    """In the order of `roots`, and in each in the natural order of names; one folder's names are held at a time.

    Folders whose names begin with a dot are passed over, and so is what lies in a clip's.
    """
    for root in roots:
        yield from _below(root, root.resolve().name)


def _below(folder: Path, name: str) -> Iterator[FoundClip]:
    try:
        with os.scandir(folder) as entries:
            inside = [(entry.name, entry.is_dir()) for entry in entries if not entry.name.startswith(".")]
    except PermissionError:
        return
    if (MANIFEST, False) in inside:
        told = _told(folder / MANIFEST)
        if told is None or (told.get("manifest") == 1 and "samples" in told):
            yield FoundClip(folder, name, told)
            return
    if (MANIFEST, False) not in inside and looks_like_clip(name for name, _ in inside):
        yield FoundClip(folder, name, None)
        return
    for below in sorted((name for name, is_folder in inside if is_folder), key=natural):
        if not _leads_up(folder / below):
            yield from _below(folder / below, f"{name}/{below}")


def _leads_up(folder: Path) -> bool:
    """Whether it is a link to a folder that it lies in: what is there has been found, and there is no end to it."""
    return folder.is_symlink() and folder.parent.resolve().is_relative_to(folder.resolve())


def _told(path: Path) -> Mapping[str, Any] | None:
    """Web pages have a file of that name, too; None: nobody can read it, and it may be ours."""
    try:
        data = json.loads(path.read_bytes())
    except (OSError, ValueError, RecursionError):
        return None
    return data if isinstance(data, dict) else {}


# ----------------------------------------------------------------------
# Folders -> the clips below them; a clip's manifest.json -> what a run told of itself, as data.


@dataclass(frozen=True)
class Manifest:
    """What a manifest says that a run can be compared by; see `report.record.RunRecord`."""

    source: str | None
    """None: an earlier physgen did not say."""
    variant: str | None
    overrides: tuple[str, ...]
    versions: Mapping[str, str]
    machine: str
    """Its kind and its system."""
    device: str
    inputs: Mapping[str, str]
    files: Mapping[str, str]
    samples: tuple[str, ...]
    frames: tuple[str, ...]
    """Of the clip as it was drawn, before refinement."""
    refined: bool
    """A model retouched it, or was to."""
    film: str
    """What its films are called without their ending: `video`, or `unrefined`."""
    size: tuple[int, int]
    """Width and height of the frames, px."""
    document: Mapping[str, Any]
    """The resolved scene."""


def clip_folders(roots: Sequence[Path]) -> list[Path]:
    """Every folder in or below `roots` that a run of ours left a manifest in, once, in the natural order of paths.

    Folders whose names begin with a dot are passed over, and what is in a clip's. Raises InputError for what is no
    folder, or where there is none at all.
    """
    found: dict[str, Path] = {}
    problems = []
    for root in roots:
        if not root.is_dir():
            problems += InputError.of(
                str(root), "", "is no folder", "name folders that were rendered into"
            ).problems
            continue
        below = {os.path.realpath(folder): folder for folder in _told_below(root)}
        if not below:
            fix = "name a folder that physgen rendered into, e.g. out"
            problems += InputError.of(str(root), "", "holds no clip", fix).problems
        found = {**below, **found}
    if problems:
        raise InputError(problems)
    return sorted(found.values(), key=lambda folder: [natural(part) for part in folder.parts])


def _told_below(root: Path) -> Iterator[Path]:
    for place, folders, files in os.walk(root):
        there = MANIFEST in files
        if _ours(Path(place) / MANIFEST) if there else looks_like_clip((*files, *folders)):
            folders.clear()
            yield Path(place)
        folders[:] = sorted(name for name in folders if not name.startswith("."))


def _ours(path: Path) -> bool:
    """Web pages have a file of that name, too; one that is damaged, or no file, may be ours."""
    if not path.is_file():  # a pipe never ends
        return True
    try:
        data = json.loads(path.read_bytes())
    except (OSError, ValueError, RecursionError):
        return True
    return isinstance(data, dict) and data.get("manifest") == 1 and "samples" in data


def read_manifest(folder: Path) -> Manifest:
    """Raises InputError where the manifest cannot be read."""
    path = folder / MANIFEST
    try:
        if not path.is_file():
            raise OSError
        data: Mapping[str, Any] = json.loads(path.read_bytes())
        refined = bool(data.get("refine"))
        source = data.get("source") or None
        machine, frames = data["platform"], data["unrefined" if refined else "frames"]
        width, height = data["video"]["size"]
        return Manifest(
            source=None if source is None else str(source),
            variant=None if data["variant"] is None else str(data["variant"]),
            overrides=tuple(map(str, data["overrides"])),
            versions=_texts(data["versions"]),
            machine=f"{machine['machine']} {machine['system']}",
            device=str(data["device"]),
            inputs=_texts(data["inputs"]),
            files=_texts(data["files"]),
            samples=tuple(map(str, data["samples"])),
            frames=tuple(map(str, frames)),
            refined=refined,
            film="unrefined" if refined else "video",
            size=(int(width), int(height)),
            document=dict(data["document"]),
        )
    except (OSError, ValueError, KeyError, TypeError, AttributeError, OverflowError, RecursionError):
        fix = "render the scene again"
        raise InputError.of(str(path), "", "is damaged: it is no manifest that can be read", fix) from None


def _texts(data: Mapping[str, Any]) -> dict[str, str]:
    return {str(name): str(value) for name, value in data.items()}
