"""What is drawn of bodies at t = 0 -> how large each is, wherever it moves: beyond the picture's borders too."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.compile.world import Body, World
from physgen.export.presence import joined
from physgen.geometry import cross, rotation
from physgen.render.sprites import Sprite
from physgen.render.stage import Cover, Stage

Array = NDArray[np.float64]

SMALLER = 0.97
"""Of the upright box's area that a tilted one has at most: what is about round stays upright."""
PIXEL = np.array([[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5]])
"""Its corners, about its centre."""


@dataclass(frozen=True)
class Extent:
    """Of one body as it is drawn; px of the photo about its centre of mass, as it stands at t = 0."""

    corners: Array
    """(4, 2): the box that holds it, from its top left on, clockwise as it is seen."""
    hull: Array
    """(K, 2): corners of the convex shape around its pixels."""
    area: float
    """px²."""
    turns: bool
    """With its pose. A ball's picture does not: its skin turns."""

    def corners_at(self, pose: Array, lens: Array) -> Array:
        """(4, 2) video px, of a pose (3,) seen through a `lens` (2, 3); an edge turns as the body does."""
        return self._moved(self.corners, pose, lens)

    def reach_at(self, pose: Array, lens: Array) -> tuple[float, float, float, float]:
        """x0, y0, x1, y1 video px: the upright box around it."""
        points = self._moved(self.hull, pose, lens)
        (x0, y0), (x1, y1) = points.min(axis=0).tolist(), points.max(axis=0).tolist()
        return x0, y0, x1, y1

    def area_at(self, lens: Array) -> float:
        """px² of the video."""
        return self.area * float(np.linalg.det(lens[:, :2]))

    def _moved(self, points: Array, pose: Array, lens: Array) -> Array:
        turned = points @ rotation(float(pose[2])).T if self.turns else points
        return np.asarray((turned + pose[:2]) @ lens[:, :2].T + lens[:, 2])


def extents(stage: Stage, world: World) -> list[Extent | None]:
    """One a body; None where nothing is drawn of it."""
    sprites: dict[int, list[Sprite]] = {}
    for sprite in stage.sprites:
        sprites.setdefault(sprite.body, []).append(sprite)
    return [_extent(body, sprites.get(k, ()), stage.scale) for k, body in enumerate(world.bodies)]


def _extent(body: Body, sprites: Sequence[Sprite], scale: float) -> Extent | None:
    drawn = []
    for sprite in sprites:
        (x, y), (height, width) = sprite.corner, sprite.coverage.shape
        drawn.append(Cover(sprite.body, np.s_[y : y + height, x : x + width], sprite.coverage >= 0.5))
    if not any(cover.mask.any() for cover in drawn):
        return None
    (rows, columns), mask = joined(drawn)
    pixels = np.asarray(cv2.findNonZero(mask.view(np.uint8)))
    around = (cv2.convexHull(pixels).reshape(-1, 1, 2) + PIXEL).reshape(-1, 2)
    photo = (around + np.array([columns.start, rows.start]) + 0.5) / scale - 0.5
    if body.rest is not None:
        photo = (photo - body.rest[:2]) @ rotation(float(body.rest[2])) + body.center
    hull = cv2.convexHull((photo - body.center).astype(np.float32)).reshape(-1, 2).astype(np.float64)
    return Extent(
        _box(hull), hull, len(pixels) / scale**2, not all(sprite.ball is not None for sprite in sprites)
    )


def _box(hull: Array) -> Array:
    """(4, 2): the smallest box around it, upright where that is about as small."""
    (x0, y0), (x1, y1) = hull.min(axis=0), hull.max(axis=0)
    upright = np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1]])
    rectangle = cv2.minAreaRect(hull.astype(np.float32))
    if np.prod(rectangle[1]) > SMALLER * (x1 - x0) * (y1 - y0):
        return upright
    corners = cv2.boxPoints(rectangle).astype(np.float64)
    if cross(corners[1] - corners[0], corners[2] - corners[1]) < 0:
        corners = corners[::-1]
    # the top edge is the one that points most to the right
    edges = np.roll(corners, -1, axis=0) - corners
    return np.roll(corners, -int(np.argmax(edges[:, 0])), axis=0)
