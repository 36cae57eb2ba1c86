"""World, motion and camera -> when objects leave the picture, come into it, or are outside at first."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from physgen.compile.world import Body, World
from physgen.export.telling.event import Event, Happening
from physgen.geometry import rotation
from physgen.render.shot import Shot
from physgen.simulate.trajectory import Trajectory

Array = NDArray[np.float64]

SIDES = ("left", "right", "top", "bottom")


def borders(world: World, seen: Trajectory, shot: Shot) -> Iterator[Event]:
    """Only what is wholly out has left: as soon as any of its outline is within the border, it is in."""
    lenses = np.stack([shot.affine(float(time)) for time in seen.times])
    for k, body in enumerate(world.bodies):
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
    if body.radius is not None:
        center = np.einsum("tij,tj->ti", lenses[:, :, :2], poses[:, :2]) + lenses[:, :, 2]
        reach = body.radius * lenses[:, 0, 0, None]
        low, high = center - reach, center + reach
    else:
        rim = np.concatenate(body.rings)
        low, high = np.empty((len(poses), 2)), np.empty((len(poses), 2))
        for t, (x, y, angle) in enumerate(poses.tolist()):
            placed = (rim @ rotation(angle).T + (x, y)) @ lenses[t, :, :2].T + lenses[t, :, 2]
            low[t], high[t] = placed.min(axis=0), placed.max(axis=0)
    width, height = size
    return np.stack(
        [-0.5 - high[:, 0], low[:, 0] - (width - 0.5), -0.5 - high[:, 1], low[:, 1] - (height - 0.5)], axis=1
    )
