"""Find clips in the folders and videos of a user, and read their frames in one size."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import partial
from itertools import islice
from pathlib import Path

import cv2
import numpy as np

from physgen.messages import Message
from physgen.problems import InputError, collect
from physgen.text import counted, natural
from physgen.videos import SUFFIXES, U8, video_frames

VIDEO_SUFFIXES = (".mp4", ".m4v", ".mov", ".mkv", ".webm", ".avi", ".gif")
CLIP_NAMES = ("video.mp4", "video.gif", "video.webp", "frames")
"""A clip rendered by physgen: the first of these names in the folder of its scene."""
SHAPE_TOLERANCE = 0.02
"""Largest relative difference of two aspect ratios that count as one; videos
have even sides.
"""
"""The fault of a folder."""


@dataclass(frozen=True)
class Source:
    """One clip: a video, or a folder of frames."""

    path: Path
    skip: int = 0
    """Number of first frames to skip."""

    @property
    def is_video(self) -> bool:
        """Return whether the source is a video or a rendered clip, rather than
        any folder of pictures.
        """
        return self.path.name in CLIP_NAMES or not self.path.is_dir()

    def frames(self) -> Iterator[U8]:
        """Yield frames (H, W, 3) sRGB of one size.

        Raise InputError for an unreadable frame, or for another size.
        """
        size: tuple[int, ...] | None = None
        for frame in islice(video_frames(self.path), self.skip, None):
            if size is not None and frame.rgb.shape != size:
                height, width = size[:2]
                raise Message.FRAME_SIZE.error(
                    frame.place,
                    _format_size(frame.rgb.shape),
                    width=width,
                    height=height,
                )
            size = frame.rgb.shape
            yield frame.rgb


def sources(paths: Iterable[Path]) -> list[Source]:
    """Return the clips of one side, in order. Raise InputError with every path without
    clips.
    """
    clips = []
    for clips_of_path in collect(partial(clips_in, path) for path in paths):
        clips += clips_of_path
    return clips


def clips_in(path: Path) -> list[Source]:
    """Return the clips in a path.

    A video is one clip. A folder is one rendered clip, or has videos and folders of
    clips in it; otherwise its pictures are the frames of one clip. Folders of pictures
    beside videos do not count, because galleries have such folders. Raise InputError if
    there are no clips.
    """
    if not path.is_dir():
        if not path.is_file():
            raise Message.NO_SUCH_PATH.error(str(path))
        return [Source(path)]
    # A rendered clip has a video of a known name, and further pictures that do not
    # count.
    for name in CLIP_NAMES:
        if (path / name).exists():
            return [Source(path / name)]
    parts = []
    for part in path.iterdir():
        if not part.name.startswith((".", "_")):
            parts.append(part)
    parts.sort(key=lambda part: natural(part.name))
    clips: list[Source] = []
    for part in parts:
        if part.is_dir():
            clips += _clips_in_part(part)
        elif part.suffix.lower() in VIDEO_SUFFIXES:
            clips.append(Source(part))
    if clips:
        return [clip for clip in clips if clip.is_video] or clips
    if any(part.suffix.lower() in SUFFIXES for part in parts):
        return [Source(path)]
    raise Message.FOLDER_WITHOUT_VIDEOS.error(str(path))


def _clips_in_part(folder: Path) -> list[Source]:
    """Return the clips in a folder, or nothing without clips."""
    try:
        return clips_in(folder)
    except InputError as error:
        code = Message.FOLDER_WITHOUT_VIDEOS.code
        if all(problem.code == code for problem in error.problems):
            return []
        raise


def _format_size(shape: tuple[int, ...]) -> str:
    return f"{shape[1]} x {shape[0]} px"


@dataclass(frozen=True)
class Rule:
    """Selection and size of frames, common to all compared clips."""

    side: int = 256
    """New length of the shorter side, px. All clips must have one aspect ratio."""
    count: int | None = None
    """Number of frames of a clip, evenly from the first to the last; None: all."""

    def frames(self, source: Source) -> list[U8]:
        """Return the frames (H, W, 3) sRGB.

        Raise InputError for an unreadable or empty clip, or for a clip shorter than
        `count`.
        """
        frames = list(map(self.resize, source.frames()))
        if not frames:
            if not source.skip:
                raise Message.VIDEO_EMPTY.error(str(source.path))
            raise Message.CLIP_WITHOUT_FRAMES.error(str(source.path), skip=source.skip)
        if self.count is None:
            return frames
        if len(frames) < self.count:
            raise Message.FRAMES_TOO_FEW.error(
                str(source.path),
                counted(len(frames), "frame"),
                wanted=self.count,
                count=len(frames),
            )
        # Even frames keep the first and the last.
        numbers = np.rint(np.linspace(0, len(frames) - 1, self.count))
        return [frames[k] for k in numbers.astype(int)]

    def resize(self, frame: U8) -> U8:
        """Return a frame of the rule's size.

        A smaller frame averages areas, which avoids aliasing; a larger one uses cubic
        interpolation.
        """
        height, width = frame.shape[:2]
        scale = self.side / min(height, width)
        size = round(width * scale), round(height * scale)
        if size == (width, height):
            return np.ascontiguousarray(frame)
        if scale < 1:
            interpolation = cv2.INTER_AREA
        else:
            interpolation = cv2.INTER_CUBIC
        resized = cv2.resize(frame, size, interpolation=interpolation)
        return np.asarray(resized, np.uint8)


def have_one_shape(first: tuple[int, int], second: tuple[int, int]) -> bool:
    """Return whether two sizes (height, width) have about one aspect ratio.

    >>> have_one_shape((360, 640), (1080, 1920)), have_one_shape((256, 256), (360, 640))
    (True, False)
    """
    ratio = first[1] / first[0] / (second[1] / second[0])
    return abs(ratio - 1) <= SHAPE_TOLERANCE
