"""Trajectory -> places, angles and, where asked for, velocities as whole numbers of a unit far below the tolerance."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from math import floor, log10, radians

import numpy as np
from numpy.typing import NDArray

from physgen.golden.asking import Motion
from physgen.simulate.trajectory import Trajectory

Array = NDArray[np.float64]
Whole = NDArray[np.int64]

MOST_POSES = 10_000
"""Samples times objects that are kept; of a longer clip or a larger heap, fewer samples are, evenly spread."""
FEWEST = 12
"""Samples that are kept of any clip that has them."""
LATE = 1e-9
"""s: how times may be rounded."""


@dataclass(frozen=True)
class Units:
    """What 1 stands for in a `Track`."""

    px: float
    degrees: float
    px_per_s: float | None
    """None: velocities are not kept."""
    degrees_per_s: float | None

    @property
    def pose(self) -> Array:
        """(3,) px, px, degrees."""
        return np.array([self.px, self.px, self.degrees])

    @property
    def turn(self) -> float:
        """Of a quaternion's parts: a turn by an angle changes them by half of it, in rad, at most."""
        return decade(radians(self.degrees))

    @property
    def velocity(self) -> Array | None:
        """(3,) px/s, px/s, degrees/s; what is not kept counts as 1."""
        if self.px_per_s is None and self.degrees_per_s is None:
            return None
        return np.array([self.px_per_s or 1.0, self.px_per_s or 1.0, self.degrees_per_s or 1.0])


def decade(amount: float) -> float:
    """The power of ten that is a tenth of an amount, or up to ten times less.

    >>> decade(0.1), decade(0.05), decade(1e-6)
    (0.01, 0.001, 1e-07)
    """
    return float(f"1e{floor(log10(amount) + 1e-9) - 1}")


def units(allowed: Motion) -> Units:
    """Such that rounding is at most a twentieth of what is allowed."""
    speed, spin = allowed.px_per_s, allowed.degrees_per_s
    return Units(
        decade(allowed.px),
        decade(allowed.degrees),
        None if speed is None else decade(speed),
        None if spin is None else decade(spin),
    )


@dataclass(frozen=True)
class Track:
    """How N objects move, at T samples."""

    names: tuple[str, ...]
    samples: Whole
    """(T,): which of the clip's."""
    times: Array
    """(T,) s."""
    units: Units
    poses: Whole
    """(T, N, 3) units of px, px, degrees: of the centre of mass, image axes."""
    turns: Whole
    """(T, N, 4): quaternions, see `Trajectory.turns`; (T, 0, 4) without."""
    velocities: Whole | None
    """(T, N, 3) units of px/s, px/s, degrees/s."""

    @cached_property
    def places(self) -> Array:
        """(T, N, 2) px."""
        return np.asarray(self.poses[..., :2] * self.units.px)


def kept_samples(times: Array, bodies: int, until: float | None) -> Whole:
    """Which samples of a clip at `times` (T,) s are kept."""
    count = len(times) if until is None else int(np.searchsorted(times, until + LATE, side="right"))
    most = max(FEWEST, MOST_POSES // max(bodies, 1))
    return np.unique(np.linspace(0, count - 1, min(count, most)).round().astype(np.int64))


def track(trajectory: Trajectory, of: Units, until: float | None) -> Track:
    """The clip's motion, up to a time if one is given, in units."""
    picked = kept_samples(trajectory.times, len(trajectory.names), until)
    poses, velocities = (_in_degrees(part[picked]) for part in (trajectory.poses, trajectory.velocities))
    return Track(
        names=trajectory.names,
        samples=picked,
        times=trajectory.times[picked],
        units=of,
        poses=_whole(poses, of.pose),
        turns=_whole(trajectory.turns[picked], of.turn),
        velocities=None if of.velocity is None else _whole(velocities, of.velocity),
    )


def _in_degrees(values: Array) -> Array:
    """(..., 3) with its angles, the last of three, in degrees."""
    return np.asarray(values * np.array([1.0, 1.0, 180 / np.pi]))


def _whole(values: Array, unit: Array | float) -> Whole:
    return np.asarray(np.rint(values / unit).astype(np.int64))
