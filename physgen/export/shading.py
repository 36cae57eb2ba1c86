"""Views -> shading/00000.png ...: the light that falls on what each pixel shows, linear, 16 bits a channel.

It is the frame's own light over the albedo that `albedo` writes, channel by channel, so that albedo times shading is
the frame again: highlights and soft borders, which no albedo tells, are in it. Where albedo is 0 it is 0.
"""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.export.motion import Moment
from physgen.export.paint import FULL
from physgen.export.pictures import save, told
from physgen.export.truth import Clip
from physgen.photometry import decode

U16 = NDArray[np.uint16]
U8 = NDArray[np.uint8]
MOST = 16.0
"""Of full light, which 65535 stands for: dark paint beside a highlight. Half a step is 0.4 grey levels at most."""


class Shading:
    """Of the frame as it is drawn, with its shadows."""

    def __init__(self, folder: Path, clip: Clip) -> None:
        self._folder, self._paint = folder, clip.paint
        told(folder, {"at_0": 0.0, "at_65535": MOST, "light": "linear", "frame": "albedo x shading"})

    def add(self, moment: Moment) -> None:
        """One file a view."""
        view = moment.view
        save(self._folder / f"{view.index:05d}.png", shading(view.rgb, self._paint.seen(view)))

    def close(self) -> None:
        """Nothing is left to be said."""


def shading(rgb: U8, albedo: U16) -> U16:
    """(h, w, 3) of a frame (h, w, 3) sRGB and its albedo (h, w, 3)."""
    light = cv2.LUT(rgb, decode(np.arange(256, dtype=np.uint8)))
    found = cv2.divide(light, albedo.astype(np.float32), scale=FULL * FULL / MOST, dtype=cv2.CV_16U)
    return np.asarray(found, np.uint16)
