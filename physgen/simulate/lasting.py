"""What lasts longer than a blow -> forces for a step, and afterwards the energy that they spent and the work done."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from physgen.compile.world import World
from physgen.scene.model import Motion
from physgen.simulate.chipmunk import Chipmunk
from physgen.simulate.loads import Loads
from physgen.simulate.resistance import Resistance
from physgen.simulate.table import Table

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Forces:
    """Lasting forces of one step, each (N, 3): g·px/s², g·px/s², g·px²/s²."""

    total: Array
    drive: Array | None
    """The part that does work."""
    spend: Array | None
    """The part that takes energy out."""
    rolled: Array | None
    """(N, 2) rad/s: change of the spheres' roll on the table."""


@dataclass(frozen=True)
class Settled:
    """What a step's lasting forces did, g·px²/s²."""

    lost: float
    work: float
    roll: Array | None
    """(N, 2) rad/s at its end; None where nothing rolls on a table."""


class Lasting:
    """Pushes, springs, fields, the table, rolling resistance and motors of a world."""

    def __init__(self, world: World, space: Chipmunk, loads: Loads) -> None:
        bodies = world.bodies
        self._space, self._loads, self._table = space, loads, Table(world)
        self._resistance = Resistance(world)
        self._center = np.array([[*b.center, 0.0] for b in bodies]).reshape(-1, 3)
        self._dynamic = np.array([b.motion is Motion.DYNAMIC for b in bodies], bool)
        self._scripted = np.array([b.motion is Motion.SCRIPTED for b in bodies], bool)
        mass = np.array([b.mass for b in bodies]).reshape(-1)
        moment = np.array([b.moment for b in bodies]).reshape(-1)
        self._moment, self._weight = moment, np.stack([mass, mass, moment], axis=1)
        self._nothing = np.zeros((len(bodies), 3))
        self._fall = np.where(self._dynamic[:, None], [*world.gravity, 0.0], 0.0)
        self._falls = bool(world.gravity.any())
        self.roll = np.array([b.roll for b in bodies]).reshape(-1, 2)
        """(N, 2) rad/s: how spheres on a table roll now."""
        self._roll_before = self.roll
        self.pushes = loads.busy or self._table.busy
        """Whether forces are to be set before a step."""
        self.accounts = self.pushes or self._resistance.busy
        """Whether a step has to be settled."""
        self.brakes = self._resistance.busy

    def begin(self) -> None:
        """A new step: a step that is taken again starts from here."""
        self._roll_before = self.roll

    def press(self) -> None:
        """Set the brakes of rolling resistance by the normal forces of the last step."""
        self._resistance.press(self._space)

    def drift(self, load: Forces | None) -> Array:
        """(N, 2) px/s²: acceleration of each body while nothing touches it."""
        fall: Array = self._fall[:, :2]
        if load is None:
            return fall
        return np.asarray(fall + (load.total / self._weight)[:, :2] * self._dynamic[:, None])

    def push(self, state: Array, end: float, h: float, first: bool) -> Forces:
        """Lasting forces for the step to `end`, taken where the bodies then are."""
        velocity = self._spread(state[:, 3:], self._nothing)
        load = Forces(self._nothing, None, None, None)
        if self._loads.busy:
            pose = self._spread(state[:, :3] + state[:, 3:] * h, self._center)
            begin, part = (end, 0.5) if first else (end - h / 2, 1.0)
            loads = self._loads.at(pose, velocity, begin, end + h / 2)
            drive, spend = loads.drive * part, loads.spend * part
            load = Forces(loads.hold * part + drive + spend, drive, spend, None)
        if self._table.busy:
            part = h / 2 if first else h
            trial = velocity + load.total / self._weight * h if self._loads.busy else velocity
            trial = trial + self._fall * part if self._falls else trial
            change, rolled = self._table.kick(trial, self._roll_before, part)
            grip = change * self._weight
            grip /= h
            spend = grip if load.spend is None else load.spend + grip
            load = Forces(load.total + grip if self._loads.busy else grip, load.drive, spend, rolled)
        every = len(self._space.moving) == len(load.total)
        self._space.push(load.total if every else load.total[self._space.moving])
        return load

    def _spread(self, rows: Array, others: Array) -> Array:
        """(M, 3) of the bodies that move -> (N, 3) of all."""
        if len(rows) == len(others):
            return rows
        out = others.copy()
        out[self._space.moving] = rows
        return out

    def settle(
        self, load: Forces | None, used: Array, state: Array, words: bytes, numbers: bytes, h: float
    ) -> Settled:
        """Lost and work of all but contacts in a step from velocities `used` (M, 3) to `state` (M, 6), and the roll."""
        mean = self._spread((used + state[:, 3:]) / 2, self._nothing)
        lost = work = 0.0
        if load is not None:
            work = 0.0 if load.drive is None else float(np.vdot(load.drive, mean)) * h
            lost = 0.0 if load.spend is None else -float(np.vdot(load.spend, mean)) * h
            if self._scripted.any():  # a spring on a scripted body hands on what its script does
                work -= float(np.vdot(load.total[self._scripted], mean[self._scripted])) * h
            if load.rolled is not None:
                # what the table takes from a sphere's motion partly goes into its rolling
                half = self._roll_before + load.rolled / 2
                lost -= float(self._moment @ (load.rolled * half).sum(axis=1))
                self.roll = self._roll_before + load.rolled
        if self._resistance.busy:
            touch = self._space.touching(words, numbers)
            lost += self._resistance.settle(self._space, touch, mean, h)
        return Settled(lost, work, self.roll if self._table.busy else None)
