"""A video and masks of its objects -> the refined video and a record of how, for videos that no scene made."""

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

from physgen.clips.covering import Coverage, open_coverage
from physgen.clips.reading import Clip, in_folder, open_clip
from physgen.problems import InputError, Place, Problem, Severity
from physgen.refine.refining import How, Refinement, frames_of_hold, no_step
from physgen.refine.roles import Said
from physgen.report.record import file_hash, frame_hash, json_text, versions
from physgen.report.video import LONGEST, NO_ROOM, Format, alongside, open_video
from physgen.scene.schema import at
from physgen.whole import move_kept, partial, write_kept

if TYPE_CHECKING:
    from physgen.crew import Crew
    from physgen.scene.model import Refine

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
    crew: Crew,
    *,
    keep_first: bool = False,
    fps: float | None = None,
    command: Sequence[str] = (),
    progress: Progress = lambda stage, done, total: None,
    warn: Callable[[Problem], None] = lambda problem: None,
    keep: Callable[[Path], None] = lambda kept: None,
) -> Refined:
    """Refine `video`, a file or a folder of pictures, with `crew`'s backend of the role `refine`.

    `masks`: see `clips.covering`; None: objects are not held. `output` None: VIDEO-STEM.refined.mp4 in the current
    folder. `keep_first`: frame 0 stays as it is, and what follows leaves it slowly. `fps`: of the result, where not the
    video's own. Raises InputError; then nothing is written.
    """
    output = Path(f"{video.resolve().stem}.refined.mp4") if output is None else output
    kind = _kind(output, video, masks)
    said = Said(settings.prompt or "", settings.negative, settings.guidance)
    how = How(
        settings.strength,
        settings.stop,
        settings.steps,
        settings.seed,
        said,
        settings.lock,
        settings.detail,
        0,
    )
    if wrong := no_step(how, Place("--strength"), ""):
        raise InputError([wrong])
    if masks is None and settings.lock:
        fix = "name masks: --masks DIR, or leave --lock out"
        raise InputError.of("--lock", f"{settings.lock:g}", "has no objects to put back", fix)
    clip = open_clip(video, progress)
    _encodable(output, kind, clip)
    rate = fps or clip.fps or float(at("render.fps")["default"])
    covered = None if masks is None else open_coverage(masks, clip, progress)
    warnings = [*clip.remarks, *(covered.remarks if covered else ()), *_remarks(video, covered, said)]
    for warning in warnings:
        warn(warning)
    if keep_first:
        how = replace(how, hold=frames_of_hold(rate))
    nothing: Sequence[F32] = [np.zeros(clip.size[::-1], np.float32)] * len(clip.frames)
    hashes: list[str] = []
    record: dict[str, Any] = {
        "refined": 1,
        "command": list(command),
        "versions": versions(),
        "video": {
            **_named(video, output),
            "size": list(clip.size),
            "frames": len(clip.frames),
            "fps": round(rate, 6),
        },
        "masks": covered and {**_named(covered.path, output), "meaning": covered.meaning},
        "keep_first": keep_first,
    }

    def use(model: Any) -> None:
        run = Refinement(model, how, clip.size, len(clip.frames), progress)
        with _room(output), ExitStack() as stack:
            write = stack.enter_context(open_video(beside, kind, clip.size, rate))
            put = stack.enter_context(alongside([write]))
            for index, rgb in enumerate(run.frames(clip.frames, covered.frames if covered else nothing)):
                hashes.append(frame_hash(rgb))
                put(rgb)
                progress("write", index + 1, len(clip.frames))
        record["refine"] = dict(run.note())

    with _beside(output) as beside:
        crew.run(ROLE, use)
        step = crew.steps[-1]
        record["backend"] = {"name": step.backend, "weights": step.weights}
        made = beside / kind.file
        record["output"] = {"path": output.name, "sha256": content_hash(made)}
        record["frames"] = hashes
        record["warnings"] = [warning.as_dict() for warning in warnings]
        with _room(output):
            move_kept(made, output, keep)
            beside_it = output.with_name(f"{output.stem if kind is not Format.PNG else output.name}.json")
            write_kept(beside_it, json_text(record).encode("utf-8"), keep)
    return Refined(output, beside_it, record)


def _kind(output: Path, video: Path, masks: Path | None) -> Format:
    """What is to be written, by the name's ending; refused before anything is read or overwritten."""
    kind = WRITTEN.get(output.suffix.lower(), Format.PNG)
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


def _encodable(output: Path, kind: Format, clip: Clip) -> None:
    most = LONGEST.get(kind)
    if most is not None and max(clip.size) > most:
        found, expected = (
            f"{clip.size[0]} x {clip.size[1]} px",
            f"is over the {most} px that {kind.value} allows a side",
        )
        raise InputError.of(str(output), found, expected, "name a folder for PNG frames")


def _remarks(video: Path, covered: Coverage | None, said: Said) -> Iterator[Problem]:
    place = Place(str(video))
    if covered is None:
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
