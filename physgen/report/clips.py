"""Finding the clips below some folders, including records of failed ones."""

from __future__ import annotations

import hashlib
import json
import os
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from math import isfinite
from pathlib import Path
from typing import Any

from physgen.files import write_atomic
from physgen.problems import InputError, Problem, Severity
from physgen.report.record import write_json
from physgen.text import natural

# ----------------------------------------------------------------------
# A clip that failed -> `NAME.failed.json` beside where its folder would be, until it succeeds: for the
# gallery.

ENDING = ".failed.json"


@dataclass(frozen=True)
class Failure:
    """What was to be made, and why it was not."""

    scene: str
    """Name of the folder that it would have got."""
    path: str
    """The scene's file, as it was given."""
    variant: str | None
    overrides: tuple[str, ...]
    command: tuple[str, ...]
    problems: tuple[str, ...]
    """Errors, one line each."""
    warnings: tuple[str, ...] = ()


def failure_of(
    scene: str,
    path: str,
    variant: str | None,
    overrides: Sequence[str],
    command: Sequence[str],
    problems: Sequence[Problem],
) -> Failure:
    """Of what a run was given, and the problems that it ended with, warnings among them."""
    errors = tuple(str(p) for p in problems if p.severity is Severity.ERROR)
    warnings = tuple(str(p) for p in problems if p.severity is Severity.WARNING)
    return Failure(scene, path, variant, tuple(overrides), tuple(command), errors, warnings)


def write_failure(out: Path, trace: Failure, page: str) -> None:
    """Write it and its `page`, whole, in place of an earlier one; a file of somebody else's there stays as it is."""
    file = out / f"{trace.scene}{ENDING}"
    if file.exists() and read_failure(file) is None:
        return
    out.mkdir(parents=True, exist_ok=True)
    write_json(file, {"failed": 1, **vars(trace)})
    write_atomic(file.with_suffix(".html"), page.encode("utf-8"))


def remove_failure(out: Path, scene: str) -> None:
    """The clip is there: take away what an earlier failure left, if it is ours."""
    file = out / f"{scene}{ENDING}"
    if read_failure(file) is not None:
        for left in (file.with_suffix(".html"), file):
            with suppress(OSError):
                left.unlink()


def read_failure(file: Path) -> Failure | None:
    """What a file tells; None where it is none of ours."""
    try:
        told: Mapping[str, Any] = json.loads(file.read_text(encoding="utf-8"))
        if told["failed"] != 1:
            return None
        lists = {name: _texts(told[name]) for name in ("overrides", "command", "problems", "warnings")}
        variant = None if told["variant"] is None else str(told["variant"])
        return Failure(str(told["scene"]), str(told["path"]), variant, **lists)
    except (OSError, ValueError, KeyError, TypeError):
        return None


def _texts(values: Any) -> tuple[str, ...]:
    if not isinstance(values, list):
        raise TypeError
    return tuple(map(str, values))


# ----------------------------------------------------------------------
# Folders -> the clips that physgen left in them at any depth, those that failed among them.

FILMS = ("video.mp4", "video.webp", "video.gif", "frames/00000.png")
"""What a clip may be shown by, the best first."""
UNREFINED = ("unrefined.mp4", "unrefined.webp", "unrefined.gif", "unrefined/00000.png")
"""The same where refining it failed."""


@dataclass(frozen=True)
class Clip:
    """What a gallery knows of one clip."""

    home: Path
    """Its folder; of one that failed, the file that says so."""
    name: str
    variant: str | None = None
    overrides: tuple[str, ...] = ()
    document: Mapping[str, Any] = field(default_factory=dict)
    """The resolved scene; empty for one that failed."""
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
    """Tells this film from any other: hexadecimal digits."""
    report: Path | None = None
    time: float = 0.0
    """When it was made, s since 1970."""

    @property
    def scene(self) -> str:
        """Its name without the variant's."""
        return self.name.removesuffix(f"-{self.variant}") if self.variant else self.name

    @property
    def duration(self) -> float:
        """Of the film, s."""
        return self.frames / self.fps if self.fps > 0 else 0.0

    @property
    def labels(self) -> Mapping[str, int]:
        """Label -> how many of its objects bear it, the commonest first."""
        objects = self.document.get("objects", {}).values()
        return dict(Counter(str(o["label"]) for o in objects if o.get("label")).most_common())

    @property
    def objects(self) -> int:
        """How many there are."""
        return len(self.document.get("objects", {}))


def clips_in(roots: Sequence[Path]) -> list[Clip]:
    """Every clip in or below `roots`, once, in the natural order of folders; raises InputError for what is no folder.

    Folders whose names begin with a dot, and what is not ours, are passed over.
    """
    missing = [root for root in roots if not root.is_dir()]
    if missing:
        fix = "name folders that physgen rendered into, e.g. out"
        raise InputError(
            problem
            for root in missing
            for problem in InputError.of(str(root), "", "is no folder", fix).problems
        )
    found: dict[Path, Clip] = {}
    for root in roots:
        for clip in _below(root):
            found.setdefault(clip.home.resolve(), clip)
    return _paired(found.values())


def _below(root: Path) -> Iterator[Clip]:
    for place, folders, files in os.walk(root):
        here = Path(place)
        clip = _rendered(here) if "manifest.json" in files else None
        if clip is not None:
            folders.clear()  # what is in a clip's folder is its own
            yield clip
            continue
        folders[:] = sorted((name for name in folders if not name.startswith(".")), key=natural)
        for name in sorted((name for name in files if name.endswith(ENDING)), key=natural):
            trace = read_failure(here / name)
            if trace is not None:
                yield _failed(here / name, trace)


def _paired(clips: Iterable[Clip]) -> list[Clip]:
    """A clip whose refinement failed takes the place of the trace that says so; traces stand among the folders."""
    found = list(clips)
    traces = {clip.home: clip for clip in found if clip.home.name.endswith(ENDING)}
    kept = []
    for clip in found:
        trace = traces.get(clip.home.with_name(clip.home.name + ENDING))
        if trace is not None and clip.problems:
            clip = replace(clip, problems=trace.problems)
            del traces[trace.home]
        kept.append(clip)
    kept = [clip for clip in kept if clip.home in traces or not clip.home.name.endswith(ENDING)]
    return sorted(kept, key=lambda clip: [natural(part) for part in clip.home.parts])


def _rendered(folder: Path) -> Clip | None:
    """None where no run of ours left that manifest."""
    path = folder / "manifest.json"
    try:
        told: Mapping[str, Any] = json.loads(path.read_text(encoding="utf-8"))
        if told["manifest"] != 1:
            return None
        files, frames = told["files"], told["frames"]
        fault = (told.get("refine") or {}).get("failed")
        document, video = told["document"], told["video"]
        if not all(isinstance(item, dict) for item in document.get("objects", {}).values()):
            return None
        if not isfinite(float(video["fps"])):
            return None
        films = (name for name in (*FILMS, *UNREFINED) if name in files and (folder / name).is_file())
        film = next(films, None)
        return Clip(
            folder,
            str(told["scene"]),
            told["variant"],
            tuple(map(str, told["overrides"])),
            document,
            str(told["inputs"].get(document.get("image"), "")),
            (int(video["size"][0]), int(video["size"][1])),
            float(video["fps"]),
            len(frames or told.get("unrefined") or told["samples"]),
            tuple(str(warning["text"]) for warning in told["warnings"]),
            () if frames else (str(fault or "the frames could not be made"),),
            None if film is None else folder / film,
            "" if film is None else _seal(files, film),
            folder / "report.html" if "report.html" in files else None,
            path.stat().st_mtime,
        )
    except (OSError, ValueError, KeyError, TypeError, AttributeError, IndexError):
        return None


def _failed(file: Path, trace: Failure) -> Clip:
    return Clip(
        file,
        trace.scene,
        trace.variant,
        trace.overrides,
        warnings=trace.warnings,
        problems=tuple(_near(text, trace.path) for text in trace.problems) or ("failed",),
        report=page if (page := file.with_suffix(".html")).is_file() else None,
        time=file.stat().st_mtime,
    )


def _near(text: str, path: str) -> str:
    """A problem without the folders of the scene's file, which only make it long."""
    return text.replace(path, Path(path).name, 1) if path and text.startswith(path) else text


def _seal(files: Mapping[str, str], film: str) -> str:
    """Of the video's hash, or of all hashes of a folder of frames."""
    if not film.endswith("/00000.png"):
        return str(files[film])[:20]
    folder = film.removesuffix("00000.png")
    hashes = "".join(str(files[name]) for name in sorted(files) if name.startswith(folder))
    return hashlib.sha256(hashes.encode()).hexdigest()[:20]
