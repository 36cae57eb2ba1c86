"""Views -> KITTI's optical flow (Menze and Geiger, CVPR 2015; devkit of stereo and flow 2015): 16-bit PNG.

R = 64 u + 2^15, G = 64 v + 2^15, rounded; B = 1 where the pixel counts. `flow_occ/000000_10.png`: all pixels, from
frame 0 to 1; `flow_noc/`: those that are seen in the other frame; `image_2/000000_10.png` and `000000_11.png`: the two
frames. `backward/` has flow from each frame to the one before.
"""

from __future__ import annotations

from collections import deque
from functools import cache
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.export.motion import Flow, Moment
from physgen.export.pictures import png_of_bgr
from physgen.export.truth import Clip

U16 = NDArray[np.uint16]
File = bytes | memoryview
STEPS, ZERO = 64, 2**15


class Kitti:
    """Flow beyond 512 px cannot be told, and does not count."""

    def __init__(self, folder: Path, clip: Clip) -> None:
        self._folder, self._ways = folder, clip.shared(Ways)
        for way in (folder, folder / "backward"):
            for kind in ("flow_occ", "flow_noc"):
                (way / kind).mkdir(parents=True)
        self._images = folder / "image_2"
        self._images.mkdir()

    def add(self, moment: Moment) -> None:
        """Two files a pair of views and direction, and the pair as tools for KITTI look for it."""
        if moment.after is not None:
            for number, view in ((10, moment.view), (11, moment.after)):
                (self._images / f"{moment.view.index:06d}_{number}.png").write_bytes(view.png)
        for home, flow in ((self._folder, moment.forward), (self._folder / "backward", moment.backward)):
            if flow is not None:
                name = f"{moment.view.index:06d}_10.png"
                every, not_hidden = self._ways.both(flow)
                (home / "flow_occ" / name).write_bytes(every)
                (home / "flow_noc" / name).write_bytes(not_hidden)

    def close(self) -> None:
        """Nothing is left to be said."""


class Ways:
    """Flow -> files; those of the two flows that were asked for last are at hand, since two formats hold them."""

    def __init__(self, clip: Clip) -> None:
        self._codes = np.empty((clip.size[1], clip.size[0], 3), np.uint16)
        self._last: deque[tuple[Flow, File]] = deque(maxlen=2)

    def every(self, flow: Flow) -> File:
        """All pixels."""
        for known, file in self._last:
            if known is flow:
                return file
        self._last.append((flow, png_of_bgr(self._encoded(flow))))
        return self._last[-1][1]

    def both(self, flow: Flow) -> tuple[File, File]:
        """All pixels; and those that are seen in the other frame."""
        codes = self._encoded(flow)
        every = png_of_bgr(codes)
        self._last.append((flow, every))
        codes.reshape(-1, 3)[np.flatnonzero(~flow.visible)] = 0
        return every, png_of_bgr(codes)

    def _encoded(self, flow: Flow) -> U16:
        """(H, W, 3), in OpenCV's order: whether they fit, v, and u; overwritten by the next."""
        if flow.moving is None:
            self._codes[:] = _encoded(flow.moved)
            return self._codes
        np.copyto(self._codes, _rest(*flow.inside.shape))
        for box in flow.moving:
            self._codes[box] = _encoded(flow.moved[box])
        return self._codes


@cache
def _rest(height: int, width: int) -> U16:
    """(H, W, 3) of what does not move."""
    return np.tile(np.array([1, ZERO, ZERO], np.uint16), (height, width, 1))


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
    return np.asarray(cv2.merge((fits, v, u)), np.uint16)
