"""Ground-truth labels exported in the same pass that draws the frames."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from physgen.pipeline.stages import Film
from physgen.problems import InputError
from physgen.progress import Progress

if TYPE_CHECKING:
    from physgen.export.formats import LabelFormat
    from physgen.export.labels import Moment
    from physgen.maps import Percepts
    from physgen.render.stage import Frame
    from physgen.report.record import RunRecord
    from physgen.scene.scene import Scene
    from physgen.simulate.trajectory import Trajectory

Tap = Callable[["Iterator[Frame]"], "Iterator[Frame]"]
"""Returns the same frames."""


@dataclass(frozen=True)
class Labels:
    """The formats of labels of one clip."""

    kinds: Sequence[LabelFormat]
    maps: Percepts | None
    """Of the photo, where a format needs them."""

    @classmethod
    def of(cls, formats: Sequence[str], scene: Scene, maps: Percepts | None) -> Labels:
        """Raises InputError where a format is unknown, or does not fit the scene."""
        if not formats:
            return cls((), None)
        from physgen.export.formats import check_fits, chosen_formats

        chosen = chosen_formats(formats)
        check_fits(chosen, scene, maps)
        return cls(chosen, maps if any(kind.maps for kind in chosen) else None)

    def check_kept(self, final: Path) -> None:
        """Raises InputError where the folder holds files of an earlier run that this one would remove."""
        from physgen.report.folders import recorded_files
        from physgen.text import listed

        again = {"trajectory.npz", *(kind.name for kind in self.kinds)}
        lost = sorted({name.partition("/")[0] for name in recorded_files(final)} - again)
        if lost:
            expected = f"holds {listed(lost, 'and')} of an earlier run, which would go"
            fix = "name all formats at once, or choose another folder with -o"
            raise InputError.of(str(final), "", expected, fix)

    @contextmanager
    def exported(self, film: Film, trajectory: Trajectory, folder: Path, record: RunRecord) -> Iterator[Tap]:
        """Labels into `folder`, of the frames that go through the tap; complete when the block ends."""
        if not self.kinds:
            yield lambda frames: frames
            return
        from physgen.export.formats import open_writers
        from physgen.export.labels import Clip, MomentQueue, starting_labels
        from physgen.export.masks import extents
        from physgen.report.record import StageTime

        shot, scene, compiled = film.shot(trajectory), film.scene, film.compiled
        labels = None if self.maps is None else self.maps.labels
        clip = Clip(
            scene.name,
            scene,
            compiled.world,
            trajectory,
            self.maps,
            extents(film.stage, compiled.world),
            scene.video_size,
            scene.render.fps,
            len(shot.order),
            shot,
            record.inputs,
            sampled=film.sampled,
            stood=starting_labels(compiled.labels, labels, compiled.scenery),
        )
        queues: list[MomentQueue] = []
        with ExitStack() as held:
            with record.stage("export"):
                writers = held.enter_context(open_writers(self.kinds, folder, clip))

            def write(moment: Moment | None) -> None:
                if moment is not None:
                    for writer in writers:
                        writer.add(moment)

            def tap(frames: Iterator[Frame]) -> Iterator[Frame]:
                fine, parts = film.exposed(trajectory)
                samples = [sample * parts + parts - 1 for sample in shot.order]
                for frame in frames:
                    wall, cpu = time.perf_counter(), time.thread_time()
                    if not queues:
                        queues.append(MomentQueue(clip.world, fine, samples, shot))
                    write(queues[0].put(frame))
                    wall, cpu = time.perf_counter() - wall, time.thread_time() - cpu
                    for stage, sign in (("export", 1), ("render", -1)):  # the caller counts it as drawing
                        times = record.stages.setdefault(stage, StageTime())
                        times.wall += sign * wall
                        times.cpu += sign * cpu
                    yield frame

            yield tap
            with record.stage("export"):
                write(queues[0].end() if queues else None)
                held.close()

    def of_frames(
        self, film: Film, trajectory: Trajectory, folder: Path, record: RunRecord, progress: Progress
    ) -> None:
        """Labels into `folder`, of frames that are drawn for nothing else."""
        if not self.kinds:
            return
        count = len(film.shot(trajectory).order)
        with self.exported(film, trajectory, folder, record) as tap:
            for index, _ in enumerate(tap(film.frames(trajectory))):
                progress("export", index + 1, count)
