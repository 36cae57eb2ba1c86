"""Joints that break: the forces in them, from the momentum that contacts and lasting forces do not explain."""

from __future__ import annotations

from collections import deque
from math import hypot, isfinite

import numpy as np
from numpy.typing import NDArray

from physgen.compile.world import Joint, World
from physgen.geometry.polygon import cross
from physgen.scene.scene import SPRINGS, Motion
from physgen.simulate.collisions import Impacts
from physgen.simulate.contacts import Order, touching
from physgen.simulate.joints import Assemblies

Array = NDArray[np.float64]

WINDOW = 1 / 240
"""s over which the force in a joint is averaged: rigid bodies stop at once, and a blow has a force only over a time."""


class Breakages:
    """The joints of a world that may still break."""

    def __init__(self, world: World) -> None:
        self._whole = [joint for joint in world.joints if isfinite(joint.breaks)]
        bodies = world.bodies
        weights = [[body.mass, body.mass, body.moment] for body in bodies]
        dynamic = [body.motion is Motion.DYNAMIC for body in bodies]
        self._weight = np.where(np.array(dynamic)[:, None], weights, 0.0)
        self._gravity = np.append(world.gravity, 0.0)
        self._last: dict[str, deque[tuple[float, float]]] = {
            joint.name: deque() for joint in self._whole
        }
        """Name of a joint -> s and impulse, g·px/s, of its last steps."""

    @property
    def busy(self) -> bool:
        """Whether any joint may break."""
        return bool(self._whole)

    def unexplained(
        self,
        change: Array,
        pose: Array,
        h: float,
        load: Array | None,
        contacts: tuple[Order, bytes],
        impacts: list[Impacts],
    ) -> Array:
        """Return the impulses (N, 3) that joints gave in a step of h seconds.

        change (N, 3) of the velocities, pose (N, 3), load (N, 3) of lasting forces.
        """
        impulse = self._weight * (change - h * self._gravity)
        if load is not None:
            impulse -= np.where(self._weight > 0, load * h, 0.0)
        count = len(pose)
        order, numbers = contacts
        if numbers:
            touch = touching(order.words, order.sort(numbers))
            points = (touch.on_first + touch.on_second) / 2
            last = np.where(touch.count == 1, 0, 1)
            middle = (points[:, 0] + points[np.arange(len(points)), last]) / 2
            for bodies, sign in ((touch.first, 1.0), (touch.second, -1.0)):
                mine = bodies < count
                arm = middle[mine] - pose[bodies[mine], :2]
                given = sign * touch.impulse[mine]
                both = np.column_stack([given, cross(arm, given)])
                np.subtract.at(impulse, bodies[mine], both)
        for impact in impacts:
            for bodies, sign in ((impact.first, 1.0), (impact.second, -1.0)):
                mine = bodies < count
                np.subtract.at(
                    impulse[:, :2], bodies[mine], sign * impact.impulse[mine]
                )
        return np.where(self._weight > 0, impulse, 0.0)

    def review(
        self, joined: Assemblies, pose: Array, impulse: Array, h: float, is_blow: bool
    ) -> list[Joint]:
        """Return the joints that break in a step of h seconds in which they gave `impulse` (N, 3).

        is_blow: where impacts turned bodies is not known.
        """
        given = joined.reactions(pose, impulse, is_blow)
        broken = []
        for joint in self._whole:
            if joint.kind in SPRINGS:
                size = h * joint.stiffness * abs(_length(joint, pose) - joint.length)
            else:
                size = given.get(joint.name, 0.0)
            last = self._last[joint.name]
            last.append((h, size))
            while len(last) > 1 and sum(span for span, _ in last) - last[0][0] >= (
                WINDOW * (1 - 1e-6)
            ):
                last.popleft()
            span = max(WINDOW, sum(span for span, _ in last))
            if sum(one for _, one in last) / span > joint.breaks:
                broken.append(joint)
        self._whole = [joint for joint in self._whole if joint not in broken]
        return broken


def _length(spring: Joint, pose: Array) -> float:
    """Return px between a spring's ends."""
    ends = []
    for body, at in (
        (spring.first, spring.first_at),
        (spring.second, spring.second_at),
    ):
        if body is None:
            ends.append(at)
            continue
        c, s = np.cos(pose[body, 2]), np.sin(pose[body, 2])
        ends.append(pose[body, :2] + [c * at[0] - s * at[1], s * at[0] + c * at[1]])
    x, y = (ends[0] - ends[1]).tolist()
    return hypot(x, y)
