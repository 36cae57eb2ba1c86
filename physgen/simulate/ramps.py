"""Pushes that bring bodies to their velocity within a time, as by a hand, and not at once."""

from __future__ import annotations

from dataclasses import dataclass
from math import hypot

import numpy as np

from physgen.compile.world import Body, World
from physgen.geometry.polygon import Array
from physgen.scene.scene import Motion


@dataclass(frozen=True)
class RampTuning:
    """Strength of the hand."""

    force_factor: float = 2.0
    """Times the largest force that the body alone needs: a heavy neighbour stops the hand."""
    slope: float = 1.5
    """Largest slope of the speed, as a share of speed over time."""


RAMP = RampTuning()


def has_ramp(body: Body) -> bool:
    """Return whether a body reaches its velocity by a ramp."""
    return body.ramp > 0 and body.motion is Motion.DYNAMIC and has_push(body)


def has_push(body: Body) -> bool:
    """Return whether a body moves or turns once it is pushed."""
    return bool(body.velocity.any() or body.spin or body.roll.any())


def ramp_share(body: Body, time: float) -> float:
    """Return the share of its velocity that a body has at a time, s."""
    x = min(max(time / body.ramp, 0.0), 1.0)
    return x * x * (3 - 2 * x)


class Ramps:
    """Forces of all ramps of a world."""

    def __init__(self, world: World) -> None:
        bodies = enumerate(world.bodies)
        self._pushed_bodies = [(k, body) for k, body in bodies if has_ramp(body)]
        self._press = max(hypot(*world.gravity), world.press)
        self.busy = bool(self._pushed_bodies)
        self._losses = {k: (-1.0, 0.0) for k, _ in self._pushed_bodies}
        """Begin of the last step, s, and px/s that friction takes in a step."""

    def add(self, velocity: Array, begin: float, end: float, drive: Array) -> None:
        """Add the forces of a step to `drive` (N, 3), by the velocity (N, 3) before it."""
        h = end - begin
        for k, body in self._pushed_bodies:
            if begin >= body.ramp:
                continue
            share = ramp_share(body, end)
            speed = hypot(*body.velocity)
            if speed:
                direction = body.velocity / speed
                present_speed = float(velocity[k, :2] @ direction)
                missing_speed = share * speed - present_speed
                missing_speed += self._loss(k, body, present_speed, begin, h)
                steepest_slope = RAMP.slope * speed / body.ramp
                max_acceleration = RAMP.force_factor * steepest_slope + self._press
                drive[k, :2] += (
                    body.mass
                    * min(max(missing_speed / h, 0.0), max_acceleration)
                    * direction
                )
            if body.spin or body.radius is not None:
                # What is round would roll by friction, faster than it is asked to.
                missing_speed = share * body.spin - float(velocity[k, 2])
                drive[k, 2] += body.moment * missing_speed / h

    def _loss(
        self, k: int, body: Body, present_speed: float, begin: float, h: float
    ) -> float:
        """Return px/s that friction will take in a step, by what it took before.

        A step that is taken again gives the same.
        """
        time, loss = self._losses[k]
        if begin > time:
            missing_speed = (
                ramp_share(body, begin) * hypot(*body.velocity) - present_speed
            )
            loss = min(max(loss + missing_speed, 0.0), self._press * h)
            self._losses[k] = begin, loss
        return loss

    def roll_change(self, begin: float, end: float, count: int) -> Array | None:
        """Return (N, 2) rad/s by which `count` bodies are made to roll on a table in a step.

        None without ramps.
        """
        if not self.busy:
            return None
        change = np.zeros((count, 2))
        for k, body in self._pushed_bodies:
            if begin < body.ramp and body.roll.any():
                share = ramp_share(body, end) - ramp_share(body, max(begin, 0.0))
                change[k] = share * body.roll
        return change
