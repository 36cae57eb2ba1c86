"""A clip's folder -> its scene rendered again and compared, and nothing written there."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from physgen import pipeline
from physgen.batch.verify import causes
from physgen.batch.verify.motion import apart, stored_motion
from physgen.batch.verify.pictures import Measured, differing, exactly, film_in, measured
from physgen.batch.verify.told import Told, read_told
from physgen.batch.verify.verdict import Frames, Outcome, Verdict, Why
from physgen.pipeline.filming import Filming
from physgen.pipeline.packs import scene_file
from physgen.pipeline.warm import Keep, Warm
from physgen.problems import InputError
from physgen.report.record import RunRecord, inputs
from physgen.whole import meant

if TYPE_CHECKING:
    from physgen.batch.workers import LostError
    from physgen.render.stage import Frame
    from physgen.simulate.trajectory import Trajectory

UNREFINED = "refinement was not run again: the clip as it was drawn is compared"


@dataclass(frozen=True)
class Claim:
    """A clip to verify."""

    folder: Path
    scene: Path | None = None
    """The scene file or pack; None: where the manifest says."""
    allow_outside: bool = False
    device: str = "cpu"


def verify(claim: Claim, progress: pipeline.Progress = pipeline.silent) -> Verdict:
    """Never raises for what is wrong with the clip or its scene: the verdict tells."""
    try:
        return _verified(claim, progress)
    except InputError as error:
        return Verdict(str(claim.folder), Outcome.UNKNOWN, problems=tuple(error.problems))
    except (OSError, MemoryError) as error:
        return failed(claim, error)


def failed(claim: Claim, error: BaseException | LostError) -> Verdict:
    """The machine's fault."""
    said = "ran out of memory" if isinstance(error, MemoryError) else str(error)
    if isinstance(error, OSError):
        where = f"{meant(str(error.filename))}: " if error.filename else ""
        said = f"{where}{error.strerror or error}"
    problems = InputError.of(str(claim.folder), "", f"failed: {said}", "").problems
    return Verdict(str(claim.folder), Outcome.UNKNOWN, problems=tuple(problems))


def _verified(claim: Claim, progress: pipeline.Progress) -> Verdict:
    folder = claim.folder
    told = read_told(folder)
    device = pipeline.drawn_by(claim.device)
    harm = causes.damaged(folder, told.files, progress)
    path = claim.scene or _source(told, folder)
    scene = pipeline.load(path, told.overrides, told.variant, claim.allow_outside)
    since = causes.changed(told, inputs(scene, scene_file(path)), scene.document)
    found = Verdict(
        str(folder),
        Outcome.EQUAL,
        len(told.samples),
        len(told.frames),
        len(told.files),
        since,
        causes.elsewhere(told, device),
        tuple(f"{name} {what}" for name, what in harm.items()),
        notes=(UNREFINED,) if told.refined else (),
    )
    warm = Warm(Keep.NOTHING)  # nothing that was kept is believed
    maps = warm.maps(scene)
    compiled = warm.compile(scene, maps)
    progress("simulate", 0, 1)
    now = warm.simulate(compiled.world, progress, cached=False)
    then = stored_motion(folder / "trajectory.npz", told.samples)
    motion = apart(told.samples, then, now)
    filming = Filming(scene, compiled, maps, claim.device, RunRecord(scene="", command=[]), warm)
    sound = [file for file in told.files if file not in harm]
    pictures = _Again(filming, told, folder, sound, progress).compared(now, then, motion is not None)
    same = motion is None and pictures is None and not harm
    outcome = Outcome.EQUAL if same else Outcome.DIFFERS
    return replace(found, outcome=outcome, motion=motion, pictures=pictures)


def _source(told: Told, folder: Path) -> Path:
    """Where the manifest says that the scene is. Raises InputError where it is not."""
    if told.source is None:
        expected = "does not say where its scene is: an earlier physgen wrote it"
        raise InputError.of(str(folder / "manifest.json"), "", expected, "name it with --scene FILE")
    path = Path(folder.resolve(), told.source)
    if not path.is_file():
        fix = "the clip or the scene was moved; name it with --scene FILE"
        raise InputError.of(str(folder / told.source), "", "is not there", fix)
    return path.parent.resolve() / path.name


class _Again:
    """The frames of a clip, drawn again."""

    def __init__(
        self, filming: Filming, told: Told, folder: Path, sound: Sequence[str], progress: pipeline.Progress
    ) -> None:
        self.filming, self.told, self.folder = filming, told, folder
        self.sound, self.progress = sound, progress

    def draw(self, trajectory: Trajectory) -> Iterator[Frame]:
        """From the first one on."""
        return self.filming.annotated(self.filming.frames(trajectory), trajectory)

    def compared(self, now: Trajectory, then: Trajectory | None, moved: bool) -> Frames | None:
        """None where no frame differs, and none is more or less."""
        total = len(self.filming.shot(now).order)
        found = differing(self.draw(now), self.told.frames, total, self.progress)
        counts = len(self.told.frames), found.count
        if not found.frames:
            same = counts[0] == counts[1]
            return None if same else Frames(min(counts), 0.0, 0, counts, Why.MOTION if moved else Why.DRAWING)
        what = Frames(found.frames[0], found.times[0], len(found.frames), counts, Why.DRAWING)
        if moved:
            what = self._explained(what, then)
        differ = frozenset(found.frames)
        if what.why is Why.MOTION and then is not None:  # what was drawn then is what is drawn of it now
            old = (frame.rgb for frame in self.draw(then))
            amounts: Measured | str = exactly(self.draw(now), old, differ, total, self.progress)
        else:
            amounts = self._measured(now, differ, total)
        if isinstance(amounts, str):
            return replace(what, unmeasured=amounts)
        most = max(amounts.amounts, key=lambda item: (item.levels, item.pixels), default=None)
        first = amounts.amounts[0] if amounts.amounts else None
        return replace(what, first=first, most=most, film=amounts.film, loss=amounts.loss)

    def _explained(self, what: Frames, then: Trajectory | None) -> Frames:
        """Whether frames differ by the motion alone: the old motion, drawn now, tells."""
        untold = self._untold(then)
        if untold or then is None:
            return replace(what, why=Why.UNTOLD, untold=untold)
        total = len(self.filming.shot(then).order)
        found = differing(self.draw(then), self.told.frames, total, self.progress)
        if not found.frames and found.count == len(self.told.frames):
            return replace(what, why=Why.MOTION)
        return replace(what, why=Why.BOTH, drawn=found.frames[0] if found.frames else found.count)

    def _untold(self, then: Trajectory | None) -> str:
        if then is None:
            return "trajectory.npz does not hold the old motion"
        if self.filming.scene.render.motion_blur > 0:
            return "it has no moments between frames, which motion blur shows"
        if then.names != tuple(body.name for body in self.filming.compiled.world.bodies):
            return "objects came or went"
        return ""

    def _measured(self, now: Trajectory, differ: frozenset[int], total: int) -> Measured | str:
        """How much frames differ; or why that cannot be told."""
        scene = self.filming.scene
        if scene.video_size != self.told.size:
            sizes = [f"{width} x {height} px" for width, height in (self.told.size, scene.video_size)]
            return f"they were {sizes[0]}, and are {sizes[1]}"
        kind = film_in(self.folder, self.told.film, list(self.told.files), lambda file: file in self.sound)
        if kind is None:
            return "no film is left as it was written"
        film = self.folder / kind.named(self.told.film)
        draw = partial(self.draw, now)
        try:
            return measured(
                draw, differ, film, kind, scene.video_size, scene.render.fps, total, self.progress
            )
        except InputError as error:
            return "; ".join(map(str, error.problems))
