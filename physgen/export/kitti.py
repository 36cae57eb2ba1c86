"""Views -> KITTI's optical flow (Menze and Geiger, CVPR 2015; devkit of stereo and flow 2015): 16-bit PNG.

R = 64 u + 2^15, G = 64 v + 2^15, rounded; B = 1 where the pixel counts. `flow_occ/000000_10.png`: all pixels, from
frame 0 to 1; `flow_noc/`: those that are seen in the other frame.
`backward/` has both from each frame to the one before.
"""

from __future__ import annotations

from functools import cache
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.export.motion import Flow, Moment
from physgen.export.pictures import save
from physgen.export.truth import Clip

U16 = NDArray[np.uint16]
STEPS, ZERO = 64, 2**15


class Kitti:
    """Flow beyond 512 px cannot be told, and does not count."""

    def __init__(self, folder: Path, clip: Clip) -> None:
        self._folder = folder
        for way in (folder, folder / "backward"):
            for kind in ("flow_occ", "flow_noc"):
                (way / kind).mkdir(parents=True)

    def add(self, moment: Moment) -> None:
        """Two files a pair of views and direction."""
        for home, flow in ((self._folder, moment.forward), (self._folder / "backward", moment.backward)):
            if flow is not None:
                name, every = f"{moment.view.index:06d}_10.png", encoded(flow)
                save(home / "flow_occ" / name, every)
                seen = flow.visible.view(np.uint8)
                save(
                    home / "flow_noc" / name, np.asarray(cv2.bitwise_and(every, every, mask=seen), np.uint16)
                )

    def close(self) -> None:
        """Nothing is left to be said."""


def encoded(flow: Flow) -> U16:
    """(H, W, 3): u, v, and whether they fit."""
    if flow.moving is None:
        return _encoded(flow.moved)
    every = _rest(*flow.inside.shape).copy()
    for box in flow.moving:
        every[box] = _encoded(flow.moved[box])
    return every


@cache
def _rest(height: int, width: int) -> U16:
    """(H, W, 3) of what does not move."""
    return np.tile(np.array([ZERO, ZERO, 1], np.uint16), (height, width, 1))


def _encoded(moved: NDArray[np.float32]) -> U16:
    """(h, w, 3) of a flow (h, w, 2)."""
    codes = moved * np.float32(STEPS)
    np.rint(codes, out=codes)
    codes += np.float32(ZERO)
    fits = np.ones(codes.shape[:2], np.uint16)
    if codes.min() < 0 or codes.max() >= 2**16:
        fits[:] = ((codes >= 0) & (codes < 2**16)).all(axis=-1)
        codes *= fits[..., None]
    u, v = cv2.split(codes.astype(np.uint16))
    return np.asarray(cv2.merge((u, v, fits)), np.uint16)
