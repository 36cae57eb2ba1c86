"""A world -> which of its things move though nobody pushes them: what a photo shows at rest is to stay at rest."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from physgen.compile.world import World
from physgen.geometry import Array
from physgen.outline.outline import Outline
from physgen.perceive.upheld import depth_within
from physgen.problems import InputError
from physgen.scene.model import Motion
from physgen.simulate.engine import simulate

FOR = 0.5
"""s that are simulated."""
STILL = 1.5
"""px that nobody sees."""


def drift(world: World) -> dict[str, float]:
    """px by which each thing's farthest point leaves its place within `FOR`; of those that move freely.

    Without pushes, fields and the speeds of the beginning. Infinity where a motion leaves all numbers.
    """
    none = np.zeros(2)
    bodies = tuple(replace(body, velocity=none, spin=0.0, roll=none) for body in world.bodies)
    free = [k for k, body in enumerate(bodies) if body.motion is Motion.DYNAMIC]
    try:
        run = simulate(replace(world, bodies=bodies, pushes=(), fields=()), np.array([0.0, FOR]))
    except InputError:
        return {bodies[k].name: float("inf") for k in free}
    dx, dy, turn = np.abs(run.poses[-1] - run.poses[0]).T
    reach = [
        0.0 if body.radius is not None else body.reach for body in bodies
    ]  # a disc looks the same turned
    return {bodies[k].name: float(np.hypot(dx[k], dy[k]) + turn[k] * reach[k]) for k in free}


def depth(outlines: Iterable[Outline], walls: Iterable[Array]) -> float:
    """px by which walls, each `(K, 2)` px, lie within outlines at most."""
    lines = [_sampled(wall) for wall in walls]
    return max((float(depth_within(one, line).max()) for one in outlines for line in lines), default=0.0)


def _sampled(wall: Array) -> Array:
    """Points along a wall, a px apart."""
    along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(wall, axis=0).T))])
    at = np.append(np.arange(0.0, along[-1]), along[-1])
    return np.stack([np.interp(at, along, wall[:, k]) for k in (0, 1)], axis=1)
