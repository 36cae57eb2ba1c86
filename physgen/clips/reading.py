"""A video's file, a picture or a folder of pictures -> its frames upright in sRGB, decoded when they are asked for."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar, overload

import numpy as np
from numpy.typing import NDArray

from physgen.clips import film
from physgen.clips.shown import Shown, over_white
from physgen.percepts.photo import read_photo
from physgen.percepts.pixels import load, opened
from physgen.problems import InputError, Place, Problem, Severity
from physgen.scene.words import natural

U8 = NDArray[np.uint8]
Item = TypeVar("Item")
Progress = Callable[[str, int, int], None]

SUFFIXES = (".png", ".jpg", ".jpeg", ".webp", ".bmp", ".tif", ".tiff", ".ppm", ".pgm", ".pnm")
"""Of pictures in a folder; what else lies there is passed over."""
MARKS = (
    (0, b"\x89PNG"),
    (0, b"\xff\xd8\xff"),
    (0, b"GIF8"),
    (8, b"WEBP"),
    (0, b"BM"),
    (0, b"II*\0"),
    (0, b"MM\0*"),
    *((0, b"P%d" % k) for k in range(1, 7)),
)
"""Where, and the bytes there, by which pictures are told from films."""
MOVING = ("GIF", "WEBP", "PNG")
"""Of Pillow's formats, those that play. FFmpeg's libraries decode no WebP that moves."""
NO_TIME = 0.1
"""s that a picture of a GIF is shown which names no time, as browsers do."""
UNEVEN = 0.0105
"""s by which times of frames may differ before it is said: a GIF counts in hundredths."""


class Decoded(Sequence[Item]):
    """Frames in order, decoded when they are asked for; one is held. Going back starts from the first again."""

    def __init__(self, path: Path, start: Callable[[], Iterator[Item]], count: int) -> None:
        """`start` decodes from the first one on."""
        self._path, self._start, self._count = path, start, count
        self._running: Iterator[Item] | None = None
        self._at = -1
        self._held: list[Item] = []

    def __len__(self) -> int:
        return self._count

    @overload
    def __getitem__(self, index: int) -> Item: ...
    @overload
    def __getitem__(self, index: slice) -> list[Item]: ...
    def __getitem__(self, index: int | slice) -> Item | list[Item]:
        """A frame; of a slice, a list. Raises InputError where the file has changed."""
        if isinstance(index, slice):
            return [self[k] for k in range(*index.indices(self._count))]
        index = index + self._count if index < 0 else index
        if not 0 <= index < self._count:
            raise IndexError(index)
        if self._running is None or index < self._at:
            self._running, self._at = self._start(), -1
        while self._at < index:
            try:
                self._held = [next(self._running)]
            except StopIteration:
                fix = "leave it as it is while it is read"
                raise InputError.of(str(self._path), "", "has lost frames since it was opened", fix) from None
            self._at += 1
        return self._held[0]


@dataclass(frozen=True)
class Clip:
    """A video whose every frame could be decoded."""

    path: Path
    size: tuple[int, int]
    """Width and height, px."""
    fps: float | None
    """1/s; None: pictures, which have no time."""
    frames: Sequence[U8]
    """(H, W, 3) sRGB each."""
    remarks: tuple[Problem, ...]
    """What of the file does not come along: sound, uneven times ..."""


def open_clip(path: Path, progress: Progress = lambda stage, done, total: None) -> Clip:
    """Frames are decoded once, to count and to check them. Raises InputError."""
    start, fps, remarks = _source(path)
    size = None
    seconds = []
    for shown in start():
        height, width = shown.rgb.shape[:2]
        size = size or (width, height)
        if size != (width, height):
            expected = f"differs from the {size[0]} x {size[1]} px of the first frame"
            fix = "make all frames the same size"
            raise InputError.of(shown.place, f"{width} x {height} px", expected, fix)
        seconds.append(shown.seconds)
        progress("read", len(seconds), 0)
    if size is None:
        raise InputError.of(str(path), "", "has no frame", "name a video that shows something")
    timed = [s for s in seconds if s]
    if fps is None and timed:
        fps = len(timed) / sum(timed)
    most, least = (pick(timed[:-1], default=0.0) for pick in (max, min))  # the last is often odd
    if fps is not None and most - least > UNEVEN:
        expected = f"shows some frames for {least:.3g} s, others for {most:.3g} s"
        remarks += (_remark(path, expected, f"now all are shown equally long, at {fps:.4g} fps"),)
    frames = Decoded(path, lambda: (shown.rgb for shown in start()), len(seconds))
    return Clip(path, size, fps, frames, remarks)


def shown_in(path: Path) -> Iterator[Shown]:
    """Frames of a video or a picture one after the other, each decoded once, unchecked. Raises InputError."""
    return _source(path)[0]()


def _source(path: Path) -> tuple[Callable[[], Iterator[Shown]], float | None, tuple[Problem, ...]]:
    """What decodes it from the first frame on, frames a second where the file says so, and what there is to say."""
    if path.is_dir():
        pictures = in_folder(path)
        return lambda: map(_still, pictures), None, ()
    if is_picture(path):
        return (lambda: _pages(path)) if plays(path) else (lambda: iter([_still(path)])), None, ()
    told = film.told(path)
    return lambda: film.frames(path), told.fps, tuple(_remark(path, *said) for said in told.remarks)


def _remark(path: Path, expected: str, fix: str) -> Problem:
    return Problem(Place(str(path)), "", "", expected, fix, Severity.WARNING)


def in_folder(folder: Path) -> list[Path]:
    """The pictures of a folder in the natural order of their names. Raises InputError where there are none."""
    found = [p for p in folder.iterdir() if p.suffix.lower() in SUFFIXES and p.name[0] != "." and p.is_file()]
    if not found:
        raise InputError.of(str(folder), "", "holds no pictures", "name a folder of one picture a frame")
    return sorted(found, key=lambda p: natural(p.name))


def is_picture(path: Path) -> bool:
    """Whether a file is a picture, by its first bytes; it may play. Raises InputError where there is no file."""
    if not path.is_file():
        raise InputError.of(str(path), "", "no such file", "check the path")
    with path.open("rb") as file:
        head = file.read(16)
    return any(head[at : at + len(mark)] == mark for at, mark in MARKS)


def plays(picture: Path) -> bool:
    """Whether a picture holds more than one, one after the other. Raises InputError."""
    with opened(picture) as image:
        return image.format in MOVING and getattr(image, "n_frames", 1) > 1


def _still(path: Path) -> Shown:
    return Shown(read_photo(path).rgb, None, str(path))


def _pages(path: Path) -> Iterator[Shown]:
    """Frames of a picture that plays, each whole."""
    with opened(path) as image:
        for k in range(getattr(image, "n_frames", 1)):
            place = f"{path}: frame {k}"
            try:
                image.seek(k)
            except (EOFError, OSError, SyntaxError, ValueError):
                raise InputError.of(place, "", "cannot be decoded", film.AGAIN) from None
            load(image, Path(place))
            seconds = float(image.info.get("duration") or 0) / 1000
            yield Shown(over_white(np.asarray(image.convert("RGBA"))), seconds or NO_TIME, place)
