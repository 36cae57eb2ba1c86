"""Motion blur: the moments of each frame's exposure, and the mean of what is seen at them."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from physgen.compile.world import World
from physgen.photometry import decode, encode_u8
from physgen.render.frames import Frame

Array = NDArray[np.float64]

MOMENTS = 8
"""Of an exposure; what moves by more than as many px a frame shows steps."""


def shutter(times: Array, world: World, part: float) -> tuple[Array, int]:
    """Moments (T x parts,) s of frames at `times`, and how many a frame has.

    The shutter is open for a `part` of the time between frames and closes at the frame's own: at t = 0 nothing has
    moved, and the first frame is the photo.
    """
    if part <= 0 or len(times) < 2 or not world.bodies:
        return times, 1
    step = float(times[1] - times[0])
    back = (np.arange(MOMENTS) - (MOMENTS - 1)) / MOMENTS * part * step
    return np.maximum((times[:, None] + back).ravel(), 0.0), MOMENTS


def exposed(frames: Iterator[Frame], parts: int) -> Iterator[Frame]:
    """Means of `parts` frames each in linear light, with the time and the ids of the last."""
    if parts == 1:
        yield from frames
        return
    for index, first in enumerate(frames):
        group = [first, *(next(frames) for _ in range(parts - 1))]
        last = group[-1]
        if all(np.array_equal(frame.rgb, last.rgb) for frame in group):
            yield Frame(index, last.time, last.rgb, last.ids)
            continue
        light = sum((decode(frame.rgb) for frame in group), np.zeros(last.rgb.shape, np.float32))
        yield Frame(index, last.time, encode_u8(light / np.float32(parts)), last.ids)
