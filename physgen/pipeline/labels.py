"""Ground-truth labels exported in the same pass that draws the frames."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from physgen.pipeline.filming import Filming
from physgen.pipeline.watch import Progress
from physgen.problems import InputError, Place, Problem, Severity, Warn

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from physgen.export.formats import LabelFormat
    from physgen.export.labels import Clip, Moment, MomentQueue, Writer
    from physgen.maps import Percepts
    from physgen.render.stage import Frame
    from physgen.report.record import RunRecord
    from physgen.scene.scene import Scene
    from physgen.simulate.trajectory import Trajectory


Tapped = Callable[["Iterator[Frame]"], "Iterator[Frame]"]
"""Hands the very same frames on."""


@dataclass(frozen=True)
class Labels:
    """What is to be told of a clip."""

    kinds: Sequence[LabelFormat]
    maps: Percepts | None
    """Of the photo, where a format asks for them."""

    @classmethod
    def of(cls, formats: Sequence[str], scene: Scene, maps: Percepts | None) -> Labels:
        """Raises InputError where a format is none, or not for this scene."""
        if not formats:
            return cls((), None)
        from physgen.export.formats import check_fits, chosen_formats

        chosen = chosen_formats(formats)
        check_fits(chosen, scene, maps)
        return cls(chosen, maps if any(kind.maps for kind in chosen) else None)

    def check_kept(self, final: Path) -> None:
        """Raises InputError where labels replace what an earlier run left in their folder and would not come again."""
        from physgen.report.folders import recorded_files
        from physgen.text import listed

        again = {"trajectory.npz", *(kind.name for kind in self.kinds)}
        lost = sorted({name.partition("/")[0] for name in recorded_files(final)} - again)
        if lost:
            expected = f"holds {listed(lost, 'and')} of an earlier run, which would go"
            fix = "name all formats at once, or choose another folder with -o"
            raise InputError.of(str(final), "", expected, fix)

    def tell_gone(self, final: Path, warn: Warn) -> None:
        """Tells of labels of an earlier run that a new clip does not have; in the same words for all clips."""
        from physgen.export.formats import FORMATS
        from physgen.report.folders import recorded_files
        from physgen.text import listed

        parts = [name.split("/") for name in recorded_files(final) if "/" in name]
        had = {path[1] if path[0] == "truth" else path[0] for path in parts if path[0] != "frames"}
        had &= {kind.name for kind in FORMATS}
        gone = sorted(had - {kind.name for kind in self.kinds})
        if gone:
            what = f"had labels that were not asked for this time, and go: {listed(gone, 'and')}"
            fix = f"add --export {','.join(sorted(had | {kind.name for kind in self.kinds}))} to have them again"
            warn(Problem(Place(str(final.parent)), "", "", what, fix, Severity.WARNING))

    @contextmanager
    def exported(
        self, filming: Filming, trajectory: Trajectory, folder: Path, record: RunRecord
    ) -> Iterator[Tapped]:
        """Formats into `folder`, of the frames that go through the tap; whole when the block ends."""
        if not self.kinds:
            yield lambda frames: frames
            return
        from physgen.export.formats import open_writers
        from physgen.export.labels import Clip
        from physgen.export.masks import extents

        shot = filming.shot(trajectory)
        scene = filming.scene
        clip = Clip(
            scene.name,
            scene,
            filming.compiled.world,
            trajectory,
            self.maps,
            extents(filming.stage, filming.compiled.world),
            scene.video_size,
            scene.render.fps,
            len(shot.order),
            shot,
            record.inputs,
            sampled=filming.sampled,
            stood=_stood(filming, self.maps),
        )
        with ExitStack() as held:
            with record.stage("export"):
                writers = held.enter_context(open_writers(self.kinds, folder, clip))
            tap = Tap(filming, trajectory, writers, clip, record)
            yield tap
            with record.stage("export"):
                tap.finish()
                held.close()

    def of_frames(
        self, filming: Filming, trajectory: Trajectory, folder: Path, record: RunRecord, progress: Progress
    ) -> None:
        """Formats into `folder`, of frames that are drawn for nothing else."""
        if not self.kinds:
            return
        count = len(filming.shot(trajectory).order)
        with self.exported(filming, trajectory, folder, record) as tap:
            for index, _ in enumerate(tap(filming.frames(trajectory))):
                progress("export", index + 1, count)


def _stood(filming: Filming, maps: Percepts | None) -> NDArray[np.uint16]:
    """(H, W) of the photo: who stands where at t = 0."""
    from physgen.export.labels import starting_labels

    compiled = filming.compiled
    return starting_labels(compiled.labels, None if maps is None else maps.labels, compiled.scenery)


class Tap:
    """Hands frames on, and what is true of each to the writers, one frame later."""

    def __init__(
        self,
        filming: Filming,
        trajectory: Trajectory,
        writers: Sequence[Writer],
        clip: Clip,
        record: RunRecord,
    ) -> None:
        self._filming, self._trajectory, self._record = filming, trajectory, record
        self._writers, self._world = writers, clip.world
        self._queue: MomentQueue | None = None

    def __call__(self, frames: Iterator[Frame]) -> Iterator[Frame]:
        """The very same frames."""
        from physgen.export.labels import MomentQueue

        fine, parts = self._filming.exposed(self._trajectory)
        shot = self._filming.shot(self._trajectory)
        samples = [sample * parts + parts - 1 for sample in shot.order]
        for frame in frames:
            wall, cpu = time.perf_counter(), time.thread_time()
            self._queue = self._queue or MomentQueue(self._world, fine, samples, shot)
            self._put(self._queue.put(frame))
            self._took(time.perf_counter() - wall, time.thread_time() - cpu)
            yield frame

    def finish(self) -> None:
        """The last frame was handed on."""
        self._put(self._queue.end() if self._queue else None)

    def _took(self, wall: float, cpu: float) -> None:
        """Whoever asks for a frame counts this as drawing, which it is not."""
        from physgen.report.record import StageTime

        for stage, sign in (("export", 1), ("render", -1)):
            times = self._record.stages.setdefault(stage, StageTime())
            times.wall += sign * wall
            times.cpu += sign * cpu

    def _put(self, moment: Moment | None) -> None:
        if moment is not None:
            for writer in self._writers:
                writer.add(moment)
