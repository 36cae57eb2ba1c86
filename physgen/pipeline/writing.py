"""From frames to the files of one video, which are encoded while frames are drawn."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from physgen import export
from physgen.export.video_formats import I16, U8, Format
from physgen.problems import InputError, Problem
from physgen.progress import Progress
from physgen.render.stage import Frame
from physgen.report.record import RunRecord, StageTime, frame_hash
from physgen.scene.scene import Scene

if TYPE_CHECKING:
    from physgen.export.video import FormatWriter


@dataclass(frozen=True)
class VideoFiles:
    """The files of a clip's videos."""

    scene: Scene
    folder: Path
    formats: Sequence[Format]
    record: RunRecord
    progress: Progress
    failures: list[Problem] = field(default_factory=list)
    """Problems of formats that could not be written, if others could; appended by
    `write`.
    """
    sound: I16 | None = None
    """Samples of the sound track of MP4, (N, 2)."""

    def write(
        self,
        frames: Iterator[Frame],
        count: int,
        name: str = "video",
        stage: str = "render",
        shown: str = "",
    ) -> tuple[list[str], U8]:
        """Write `count` frames in all formats under a name; return hashes and the first
        frame.

        The drawing time of the frames counts as `stage`, the rest as encoding. Progress
        is shown as `shown` or `stage`. Raises InputError if no format can be written.
        """
        record = self.record
        # A model computes in threads of its own: count the time of the whole process.
        if stage == "refine":
            clock = time.process_time
        else:
            clock = time.thread_time
        frame_hashes = []
        encoding = record.stages.setdefault("encode", StageTime())
        with ExitStack() as files:
            with record.stage("encode", time.thread_time):
                writers = self._open_writers(files, name)
                _check_any_usable(writers)

            def encode(rgb: U8) -> None:
                start_time = time.thread_time()
                for writer in writers:
                    writer.write(rgb)
                _check_any_usable(writers)
                encoding.cpu += time.thread_time() - start_time

            with export.video.encode_in_thread([encode]) as write:
                for index in range(count):
                    with record.stage(stage, clock):
                        frame = next(frames)
                        frame_hashes.append(frame_hash(frame.rgb))
                    if index == 0:
                        # The array may be a view of a batch of frames.
                        first_frame = frame.rgb.copy()
                    start_time = time.perf_counter()
                    write(frame.rgb)
                    encoding.wall += time.perf_counter() - start_time
                    self.progress(shown or stage, index + 1, count)
            with record.stage("encode", time.thread_time):
                files.close()
        _check_any_usable(writers)
        for writer in writers:
            self.failures.extend(writer.problems)
        return frame_hashes, first_frame

    def _open_writers(self, files: ExitStack, name: str) -> list[FormatWriter]:
        """Open a file of each format; `files` closes them."""
        render = self.scene.render
        mp4 = export.video.Mp4Options(render.chroma, self.sound)
        size = self.scene.video_size
        writers = []
        for kind in self.formats:
            writer = export.video.FormatWriter(
                self.folder, kind, size, render.fps, name, mp4
            )
            writers.append(files.enter_context(writer))
        return writers


def _check_any_usable(writers: Sequence[FormatWriter]) -> None:
    """Raise InputError with the problems of all formats if each has failed."""
    if writers and all(writer.problems for writer in writers):
        raise InputError(problem for writer in writers for problem in writer.problems)
