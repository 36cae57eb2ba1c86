"""Motions of one object under pushes -> what each push did, against the motion without one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import atan2, degrees, hypot

import numpy as np
from numpy.typing import NDArray

from physgen.simulate.trajectory import Trajectory, new_touches

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Path:
    """Where one object went."""

    times: Array
    """(T,) s."""
    places: Array
    """(T, 2) px: its centre of mass."""
    free: int
    """Samples, from the first on, before it met anybody whom it did not touch from the start."""


def path_of(trajectory: Trajectory, name: str) -> Path:
    """Raises ValueError where the trajectory has no such object."""
    body = trajectory.names.index(name)
    mine = new_touches(trajectory) & (trajectory.contacts.touch_pairs == body).any(axis=1)
    first = float(trajectory.contacts.touch_times[mine, 0].min(initial=np.inf))
    free = int(np.searchsorted(trajectory.times, first, side="right"))
    return Path(trajectory.times, trajectory.poses[:, body, :2], free)


@dataclass(frozen=True)
class Push:
    """The speed that an impulse gives: impulse over mass."""

    x: float
    """px/s."""
    y: float
    """px/s, down."""

    @property
    def size(self) -> float:
        """px/s."""
        return hypot(self.x, self.y)

    @property
    def angle(self) -> float:
        """degrees in [0, 360): 0 to the right, 90 down, as in scenes."""
        return round(degrees(atan2(self.y, self.x)), 6) % 360


@dataclass(frozen=True)
class Outcome:
    """One push and what it did."""

    push: Push
    path: Path
    response: Array
    """(2,) px at the end: from where it would have been without a push."""
    at_first: Array
    """(2,) px: the same at the last sample before it met anybody, at the end where it met nobody."""
    moved: float
    """px from where it began."""

    @property
    def met(self) -> bool:
        """Whether it met anybody."""
        return self.path.free < len(self.path.times)

    @property
    def length(self) -> float:
        """px of the response."""
        return float(np.hypot(*self.response))


def outcome(push: Push, path: Path, still: Path | None) -> Outcome:
    """`still` is the path without a push, at the same times; None: nobody knows, and it is taken to stay."""
    before = path.places[0] if still is None else still.places
    off = path.places - before
    return Outcome(
        push, path, off[-1], off[max(path.free - 1, 0)], float(np.hypot(*(path.places[-1] - path.places[0])))
    )


def between(one: Array | Sequence[float], other: Array | Sequence[float]) -> float:
    """degrees between two directions, 0..180.

    >>> between((1, 0), (0, -2))
    90.0
    """
    (a, b), (c, d) = one, other
    return abs(degrees(atan2(a * d - b * c, a * c + b * d)))
