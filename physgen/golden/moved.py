"""The motion that is kept, and the motion now -> which objects stray farther than allowed, when, and how far."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from physgen.golden.asking import Motion
from physgen.golden.tracks import LATE, Track, Units, track
from physgen.simulate.trajectory import Trajectory

Array = NDArray[np.float64]

MEASURES = {"px": " px", "degrees": "°", "px_per_s": " px/s", "degrees_per_s": "°/s"}
"""What of a `Motion` is compared, and its unit as it is written behind a number."""
SLACK = 1 + 1e-9
"""Of what is allowed: 30 units of 0.01 are 0.3."""


@dataclass(frozen=True)
class Strayed:
    """An object that is not where it was."""

    name: str
    sample: int
    """The first at which it is farther away than allowed."""
    time: float
    """s."""
    there: Mapping[str, float]
    """How far it is then, by measure."""
    most: Mapping[str, tuple[float, float]]
    """How far it is at most, and when, s."""


@dataclass(frozen=True)
class Moved:
    """How two motions compare, at the samples and for the objects that both have."""

    allowed: Motion
    then: Track
    now: Track
    """In the units of `then`."""
    names: tuple[str, ...]
    samples: NDArray[np.int64]
    """(T,)."""
    times: Array
    """(T,) s."""
    apart: Mapping[str, Array]
    """(T, N) each, by measure."""

    @cached_property
    def gone(self) -> tuple[str, ...]:
        """Objects that are there no more."""
        return tuple(name for name in self.then.names if name not in self.names)

    @cached_property
    def new(self) -> tuple[str, ...]:
        """Objects that were not there."""
        return tuple(name for name in self.now.names if name not in self.names)

    @property
    def retimed(self) -> bool:
        """Whether the clip is longer or shorter, or sampled at other times."""
        return not len(self.then.times) == len(self.times) == len(self.now.times)

    @cached_property
    def excess(self) -> Array:
        """(T, N): the largest of what is apart, as a multiple of what is allowed."""
        shares = [apart / getattr(self.allowed, name) for name, apart in self.apart.items()]
        return np.asarray(np.max(shares, axis=0))

    @cached_property
    def strayed(self) -> tuple[Strayed, ...]:
        """The first to stray first; of those that do at the same sample, the farthest."""
        beyond = self.excess > SLACK
        found = []
        for k in np.flatnonzero(beyond.any(axis=0)).tolist():
            row = int(beyond[:, k].argmax())
            tops = {name: int(apart[:, k].argmax()) for name, apart in self.apart.items()}
            strayed = Strayed(
                self.names[k],
                int(self.samples[row]),
                float(self.times[row]),
                {name: float(apart[row, k]) for name, apart in self.apart.items()},
                {
                    name: (float(self.apart[name][top, k]), float(self.times[top]))
                    for name, top in tops.items()
                },
            )
            found.append((row, -self.excess[row, k], strayed))
        return tuple(item for *_, item in sorted(found, key=lambda row: row[:2]))

    @property
    def agrees(self) -> bool:
        """Whether nothing differs by more than is allowed."""
        return not (self.strayed or self.gone or self.new or self.retimed)

    def most(self, measure: str) -> float:
        """The largest of the whole clip."""
        apart = self.apart[measure]
        return float(apart.max()) if apart.size else 0.0


def moved(then: Track, trajectory: Trajectory, allowed: Motion, until: float | None) -> Moved:
    """Compare; `then` is fine enough, see `too_coarse`."""
    now = track(trajectory, then.units, until)
    names = tuple(name for name in then.names if name in now.names)
    old, new = ([t.names.index(name) for name in names] for t in (then, now))
    _, one, other = np.intersect1d(then.samples, now.samples, return_indices=True)
    alike = np.abs(then.times[one] - now.times[other]) <= LATE
    one, other = one[alike], other[alike]
    poses = now.poses[other][:, new] - then.poses[one][:, old]
    apart = {
        "px": np.hypot(poses[..., 0], poses[..., 1]) * then.units.px,
        "degrees": np.abs(poses[..., 2]) * then.units.degrees,
    }
    if then.turns.shape[1] and now.turns.shape[1]:
        turned = _turned(then.turns[one][:, old], now.turns[other][:, new], then.units.turn)
        apart["degrees"] = np.maximum(apart["degrees"], turned)
    if then.velocities is not None and now.velocities is not None:
        change = now.velocities[other][:, new] - then.velocities[one][:, old]
        if allowed.px_per_s is not None and then.units.px_per_s is not None:
            apart["px_per_s"] = np.hypot(change[..., 0], change[..., 1]) * then.units.px_per_s
        if allowed.degrees_per_s is not None and then.units.degrees_per_s is not None:
            apart["degrees_per_s"] = np.abs(change[..., 2]) * then.units.degrees_per_s
    return Moved(allowed, then, now, names, then.samples[one], then.times[one], apart)


def too_coarse(of: Units, allowed: Motion) -> str:
    """Why a motion kept in these units cannot be compared as closely as is asked; nothing where it can."""
    for name, unit in MEASURES.items():
        asked, kept = getattr(allowed, name), getattr(of, name)
        if asked is not None and kept is None:
            return f"velocities are not kept, and {asked:g}{unit} are asked for"
        if asked is not None and kept > asked * SLACK:
            return f"it is kept to {kept:g}{unit} only, and {asked:g}{unit} are asked for"
    return ""


def _turned(then: NDArray[np.int64], now: NDArray[np.int64], unit: float) -> Array:
    """Degrees between quaternions (..., 4) in a unit; q and -q are the same turn."""
    near = np.minimum(np.linalg.norm(now - then, axis=-1), np.linalg.norm(now + then, axis=-1)) * unit
    return np.asarray(np.degrees(4 * np.arcsin(np.clip(near / 2, 0.0, 1.0))))
