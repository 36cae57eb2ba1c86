"""Scripted bodies: where their paths have them, and the velocity that brings them to the next place."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from physgen.compile.world import World
from physgen.scene.model import Motion

Array = NDArray[np.float64]


class Scripts:
    """Paths of a world's scripted bodies."""

    def __init__(self, world: World) -> None:
        self._paths = [
            (k, body.path) for k, body in enumerate(world.bodies) if body.motion is Motion.SCRIPTED
        ]
        self.busy = bool(self._paths)
        self._knots = np.unique(np.concatenate([np.zeros(0), *(path[:, 0] for _, path in self._paths)]))

    def jump(self, begin: float, end: float) -> bool:
        """Whether a path's velocity changes after `begin`, up to `end`, s."""
        low, high = np.searchsorted(self._knots, [begin, end], side="right")
        return bool(high > low)

    def drive(self, time: float, h: float, state: Array, row: dict[int, int]) -> None:
        """Set each scripted row of the state (M, 6): to be at its place at `time` after a move of h seconds, with the
        velocity of the h seconds after, which is what pushes others then."""
        for body, path in self._paths:
            now, then = _pose(path, time), _pose(path, time + h)
            velocity = (then - now) / h
            state[row[body], :3] = now - velocity * h
            state[row[body], 3:] = velocity

    def rows(self, row: dict[int, int]) -> list[int]:
        """Rows of the scripted bodies in the state."""
        return [row[body] for body, _ in self._paths]

    def sample(self, time: float, pose: Array, velocity: Array) -> None:
        """Write the exact pose and velocity of the scripted bodies into (N, 3) arrays."""
        for body, path in self._paths:
            pose[body] = _pose(path, time)
            after = int(np.searchsorted(path[:, 0], time, side="right"))
            if 0 < after < len(path):
                velocity[body] = (path[after, 1:] - path[after - 1, 1:]) / (
                    path[after, 0] - path[after - 1, 0]
                )
            else:
                velocity[body] = 0.0


def _pose(path: Array, time: float) -> Array:
    return np.array([np.interp(time, path[:, 0], path[:, k]) for k in (1, 2, 3)])
