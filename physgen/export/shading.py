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
from physgen.export.paint import FULL, Paint
from physgen.export.pictures import png_of_bgr, told
from physgen.export.truth import Clip
from physgen.photometry import decode

F32 = NDArray[np.float32]
LIGHT = decode(np.arange(256, dtype=np.uint8))
"""Linear light of the codes of sRGB."""
MOST = 16.0
"""Of full light, which 65535 stands for: dark paint beside a highlight. Half a step is 0.4 grey levels at most."""


class Shading:
    """Of the frame as it is drawn, with its shadows."""

    def __init__(self, folder: Path, clip: Clip) -> None:
        self._folder, self._paint = folder, clip.shared(Paint)
        self._light: F32 | None = None
        self._found = np.zeros((0, 0, 3), np.uint16)
        told(folder, {"at_0": 0.0, "at_65535": MOST, "light": "linear", "frame": "albedo x shading"})

    def add(self, moment: Moment) -> None:
        """One file a view."""
        view = moment.view
        albedo = self._paint.seen(view)
        if self._light is None or self._light.shape != albedo.shape:
            self._light, self._found = np.empty(albedo.shape, np.float32), np.empty_like(albedo)
        bgr = np.asarray(cv2.cvtColor(view.rgb, cv2.COLOR_RGB2BGR), np.uint8)
        cv2.LUT(bgr, LIGHT, self._light)
        scale = FULL * FULL / MOST
        cv2.divide(self._light, albedo, self._found, scale, cv2.CV_16U)
        (self._folder / f"{view.index:05d}.png").write_bytes(png_of_bgr(self._found))

    def close(self) -> None:
        """Nothing is left to be said."""
