"""Find the clips below folders, with records of failed clips.

A failed run leaves `NAME.failed.json` at the place of the clip's folder, until a run
succeeds.
"""

from __future__ import annotations

import hashlib
import json
import os
from collections import Counter
from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from math import isfinite
from pathlib import Path
from typing import Any

from physgen.messages import Message
from physgen.problems import InputError, Problem, Severity
from physgen.report.record import write_json
from physgen.report.scene_words import masks_from, sentence_of, title_of
from physgen.text import natural

ENDING = ".failed.json"
FILMS = ("video.mp4", "video.webp", "video.gif", "frames/00000.png")
"""Files with the pictures of a clip, in order of preference."""
UNREFINED = ("unrefined.mp4", "unrefined.webp", "unrefined.gif", "unrefined/00000.png")
"""The same files after a failed refinement."""


@dataclass(frozen=True)
class Failure:
    """The record of a failed run."""

    scene: str
    """Folder name of the clip."""
    path: str
    """The scene file, as the user wrote it."""
    variant: str | None
    overrides: tuple[str, ...]
    command: tuple[str, ...]
    problems: tuple[str, ...]
    """Errors, one line each."""
    warnings: tuple[str, ...] = ()


def write_failure(
    out: Path,
    scene: str,
    path: str,
    variant: str | None,
    overrides: Sequence[str],
    command: Sequence[str],
    problems: Sequence[Problem],
) -> None:
    """Write the inputs and problems of a failed run, in the format of `read_failure`.

    Replace an earlier record, but keep a file from another program.
    """
    file = out / f"{scene}{ENDING}"
    if file.exists() and read_failure(file) is None:
        return
    errors = tuple(str(p) for p in problems if p.severity is Severity.ERROR)
    warnings = tuple(str(p) for p in problems if p.severity is Severity.WARNING)
    failure = Failure(
        scene, path, variant, tuple(overrides), tuple(command), errors, warnings
    )
    out.mkdir(parents=True, exist_ok=True)
    write_json(file, {"failed": 1, **vars(failure)})


def remove_failure(out: Path, scene: str) -> None:
    """Remove the record of a failure after success."""
    file = out / f"{scene}{ENDING}"
    if read_failure(file) is not None:
        with suppress(OSError):
            file.unlink()


def read_failure(file: Path) -> Failure | None:
    """Read the record of a failure. Return None for a file from another program."""
    try:
        data: Mapping[str, Any] = json.loads(file.read_text(encoding="utf-8"))
        if data["failed"] != 1:
            return None
        lists = {}
        for name in ("overrides", "command", "problems", "warnings"):
            if not isinstance(data[name], list):
                return None
            lists[name] = tuple(map(str, data[name]))
        if data["variant"] is None:
            variant = None
        else:
            variant = str(data["variant"])
        return Failure(str(data["scene"]), str(data["path"]), variant, **lists)
    except (OSError, ValueError, KeyError, TypeError):
        return None


@dataclass(frozen=True)
class Clip:
    """One clip of a gallery."""

    home: Path
    """Folder of the clip, or the record of a failed clip."""
    name: str
    variant: str | None = None
    overrides: tuple[str, ...] = ()
    # The resolved scene; empty for a failed clip.
    document: Mapping[str, Any] = field(default_factory=dict)
    photo: str = ""
    """SHA-256 of the scene's photo; empty without a photo."""
    size: tuple[int, int] = (4, 3)
    """Width and height of the film, px."""
    fps: float = 30.0
    """1/s."""
    frames: int = 0
    warnings: tuple[str, ...] = ()
    problems: tuple[str, ...] = ()
    """Reasons of the failure; empty after success."""
    film: Path | None = None
    """The video, or the first of its frames."""
    seal: str = ""
    """Hexadecimal digits that identify the film."""
    report: Path | None = None
    time: float = 0.0
    """Time of the render, s since 1970."""
    source: Path | None = None
    """The scene file; None if it does not exist any more."""
    masks: str = ""
    """Origin of the masks: `perceived`, `hand-made masks`, or empty."""

    @property
    def title(self) -> str:
        """Return the scene's title, or its name in words. A name with settings stays
        unchanged.
        """
        title = self.document.get("title")
        if isinstance(title, str):
            return title
        return title_of(self.scene)

    @property
    def sentence(self) -> str:
        """Return the first sentence of the scene file."""
        if self.source is None:
            return ""
        return sentence_of(self.source)

    @property
    def slow(self) -> float:
        """Return the factor of slow motion."""
        slow = self.document.get("render", {}).get("slow", 1)
        if isinstance(slow, int | float):
            return float(slow)
        return 1.0

    @property
    def scene(self) -> str:
        """Return the clip's name without the variant's."""
        if self.variant:
            return self.name.removesuffix(f"-{self.variant}")
        return self.name

    @property
    def subject(self) -> object:
        """Return a common value of all clips of one photo or of the same objects."""
        return self.photo or tuple(self.document.get("objects", ()))

    @property
    def duration(self) -> float:
        """Return the duration of the film, s."""
        if self.fps > 0:
            return self.frames / self.fps
        return 0.0

    @property
    def labels(self) -> Mapping[str, int]:
        """Return the number of objects by label, the most common first."""
        objects = self.document.get("objects", {}).values()
        return dict(
            Counter(str(o["label"]) for o in objects if o.get("label")).most_common()
        )

    @property
    def objects(self) -> int:
        """Return the number of objects."""
        return len(self.document.get("objects", {}))


def clips_in(roots: Sequence[Path]) -> list[Clip]:
    """Find every clip in or below `roots`, without repetitions, in natural order of
    folders.

    Skip folders with a leading dot and files from other programs. Raise InputError for
    roots that do not exist.
    """
    missing = []
    for root in roots:
        if not root.is_dir():
            missing.append(Message.NOT_A_CLIP_FOLDER.error(str(root)))
    if missing:
        raise InputError(problem for error in missing for problem in error.problems)
    # Roots may contain each other: real paths remove repetitions.
    found: dict[Path, Clip] = {}
    for root in roots:
        for clip in _find_clips(root):
            found.setdefault(clip.home.resolve(), clip)
    # A clip with a failed refinement exists beside the record: show it once.
    failures = {}
    for clip in found.values():
        if clip.home.name.endswith(ENDING):
            failures[clip.home] = clip
    kept = []
    for clip in found.values():
        failure = failures.get(clip.home.with_name(clip.home.name + ENDING))
        if failure is not None and clip.problems:
            kept.append(replace(clip, problems=failures.pop(failure.home).problems))
        elif clip.home not in failures:
            kept.append(clip)
    return sorted(
        [*kept, *failures.values()],
        key=lambda clip: list(map(natural, clip.home.parts)),
    )


def _find_clips(root: Path) -> Iterator[Clip]:
    for place, folders, files in os.walk(root):
        here = Path(place)
        if "manifest.json" in files:
            clip = _read_rendered(here)
        else:
            clip = None
        if clip is not None:
            # Folders inside a clip belong to it.
            folders.clear()
            yield clip
            continue
        # A change in place makes os.walk skip the removed folders.
        folders[:] = [name for name in folders if not name.startswith(".")]
        for name in files:
            if (
                name.endswith(ENDING)
                and (failure := read_failure(here / name)) is not None
            ):
                yield _read_failed(here / name, failure)


def _first_film(folder: Path, files: Collection[str]) -> str | None:
    """Return the name of a clip's video; None without one.

    The listed `files` may have been deleted since.
    """
    for name in (*FILMS, *UNREFINED):
        if name in files and (folder / name).is_file():
            return name
    return None


def _fault(data: Mapping[str, Any]) -> str:
    """Return the reason for the missing frames of a clip."""
    refinement = data.get("refine") or {}
    return str(refinement.get("failed") or "the frames could not be made")


def _read_rendered(folder: Path) -> Clip | None:
    """Read a rendered clip. Return None for a manifest from another program."""
    path = folder / "manifest.json"
    try:
        data: Mapping[str, Any] = json.loads(path.read_text(encoding="utf-8"))
        files, frames, document, video = (
            data["files"],
            data["frames"],
            data["document"],
            data["video"],
        )
        objects = document.get("objects", {}).values()
        # Other programs also write files named manifest.json.
        if data["manifest"] != 1 or not isfinite(float(video["fps"])):
            return None
        if not all(isinstance(item, dict) for item in objects):
            return None
        film = _first_film(folder, files)
        fault = _fault(data)
        return Clip(
            home=folder,
            name=str(data["scene"]),
            variant=data["variant"],
            overrides=tuple(map(str, data["overrides"])),
            document=document,
            photo=str(data["inputs"].get(document.get("image"), "")),
            size=(int(video["size"][0]), int(video["size"][1])),
            fps=float(video["fps"]),
            frames=len(frames or data.get("unrefined") or data["samples"]),
            warnings=tuple(str(warning["text"]) for warning in data["warnings"]),
            problems=() if frames else (fault,),
            film=None if film is None else folder / film,
            seal="" if film is None else _seal(files, film),
            report=folder / "report.html" if "report.html" in files else None,
            time=path.stat().st_mtime,
            source=_source(folder, data),
            masks=masks_from(document, data["inputs"]),
        )
    except (OSError, ValueError, KeyError, TypeError, AttributeError, IndexError):
        return None


def _source(folder: Path, data: Mapping[str, Any]) -> Path | None:
    """Return the scene file of a clip, or None if it does not exist any more."""
    name = str(data.get("source") or "")
    if not name:
        return None
    # `..` after a linked folder would lead to another place: resolve links first.
    path = Path(os.path.normpath(os.path.realpath(folder) + "/" + name))
    if path.is_file():
        return path
    return None


def _read_failed(file: Path, failure: Failure) -> Clip:
    """Read a failed clip. Its problems name the scene file without folders."""
    name = Path(failure.path).name
    # The folder of the user's machine is of no interest on a page.
    texts = (
        text.replace(failure.path, name, 1)
        if failure.path and text.startswith(failure.path)
        else text
        for text in failure.problems
    )
    return Clip(
        file,
        failure.scene,
        failure.variant,
        failure.overrides,
        warnings=failure.warnings,
        problems=tuple(texts) or ("failed",),
        time=file.stat().st_mtime,
    )


def _seal(files: Mapping[str, str], film: str) -> str:
    """Return the start of the video's hash, or of the hash of all frames in a
    folder.
    """
    # The manifest has the hash already: pages need no second one.
    if not film.endswith("/00000.png"):
        return str(files[film])[:20]
    folder = film.removesuffix("00000.png")
    hashes = "".join(
        str(files[name]) for name in sorted(files) if name.startswith(folder)
    )
    return hashlib.sha256(hashes.encode()).hexdigest()[:20]
