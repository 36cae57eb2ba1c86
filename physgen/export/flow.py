"""Optical flow as Middlebury .flo, and the colours of a flow."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.export.labels import Clip, Moment, Writer, write_png
from physgen.maps import F32

SEEN, HIDDEN, GONE = 255, 128, 0
"""Codes of pixels that are visible in the other frame, hidden there, and outside of it."""
SECTORS = (("RY", 15), ("YG", 6), ("GC", 4), ("CB", 11), ("BM", 13), ("MR", 6))
"""Hues between two colours (Baker et al., IJCV 92, 2011, figure 4): as many as people can distinguish."""
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
    """Middlebury .flo (Baker et al., IJCV 92, 2011): little-endian float32 u, v of all pixels, row by row.

    `forward/00000.flo` is from frame 0 to 1, `backward/00001.flo` from 1 to 0; `visible/` has the codes SEEN, HIDDEN
    and GONE as PNG.
    """

    def __init__(self, folder: Path, clip: Clip) -> None:
        super().__init__(folder, clip)
        for name in ("forward", "backward"):
            (folder / name).mkdir()
            (folder / "visible" / name).mkdir(parents=True)

    def add(self, moment: Moment) -> None:
        """One file a frame and direction."""
        for name, flow in (("forward", moment.forward), ("backward", moment.backward)):
            if flow is None:
                continue
            path = self._folder / name / f"{moment.view.index:05d}.flo"
            if not cv2.writeOpticalFlow(str(path), flow.moved):
                raise OSError(f"{path} cannot be written")
            codes = np.where(
                flow.visible,
                np.uint8(SEEN),
                np.uint8(HIDDEN) * flow.inside.view(np.uint8),
            )
            write_png(
                self._folder / "visible" / name / f"{moment.view.index:05d}.png", codes
            )


def colour_flow(moved: F32, full: float) -> NDArray[np.uint8]:
    """(H, W, 3) sRGB in OpenCV's order, of a flow (H, W, 2); `full` px are full colour, rest is white."""
    place = moved * np.float32(GRID / full)
    place += np.float32(GRID)
    u, v = cv2.split(place)
    shown = cv2.remap(
        _colour_disc(), u, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
    )
    return np.asarray(shown, np.uint8)


@cache
def _colour_disc() -> NDArray[np.uint8]:
    """(2 GRID + 1, 2 GRID + 1, 3) sRGB in OpenCV's order, of all flows up to 1 px in x and y, GRID steps a px."""
    rows = []
    for pair, count in SECTORS:
        one, other = (np.array(COLOURS[letter]) for letter in pair)
        rows.append(one + (other - one) * np.arange(count)[:, None] / count)
    wheel = np.concatenate(rows).astype(np.float32)
    u = np.linspace(-1, 1, 2 * GRID + 1)[None, :]
    v = u.T
    radius = np.hypot(u, v)[..., None]
    place = (np.arctan2(-v, -u) / np.pi + 1) / 2 * (len(wheel) - 1)
    low = np.floor(place).astype(np.int64)
    part = (place - low)[..., None]
    hue = wheel[low] * (1 - part) + wheel[(low + 1) % len(wheel)] * part
    shown = np.where(radius <= 1, 1 - radius * (1 - hue), hue * 0.75)
    return np.ascontiguousarray(np.floor(255 * shown[..., ::-1]), np.uint8)
