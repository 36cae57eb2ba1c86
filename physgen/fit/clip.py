"""The filmed clip of a scene: frames, times and size."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import islice
from pathlib import Path

import numpy as np

from physgen.arrays import F64, U8
from physgen.compile.compile import CompiledScene
from physgen.fit.film import follow_film
from physgen.fit.tracks import Tracks
from physgen.messages import Message
from physgen.problems import Place, Warn
from physgen.progress import Progress
from physgen.render.stage import Stage
from physgen.scene.scene import Scene
from physgen.videos import Video, read_video

MOST_FRAMES = 600
"""Frames of a clip that are followed, at most."""
EVEN_DURATIONS = 0.0015
"""Largest difference between the durations of equal frames, s, since files round them."""
SIZE_TOLERANCE = 0.5
"""Difference between the sizes of a clip and a photo, px, besides the encoder's."""


class FilmedClip:
    """A clip whose first frame shows the photo of a scene."""

    def __init__(self, path: Path, slowdown: float, scene: Scene) -> None:
        """Raise InputError for an unreadable clip or a clip of another size."""
        self.video: Video = read_video(path)
        self.size = scene.size
        width, height = scene.size
        clip_width, clip_height = self.video.size
        # Encoders make odd sides even.
        tolerance = 1 + SIZE_TOLERANCE
        difference = max(abs(clip_width - width), abs(clip_height - height))
        if difference > tolerance:
            found = f"{clip_width} x {clip_height} px"
            message = Message.FIT_CLIP_SIZE
            raise message.error(str(path), found, width=width, height=height)
        if self.video.fps is None:
            raise Message.FIT_CLIP_WITHOUT_RATE.error(str(path))
        self.fps = self.video.fps
        count = min(self.video.count, MOST_FRAMES)
        times = frame_times(self.video.durations, self.fps)
        self.times: F64 = times[:count] / slowdown

    def warn_of_frames(self, warn: Warn) -> None:
        """Warn of frames beyond the limit."""
        rest = self.video.count - len(self.times)
        if rest:
            place = Place(str(self.video.path))
            found = f"{rest} frames"
            warn(Message.FIT_FRAMES_LEFT.warning(place, "", found, most=MOST_FRAMES))

    def frames(self) -> Iterator[U8]:
        """Yield the frames, (H, W, 3) sRGB of the photo's size."""
        width, height = self.size
        for frame in islice(self.video.frames(), len(self.times)):
            frame_height, frame_width = frame.shape[:2]
            rows = max(height - frame_height, 0)
            columns = max(width - frame_width, 0)
            # A lost row at the border repeats its neighbour.
            complete = np.pad(frame, ((0, rows), (0, columns), (0, 0)), mode="edge")
            yield np.ascontiguousarray(complete[:height, :width])

    def tracks(
        self,
        compiled_scene: CompiledScene,
        stage: Stage,
        has_photo: bool,
        progress: Progress,
    ) -> Tracks:
        """Follow the objects of a scene and return their tracks."""
        world = compiled_scene.world
        frames = self.frames()
        return follow_film(frames, self.times, stage, world, has_photo, progress)


def frame_times(durations: Sequence[float | None], fps: float) -> F64:
    """Return the time at which each frame begins, s."""
    known_durations = []
    for duration in durations:
        known_durations.append(1 / fps if duration is None else duration)
    frame_durations = np.array(known_durations)
    # Files round durations: multiples of the rate are exact, and their errors do not
    # add up.
    if np.ptp(frame_durations) < EVEN_DURATIONS:
        return np.arange(len(frame_durations)) / fps
    return np.concatenate([[0.0], np.cumsum(frame_durations[:-1])])
