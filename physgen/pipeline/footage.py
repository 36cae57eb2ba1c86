"""Cached unrefined frames.

A frame is stored as its difference from the first where that is mostly 0, else as the difference of each pixel from its
left neighbour; deflated and lossless.
"""

from __future__ import annotations

import io
import json
import zlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, Generic, TypeVar

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
SAME = 0.5
"""Share of a picture that must equal the first for the difference from it to be stored."""


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

    size: tuple[int, int]
    """(H, W) px."""
    blobs: Sequence[tuple[bytes | memoryview, ...]]
    """Deflated picture, coverage and ids of each frame."""
    still: list[bool]
    """Which pictures are differences from the first."""
    trajectory: Trajectory

    @property
    def rgb(self) -> Frames[U8]:
        """(H, W, 3) sRGB each."""
        return Frames(self._rgb, len(self.blobs))

    @property
    def coverage(self) -> Frames[F32]:
        """(H, W) each, of objects: 0..1, in steps of 1/255."""
        return Frames(self._coverage, len(self.blobs))

    @property
    def ids(self) -> Frames[U16]:
        """(H, W) each: body k shows as k + 1, 0 = background."""
        return Frames(self._ids, len(self.blobs))

    def _decoded(self, frame: int, part: int) -> U8:
        return np.frombuffer(bytearray(zlib.decompress(self.blobs[frame][part])), np.uint8)

    def _rgb(self, frame: int) -> U8:
        picture = self._decoded(frame, 0).reshape(*self.size, 3)
        if self.still[frame]:
            return self._rgb(0) + picture
        return np.cumsum(picture, axis=1, dtype=np.uint8)

    def _coverage(self, frame: int) -> F32:
        steps = self._decoded(frame, 1).reshape(self.size).astype(np.float32)
        return np.asarray(steps / np.float32(255), np.float32)

    def _ids(self, frame: int) -> U16:
        return self._decoded(frame, 2).view("<u2").reshape(self.size).astype(np.uint16, copy=False)

    def parts(self) -> list[bytes | memoryview]:
        """For the cache: a header in JSON with its length, the motion, and the blobs as they are."""
        motion = self.trajectory.to_bytes()
        lengths = [[len(blob) for blob in row] for row in self.blobs]
        about = {"size": self.size, "still": self.still, "lengths": lengths, "motion": len(motion)}
        head = json.dumps(about).encode()
        return [len(head).to_bytes(8, "big"), head, motion, *(blob for row in self.blobs for blob in row)]

    @classmethod
    def from_parts(cls, data: memoryview) -> Footage:
        """The inverse of `parts`, joined. Raises ValueError or KeyError for other data."""
        at = 8 + int.from_bytes(data[:8], "big")
        head = json.loads(bytes(data[8:at]))
        motion = read_trajectory(io.BytesIO(data[at : at + head["motion"]]))
        at += head["motion"]
        blobs: list[tuple[bytes | memoryview, ...]] = []
        for row in head["lengths"]:
            ends = [at, *(at + sum(row[: k + 1]) for k in range(len(row)))]
            blobs.append(tuple(data[a:b] for a, b in pairwise(ends)))
            at = ends[-1]
        height, width = head["size"]
        return cls((height, width), blobs, head["still"], motion)


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
        try:
            return Footage.from_parts(data)
        except (ValueError, KeyError):
            pass  # written by another version
    blobs: list[tuple[bytes | memoryview, ...]] = []
    still: list[bool] = []
    sizes: list[tuple[int, ...]] = []
    first: list[U8] = []

    def add(rgb: U8, coverage: F32, ids: U16) -> None:
        sizes.append(rgb.shape[:2])
        if not {rgb.shape[:2], coverage.shape, ids.shape} == {sizes[0]}:
            raise ValueError(f"frame {len(blobs)} of {rgb.shape[1]} x {rgb.shape[0]} px is of another size")
        if not first:
            first.append(rgb.copy())
        less = rgb - first[0]
        still.append(bool(blobs) and bool(np.count_nonzero(less) < (1 - SAME) * less.size))
        if not still[-1]:
            less = rgb.copy()
            less[:, 1:] -= rgb[:, :-1]
        steps = np.rint(np.clip(coverage, 0, 1) * np.float32(255)).astype(np.uint8)
        parts = (less, steps, ids.astype("<u2", copy=False))
        blobs.append(tuple(zlib.compress(np.ascontiguousarray(part).data, 1) for part in parts))

    trajectory = film(add)
    height, width = sizes[0] if sizes else (0, 0)
    made = Footage((height, width), blobs, still, trajectory)
    if store is not None and unchanged():
        store.write(key, made.parts())
    return made
