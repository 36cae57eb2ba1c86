"""Rows of blocks that rock on their corners to rest."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from math import atan2, cos, degrees, hypot, pi, sin, sqrt

import numpy as np
from numpy.typing import NDArray

from physgen.evaluate.physics.elliptic import runge_kutta
from physgen.evaluate.physics.scorecard import (
    Case,
    Draw,
    Errors,
    Measure,
    Row,
    Run,
    worst,
)
from physgen.evaluate.physics.staging import GRAVITY, box, scene, segment

Array = NDArray[np.float64]

FLOOR = 240.0
"""Height of the floor, px."""
IMPACTS = 5
SWING_STEPS = 600
"""Steps of a swing. The error of its end is below 1e-4."""
LONGEST_SWING = 1.5
"""s."""


@dataclass(frozen=True)
class _Block:
    """A block of width and height, px, with a tilt about its lower right corner at the
    start.
    """

    width: float
    height: float
    tilt: float
    """rad."""
    rocking: float

    @property
    def half_diagonal(self) -> float:
        """Return the half diagonal, px."""
        return hypot(self.width, self.height) / 2

    @property
    def slenderness(self) -> float:
        """Return the tilt at which it falls over, rad."""
        return atan2(self.width, self.height)

    @property
    def restitution(self) -> float:
        """Return the speed after an impact over the speed before. Angular momentum
        about the new corner is conserved.
        """
        return 1 - 1.5 * sin(self.slenderness) ** 2

    def rate(self, state: Array) -> Array:
        """Return the change of tilt and speed, with the moment of the normal
        force at the corner.
        """
        tilt, speed = state
        arm = self.slenderness - tilt
        # The resistance is a share of the radius of the disc of equal area.
        lever = self.rocking * sqrt(self.width * self.height / pi)
        if speed <= 0:
            lever = -lever
        # Weight and normal force are per mass. The normal force is less than the weight
        # by the centripetal acceleration of the centre.
        lift = self.half_diagonal * sin(arm)
        press = GRAVITY - self.half_diagonal * cos(arm) * speed**2
        # Per mass, the moment of inertia about the corner is 4/3 of the squared half
        # diagonal.
        inertia = 4 / 3 * self.half_diagonal**2 + lever * lift
        return np.array([speed, -(GRAVITY * lift + lever * press) / inertia])

    def impact_times(self) -> list[float]:
        """Return the times of the first impacts, s."""
        state = np.array([self.tilt, 0.0])
        time = 0.0
        times = list[float]()
        h = LONGEST_SWING / SWING_STEPS
        for _ in range(IMPACTS):
            # A swing ends when the tilt changes its sign: the other corner hits the floor.
            states = runge_kutta(self.rate, state, LONGEST_SWING, SWING_STEPS)
            end = int(np.argmax(states[:, 0] < 0))
            before, after = states[end - 1 : end + 1]
            # Within a step, the tilt is nearly linear in time.
            part = before[0] / (before[0] - after[0])
            time += h * (end - 1 + part)
            times.append(time)
            # Each impact takes the same share of the speed, Housner 1963.
            speed = before[1] + part * (after[1] - before[1])
            state = np.array([0.0, -self.restitution * speed])
        return times


def _impact_time_error(
    run: Run, *, times: dict[str, list[float]], blocks: dict[str, _Block]
) -> Errors:
    """Return the largest deviation of an impact's time over the last time."""
    errors = []
    for name, exact in times.items():
        track = run.track(name)
        tilt = blocks[name].tilt + track.angle - track.angle[0]
        found = _crossings(tilt, track.times)[:IMPACTS]
        if len(found) < IMPACTS:
            return {"time": float("inf")}
        deviation = np.abs(np.array(found) - exact)
        errors.append(float(deviation.max()) / exact[-1])
    return {"time": worst(errors)}


def _rocking(draw: Draw) -> list[Case]:
    """Return the case of two rocking blocks on one floor. Error: largest deviation of
    the times of the first impacts over the last.
    """
    objects, blocks, times = {}, {}, {}
    for k, name in enumerate(("free", "resisted")):
        block, tilt = _random_block(draw, k)
        # One corner touches the floor.
        rise = block.half_diagonal * cos(block.slenderness - block.tilt)
        objects[name] = box(
            (140 + 220 * k, FLOOR - rise),
            (block.width, block.height),
            tilt,
            mass=draw.mass(),
            friction=1.0,
            elasticity=0.0,
            rocking=block.rocking,
        )
        blocks[name] = block
        times[name] = block.impact_times()
    measure = partial(_impact_time_error, times=times, blocks=blocks)
    # The clip lasts a little longer than the last impact that is compared.
    duration = max(impacts[-1] for impacts in times.values()) + 0.2
    walls = {"floor": segment((10, FLOOR), (490, FLOOR), friction=1.0, elasticity=0.0)}
    document = scene((500, 280), duration, objects, walls)
    return [Case(document, measure)]


def _random_block(draw: Draw, number: int) -> tuple[_Block, float]:
    """Return a tilted block and its tilt in degrees; the block with number 0 has no
    resistance to rocking.
    """
    width = draw.number(26, 44, 1)
    height = draw.number(80, 110, 1)
    # The tilt is a part of the one at which the block falls over. It is rounded in
    # degrees, since the scene file has degrees.
    part = draw.number(0.35, 0.7)
    tilt = round(degrees(part * atan2(width, height)), 3)
    rocking = number * draw.number(0.02, 0.1, 3)
    return _Block(width, height, float(np.radians(tilt)), rocking), tilt


def _crossings(values: Array, times: Array) -> list[float]:
    """Return the times, s, of changes of sign between samples."""
    before = np.flatnonzero(values[:-1] * values[1:] < 0)
    part = values[before] / (values[before] - values[before + 1])
    steps = np.diff(times)[before]
    crossings: list[float] = (times[before] + part * steps).tolist()
    return crossings


ROWS = (
    Row(
        62, "rocking", "block that rocks to rest", "w'/w = 1 - 3/2 sin² a; a moment of rocking x N x radius",
        "26 to 44 by 80 to 110 px, tilted by 0.35 to 0.7 of a, one free, one with rocking of 0.02 to 0.1",
        "Largest deviation of the times of five impacts over the last. Impacts fall between steps: 1 %. Housner 1963.",
        (Measure("time", 1e-2),), _rocking,
    ),
)  # fmt: skip
