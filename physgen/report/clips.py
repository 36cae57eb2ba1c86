"""Finding the clips below some folders, including records of failed ones.

A run that fails leaves `NAME.failed.json` where the clip's folder would be, until it succeeds.
"""

from __future__ import annotations

import hashlib
import json
import os
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
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
"""Files that show a clip, the best first."""
UNREFINED = ("unrefined.mp4", "unrefined.webp", "unrefined.gif", "unrefined/00000.png")
"""The same where its refinement failed."""


@dataclass(frozen=True)
class Failure:
    """A record of a run that failed."""

    scene: str
    """Name of the folder of the clip."""
    path: str
    """The scene's file, as it was given."""
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
    """Writes a run's inputs, and the problems that it ended with, warnings among them, as `read_failure` reads them.

    In place of an earlier record; a file that is not ours stays.
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
    """Remove the record of a failure, after the clip has succeeded."""
    file = out / f"{scene}{ENDING}"
    if read_failure(file) is not None:
        with suppress(OSError):
            file.unlink()


def read_failure(file: Path) -> Failure | None:
    """Read the record of a failure; None if the file is not ours."""
    try:
        data: Mapping[str, Any] = json.loads(file.read_text(encoding="utf-8"))
        if data["failed"] != 1:
            return None
        lists = {}
        for name in ("overrides", "command", "problems", "warnings"):
            if not isinstance(data[name], list):
                return None
            lists[name] = tuple(map(str, data[name]))
        variant = None if data["variant"] is None else str(data["variant"])
        return Failure(str(data["scene"]), str(data["path"]), variant, **lists)
    except (OSError, ValueError, KeyError, TypeError):
        return None


@dataclass(frozen=True)
class Clip:
    """One clip of a gallery."""

    home: Path
    """Its folder; of one that failed, the file of its record."""
    name: str
    variant: str | None = None
    overrides: tuple[str, ...] = ()
    document: Mapping[str, Any] = field(
        default_factory=dict
    )  # the resolved scene; empty for one that failed
    photo: str = ""
    """SHA-256 of the scene's photo; empty without one."""
    size: tuple[int, int] = (4, 3)
    """Width and height of the film, px."""
    fps: float = 30.0
    """1/s."""
    frames: int = 0
    warnings: tuple[str, ...] = ()
    problems: tuple[str, ...] = ()
    """Why it failed; empty for one that did not."""
    film: Path | None = None
    """The video, or the first of its frames."""
    seal: str = ""
    """Identifies the film: hexadecimal digits."""
    report: Path | None = None
    time: float = 0.0
    """When it was made, s since 1970."""
    source: Path | None = None
    """The scene file; None where it is no longer."""
    masks: str = ""
    """Origin of the masks: `perceived`, `hand-made masks`, or empty."""

    @property
    def title(self) -> str:
        """Return the scene's name in words; a name that holds settings stays."""
        return title_of(self.scene)

    @property
    def sentence(self) -> str:
        """Return the first sentence of the scene file."""
        return "" if self.source is None else sentence_of(self.source)

    @property
    def slow(self) -> float:
        """Return how many times slower than the motion the film is."""
        slow = self.document.get("render", {}).get("slow", 1)
        return float(slow) if isinstance(slow, int | float) else 1.0

    @property
    def scene(self) -> str:
        """Return the clip's name without the variant's."""
        return self.name.removesuffix(f"-{self.variant}") if self.variant else self.name

    @property
    def subject(self) -> object:
        """Return a name that is the same for clips of one photo, or of the same objects."""
        return self.photo or tuple(self.document.get("objects", ()))

    @property
    def duration(self) -> float:
        """Return the duration of the film, s."""
        return self.frames / self.fps if self.fps > 0 else 0.0

    @property
    def labels(self) -> Mapping[str, int]:
        """Label -> number of objects with it, the most common first."""
        objects = self.document.get("objects", {}).values()
        return dict(
            Counter(str(o["label"]) for o in objects if o.get("label")).most_common()
        )

    @property
    def objects(self) -> int:
        """Return the number of objects."""
        return len(self.document.get("objects", {}))


def clips_in(roots: Sequence[Path]) -> list[Clip]:
    """Find every clip in or below `roots`, once, in the natural order of folders.

    Raises InputError for roots without clips.

    Folders whose names begin with a dot, and files that are not ours, are skipped.
    """
    missing = [
        Message.NOT_A_CLIP_FOLDER.error(str(root))
        for root in roots
        if not root.is_dir()
    ]
    if missing:
        raise InputError(problem for error in missing for problem in error.problems)
    found: dict[Path, Clip] = {}
    for root in roots:
        for clip in _find_clips(root):
            found.setdefault(clip.home.resolve(), clip)
    # a clip whose refinement failed replaces the record of that failure
    failures = {
        clip.home: clip for clip in found.values() if clip.home.name.endswith(ENDING)
    }
    kept = []
    for clip in found.values():
        failure = failures.get(clip.home.with_name(clip.home.name + ENDING))
        if failure is not None and clip.problems:
            kept.append(replace(clip, problems=failures.pop(failure.home).problems))
        elif clip.home not in failures:
            kept.append(clip)
    return sorted(
        [*kept, *failures.values()],
        key=lambda clip: [natural(part) for part in clip.home.parts],
    )


def _find_clips(root: Path) -> Iterator[Clip]:
    for place, folders, files in os.walk(root):
        here = Path(place)
        clip = _read_rendered(here) if "manifest.json" in files else None
        if clip is not None:
            folders.clear()  # folders inside a clip belong to it
            yield clip
            continue
        folders[:] = [name for name in folders if not name.startswith(".")]
        for name in files:
            if (
                name.endswith(ENDING)
                and (failure := read_failure(here / name)) is not None
            ):
                yield _read_failed(here / name, failure)


def _read_rendered(folder: Path) -> Clip | None:
    """Read a rendered clip; None if the manifest is not ours."""
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
        if data["manifest"] != 1 or not isfinite(float(video["fps"])):
            return None
        if not all(isinstance(item, dict) for item in objects):
            return None
        fault = (data.get("refine") or {}).get(
            "failed"
        ) or "the frames could not be made"
        films = (
            name
            for name in (*FILMS, *UNREFINED)
            if name in files and (folder / name).is_file()
        )
        film = next(films, None)
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
            problems=() if frames else (str(fault),),
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
    """Return the scene file of a clip; None if it is no longer there."""
    name = str(data.get("source") or "")
    if not name:
        return None
    path = Path(os.path.normpath(os.path.realpath(folder) + "/" + name))
    return path if path.is_file() else None


def _read_failed(file: Path, failure: Failure) -> Clip:
    """Read a failed clip, whose problems name the scene's file without its folders."""
    name = Path(failure.path).name
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
    """Return a name for the video's hash, or for all hashes of a folder of frames."""
    if not film.endswith("/00000.png"):
        return str(files[film])[:20]
    folder = film.removesuffix("00000.png")
    hashes = "".join(
        str(files[name]) for name in sorted(files) if name.startswith(folder)
    )
    return hashlib.sha256(hashes.encode()).hexdigest()[:20]
