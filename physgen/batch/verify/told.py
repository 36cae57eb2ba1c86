"""Folders -> the clips below them; a clip's manifest.json -> what a run told of itself, as data."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from physgen.problems import InputError
from physgen.report.folder import seems_clip
from physgen.scene.words import natural

MANIFEST = "manifest.json"


@dataclass(frozen=True)
class Told:
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
        below = {os.path.realpath(folder): folder for folder in _below(root)}
        if not below:
            fix = "name a folder that physgen rendered into, e.g. out"
            problems += InputError.of(str(root), "", "holds no clip", fix).problems
        found = {**below, **found}
    if problems:
        raise InputError(problems)
    return sorted(found.values(), key=lambda folder: [natural(part) for part in folder.parts])


def _below(root: Path) -> Iterator[Path]:
    for place, folders, files in os.walk(root):
        there = MANIFEST in files
        if _ours(Path(place) / MANIFEST) if there else seems_clip((*files, *folders)):
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


def read_told(folder: Path) -> Told:
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
        return Told(
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
