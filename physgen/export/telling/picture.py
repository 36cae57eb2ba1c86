"""World, motion and camera -> when objects leave the picture, come into it, or are outside at first."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from cv2 import convexHull
from numpy.typing import NDArray

from physgen.compile.world import Body, World
from physgen.export.telling.event import Event, Happening
from physgen.render.shot import Shot
from physgen.simulate.trajectory import Trajectory

Array = NDArray[np.float64]

SIDES = ("left", "right", "top", "bottom")


def borders(world: World, seen: Trajectory, shot: Shot) -> Iterator[Event]:
    """Only what is wholly out has left: as soon as any of its outline is within the border, it is in."""
    lenses = np.stack([shot.affine(float(time)) for time in seen.times])
    for k, body in enumerate(world.bodies):
        middle = np.einsum("tij,tj->ti", lenses[:, :, :2], seen.poses[:, k, :2]) + lenses[:, :, 2]
        if (_beyond(middle, middle, shot.video) <= 0).all():  # it lies within the outline
            continue
        beyond = outside(body, seen.poses[:, k], lenses, shot.video)
        far = beyond.max(axis=1)
        if far[0] > 0:
            x, y = seen.poses[0, k, :2].tolist()
            yield Event(Happening.OUTSIDE, 0.0, (k,), (x, y), side=SIDES[int(beyond[0].argmax())])
        for at in np.flatnonzero((far[1:] > 0) != (far[:-1] > 0)) + 1:
            low, high = far[at - 1], far[at]
            part = float(low / (low - high))
            time = float(seen.times[at - 1] + part * (seen.times[at] - seen.times[at - 1]))
            out = at if high > 0 else at - 1
            kind = Happening.LEAVE if high > 0 else Happening.ENTER
            x, y = seen.poses[at, k, :2].tolist()
            yield Event(kind, time, (k,), (x, y), side=SIDES[int(beyond[out].argmax())])


def outside(body: Body, poses: Array, lenses: Array, size: tuple[int, int]) -> Array:
    """(T, 4) video px by which all of a body is beyond the left, right, top and bottom border; below 0: some is not.

    poses (T, 3), lenses (T, 2, 3). The border of a picture is half a pixel beyond the centres of its first pixels.
    """
    scale, shift = lenses[:, 0, 0, None], lenses[:, :, 2]
    if body.radius is not None:
        low, high = poses[:, :2] - body.radius, poses[:, :2] + body.radius
    else:
        rim = np.concatenate(body.rings)
        rim = rim[convexHull(rim.astype(np.float32), returnPoints=False).ravel()]
        c, s = np.cos(poses[:, 2:]), np.sin(poses[:, 2:])
        ways = (c * rim[:, 0] - s * rim[:, 1], s * rim[:, 0] + c * rim[:, 1])
        low, high = (
            poses[:, :2] + np.stack([end(way, axis=1) for way in ways], axis=1) for end in (np.min, np.max)
        )
    return _beyond(low * scale + shift, high * scale + shift, size)


def _beyond(low: Array, high: Array, size: tuple[int, int]) -> Array:
    """(T, 4): how far all from `low` to `high` (T, 2) is beyond each border."""
    width, height = size
    return np.stack(
        [-0.5 - high[:, 0], low[:, 0] - (width - 0.5), -0.5 - high[:, 1], low[:, 1] - (height - 0.5)], axis=1
    )
