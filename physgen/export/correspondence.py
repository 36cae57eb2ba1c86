"""Map points of one frame to another frame, exactly, from poses and cameras.

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

    lens: Array
    """(2, 3): photo px -> video px."""
    poses: Array
    """(N, 3): x px, y px, angle rad, of the centre of mass, in the photo."""
    spaces: Array | None
    """(N, 3, 3): rotations in space since t = 0, +z into the photo; None: bodies turn in the picture alone."""
    faces: Mapping[int, float]
    """px by which the front of a body, about whose middle it turns, is below its centre, for bodies that have one."""


def photo_view(trajectory: Trajectory, world: World) -> PosedView:
    """Return the photo as a view: all of it, before anything moved, or was placed elsewhere."""
    known_poses = photo_poses(world)
    poses = np.array(known_poses) if known_poses else trajectory.poses[0]
    rotations = None
    if trajectory.turns.size:
        rotations = np.tile(np.eye(3), (len(poses), 1, 1))
        if known_poses:
            rotations[:, :2, :2] = [rotation(pose.angle) for pose in known_poses]
    return PosedView(np.eye(2, 3), poses, rotations, {})


def is_ball(body: Body) -> bool:
    """Return whether the body is a sphere."""
    return body.radius is not None and body.solid is Solid.SPHERE


def turns_in_space(body: int, view: PosedView, world: World) -> bool:
    """Return whether the far side of a body may come up; -1 is the background."""
    return body >= 0 and view.spaces is not None and is_ball(world.bodies[body])


def similarity(body: int, view: PosedView, other: PosedView) -> tuple[complex, complex]:
    """Return m and n of a body that turns in the picture alone; -1 is the background."""
    scale, shift = _lens(view.lens)
    other_scale, other_shift = _lens(other.lens)
    if body < 0 or is_still(body, view, other):
        return complex(other_scale / scale), other_shift - other_scale / scale * shift
    x, y, angle = view.poses[body].tolist()
    other_x, other_y, other_angle = other.poses[body].tolist()
    face = view.faces.get(body, 0.0)
    turn = exp(1j * (other_angle - angle))
    start = shift / scale + complex(x, y + face)
    offset = complex(other_x, other_y + face) - turn * start
    return other_scale / scale * turn, other_scale * offset + other_shift


def is_still(body: int, view: PosedView, other: PosedView) -> bool:
    """Return whether a body has the same pose in both views, up to rounding."""
    change = [view.poses[body] - other.poses[body]]
    if view.spaces is not None and other.spaces is not None:
        change.append((view.spaces[body] - other.spaces[body]).ravel())
    return bool(np.abs(np.concatenate(change)).max() <= AT_REST)


def _lens(lens: Array) -> tuple[float, complex]:
    """Return the magnification and shift of a camera."""
    (scale, _, x), (_, _, y) = lens.tolist()
    return scale, complex(x, y)


def spans(box: Slices) -> tuple[Array, Array]:
    """Return x (1, w) and y (h, 1) of a box, px."""
    rows, columns = box
    x = np.arange(columns.start, columns.stop, dtype=np.float64)
    return x[None, :], np.arange(rows.start, rows.stop, dtype=np.float64)[:, None]


def follow_ball(
    x: Array, y: Array, body: int, view: PosedView, other: PosedView, world: World
) -> tuple[Array, Array, Mask]:
    """Return x, y and far side in the other view of video px x and y, which broadcast, of a ball.

    Both views have rotations in space. Pixels of the mask beyond the rim move with the rim.
    """
    radius = world.bodies[body].radius
    assert radius is not None
    assert view.spaces is not None
    assert other.spaces is not None
    scale = float(view.lens[0, 0])
    other_scale = float(other.lens[0, 0])
    radius *= scale
    center_x, center_y = (scale * view.poses[body, :2] + view.lens[:, 2]).tolist()
    other_center = other_scale * other.poses[body, :2] + other.lens[:, 2]
    other_x, other_y = other_center.tolist()
    u = (x - center_x) / radius
    v = (y - center_y) / radius
    square = u * u + v * v
    depth = np.sqrt(np.maximum(1 - square, 0))
    other_radius = radius * (other_scale / scale)
    shifted_x = other_x + other_radius * u
    shifted_y = other_y + other_radius * v
    # pixels beyond the rim get the point of the rim
    limit = 1 / np.sqrt(np.maximum(square, 1))
    u, v = u * limit, v * limit
    turn = other.spaces[body] @ view.spaces[body].T
    scales = [[other_radius], [other_radius], [1.0]]
    change = (turn - np.diag([1.0, 1.0, 0.0])) * scales
    (xx, xy, xz), (yx, yy, yz), (zx, zy, zz) = change.tolist()
    return (
        shifted_x + (xx * u + xy * v - xz * depth),
        shifted_y + (yx * u + yy * v - yz * depth),
        zx * u + zy * v > zz * depth,
    )
