"""Scene + label map -> what its masks and shapes are: whose pixels are whose, and the outlines that fit them.

No mass, coefficient, velocity or force counts here: scenes that differ in these alone share one result.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from math import radians, sqrt

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.compile.masks import object_labels
from physgen.compile.reach import beyond
from physgen.compile.walls import Fitted, fit_masks
from physgen.geometry import rotation
from physgen.outline.outline import Disc, Outline, Region, Ring
from physgen.scene.model import Box, Circle, Polygon, Scene, Shape

U16 = NDArray[np.uint16]

SEEN = 0.08
"""Of a mask's size (root of its area): how far it may reach beyond the hull of its shape and still be its own.

A shape is the section through the plane of motion; the photo also shows a top, an inside or a rim nearer the lens.
"""
THIN = 5
"""px: threads and wires narrower than this move with their object and need no shape."""


@dataclass(frozen=True, eq=False)
class Shapes:
    """Of a scene's N objects, and of those of its boundaries that are masks."""

    written: tuple[Outline | None, ...]
    """Outlines as the file has them; None where one is fitted, or the shape is none."""
    masked: tuple[bool, ...]
    """Which objects have a mask."""
    labels: U16
    """(H, W): id k + 1 is the k-th object; 0 = background."""
    fits: Fitted

    @property
    def outlines(self) -> tuple[Outline, ...]:
        """Written or fitted, photo frame."""
        return tuple(self.fits.objects[k + 1] if it is None else it for k, it in enumerate(self.written))

    @cached_property
    def missed(self) -> tuple[float, ...]:
        """Part of each object's mask that its written shape misses, 0..1."""
        return tuple(
            _missed(outline, self.labels == k + 1) if outline is not None and masked else 0.0
            for k, (outline, masked) in enumerate(zip(self.written, self.masked, strict=True))
        )


def shapes_of(scene: Scene, labels: U16 | None) -> Shapes:
    """`labels` (H, W) is the photo's label map, None for a scene without one. Raises InputError."""
    written = [_written(item.shape) for item in scene.objects]
    of_objects = object_labels(scene, labels, written)
    fits = fit_masks(scene, labels, of_objects, [k + 1 for k, it in enumerate(written) if it is None])
    masked = tuple(item.mask is not None for item in scene.objects)
    return Shapes(tuple(written), masked, of_objects, fits)


def _written(shape: Shape) -> Outline | None:
    """Outline of an explicit shape; None for `auto`."""
    match shape:
        case Circle(center=center, radius=radius):
            return Disc(np.array(center, np.float64), float(radius))
        case Box(center=center, size=(width, height), angle=angle):
            corners = np.array([[-width, -height], [width, -height], [width, height], [-width, height]]) / 2
            return Region((Ring(corners @ rotation(radians(angle)).T + center, ()),))
        case Polygon(rings=rings):
            return Region(
                tuple(
                    Ring(np.array(r.outline, np.float64), tuple(np.array(h, np.float64) for h in r.holes))
                    for r in rings
                )
            )
        case _:
            return None


def _missed(outline: Outline, mask: NDArray[np.bool_]) -> float:
    rows, columns = np.nonzero(mask)
    away = beyond(outline, np.stack([columns, rows], axis=-1).astype(np.float64))
    beyond_it = np.zeros(mask.shape, np.uint8)
    beyond_it[rows, columns] = away > SEEN * sqrt(len(away))
    thick = cv2.morphologyEx(beyond_it, cv2.MORPH_OPEN, np.ones((THIN, THIN), np.uint8))
    return float(np.count_nonzero(thick) / max(len(away), 1))
