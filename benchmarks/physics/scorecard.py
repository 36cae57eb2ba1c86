"""What the rows are made of: seeded draws of parameters, and readable access to the motion of a body."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from physgen.compile.world import Body, World
from physgen.evaluate import physics
from physgen.evaluate.physics import DRAWS, Document, Errors, Measure, Unit
from physgen.simulate.trajectory import Trajectory

__all__ = ["Array", "Case", "Document", "Draw", "Errors", "Measure", "Row", "Run", "Track", "Unit", "worst"]

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Track:
    """Motion of one body at T times."""

    times: Array
    """(T,) s."""
    poses: Array
    """(T, 3): x px, y px, angle rad since t = 0."""
    velocities: Array
    """(T, 3): px/s, px/s, rad/s."""

    @property
    def x(self) -> Array:
        return self.poses[:, 0]

    @property
    def y(self) -> Array:
        return self.poses[:, 1]

    @property
    def angle(self) -> Array:
        return self.poses[:, 2]

    @property
    def at(self) -> Array:
        return self.poses[:, :2]

    @property
    def moved(self) -> Array:
        """(T, 2) px since t = 0."""
        return self.poses[:, :2] - self.poses[0, :2]

    @property
    def velocity(self) -> Array:
        return self.velocities[:, :2]

    @property
    def speed(self) -> Array:
        return np.asarray(np.hypot(*self.velocity.T))

    @property
    def spin(self) -> Array:
        return self.velocities[:, 2]

    def sample(self, time: float) -> int:
        """Index of the last sample that is not after `time` (s)."""
        return int(np.searchsorted(self.times, time + 1e-9, side="right")) - 1


@dataclass(frozen=True)
class Run:
    """A world and its motion, by any engine that simulated this world."""

    world: World
    trajectory: Trajectory

    def track(self, name: str) -> Track:
        """Motion of one object."""
        k = self.trajectory.names.index(name)
        return Track(self.trajectory.times, self.trajectory.poses[:, k], self.trajectory.velocities[:, k])

    def body(self, name: str) -> Body:
        """Mass, moment and shape of one object."""
        return next(body for body in self.world.bodies if body.name == name)

    def impulse(self, on: str, of: str, begin: float, end: float) -> Array:
        """(2,) g·px/s that `of` gave `on` after the sample at `begin` up to the one at `end` (s)."""
        contacts, times = self.trajectory.contacts, self.trajectory.times
        a, b = contacts.surfaces.index(on), contacts.surfaces.index(of)
        rows, given = contacts.impulse_rows, contacts.impulses
        inside = (times[rows[:, 0]] > begin + 1e-9) & (times[rows[:, 0]] < end + 1e-9)
        first = inside & (rows[:, 1] == a) & (rows[:, 2] == b)
        second = inside & (rows[:, 1] == b) & (rows[:, 2] == a)
        return np.asarray(given[first].sum(axis=0) - given[second].sum(axis=0), np.float64)


class Draw:
    """One seeded draw of a row's parameters, rounded so that the scene file shows them in full.

    `index` selects among a row's named cases; more draws than five go through them again.
    """

    def __init__(self, row: int, index: int) -> None:
        self.index = index % DRAWS
        self._rng = np.random.default_rng((20241, row, index))

    def number(self, low: float, high: float, digits: int = 2) -> float:
        return round(float(self._rng.uniform(low, high)), digits)

    def count(self, low: int, high: int) -> int:
        return int(self._rng.integers(low, high + 1))

    def sign(self) -> int:
        return 1 if self._rng.random() < 0.5 else -1

    def angle(self) -> float:
        """rad; a whole number of degrees."""
        return float(np.radians(int(self._rng.integers(0, 360))))

    def mass(self) -> float:
        """20 to 500 g."""
        return self.number(20, 500, 0)


def worst(errors: Sequence[float]) -> float:
    """The largest; NaN where any is NaN."""
    return float(np.max(errors))


def Case(  # noqa: N802 (reads as the class that it builds)
    scene: Document,
    measure: Callable[..., Errors],
    label: str = "",
    variants: tuple[str | None, ...] = (None,),
    rate: float = 240.0,
) -> physics.Case:
    """A case whose measure gets a `Run` of this module for each variant."""
    return physics.Case(scene, lambda *runs: measure(*(Run(*run) for run in runs)), label, variants, rate)


def Row(  # noqa: N802
    number: int,
    name: str,
    title: str,
    closed_form: str,
    ranges: str,
    why: str,
    measures: tuple[Measure, ...],
    cases: Callable[[Draw], Sequence[physics.Case]],
) -> physics.Row:
    """A row whose cases are built from a `Draw`."""

    def draw(index: int) -> Sequence[physics.Case]:
        return cases(Draw(number, index))

    return physics.Row(number, name, title, closed_form, ranges, why, measures, draw)
