"""Colours of the background along lines, and the ends of the surface under objects."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.geometry.polygon import bounds
from physgen.maps import F32
from physgen.perceive.roles import Labels, Rgb
from physgen.perceive.support.ground_contact import Foot, Line

Span = tuple[float, float]
"""The columns of two ends, px."""

SURFACE_DIFFERENCE = 10.0
"""Largest CIE 1976 Lab distance between two strips of the same surface."""
CHANGE = 1.5
"""Least distance from the floor's colour outside its end, as a multiple of that."""
FADED = 0.35
"""Largest contrast across the edge outside a floor's end, as a share of the contrast
inside.
"""
SURE_END = 6
"""Columns outside an end that must be visible."""
MAJORITY = 0.8
"""Least share of columns outside an end without the floor's surface."""
SHADE = 5.0
"""Largest ratio of luminances outside and inside that a shadow can explain."""


@dataclass(frozen=True, eq=False)
class _Surface:
    """The colours below and above a floor's line, by column."""

    # (W, 3) CIE Lab; NaN if hidden.
    lower_strip: NDArray[np.float64]
    upper_strip: NDArray[np.float64]
    # (3,): colour below the line under the objects.
    colour: NDArray[np.float64]
    # Typical difference of both strips under the objects.
    contrast: float
    is_visible: bool

    @cached_property
    def is_uniform(self) -> NDArray[np.bool_]:
        """Return (W,) whether both strips show one surface."""
        differences = np.linalg.norm(self.lower_strip - self.upper_strip, axis=1)
        return np.asarray(differences < max(SURFACE_DIFFERENCE, FADED * self.contrast))

    @cached_property
    def is_lighter(self) -> NDArray[np.bool_]:
        """Return (W,) whether the lower strip is the surface in more light.

        Outside an object's own shadow the surface is lighter, with the same hue.
        """
        ratio = _luminance(self.lower_strip) / _luminance(self.colour)
        hue_difference = np.linalg.norm((self.lower_strip - self.colour)[:, 1:], axis=1)
        return np.asarray(
            (ratio > 1) & (ratio < SHADE) & (hue_difference < SURFACE_DIFFERENCE)
        )


class Photo:
    """The colours of the background along lines."""

    def __init__(self, rgb: Rgb, labels: Labels) -> None:
        lab = cv2.cvtColor(rgb.astype(np.float32) / np.float32(255), cv2.COLOR_RGB2LAB)
        self.lab: F32 = np.asarray(lab, np.float32)
        self.labels = labels
        self.width = labels.shape[1]

    def strips(self, line: Line) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return Lab of each column (W, 3) in strips of 6 px below and above a line.

        Columns are NaN if objects or the border hide them.
        """
        columns = np.arange(self.width)
        level = np.round(line.slope * columns + line.height).astype(int)
        lower_strip = self._strip(level + 4)
        upper_strip = self._strip(level - 10)
        return lower_strip, upper_strip

    def _strip(self, top: NDArray[np.int64]) -> NDArray[np.float64]:
        """Return the mean Lab (W, 3) of 6 rows below `top` (W,)."""
        height, width = self.labels.shape
        rows = top[None, :] + np.arange(6)[:, None]
        occlusion = (rows < 0) | (rows >= height)
        rows = np.clip(rows, 0, height - 1)
        occlusion = (
            occlusion | (self.labels[rows, np.arange(width)[None, :]] > 0)
        ).any(0)
        strip = np.asarray(
            self.lab[rows, np.arange(width)[None, :]].mean(0), np.float64
        )
        strip[occlusion] = np.nan
        return strip

    def reach(self, line: Line, group: Sequence[Foot], is_ground: bool) -> Span | None:
        """Return the two ends of the surface under a group, or None if the surface is
        hidden.

        The surface ends at a change of colour below its edge. The ground ends only if
        one surface fills both strips from there to the photo's side. A surface that
        reaches the photo's side continues outside it by the photo's width.
        """
        boxes = np.array([bounds(f.item.outline) for f in group])
        surface = self._measure_surface(line, boxes)
        if not is_ground and surface.contrast < SURFACE_DIFFERENCE:
            return None
        first = min(float(f.left[0]) for f in group)
        last = max(float(f.right[0]) for f in group)
        # A shadow is at most as long as the highest object.
        height = float((boxes[:, 3] - boxes[:, 1]).max())
        start = self._find_end(surface, first, -1, height, is_ground)
        end = self._find_end(surface, last, 1, height, is_ground)
        # Without a visible end, the floor continues outside the photo.
        if start is None:
            start = -float(self.width)
        if end is None:
            end = 2.0 * self.width
        return min(first, start), max(last, end)

    def _measure_surface(self, line: Line, boxes: NDArray[np.float64]) -> _Surface:
        """Return the surface along a line under objects with boxes (N, 4)."""
        margin = 0.5 * float((boxes[:, 2] - boxes[:, 0]).max())
        first = float(boxes[:, 0].min())
        last = float(boxes[:, 2].max())
        lower_strip, upper_strip = self.strips(line)
        span = slice(max(0, int(first - margin)), max(0, int(last + margin) + 2))
        steps = np.linalg.norm((lower_strip - upper_strip)[span], axis=1)
        if np.isfinite(steps).sum() < 3:
            return _Surface(lower_strip, upper_strip, np.zeros(3), 0.0, False)
        colour = np.nanmedian(lower_strip[span], 0)
        contrast = float(np.nanmedian(steps))
        return _Surface(lower_strip, upper_strip, colour, contrast, True)

    def _find_end(
        self, surface: _Surface, x: float, way: int, height: float, is_ground: bool
    ) -> float | None:
        """Return the end of a surface from column `x` to the left (`way` -1) or right.

        The end is None if it is not visible. `height` is the largest length of a
        shadow, px.
        """
        first = round(np.clip(x, 0, self.width - 1))
        columns = np.arange(first, -1 if way < 0 else self.width, way)
        visible = np.isfinite(surface.lower_strip[columns, 0]) & surface.is_visible
        columns = columns[visible]
        differences = np.linalg.norm(
            surface.lower_strip[columns] - surface.colour, axis=1
        )
        is_different = differences > CHANGE * SURFACE_DIFFERENCE
        shadow_end = is_different & surface.is_lighter[columns]
        if shadow_end.any() and abs(columns[shadow_end.argmax()] - x) < height:
            is_different &= ~shadow_end
        # The end is the first column after which the surface no longer appears.
        is_outside = is_different & surface.is_uniform[columns]
        for i in np.flatnonzero(is_different).tolist():
            if len(is_different) - i < SURE_END:
                return None
            following = is_different[i : i + SURE_END]
            if is_ground:
                remainder = is_outside[i:]
            else:
                remainder = following
            if following.all() and remainder.mean() >= MAJORITY:
                return float(columns[i]) - 0.5 * way
        return None


def _luminance(lab: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the relative luminance, 0.003..1, of CIE Lab `(..., 3)`."""
    return np.asarray(np.maximum((lab[..., 0] + 16) / 116, 0.14) ** 3)
