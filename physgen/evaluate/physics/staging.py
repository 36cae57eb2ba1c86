"""Parts of a scene as plain data: bodies, walls and slopes with every number as in the
scene file.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import atan, cos, degrees, sin
from typing import Any

import numpy as np
from numpy.typing import NDArray

from physgen.evaluate.physics.scorecard import Document

Point = tuple[float, float]
Position = Sequence[float] | NDArray[np.float64]
"""x px, y px."""

GRAVITY = 980.0
"""Gravity, px/s²: 9.8 m/s² at the default of 100 px per metre."""

MIN_VIDEO_TIME = 2.0
"""Minimum duration of a video, s. Faster motion is hard to watch."""
FRAME_RATE = 30
"""Frame rate of such a video, 1/s."""
DECIMALS = 9
"""Decimals of numbers in scene files: readable, and finer than any gap of a row."""

INERTIA = {"disc": 1 / 2, "sphere": 2 / 5, "hoop": 1.0}
"""k of I = k m r²."""
FLOATING = {"gravity": [0, 0]}
"""The world of floating bodies."""


def scene(
    size: tuple[int, int],
    duration: float,
    objects: Mapping[str, Document],
    boundaries: Mapping[str, Document] | None = None,
    world: Mapping[str, Any] | None = None,
    **sections: Any,
) -> Document:
    """Return a complete scene; `world` and `sections` have further keys.

    The duration (s) is rounded up to a tenth. A motion shorter than MIN_VIDEO_TIME is
    slowed down to it.
    """
    duration = round_up(duration)
    # Slow motion keeps the physics and makes the video watchable.
    if duration < MIN_VIDEO_TIME:
        frames = round(MIN_VIDEO_TIME * FRAME_RATE)
        sections["render"] = {"fps": FRAME_RATE, "frames": frames}
    document = {
        "physgen": 1,
        "size": list(size),
        "world": {**(world or {}), "duration": duration},
        "objects": dict(objects),
    }
    if boundaries:
        document["boundaries"] = dict(boundaries)
    document.update(sections)
    return {key: _round_numbers(value) for key, value in document.items()}


def _round_numbers(value: Any) -> Any:
    """Return a value of a scene file with all its numbers rounded to DECIMALS."""
    if isinstance(value, Mapping):
        return {key: _round_numbers(part) for key, part in value.items()}
    if isinstance(value, list | tuple):
        return list(map(_round_numbers, value))
    if isinstance(value, float):
        return round(float(value), DECIMALS)
    return value


def round_up(duration: float) -> float:
    """Return a duration (s) rounded up to a tenth."""
    # The floor of the negative number rounds up.
    return round(-(-duration * 10 // 1) / 10, 1)


def circle(center: Position, radius: float, **keys: Any) -> Document:
    """Return an object with a circle as its shape."""
    shape = {"center": list_floats(center), "radius": radius}
    return {"shape": {"circle": shape}, **keys}


def box(center: Position, size: Point, angle: float = 0.0, **keys: Any) -> Document:
    """Return an object with a rectangle as its shape; `angle` in degrees."""
    shape: Document = {"center": list_floats(center), "size": list(size)}
    if angle:
        shape["angle"] = angle
    return {"shape": {"box": shape}, **keys}


def segment(begin: Position, end: Position, **keys: Any) -> Document:
    """Return a straight boundary."""
    return {"segment": [list_floats(begin), list_floats(end)], **keys}


def list_floats(position: Position) -> list[float]:
    """Return a point in the file's form, as Python floats."""
    return list(map(float, position))


@dataclass(frozen=True)
class Slope:
    """A straight slope, from its upper end `top` (px) down to the right (`side` 1) or
    to the left (-1).
    """

    top: Point
    tangent: float
    """Tangent of its angle to the horizontal."""
    side: int
    length: float
    """Length from end to end, px."""

    @property
    def angle(self) -> float:
        """Return the angle against the horizontal, rad, positive."""
        return atan(self.tangent)

    @property
    def box_angle(self) -> float:
        """Return the rotation of a box on the slope, degrees."""
        return self.side * degrees(self.angle)

    @property
    def direction(self) -> Point:
        """Return the unit vector down the slope."""
        return self.side * cos(self.angle), sin(self.angle)

    def point(self, distance: float, height: float = 0.0) -> Point:
        """Return the point (px) at a distance from the upper end and a height
        above the surface.
        """
        (dx, dy), (x, y) = self.direction, self.top
        return (
            x + distance * dx + height * dy * self.side,
            y + distance * dy - height * dx * self.side,
        )

    def wall(self, **keys: Any) -> Document:
        """Return the slope as a boundary."""
        return segment(self.point(0), self.point(self.length), **keys)
