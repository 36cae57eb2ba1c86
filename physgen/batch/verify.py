"""Render a clip's scene again and compare the result with the clip; nothing is written to the clip's folder."""

from __future__ import annotations

import json
import platform
import zipfile
import zlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from enum import Enum
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from PIL import Image

from physgen import pipeline
from physgen.batch.clips import Manifest, read_manifest
from physgen.batch.compare import (
    MotionDifference,
    changed_environment,
    changed_files,
    changed_values,
    counted,
    few,
    motion_difference,
)
from physgen.export.video import U8, Format
from physgen.files import final_name
from physgen.pipeline.stages import Film, Keep, Stages
from physgen.problems import InputError, Problem
from physgen.report.record import RunRecord, file_hash, frame_hash, inputs, json_text, versions
from physgen.scene.scene import Scene
from physgen.simulate.trajectory import Trajectory, read_trajectory

if TYPE_CHECKING:
    from physgen.render.stage import Frame


NOT_REFINED = "refinement was not run again: the clip as it was drawn is compared"
NO_OLD_MOTION = "objects cannot be compared: trajectory.npz does not hold the old motion"
NO_CAUSE = "nothing that it reads has changed, nor have versions or the machine"


@dataclass(frozen=True)
class VerifyRequest:
    """A clip to verify."""

    folder: Path
    scene: Path | None = None
    """The scene file; None: the one that the manifest names."""
    allow_outside: bool = False


class Outcome(Enum):
    """Result of a comparison."""

    EQUAL = "equal"
    DIFFERS = "differs"
    UNKNOWN = "not verified"
    """It could not be rendered again."""


@dataclass(frozen=True)
class FrameDifference:
    """How the frames differ."""

    frame: int
    """The first that differs."""
    time: float
    """s of the motion that it shows."""
    differ: int
    """How many do, of those that both clips have."""
    counts: tuple[int, int]
    """How many frames there were, and are."""
    pixels: int = 0
    """Of the first frame: how many differ."""
    levels: int = 0
    """Of 255: the most by which a channel of it differs."""
    unmeasured: str = ""
    """Why pixels are not compared."""

    def text(self) -> str:
        """For a person."""
        before, now = self.counts
        parts = [f"{counted(before, 'frame')} then, {now} now"] if before != now else []
        if self.differ:
            text = f"frames from {self.frame} ({self.time:.3g} s), {self.differ} of {min(before, now)}"
            if self.unmeasured:
                text += f", how much is not known: {self.unmeasured}"
            else:
                amount = f"{self.pixels} px by up to {counted(self.levels, 'grey level')}"
                text += f": {amount}"
            parts.append(text)
        return "; ".join(parts)


@dataclass(frozen=True)
class Verdict:
    """Result for one clip."""

    clip: str
    """Its folder."""
    outcome: Outcome
    samples: int = 0
    """Of its motion, as its manifest has it."""
    frames: int = 0
    files: int = 0
    changed: tuple[str, ...] = ()
    """What the run read and is different now."""
    elsewhere: tuple[str, ...] = ()
    """Versions and machine that are different now."""
    damaged: tuple[str, ...] = ()
    """Output files that are not as they were written."""
    motion: MotionDifference | None = None
    pictures: FrameDifference | None = None
    notes: tuple[str, ...] = ()
    problems: tuple[Problem, ...] = ()
    """Why it could not be rendered."""

    def line(self) -> str:
        """For a person.

        >>> Verdict("out/pool", Outcome.EQUAL, 48, 48, 4).line()
        'out/pool: equal: 48 samples, 48 frames, 4 files'
        """
        parts: list[str] = []
        if self.outcome is Outcome.EQUAL:
            counts = ((self.samples, "sample"), (self.frames, "frame"), (self.files, "file"))
            parts.append(", ".join(counted(number, noun) for number, noun in counts))
        parts += [f"since then {few(self.changed)}"] if self.changed else []
        parts += [str(problem) for problem in self.problems]
        parts += [few(self.damaged)] if self.damaged else []
        parts += [f"motion {self.motion.text()}"] if self.motion else []
        parts += [self.pictures.text()] if self.pictures else []
        if self.motion or self.pictures:
            causes = few(self.elsewhere) if self.elsewhere else "" if self.changed else NO_CAUSE
            parts += [causes] if causes else []
        return f"{self.clip}: {self.outcome.value}: {'; '.join([*parts, *self.notes])}"

    def as_dict(self) -> dict[str, Any]:
        """For a program."""
        problems = [problem.as_dict() for problem in self.problems]
        return asdict(replace(self, problems=())) | {"outcome": self.outcome.value, "problems": problems}


def verify(request: VerifyRequest, progress: pipeline.Progress = pipeline.silent) -> Verdict:
    """Renders the clip's scene again and compares; what is wrong with the clip or its scene is in the verdict."""
    try:
        return _verify(request, progress)
    except InputError as error:
        return Verdict(str(request.folder), Outcome.UNKNOWN, problems=tuple(error.problems))
    except Exception as error:  # a manifest is untrusted, and other clips wait
        return failed(request, error)


def failed(request: VerifyRequest, error: Exception) -> Verdict:
    """The verdict where the machine or physgen failed, not the scene."""
    if isinstance(error, OSError):
        where = f"{final_name(str(error.filename))}: " if error.filename else ""
        reason = f"{where}{error.strerror or error}"
    else:
        reason = "ran out of memory" if isinstance(error, MemoryError) else f"{type(error).__name__}: {error}"
    problems = InputError.of(str(request.folder), "", f"failed: {reason}", "").problems
    return Verdict(str(request.folder), Outcome.UNKNOWN, problems=tuple(problems))


def _verify(request: VerifyRequest, progress: pipeline.Progress) -> Verdict:
    folder = request.folder
    manifest = read_manifest(folder)
    damaged = _damaged_files(folder, manifest.files, progress)
    path = request.scene or _source(manifest, folder)
    scene = pipeline.load(path, manifest.overrides, manifest.variant, request.allow_outside)
    files = changed_files(manifest.inputs, inputs(scene, Path(path)))
    values = changed_values(manifest.document, json.loads(json_text(scene.document)))
    here = {"machine": f"{platform.machine()} {platform.system()}"}
    there = {"machine": manifest.machine}
    now = _Take(scene, progress)
    motion = _motion_difference(folder, manifest.samples, now.trajectory)
    undamaged = [file for file in manifest.files if file not in damaged]
    pictures = _frame_difference(manifest, folder, undamaged, now, progress)
    same = motion is None and pictures is None and not damaged
    return Verdict(
        clip=str(folder),
        outcome=Outcome.EQUAL if same else Outcome.DIFFERS,
        samples=len(manifest.samples),
        frames=len(manifest.frames),
        files=len(manifest.files),
        changed=(*files, *values),
        elsewhere=tuple(changed_environment({**manifest.versions, **there}, {**versions(), **here})),
        damaged=tuple(f"{name} {what}" for name, what in damaged.items()),
        motion=motion,
        pictures=pictures,
        notes=(NOT_REFINED,) if manifest.refined else (),
    )


def _source(manifest: Manifest, folder: Path) -> Path:
    """The scene file that the manifest names. Raises InputError where it is not there."""
    if manifest.source is None:
        found = "does not say where its scene is: an earlier physgen wrote it"
        raise InputError.of(str(folder / "manifest.json"), "", found, "name it with --scene FILE")
    path = Path(folder.resolve(), manifest.source)
    if not path.is_file():
        fix = "the clip or the scene was moved; name it with --scene FILE"
        raise InputError.of(str(folder / manifest.source), "", "is not there", fix)
    return path.parent.resolve() / path.name


def _damaged_files(
    folder: Path, files: Mapping[str, str], progress: Callable[[str, int, int], None]
) -> dict[str, str]:
    """Output files that are not as they were written -> what is wrong with them."""
    found = {}
    for count, (name, digest) in enumerate(files.items(), 1):
        path = folder / name
        if ".." in name.split("/") or Path(name).is_absolute():
            found[name] = "is no file of the clip"
        elif not path.is_file():
            found[name] = "is missing"
        elif file_hash(path) != digest:
            found[name] = "is not as it was written"
        progress("files", count, len(files))
    return found


class _Take:
    """A scene simulated and about to be drawn, without any cached result."""

    def __init__(self, scene: Scene, progress: pipeline.Progress) -> None:
        warm = Stages(Keep.NOTHING)
        maps = warm.maps(scene)
        compiled = warm.compile(scene, maps)
        progress("simulate", 0, 1)
        self.scene = scene
        self.trajectory = warm.simulate(compiled.world, progress)
        self._filming = Film(scene, compiled, maps, RunRecord(scene="", command=[]), warm)

    def frames(self) -> Iterator[Frame]:
        """The clip from its first frame on."""
        return self._filming.annotated(self._filming.frames(self.trajectory), self.trajectory)

    def count(self) -> int:
        """Frames of the clip."""
        return len(self._filming.shot(self.trajectory).order)


def _stored_motion(path: Path, samples: Sequence[str]) -> Trajectory | None:
    """A clip's trajectory.npz, if it holds the `samples` of the manifest."""
    if not path.is_file():
        return None
    try:
        trajectory = read_trajectory(path)
        count, bodies = len(trajectory.times), len(trajectory.names)
        complete = (
            trajectory.poses.shape == trajectory.velocities.shape == (count, bodies, 3)
            and trajectory.turns.shape in ((count, 0, 4), (count, bodies, 4))
            and trajectory.sample_hashes() == list(samples)
        )
        return trajectory if complete else None
    except (OSError, ValueError, KeyError, TypeError, EOFError, AttributeError):
        return None
    except (zipfile.BadZipFile, zlib.error):
        return None


def _motion_difference(folder: Path, samples: Sequence[str], now: Trajectory) -> MotionDifference | None:
    """None for equal motions; `samples` are the hashes of the old one."""
    hashes = now.sample_hashes()
    if hashes == list(samples):
        return None
    counts = len(samples), len(hashes)
    pairs = enumerate(zip(samples, hashes, strict=False))
    first = next((k for k, (a, b) in pairs if a != b), min(counts))
    time = float(now.times[min(first, len(now.times) - 1)]) if len(now.times) else 0.0
    then = _stored_motion(folder / "trajectory.npz", samples)
    if then is None:
        return MotionDifference(first, time, counts, unnamed=NO_OLD_MOTION)
    found = motion_difference(then, now)
    return found or MotionDifference(first, time, counts)


def _frame_difference(
    manifest: Manifest, folder: Path, undamaged: Sequence[str], now: _Take, progress: pipeline.Progress
) -> FrameDifference | None:
    """None for equal frames."""
    times: dict[int, float] = {}
    pictures: list[U8] = []
    count, total = 0, now.count()
    for count, frame in enumerate(now.frames(), 1):
        if count <= len(manifest.frames) and frame_hash(frame.rgb) != manifest.frames[count - 1]:
            times[count - 1] = frame.time
            pictures = pictures or [frame.rgb.copy()]
        progress("render", count, total)
    counts = len(manifest.frames), count
    if not times:
        return None if counts[0] == counts[1] else FrameDifference(min(counts), 0.0, 0, counts)
    first = next(iter(times))
    found = FrameDifference(first, times[first], len(times), counts)
    file = f"{Format.PNG.named(manifest.film)}/{first:05d}.png"
    if file not in undamaged:
        return replace(found, unmeasured="there are no PNG frames")
    with Image.open(folder / file, formats=("PNG",)) as image:  # a clip may come from anywhere
        before = np.asarray(image, np.int16)
    if before.shape != pictures[0].shape:
        return replace(found, unmeasured="frames were of another size")
    levels = np.abs(pictures[0] - before).max(axis=2)
    return replace(found, pixels=int((levels > 0).sum()), levels=int(levels.max()))
