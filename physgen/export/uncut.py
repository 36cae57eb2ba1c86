"""What a picture has of a body -> what it would have if it went on beyond its borders."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from physgen.export.extent import Extent
from physgen.export.presence import Presence

Array = NDArray[np.float64]

CORNER = 0.5
"""px from the corner of a picture to the first pixel's centre, our origin."""
LEAST = 0.5
"""px beyond a border from which on a body is cut: what reaches less far covers no pixel there."""


@dataclass(frozen=True)
class Uncut:
    """All of a body."""

    box: tuple[float, float, float, float]
    """x0, y0, x1, y1 px from the picture's corner on; that of its pixels but at borders that it crosses."""
    inside: float
    """Share of it that is in the picture, 0..1."""


def uncut(extent: Extent | None, pose: Array, lens: Array, size: tuple[int, int], thing: Presence) -> Uncut:
    """As far as it is drawn: what the photo's own border cuts off at t = 0 is nowhere."""
    x, y, w, h = thing.box
    sides = [float(x), float(y), float(x + w), float(y + h)]
    borders = (0, 0, *size)
    crossed = False
    if extent is not None and any(side == border for side, border in zip(sides, borders, strict=True)):
        reach = extent.reach_at(pose, lens)
        for k, (border, far, out) in enumerate(zip(borders, reach, (-1, -1, 1, 1), strict=True)):
            if sides[k] == border and (far + CORNER - border) * out > LEAST:
                sides[k], crossed = far + CORNER, True
    inside = 1.0
    if extent is not None and crossed:
        inside = min(1.0, thing.whole_area / extent.area_at(lens))
    return Uncut((sides[0], sides[1], sides[2], sides[3]), inside)
