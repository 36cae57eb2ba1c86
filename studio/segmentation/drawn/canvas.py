"""A small depth-buffered canvas on which one thing is drawn: what is visible of it, with colour, normal and finish."""

from __future__ import annotations

from dataclasses import dataclass, field

import cv2
import numpy as np
from numpy.typing import NDArray

from .hand import Array

Ints = NDArray[np.intp]


@dataclass(frozen=True)
class Pose:
    """Where a thing stands before the camera: +x right, +y down, +z to the viewer, all in pixels."""

    turn: Array
    """(3, 3) from the thing's own axes to the camera's."""
    at: Array
    """(3,) px, of the thing's origin."""
    scale: float
    """Px per unit of the thing's own measure."""

    def apply(self, points: Array) -> Array:
        """(N, 3) own units -> (N, 3) px before the camera."""
        return (points @ self.turn.T) * np.float32(self.scale) + self.at

    def own(self, points: Array) -> Array:
        """(N, 3) px -> own units."""
        return ((points - self.at) / np.float32(self.scale)) @ self.turn


@dataclass(frozen=True)
class Finish:
    """How a surface answers light beyond its colour."""

    gloss: float = 0.0
    """Strength of highlights, 0..1."""
    sharpness: float = 30.0
    """Exponent of the highlight."""
    metal: float = 0.0
    """Share of the colour that comes from mirroring the room."""
    clear: float = 0.0
    """Share of light that passes through."""

    def row(self) -> Array:
        return np.array(
            [self.gloss, np.log(self.sharpness), self.metal, self.clear], np.float32
        )


@dataclass
class Canvas:
    """(h, w) working pixels; integer coordinates are pixel centres."""

    height: int
    width: int
    depth: Array = field(init=False)
    normal: Array = field(init=False)
    colour: Array = field(init=False)
    finish: Array = field(init=False)

    def __post_init__(self) -> None:
        shape = (self.height, self.width)
        self.depth = np.full(shape, -np.inf, np.float32)
        self.normal = np.zeros((*shape, 3), np.float32)
        self.colour = np.zeros((*shape, 3), np.float32)
        self.finish = np.zeros((*shape, 4), np.float32)

    def window(self, low: Array, high: Array) -> tuple[int, int, int, int]:
        """The box x0, y0, x1, y1 of whole pixels that holds (low, high), within the canvas; may be empty."""
        x0, y0 = max(0, int(low[0]) - 1), max(0, int(low[1]) - 1)
        return (
            x0,
            y0,
            min(self.width, int(high[0]) + 2),
            min(self.height, int(high[1]) + 2),
        )

    def nearer(self, y: Ints, x: Ints, depth: Array) -> NDArray[np.bool_]:
        return depth > self.depth.ravel()[y * self.width + x]

    def put(
        self,
        y: Ints,
        x: Ints,
        depth: Array,
        normal: Array,
        colour: Array,
        finish: Finish,
    ) -> None:
        """Set N pixels, which the caller found to be nearer; normal and colour are (N, 3)."""
        at = y * self.width + x  # one flat index is found quicker than two
        self.depth.reshape(-1)[at] = depth
        self.normal.reshape(-1, 3)[at] = normal
        self.colour.reshape(-1, 3)[at] = colour
        self.finish.reshape(-1, 4)[at] = finish.row()


@dataclass(frozen=True)
class Sprite:
    """A drawn thing at the picture's own resolution, h x w pixels from (x0, y0)."""

    x0: int
    y0: int
    cover: Array
    """(h, w) 0..1."""
    depth: Array
    """(h, w) px to the viewer, means something where cover > 0."""
    normal: Array
    colour: Array
    finish: Array


def reduced(canvas: Canvas, x0: int, y0: int, fine: int) -> Sprite:
    """The canvas with blocks of `fine` x `fine` pixels averaged over what is covered in them."""
    mask = np.isfinite(canvas.depth).astype(np.float32)
    canvas.depth[mask == 0] = 0
    if fine == 1:
        return _softened(canvas, mask, x0, y0)
    size = (canvas.width // fine, canvas.height // fine)

    def shrink(values: Array) -> Array:
        return cv2.resize(values, size, interpolation=cv2.INTER_AREA)

    cover = shrink(mask)
    share = 1 / np.maximum(cover, 1e-3)
    normal = _facing(shrink(canvas.normal))
    return Sprite(
        x0,
        y0,
        cover,
        shrink(canvas.depth) * share,
        normal,
        shrink(canvas.colour) * share[..., None],
        shrink(canvas.finish) * share[..., None],
    )


def _softened(canvas: Canvas, mask: Array, x0: int, y0: int) -> Sprite:
    """Not drawn larger and reduced: the outline alone is spread over the pixels beside it."""

    def spread(values: Array) -> Array:
        return cv2.GaussianBlur(values, (3, 3), 0.55)

    cover = spread(mask)
    y, x = np.nonzero((mask == 0) & (cover > 0.01))
    share = 1 / cover[y, x]
    maps = []
    for values in (canvas.depth, canvas.normal, canvas.colour, canvas.finish):
        wide = spread(values)[y, x]
        values[y, x] = wide * (share if values.ndim == 2 else share[:, None])
        maps.append(values)
    return Sprite(x0, y0, cover, maps[0], _facing(maps[1]), maps[2], maps[3])


def _facing(normal: Array) -> Array:
    """Unit normals of what is seen: none points away from the viewer."""
    np.maximum(normal[..., 2], 0.01, out=normal[..., 2])
    normal /= np.sqrt(np.einsum("ijk,ijk->ij", normal, normal))[..., None]
    return normal
