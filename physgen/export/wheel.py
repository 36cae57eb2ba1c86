"""Views -> optical flow to look at: hue is direction, saturation is speed, as a share of the clip's fastest.

The wheel is that of Baker et al., A Database and Evaluation Methodology for Optical Flow, IJCV 92, 2011, figure 4.
"""

from __future__ import annotations

from functools import cache
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.export.motion import Flow, Moment
from physgen.export.pictures import png_of_bgr
from physgen.export.truth import Clip

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
