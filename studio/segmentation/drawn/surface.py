"""What all parts share: the points of a surface, their paint, and laying them on a canvas."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from .canvas import Canvas, Finish, Ints, Pose
from .hand import Array


@dataclass(frozen=True)
class Surface:
    """N visible points of a part, for its paint."""

    own: Array
    """(N, 3) in the thing's own units."""
    u: Array
    """(N,) across: -1..1 round a solid of revolution or over a face; 0 in front."""
    v: Array
    """(N,) along: 0..1 from the foot of a solid of revolution or tube, -1..1 up a face."""
    texel: float
    """Own units per working pixel: finer patterns than this need not be drawn."""


DULL = Finish()
Paint = Callable[[Surface], Array]
"""(N, 3) linear reflectance of N points."""


class Part(Protocol):
    """What a thing is made of."""

    def hull(self) -> Array:
        """(N, 3) points in own units about the part; their bounds are the part's, or a little more."""
        ...

    def draw(self, canvas: Canvas, pose: Pose) -> None: ...


def unit(v: Array) -> Array:
    return (v / max(float(v @ v) ** 0.5, 1e-9)).astype(np.float32)


CORNERS = np.array(
    [[a, b, c] for a in (-1, 1) for b in (-1, 1) for c in (-1, 1)], np.float32
)


def origin() -> Array:
    return np.zeros(3, np.float32)


def up() -> Array:
    return np.array([0, 1, 0], np.float32)


def straight() -> Array:
    return np.eye(3, dtype=np.float32)


def lay(
    canvas: Canvas,
    pose: Pose,
    y: Ints,
    x: Ints,
    z: Array,
    normal: Array,
    uv: tuple[Array, Array],
    paint: Paint,
    finish: Finish,
) -> None:
    """Test N points against the canvas's depth and paint those that are nearer."""
    keep = canvas.nearer(y, x, z)
    if not keep.any():
        return
    if not keep.all():
        y, x, z, normal, uv = (
            y[keep],
            x[keep],
            z[keep],
            normal[keep],
            (uv[0][keep], uv[1][keep]),
        )
    points = np.stack([x.astype(np.float32), y.astype(np.float32), z], axis=1)
    surface = Surface(pose.own(points), uv[0], uv[1], 1 / pose.scale)
    canvas.put(y, x, z, normal, paint(surface), finish)
