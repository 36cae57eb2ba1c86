"""Render a clip's scene again and compare the result with the clip; nothing is written to the clip's folder."""

from __future__ import annotations

import json
import platform
import zipfile
import zlib
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence, Set
from dataclasses import asdict, dataclass, replace
from enum import Enum
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from physgen import pipeline
from physgen.batch.clips import Manifest, read_manifest
from physgen.batch.compare import (
    F64,
    Distances,
    changed_environment,
    changed_files,
    changed_values,
    distances,
    few,
    level_differences,
)
from physgen.export.video import Format, open_video
from physgen.files import final_name
from physgen.pipeline.packs import scene_file
from physgen.pipeline.stages import Film, Keep, Stages
from physgen.problems import InputError, Problem
from physgen.report.folders import temporary_folder
from physgen.report.record import RunRecord, file_hash, frame_hash, inputs, json_text, versions
from physgen.scene.scene import Scene
from physgen.scene.write import scene_text
from physgen.simulate.trajectory import Trajectory, read_trajectory
from physgen.videos import video_frames

if TYPE_CHECKING:
    from physgen.render.stage import Frame

U8 = NDArray[np.uint8]

ROUNDING = 1e-6
"""px, rad, px/s and rad/s: less is a difference in rounding between machines, and invisible."""
MAX_NAMED = 3
"""Objects or files that a line names; the others are counted, and are in the JSON."""
NOT_REFINED = "refinement was not run again: the clip as it was drawn is compared"
NO_OLD_MOTION = "trajectory.npz does not hold the old motion"
FILE_KEYS = ("image", "assets")
"""Keys that name files. Those of the scene as it is now are taken, so that a manifest cannot name any other."""
RESOLVED_KEYS = ("extends", "variants")
"""Keys that are already applied in a resolved scene."""


@dataclass(frozen=True)
class VerifyRequest:
    """A clip to verify."""

    folder: Path
    scene: Path | None = None
    """The scene file or pack; None: the one that the manifest names."""
    allow_outside: bool = False
    device: str = "cpu"


class Outcome(Enum):
    """Result of a comparison."""

    EQUAL = "equal"
    DIFFERS = "differs"
    UNKNOWN = "not verified"
    """It could not be rendered again."""


class Recorded(Enum):
    """What the scene as recorded in the manifest gives now."""

    SAME = "the scene as the manifest has it still gives that clip"
    OTHER = "nor does the scene as the manifest has it give that clip"
    UNREAD = "the scene as the manifest has it cannot be read any more"


class Why(Enum):
    """What frames differ by."""

    MOTION = "because of the motion alone"
    """Drawn with the old motion, they are equal."""
    DRAWING = "drawn differently: the motion is the same"
    BOTH = "drawn differently, besides the motion"
    """They differ even where the old motion is drawn."""
    UNTOLD = "whether by the motion alone is not known"


@dataclass(frozen=True)
class ObjectDifference:
    """How far an object is from where it was, at one sample."""

    object: str
    px: float
    rad: float
    """In the photo's plane, with whole turns."""
    px_s: float
    rad_s: float
    turned: float
    """rad: rotation of a sphere in space."""

    @property
    def rounding(self) -> bool:
        """No more than rounding."""
        return max(self.px, self.rad, self.px_s, self.rad_s, self.turned) < ROUNDING

    def __str__(self) -> str:
        if self.rounding:
            return f"{self.object} by rounding"
        amounts = [(self.px, "px"), (self.rad, "rad")]
        if not any(amount for amount, _ in amounts):
            amounts = [(self.px_s, "px/s"), (self.rad_s, "rad/s"), (self.turned, "rad in space")]
        return (
            f"{self.object} by {' and '.join(f'{amount:.3g} {unit}' for amount, unit in amounts if amount)}"
        )


@dataclass(frozen=True)
class Farthest:
    """The largest amount of the clip."""

    amount: float
    object: str
    sample: int
    time: float
    """s."""


@dataclass(frozen=True)
class MotionDifference:
    """How two motions differ."""

    sample: int
    """The first that differs by more than rounding; where none does, the first that differs at all."""
    time: float
    """s."""
    objects: tuple[ObjectDifference, ...] = ()
    """Those that differ there, the farthest first; empty where the old motion is not known."""
    most_px: Farthest | None = None
    most_rad: Farthest | None = None
    rounding: tuple[int, float, tuple[str, ...]] | None = None
    """Before that: the first sample that differs by rounding, its time, and the objects."""
    gone: tuple[str, ...] = ()
    new: tuple[str, ...] = ()
    samples: tuple[int, int] = (0, 0)
    """How many there were, and are."""
    retimed: bool = False
    """From that sample on, times differ, and nothing can be compared."""
    unnamed: str = ""
    """Why objects cannot be compared."""

    def texts(self) -> Iterable[str]:
        """For a person."""
        before, now = self.samples
        if before != now:
            yield f"{_count(before, 'sample')} then, {now} now"
        if self.gone:
            yield f"without {few(self.gone, MAX_NAMED)} now"
        if self.new:
            yield f"with {few(self.new, MAX_NAMED)} now"
        where = f"motion from sample {self.sample} ({self.time:.3g} s)"
        if self.unnamed:
            yield f"{where}; objects cannot be compared: {self.unnamed}"
        elif self.objects:
            ends = [
                f"{end.amount:.3g} {unit} ({end.object} at {end.time:.3g} s)"
                for end, unit in ((self.most_px, "px"), (self.most_rad, "rad"))
                if end is not None
            ]
            most = f"; at most {' and '.join(ends)}" if ends else ""
            yield f"{where}: {few([str(item) for item in self.objects], MAX_NAMED)}{most}"
        elif not (self.gone or self.new or before != now):
            yield where
        if self.retimed:
            yield "samples are at other times now"
        if self.rounding is not None:
            sample, time, names = self.rounding
            yield f"by rounding from sample {sample} ({time:.3g} s): {few(names, MAX_NAMED)}"


@dataclass(frozen=True)
class PixelDifference:
    """How much of one frame differs."""

    frame: int
    pixels: int
    """Of which a channel differs by more grey levels than the film may lose."""
    levels: int
    """Of 255: the most by which a channel differs."""

    def text(self, loss: int) -> str:
        """For a person."""
        if self.levels <= loss:
            return "nothing that it shows"
        return f"{self.pixels} px by up to {_count(self.levels, 'grey level')}"


@dataclass(frozen=True)
class FrameDifference:
    """How the frames differ."""

    frame: int
    """The first."""
    time: float
    """s of the motion that it shows."""
    differ: int
    """How many do, of those that both clips have."""
    counts: tuple[int, int]
    """How many frames there were, and are."""
    why: Why
    first: PixelDifference | None = None
    """Of the first frame; None where it could not be measured."""
    most: PixelDifference | None = None
    """Of the frame in which most grey levels differ."""
    film: str = ""
    """In which film that was measured; empty for one without loss."""
    loss: int = 0
    """Grey levels that this film loses of its own frames."""
    unmeasured: str = ""
    drawn: int | None = None
    """With `BOTH`: the first frame that differs though the old motion is drawn."""
    untold: str = ""
    """With `UNTOLD`: why."""

    def texts(self) -> Iterable[str]:
        """For a person."""
        before, now = self.counts
        if before != now:
            yield f"{_count(before, 'frame')} then, {now} now"
        if not self.differ:
            return
        how = ""
        if self.first is not None:
            how = f": {f'in {self.film} ' if self.film else ''}{self.first.text(self.loss)}"
            if self.most is not None and self.most.frame != self.first.frame and self.most.levels > self.loss:
                how += f", {self.most.text(self.loss)} in frame {self.most.frame}"
            how += f" (beyond the {self.loss} that it may lose)" if self.loss else ""
        elif self.unmeasured:
            how = f", how much is not known: {self.unmeasured}"
        yield f"frames from {self.frame} ({self.time:.3g} s), {self.differ} of {min(before, now)}{how}"
        if self.why is Why.BOTH:
            yield f"{self.why.value}, from frame {self.drawn}"
        else:
            yield self.why.value + (f": {self.untold}" if self.untold else "")


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
    """Versions, machine and device that are different now."""
    damaged: tuple[str, ...] = ()
    """Output files that are not as they were written."""
    motion: MotionDifference | None = None
    pictures: FrameDifference | None = None
    recorded: Recorded | None = None
    """Where the scene has changed and the clip differs."""
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
            parts.append(", ".join(_count(number, noun) for number, noun in counts))
        if self.changed:
            parts.append(f"since then {few(self.changed, MAX_NAMED)}")
        parts += [str(problem) for problem in self.problems]
        parts += [few(self.damaged, MAX_NAMED)] if self.damaged else []
        parts += [*self.motion.texts()] if self.motion else []
        parts += [*self.pictures.texts()] if self.pictures else []
        if self.outcome is Outcome.DIFFERS and (self.motion or self.pictures):
            if self.elsewhere:
                parts.append(few(self.elsewhere, MAX_NAMED))
            elif not self.changed:
                parts.append("nothing that it reads has changed, nor have versions or the machine")
        parts += [self.recorded.value] if self.recorded else []
        parts += self.notes
        return f"{self.clip}: {self.outcome.value}: {'; '.join(parts)}"

    def as_dict(self) -> dict[str, Any]:
        """For a program."""
        data = {name: getattr(self, name) for name in self.__dataclass_fields__}
        if self.pictures is not None:
            data["pictures"] = {**asdict(self.pictures), "why": self.pictures.why.name.lower()}
        return data | {
            "outcome": self.outcome.value,
            "motion": None if self.motion is None else asdict(self.motion),
            "recorded": None if self.recorded is None else self.recorded.name.lower(),
            "problems": [problem.as_dict() for problem in self.problems],
        }


def _count(number: int, noun: str) -> str:
    return f"{number} {noun}{'s' * (number != 1)}"


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
    elif isinstance(error, MemoryError):
        reason = "ran out of memory"
    else:
        reason = f"{type(error).__name__}: {error}"
    problems = InputError.of(str(request.folder), "", f"failed: {reason}", "").problems
    return Verdict(str(request.folder), Outcome.UNKNOWN, problems=tuple(problems))


def _verify(request: VerifyRequest, progress: pipeline.Progress) -> Verdict:
    folder = request.folder
    manifest = read_manifest(folder)
    damaged = _damaged_files(folder, manifest.files, progress)
    path = request.scene or _source(manifest, folder)
    scene = pipeline.load(path, manifest.overrides, manifest.variant, request.allow_outside)
    files = changed_files(manifest.inputs, inputs(scene, scene_file(path)))
    values = list(changed_values(manifest.document, json.loads(json_text(scene.document))))
    here = {
        "machine": f"{platform.machine()} {platform.system()}",
        "device": pipeline.drawn_by(request.device),
    }
    there = {"machine": manifest.machine, "device": manifest.device}
    now = _Take(scene, request.device, progress)
    undamaged = [file for file in manifest.files if file not in damaged]
    clip = _Clip(manifest, folder, undamaged, stored_motion(folder / "trajectory.npz", manifest.samples))
    motion = motion_difference(manifest.samples, clip.motion, now.trajectory)
    recorded_take, recorded = None, None
    if values and (motion is not None or not now.gives(manifest, progress)):
        recorded_take, recorded = _recorded(request, manifest, scene, progress)
    pictures = _frame_difference(clip, now, motion is not None, recorded_take, progress)
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
        recorded=recorded,
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

    def __init__(self, scene: Scene, device: str, progress: pipeline.Progress) -> None:
        warm = Stages(Keep.NOTHING)
        maps = warm.maps(scene)
        compiled = warm.compile(scene, maps)
        progress("simulate", 0, 1)
        self.trajectory = warm.simulate(compiled.world, progress, cached=False)
        self.filming = Film(scene, compiled, maps, RunRecord(scene="", command=[]), warm, device)

    def draw(self, trajectory: Trajectory | None = None) -> Iterator[Frame]:
        """The clip from its first frame on, of its own motion or another."""
        motion = trajectory or self.trajectory
        return self.filming.annotated(self.filming.frames(motion), motion)

    def count(self, trajectory: Trajectory | None = None) -> int:
        """Frames of the clip."""
        return len(self.filming.shot(trajectory or self.trajectory).order)

    def differing(
        self, hashes: Sequence[str], progress: pipeline.Progress, trajectory: Trajectory | None = None
    ) -> tuple[dict[int, float], int]:
        """Frames whose hashes differ, with their times, s; and the number of all frames."""
        found, count, total = {}, 0, self.count(trajectory)
        for count, frame in enumerate(self.draw(trajectory), 1):
            if count <= len(hashes) and frame_hash(frame.rgb) != hashes[count - 1]:
                found[count - 1] = frame.time
            progress("render", count, total)
        return found, count

    def gives(self, manifest: Manifest, progress: pipeline.Progress) -> bool:
        """Whether it is the clip of the manifest, sample by sample and frame by frame."""
        if self.trajectory.sample_hashes() != list(manifest.samples):
            return False
        return self.differing(manifest.frames, progress) == ({}, len(manifest.frames))


@dataclass(frozen=True)
class _Clip:
    """The clip to compare with."""

    manifest: Manifest
    folder: Path
    undamaged: Sequence[str]
    """Its files that are as they were written."""
    motion: Trajectory | None
    """None: it was lost."""


def _recorded(
    request: VerifyRequest, manifest: Manifest, scene: Scene, progress: pipeline.Progress
) -> tuple[_Take | None, Recorded]:
    """The scene as the manifest has it, if that still gives the clip: then all differences come from the scene."""
    document = {k: v for k, v in manifest.document.items() if k not in (*FILE_KEYS, *RESOLVED_KEYS)}
    for key, path in zip(FILE_KEYS, (scene.image, scene.assets), strict=True):
        if path is not None and key in manifest.document:
            document[key] = str(path)
    try:
        with temporary_folder() as folder:
            path = Path(folder) / "recorded.yaml"
            path.write_text(scene_text(document), encoding="utf-8")
            take = _Take(pipeline.load(path, allow_outside=True), request.device, progress)
    except (InputError, ValueError, RecursionError):  # a manifest is untrusted
        return None, Recorded.UNREAD
    return (take, Recorded.SAME) if take.gives(manifest, progress) else (None, Recorded.OTHER)


def stored_motion(path: Path, samples: Sequence[str]) -> Trajectory | None:
    """A clip's trajectory.npz, if it holds the `samples` of the manifest."""
    if not path.is_file():
        return None
    try:
        trajectory = read_trajectory(path)
        count, bodies = len(trajectory.times), len(trajectory.names)
        arrays = (trajectory.poses, trajectory.velocities, trajectory.turns)
        complete = (
            trajectory.poses.shape == trajectory.velocities.shape == (count, bodies, 3)
            and trajectory.turns.shape in ((count, 0, 4), (count, bodies, 4))
            and {array.dtype for array in arrays} == {np.dtype(float)}
        )
        return trajectory if complete and trajectory.sample_hashes() == list(samples) else None
    except (OSError, ValueError, KeyError, TypeError, EOFError, AttributeError):
        return None
    except (zipfile.BadZipFile, zlib.error):
        return None


def motion_difference(
    samples: Sequence[str], then: Trajectory | None, now: Trajectory
) -> MotionDifference | None:
    """None for equal motions; `samples` are the hashes of the old one, `then` itself, where it is known."""
    hashes = now.sample_hashes()
    counts = len(samples), len(hashes)
    first = next((k for k, (a, b) in enumerate(zip(samples, hashes, strict=False)) if a != b), None)
    if first is None and counts[0] != counts[1]:
        first = min(counts)

    def time(sample: int) -> float:
        return float(now.times[min(sample, len(now.times) - 1)]) if len(now.times) else 0.0

    if then is None:
        if first is None:
            return None
        return MotionDifference(first, time(first), samples=counts, unnamed=NO_OLD_MOTION)
    same_times = then.times[: min(counts)] == now.times[: min(counts)]
    count = len(same_times) if same_times.all() else int(same_times.argmin())
    found = distances(then, now, (np.arange(count), np.arange(count)))
    if first is None and not found.differs.any():
        return None
    common = MotionDifference(0, 0.0, gone=found.gone, new=found.new, samples=counts)
    rows = np.flatnonzero(found.differs.any(axis=1))
    if not len(rows):  # objects came or went, or the clip is longer, or sampled at other times
        at = first or 0
        return replace(common, sample=at, time=time(at), retimed=at >= count < min(counts))
    row, rounding, differs = int(rows[0]), None, found.differs
    large = found.largest >= ROUNDING
    if large.any():
        first_large = int(np.flatnonzero(large.any(axis=1))[0])
        if first_large > row:
            names = tuple(found.names[k] for k in np.flatnonzero(differs[row]))
            rounding = row, time(row), names
        row, differs = first_large, large
    objects = [_object_difference(found, row, int(k)) for k in np.flatnonzero(differs[row])]
    objects.sort(key=lambda item: (-item.px, -item.rad, -item.px_s, -item.rad_s, -item.turned, item.object))
    return replace(
        common,
        sample=row,
        time=time(row),
        objects=tuple(objects),
        most_px=_farthest(found, found.px),
        most_rad=_farthest(found, found.rad),
        rounding=rounding,
        retimed=count < min(counts),
    )


def _object_difference(found: Distances, row: int, k: int) -> ObjectDifference:
    amounts = (found.px, found.rad, found.px_s, found.rad_s, found.turned)
    return ObjectDifference(found.names[k], *(float(amount[row, k]) for amount in amounts))


def _farthest(found: Distances, amounts: F64) -> Farthest | None:
    """None where all are 0."""
    if not amounts.size or amounts.max() <= 0:
        return None
    sample, k = divmod(int(amounts.argmax()), amounts.shape[1])
    return Farthest(float(amounts.max()), found.names[k], sample, float(found.times[sample]))


def _frame_difference(
    clip: _Clip, now: _Take, moved: bool, recorded: _Take | None, progress: pipeline.Progress
) -> FrameDifference | None:
    """None for equal frames. `moved`: the motion differs; `recorded`: the recorded scene, if it gives the clip."""
    hashes = clip.manifest.frames
    found, count = now.differing(hashes, progress)
    counts = len(hashes), count
    if not found:
        why = Why.MOTION if moved else Why.DRAWING
        return None if counts[0] == counts[1] else FrameDifference(min(counts), 0.0, 0, counts, why)
    first = next(iter(found))
    what = FrameDifference(first, found[first], len(found), counts, Why.DRAWING)
    if moved:
        what = _explained(what, clip, now, progress)
    old = None if recorded is None else recorded.draw()
    if old is None and what.why is Why.MOTION:  # the old motion drawn now gives the old frames
        old = now.draw(clip.motion)
    try:
        amounts, film, loss = _measure(clip, now, old, found.keys(), progress)
    except InputError as error:
        return replace(what, unmeasured="; ".join(problem.expected for problem in error.problems))
    most = max(amounts, key=lambda item: (item.levels, item.pixels), default=None)
    return replace(what, first=amounts[0] if amounts else None, most=most, film=film, loss=loss)


def _explained(
    what: FrameDifference, clip: _Clip, now: _Take, progress: pipeline.Progress
) -> FrameDifference:
    """Whether frames differ by the motion alone: the old motion is drawn now."""
    unknown = ""
    if clip.motion is None:
        unknown = NO_OLD_MOTION
    elif now.filming.scene.render.motion_blur > 0:
        unknown = "it has no moments between frames, which motion blur shows"
    elif clip.motion.names != now.trajectory.names:
        unknown = "objects came or went"
    if unknown:
        return replace(what, why=Why.UNTOLD, untold=unknown)
    found, count = now.differing(clip.manifest.frames, progress, clip.motion)
    if not found and count == len(clip.manifest.frames):
        return replace(what, why=Why.MOTION)
    return replace(what, why=Why.BOTH, drawn=next(iter(found), count))


def _measure(
    clip: _Clip, now: _Take, old: Iterator[Frame] | None, differ: Set[int], progress: pipeline.Progress
) -> tuple[list[PixelDifference], str, int]:
    """How much the frames `differ`; the film in which that was measured, if it loses anything; and its loss.

    Frames are compared with the `old` ones, if there are any, or with those of the clip's best film. A film other than
    PNG has lost detail, so the new frames are encoded, too, and both are compared as decoded; less than what the film
    loses of its own frames is not significant. Raises InputError with the reason where that cannot be measured.
    """
    scene, manifest, total = now.filming.scene, clip.manifest, now.count()
    if scene.video_size != manifest.size:
        sizes = [f"{width} x {height} px" for width, height in (manifest.size, scene.video_size)]
        raise InputError.of("", "", f"they were {sizes[0]}, and are {sizes[1]}", "")
    kind = _best_film(manifest, clip.undamaged)
    if old is None and kind is None:
        raise InputError.of("", "", "no film is left as it was written", "")
    if old is not None or kind is Format.PNG:
        frames = clip.folder / Format.PNG.named(manifest.film)
        amounts = []
        for k, frame in enumerate(now.draw()):
            progress("compare", k + 1, total)
            before = None if old is None else next(old, None)
            if k in differ:
                stored = next(video_frames(frames / f"{k:05d}.png")).rgb if old is None else None
                rgb = before.rgb if before is not None else stored
                if rgb is not None:
                    amounts.append(_pixel_difference(k, _levels(k, rgb, frame.rgb), 0))
        return amounts, "", 0
    assert kind is not None
    counts, loss = {}, 0
    film = clip.folder / kind.named(manifest.film)
    with temporary_folder() as folder:
        with open_video(Path(folder), kind, scene.video_size, scene.render.fps) as write:
            for k, frame in enumerate(now.draw()):
                write(frame.rgb)
                progress("compare", k + 1, total)
        films = zip(video_frames(film), video_frames(Path(folder) / kind.file), now.draw(), strict=False)
        for k, (stored_frame, new, frame) in enumerate(films):
            height, width = frame.rgb.shape[:2]  # a film may have a row and a column more
            loss = max(loss, int(np.flatnonzero(_levels(k, new.rgb[:height, :width], frame.rgb)).max()))
            if k in differ:
                counts[k] = _levels(k, stored_frame.rgb, new.rgb)
    return [_pixel_difference(k, levels, loss) for k, levels in counts.items()], film.name, loss


def _best_film(manifest: Manifest, undamaged: Sequence[str]) -> Format | None:
    """The film of the clip that lost least, among those that are undamaged."""
    for kind in (Format.PNG, Format.MP4, Format.WEBP, Format.GIF):
        file = kind.named(manifest.film)
        parts = [part for part in manifest.files if part == file or part.startswith(f"{file}/")]
        if parts and all(part in undamaged for part in parts):
            return kind
    return None


def _levels(frame: int, old: U8, new: U8) -> NDArray[np.int64]:
    """(256,): number of pixels by the most grey levels by which a channel differs. Raises InputError."""
    differences = level_differences(old, new)
    if differences is None:
        sizes = [f"{shape[1]} x {shape[0]} px" for shape in (old.shape, new.shape)]
        raise InputError.of(f"frame {frame}", "", f"was {sizes[0]}, is {sizes[1]}", "")
    return np.bincount(differences.max(axis=2).ravel(), minlength=256)


def _pixel_difference(frame: int, counts: NDArray[np.int64], loss: int) -> PixelDifference:
    return PixelDifference(frame, int(counts[loss + 1 :].sum()), int(np.flatnonzero(counts).max()))
