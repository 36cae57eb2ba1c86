"""How far bodies move in a step -> into how many parts it must be divided, so that nothing passes through anything."""

from __future__ import annotations

from itertools import pairwise
from math import ceil

import numpy as np
from numpy.typing import NDArray

from physgen.compile.world import World
from physgen.scene.model import Load, Motion

Array = NDArray[np.float64]
Index = NDArray[np.int64]

SHARE = 0.3
"""Part of its own smallest extent that a body may move in a step: its middle never crosses a line unseen."""
MOST = 4096
"""Parts of a step."""


class Reach:
    """Watches the bodies that move far in a step."""

    def __init__(self, world: World, moving: Index) -> None:
        bodies = [world.bodies[k] for k in moving.tolist()]
        self._limit = np.array([SHARE * body.size for body in bodies]).reshape(-1)
        self._reach = np.array([body.reach for body in bodies]).reshape(-1)
        self._turns = np.array([0.0 if body.radius is not None else body.reach for body in bodies]).reshape(
            -1
        )
        boxes = [
            (*np.minimum(a, b), *np.maximum(a, b))
            for wall in world.walls
            for chain in wall.chains
            for a, b in pairwise(chain)
        ]
        boxes += [
            (*(body.center - body.reach), *(body.center + body.reach))
            for body in world.bodies
            if body.motion is Motion.STATIC
        ]
        self._still = np.array(boxes, np.float64).reshape(-1, 4)
        self._free = np.array([body.motion is Motion.DYNAMIC for body in bodies], bool)
        self._jolt = np.zeros(len(bodies))
        """(M,) px/s that pushes may add in a step."""
        row = {int(body): k for k, body in enumerate(moving.tolist())}
        for push in world.pushes:
            if push.load is Load.FORCE and push.body in row:
                body = world.bodies[push.body]
                force = float(np.hypot(*push.vector)) / world.steps_per_second
                self._jolt[row[push.body]] += force / body.mass * 2
        self.watchful = False
        """Whether something is fast enough to be looked at every step."""

    def _ratio(self, state: Array, h: float, more: Array | float = 0.0) -> Array:
        """(M,): movement in h seconds over what is allowed."""
        speed = np.hypot(state[:, 3], state[:, 4]) + np.abs(state[:, 5]) * self._turns + more
        return np.asarray(speed * h / self._limit)

    def look(self, state: Array, ahead: float, gravity: float, h: float) -> None:
        """Start to watch where something may move too far in a step of h seconds within the time `ahead`."""
        self.watchful = bool((self._ratio(state, h, gravity * ahead + self._jolt) > 1).any())

    def parts(self, state: Array, h: float) -> int:
        """Parts of a step of h seconds; 1 where what is fast has nothing in its way."""
        ratio = self._ratio(state, h, self._jolt)
        fast = np.flatnonzero((ratio > 1) & np.isfinite(ratio))
        if not len(fast):
            self.watchful = False
            return 1
        here, there = state[:, :2], state[:, :2] + state[:, 3:5] * h
        reach = self._reach[:, None] + 2.0
        low, high = np.minimum(here, there) - reach, np.maximum(here, there) + reach
        parts = 1
        for k in fast.tolist():
            meets = (low[:, 0] < high[k, 0]) & (high[:, 0] > low[k, 0])
            meets &= (low[:, 1] < high[k, 1]) & (high[:, 1] > low[k, 1])
            meets[k] = False
            still = self._still
            blocked = (still[:, 0] < high[k, 0]) & (still[:, 2] > low[k, 0])
            blocked &= (still[:, 1] < high[k, 1]) & (still[:, 3] > low[k, 1])
            if meets.any() or blocked.any():
                parts = max(parts, min(MOST, ceil(ratio[k])))
        return parts
