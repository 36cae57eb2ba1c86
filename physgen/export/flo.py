"""Views -> Middlebury .flo (Baker et al., IJCV 92, 2011): little-endian float32 u, v, row by row.

`forward/00000.flo` is from frame 0 to 1, `backward/00001.flo` from 1 to 0. Beside each, in `visible/`, PNG: 255 where
the pixel is seen in the other frame, 128 where it is in the picture and hidden, 0 where it has left the picture.
"""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.export.motion import Flow, Moment
from physgen.export.pictures import save
from physgen.export.truth import Clip

SEEN, HIDDEN, GONE = 255, 128, 0


class Flo:
    """Flow is told of every pixel, of those that leave the picture or are hidden too."""

    def __init__(self, folder: Path, clip: Clip) -> None:
        self._folder = folder
        for way in ("forward", "backward"):
            (folder / way).mkdir()
            (folder / "visible" / way).mkdir(parents=True)

    def add(self, moment: Moment) -> None:
        """One file a pair of views and direction."""
        for way, flow in (("forward", moment.forward), ("backward", moment.backward)):
            if flow is not None:
                name = f"{moment.view.index:05d}"
                path = self._folder / way / f"{name}.flo"
                if not cv2.writeOpticalFlow(str(path), flow.moved):
                    raise OSError(f"{path} cannot be written")
                save(self._folder / "visible" / way / f"{name}.png", seen(flow))

    def close(self) -> None:
        """Nothing is left to be said."""


def seen(flow: Flow) -> NDArray[np.uint8]:
    """(H, W) SEEN, HIDDEN or GONE."""
    # what is seen is inside
    return flow.inside.view(np.uint8) * np.uint8(HIDDEN) + flow.visible.view(np.uint8) * np.uint8(
        SEEN - HIDDEN
    )
