"""Pairs of shapes that touch -> single contact points, and how fast they close."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from physgen.simulate.chipmunk import Touching

Array = NDArray[np.float64]
Index = NDArray[np.int64]


@dataclass(frozen=True)
class Points:
    """P contact points of the K pairs of shapes that touch at a step's end."""

    row: Index
    """(P,): its pair."""
    first: Index
    second: Index
    normal: Array
    """(P, 2): from the first to the second."""
    on_first: Array
    """(P, 2) px."""
    on_second: Array
    depth: Array
    closing: Array
    """(P,) px/s at which they close, by velocities before contacts."""


def contact_points(touching: Touching, pose: Array, velocity: Array) -> Points:
    """One row a point; pose and velocity (N, 3) of all things."""
    use = np.arange(2) < touching.count[:, None]
    row = np.repeat(np.arange(len(use)), touching.count)
    first, second, normal = touching.first[row], touching.second[row], touching.normal[row]
    on1, on2 = touching.on_first[use], touching.on_second[use]
    apart = _at(velocity, first, on1, pose) - _at(velocity, second, on2, pose)
    closing = apart[:, 0] * normal[:, 0] + apart[:, 1] * normal[:, 1]
    return Points(row, first, second, normal, on1, on2, touching.depth[use], closing)


def _at(velocity: Array, things: Index, points: Array, pose: Array) -> Array:
    """(P, 2) px/s of points on bodies."""
    v, arm = velocity[things], points - pose[things, :2]
    out = v[:, :2].copy()
    out[:, 0] -= v[:, 2] * arm[:, 1]
    out[:, 1] += v[:, 2] * arm[:, 0]
    return out
