"""The motion that a clip was made of, and what its scene moves like now -> the first sample and objects that differ."""

from __future__ import annotations

import zipfile
import zlib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from physgen.simulate.trajectory import Trajectory, read_trajectory

Array = NDArray[np.float64]

ROUNDING = 1e-6
"""px, rad, px/s and rad/s: less is how two machines round, or two orders of summing; nobody sees it."""


@dataclass(frozen=True)
class Apart:
    """How far an object is from where it was, at one sample."""

    object: str
    px: float
    rad: float
    """In the photo's plane, whole turns counted."""
    px_s: float
    """px/s: of its velocity."""
    rad_s: float
    turned: float
    """rad: of how a sphere has turned in space."""

    @property
    def rounding(self) -> bool:
        """No more than rounding."""
        return max(self.px, self.rad, self.px_s, self.rad_s, self.turned) < ROUNDING


@dataclass(frozen=True)
class Farthest:
    """Where an amount is the largest of the whole clip."""

    amount: float
    object: str
    sample: int
    time: float
    """s."""


@dataclass(frozen=True)
class Motion:
    """How two motions differ."""

    sample: int
    """The first that differs by more than rounding; where none does, the first that differs at all."""
    time: float
    """s."""
    objects: tuple[Apart, ...] = ()
    """Those that differ there, the farthest first; empty where the old motion is not known."""
    most_px: Farthest | None = None
    most_rad: Farthest | None = None
    rounding: tuple[int, float, tuple[str, ...]] | None = None
    """Before that: the first sample that differs by rounding, its time, and the objects."""
    gone: tuple[str, ...] = ()
    """Objects that are there no more."""
    new: tuple[str, ...] = ()
    samples: tuple[int, int] = (0, 0)
    """How many there were, and are."""
    retimed: bool = False
    """Samples are at other times now, from that one on: nothing can be compared there."""
    unnamed: str = ""
    """Why objects cannot be told."""


def stored_motion(path: Path, samples: Sequence[str]) -> Trajectory | None:
    """A clip's trajectory.npz, if it holds the `samples` of the manifest."""
    if not path.is_file():
        return None
    try:
        trajectory = read_trajectory(path)
        count, bodies = len(trajectory.times), len(trajectory.names)
        whole = (
            trajectory.poses.shape == trajectory.velocities.shape == (count, bodies, 3)
            and trajectory.turns.shape in ((count, 0, 4), (count, bodies, 4))
            and {a.dtype for a in (trajectory.poses, trajectory.velocities, trajectory.turns)}
            == {np.dtype(float)}
        )
        return trajectory if whole and trajectory.sample_hashes() == list(samples) else None
    except (
        OSError,
        ValueError,
        KeyError,
        TypeError,
        EOFError,
        zipfile.BadZipFile,
        zlib.error,
        AttributeError,
    ):
        return None


def apart(samples: Sequence[str], then: Trajectory | None, now: Trajectory) -> Motion | None:
    """None where the motion is the same; `samples` are the hashes of the old one, `then` itself, where it is known."""
    hashes = now.sample_hashes()
    counts = len(samples), len(hashes)
    first = next((k for k, (a, b) in enumerate(zip(samples, hashes, strict=False)) if a != b), None)
    if first is None and counts[0] != counts[1]:
        first = min(counts)
    if then is None:
        if first is None:
            return None
        why = "trajectory.npz does not hold the old motion"
        return Motion(first, _time(now, first), samples=counts, unnamed=why)
    shared = [name for name in then.names if name in now.names]
    table = _Table(then, now, shared)
    differs = table.differs
    if first is None and not differs.any():
        return None
    gone = tuple(name for name in then.names if name not in now.names)
    new = tuple(name for name in now.names if name not in then.names)
    rows = np.flatnonzero(differs.any(axis=1))
    if not len(rows):  # objects came or went, or the clip is longer, or sampled at other times
        at = first or 0
        return Motion(
            at, _time(now, at), gone=gone, new=new, samples=counts, retimed=at >= table.count < min(counts)
        )
    row, early = int(rows[0]), None
    large = table.largest >= ROUNDING
    if large.any():
        first_large = int(np.flatnonzero(large.any(axis=1))[0])
        if first_large > row:
            early = row, _time(now, row), tuple(shared[k] for k in np.flatnonzero(differs[row]))
        row, differs = first_large, large
    objects = [table.apart(row, int(k)) for k in np.flatnonzero(differs[row])]
    objects.sort(key=lambda item: (-item.px, -item.rad, -item.px_s, -item.rad_s, -item.turned, item.object))
    return Motion(
        sample=row,
        time=_time(now, row),
        objects=tuple(objects),
        most_px=table.farthest(table.px),
        most_rad=table.farthest(table.rad),
        rounding=early,
        gone=gone,
        new=new,
        samples=counts,
        retimed=table.count < min(counts),
    )


def _time(trajectory: Trajectory, sample: int) -> float:
    """s of a sample, the last one's where there is none."""
    times = trajectory.times
    return float(times[min(sample, len(times) - 1)]) if len(times) else 0.0


class _Table:
    """(T, N) each: how far the objects of both motions are apart, at the samples that both have."""

    def __init__(self, then: Trajectory, now: Trajectory, names: Sequence[str]) -> None:
        count = min(len(then.times), len(now.times))
        same = then.times[:count] == now.times[:count]
        count = self.count = count if same.all() else int(same.argmin())
        """Samples at the same times."""
        self.names, self._now = tuple(names), now
        old, new = ([t.names.index(name) for name in names] for t in (then, now))
        sides = ((then, old), (now, new))
        poses = [t.poses[:count, pick] for t, pick in sides]
        speeds = [t.velocities[:count, pick] for t, pick in sides]
        between, change = poses[1] - poses[0], speeds[1] - speeds[0]
        self.px = np.hypot(between[..., 0], between[..., 1])
        self.rad = np.abs(between[..., 2])
        self.px_s = np.hypot(change[..., 0], change[..., 1])
        self.rad_s = np.abs(change[..., 2])
        self.turned = np.zeros(self.px.shape)
        self.differs = _bits(*poses) | _bits(*speeds)
        if then.turns.shape[1] == len(then.names) and now.turns.shape[1] == len(now.names) and names:
            turns = [t.turns[:count, pick] for t, pick in sides]
            near, far = (np.linalg.norm(turns[1] - side * turns[0], axis=-1) for side in (1, -1))
            turning = _bits(*turns)
            self.turned = 4 * np.arcsin(np.clip(np.minimum(near, far) / 2, 0.0, 1.0))  # q and -q turn alike
            self.differs |= turning
        self.largest = np.max([self.px, self.rad, self.px_s, self.rad_s, self.turned], axis=0)

    def time(self, sample: int) -> float:
        """s."""
        return _time(self._now, sample)

    def apart(self, sample: int, k: int) -> Apart:
        """Of one object."""
        at = sample, k
        px, rad, px_s, rad_s, turned = (
            float(part[at]) for part in (self.px, self.rad, self.px_s, self.rad_s, self.turned)
        )
        return Apart(self.names[k], px, rad, px_s, rad_s, turned)

    def farthest(self, amounts: Array) -> Farthest | None:
        """None where it is nowhere above 0."""
        if not amounts.size or amounts.max() <= 0:
            return None
        sample, k = np.unravel_index(int(amounts.argmax()), amounts.shape)
        return Farthest(float(amounts.max()), self.names[int(k)], int(sample), self.time(int(sample)))


def _bits(one: Array, other: Array) -> NDArray[np.bool_]:
    """(T, N): whether any bit differs; what is equal as a number need not be."""
    differ = np.ascontiguousarray(one).view(np.int64) != np.ascontiguousarray(other).view(np.int64)
    return np.asarray(differ.any(axis=-1), np.bool_)
