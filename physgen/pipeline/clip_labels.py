"""Ground-truth labels that are written while a clip is drawn."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from physgen import export
from physgen.messages import Message
from physgen.pipeline.film import Film
from physgen.pipeline.labelling import labelled_clip, open_queue
from physgen.progress import Progress
from physgen.report.folders import (
    lost_files,
    read_manifest,
)
from physgen.report.record import (
    RunRecord,
    StageTime,
)

if TYPE_CHECKING:
    from physgen.export.formats import LabelFormat
    from physgen.export.labels import Moment, MomentQueue
    from physgen.maps import Percepts
    from physgen.render.stage import Frame
    from physgen.scene.scene import Scene
    from physgen.simulate.trajectory import Trajectory


Tap = Callable[["Iterator[Frame]"], "Iterator[Frame]"]
"""Function that returns the same frames, and uses them on the way."""


@dataclass(frozen=True)
class Labels:
    """The formats of labels of one clip."""

    kinds: Sequence[LabelFormat]
    maps: Percepts | None
    """Maps of the photo, if a format needs them."""

    @classmethod
    def for_clip(
        cls, formats: Sequence[str], scene: Scene, maps: Percepts | None
    ) -> Labels:
        """Create the labels of a clip. Raises InputError for a wrong format for the
        scene.
        """
        if not formats:
            return cls((), None)

        label_formats = export.formats.choose_formats(formats)
        export.formats.check_fits(label_formats, scene, maps)
        return cls(
            label_formats, maps if any(kind.needs for kind in label_formats) else None
        )

    def check_kept(self, final: Path) -> None:
        """Raise InputError if this run would remove files of an earlier run from the
        folder.
        """
        if removed_files := lost_files(
            read_manifest(final),
            {"trajectory.npz", *(kind.name for kind in self.kinds)},
        ):
            raise Message.FILES_WOULD_BE_LOST.error(str(final), files=removed_files)

    @contextmanager
    def export_labels(
        self, film: Film, trajectory: Trajectory, folder: Path, record: RunRecord
    ) -> Iterator[Tap]:
        """Write labels of the frames that pass the tap into `folder`.

        The labels are complete when the block ends.
        """
        if not self.kinds:
            yield lambda frames: frames
            return

        # Labels read frames on their way to the video: drawing each frame again would
        # double the time.
        shot = film.shot(trajectory)
        clip = labelled_clip(film, trajectory, record, self.maps)
        queues: list[MomentQueue] = []
        with ExitStack() as open_files:
            with record.stage("export"):
                writers = open_files.enter_context(
                    export.formats.open_writers(self.kinds, folder, clip)
                )

            def write(moment: Moment | None) -> None:
                if moment is not None:
                    for writer in writers:
                        writer.add(moment)

            def tap(frames: Iterator[Frame]) -> Iterator[Frame]:
                exposure_samples, parts = film.sample_exposures(trajectory)
                samples = [sample * parts + parts - 1 for sample in shot.order]
                for frame in frames:
                    wall_time = time.perf_counter()
                    cpu_time = time.thread_time()
                    if not queues:
                        queues.append(open_queue(clip, exposure_samples, samples))
                    write(queues[0].put(frame))
                    wall_time = time.perf_counter() - wall_time
                    cpu_time = time.thread_time() - cpu_time
                    # The caller counts all time of this generator as drawing.
                    _count_time(record, "export", wall_time, cpu_time)
                    _count_time(record, "render", -wall_time, -cpu_time)
                    yield frame

            yield tap
            with record.stage("export"):
                write(queues[0].end() if queues else None)
                open_files.close()

    def of_frames(
        self,
        film: Film,
        trajectory: Trajectory,
        folder: Path,
        record: RunRecord,
        progress: Progress,
    ) -> None:
        """Write labels into `folder`, of frames drawn only for this purpose."""
        if not self.kinds:
            return
        count = len(film.shot(trajectory).order)
        with self.export_labels(film, trajectory, folder, record) as tap:
            for index, _ in enumerate(tap(film.frames(trajectory))):
                progress("export", index + 1, count)


def _count_time(record: RunRecord, stage: str, wall: float, cpu: float) -> None:
    """Add wall and CPU time, s, to a stage."""
    times = record.stages.setdefault(stage, StageTime())
    times.wall += wall
    times.cpu += cpu
