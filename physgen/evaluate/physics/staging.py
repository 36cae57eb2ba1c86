"""Parts of a scene as plain data: bodies, walls and slopes with every number where the scene file has it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import atan, cos, degrees, sin
from typing import Any

import numpy as np
from numpy.typing import NDArray

from physgen.evaluate.physics.scorecard import Document

Point = tuple[float, float]
At = Sequence[float] | NDArray[np.float64]
"""x px, y px."""

GRAVITY = 980.0
"""px/s²: 9.8 m/s² at the default of 100 px a meter."""

SHOWN = 2.0
"""s of video, at least."""

INERTIA = {"disc": 1 / 2, "sphere": 2 / 5, "hoop": 1.0}
"""k of I = k m r²."""


def scene(
    size: tuple[int, int],
    duration: float,
    objects: Mapping[str, Document],
    boundaries: Mapping[str, Document] | None = None,
    world: Mapping[str, Any] | None = None,
    **more: Any,
) -> Document:
    """A whole scene; `duration` s is rounded up to a tenth. `world` and `more` hold further keys.

    What is shorter than two seconds is shown in two seconds. Numbers keep nine decimals: what a reader can stand, and
    less than any gap that a row draws.
    """
    lasts = whole(duration)
    if lasts < SHOWN:
        more["render"] = {"fps": 30, "frames": round(SHOWN * 30)}
    document = {
        "physgen": 1,
        "size": list(size),
        "world": {**(world or {}), "duration": lasts},
        "objects": dict(objects),
        **({"boundaries": dict(boundaries)} if boundaries else {}),
        **more,
    }
    return {key: _rounded(value) for key, value in document.items()}


def _rounded(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {key: _rounded(part) for key, part in value.items()}
    if isinstance(value, list | tuple):
        return [_rounded(part) for part in value]
    return round(float(value), 9) if isinstance(value, float) else value


def whole(duration: float) -> float:
    """s, rounded up to a tenth."""
    return round(-(-duration * 10 // 1) / 10, 1)


def circle(center: At, radius: float, **keys: Any) -> Document:
    """An object with a circle for a shape."""
    return {"shape": {"circle": {"center": points(center), "radius": radius}}, **keys}


def box(center: At, size: Point, angle: float = 0.0, **keys: Any) -> Document:
    """An object with a rectangle for a shape; `angle` in degrees."""
    shape = {
        "center": points(center),
        "size": list(size),
        **({"angle": angle} if angle else {}),
    }
    return {"shape": {"box": shape}, **keys}


def segment(a: At, b: At, **keys: Any) -> Document:
    """A boundary from a to b."""
    return {"segment": [points(a), points(b)], **keys}


def points(at: At) -> list[float]:
    """A point as the file holds it: floats of Python."""
    return [float(value) for value in at]


@dataclass(frozen=True)
class Slope:
    """A straight way down, from its upper end `top` (px) to the right (`side` 1) or to the left (-1)."""

    top: Point
    tangent: float
    """Of its angle against the horizontal."""
    side: int
    length: float
    """px along it."""

    @property
    def angle(self) -> float:
        """rad against the horizontal, positive."""
        return atan(self.tangent)

    @property
    def turned(self) -> float:
        """degrees by which a box that lies on it is turned."""
        return self.side * degrees(self.angle)

    @property
    def down(self) -> Point:
        """Unit vector down the slope."""
        return self.side * cos(self.angle), sin(self.angle)

    def point(self, along: float, above: float = 0.0) -> Point:
        """px: so far down from the upper end, so far above the surface."""
        (dx, dy), (x, y) = self.down, self.top
        return (
            x + along * dx + above * dy * self.side,
            y + along * dy - above * dx * self.side,
        )

    def wall(self, **keys: Any) -> Document:
        """The boundary itself."""
        return segment(self.point(0), self.point(self.length), **keys)
