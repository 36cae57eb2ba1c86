"""Where points of one frame are in another frame, computed exactly from poses and cameras."""

from __future__ import annotations

from cmath import exp
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from physgen.compile.appearance import photo_poses
from physgen.compile.world import Body, World
from physgen.geometry.polygon import rotation
from physgen.render.stage import Slices
from physgen.scene.scene import Solid
from physgen.simulate.trajectory import Trajectory

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

REST = 1e-9
"""px and rad."""


class PosedView(Protocol):
    """How N bodies stand, and how they are filmed."""

    @property
    def lens(self) -> Array:
        """(2, 3): photo px -> video px."""

    @property
    def poses(self) -> Array:
        """(N, 3): x px, y px, angle rad, of the centre of mass, in the photo."""

    @property
    def spaces(self) -> Array | None:
        """(N, 3, 3): how bodies have turned in space since t = 0, +z into the photo; None: in the picture alone."""


@dataclass(frozen=True)
class PhotoPose:
    """The photo: all of it, at t = 0."""

    lens: Array
    poses: Array
    spaces: Array | None

    @classmethod
    def of(cls, trajectory: Trajectory, world: World) -> PhotoPose:
        """Before anything moved, or was put elsewhere."""
        shown = photo_poses(world)
        poses = np.array(shown) if shown else trajectory.poses[0]
        turned = np.tile(np.eye(3), (len(poses), 1, 1)) if trajectory.turns.size else None
        if turned is not None and shown:
            turned[:, :2, :2] = [rotation(pose.angle) for pose in shown]
        return cls(np.eye(2, 3), poses, turned)


def is_ball(body: Body) -> bool:
    """Whether it is as round from all sides."""
    return body.radius is not None and body.solid is Solid.SPHERE


def turns_in_space(body: int, view: PosedView, world: World) -> bool:
    """Whether its far side may come up; -1 is the background."""
    return body >= 0 and view.spaces is not None and is_ball(world.bodies[body])


def similarity(body: int, view: PosedView, other: PosedView) -> tuple[complex, complex]:
    """m and n of a body that turns in the picture alone; -1 is the background."""
    large, shift = _lens(view.lens)
    larger, shifted = _lens(other.lens)
    if body < 0 or is_still(body, view, other):
        return complex(larger / large), shifted - larger / large * shift
    (x, y, angle), (to_x, to_y, to_angle) = view.poses[body].tolist(), other.poses[body].tolist()
    turn = exp(1j * (to_angle - angle))
    there = complex(to_x, to_y) - turn * (shift / large + complex(x, y))
    return larger / large * turn, larger * there + shifted


def is_still(body: int, view: PosedView, other: PosedView) -> bool:
    """Whether a body stands in the one as in the other, but for rounding: then it has not moved at all."""
    if view.spaces is not None and other.spaces is not None:
        turned = np.abs(view.spaces[body] - other.spaces[body]).max() > REST
    else:
        turned = False
    moved = np.abs(view.poses[body] - other.poses[body]).max()
    return not turned and bool(moved <= REST)


def _lens(lens: Array) -> tuple[float, complex]:
    """By how much it enlarges, and its shift."""
    (large, _, x), (_, _, y) = lens.tolist()
    return large, complex(x, y)


def spans(box: Slices) -> tuple[Array, Array]:
    """(1, w) x and (h, 1) y of a box, px."""
    rows, columns = box
    x = np.arange(columns.start, columns.stop, dtype=np.float64)
    return x[None, :], np.arange(rows.start, rows.stop, dtype=np.float64)[:, None]


@dataclass(frozen=True)
class Ball:
    """Which way a ball has turned from one view to another."""

    radius: float
    """Video px of the one view."""
    middle: tuple[float, float]
    """Video px of the one view."""
    turn: Array
    """(3, 3), +z into the photo."""
    larger: float
    """The camera of the other view, by how much it enlarges more."""
    to: tuple[float, float]
    """The middle in the other view, video px."""

    @classmethod
    def between(cls, body: int, view: PosedView, other: PosedView, world: World) -> Ball:
        """Of two views that both know how it has turned in space."""
        radius = world.bodies[body].radius
        assert radius is not None
        assert view.spaces is not None
        assert other.spaces is not None
        (large, shift), (larger, shifted) = _lens(view.lens), _lens(other.lens)
        (x, y), (to_x, to_y) = view.poses[body, :2].tolist(), other.poses[body, :2].tolist()
        return cls(
            radius * large,
            (large * x + shift.real, large * y + shift.imag),
            other.spaces[body] @ view.spaces[body].T,
            larger / large,
            (larger * to_x + shifted.real, larger * to_y + shifted.imag),
        )

    def carried(self, x: Array, y: Array) -> tuple[Array, Array, Mask]:
        """Video px x and y, which broadcast, in px of the other view; and which of them are underneath there.

        What a mask has beyond the rim goes with the rim.
        """
        u, v = (x - self.middle[0]) / self.radius, (y - self.middle[1]) / self.radius
        far = u * u + v * v
        towards = np.sqrt(np.maximum(1 - far, 0))
        reach = self.radius * self.larger
        along, down = self.to[0] + reach * u, self.to[1] + reach * v
        within = 1 / np.sqrt(np.maximum(far, 1))
        u, v = u * within, v * within
        change = (self.turn - np.diag([1.0, 1.0, 0.0])) * [[reach], [reach], [1.0]]
        (xx, xy, xz), (yx, yy, yz), (zx, zy, zz) = change.tolist()
        return (
            along + (xx * u + xy * v - xz * towards),
            down + (yx * u + yy * v - yz * towards),
            zx * u + zy * v > zz * towards,
        )

    def origin(self, x: Array, y: Array) -> tuple[Array, Array]:
        """The same without what is underneath, where x and y are none but roughly those of the ball's pixels."""
        u, v = (x - self.middle[0]) / self.radius, (y - self.middle[1]) / self.radius
        towards = np.sqrt(np.maximum(1 - (u * u + v * v), 0))
        reach = self.radius * self.larger
        along, down = (
            to + (reach * row[0] * u + reach * row[1] * v) - reach * row[2] * towards
            for to, row in zip(self.to, self.turn[:2].tolist(), strict=True)
        )
        return along, down


def transfer_points(
    points: Array, body: int, view: PosedView, other: PosedView, world: World
) -> tuple[Array, Mask]:
    """Points (K, 2) video px of a `body` of `view`, -1 the background, in px of `other`; which are on its back."""
    x, y = points[:, 0], points[:, 1]
    if turns_in_space(body, view, world) and other.spaces is not None:
        to_x, to_y, hidden = Ball.between(body, view, other, world).carried(x, y)
        return np.column_stack([to_x, to_y]), hidden
    m, n = similarity(body, view, other)
    there = m * (x + 1j * y) + n
    return np.column_stack([there.real, there.imag]), np.zeros(len(points), bool)
