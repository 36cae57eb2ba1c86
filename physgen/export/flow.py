"""Optical flow as Middlebury .flo and KITTI 16-bit PNG, and the colours of a flow."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.export.labels import Clip, Flow, Moment, Writer, png_of_bgr, write_png

F32 = NDArray[np.float32]
U16 = NDArray[np.uint16]

SEEN, HIDDEN, GONE = 255, 128, 0
"""Codes of pixels that are visible in the other frame, hidden there, and outside of it."""
KITTI_STEPS, KITTI_ZERO = 64, 2**15
"""Codes a px of flow, and the code of 0."""
SECTORS = (("RY", 15), ("YG", 6), ("GC", 4), ("CB", 11), ("BM", 13), ("MR", 6))
"""Hues between two colours (Baker et al., IJCV 92, 2011, figure 4): as many as people can distinguish."""
COLOURS = {"R": (1, 0, 0), "Y": (1, 1, 0), "G": (0, 1, 0), "C": (0, 1, 1), "B": (0, 0, 1), "M": (1, 0, 1)}
GRID = 256
"""Steps of the colour disc from rest to full colour."""


def _directions(moment: Moment) -> Iterator[tuple[str, Flow]]:
    """`forward` and `backward`, where there is a frame in that direction."""
    for name, flow in (("forward", moment.forward), ("backward", moment.backward)):
        if flow is not None:
            yield name, flow


class Flo(Writer):
    """Middlebury .flo (Baker et al., IJCV 92, 2011): little-endian float32 u, v of all pixels, row by row.

    `forward/00000.flo` is from frame 0 to 1, `backward/00001.flo` from 1 to 0; `visible/` has the codes SEEN, HIDDEN
    and GONE as PNG.
    """

    def __init__(self, folder: Path, clip: Clip) -> None:
        self._folder = folder
        for name in ("forward", "backward"):
            (folder / name).mkdir()
            (folder / "visible" / name).mkdir(parents=True)

    def add(self, moment: Moment) -> None:
        """One file a frame and direction."""
        for name, flow in _directions(moment):
            path = self._folder / name / f"{moment.view.index:05d}.flo"
            if not cv2.writeOpticalFlow(str(path), flow.moved):
                raise OSError(f"{path} cannot be written")
            codes = np.where(flow.visible, np.uint8(SEEN), np.uint8(HIDDEN) * flow.inside.view(np.uint8))
            write_png(self._folder / "visible" / name / f"{moment.view.index:05d}.png", codes)


class Kitti(Writer):
    """KITTI (Menze and Geiger, CVPR 2015), 16-bit PNG: R = 64 u + 2^15, G = 64 v + 2^15; B = 1 for valid pixels.

    `flow_occ/000000_10.png` has all pixels from frame 0 to 1, `flow_noc/` those visible in frame 1; `image_2/` has
    the two frames, and `backward/` the flow from each frame to the one before. Flow beyond 512 px is not valid.
    """

    def __init__(self, folder: Path, clip: Clip) -> None:
        self._folder = folder
        for home in (folder, folder / "backward"):
            for kind in ("flow_occ", "flow_noc"):
                (home / kind).mkdir(parents=True)
        (folder / "image_2").mkdir()

    def add(self, moment: Moment) -> None:
        """Two files a frame and direction, and the pair of frames."""
        if moment.after is not None:
            for number, view in ((10, moment.view), (11, moment.after)):
                name = f"{moment.view.index:06d}_{number}.png"
                (self._folder / "image_2" / name).write_bytes(view.png)
        for direction, flow in _directions(moment):
            home = self._folder / direction if direction == "backward" else self._folder
            name = f"{moment.view.index:06d}_10.png"
            codes = kitti_codes(flow.moved)
            (home / "flow_occ" / name).write_bytes(png_of_bgr(codes))
            codes[~flow.visible] = 0
            (home / "flow_noc" / name).write_bytes(png_of_bgr(codes))


def kitti_codes(moved: F32) -> U16:
    """(H, W, 3) of a flow (H, W, 2), in OpenCV's order: valid, v, u."""
    codes = moved * np.float32(KITTI_STEPS)
    np.rint(codes, out=codes)
    codes += np.float32(KITTI_ZERO)
    valid = np.ones(codes.shape[:2], np.uint16)
    if codes.min() < 0 or codes.max() >= 2**16:
        valid[:] = ((codes >= 0) & (codes < 2**16)).all(axis=-1)
        codes *= valid[..., None]
    u, v = cv2.split(codes.astype(np.uint16))
    return np.asarray(cv2.merge((valid, v, u)), np.uint16)


def coloured(moved: F32, full: float) -> NDArray[np.uint8]:
    """(H, W, 3) sRGB in OpenCV's order, of a flow (H, W, 2); `full` px are full colour, rest is white."""
    place = moved * np.float32(GRID / full)
    place += np.float32(GRID)
    u, v = cv2.split(place)
    shown = cv2.remap(_colour_disc(), u, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
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
