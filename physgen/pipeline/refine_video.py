"""A video and masks of its objects to the refined video and a record."""

from __future__ import annotations

import hashlib
import os
import shutil
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from physgen.export.video import LONGEST, NO_ROOM, Format, encode_in_thread, open_video
from physgen.files import move_with_backup, partial, write_with_backup
from physgen.problems import InputError, Place, Problem, Severity
from physgen.refine.denoiser import PromptSettings
from physgen.refine.fusion import Refinement, RefineSettings, backend_errors, hold_frames, no_steps_problem
from physgen.registry import Backends, Plan
from physgen.report.record import file_hash, frame_hash, json_text, versions
from physgen.scene.schema import at
from physgen.videos import Coverage, Video, in_folder, open_coverage, read_video

if TYPE_CHECKING:
    from physgen.scene.scene import Refine


F32 = NDArray[np.float32]

ROLE, BACKEND = "refine", "animatediff"
"""Who refines unless told otherwise: a scene's default is nobody, a command to refine needs somebody."""
WRITTEN = {f".{kind.value}": kind for kind in (Format.MP4, Format.GIF, Format.WEBP)}
"""Endings of what can be written; a name without one is a folder of PNG."""

Progress = Callable[[str, int, int], None]


@dataclass(frozen=True)
class Refined:
    """What came of it."""

    output: Path
    """The video, or the folder of pictures."""
    record_path: Path
    """`NAME.json` beside it."""
    record: dict[str, Any]


def refine_video(
    video: Path,
    masks: Path | None,
    output: Path | None,
    settings: Refine,
    who: Plan | Backends,
    *,
    keep_first: bool = False,
    fps: float | None = None,
    command: Sequence[str] = (),
    progress: Progress = lambda stage, done, total: None,
    warn: Callable[[Problem], None] = lambda problem: None,
    keep: Callable[[Path], None] = lambda kept: None,
) -> Refined:
    """Refine `video`, a file or a folder of pictures, with the backend that `who` chooses for the role `refine`.

    Of a plan it is made once all is right that can be told without it, and let go at the end; a crew keeps its own.

    `masks`: see `clips.covering`; None: objects are not held. `output` None: VIDEO-STEM.refined.mp4 in the current
    folder. `keep_first`: frame 0 stays as it is, and what follows leaves it slowly. `fps`: of the result, where not the
    video's own. Raises InputError; then nothing is written.
    """
    output = Path(f"{video.resolve().stem}.refined.mp4") if output is None else output
    kind = _kind(output, video, masks)
    said = PromptSettings(settings.prompt or "", settings.negative, settings.guidance)
    how = RefineSettings(
        settings.strength,
        settings.stop,
        settings.steps,
        settings.seed,
        said,
        settings.lock,
        settings.detail,
        0,
    )
    if wrong := no_steps_problem(how, Place("--strength"), ""):
        raise InputError([wrong])
    if masks is None and settings.lock:
        fix = "name masks: --masks DIR, or leave --lock out"
        raise InputError.of("--lock", f"{settings.lock:g}", "has no objects to put back", fix)
    for path in filter(None, (video, masks)):
        if not path.exists():
            raise InputError.of(str(path), "", "no such file", "check the path")
    with _crew(who) as crew:
        shown = _opened(video, masks, fps, progress)
        _encodable(output, kind, shown.clip)
        warnings = [*shown.remarks(), *_remarks(video, masks, said)]
        for warning in warnings:
            warn(warning)
        how = replace(how, hold=hold_frames(shown.fps) if keep_first else 0)
        with _beside(output) as beside:
            made = beside / kind.file
            refined = _run(crew, how, shown, beside, kind, output, progress)
            record = {
                "refined": 1,
                "command": list(command),
                "versions": versions(),
                **shown.record(output),
                "keep_first": keep_first,
                **refined,
                "output": {"path": output.name, "sha256": content_hash(made)},
                "warnings": [warning.as_dict() for warning in warnings],
            }
            told = output.with_name(f"{output.name if kind is Format.PNG else output.stem}.json")
            with _room(output):
                move_with_backup(made, output, keep)
                write_with_backup(told, json_text(record).encode("utf-8"), keep)
    return Refined(output, told, record)


@contextmanager
def _crew(who: Plan | Backends) -> Iterator[Backends]:
    if isinstance(who, Backends):
        yield who
        return
    crew = Backends(who)
    try:
        yield crew
    finally:
        crew.close()


@dataclass(frozen=True)
class _Shown:
    """What is to be refined."""

    clip: Video
    covered: Coverage | None
    fps: float
    """1/s, of the result."""

    def coverage(self) -> Sequence[F32]:
        """(H, W) of each frame: nothing where nobody said where objects are."""
        if self.covered is not None:
            return self.covered.frames
        return [np.zeros(self.clip.size[::-1], np.float32)] * len(self.clip.frames)

    def remarks(self) -> Sequence[Problem]:
        """What its readers say."""
        return (*self.clip.remarks, *(self.covered.remarks if self.covered else ()))

    def record(self, output: Path) -> dict[str, Any]:
        """What was read, paths as seen from the output."""
        clip, covered = self.clip, self.covered
        shape = {"size": list(clip.size), "frames": len(clip.frames), "fps": round(self.fps, 6)}
        masks = covered and {**_named(covered.path, output), "meaning": covered.meaning}
        return {"video": {**_named(clip.path, output), **shape}, "masks": masks}


def _opened(video: Path, masks: Path | None, fps: float | None, progress: Progress) -> _Shown:
    clip = read_video(video, progress)
    covered = None if masks is None else open_coverage(masks, clip, progress)
    return _Shown(clip, covered, fps or clip.fps or float(at("render.fps")["default"]))


def _run(
    crew: Backends,
    how: RefineSettings,
    shown: _Shown,
    beside: Path,
    kind: Format,
    output: Path,
    progress: Progress,
) -> dict[str, Any]:
    """The refined video, written `beside`; its part of the record."""
    clip, hashes = shown.clip, list[str]()
    with backend_errors("--backend", crew.name(ROLE)):
        run = Refinement(crew.get(ROLE), how, clip.size, len(clip.frames), progress)
    frames = run.frames(clip.frames, shown.coverage())
    with _room(output), ExitStack() as stack:
        write = stack.enter_context(open_video(beside, kind, clip.size, shown.fps))
        put = stack.enter_context(encode_in_thread([write]))
        for index in range(len(clip.frames)):
            with backend_errors("--backend", crew.name(ROLE)):
                rgb = next(frames)
            hashes.append(frame_hash(rgb))
            put(rgb)
            progress("write", index + 1, len(clip.frames))
    row, said = crew.row(ROLE), crew.plan.setup(ROLE).weights
    return {
        "backend": {"name": row.name, "weights": said or (row.weights[0].id if row.weights else "")},
        "refine": dict(run.note()),
        "frames": hashes,
    }


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


def _encodable(output: Path, kind: Format, clip: Video) -> None:
    most = LONGEST.get(kind)
    if most is not None and max(clip.size) > most:
        found, expected = (
            f"{clip.size[0]} x {clip.size[1]} px",
            f"is over the {most} px that {kind.value} allows a side",
        )
        raise InputError.of(str(output), found, expected, "name a folder for PNG frames")


def _remarks(video: Path, masks: Path | None, said: PromptSettings) -> Iterator[Problem]:
    place = Place(str(video))
    if masks is None:
        yield Problem(
            place,
            "",
            "",
            "has no masks, so objects may change as all else",
            "hold them: --masks DIR",
            _WARNING,
        )
    if not said.prompt:
        fix = 'say it, e.g. --prompt "billiard balls on green cloth"'
        yield Problem(place, "", "", "is refined by a model that is not told what it shows", fix, _WARNING)


_WARNING = Severity.WARNING


def _named(path: Path, output: Path) -> dict[str, str]:
    """Where an input lies, as seen from the output, and what it holds."""
    beside = os.path.relpath(path.resolve(), output.resolve().parent)
    return {"path": Path(beside).as_posix(), "sha256": content_hash(path)}


def content_hash(path: Path) -> str:
    """SHA-256 of a file; of a folder, of its pictures' names and hashes, a line each."""
    if not path.is_dir():
        return file_hash(path)
    lines = (f"{file_hash(picture)}  {picture.name}\n" for picture in in_folder(path))
    return hashlib.sha256("".join(lines).encode("utf-8", "surrogateescape")).hexdigest()


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


@contextmanager
def _room(output: Path) -> Iterator[None]:
    """Tells of a disk that is full."""
    try:
        yield
    except OSError as error:
        if error.errno not in NO_ROOM:
            raise
        fix = "make room, or write to another disk: -o"
        raise InputError.of(str(output), "", f"could not be written ({error.strerror})", fix) from None
