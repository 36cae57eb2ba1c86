"""Motion blur: the moments of each frame's exposure, and the mean of what is seen at them."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from physgen.compile.world import World
from physgen.photometry import decode, encode_u8
from physgen.render.stage import Frame
from physgen.simulate.trajectory import Trajectory

Array = NDArray[np.float64]

FEWEST, MOST = 4, 24
"""Moments of an exposure."""
STEP = 2.0
"""px that anything moves between two of them, unless there are the most already."""


def shutter(trajectory: Trajectory, world: World, part: float) -> tuple[Array, int]:
    """Moments (T x parts,) s of frames at the trajectory's times, and how many a frame has.

    The shutter is open for a `part` of the time between frames and closes at the frame's own: at t = 0 nothing has
    moved, and the first frame is the photo.
    """
    times = trajectory.times
    if part <= 0 or len(times) < 2 or not world.bodies:
        return times, 1
    open_ = part * float(times[1] - times[0])
    reach = np.array([np.hypot(*np.concatenate(body.rings).T).max() for body in world.bodies])
    vx, vy, spin = np.moveaxis(trajectory.velocities, -1, 0)
    farthest = float((np.hypot(vx, vy) + np.abs(spin) * reach).max()) * open_
    parts = int(np.clip(np.ceil(farthest / STEP), FEWEST, MOST))
    back = (np.arange(parts) - (parts - 1)) / parts * open_
    return np.maximum((times[:, None] + back).ravel(), 0.0), parts


def exposed(frames: Iterator[Frame], parts: int) -> Iterator[Frame]:
    """Means of `parts` frames each in linear light, with the time and the ids of the last."""
    if parts == 1:
        yield from frames
        return
    for index, first in enumerate(frames):
        group = [first, *(next(frames) for _ in range(parts - 1))]
        last = group[-1]
        if all(np.array_equal(frame.rgb, last.rgb) for frame in group):
            yield Frame(index, last.time, last.rgb, last.named, last.covering)
            continue
        light = sum((decode(frame.rgb) for frame in group), np.zeros(last.rgb.shape, np.float32))
        rgb = encode_u8(light / np.float32(parts))
        yield Frame(index, last.time, rgb, last.named, last.covering)
