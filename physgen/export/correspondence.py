"""Where points of one frame are in another frame, computed exactly from poses and cameras.

Points of a body move with its pose; those of a ball on a table turn with it in space; the background moves with the
camera alone. The camera scales and shifts, so a rotation in the picture is one similarity, which is two complex
numbers: x + iy of the one picture -> m (x + iy) + n of the other.
"""

from __future__ import annotations

from cmath import exp
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from physgen.compile.world import Body, World, photo_poses
from physgen.geometry.polygon import Array, rotation
from physgen.render.stage import Slices
from physgen.scene.scene import Solid
from physgen.simulate.trajectory import Trajectory

Mask = NDArray[np.bool_]

AT_REST = 1e-9
"""px and rad: rounding of poses that are equal."""


@dataclass(frozen=True)
class PosedView:
    """Poses of N bodies, and the camera."""

    lens: Array  # (2, 3): photo px -> video px
    poses: Array  # (N, 3): x px, y px, angle rad, of the centre of mass, in the photo
    spaces: Array | None
    """(N, 3, 3): rotations in space since t = 0, +z into the photo; None: bodies turn in the picture alone."""
    faces: Mapping[int, float]
    """px by which the front of a body, about whose middle it turns, lies below its centre, where it does."""


def photo_view(trajectory: Trajectory, world: World) -> PosedView:
    """The photo as a view: all of it, before anything moved, or was placed elsewhere."""
    shown = photo_poses(world)
    poses = np.array(shown) if shown else trajectory.poses[0]
    turned = np.tile(np.eye(3), (len(poses), 1, 1)) if trajectory.turns.size else None
    if turned is not None and shown:
        turned[:, :2, :2] = [rotation(pose.angle) for pose in shown]
    return PosedView(np.eye(2, 3), poses, turned, {})


def is_ball(body: Body) -> bool:
    """Whether the body is a sphere."""
    return body.radius is not None and body.solid is Solid.SPHERE


def turns_in_space(body: int, view: PosedView, world: World) -> bool:
    """Whether the far side of a body may come up; -1 is the background."""
    return body >= 0 and view.spaces is not None and is_ball(world.bodies[body])


def similarity(body: int, view: PosedView, other: PosedView) -> tuple[complex, complex]:
    """m and n of a body that turns in the picture alone; -1 is the background."""
    scale, shift = _lens(view.lens)
    other_scale, other_shift = _lens(other.lens)
    if body < 0 or is_still(body, view, other):
        return complex(other_scale / scale), other_shift - other_scale / scale * shift
    (x, y, angle), (to_x, to_y, to_angle) = (
        view.poses[body].tolist(),
        other.poses[body].tolist(),
    )
    turn, face = exp(1j * (to_angle - angle)), view.faces.get(body, 0.0)
    there = complex(to_x, to_y + face) - turn * (shift / scale + complex(x, y + face))
    return other_scale / scale * turn, other_scale * there + other_shift


def is_still(body: int, view: PosedView, other: PosedView) -> bool:
    """Whether a body has the same pose in both views, up to rounding."""
    change = [view.poses[body] - other.poses[body]]
    if view.spaces is not None and other.spaces is not None:
        change.append((view.spaces[body] - other.spaces[body]).ravel())
    return bool(np.abs(np.concatenate(change)).max() <= AT_REST)


def _lens(lens: Array) -> tuple[float, complex]:
    """Its magnification and shift."""
    (scale, _, x), (_, _, y) = lens.tolist()
    return scale, complex(x, y)


def spans(box: Slices) -> tuple[Array, Array]:
    """(1, w) x and (h, 1) y of a box, px."""
    rows, columns = box
    x = np.arange(columns.start, columns.stop, dtype=np.float64)
    return x[None, :], np.arange(rows.start, rows.stop, dtype=np.float64)[:, None]


def carried_by_ball(
    x: Array, y: Array, body: int, view: PosedView, other: PosedView, world: World
) -> tuple[Array, Array, Mask]:
    """Video px x and y, which broadcast, of a ball in px of the other view, and which are on the far side there.

    Both views have rotations in space. Pixels of the mask beyond the rim move with the rim.
    """
    radius = world.bodies[body].radius
    assert radius is not None
    assert view.spaces is not None
    assert other.spaces is not None
    scale, other_scale = float(view.lens[0, 0]), float(other.lens[0, 0])
    radius *= scale
    at_x, at_y = (scale * view.poses[body, :2] + view.lens[:, 2]).tolist()
    to_x, to_y = (other_scale * other.poses[body, :2] + other.lens[:, 2]).tolist()
    u, v = (x - at_x) / radius, (y - at_y) / radius
    squared = u * u + v * v
    towards = np.sqrt(np.maximum(1 - squared, 0))
    reach = radius * (other_scale / scale)
    along, down = to_x + reach * u, to_y + reach * v
    within = 1 / np.sqrt(np.maximum(squared, 1))
    u, v = u * within, v * within
    turn = other.spaces[body] @ view.spaces[body].T
    change = (turn - np.diag([1.0, 1.0, 0.0])) * [[reach], [reach], [1.0]]
    (xx, xy, xz), (yx, yy, yz), (zx, zy, zz) = change.tolist()
    return (
        along + (xx * u + xy * v - xz * towards),
        down + (yx * u + yy * v - yz * towards),
        zx * u + zy * v > zz * towards,
    )
