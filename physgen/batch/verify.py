"""Render the scene of a clip again and compare the result with the clip. The clip's
folder does not change.
"""

from __future__ import annotations

import platform
import zipfile
import zlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from enum import Enum
from pathlib import Path
from typing import Any

import numpy as np

from physgen import pipeline
from physgen.batch.clips import Manifest, read_manifest
from physgen.batch.run import describe_failure
from physgen.messages import Message
from physgen.pipeline.film import Film
from physgen.pipeline.stages import Keep, Stages
from physgen.problems import InputError, Place, Problem
from physgen.report.record import RunRecord, file_hash, frame_hash, inputs, versions
from physgen.scene.scene import Scene
from physgen.simulate.trajectory import Trajectory, read_trajectory
from physgen.text import counted, quoted, rounded

NOT_REFINED = "refinement was not run again: the clip as it was drawn is compared"
NO_CAUSE = "nothing that it reads has changed, nor have versions or the machine"
MAX_NAMED = 3
"""Maximum number of objects or files named in a line; the others are counted."""


@dataclass(frozen=True)
class VerifyRequest:
    """A clip to verify."""

    folder: Path
    # The scene file; None for the file in the manifest.
    scene: Path | None = None
    allow_outside: bool = False


class Outcome(Enum):
    """The result of a comparison."""

    EQUAL = "equal"
    DIFFERS = "differs"
    UNKNOWN = "not verified"
    """A second render failed."""


@dataclass(frozen=True)
class MotionDifference:
    """The difference between two motions."""

    # The first different sample.
    sample: int
    time: float  # s
    # Numbers of samples, old and new.
    counts: tuple[int, int]
    objects: Mapping[str, float] = field(default_factory=dict)
    """Largest distance of each different object, px, in falling order; empty if
    trajectory.npz is unusable.
    """

    def text(self) -> str:
        """Return the difference as a sentence."""
        before, count_now = self.counts
        counts = ""
        if before != count_now:
            counts = f"{counted(before, 'sample')} then, {count_now} now; "
        deviations = summarize_texts(
            [f"{name} by up to {rounded(px)} px" for name, px in self.objects.items()]
        )
        return f"{counts}from sample {self.sample} ({self.time:.3f} s){': ' * bool(deviations)}{deviations}"


@dataclass(frozen=True)
class FrameDifference:
    """The difference between two lists of frames."""

    # The first different frame.
    frame: int
    # Number of different frames among those of both clips.
    differ: int
    # Numbers of frames, old and new.
    counts: tuple[int, int]

    def text(self) -> str:
        """Return the difference as a sentence."""
        before, count_now = self.counts
        if before != count_now:
            parts = [f"{counted(before, 'frame')} then, {count_now} now"]
        else:
            parts = []
        if self.differ:
            parts.append(
                f"frames from {self.frame}, {self.differ} of {min(before, count_now)}"
            )
        return "; ".join(parts)


JSON_KEYS = {
    "input_changes": "changed",
    "machine_changes": "elsewhere",
    "file_changes": "damaged",
}
"""Field of a verdict -> its key in the output of `verify --json`."""


@dataclass(frozen=True)
class Verdict:
    """The result for one clip."""

    # Folder of the clip.
    clip: str
    outcome: Outcome
    # Number of samples in the manifest.
    samples: int = 0
    frames: int = 0
    files: int = 0
    # Inputs with changes since the render.
    input_changes: tuple[str, ...] = ()
    # Versions and machine properties with changes since the render.
    machine_changes: tuple[str, ...] = ()
    # Output files with changes since the render.
    file_changes: tuple[str, ...] = ()
    motion: MotionDifference | None = None
    pictures: FrameDifference | None = None
    notes: tuple[str, ...] = ()
    # Reasons for a failed second render.
    problems: tuple[Problem, ...] = ()

    def line(self) -> str:
        """Return the result as a sentence.

        >>> Verdict("out/pool", Outcome.EQUAL, 48, 48, 4).line()
        'out/pool: equal: 48 samples, 48 frames, 4 files'
        """
        parts: list[str] = []
        if self.outcome is Outcome.EQUAL:
            counts = (
                (self.samples, "sample"),
                (self.frames, "frame"),
                (self.files, "file"),
            )
            parts.append(", ".join(counted(number, noun) for number, noun in counts))
        if self.input_changes:
            parts.append(f"since then {summarize_texts(self.input_changes)}")
        parts += map(str, self.problems)
        if self.file_changes:
            parts.append(summarize_texts(self.file_changes))
        parts += [*self._differences(), *self.notes]
        return f"{self.clip}: {self.outcome.value}: {'; '.join(parts)}"

    def _differences(self) -> Iterator[str]:
        """Yield the differences of motion and pictures, and their cause."""
        if self.motion:
            yield f"motion {self.motion.text()}"
        if self.pictures:
            yield self.pictures.text()
        if not (self.motion or self.pictures):
            return
        if self.machine_changes:
            yield summarize_texts(self.machine_changes)
        elif not self.input_changes:
            yield NO_CAUSE

    def as_dict(self) -> dict[str, Any]:
        """Return the result as data."""
        values = asdict(replace(self, problems=()))
        data = {JSON_KEYS.get(name, name): value for name, value in values.items()}
        data["outcome"] = self.outcome.value
        data["problems"] = [problem.as_dict() for problem in self.problems]
        return data


def verify(
    request: VerifyRequest, progress: pipeline.Progress = pipeline.silent
) -> Verdict:
    """Render the scene of a clip again and compare. The verdict contains the faults of
    the clip or its scene.
    """
    try:
        return _verify(request, progress)
    except InputError as error:
        return Verdict(
            str(request.folder), Outcome.UNKNOWN, problems=tuple(error.problems)
        )
    except Exception as error:
        # A manifest is untrusted, and other clips wait.
        return report_failure(request, error)


def report_failure(request: VerifyRequest, error: Exception) -> Verdict:
    """Return the verdict after a fault of the machine or of physgen."""
    failure, fix = describe_failure(error)
    folder, message = str(request.folder), Message.JOB_FAILED
    problem = message.problem(Place(folder), failure=failure, fix=fix)
    return Verdict(folder, Outcome.UNKNOWN, problems=(problem,))


def _verify(request: VerifyRequest, progress: pipeline.Progress) -> Verdict:
    folder = request.folder
    manifest = read_manifest(folder)
    damaged_files = _damaged_files(folder, manifest.files, progress)
    path = request.scene or _source(manifest, folder)
    scene = pipeline.load(
        path, manifest.overrides, manifest.variant, request.allow_outside
    )
    trajectory, hashes = _render_again(scene, manifest, progress)
    motion = _motion_difference(folder, manifest.samples, trajectory)
    pictures = _frame_difference(manifest.frames, hashes)
    outcome = Outcome.DIFFERS
    if motion is None and pictures is None and not damaged_files:
        outcome = Outcome.EQUAL
    return Verdict(
        clip=str(folder),
        outcome=outcome,
        samples=len(manifest.samples),
        frames=len(manifest.frames),
        files=len(manifest.files),
        input_changes=tuple(changed_files(manifest.inputs, inputs(scene, Path(path)))),
        machine_changes=_changed_machine(manifest),
        file_changes=tuple(
            f"{name} {damage}" for name, damage in damaged_files.items()
        ),
        motion=motion,
        pictures=pictures,
        notes=(NOT_REFINED,) if manifest.has_refinement else (),
    )


def _render_again(
    scene: Scene, manifest: Manifest, progress: pipeline.Progress
) -> tuple[Trajectory, list[str]]:
    """Return the motion of a scene, and the hashes of its frames."""
    stages = Stages(Keep.NOTHING)
    maps = stages.maps(scene)
    compilation = stages.compile(scene, maps)
    progress("simulate", 0, 1)
    with scene.located():
        trajectory = stages.simulate(compilation.world, progress)
    film = Film(scene, compilation, maps, RunRecord(scene="", command=[]), stages)
    if manifest.has_delivery:
        film.deliver()
    hashes = []
    for frame in film.deliver_frames(film.frames(trajectory), trajectory):
        hashes.append(frame_hash(frame.rgb))
        progress("render", len(hashes), film.count(trajectory))
    return trajectory, hashes


def _changed_machine(manifest: Manifest) -> tuple[str, ...]:
    """Return the versions and the machine that changed since the render."""
    machine = f"{platform.machine()} {platform.system()}"
    then = {**manifest.versions, "machine": manifest.machine}
    return tuple(changed_environment(then, {**versions(), "machine": machine}))


def _source(manifest: Manifest, folder: Path) -> Path:
    """Return the scene file of the manifest. Raise InputError if it is missing."""
    path = Path(folder.resolve(), manifest.source)
    if not path.is_file():
        raise Message.SOURCE_MOVED.error(str(folder / manifest.source))
    return path.parent.resolve() / path.name


def _damaged_files(
    folder: Path, files: Mapping[str, str], progress: Callable[[str, int, int], None]
) -> dict[str, str]:
    """Return the damage of each changed output file, by file name."""
    damage_by_file = {}
    for count, (name, digest) in enumerate(files.items(), 1):
        path = folder / name
        if ".." in name.split("/") or Path(name).is_absolute():
            damage_by_file[name] = "is not a file of the clip"
        elif not path.is_file():
            damage_by_file[name] = "is missing"
        elif file_hash(path) != digest:
            damage_by_file[name] = "is not as it was written"
        progress("files", count, len(files))
    return damage_by_file


def _stored_motion(path: Path, samples: Sequence[str]) -> Trajectory | None:
    """Return the trajectory of a clip, or None unless it matches the `samples` of the
    manifest.
    """
    if not path.is_file():
        return None
    try:
        trajectory = read_trajectory(path)
        count, bodies = len(trajectory.times), len(trajectory.names)
        # The file can be damaged or of another run, so its shapes and its hashes are
        # compared before its values are used.
        complete = (
            trajectory.poses.shape == trajectory.velocities.shape == (count, bodies, 3)
            and trajectory.turns.shape in ((count, 0, 4), (count, bodies, 4))
            and trajectory.sample_hashes() == list(samples)
        )
        if complete:
            return trajectory
        return None
    except (OSError, ValueError, KeyError, TypeError, EOFError, AttributeError):
        return None
    except (zipfile.BadZipFile, zlib.error):
        return None


def _motion_difference(
    folder: Path, samples: Sequence[str], new_motion: Trajectory
) -> MotionDifference | None:
    """Return the difference of two motions, or None for equal ones. `samples` are the
    hashes of the old motion.
    """
    hashes = new_motion.sample_hashes()
    if hashes == list(samples):
        return None
    counts = len(samples), len(hashes)
    first = _first_difference(samples, hashes)
    time = 0.0
    # The new motion can be the shorter one: then its last time stands for the first
    # sample that it lacks.
    if len(new_motion.times):
        time = float(new_motion.times[min(first, len(new_motion.times) - 1)])
    difference = MotionDifference(first, time, counts)
    old_motion = _stored_motion(folder / "trajectory.npz", samples)
    # Distances need the same objects at the same times. Without them, only the first
    # different sample is reported.
    if (
        old_motion is None
        or old_motion.names != new_motion.names
        or not np.array_equal(old_motion.times, new_motion.times)
    ):
        return difference
    position_changes = old_motion.poses[..., :2] - new_motion.poses[..., :2]
    distances = dict(
        zip(
            new_motion.names,
            np.hypot(position_changes[..., 0], position_changes[..., 1])
            .max(axis=0)
            .tolist(),
            strict=True,
        )
    )
    order = sorted(
        (name for name in distances if distances[name]),
        key=lambda name: -distances[name],
    )
    return replace(difference, objects={name: distances[name] for name in order})


def _frame_difference(
    old_hashes: Sequence[str], new_hashes: Sequence[str]
) -> FrameDifference | None:
    """Return the difference of two lists of frame hashes, or None for equal ones."""
    if list(old_hashes) == list(new_hashes):
        return None
    differ = sum(a != b for a, b in zip(old_hashes, new_hashes, strict=False))
    return FrameDifference(
        _first_difference(old_hashes, new_hashes),
        differ,
        (len(old_hashes), len(new_hashes)),
    )


def _first_difference(old_hashes: Sequence[str], new_hashes: Sequence[str]) -> int:
    """Return the index of the first difference. For lists with a common start, return
    the shorter length.
    """
    pairs = enumerate(zip(old_hashes, new_hashes, strict=False))
    return next(
        (k for k, (a, b) in pairs if a != b), min(len(old_hashes), len(new_hashes))
    )


def changed_files(
    old_hashes: Mapping[str, str], new_hashes: Mapping[str, str]
) -> Iterator[str]:
    """Yield a sentence for each input file with a new hash."""
    for name in (*old_hashes, *(name for name in new_hashes if name not in old_hashes)):
        if old_hashes.get(name) != new_hashes.get(name):
            if name not in old_hashes:
                change = "is read now, was not"
            else:
                change = "is not read any more"
                if name in new_hashes:
                    change = "has changed"
            yield f"{quoted(name, '', 80)} {change}"


def changed_environment(
    old_values: Mapping[str, str], new_values: Mapping[str, str]
) -> Iterator[str]:
    """Yield a sentence for each changed version or machine property, if both values are
    known.
    """
    for name, value in old_values.items():
        if name in new_values and new_values[name] != value:
            yield f"{name} is {quoted(new_values[name], '', 200)}, was {quoted(value, '', 200)}"


def summarize_texts(texts: Sequence[str]) -> str:
    """Return the first texts, and the number of the others."""
    left_out = len(texts) - MAX_NAMED
    return ", ".join(texts[:MAX_NAMED]) + (
        f" and {left_out} more" if left_out > 0 else ""
    )
