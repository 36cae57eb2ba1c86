"""Cached unrefined frames, without loss: PNG of their differences from the first, in memory and on disk."""

from __future__ import annotations

import io
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.pipeline.cache import Store
from physgen.simulate.trajectory import Trajectory, read_trajectory

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

    def to_bytes(self) -> bytes:
        """For the cache: an archive of the files, one after the other, their lengths, and the motion."""
        buffer = io.BytesIO()
        motion = np.frombuffer(self.trajectory.to_bytes(), np.uint8)
        lengths = np.array([[len(file) for file in row] for row in self.files])
        files = np.concatenate([file for row in self.files for file in row])
        np.savez(buffer, motion=motion, lengths=lengths, files=files)
        return buffer.getvalue()

    @classmethod
    def from_bytes(cls, data: memoryview) -> Footage:
        """The inverse of `to_bytes`."""
        with np.load(io.BytesIO(data), allow_pickle=False) as stored:
            lengths, motion = stored["lengths"], io.BytesIO(stored["motion"].tobytes())
            files = np.split(stored["files"], np.cumsum(lengths)[:-1])
        return cls([files[k : k + 3] for k in range(0, len(files), 3)], read_trajectory(motion))


def footage(
    store: Store | None,
    key: str,
    film: Callable[[Add], Trajectory],
    unchanged: Callable[[], bool] = lambda: True,
) -> Footage:
    """The unrefined clip of a key: from the store, or else filmed now and stored.

    `film` adds all frames and returns their motion. What was filmed is not stored where its inputs are no longer
    `unchanged`: the key may then describe other inputs.
    """
    if store is not None and (data := store.read(key)) is not None:
        return Footage.from_bytes(data)
    files: list[list[U8]] = []
    first: list[U8] = []

    def add(rgb: U8, coverage: F32, ids: U16) -> None:
        rgb = rgb - first[0] if first else rgb
        first.extend([] if first else [rgb.copy()])
        steps = np.rint(np.clip(coverage, 0, 1) * np.float32(255)).astype(np.uint8)
        files.append([_png(np.ascontiguousarray(picture)) for picture in (rgb, steps, ids)])

    made = Footage(files, film(add))
    if store is not None and unchanged():
        store.write(key, made.to_bytes())
    return made


def _png(picture: U8 | U16) -> U8:
    """A file whose channels stand in the order of the picture's."""
    return np.asarray(cv2.imencode(".png", picture, [cv2.IMWRITE_PNG_COMPRESSION, 1])[1])
