"""Impulses of a world -> changes of velocity at their times."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from physgen.compile.world import World
from physgen.scene.model import Load, Motion

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Kick:
    """What happened to the energy at one time, g·px²/s²."""

    time: float
    """s."""
    lost: float
    work: float


class Kicks:
    """The impulses that are still to come."""

    def __init__(self, world: World) -> None:
        dynamic = [body.motion is Motion.DYNAMIC for body in world.bodies]
        self._bodies = world.bodies
        self._coming = sorted(
            (p for p in world.pushes if p.load is Load.IMPULSE and dynamic[p.body]), key=lambda p: p.start
        )

    def due(self, end: float) -> bool:
        """Whether one is given before `end`, s."""
        return bool(self._coming) and self._coming[0].start < end - 1e-12

    def since(self, begin: float) -> float:
        """s from `begin` to the next one."""
        return max(0.0, self._coming[0].start - begin)

    def give(self, velocity: Array, pose: Array, since: float) -> Kick:
        """Give the next one to the velocities (N, 3), `since` s after the bodies had the pose (N, 3)."""
        push = self._coming.pop(0)
        body = self._bodies[push.body]
        v = velocity[push.body]
        angle = pose[push.body, 2] + v[2] * since
        c, s = np.cos(angle), np.sin(angle)
        arm = np.array([c * push.at[0] - s * push.at[1], s * push.at[0] + c * push.at[1]])
        change = np.array([*push.vector, arm[0] * push.vector[1] - arm[1] * push.vector[0]])
        change /= [body.mass, body.mass, body.moment]
        work = body.mass * (change[:2] @ (v[:2] + change[:2] / 2))
        work += body.moment * change[2] * (v[2] + change[2] / 2)
        velocity[push.body] += change
        return Kick(push.start, 0.0, float(work))
