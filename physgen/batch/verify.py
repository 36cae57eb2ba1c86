"""Render a clip's scene again and compare the result with the clip."""

from __future__ import annotations

import tempfile
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from enum import Enum
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from physgen import pipeline
from physgen.batch import changes
from physgen.batch.clips import Manifest, read_manifest
from physgen.batch.compare import (
    Amount,
    Apart,
    Farthest,
    Measured,
    MotionDifference,
    apart,
    differing,
    exactly,
    film_in,
    measured,
    stored_motion,
)
from physgen.batch.workers import LostError
from physgen.export.video import Format
from physgen.files import final_name
from physgen.pipeline.filming import Filming
from physgen.pipeline.packs import scene_file
from physgen.pipeline.warm import Keep, Warm
from physgen.problems import InputError, Problem
from physgen.report.record import RunRecord, inputs
from physgen.scene.scene import Scene
from physgen.scene.write import scene_text

if TYPE_CHECKING:
    from physgen.render.stage import Frame
    from physgen.simulate.trajectory import Trajectory


# ----------------------------------------------------------------------
# A clip's manifest and its scene as it is now -> the scene as the run had it, with every value of then.

FILES = ("image", "assets")
"""Keys that name files: those that the scene reads now are taken, so a manifest cannot have any other read."""
DONE = ("extends", "variants")
"""Keys that a resolved scene has behind it."""


def recorded(told: Manifest, scene: Scene) -> Scene:
    """Raises InputError where this physgen cannot read it, or the scene has no photo now and had one."""
    document = {key: value for key, value in told.document.items() if key not in (*FILES, *DONE)}
    for key, path in zip(FILES, (scene.image, scene.assets), strict=True):
        if path is not None and key in told.document:
            document[key] = str(path)
    with tempfile.TemporaryDirectory(prefix="physgen-") as folder:
        path = Path(folder) / "recorded.yaml"
        path.write_text(scene_text(document), encoding="utf-8")
        return pipeline.load(path, allow_outside=True)


# ----------------------------------------------------------------------
# What was found of a clip, as data, as one line, and as JSON.

NAMED = 3
"""Things that a line names; the rest is counted, and is in the JSON."""


class Outcome(Enum):
    """How a clip did."""

    EQUAL = "equal"
    DIFFERS = "differs"
    UNKNOWN = "not verified"
    """It could not be rendered again."""


class Recorded(Enum):
    """What the scene gives as the manifest has it, with every value as it was then."""

    SAME = "the scene as the manifest has it still gives that clip"
    OTHER = "nor does the scene as the manifest has it give that clip"
    UNREAD = "the scene as the manifest has it cannot be read any more"


class Why(Enum):
    """What frames differ by."""

    MOTION = "because of the motion alone"
    """Drawn with the old motion, they are as they were."""
    DRAWING = "drawn differently: the motion is the same"
    BOTH = "drawn differently, besides the motion"
    """They differ even where the old motion is drawn."""
    UNTOLD = "whether by the motion alone is not known"


@dataclass(frozen=True)
class Frames:
    """How the frames differ."""

    frame: int
    """The first."""
    time: float
    """s of the motion: what it shows."""
    differ: int
    """How many do, of those that both clips have."""
    counts: tuple[int, int]
    """How many frames there were, and are."""
    why: Why
    first: Amount | None = None
    """How much the first differs; None where that could not be measured."""
    most: Amount | None = None
    """Of the frame in which most grey levels differ."""
    film: str = ""
    """What that was measured in; empty where that loses nothing."""
    loss: int = 0
    """Grey levels that this film loses by itself: less says nothing."""
    unmeasured: str = ""
    drawn: int | None = None
    """With `BOTH`: the first frame that differs though the old motion is drawn."""
    untold: str = ""
    """With `UNTOLD`: why."""


@dataclass(frozen=True)
class Verdict:
    """What was found of one clip."""

    clip: str
    """Its folder."""
    outcome: Outcome
    samples: int = 0
    """Of its motion, as its manifest has it."""
    frames: int = 0
    files: int = 0
    changed: tuple[str, ...] = ()
    """What the run read and is not as it was."""
    elsewhere: tuple[str, ...] = ()
    """Versions, machine and device that are not the run's."""
    damaged: tuple[str, ...] = ()
    """Output files that are not as they were written."""
    motion: MotionDifference | None = None
    pictures: Frames | None = None
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
            parts.append(
                f"{_count(self.samples, 'sample')}, {_count(self.frames, 'frame')}, {_count(self.files, 'file')}"
            )
        if self.changed:
            parts.append(f"since then {_some(self.changed)}")
        parts += [str(problem) for problem in self.problems]
        parts += [_some(self.damaged)] if self.damaged else []
        parts += [*_of_motion(self.motion)] if self.motion else []
        parts += [*_of_frames(self.pictures)] if self.pictures else []
        if self.outcome is Outcome.DIFFERS and (self.motion or self.pictures):
            cause = f"made with {_some(self.elsewhere)}" if self.elsewhere else ""
            if not (self.changed or self.elsewhere):
                cause = "nothing that it reads has changed, nor have versions or the machine"
            parts += [cause] if cause else []
        parts += [self.recorded.value] if self.recorded else []
        parts += self.notes
        return f"{self.clip}: {self.outcome.value}: {'; '.join(parts)}"

    def as_dict(self) -> dict[str, Any]:
        """For a program."""
        return {
            "clip": self.clip,
            "outcome": self.outcome.value,
            "samples": self.samples,
            "frames": self.frames,
            "files": self.files,
            "changed": self.changed,
            "elsewhere": self.elsewhere,
            "damaged": self.damaged,
            "motion": None if self.motion is None else asdict(self.motion),
            "pictures": None
            if self.pictures is None
            else {**asdict(self.pictures), "why": self.pictures.why.name.lower()},
            "recorded": None if self.recorded is None else self.recorded.name.lower(),
            "notes": self.notes,
            "problems": [problem.as_dict() for problem in self.problems],
        }


def _of_motion(motion: MotionDifference) -> Iterable[str]:
    before, now = motion.samples
    if before != now:
        yield f"{_count(before, 'sample')} then, {now} now"
    if motion.gone:
        yield f"without {_some(motion.gone)} now"
    if motion.new:
        yield f"with {_some(motion.new)} now"
    where = f"motion from sample {motion.sample} ({motion.time:.3g} s)"
    if motion.unnamed:
        yield f"{where}; objects cannot be told: {motion.unnamed}"
    elif motion.objects:
        ends = [
            _far(end, unit)
            for end, unit in ((motion.most_px, "px"), (motion.most_rad, "rad"))
            if end is not None
        ]
        yield f"{where}: {_some([_apart(item) for item in motion.objects])}" + (
            f"; at most {' and '.join(ends)}" if ends else ""
        )
    elif not (motion.gone or motion.new or before != now):
        yield where
    if motion.retimed:
        yield "samples are at other times now"
    if motion.rounding is not None:
        sample, time, names = motion.rounding
        yield f"by rounding from sample {sample} ({time:.3g} s): {_some(names)}"


def _of_frames(frames: Frames) -> Iterable[str]:
    before, now = frames.counts
    if before != now:
        yield f"{_count(before, 'frame')} then, {now} now"
    if not frames.differ:
        return
    where = f"frames from {frames.frame} ({frames.time:.3g} s)"
    often = f"{frames.differ} of {min(before, now)}"
    how = ""
    if frames.first is not None:
        how = f": {f'in {frames.film} ' if frames.film else ''}{_much(frames.first, frames.loss)}"
        most = frames.most
        if most is not None and most.frame != frames.first.frame and most.levels > frames.loss:
            how += f", {_much(most, frames.loss)} in frame {most.frame}"
        how += f" (beyond the {frames.loss} that it may lose)" if frames.loss else ""
    elif frames.unmeasured:
        how = f", how much cannot be told: {frames.unmeasured}"
    yield f"{where}, {often}{how}"
    if frames.why is Why.BOTH:
        yield f"{frames.why.value}, from frame {frames.drawn}"
    else:
        yield frames.why.value + (f": {frames.untold}" if frames.untold else "")


def _much(amount: Amount, loss: int) -> str:
    if amount.levels <= loss:
        return "nothing that it shows"
    return f"{amount.pixels} px by up to {_count(amount.levels, 'grey level')}"


def _apart(item: Apart) -> str:
    if item.rounding:
        return f"{item.object} by rounding"
    amounts = [(item.px, "px"), (item.rad, "rad")]
    if not any(amount for amount, _ in amounts):
        amounts = [(item.px_s, "px/s"), (item.rad_s, "rad/s"), (item.turned, "rad in space")]
    told = [f"{amount:.3g} {unit}" for amount, unit in amounts if amount]
    return f"{item.object} by {' and '.join(told)}"


def _far(end: Farthest, unit: str) -> str:
    return f"{end.amount:.3g} {unit} ({end.object} at {end.time:.3g} s)"


def _some(things: Sequence[str]) -> str:
    """Few of them by name."""
    more = len(things) - NAMED
    return ", ".join(things[:NAMED]) + (f" and {more} more" if more > 0 else "")


def _count(number: int, what: str) -> str:
    return f"{number} {what}{'s' * (number != 1)}"


# ----------------------------------------------------------------------
# A scene, its motion and a clip's manifest -> how the frames that are drawn now differ from the clip's, and
# why.


class Take:
    """A scene simulated and about to be drawn; nothing that was kept is believed."""

    def __init__(self, scene: Scene, device: str, progress: pipeline.Progress) -> None:
        warm = Warm(Keep.NOTHING)
        maps = warm.maps(scene)
        compiled = warm.compile(scene, maps)
        progress("simulate", 0, 1)
        self.trajectory = warm.simulate(compiled.world, progress, cached=False)
        self.filming = Filming(scene, compiled, maps, device, RunRecord(scene="", command=[]), warm)

    def draw(self, trajectory: Trajectory | None = None) -> Iterator[Frame]:
        """The clip from its first frame on, of its own motion or another."""
        motion = trajectory or self.trajectory
        return self.filming.annotated(self.filming.frames(motion), motion)

    def count(self, trajectory: Trajectory | None = None) -> int:
        """Frames of the clip."""
        return len(self.filming.shot(trajectory or self.trajectory).order)


@dataclass(frozen=True)
class Clip:
    """What is left of the clip that frames are compared with."""

    told: Manifest
    folder: Path
    sound: Sequence[str]
    """Its files that are as they were written."""
    motion: Trajectory | None
    """None: it was lost."""


def compared(
    clip: Clip, now: Take, moved: bool, recorded: Take | None, progress: pipeline.Progress
) -> Frames | None:
    """None where no frame differs, and none is more or less.

    `moved`: the motion differs. `recorded` is the scene as the manifest has it, where that differs from `now` and still
    gives the clip.
    """
    total = now.count()
    found = differing(now.draw(), clip.told.frames, total, progress)
    counts = len(clip.told.frames), found.count
    if not found.frames:
        same = counts[0] == counts[1]
        return None if same else Frames(min(counts), 0.0, 0, counts, Why.MOTION if moved else Why.DRAWING)
    what = Frames(found.frames[0], found.times[0], len(found.frames), counts, Why.DRAWING)
    if moved:
        what = _explained(what, clip, now, progress)
    old = None if recorded is None else recorded.draw()
    if old is None and what.why is Why.MOTION:  # what was drawn then is what is drawn of that motion now
        old = now.draw(clip.motion)
    amounts = _measured(clip, now, old, frozenset(found.frames), total, progress)
    if isinstance(amounts, str):
        return replace(what, unmeasured=amounts)
    most = max(amounts.amounts, key=lambda item: (item.levels, item.pixels), default=None)
    first = amounts.amounts[0] if amounts.amounts else None
    return replace(what, first=first, most=most, film=amounts.film, loss=amounts.loss)


def gives(take: Take, told: Manifest, progress: pipeline.Progress) -> bool:
    """Whether a scene gives that clip, sample by sample and frame by frame."""
    if take.trajectory.sample_hashes() != list(told.samples):
        return False
    found = differing(take.draw(), told.frames, take.count(), progress)
    return not found.frames and found.count == len(told.frames)


def _explained(what: Frames, clip: Clip, now: Take, progress: pipeline.Progress) -> Frames:
    """Whether frames differ by the motion alone: the old motion, drawn now, tells."""
    untold = _untold(clip, now)
    if untold:
        return replace(what, why=Why.UNTOLD, untold=untold)
    found = differing(now.draw(clip.motion), clip.told.frames, now.count(clip.motion), progress)
    if not found.frames and found.count == len(clip.told.frames):
        return replace(what, why=Why.MOTION)
    return replace(what, why=Why.BOTH, drawn=found.frames[0] if found.frames else found.count)


def _untold(clip: Clip, now: Take) -> str:
    if clip.motion is None:
        return "trajectory.npz does not hold the old motion"
    if now.filming.scene.render.motion_blur > 0:
        return "it has no moments between frames, which motion blur shows"
    if clip.motion.names != now.trajectory.names:
        return "objects came or went"
    return ""


def _measured(
    clip: Clip,
    now: Take,
    old: Iterator[Frame] | None,
    differ: frozenset[int],
    total: int,
    progress: pipeline.Progress,
) -> Measured | str:
    """How much frames differ from the `old` ones, or from those in a film; or why that cannot be told."""
    scene, told = now.filming.scene, clip.told
    if scene.video_size != told.size:
        sizes = [f"{width} x {height} px" for width, height in (told.size, scene.video_size)]
        return f"they were {sizes[0]}, and are {sizes[1]}"
    kind = film_in(clip.folder, told.film, list(told.files), lambda file: file in clip.sound)
    try:
        if old is not None and kind is not Format.PNG:
            return exactly(now.draw(), (frame.rgb for frame in old), differ, total, progress)
        if kind is None:
            return "no film is left as it was written"
        film, fps = clip.folder / kind.named(told.film), scene.render.fps
        return measured(partial(now.draw), differ, film, kind, scene.video_size, fps, total, progress)
    except InputError as error:
        return "; ".join(map(str, error.problems))


# ----------------------------------------------------------------------
# A clip's folder -> its scene rendered again and compared, and nothing written there.

UNREFINED = "refinement was not run again: the clip as it was drawn is compared"


@dataclass(frozen=True)
class VerifyRequest:
    """A clip to verify."""

    folder: Path
    scene: Path | None = None
    """The scene file or pack; None: where the manifest says."""
    allow_outside: bool = False
    device: str = "cpu"


def verify(claim: VerifyRequest, progress: pipeline.Progress = pipeline.silent) -> Verdict:
    """Never raises for what is wrong with the clip or its scene: the verdict tells."""
    try:
        return _verified(claim, progress)
    except InputError as error:
        return Verdict(str(claim.folder), Outcome.UNKNOWN, problems=tuple(error.problems))
    except Exception as error:  # a manifest may be anybody's, and other clips wait
        return failed(claim, error)


def failed(claim: VerifyRequest, error: BaseException | LostError) -> Verdict:
    """Not the scene's fault: the machine's, or ours."""
    said = "ran out of memory" if isinstance(error, MemoryError) else str(error)
    if not isinstance(error, MemoryError | OSError | LostError):
        said = f"{type(error).__name__}: {said}"
    if isinstance(error, OSError):
        where = f"{final_name(str(error.filename))}: " if error.filename else ""
        said = f"{where}{error.strerror or error}"
    problems = InputError.of(str(claim.folder), "", f"failed: {said}", "").problems
    return Verdict(str(claim.folder), Outcome.UNKNOWN, problems=tuple(problems))


def _verified(claim: VerifyRequest, progress: pipeline.Progress) -> Verdict:
    folder = claim.folder
    told = read_manifest(folder)
    device = pipeline.drawn_by(claim.device)
    harm = changes.damaged(folder, told.files, progress)
    path = claim.scene or _source(told, folder)
    scene = pipeline.load(path, told.overrides, told.variant, claim.allow_outside)
    files = changes.changed_files(told, inputs(scene, scene_file(path)))
    values = changes.changed_values(told, scene.document)
    found = Verdict(
        str(folder),
        Outcome.EQUAL,
        len(told.samples),
        len(told.frames),
        len(told.files),
        (*files, *values),
        changes.elsewhere(told, device),
        tuple(f"{name} {what}" for name, what in harm.items()),
        notes=(UNREFINED,) if told.refined else (),
    )
    now = Take(scene, claim.device, progress)
    sound = [file for file in told.files if file not in harm]
    clip = Clip(told, folder, sound, stored_motion(folder / "trajectory.npz", told.samples))
    motion = apart(told.samples, clip.motion, now.trajectory)
    as_told, how = None, None
    if values and (motion is not None or not gives(now, told, progress)):
        as_told, how = _as_told(claim, told, scene, progress)
    pictures = compared(clip, now, motion is not None, as_told, progress)
    same = motion is None and pictures is None and not harm
    outcome = Outcome.EQUAL if same else Outcome.DIFFERS
    return replace(found, outcome=outcome, motion=motion, pictures=pictures, recorded=how)


def _as_told(
    claim: VerifyRequest, told: Manifest, scene: Scene, progress: pipeline.Progress
) -> tuple[Take | None, Recorded]:
    """The scene as the manifest has it, if that still gives the clip: then all that differs comes from the scene."""
    try:
        take = Take(recorded(told, scene), claim.device, progress)
    except (InputError, ValueError, RecursionError):  # a manifest may be anybody's
        return None, Recorded.UNREAD
    return (take, Recorded.SAME) if gives(take, told, progress) else (None, Recorded.OTHER)


def _source(told: Manifest, folder: Path) -> Path:
    """Where the manifest says that the scene is. Raises InputError where it is not."""
    if told.source is None:
        expected = "does not say where its scene is: an earlier physgen wrote it"
        raise InputError.of(str(folder / "manifest.json"), "", expected, "name it with --scene FILE")
    path = Path(folder.resolve(), told.source)
    if not path.is_file():
        fix = "the clip or the scene was moved; name it with --scene FILE"
        raise InputError.of(str(folder / told.source), "", "is not there", fix)
    return path.parent.resolve() / path.name
