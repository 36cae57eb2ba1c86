"""Folders and videos, as a person names them -> clips, each a video, a folder of frames or a strip of them."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import islice
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from physgen.problems import InputError, Place, Problem
from physgen.text import natural
from physgen.videos import SUFFIXES, in_folder, video_frames

U8 = NDArray[np.uint8]

FILMS = (".mp4", ".m4v", ".mov", ".mkv", ".webm", ".avi", ".gif")
RENDERED = ("video.mp4", "video.gif", "video.webp", "frames")
"""A clip of physgen's, the first that is there, in the folder of its scene."""
STRIPS = "clips.json"
"""Says by `frame: [width, height]`, px, that each picture beside it is a clip: frames side by side."""


@dataclass(frozen=True)
class Source:
    """One clip."""

    path: Path
    strip: tuple[int, int] | None = None
    """Width and height, px, of the frames in a picture."""
    skip: int = 0
    """First frames that do not count."""

    @property
    def filmed(self) -> bool:
        """Whether it is a video, strips, or physgen's: more surely a clip than any folder of pictures is."""
        return self.strip is not None or self.path.name in RENDERED or not self.path.is_dir()

    def frames(self) -> Iterator[U8]:
        """(H, W, 3) sRGB, all of one size. Raises InputError where one cannot be read, or where sizes differ."""
        size: tuple[int, ...] | None = None
        for frame, place in islice(self._read(), self.skip, None):
            if size is not None and frame.shape != size:
                found, expected = _px(frame.shape), f"differs from the {_px(size)} of the first frame"
                raise InputError.of(place, found, expected, "make all frames of a clip the same size")
            size = frame.shape
            yield frame

    def _read(self) -> Iterator[tuple[U8, str]]:
        for shown in video_frames(self.path):
            if self.strip is None:
                yield shown.rgb, shown.place
                continue
            wide, high = self.strip
            height, width = shown.rgb.shape[:2]
            if height != high or width % wide:
                expected = f"is no row of frames of {wide} x {high} px, as {STRIPS} says"
                fix = f"make it {high} px high and a whole number of frames wide"
                raise InputError.of(shown.place, _px(shown.rgb.shape), expected, fix)
            for left in range(0, width, wide):
                yield np.ascontiguousarray(shown.rgb[:, left : left + wide]), shown.place


def sources(paths: Iterable[Path]) -> list[Source]:
    """The clips of one side, in order. Raises InputError with every path that holds none."""
    found: list[Source] = []
    problems: list[Problem] = []
    for path in paths:
        try:
            found += clips_in(path)
        except InputError as error:
            problems += error.problems
    if problems:
        raise InputError(problems)
    return found


def clips_in(path: Path) -> list[Source]:
    """A video is a clip. A folder is one clip of physgen's, or of strips, or it holds videos and folders of clips; else
    its pictures are the frames of one.

    Pictures in folders beside videos are no clips: a gallery has such. Raises InputError for what is none of it.
    """
    if not path.is_dir():
        if not path.is_file():
            raise InputError.of(str(path), "", "no such file or folder", "check the path")
        return [Source(path)]
    if (path / STRIPS).is_file():
        strip = _strip(path / STRIPS)
        return [Source(picture, strip) for picture in in_folder(path)]
    for name in RENDERED:
        if (path / name).exists():
            return [Source(path / name)]
    inside = sorted(
        (p for p in path.iterdir() if not p.name.startswith((".", "_"))), key=lambda p: natural(p.name)
    )
    found: list[Source] = []
    for part in inside:
        if part.is_dir():
            found += _below(part)
        elif part.suffix.lower() in FILMS:
            found.append(Source(part))
    if found:
        return [source for source in found if source.filmed] or found
    if any(part.suffix.lower() in SUFFIXES for part in inside):
        return [Source(path)]
    raise InputError.of(str(path), "", "holds no clips", "name a folder of videos, or of folders of frames")


def _below(folder: Path) -> list[Source]:
    try:
        return clips_in(folder)
    except InputError as error:
        if all(problem.expected == "holds no clips" for problem in error.problems):
            return []
        raise


def _strip(path: Path) -> tuple[int, int]:
    """Width and height of a frame."""
    try:
        said = json.loads(path.read_text(encoding="utf-8"))
    except ValueError as error:
        raise InputError.of(
            str(path), "", f"is no JSON ({error})", 'write e.g. {"frame": [256, 256]}'
        ) from None
    frame = said.get("frame") if isinstance(said, dict) else None
    if not (
        isinstance(frame, list) and len(frame) == 2 and all(type(side) is int and side > 0 for side in frame)
    ):
        problem = Problem(
            Place(str(path)), "frame", json.dumps(frame)[:40], "is not the width and height of a frame in px",
            'write e.g. {"frame": [256, 256]}',
        )  # fmt: skip
        raise InputError([problem])
    return frame[0], frame[1]


def _px(shape: tuple[int, ...]) -> str:
    return f"{shape[1]} x {shape[0]} px"
