"""A frame as paper for overlays: where it shows the photo's pixels, how thick a pen and how large a letter are."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from physgen.render.ink import Layer

Array = NDArray[np.float64]

PEN = 1 / 380
"""Of the picture's longer side: the width of a line."""
LETTER = 1 / 42
"""Of the picture's longer side: the size of a letter."""


@dataclass(frozen=True)
class Sheet:
    """One frame."""

    size: tuple[int, int]
    """W, H px."""
    unit: float
    """px of the frame for a px of the photo, seen whole: what lengths of arrows and rings are given in."""
    lens: Array
    """(2, 3): photo px (x, y, 1) -> px of the frame."""
    time: float
    """s."""
    sample: int
    """Of the trajectory."""

    @property
    def pen(self) -> float:
        """px: width of a line."""
        return max(1.3, PEN * max(self.size))

    @property
    def letter(self) -> float:
        """px: size of a letter."""
        return max(10.0, LETTER * max(self.size))

    @property
    def zoom(self) -> float:
        """px of the frame for a px of the photo, now."""
        return float(np.sqrt(abs(np.linalg.det(self.lens[:, :2]))))

    def at(self, points: Array) -> Array:
        """Points (..., 2) of the photo -> px of the frame."""
        return np.asarray(points @ self.lens[:, :2].T + self.lens[:, 2])

    def way(self, vectors: Array) -> Array:
        """Lengths and directions (..., 2) in px of the photo -> px of the frame: turned as the frame is, not zoomed.

        So the key stays as it is while a camera moves in.
        """
        return np.asarray(vectors @ self.lens[:, :2].T * (self.unit / max(self.zoom, 1e-9)))

    def sees(self, point: Array) -> bool:
        """Whether a point (2,) px of the frame is in it."""
        return bool((point >= -0.5).all() and (point <= np.array(self.size) - 0.5).all())

    def layer(self) -> Layer:
        """An empty layer of ink."""
        return Layer(self.size, 0.75 * self.pen)
