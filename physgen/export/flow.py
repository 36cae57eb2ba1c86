"""Optical flow as Middlebury .flo, KITTI 16-bit PNG and a colour wheel."""

from __future__ import annotations

from collections import deque
from functools import cache
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.export.files import png_of_bgr, write_png
from physgen.export.labels import Clip, Flow, Moment

# ----------------------------------------------------------------------
# Views -> Middlebury .flo (Baker et al., IJCV 92, 2011): little-endian float32 u, v, row by row.
#
# `forward/00000.flo` is from frame 0 to 1, `backward/00001.flo` from 1 to 0. Beside each, in `visible/`, PNG:
# 255 where
# the pixel is seen in the other frame, 128 where it is in the picture and hidden, 0 where it has left the
# picture.

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
                write_png(self._folder / "visible" / way / f"{name}.png", visibility_codes(flow))

    def close(self) -> None:
        """Nothing is left to be said."""


def visibility_codes(flow: Flow) -> NDArray[np.uint8]:
    """(H, W) SEEN, HIDDEN or GONE."""
    # what is seen is inside
    return flow.inside.view(np.uint8) * np.uint8(HIDDEN) + flow.visible.view(np.uint8) * np.uint8(
        SEEN - HIDDEN
    )


# ----------------------------------------------------------------------
# Views -> KITTI's optical flow (Menze and Geiger, CVPR 2015; devkit of stereo and flow 2015): 16-bit PNG.
#
# R = 64 u + 2^15, G = 64 v + 2^15, rounded; B = 1 where the pixel counts. `flow_occ/000000_10.png`: all
# pixels, from
# frame 0 to 1; `flow_noc/`: those that are seen in the other frame; `image_2/000000_10.png` and
# `000000_11.png`: the two
# frames. `backward/` has flow from each frame to the one before.

U16 = NDArray[np.uint16]
File = bytes | memoryview
STEPS, ZERO = 64, 2**15


class Kitti:
    """Flow beyond 512 px cannot be told, and does not count."""

    def __init__(self, folder: Path, clip: Clip) -> None:
        self._folder, self._ways = folder, clip.shared(KittiEncoder)
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


class KittiEncoder:
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


# ----------------------------------------------------------------------
# Views -> optical flow to look at: hue is direction, saturation is speed, as a share of the clip's fastest.
#
# The wheel is that of Baker et al., A Database and Evaluation Methodology for Optical Flow, IJCV 92, 2011,
# figure 4.

F32 = NDArray[np.float32]
SECTORS = (("RY", 15), ("YG", 6), ("GC", 4), ("CB", 11), ("BM", 13), ("MR", 6))
"""Hues between two colours: as many as people tell apart."""
GRID = 256
"""Steps from rest to full colour."""
COLOURS = {"R": (1, 0, 0), "Y": (1, 1, 0), "G": (0, 1, 0), "C": (0, 1, 1), "B": (0, 0, 1), "M": (1, 0, 1)}


class Wheel:
    """`forward/` and `backward/`, PNG."""

    def __init__(self, folder: Path, clip: Clip) -> None:
        self._folder, self._most = folder, fastest(clip)
        for way in ("forward", "backward"):
            (folder / way).mkdir()

    def add(self, moment: Moment) -> None:
        """One file a pair of views and direction."""
        for way, flow in (("forward", moment.forward), ("backward", moment.backward)):
            if flow is not None:
                name = f"{moment.view.index:05d}.png"
                (self._folder / way / name).write_bytes(png_of_bgr(_shown(flow, self._most)))

    def close(self) -> None:
        """Nothing is left to be said."""


def fastest(clip: Clip) -> float:
    """px that a point of a body moves from frame to frame, at most and about; at least 1."""
    steps = np.diff(clip.trajectory.poses, axis=0)
    if not steps.size:
        return 1.0
    reach = np.array([body.reach for body in clip.world.bodies])
    way = np.hypot(steps[..., 0], steps[..., 1]) + reach * np.minimum(np.abs(steps[..., 2]), 2)
    return max(1.0, float(way.max()) * max(clip.size) / max(clip.scene.size))


def _shown(flow: Flow, most: float) -> NDArray[np.uint8]:
    """(H, W, 3) sRGB in OpenCV's order; what is at rest is white."""
    if flow.moving is None:
        return coloured(flow.moved, most)
    shown = np.full((*flow.inside.shape, 3), 255, np.uint8)
    for box in flow.moving:
        shown[box] = coloured(flow.moved[box], most)
    return shown


def coloured(moved: F32, most: float) -> NDArray[np.uint8]:
    """(H, W, 3) sRGB in OpenCV's order, of a flow (H, W, 2); `most` px are full colour, what is at rest is white."""
    place = moved * np.float32(GRID / most)
    place += np.float32(GRID)
    u, v = cv2.split(place)
    shown = cv2.remap(_disc(), u, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(shown, np.uint8)


@cache
def _disc() -> NDArray[np.uint8]:
    """(2 GRID + 1, 2 GRID + 1, 3) sRGB in OpenCV's order, of all flows up to 1 px in x and y, GRID steps a px."""
    u = np.linspace(-1, 1, 2 * GRID + 1)[None, :]
    v = u.T
    wheel = _wheel()
    far = np.hypot(u, v)[..., None]
    place = (np.arctan2(-v, -u) / np.pi + 1) / 2 * (len(wheel) - 1)
    low = np.floor(place).astype(np.int64)
    part = (place - low)[..., None]
    hue = wheel[low] * (1 - part) + wheel[(low + 1) % len(wheel)] * part
    shown = np.where(far <= 1, 1 - far * (1 - hue), hue * 0.75)
    return np.ascontiguousarray(np.floor(255 * shown[..., ::-1]), np.uint8)


def _wheel() -> F32:
    """(55, 3) sRGB 0..1."""
    rows = []
    for pair, count in SECTORS:
        one, other = (np.array(COLOURS[letter]) for letter in pair)
        part = np.arange(count)[:, None] / count
        rows.append(one * (1 - part) + other * part)
    return np.concatenate(rows).astype(np.float32)
