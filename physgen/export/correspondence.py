"""Map points of one frame to another frame exactly, from poses and cameras.

Points of a body move with its pose. Points of a ball on a table turn with it in space.
The background moves with the camera only. The camera scales and shifts, so that a
rotation in the picture is a similarity of two complex numbers: x + iy of one picture ->
m (x + iy) + n of the other.
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
"""Maximum difference of equal poses after rounding, px and rad."""


@dataclass(frozen=True)
class PosedView:
    """Poses of N bodies, and the camera."""

    lens: Array
    """(2, 3): photo px -> video px."""
    poses: Array
    """(N, 3): x px, y px, angle rad, of the centre of mass, in the photo."""
    spaces: Array | None
    """(N, 3, 3): rotations in space since t = 0, +z into the photo; None: bodies turn
    only in the picture.
    """
    faces: Mapping[int, float]
    """Distance of the front face's centre below the body's centre, px, for bodies with
    a front face. The face turns about its own centre.
    """


def photo_view(trajectory: Trajectory, world: World) -> PosedView:
    """Return the view of the whole photo, with the bodies at their places in
    the photo.
    """
    known_poses = photo_poses(world)
    if known_poses:
        poses = np.array(known_poses)
    else:
        poses = trajectory.poses[0]
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
    """Return whether the far side of a body can become visible; -1 is the
    background.
    """
    return body >= 0 and view.spaces is not None and is_ball(world.bodies[body])


def similarity(body: int, view: PosedView, other: PosedView) -> tuple[complex, complex]:
    """Return m and n of a body that turns only in the picture; -1 is the background."""
    scale, shift = _lens(view.lens)
    other_scale, other_shift = _lens(other.lens)
    if body < 0 or is_still(body, view, other):
        # Only the cameras differ: undo the first one, and apply the other.
        return complex(other_scale / scale), other_shift - other_scale / scale * shift
    x, y, angle = view.poses[body].tolist()
    other_x, other_y, other_angle = other.poses[body].tolist()
    # A block's front face turns about its own centre.
    face = view.faces.get(body, 0.0)
    # Points are complex numbers x + i y: a turn is a factor, and a shift a sum.
    turn = exp(1j * (other_angle - angle))
    # From the video to the photo, about the body's centre to its other pose, and back
    # to the video.
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
    y = np.arange(rows.start, rows.stop, dtype=np.float64)
    return x[None, :], y[:, None]


def follow_ball(
    x: Array, y: Array, body: int, view: PosedView, other: PosedView, world: World
) -> tuple[Array, Array, Mask]:
    """Return x, y and far side in the other view for points x and y of a ball, video
    px. x and y broadcast.

    Both views have rotations in space. Mask pixels beyond the rim move with the rim.
    """
    body_radius = world.bodies[body].radius
    assert body_radius is not None
    assert view.spaces is not None
    assert other.spaces is not None
    scale = float(view.lens[0, 0])
    radius = scale * body_radius
    other_radius = radius * (float(other.lens[0, 0]) / scale)
    center = _video_center(body, view)
    u = (x - center[0]) / radius
    v = (y - center[1]) / radius
    other_x, other_y = _video_center(body, other)
    # From one view back to t = 0 and on to the other view.
    turn = other.spaces[body] @ view.spaces[body].T
    # Only the change is computed: a ball at rest then moves by exactly zero.
    scales = [[other_radius], [other_radius], [1.0]]
    change = (turn - np.diag([1.0, 1.0, 0.0])) * scales
    change_x, change_y, change_z = _turn_ball(u, v, change)
    return (
        other_x + other_radius * u + change_x,
        other_y + other_radius * v + change_y,
        change_z > 0,
    )


def _turn_ball(u: Array, v: Array, matrix: Array) -> tuple[Array, Array, Array]:
    """Return a matrix (3, 3) times the front points of a unit sphere at u and v, which
    broadcast.

    Points beyond the rim are moved to the rim.
    """
    square = u * u + v * v
    depth = np.sqrt(np.maximum(1 - square, 0))
    # Coverage reaches about a pixel beyond the rim.
    limit = 1 / np.sqrt(np.maximum(square, 1))
    u = u * limit
    v = v * limit
    # The front of the sphere has z = -depth: +z leads away from the viewer.
    first, second, third = matrix.tolist()
    return (
        first[0] * u + first[1] * v - first[2] * depth,
        second[0] * u + second[1] * v - second[2] * depth,
        third[0] * u + third[1] * v - third[2] * depth,
    )


def _video_center(body: int, view: PosedView) -> tuple[float, float]:
    """Return the centre of a body, video px."""
    scale = float(view.lens[0, 0])
    center = scale * view.poses[body, :2] + view.lens[:, 2]
    x, y = center.tolist()
    return x, y
