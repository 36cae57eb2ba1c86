"""Light at the foot of an object that moves along a floor with the object.

The halo of a sprite is the photo beyond sprites and shaded background: a thin contact
shadow, the colours of a mirror image, the lower rim of the object itself. Most of it
fades where it is. The part on the floor belongs to the object; if it stayed behind,
the object would hover.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import exp, hypot

import numpy as np

from physgen.arrays import F32
from physgen.geometry.polygon import Pose
from physgen.geometry.shadows import PixelBox
from physgen.render.shadow_decomposition import SHADOW, shifted_picture

Slices = tuple[slice, slice]
"""Rows and columns of the photo."""


@dataclass(frozen=True)
class FootHaloTuning:
    """Extent of the floor around a foot; lengths are shares of an object's height."""

    legs: float = 0.5
    """Height of the gaps between legs or wheels over the foot."""
    soft_top: float = 0.2
    """Height over which the shade in these gaps begins."""
    floor_height: float = 0.1
    """Height over the foot at which the floor begins beside an object."""
    side_reach: float = 0.1
    """Distance over which the floor below an overhang fades beside it; by eye."""
    lift: float = 0.03
    """Largest height of an object on its floor: a mask may lack the lowest rim."""
    ramp: float = 4.0
    """px over which the floor's part begins, and over which detail fades."""
    rim: float = 0.05
    """Width of a lower rim that the mask may lack."""
    shade: float = 0.1
    """Distance from the outline over which shade is carried."""
    rim_ratio: tuple[float, float] = (0.85, 0.97)
    """Mean darkness over its root mean square: of grain, and of a rim."""
    blur_width: float = 0.02
    """Standard deviation of the blur: grain of the ground stays with the ground."""
    slope: float = 0.25
    """Largest slope of a floor."""
    darkest: float = 1e-3
    """Linear light of a ground without visible shade."""
    deepest: float = 3.0
    """-log of the least light that shade leaves."""
    least_share: float = 0.02
    """Largest invisible share."""


FOOT_HALO = FootHaloTuning()


@dataclass(frozen=True)
class FootHalo:
    """The moving part of a halo."""

    corner: tuple[int, int]
    """Column and row of the photo."""
    light: F32
    """Linear light that is added, (h, w, 3)."""
    shade: F32
    """-log of the share of light that is left, (h, w, 3)."""
    ends: tuple[float, float]
    """Columns of both ends of the floor, px."""
    side: float
    """Smaller side of the object, px."""
    weight: F32
    """Share of the pixels (h, w) that belongs to the object, 0..1."""
    darkness: F32 | None = None
    """-log of the share of full light in the photo, (h, w, 3): that of `shade` and of
    drawn shadows; None of a mirror image."""

    def draw(
        self,
        start: Pose,
        pose: Pose,
        turn: float,
        size: tuple[int, int],
        share: float = 1.0,
    ) -> tuple[Slices, F32, F32] | None:
        """Return a box of the photo, the share of its light that is left there, and the
        added light, (h, w, 3), at a pose; None if both are invisible.

        `share`: share of the shade that is not drawn with a contact shade.
        """
        dx, dy = pose.x - start.x, pose.y - start.y
        # The object follows its floor; a larger rise lifts it off.
        rise = min(max(dy, -FOOT_HALO.slope * abs(dx)), FOOT_HALO.slope * abs(dx))
        lift = (dy - rise) / (SHADOW.lift * self.side)
        share *= exp(-(hypot(lift, turn / SHADOW.turn) ** 2))
        if share < FOOT_HALO.least_share:
            return None
        shift = (dx, rise)
        box, light = shifted_picture(self.light, self.corner, shift, size)
        _, shade = shifted_picture(self.shade, self.corner, shift, size)
        if box is None:
            return None
        weight = np.float32(share) * self._floor_columns(box)
        shape = (box[3] - box[1], box[2] - box[0], 3)
        factor = np.exp(-shade.reshape(shape) * weight).astype(np.float32)
        place = np.s_[box[1] : box[3], box[0] : box[2]]
        return place, factor, np.asarray(light.reshape(shape) * weight, np.float32)

    def _floor_columns(self, box: PixelBox) -> F32:
        """Return 1 for the columns (w, 1) of a box on the floor, else 0."""
        columns = np.arange(box[0], box[2])
        is_floor = (columns >= self.ends[0]) & (columns <= self.ends[1])
        return is_floor.astype(np.float32)[:, None]
