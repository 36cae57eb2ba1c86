"""Masks of a video, as pictures or as a video -> how much of each pixel objects cover, frame by frame.

What a mask's numbers mean is told by its kind:

- grey of 8 bits: coverage, 0 none .. 255 all, soft at borders; so are videos of masks, and a picture's opacity;
- 16 bits, a palette of colours, or colours: ids or colours of objects, anything but 0 or black is an object;
- grey of 8 bits that is nowhere brighter than `FEW` in all masks: ids, too, and that is said.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.clips.reading import Clip, Decoded, Progress, in_folder, is_picture, open_clip, plays
from physgen.percepts.pixels import channels, load, opened
from physgen.problems import InputError, Place, Problem, Severity

U8 = NDArray[np.uint8]
F32 = NDArray[np.float32]

FEW = 32
"""Code up to which the brightest of 8-bit masks is a number of objects: as coverage hardly any would be seen."""
TINTED = 32
"""Codes by which the channels of a video of grey masks may differ: what compression does to colours."""


@dataclass(frozen=True)
class Coverage:
    """Where objects are."""

    path: Path
    frames: Sequence[F32]
    """(H, W) of each frame, 0..1."""
    meaning: str
    """How the numbers were read: `coverage`, `ids`, or both words."""
    remarks: tuple[Problem, ...]


@dataclass(frozen=True)
class _Mask:
    """A mask as it was saved."""

    values: U8
    """(H, W): coverage in 255ths; of ids 255 where there is one, 0 elsewhere."""
    ids: bool


def open_coverage(path: Path, clip: Clip, progress: Progress = lambda stage, done, total: None) -> Coverage:
    """Masks for every frame of `clip`: a folder with a picture a frame, a video, or one picture for all frames.

    Each is read once to be checked. Raises InputError for the first that does not fit.
    """
    count = len(clip.frames)
    if path.is_dir():
        pictures = in_folder(path)
        _count(path, len(pictures), count, "name the picture itself to use one for all frames")
        return _of_pictures(path, pictures, clip, progress)
    if is_picture(path) and not plays(path):
        one = _of_pictures(path, [path], clip, progress)
        return Coverage(path, [one.frames[0]] * count, one.meaning, one.remarks)
    film = open_clip(path, progress)
    _count(path, len(film.frames), count, "give one mask a frame")
    _fits(str(path), film.size, clip.size)
    bright = 0
    for k, rgb in enumerate(film.frames):
        if int((rgb.max(axis=2) - rgb.min(axis=2)).max()) > TINTED:
            fix = "save masks in grey, white where objects are, or ids as a folder of PNG"
            raise InputError.of(f"{path}: frame {k}", "", "is in colour", fix)
        bright = max(bright, int(rgb.max()))
        progress("read masks", k + 1, count)

    def masks() -> Iterator[F32]:
        return (
            _as_large(np.asarray(cv2.cvtColor(rgb, cv2.COLOR_RGB2GRAY), np.uint8), clip.size)
            for rgb in film.frames
        )

    return Coverage(path, Decoded(path, masks, count), "coverage", _remarks(path, bright, False))


def _of_pictures(path: Path, pictures: Sequence[Path], clip: Clip, progress: Progress) -> Coverage:
    bright, kinds = 0, set()
    for k, picture in enumerate(pictures):
        mask = _read(picture)
        _fits(str(picture), mask.values.shape[::-1], clip.size)
        kinds.add("ids" if mask.ids else "coverage")
        bright = max(bright, int(mask.values.max()))
        progress("read masks", k + 1, len(pictures))
    few = kinds == {"coverage"} and 0 < bright <= FEW

    def masks() -> Iterator[F32]:
        for picture in pictures:
            values = _read(picture).values
            yield _as_large(np.where(values > 0, np.uint8(255), np.uint8(0)) if few else values, clip.size)

    meaning = "ids" if few else " and ".join(sorted(kinds))
    return Coverage(path, Decoded(path, masks, len(pictures)), meaning, _remarks(path, bright, few))


def _remarks(path: Path, bright: int, few: bool) -> tuple[Problem, ...]:
    warn: Callable[[str, str], Problem] = partial(
        Problem, Place(str(path)), "", "", severity=Severity.WARNING
    )
    if not bright:
        return (warn("covers nothing", "no object is held"),)
    if few:
        fix = "anything but 0 is taken for an object; coverage goes up to 255"
        return (warn(f"is nowhere brighter than {bright}, so its numbers are taken for ids", fix),)
    return ()


def _count(path: Path, found: int, expected: int, fix: str) -> None:
    if found != expected:
        masks = f"{found} mask{'s' * (found != 1)}"
        what = f"for {expected} frame{'s' * (expected != 1)}"
        raise InputError.of(str(path), masks, what, fix)


def _fits(place: str, size: tuple[int, ...], video: tuple[int, int]) -> None:
    """A video of 4:2:0 has even sides, those of what was filmed may be one less: the last column is there twice."""
    if any(of - side not in (0, 1 - of % 2) for side, of in zip(size, video, strict=True)):
        found, expected = f"{size[0]} x {size[1]} px", f"differs from the video's {video[0]} x {video[1]} px"
        raise InputError.of(place, found, expected, "make masks the video's size")


def _as_large(values: U8, size: tuple[int, int]) -> F32:
    """0..1, with the last column and row there twice where they are in the video."""
    below, right = size[1] - values.shape[0], size[0] - values.shape[1]
    if below or right:
        values = np.pad(values, ((0, below), (0, right)), mode="edge")
    return values.astype(np.float32) / np.float32(255)


def _read(path: Path) -> _Mask:
    """One mask. Raises InputError."""
    with opened(path) as image:
        jpeg = image.format in ("JPEG", "MPO")
        if image.mode == "P":
            load(image, path)
            colours = np.asarray(image.convert("RGB"))
            if _grey(colours):  # a program that saves space has made a palette of greys
                return _Mask(np.ascontiguousarray(colours[..., 0]), False)
            return _objects(np.asarray(image))
    raw = channels(path)
    if raw.dtype == np.uint16:
        return _objects(raw if raw.ndim == 2 else raw[..., : 1 if raw.shape[2] == 2 else 3])
    values = raw.astype(np.uint8, copy=False)
    if values.ndim == 2:
        return _Mask(values, False)
    if values.shape[2] in (2, 4) and (values[..., -1] < 255).any():
        return _Mask(np.ascontiguousarray(values[..., -1]), False)
    if values.shape[2] == 2 or _grey(values[..., :3]):
        return _Mask(np.ascontiguousarray(values[..., 0]), False)
    if jpeg:
        fix = "save it as PNG, or in grey"
        raise InputError.of(str(path), "", "is a JPEG in colour, whose compression changes ids", fix)
    return _objects(values[..., :3])


def _grey(rgb: U8) -> bool:
    return np.array_equal(rgb[..., 0], rgb[..., 1]) and np.array_equal(rgb[..., 0], rgb[..., 2])


def _objects(ids: NDArray[np.uint8] | NDArray[np.uint16]) -> _Mask:
    """Ids (H, W), or colours (H, W, 3)."""
    there = ids > 0 if ids.ndim == 2 else np.any(ids > 0, axis=2)
    return _Mask(np.where(there, np.uint8(255), np.uint8(0)), True)
