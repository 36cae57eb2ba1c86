"""Unrefined frames in memory, without loss: PNG of their differences from the first."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.simulate.trajectory import Trajectory

U8 = NDArray[np.uint8]
U16 = NDArray[np.uint16]
F32 = NDArray[np.float32]
A = TypeVar("A", bound=NDArray[Any])

Add = Callable[[U8, F32, U16], None]
"""Takes the next frame: (H, W, 3) sRGB; (H, W) coverage of objects, 0..1; (H, W) ids of bodies."""


class Frames(Sequence[A], Generic[A]):
    """Pictures that are decoded when they are asked for."""

    def __init__(self, read: Callable[[int], A], count: int) -> None:
        self._read, self._count = read, count

    def __len__(self) -> int:
        return self._count

    def __getitem__(self, index: int) -> A:  # type: ignore[override]  # no slices
        if not 0 <= index < self._count:
            raise IndexError(index)
        return self._read(index)


@dataclass(frozen=True)
class Footage:
    """A clip before it is refined, one frame a sample of its trajectory."""

    files: Sequence[Sequence[U8]]
    """Of each frame the PNG of its picture (all but the first as differences from it), its coverage and its ids."""
    trajectory: Trajectory

    @property
    def rgb(self) -> Frames[U8]:
        """(H, W, 3) sRGB each."""
        return Frames(lambda k: self._read(k, 0) + (self._read(0, 0) if k else np.uint8(0)), len(self.files))

    @property
    def coverage(self) -> Frames[F32]:
        """(H, W) each, of objects: 0..1, in steps of 1/255."""
        return Frames(lambda k: self._read(k, 1).astype(np.float32) / np.float32(255), len(self.files))

    @property
    def ids(self) -> Frames[U16]:
        """(H, W) each: body k shows as k + 1, 0 = background."""
        return Frames(lambda k: self._read(k, 2), len(self.files))

    def _read(self, frame: int, part: int) -> NDArray[Any]:
        return np.asarray(cv2.imdecode(self.files[frame][part], cv2.IMREAD_UNCHANGED))


def footage(film: Callable[[Add], Trajectory]) -> Footage:
    """The unrefined clip; `film` adds all frames and returns their motion."""
    files: list[list[U8]] = []
    first: list[U8] = []

    def add(rgb: U8, coverage: F32, ids: U16) -> None:
        rgb = rgb - first[0] if first else rgb
        first.extend([] if first else [rgb.copy()])
        steps = np.rint(np.clip(coverage, 0, 1) * np.float32(255)).astype(np.uint8)
        files.append([_png(np.ascontiguousarray(picture)) for picture in (rgb, steps, ids)])

    return Footage(files, film(add))


def _png(picture: U8 | U16) -> U8:
    """A file whose channels stand in the order of the picture's."""
    return np.asarray(cv2.imencode(".png", picture, [cv2.IMWRITE_PNG_COMPRESSION, 1])[1])
