"""Frames to the files of one video."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from physgen.pipeline.watch import Progress

if TYPE_CHECKING:
    from physgen.export.video import Format
    from physgen.render.stage import Frame
    from physgen.report.record import RunRecord
    from physgen.scene.scene import Scene


U8 = NDArray[np.uint8]


def write_video(
    frames: Iterator[Frame],
    count: int,
    scene: Scene,
    folder: Path,
    kinds: Sequence[Format],
    record: RunRecord,
    progress: Progress,
    *,
    name: str = "video",
    stage: str = "render",
    doing: str = "",
) -> tuple[list[str], U8]:
    """Writes `count` frames into `folder` as `name`, in all `kinds`; returns their hashes, and the first.

    What making the frames costs is the `stage`'s, the rest encoding's; `doing` is what `progress` is told instead.
    """
    from physgen.export.video import encode_in_thread, open_video
    from physgen.report.record import StageTime, frame_hash

    clock = time.process_time if stage == "refine" else time.thread_time  # a model has threads of its own
    hashes = []
    making = record.stages.setdefault(stage, StageTime())
    encoding = record.stages.setdefault("encode", StageTime())
    started, made, encoded = time.process_time(), making.cpu, encoding.cpu
    with ExitStack() as files:
        with record.stage("encode"):
            writers = [
                files.enter_context(open_video(folder, kind, scene.video_size, scene.render.fps, name))
                for kind in kinds
            ]
        with encode_in_thread(writers) as write:
            for index in range(count):
                with record.stage(stage, clock):
                    frame = next(frames)
                    hashes.append(frame_hash(frame.rgb))
                if index == 0:
                    first = frame.rgb.copy()  # it may be one of a batch
                with record.stage("encode"):
                    write(frame.rgb)
                progress(doing or stage, index + 1, count)
        with record.stage("encode"):
            files.close()
    # the encoder's own threads run on while frames are made: its share is what making them did not take
    encoding.cpu = max(encoded, encoded + time.process_time() - started - (making.cpu - made))
    return hashes, first
