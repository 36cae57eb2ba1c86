"""What the engine needs, resolved: no paths, no defaults. px, s, g, rad; image axes.

A body's frame has its origin at the centre of mass and is turned by 0 at t = 0.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from physgen.scene.model import Combine, Load, Motion, View

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Surface:
    """Factors of a body's or wall's coefficients: a pair's coefficient is the product of the two factors.

    `combine: geometric` puts the square root here, `multiply` the coefficient itself; see `compile.pairs`.
    """

    friction: float
    elasticity: float


@dataclass(frozen=True)
class Body:
    """One rigid body."""

    name: str
    motion: Motion
    center: Array
    """(2,) px: its centre of mass at t = 0."""
    mass: float
    """g."""
    moment: float
    """g·px², about the centre of mass."""
    radius: float | None
    """px of a circle; None for pieces."""
    pieces: tuple[Array, ...]
    """Convex pieces, each (K, 2) px in the body's frame; empty for a circle."""
    rings: tuple[Array, ...]
    """Outline for drawing, outer rings and holes alike, each (K, 2) px in the body's frame."""
    surface: Surface
    rolling: float
    velocity: Array
    """(2,) px/s at t = 0."""
    spin: float
    """rad/s at t = 0."""
    path: Array
    """(K, 4): s, x px, y px, rad; empty unless scripted."""

    @property
    def size(self) -> float:
        """Smallest extent, px: what a step may not jump over."""
        if self.radius is not None:
            return 2 * self.radius
        points = np.concatenate(self.pieces)
        return float((points.max(axis=0) - points.min(axis=0)).min())


@dataclass(frozen=True)
class Wall:
    """A fixed chain of segments."""

    name: str
    points: Array
    """(K, 2) px."""
    surface: Surface


@dataclass(frozen=True)
class Push:
    """An impulse (at `start`), or a force or torque (from `start` to `end`)."""

    body: int
    """Index into `World.bodies`."""
    load: Load
    vector: Array
    """(2,) g·px/s or g·px/s², fixed in the world."""
    torque: float
    """g·px²/s²."""
    at: Array
    """(2,) px in the body's frame, rides on the body."""
    start: float
    end: float


@dataclass(frozen=True)
class World:
    """Everything that moves or is bumped into, and the laws."""

    size: tuple[int, int]
    """Width and height of the canvas, px."""
    view: View
    gravity: Array
    """(2,) px/s²."""
    pixels_per_meter: float
    table_friction: float
    combine: Combine
    duration: float
    steps_per_second: float
    times: Array
    """(T,) s: when the video's frames are taken, t = 0 first."""
    bodies: tuple[Body, ...]
    walls: tuple[Wall, ...]
    pushes: tuple[Push, ...]

    @property
    def surfaces(self) -> tuple[tuple[str, Surface], ...]:
        """Name and surface of every body, then of every wall."""
        things: tuple[Body | Wall, ...] = (*self.bodies, *self.walls)
        return tuple((thing.name, thing.surface) for thing in things)
