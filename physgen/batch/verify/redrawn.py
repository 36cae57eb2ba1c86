"""A scene, its motion and a clip's manifest -> how the frames that are drawn now differ from the clip's, and why."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from physgen import pipeline
from physgen.batch.verify.pictures import Measured, differing, exactly, film_in, measured
from physgen.batch.verify.told import Told
from physgen.batch.verify.verdict import Frames, Why
from physgen.pipeline.filming import Filming
from physgen.pipeline.warm import Keep, Warm
from physgen.problems import InputError
from physgen.report.record import RunRecord
from physgen.report.video import Format

if TYPE_CHECKING:
    from physgen.render.stage import Frame
    from physgen.scene.model import Scene
    from physgen.simulate.trajectory import Trajectory


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

    told: Told
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


def gives(take: Take, told: Told, progress: pipeline.Progress) -> bool:
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
