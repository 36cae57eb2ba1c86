"""A video and masks of its objects to the refined video and a record."""

from __future__ import annotations

import hashlib
import os
import shutil
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from physgen.export.video import LONGEST, Format, encode_in_thread, open_video
from physgen.files import move_with_backup, partial, write_with_backup
from physgen.problems import InputError, Place, Problem, Severity, Warn, ignore_warning
from physgen.progress import Progress, silent
from physgen.refine.denoiser import F32, PromptSettings
from physgen.refine.fusion import Refinement, RefineSettings, backend_errors, hold_frames, no_steps_problem
from physgen.registry import Backends, Plan
from physgen.report.record import file_hash, frame_hash, json_text, versions
from physgen.scene.scene import Refine
from physgen.scene.schema import at
from physgen.videos import Coverage, Video, in_folder, open_coverage, read_video

ROLE, BACKEND = "refine", "animatediff"
"""The role, and the backend that fills it unless another is chosen."""
WRITTEN = {f".{kind.value}": kind for kind in (Format.MP4, Format.GIF, Format.WEBP)}
"""Endings of what can be written; a name without one is a folder of PNG."""


@dataclass(frozen=True)
class VideoJob:
    """A video to be refined."""

    video: Path
    """A file, or a folder of pictures."""
    settings: Refine
    masks: Path | None = None
    """Coverage of the objects, see `physgen.videos`; None: objects are not held."""
    output: Path | None = None
    """None: VIDEO-STEM.refined.mp4 in the current folder."""
    keep_first: bool = False
    """Frame 0 stays as it is, and what follows leaves it slowly."""
    fps: float | None = None
    """Of the result; None: the video's own."""
    command: Sequence[str] = ()
    """The command line, for the record."""


@dataclass(frozen=True)
class Refined:
    """A refined video."""

    output: Path
    """The video, or the folder of pictures."""
    record_path: Path
    """`NAME.json` beside it."""
    record: dict[str, Any]


def refine_video(
    job: VideoJob,
    crew: Plan | Backends,
    progress: Progress = silent,
    warn: Warn = ignore_warning,
    keep: Callable[[Path], None] = lambda kept: None,
) -> Refined:
    """Refine a video with the backend for the role `refine`.

    A plan's backend is loaded once the inputs are checked, and released at the end; Backends keep theirs. Raises
    InputError; then nothing is written.
    """
    video, masks, settings = job.video, job.masks, job.settings
    output = job.output or Path(f"{video.resolve().stem}.refined.mp4")
    kind = _kind(output, video, masks)
    prompt = PromptSettings(settings.prompt or "", settings.negative, settings.guidance)
    strength, stop, steps = settings.strength, settings.stop, settings.steps
    how = RefineSettings(strength, stop, steps, settings.seed, prompt, settings.lock, settings.detail, 0)
    if wrong := no_steps_problem(how, Place("--strength"), ""):
        raise InputError([wrong])
    if masks is None and settings.lock:
        fix = "name masks: --masks DIR, or leave --lock out"
        raise InputError.of("--lock", f"{settings.lock:g}", "has no objects to put back", fix)
    for path in filter(None, (video, masks)):
        if not path.exists():
            raise InputError.of(str(path), "", "no such file", "check the path")
    with ExitStack() as stack:
        if isinstance(crew, Plan):
            crew = Backends(crew)
            stack.callback(crew.close)
        clip = read_video(video, progress)
        covered = None if masks is None else open_coverage(masks, clip, progress)
        most = LONGEST.get(kind)
        if most is not None and max(clip.size) > most:
            found = f"{clip.size[0]} x {clip.size[1]} px"
            expected = f"is over the {most} px that {kind.value} allows a side"
            raise InputError.of(str(output), found, expected, "name a folder for PNG frames")
        warnings = list(_remarks(job))
        for warning in warnings:
            warn(warning)
        fps = job.fps or clip.fps or float(at("render.fps")["default"])
        how = replace(how, hold=hold_frames(fps) if job.keep_first else 0)
        beside = stack.enter_context(_beside(output))
        made = beside / kind.file
        with open_video(beside, kind, clip.size, fps) as write:
            refined = _run(crew, how, clip, covered, write, progress)
        size = {"size": list(clip.size), "frames": len(clip.frames), "fps": round(fps, 6)}
        record = {
            "refined": 1,
            "command": list(job.command),
            "versions": versions(),
            "video": {**_named(clip.path, output), **size},
            "masks": covered and _named(covered.path, output),
            "keep_first": job.keep_first,
            **refined,
            "output": {"path": output.name, "sha256": content_hash(made)},
            "warnings": [warning.as_dict() for warning in warnings],
        }
        record_path = output.with_name(f"{output.name if kind is Format.PNG else output.stem}.json")
        move_with_backup(made, output, keep)
        write_with_backup(record_path, json_text(record).encode("utf-8"), keep)
    return Refined(output, record_path, record)


def _run(
    crew: Backends,
    how: RefineSettings,
    clip: Video,
    covered: Coverage | None,
    write: Callable[[Any], None],
    progress: Progress,
) -> dict[str, Any]:
    """Write the refined frames; returns their part of the record."""
    hashes: list[str] = []
    count = len(clip.frames)
    with backend_errors("--backend", crew.name(ROLE)):
        run = Refinement(crew.get(ROLE), how, clip.size, count, progress)
    nothing: list[F32] = [np.zeros(clip.size[::-1], np.float32)] * count
    frames = run.frames(clip.frames, covered.frames if covered else nothing)
    with encode_in_thread([write]) as put:
        for index in range(count):
            with backend_errors("--backend", crew.name(ROLE)):
                rgb = next(frames)
            hashes.append(frame_hash(rgb))
            put(rgb)
            progress("write", index + 1, count)
    row, weights = crew.row(ROLE), crew.plan.setup(ROLE).weights
    return {
        "backend": {"name": row.name, "weights": weights or (row.weights[0].id if row.weights else "")},
        "refine": dict(run.note()),
        "frames": hashes,
    }


def _remarks(job: VideoJob) -> Iterator[Problem]:
    place = Place(str(job.video))
    if job.masks is None:
        what, fix = "has no masks, so objects may change as all else", "hold them: --masks DIR"
        yield Problem(place, "", "", what, fix, Severity.WARNING)
    if not job.settings.prompt:
        what = "is refined by a model without a prompt"
        fix = 'say it, e.g. --prompt "billiard balls on green cloth"'
        yield Problem(place, "", "", what, fix, Severity.WARNING)


def _named(path: Path, output: Path) -> dict[str, str]:
    """The path of an input as seen from the output, and its hash."""
    beside = os.path.relpath(path.resolve(), output.resolve().parent)
    return {"path": Path(beside).as_posix(), "sha256": content_hash(path)}


def content_hash(path: Path) -> str:
    """SHA-256 of a file; of a folder, of its pictures' names and hashes, a line each."""
    if not path.is_dir():
        return file_hash(path)
    lines = (f"{file_hash(picture)}  {picture.name}\n" for picture in in_folder(path))
    return hashlib.sha256("".join(lines).encode("utf-8", "surrogateescape")).hexdigest()


def _kind(output: Path, video: Path, masks: Path | None) -> Format:
    """What is to be written, by the name's ending; refused before anything is read or overwritten."""
    kind = WRITTEN.get(output.suffix.lower(), Format.PNG)
    if output.name in ("", ".."):
        raise InputError.of("-o", f'"{output}"', "is no name", "name a file, e.g. refined.mp4")
    if output.suffix and kind is Format.PNG:
        fix = f"end it in {', '.join(WRITTEN)}, or name a folder for PNG frames"
        raise InputError.of("-o", f'"{output}"', "is no name for a video", fix)
    for name, read in (("video", video), ("masks", masks)):
        if read is not None and output.resolve() == read.resolve():
            raise InputError.of(
                "-o", f'"{output}"', f"is where the {name} is read from", "choose another name"
            )
    if kind is not Format.PNG and output.is_dir():
        raise InputError.of("-o", f'"{output}"', "is a folder", f"write e.g. {output / f'{video.stem}.mp4'}")
    if kind is Format.PNG and output.is_dir():
        strange = [p.name for p in sorted(output.iterdir()) if p.suffix != ".png" or not p.stem.isdecimal()]
        if strange:
            found = ", ".join(strange[:3]) + (", ..." if len(strange) > 3 else "")
            fix = f"choose a new folder, or a video in it: {output / f'{video.stem}.mp4'}"
            raise InputError.of("-o", f'"{output}"', f"is there already and holds {found}", fix)
    elif kind is Format.PNG and output.exists():
        raise InputError.of("-o", f'"{output}"', "is a file", "choose a new folder")
    return kind


@contextmanager
def _beside(output: Path) -> Iterator[Path]:
    """A folder on the output's disk, removed in the end whatever comes."""
    above = [folder for folder in (output.parent, *output.parent.parents) if not folder.exists()]
    output.parent.mkdir(parents=True, exist_ok=True)
    folder = partial(output)
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir()
    try:
        yield folder
    finally:
        shutil.rmtree(folder, ignore_errors=True)
        for made in above:  # where nothing came of it; others are not empty
            with suppress(OSError):
                made.rmdir()
