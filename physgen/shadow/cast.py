"""What throws a shadow, and where; and what floor, wall and table have in common."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from math import ceil, floor, radians, tan

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.photometry import DistantLight

F32 = NDArray[np.float32]
Box = tuple[int, int, int, int]
"""First and last + 1 column and row: x0, y0, x1, y1."""

LOWEST = 0.2
"""Least sine of the light's height over a surface: lower lights throw shadows without end."""
FARTHEST = 0.98
"""Of the direct or the ambient light, no more is taken away."""
SKY = 0.5
"""By how much more ambient light falls on what faces up: skies and ceilings are brighter than floors."""


@dataclass(frozen=True)
class Setting:
    """What light falls on, beside the objects."""

    light: DistantLight
    softness: float
    """degrees: half the width of the light as the objects see it."""
    top: bool
    """Seen from above: a table behind everything."""
    tilt: float
    """Side view: px by which a floor's point appears higher for each px that it lies farther back."""
    backdrop: float
    """Side view: px from the plane of motion back to an upright wall; infinite without."""
    size: tuple[int, int]
    """Width and height of the photo, px."""

    def direct(self, normal: tuple[float, float, float]) -> float:
        """Share of a surface's light that is direct."""
        facing = sum(a * b for a, b in zip(self.light.direction, normal, strict=True))
        straight = self.light.intensity * max(facing, 0.0)
        around = self.light.ambient * (1 if self.top else 1 + SKY * max(-normal[1], 0.0))
        return straight / max(straight + around, 1e-9)


@dataclass(frozen=True)
class Silhouette:
    """An object as it stands now."""

    coverage: F32
    """(h, w) in 0..1."""
    corner: tuple[int, int]
    """Photo column and row of its first pixel."""
    center: tuple[float, float]
    """px."""
    radius: float | None
    """px, of a sphere; None for all others."""
    thick: float
    """px that it reaches through the plane of motion (side view), or above the table (top view)."""
    floor: float | None
    """Side view: the row, px, at which the floor below it is; None where nothing lies below."""
    id: int = 0
    """Of the object in the label map; 0 where nobody asks, or where it is several."""

    @cached_property
    def rows(self) -> NDArray[np.intp]:
        """Rows of `coverage` that show it."""
        return np.flatnonzero(self.coverage.max(axis=1) > 0.5)

    @cached_property
    def lowest(self) -> tuple[int, NDArray[np.intp]]:
        """The first column of `coverage` that shows it, and of each to the last the row below its lowest pixel.

        0 in a column between that shows nothing; no columns at all where none shows anything.
        """
        solid = self.coverage > 0.5
        columns = np.flatnonzero(solid.any(axis=0))
        if not len(columns):
            return 0, columns
        solid = solid[:, columns[0] : columns[-1] + 1]
        rows = solid.shape[0] - np.argmax(solid[::-1], axis=0)
        return int(columns[0]), np.where(solid.any(axis=0), rows, 0)

    @cached_property
    def area(self) -> float:
        """px²."""
        return float(self.coverage.sum())


def spread(setting: Setting, height: float, rise: float, slope: float = 0.66) -> float:
    """px, standard deviation of a shadow's edge that is thrown from so far away; `slope` px sideways for each px."""
    far = tan(radians(min(setting.softness, 60.0))) * max(height, 0.0) / rise
    return float(0.35 + 0.5 * far * (1 + slope * slope) ** 0.5)


def clipped(box: tuple[float, float, float, float], size: tuple[int, int]) -> Box | None:
    """Whole pixels of a photo of `size` (w, h) that a box touches; None where it lies outside."""
    x0, y0 = max(floor(box[0]), 0), max(floor(box[1]), 0)
    x1, y1 = min(ceil(box[2]) + 1, size[0]), min(ceil(box[3]) + 1, size[1])
    return (x0, y0, x1, y1) if x1 > x0 and y1 > y0 else None


def kept(direct: float, blocked: F32, hidden: F32) -> F32:
    """-log of the light that is left where so much of direct and ambient light is taken away."""
    left = (1 - np.float32(direct * FARTHEST) * blocked) * (1 - np.float32((1 - direct) * FARTHEST) * hidden)
    return np.asarray(-np.log(left), np.float32)


def faded(x: F32, y: F32, reach: float) -> F32:
    """1 near the origin, 0 from `reach` on: an end to what thins out for ever."""
    return np.asarray(np.clip(1.5 - 1.5 * np.sqrt(x * x + y * y) / np.float32(reach), 0, 1), np.float32)


def moved(what: Silhouette, box: Box, dx: float, dy: float, blur: float) -> F32:
    """The silhouette, moved and blurred, in a box of the photo."""
    size = (box[2] - box[0], box[3] - box[1])
    shift = np.array([[1.0, 0, what.corner[0] + dx - box[0]], [0, 1, what.corner[1] + dy - box[1]]])
    there = cv2.warpAffine(what.coverage, shift, size, flags=cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT)
    return blurred(np.asarray(there, np.float32), blur)


def blurred(picture: F32, sigma: float) -> F32:
    """Gaussian blur; a wide one on a coarser grid."""
    if sigma < 0.3:
        return picture
    step = int(sigma / 3)
    if step < 2 or min(picture.shape) < 4 * step:
        return np.asarray(
            cv2.GaussianBlur(picture, (0, 0), sigma, borderType=cv2.BORDER_CONSTANT), np.float32
        )
    h, w = picture.shape
    small = cv2.resize(picture, (ceil(w / step), ceil(h / step)), interpolation=cv2.INTER_AREA)
    small = cv2.GaussianBlur(small, (0, 0), sigma / step, borderType=cv2.BORDER_CONSTANT)
    return np.asarray(cv2.resize(small, (w, h), interpolation=cv2.INTER_LINEAR), np.float32)


def behind_ball(radius: float, setting: Setting, x: F32, y: F32 | float, z: F32 | float) -> F32:
    """How much of the light a ball hides from points that lie so far (px) right of, below and before its centre."""
    lx, ly, lz = setting.light.direction
    along = np.asarray(-(x * np.float32(lx) + y * np.float32(ly) + z * np.float32(lz)), np.float32)
    apart = np.sqrt(np.maximum(x * x + y * y + z * z - along * along, 0))
    # of two discs, the ball's and the light's as it shines past there
    disc = np.maximum(np.float32(tan(radians(min(setting.softness, 60.0)))) * along, np.float32(0.35))
    small = np.minimum(np.float32(radius), disc)
    away = (apart - np.maximum(np.float32(radius), disc)) / (0.28 * small)
    return np.asarray((small / disc) ** 2 / (1 + np.exp(np.clip(away, -30, 30))) * (along > 0), np.float32)
