"""Cached trajectories and unrefined frames."""

from __future__ import annotations

import json
import os
import zlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Generic, TypeVar, overload

import numpy as np
from numpy.typing import NDArray

from physgen.pipeline.cache import Filling, Store
from physgen.simulate.trajectory import Trajectory, read_trajectory

# ----------------------------------------------------------------------
# Unrefined frames in the order of the motion <-> an entry of the store, read frame by frame as they are asked
# for.
#
# All pictures lie in one file, each alone, so that any can be read at once and an entry that is open survives
# its
# removal. A frame is kept as what differs from the first where that is little, else as what differs from the
# pixel on the
# left; deflated, level 1. Nothing is lost.

U8 = NDArray[np.uint8]
U16 = NDArray[np.uint16]
F32 = NDArray[np.float32]
A = TypeVar("A", bound=NDArray[Any])

Add = Callable[[U8, U8 | F32, U16], None]
"""Takes the next frame: (H, W, 3) sRGB; (H, W) coverage of objects, 0..1 or 0..255; (H, W) ids of bodies."""
Film = Callable[[Add], tuple[Trajectory, Mapping[str, Any]]]
"""Makes all frames, and returns the motion that they show and whatever else is to be told of it, as JSON data."""

PICTURES, TABLE, MOTION = "pictures.bin", "footage.json", "trajectory.npz"
SAME = 0.5
"""Part of a picture that is as in the first from which on it is told by what differs."""


class Frames(Sequence[A], Generic[A]):
    """Pictures that are read when they are asked for; a slice, or another order, is a view."""

    def __init__(self, read: Callable[[int], A], order: Sequence[int]) -> None:
        self._read, self._order = read, order

    def __len__(self) -> int:
        return len(self._order)

    @overload
    def __getitem__(self, index: int) -> A: ...
    @overload
    def __getitem__(self, index: slice) -> Frames[A]: ...
    def __getitem__(self, index: int | slice) -> A | Frames[A]:
        if isinstance(index, slice):
            return Frames(self._read, self._order[index])
        return self._read(self._order[index])

    def shown(self, order: Sequence[int]) -> Frames[A]:
        """Those at `order`, one after the other, some perhaps twice: as a clip plays them."""
        return Frames(self._read, [self._order[index] for index in order])


@dataclass(frozen=True)
class Footage:
    """A clip before it is refined, one frame a sample of its trajectory."""

    rgb: Frames[U8]
    """(H, W, 3) sRGB each."""
    coverage: Frames[F32]
    """(H, W) each, of objects: 0..1, in steps of 1/255."""
    ids: Frames[U16]
    """(H, W) each: body k shows as k + 1, 0 = background."""
    trajectory: Trajectory
    said: Mapping[str, Any]
    """What the stages told when it was made."""
    kept: bool
    """It was not made now."""


class PictureFile:
    """Bytes one after the other in a file, or in memory where there is none, or no room in it."""

    def __init__(self, filling: Filling | None) -> None:
        self._filling, self._file, self._held, self._size = filling, -1, bytearray(), 0
        if filling is not None:
            try:
                self._file = os.open(filling.folder / PICTURES, os.O_CREAT | os.O_RDWR, 0o600)
            except OSError as error:
                filling.give_up(error)

    @classmethod
    def of(cls, path: Path) -> PictureFile:
        """One that was written. Raises OSError."""
        tape = cls(None)
        tape._file = os.open(path, os.O_RDONLY)
        return tape

    def append(self, data: bytes) -> int:
        """Where it went."""
        start, done = self._size, 0
        while self._file >= 0 and done < len(data):
            try:
                done += os.pwrite(self._file, data[done:], start + done)
            except OSError as error:
                self._into_memory(error)
        if self._file < 0:
            self._held += data
        self._size += len(data)
        return start

    def read(self, start: int, size: int) -> bytes:
        """`size` bytes from `start` on."""
        if self._file < 0:
            return bytes(self._held[start : start + size])
        return os.pread(self._file, size, start)

    def close(self) -> None:
        """Nothing is read any more."""
        if self._file >= 0:
            os.close(self._file)
            self._file = -1

    def _into_memory(self, error: OSError) -> None:
        self._held = bytearray(self.read(0, self._size))
        self.close()
        if self._filling is not None:
            self._filling.give_up(error)


class Recorder:
    """Frames -> a tape and where on it they lie."""

    def __init__(self, filling: Filling | None) -> None:
        self.tape, self.table = PictureFile(filling), Table((0, 0), [])
        self._filling = filling

    def add(self, rgb: U8, coverage: U8 | F32, ids: U16) -> None:
        """The next frame; see `Add`. Raises ValueError where it is not as large as those before."""
        table, (H, W) = self.table, ids.shape
        if not table.rows:
            self._first, self.table = rgb.copy(), (table := Table((H, W), []))
        if rgb.shape != (*table.size, 3) or coverage.shape != table.size or ids.shape != table.size:
            raise ValueError(
                f"frame {len(table.rows)} of {rgb.shape[1]} x {rgb.shape[0]} px is of another size"
            )
        less = rgb - self._first
        still = bool(table.rows) and bool(np.count_nonzero(less) < (1 - SAME) * less.size)
        parts = (less if still else _sloped(rgb), _stepped(coverage), ids.astype("<u2", copy=False))
        blobs = [zlib.compress(np.ascontiguousarray(part).data, 1) for part in parts]
        places = [(self.tape.append(blob), len(blob)) for blob in blobs]
        table.rows.append((places[0], places[1], places[2], still))

    def footage(self, trajectory: Trajectory, said: Mapping[str, Any]) -> Footage:
        """What was recorded; its other files are written, too."""
        text = json.dumps({"size": self.table.size, "rows": self.table.rows, "said": said})
        filling = self._filling
        if filling is not None and filling.kept:
            try:
                trajectory.save(filling.folder / MOTION)
                (filling.folder / TABLE).write_text(text, encoding="utf-8")
            except OSError as error:
                filling.give_up(error)
        return _shown(self.tape, self.table, trajectory, json.loads(text)["said"], False)


Place = tuple[int, int]
"""Start and count of bytes."""


@dataclass(frozen=True)
class Table:
    """Where frames of a size (H, W) lie: rgb, coverage, ids, and whether rgb is told by the first frame."""

    size: tuple[int, int]
    rows: list[tuple[Place, Place, Place, bool]]


@contextmanager
def footage(
    store: Store | None, key: str, film: Film, sound: Callable[[], bool] = lambda: True
) -> Iterator[Footage]:
    """The clip of a key, to be used within the block: from the store, or else filmed now, and kept for the next time.

    Without a store, or where it cannot be written, it is filmed and held in memory, deflated. It is not kept where it
    is not `sound` when it is filmed: what it was made of may be something else than the key says.
    """
    with ExitStack() as held:
        folder = None if store is None else held.enter_context(store.find(key))
        found = None if folder is None else _opened(folder, held)
        if found is None:
            with store.fill(key) if store is not None else nullcontext() as filling:
                recorder = Recorder(filling)
                held.callback(recorder.tape.close)
                made = film(recorder.add)
                if filling is not None and filling.kept and not sound():
                    filling.drop()  # the tape is open, and can be read
                found = recorder.footage(*made)
        yield found


def _opened(folder: Path, held: ExitStack) -> Footage | None:
    """An entry of the store; None where it is none."""
    try:
        text = json.loads((folder / TABLE).read_bytes())
        rows = [(*(tuple(place) for place in row[:3]), row[3]) for row in text["rows"]]
        table = Table((text["size"][0], text["size"][1]), rows)
        trajectory = read_trajectory(folder / MOTION)
        tape = PictureFile.of(folder / PICTURES)
    except (OSError, ValueError, KeyError, TypeError, IndexError):
        return None
    held.callback(tape.close)
    return _shown(tape, table, trajectory, text["said"], True)


def _shown(
    tape: PictureFile, table: Table, trajectory: Trajectory, said: Mapping[str, Any], kept: bool
) -> Footage:
    H, W = table.size
    first: list[U8] = []

    def pixels(place: Place) -> U8:
        return np.frombuffer(bytearray(zlib.decompress(tape.read(*place))), np.uint8)

    def rgb(index: int) -> U8:
        place, _, _, still = table.rows[index]
        if not still:
            return _summed(pixels(place).reshape(H, W, 3))
        if not first:
            first.append(rgb(0))
        return first[0] + pixels(place).reshape(H, W, 3)

    def coverage(index: int) -> F32:
        return pixels(table.rows[index][1]).reshape(H, W).astype(np.float32) / np.float32(255)

    def ids(index: int) -> U16:
        return pixels(table.rows[index][2]).view("<u2").reshape(H, W).astype(np.uint16, copy=False)

    every = range(len(table.rows))
    return Footage(Frames(rgb, every), Frames(coverage, every), Frames(ids, every), trajectory, said, kept)


def _stepped(coverage: U8 | F32) -> U8:
    """0..1 as 0..255."""
    if coverage.dtype == np.uint8:
        return coverage.astype(np.uint8, copy=False)
    steps: U8 = np.rint(np.clip(coverage.astype(np.float32), 0, 1) * np.float32(255)).astype(np.uint8)
    return steps


def _sloped(rgb: U8) -> U8:
    """What each pixel (H, W, 3) adds to the one on its left, modulo 256."""
    slope = rgb.copy()
    slope[:, 1:] -= rgb[:, :-1]
    return slope


def _summed(slope: U8) -> U8:
    """The inverse of `_sloped`."""
    rgb: U8 = np.cumsum(slope, axis=1, dtype=np.uint8)
    return rgb


# ----------------------------------------------------------------------
# Motions <-> entries of the store, one file each.

MOTION_FILE = "trajectory.npz"


def load_motion(store: Store | None, key: str) -> Trajectory | None:
    """The motion of a key; None where it is not kept."""
    if store is None:
        return None
    with store.find(key) as folder:
        if folder is None:
            return None
        try:
            return read_trajectory(folder / MOTION_FILE)
        except (OSError, ValueError, KeyError, TypeError):
            return None


def save_motion(store: Store | None, key: str, motion: Trajectory) -> None:
    """For the next time; where it cannot be written, the user is told, and nobody fails."""
    if store is None:
        return
    with store.fill(key) as filling:
        if filling is not None:
            try:
                motion.save(filling.folder / MOTION_FILE)
            except OSError as error:
                filling.give_up(error)
