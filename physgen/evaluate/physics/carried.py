"""Rows of objects on belts and turntables, seen from above."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from math import cos, degrees, pi, sin

import numpy as np
from numpy.typing import NDArray

from physgen.evaluate.physics.scorecard import (
    Case,
    Draw,
    Errors,
    Measure,
    Row,
    Run,
)
from physgen.evaluate.physics.staging import GRAVITY, circle, scene

Array = NDArray[np.float64]

MIDDLE = np.array([320.0, 320.0])
"""Centre of the turntable, px."""
BALL_RATE = 2 / 7
"""Angular velocity of a rolling sphere's circle over the turntable's."""


def _belt_errors(
    run: Run,
    *,
    time: float,
    gain: float,
    speed: float,
    way: Array,
    mass: float,
    reach: float,
) -> Errors:
    """Return the errors of the puck's path and of the belt's work."""
    track = run.track("puck")
    # Friction accelerates with mu g up to the belt's speed; then the puck is carried.
    rising = np.minimum(track.times, time)
    exact = gain * rising**2 / 2 + speed * (track.times - rising)
    path_error = np.abs(track.displacements @ way - exact).max()
    # Half of the work m u² is kinetic energy, and half is lost by sliding.
    last_work = float(run.trajectory.energy.work[-1])
    work = last_work / (mass * speed**2)
    return {"way": float(path_error) / reach, "work": abs(work - 1)}


def _belt(draw: Draw) -> Case:
    """Return the case of a puck on a belt. Errors: largest deviation of its path over
    the pick-up distance, and of the belt's work over m u².
    """
    mu = draw.number(0.15, 0.6)
    mass = draw.mass()
    angle = draw.angle()
    speed = draw.number(80, 240, 0)
    way = np.array([cos(angle), sin(angle)])
    # Kinetic friction accelerates the puck by mu g, until the puck has the speed u of
    # the belt: the time is u / (mu g), the path u² / (2 mu g).
    gain = mu * GRAVITY
    # The way of the puck until it has the belt's speed.
    reach = speed**2 / (2 * gain)
    time = speed / gain
    puck = circle(MIDDLE, draw.number(12, 24), mass=mass, friction=mu)
    belt = {"belt": [0, 0, 640, 640], "velocity": (speed * way).tolist()}
    world = {"view": "top", "table": {"friction": mu}}

    measure = partial(
        _belt_errors, time=time, gain=gain, speed=speed, way=way, mass=mass, reach=reach
    )

    fields = {"belt": belt}
    # Some time after the pick-up shows that the puck rides on without further work.
    document = scene((640, 640), time + 0.3, {"puck": puck}, world=world, fields=fields)
    return Case(document, measure, "belt")


@dataclass(frozen=True)
class _RollingBall:
    """A ball that rolls on the turntable."""

    start: Array
    """First position, (2,) px."""
    velocity: Array
    """First velocity, (2,) px/s."""
    rate: float
    """Angular velocity of its circle, rad/s."""

    def roll(self, radius: float, table_spin: float) -> list[float]:
        """Return the roll without slip on the table, (2,) deg/s."""
        # The table's velocity w x r at the ball, with +y downwards.
        table_velocity = table_spin * (self.start - MIDDLE)[::-1] * (-1, 1)
        slip = self.velocity - table_velocity
        roll = [slip[1] / radius, -slip[0] / radius]
        rates: list[float] = np.degrees(roll).tolist()
        return rates

    def error(self, run: Run) -> float:
        """Return the largest deviation from the circle over its radius."""
        ball = run.track("ball")
        rotation = np.exp(1j * self.rate * ball.times)
        velocity = complex(*self.velocity)
        # The velocity turns at a constant rate, so that its integral is a circle.
        chord = velocity * (rotation - 1) / (1j * self.rate)
        positions = complex(*self.start) + chord
        deviation = np.abs(ball.x + 1j * ball.y - positions).max()
        speed = float(np.hypot(*self.velocity))
        return float(deviation * abs(self.rate) / speed)


@dataclass(frozen=True)
class _RidingPuck:
    """A puck that turns with the turntable."""

    arm: Array
    """First position from the centre of the turntable, (2,) px."""
    spin: float
    """Angular velocity of the turntable, rad/s."""

    def velocity(self) -> Array:
        """Return the first velocity, (2,) px/s."""
        return np.asarray(self.spin * self.arm[::-1] * (-1, 1))

    def error(self, run: Run) -> float:
        """Return the largest deviation from the circle over its radius."""
        puck = run.track("puck")
        rotation = np.exp(1j * self.spin * puck.times)
        circle_positions = complex(*self.arm) * rotation
        positions = puck.x + 1j * puck.y - complex(*MIDDLE)
        deviation = np.abs(positions - circle_positions).max()
        return float(deviation) / float(np.hypot(*self.arm))


def _turntable(draw: Draw) -> Case:
    """Return the case of a rolling ball and a riding puck. Errors: largest deviations
    of their places over their circles.

    The ball's velocity turns with 2/7 of the table's rate (Earnshaw 1844), for every
    initial velocity.
    """
    spin = draw.sign() * draw.number(1.5, 3.0)
    start = MIDDLE + draw.number(30, 60) * np.array([1.0, 0.0])
    speed = draw.number(0.6, 1.2) * 40
    heading = draw.angle()
    velocity = speed * np.array([cos(heading), sin(heading)])
    ball = _RollingBall(start, velocity, BALL_RATE * spin)
    radius = draw.number(8, 14)
    distance = draw.number(160, 220)
    side = draw.angle()
    # Friction holds the puck on its circle: mu g must exceed w² r.
    mu = draw.number(1.3, 2.0) * spin**2 * distance / GRAVITY
    # A puck that rides with the disc needs the force m w² r towards its middle, and
    # must not begin to slide.
    puck = _RidingPuck(distance * np.array([cos(side), sin(side)]), spin)
    objects = {
        "ball": circle(
            start,
            radius,
            solid="sphere",
            mass=draw.mass(),
            friction=mu,
            velocity=velocity.tolist(),
            roll=ball.roll(radius, spin),
            collides_with=["main"],
            collision_group="ball",
        ),
        "puck": circle(
            MIDDLE + puck.arm,
            14,
            mass=draw.mass(),
            friction=mu,
            velocity=puck.velocity().tolist(),
            spin=degrees(spin),
            collides_with=["main"],
            collision_group="puck",
        ),
    }
    fields = {"disc": {"turntable": [320, 320, 310], "spin": degrees(spin)}}
    world = {"view": "top", "table": {"friction": mu}}
    document = scene(
        (640, 640), 2 * pi / abs(spin), objects, world=world, fields=fields
    )
    return Case(document, partial(_turntable_errors, ball, puck), "turntable")


def _turntable_errors(ball: _RollingBall, puck: _RidingPuck, run: Run) -> Errors:
    """Return the errors of both paths."""
    return {"ball": ball.error(run), "puck": puck.error(run)}


def _cases(draw: Draw) -> list[Case]:
    return [_belt(draw), _turntable(draw)]


ROWS = (
    Row(
        63, "carried", "from above: belt and turntable",
        "u²/(2 mu g) to the belt's speed; work m u²; a ball circles with 2/7 of the turntable",
        "belts at 80 to 240 px/s in any direction, mu 0.15 to 0.6; turntables of 1.5 to 3 rad/s either way, a ball "
        "at 24 to 48 px/s, a puck 160 to 220 px from the middle",
        "Way over the pick-up distance, work over its closed form, and places over the radius of their circles.",
        (Measure("way", 3e-3), Measure("work", 3e-3), Measure("ball", 3e-3), Measure("puck", 3e-3)), _cases,
    ),
)  # fmt: skip
