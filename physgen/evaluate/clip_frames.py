"""Folders and videos named by a user -> clips, and their frames in one size."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import partial
from itertools import islice
from pathlib import Path

import cv2
import numpy as np

from physgen.problems import InputError, collect
from physgen.text import natural
from physgen.videos import SUFFIXES, U8, video_frames

FILMS = (".mp4", ".m4v", ".mov", ".mkv", ".webm", ".avi", ".gif")
RENDERED = ("video.mp4", "video.gif", "video.webp", "frames")
"""A clip that physgen rendered: the first of these in the folder of its scene."""
ALIKE = 0.02
"""Largest relative difference of two aspect ratios that count as one; videos have even sides."""


@dataclass(frozen=True)
class Source:
    """One clip: a video, or a folder of frames."""

    path: Path
    skip: int = 0  # first frames that do not count

    @property
    def filmed(self) -> bool:
        """Whether it is a video or a rendered clip, rather than any folder of pictures."""
        return self.path.name in RENDERED or not self.path.is_dir()

    def frames(self) -> Iterator[U8]:
        """(H, W, 3) sRGB, all of one size. Raises InputError for a frame that cannot be read or differs in size."""
        size: tuple[int, ...] | None = None
        for shown in islice(video_frames(self.path), self.skip, None):
            if size is not None and shown.rgb.shape != size:
                expected = f"differs from the {_px(size)} of the first frame"
                fix = "make all frames of a clip the same size"
                raise InputError.of(shown.place, _px(shown.rgb.shape), expected, fix)
            size = shown.rgb.shape
            yield shown.rgb


def sources(paths: Iterable[Path]) -> list[Source]:
    """Clips of one side, in order. Raises InputError with every path that holds none."""
    return [
        clip
        for clips in collect(partial(clips_in, path) for path in paths)
        for clip in clips
    ]


def clips_in(path: Path) -> list[Source]:
    """A video is one clip. A folder is one rendered clip, or holds videos and folders of clips; otherwise its pictures
    are the frames of one clip.

    Folders of pictures beside videos are no clips: galleries have such. Raises InputError where there is none.
    """
    if not path.is_dir():
        if not path.is_file():
            raise InputError.of(
                str(path), "", "no such file or folder", "check the path"
            )
        return [Source(path)]
    for name in RENDERED:
        if (path / name).exists():
            return [Source(path / name)]
    inside = [part for part in path.iterdir() if not part.name.startswith((".", "_"))]
    found: list[Source] = []
    for part in sorted(inside, key=lambda part: natural(part.name)):
        if part.is_dir():
            try:
                found += clips_in(part)
            except InputError as error:
                if any(
                    problem.expected != "holds no clips" for problem in error.problems
                ):
                    raise
        elif part.suffix.lower() in FILMS:
            found.append(Source(part))
    if found:
        return [source for source in found if source.filmed] or found
    if any(part.suffix.lower() in SUFFIXES for part in inside):
        return [Source(path)]
    raise InputError.of(
        str(path),
        "",
        "holds no clips",
        "name a folder of videos, or of folders of frames",
    )


def _px(shape: tuple[int, ...]) -> str:
    return f"{shape[1]} x {shape[0]} px"


@dataclass(frozen=True)
class Rule:
    """Selection and size of frames, one for all clips that are compared."""

    side: int = (
        256  # px that the shorter side becomes; all clips must have one aspect ratio
    )
    count: int | None = (
        None  # frames of a clip, evenly from the first to the last; None: all
    )

    def frames(self, source: Source) -> list[U8]:
        """(H, W, 3) sRGB. Raises InputError for a clip that cannot be read, is empty, or is shorter than `count`."""
        frames = [self.sized(frame) for frame in source.frames()]
        if not frames:
            after = f" after the first {source.skip}" if source.skip else ""
            raise InputError.of(
                str(source.path), "", f"has no frame{after}", "leave it out"
            )
        if self.count is None:
            return frames
        if len(frames) < self.count:
            found = f"{len(frames)} frame{'s' * (len(frames) != 1)}"
            fix = f"give --frames {len(frames)}, or leave the clip out"
            raise InputError.of(
                str(source.path), found, f"are fewer than --frames {self.count}", fix
            )
        return [
            frames[k]
            for k in np.rint(np.linspace(0, len(frames) - 1, self.count)).astype(int)
        ]

    def sized(self, frame: U8) -> U8:
        """Areas are averaged where the frame shrinks, so that nothing aliases; cubic where it grows."""
        height, width = frame.shape[:2]
        scale = self.side / min(height, width)
        size = round(width * scale), round(height * scale)
        if size == (width, height):
            return np.ascontiguousarray(frame)
        way = cv2.INTER_AREA if scale < 1 else cv2.INTER_CUBIC
        return np.asarray(cv2.resize(frame, size, interpolation=way), np.uint8)


def one_shape(one: tuple[int, int], other: tuple[int, int]) -> bool:
    """Whether two sizes (height, width) have about one aspect ratio.

    >>> one_shape((360, 640), (1080, 1920)), one_shape((256, 256), (360, 640))
    (True, False)
    """
    return abs(one[1] / one[0] / (other[1] / other[0]) - 1) <= ALIKE
