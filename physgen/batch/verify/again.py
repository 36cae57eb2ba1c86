"""A clip's folder -> its scene rendered again and compared, and nothing written there."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from physgen import pipeline
from physgen.batch.verify import causes
from physgen.batch.verify.motion import apart, stored_motion
from physgen.batch.verify.recorded import recorded
from physgen.batch.verify.redrawn import Clip, Take, compared, gives
from physgen.batch.verify.told import Told, read_told
from physgen.batch.verify.verdict import Outcome, Recorded, Verdict
from physgen.batch.workers import LostError
from physgen.pipeline.packs import scene_file
from physgen.problems import InputError
from physgen.report.record import inputs
from physgen.whole import meant

if TYPE_CHECKING:
    from physgen.scene.model import Scene

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
    except Exception as error:  # a manifest may be anybody's, and other clips wait
        return failed(claim, error)


def failed(claim: Claim, error: BaseException | LostError) -> Verdict:
    """Not the scene's fault: the machine's, or ours."""
    said = "ran out of memory" if isinstance(error, MemoryError) else str(error)
    if not isinstance(error, MemoryError | OSError | LostError):
        said = f"{type(error).__name__}: {said}"
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
    files = causes.files(told, inputs(scene, scene_file(path)))
    values = causes.values(told, scene.document)
    found = Verdict(
        str(folder),
        Outcome.EQUAL,
        len(told.samples),
        len(told.frames),
        len(told.files),
        (*files, *values),
        causes.elsewhere(told, device),
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
    claim: Claim, told: Told, scene: Scene, progress: pipeline.Progress
) -> tuple[Take | None, Recorded]:
    """The scene as the manifest has it, if that still gives the clip: then all that differs comes from the scene."""
    try:
        take = Take(recorded(told, scene), claim.device, progress)
    except (InputError, ValueError, RecursionError):  # a manifest may be anybody's
        return None, Recorded.UNREAD
    return (take, Recorded.SAME) if gives(take, told, progress) else (None, Recorded.OTHER)


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
