"""What a row of the physics scorecard is: scenes drawn at random, a closed form, and the error that it allows."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from enum import Enum
from typing import Any

import numpy as np

from physgen.compile.world import Body, World
from physgen.evaluate.track import Track
from physgen.simulate.trajectory import Trajectory

Document = dict[str, Any]
"""A scene as plain data, as the YAML file holds it."""

Errors = Mapping[str, float]
"""Measure's name -> error, in the measure's unit."""


class Unit(Enum):
    """What an error is counted in."""

    PART = "part"
    """Of the closed form's value; shown in percent."""
    PX = "px"
    DEGREES = "degrees"
    SWITCH = "switch"
    """0: as it must be, 1: not."""


@dataclass(frozen=True)
class Measure:
    """One number that a row holds the engine to."""

    name: str
    bar: float
    """The largest error that passes, in `unit`."""
    unit: Unit = Unit.PART


@dataclass(frozen=True)
class Run:
    """One scene's world and its motion; the motion may come from any engine that simulated this world."""

    world: World
    trajectory: Trajectory

    def track(self, name: str) -> Track:
        """The motion of one object."""
        k = self.trajectory.names.index(name)
        return Track(self.trajectory.times, self.trajectory.poses[:, k], self.trajectory.velocities[:, k])

    def body(self, name: str) -> Body:
        """One object's mass, moment and shape."""
        return next(body for body in self.world.bodies if body.name == name)

    def impulse(self, on: str, of: str, begin: float, end: float) -> np.ndarray[Any, np.dtype[np.float64]]:
        """(2,) g·px/s that `of` gave `on` after the sample at `begin` up to the one at `end` (s)."""
        contacts, times = self.trajectory.contacts, self.trajectory.times
        a, b = contacts.surfaces.index(on), contacts.surfaces.index(of)
        rows, given = contacts.impulse_rows, contacts.impulses
        inside = (times[rows[:, 0]] > begin + 1e-9) & (times[rows[:, 0]] < end + 1e-9)
        first = inside & (rows[:, 1] == a) & (rows[:, 2] == b)
        second = inside & (rows[:, 1] == b) & (rows[:, 2] == a)
        total: np.ndarray[Any, np.dtype[np.float64]] = given[first].sum(axis=0) - given[second].sum(axis=0)
        return total


@dataclass(frozen=True)
class Case:
    """One scene and how to measure it."""

    scene: Document
    measure: Callable[..., Errors]
    """Takes one `Run` for each entry of `variants`."""
    label: str = ""
    """Tells the cases of one draw apart; part of the file's name."""
    variants: tuple[str | None, ...] = (None,)
    """Variants of the scene that are run, None for the scene itself."""
    rate: float = 240.0
    """Samples a second; divides every rate of steps, so that samples fall on steps."""


DRAWS = 5
"""Of each row."""


class Draw:
    """One seeded draw of a row's parameters; numbers are rounded, so that the file shows them whole.

    `index` says which of a row's named cases it takes; more draws than five go round them again.
    """

    def __init__(self, row: int, index: int) -> None:
        self.index = index % DRAWS
        self._rng = np.random.default_rng((20241, row, index))

    def number(self, low: float, high: float, digits: int = 2) -> float:
        """Uniform from `low` to `high`."""
        return round(float(self._rng.uniform(low, high)), digits)

    def count(self, low: int, high: int) -> int:
        """A whole number from `low` to `high`, both included."""
        return int(self._rng.integers(low, high + 1))

    def sign(self) -> int:
        """-1 or 1."""
        return 1 if self._rng.random() < 0.5 else -1

    def angle(self) -> float:
        """A direction, rad; a whole number of degrees."""
        return float(np.radians(int(self._rng.integers(0, 360))))

    def mass(self) -> float:
        """20 to 500 g."""
        return self.number(20, 500, 0)


@dataclass(frozen=True)
class Row:
    """One line of the scorecard."""

    number: int
    name: str
    """Short, for files: `free-fall`."""
    title: str
    closed_form: str
    ranges: str
    """What the draws vary, and within which bounds."""
    why: str
    """How the error is counted, why the bar is where it is, and the source."""
    measures: tuple[Measure, ...]
    cases: Callable[[Draw], Sequence[Case]]

    def draw(self, index: int) -> Sequence[Case]:
        """The cases of one draw, the same on every call."""
        return self.cases(Draw(self.number, index))


def worst(errors: Sequence[float]) -> float:
    """The largest; not a number where any is not."""
    return float(np.max(errors))
