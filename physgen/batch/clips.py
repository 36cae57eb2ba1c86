"""Find clips on disk and read their manifests."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

from physgen.messages import Message
from physgen.problems import InputError, Problem
from physgen.report.folders import looks_like_clip
from physgen.text import natural

MANIFEST = "manifest.json"


class FoundClip(NamedTuple):
    """The folder of a clip."""

    folder: Path
    # Path below the parent of the user's folder, separated by `/`.
    name: str
    # None for an unreadable manifest.
    manifest: Mapping[str, Any] | None


def checked_folders(roots: Sequence[Path]) -> list[Path]:
    """Return the folders after a check that all exist and none lies within another.
    Raise InputError.
    """
    problems = []
    for root in roots:
        if not root.is_dir():
            problems += Message.NOT_A_FOLDER_OF_CLIPS.error(str(root)).problems
    problems += _repeated_roots(roots)
    if problems:
        raise InputError(problems)
    return list(roots)


def check_distinct(roots: Sequence[Path]) -> None:
    """Raise InputError if a folder lies within another one."""
    problems = _repeated_roots(roots)
    if problems:
        raise InputError(problems)


def _repeated_roots(roots: Sequence[Path]) -> list[Problem]:
    """Return a problem for each pair of nested folders."""
    real = {root: root.resolve() for root in roots}
    problems: list[Problem] = []
    for n, root in enumerate(roots):
        for other in roots[:n]:
            if real[root].is_relative_to(real[other]) or real[other].is_relative_to(
                real[root]
            ):
                message = Message.FOLDERS_SHARE_CLIPS
                problems += message.error(str(root), other=other).problems
    return problems


def find_clips(roots: Sequence[Path]) -> Iterator[FoundClip]:
    """Yield clips in the order of `roots`, and below each root in natural order of
    names.

    List one folder at a time. Skip folders with a leading dot and folders within a
    clip.
    """
    for root in roots:
        yield from _find_below(root, root.resolve().name)


def _find_below(folder: Path, name: str) -> Iterator[FoundClip]:
    try:
        contents = _visible_contents(folder)
    except OSError:
        # The folder is unreadable, or another process removed it.
        return
    if contents.get(MANIFEST) is False:
        manifest = _read(folder / MANIFEST)
        if manifest is None or (
            manifest.get("manifest") == 1 and "samples" in manifest
        ):
            yield FoundClip(folder, name, manifest)
            return
    elif looks_like_clip(contents):
        # A folder with the files of a clip but without a manifest is an interrupted
        # render.
        yield FoundClip(folder, name, None)
        return
    subfolders = []
    for entry, is_folder in contents.items():
        if is_folder:
            subfolders.append(entry)
    for subfolder in sorted(subfolders, key=natural):
        path = folder / subfolder
        # A link to a folder above itself would make an endless loop.
        is_loop = path.is_symlink() and path.parent.resolve().is_relative_to(
            path.resolve()
        )
        if not is_loop:
            yield from _find_below(path, f"{name}/{subfolder}")


def _visible_contents(folder: Path) -> dict[str, bool]:
    """Return whether each visible entry of a folder is a folder. Raise OSError."""
    contents = {}
    with os.scandir(folder) as entries:
        for entry in entries:
            if entry.name.startswith("."):
                continue
            if entry.is_symlink():
                contents[entry.name] = os.path.isdir(entry)
            else:
                contents[entry.name] = entry.is_dir()
    return contents


def _read(path: Path) -> Mapping[str, Any] | None:
    """Return the manifest, None for an unreadable file, or an empty mapping for JSON of
    another kind.

    An unreadable file may belong to a clip. Web pages also have files named
    `manifest.json`, with other content.
    """
    try:
        # Reading a pipe never ends, so that only regular files are read.
        if path.is_file():
            data = json.loads(path.read_bytes())
        else:
            data = None
    except (OSError, ValueError, RecursionError):
        return None
    if isinstance(data, dict) or data is None:
        return data
    return {}


def clip_folders(roots: Sequence[Path]) -> list[Path]:
    """Return the folders of all clips in or below `roots`, without repetitions, in
    natural order of paths. Raise InputError if a root has no clip.
    """
    folders_by_path: dict[str, Path] = {}
    problems = []
    for root in roots:
        if not root.is_dir():
            problems += Message.NOT_RENDERED_INTO.error(str(root)).problems
            continue
        # Links may lead to the same clip twice: the real path identifies a clip.
        clips_below = {}
        for clip in find_clips([root]):
            clips_below[os.path.realpath(clip.folder)] = clip.folder
        if not clips_below:
            problems += Message.NO_CLIP_IN_FOLDER.error(str(root)).problems
        folders_by_path = {**clips_below, **folders_by_path}
    if problems:
        raise InputError(problems)
    return sorted(
        folders_by_path.values(),
        key=lambda folder: list(map(natural, folder.parts)),
    )


DELIVERY_KEYS = {"hold", "grain", "squash", "enter", "first_blur"}
"""Keys of `video` in a manifest that `render.grain.Delivery` sets."""


@dataclass(frozen=True)
class Manifest:
    """The record of a run from its manifest; see `report.record.RunRecord`."""

    source: str
    variant: str | None
    overrides: tuple[str, ...]
    versions: Mapping[str, str]
    # Processor and system.
    machine: str
    inputs: Mapping[str, str]
    files: Mapping[str, str]
    samples: tuple[str, ...]
    # Hashes of the frames before refinement.
    frames: tuple[str, ...]
    # True if the render asked for refinement by a model.
    has_refinement: bool
    # True if the video has the hold and the grain of the scene.
    has_delivery: bool = False


def read_manifest(folder: Path) -> Manifest:
    """Read the manifest of a clip. Raise InputError for a missing or damaged one."""
    path = folder / MANIFEST
    try:
        if not path.is_file():
            raise OSError
        data: Mapping[str, Any] = json.loads(path.read_bytes())
        has_refinement = bool(data.get("refine"))
        platform = data["platform"]
        return Manifest(
            source=str(data["source"]),
            variant=None if data["variant"] is None else str(data["variant"]),
            overrides=tuple(map(str, data["overrides"])),
            versions=_texts(data["versions"]),
            machine=f"{platform['machine']} {platform['system']}",
            inputs=_texts(data["inputs"]),
            files=_texts(data["files"]),
            samples=tuple(map(str, data["samples"])),
            frames=tuple(map(str, data["unrefined" if has_refinement else "frames"])),
            has_refinement=has_refinement,
            has_delivery=bool(DELIVERY_KEYS & set(data["video"])),
        )
    # A damaged manifest can lack keys or hold values of any type, so every error of
    # reading it means the same.
    except (
        OSError,
        ValueError,
        KeyError,
        TypeError,
        AttributeError,
        OverflowError,
        RecursionError,
    ):
        raise Message.MANIFEST_DAMAGED.error(str(path)) from None


def _texts(data: Mapping[str, Any]) -> dict[str, str]:
    return {str(name): str(value) for name, value in data.items()}
