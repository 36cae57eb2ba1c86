"""Optical flow as Middlebury .flo, and the colours of a flow."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.export.labels import Clip, Moment, Writer, write_png
from physgen.maps import F32

VISIBLE, HIDDEN, OUTSIDE = 255, 128, 0
"""Codes of pixels that are visible, hidden, or outside in the other frame."""
SECTORS = (("RY", 15), ("YG", 6), ("GC", 4), ("CB", 11), ("BM", 13), ("MR", 6))
"""Hues between two colours (Baker et al., IJCV 92, 2011, figure 4): as many as people
can distinguish.
"""
COLOURS = {
    "R": (1, 0, 0),
    "Y": (1, 1, 0),
    "G": (0, 1, 0),
    "C": (0, 1, 1),
    "B": (0, 0, 1),
    "M": (1, 0, 1),
}
GRID = 256
"""Steps of the colour disc from rest to full colour."""


class Flo(Writer):
    """Writes Middlebury .flo (Baker et al., IJCV 92, 2011): little-endian float32 u, v
    of all pixels, row by row.

    `forward/00000.flo` is from frame 0 to 1, `backward/00001.flo` from 1 to 0;
    `visible/` has the codes VISIBLE, HIDDEN and OUTSIDE as PNG.
    """

    def __init__(self, folder: Path, clip: Clip) -> None:
        super().__init__(folder, clip)
        for name in ("forward", "backward"):
            (folder / name).mkdir()
            (folder / "visible" / name).mkdir(parents=True)

    def add(self, moment: Moment) -> None:
        """Write one file per frame and direction."""
        for name, flow in (("forward", moment.forward), ("backward", moment.backward)):
            if flow is None:
                continue
            path = self._folder / name / f"{moment.view.index:05d}.flo"
            if not cv2.writeOpticalFlow(str(path), flow.motion):
                raise OSError(f"{path} cannot be written")
            # A point that is not visible is hidden if it is still inside.
            codes = np.where(
                flow.visible,
                np.uint8(VISIBLE),
                np.uint8(HIDDEN) * flow.inside.view(np.uint8),
            )
            write_png(
                self._folder / "visible" / name / f"{moment.view.index:05d}.png", codes
            )


def colour_flow(flow: F32, full_colour: float) -> NDArray[np.uint8]:
    """Return the picture (H, W, 3) of a flow (H, W, 2), sRGB in OpenCV's order.

    `full_colour` px have full colour; rest is white.
    """
    # A lookup in a table is faster than the colour formula per pixel.
    place = flow * np.float32(GRID / full_colour)
    place += np.float32(GRID)
    u, v = cv2.split(place)
    picture = cv2.remap(
        _colour_disc(), u, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
    )
    return np.asarray(picture, np.uint8)


@cache
def _colour_disc() -> NDArray[np.uint8]:
    """Return the colours of all flows up to 1 px in x and y with GRID steps per px, (2
    GRID + 1, 2 GRID + 1, 3) sRGB in OpenCV's order.
    """
    wheel = _colour_wheel()
    u = np.linspace(-1, 1, 2 * GRID + 1)[None, :]
    v = u.T
    radius = np.hypot(u, v)[..., None]
    # The angle as a share of a turn, from -x on, as in the published code.
    turn = (np.arctan2(-v, -u) / np.pi + 1) / 2
    # The direction chooses a hue of the wheel, by linear interpolation between its
    # neighbours; the length chooses the saturation (Baker et al., Middlebury).
    place = turn * (len(wheel) - 1)
    low = np.floor(place).astype(np.int64)
    part = (place - low)[..., None]
    high = (low + 1) % len(wheel)
    hue = wheel[low] * (1 - part) + wheel[high] * part
    # Colours beyond the disc are darker, as in the published colour code.
    colour = np.where(radius <= 1, 1 - radius * (1 - hue), hue * 0.75)
    levels = np.floor(255 * colour[..., ::-1])
    return np.ascontiguousarray(levels, np.uint8)


def _colour_wheel() -> F32:
    """Return the hues of all directions, (K, 3), 0 to 1."""
    rows = []
    for pair, count in SECTORS:
        begin, end = (np.array(COLOURS[letter]) for letter in pair)
        steps = np.arange(count)[:, None]
        rows.append(begin + (end - begin) * steps / count)
    return np.concatenate(rows).astype(np.float32)
