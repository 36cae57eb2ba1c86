"""Frames that are drawn now, and a clip's hashes and films -> the first frame that differs, how many pixels, how far.

A run keeps a hash of each frame, and the frames themselves only as PNG. Any other film has lost something of them, so
the new frames are made into such a film, too, and the two are compared as they are decoded. What an encoder makes of a
frame depends on the frames around it, so frames that are alike may come out a little differently: what is less than the
film loses of its own frames says nothing.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterator, Sequence, Set
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from physgen.problems import InputError

if TYPE_CHECKING:
    from physgen.render.stage import Frame
    from physgen.report.video import Format

U8 = NDArray[np.uint8]
Draw = Callable[[], Iterator["Frame"]]
"""Draws the clip from its first frame on."""
Progress = Callable[[str, int, int], None]


@dataclass(frozen=True)
class Differing:
    """Which frames do."""

    frames: tuple[int, ...]
    """Among those that both clips have."""
    times: tuple[float, ...]
    """s of the motion: what each of them shows."""
    count: int
    """Frames that there are now."""


@dataclass(frozen=True)
class Amount:
    """How much of one frame differs."""

    frame: int
    pixels: int
    """Those of which a channel differs by more grey levels than the film may lose."""
    levels: int
    """Of 255: the most that a channel of a pixel differs by."""


@dataclass(frozen=True)
class Measured:
    """How much frames differ."""

    amounts: tuple[Amount, ...]
    """Of those that do, in their order."""
    film: str
    """What it was measured in: `video.mp4` ...; empty where that loses nothing."""
    loss: int
    """Grey levels: the most that the film loses of its own frames; less says nothing."""


def differing(frames: Iterator[Frame], hashes: Sequence[str], total: int, progress: Progress) -> Differing:
    """Which of `total` frames are not those of the `hashes`."""
    from physgen.report.record import frame_hash

    found, times, count = [], [], 0
    for count, frame in enumerate(frames, 1):
        if count <= len(hashes) and frame_hash(frame.rgb) != hashes[count - 1]:
            found.append(count - 1)
            times.append(frame.time)
        progress("render", count, total)
    return Differing(tuple(found), tuple(times), count)


def film_in(folder: Path, name: str, files: Sequence[str], sound: Callable[[str], bool]) -> Format | None:
    """What is best to compare with, of the films called `name` that a run wrote; `sound` ones only."""
    from physgen.report.video import Format

    for kind in (Format.PNG, Format.MP4, Format.WEBP, Format.GIF):
        file = kind.named(name)
        parts = [part for part in files if part == file or part.startswith(f"{file}/")]
        if parts and all(map(sound, parts)):
            return kind
    return None


def measured(
    draw: Draw,
    differ: Set[int],
    film: Path,
    kind: Format,
    size: tuple[int, int],
    fps: float,
    total: int,
    progress: Progress,
) -> Measured:
    """How much the frames `differ` are apart from those in `film`. Raises InputError where it cannot be read."""
    from physgen.clips.reading import shown_in
    from physgen.report.video import Format, open_video

    if kind is Format.PNG:
        stored = (next(shown_in(film / f"{k:05d}.png")).rgb if k in differ else None for k in range(total))
        return exactly(draw(), stored, differ, total, progress)
    counts, loss = {}, 0
    with tempfile.TemporaryDirectory(prefix="physgen-") as folder:
        with open_video(Path(folder), kind, size, fps) as write:
            for k, frame in enumerate(draw()):
                write(frame.rgb)
                progress("compare", k + 1, total)
        films = zip(shown_in(film), shown_in(Path(folder) / kind.file), draw(), strict=False)
        for k, (old, new, frame) in enumerate(films):
            height, width = frame.rgb.shape[:2]  # a film may have a row and a column more
            loss = max(loss, int(np.flatnonzero(levels(k, new.rgb[:height, :width], frame.rgb)).max()))
            if k in differ:
                counts[k] = levels(k, old.rgb, new.rgb)
    return Measured(tuple(_amount(k, count, loss) for k, count in counts.items()), film.name, loss)


def exactly(
    new: Iterator[Frame], old: Iterator[U8 | None], differ: Set[int], total: int, progress: Progress
) -> Measured:
    """How much the frames `differ` are apart from the `old` ones, of which only those are needed."""
    amounts = []
    for k, (frame, before) in enumerate(zip(new, old, strict=False)):
        if k in differ and before is not None:
            amounts.append(_amount(k, levels(k, before, frame.rgb), 0))
        progress("compare", k + 1, total)
    return Measured(tuple(amounts), "", 0)


def levels(frame: int, old: U8, new: U8) -> NDArray[np.int64]:
    """(256,): how many pixels of two pictures (H, W, 3) sRGB differ by so many grey levels in a channel, at most.

    Raises InputError where they are not as large.
    """
    if old.shape != new.shape:
        sizes = [f"{shape[1]} x {shape[0]} px" for shape in (old.shape, new.shape)]
        raise InputError.of(f"frame {frame}", sizes[0], f"is now {sizes[1]}", "")
    apart = np.abs(old.astype(np.int16) - new).max(axis=2)
    return np.bincount(apart.ravel(), minlength=256)


def _amount(frame: int, counts: NDArray[np.int64], loss: int) -> Amount:
    return Amount(frame, int(counts[loss + 1 :].sum()), int(np.flatnonzero(counts).max()))
