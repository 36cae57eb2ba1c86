"""Masks, boxes and extents of objects in a frame, whole and visible, and their COCO run-length encoding."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.compile.world import Body, World
from physgen.geometry.polygon import cross, rotation
from physgen.render.sprites import Sprite
from physgen.render.stage import Cover, Stage

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Box = tuple[int, int, int, int]
"""First column, first row, width and height, px."""

TILT_GAIN = 0.97
"""A tilted box is used where its area is below this part of the upright one's: round objects stay upright."""
PIXEL_CORNERS = np.array([[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5]])
"""px about a pixel's centre."""
CORNER = 0.5
"""px from the corner of a picture to the first pixel's centre, which is our origin."""
CROSSING = 0.5
"""px beyond a border from which on an object counts as cut: a smaller part covers no pixel."""


@dataclass(frozen=True)
class Presence:
    """One body that reaches into a frame."""

    body: int
    box: Box
    """The smallest that holds all of the body inside the frame."""
    whole: Mask
    """(h, w) on the box: hidden parts included."""
    seen: Mask
    """(h, w) on the box: the visible part."""

    @cached_property
    def whole_area(self) -> int:
        """px²."""
        return int(np.count_nonzero(self.whole))

    @cached_property
    def seen_area(self) -> int:
        """px²; 0 where the body is hidden completely."""
        return int(np.count_nonzero(self.seen))

    @property
    def visible(self) -> float:
        """Visible share of what is in the frame, 0..1."""
        return self.seen_area / self.whole_area

    @cached_property
    def seen_box(self) -> Box:
        """The smallest that holds the visible part; width and height are 0 where there is none."""
        x, y, w, h = _bounding_box(self.seen)
        return self.box[0] + x, self.box[1] + y, w, h


def presences(covers: Iterable[Cover], ids: NDArray[np.uint16]) -> list[Presence]:
    """One for each body that covers a pixel, in the order of the ids; visible pixels always belong to their body."""
    parts: dict[int, list[Cover]] = {}
    for cover in covers:
        if cover.mask.size:
            parts.setdefault(cover.body, []).append(cover)
    found = []
    for body, some in sorted(parts.items()):
        (rows, columns), mask = _joined(some)
        seen = ids[rows, columns] == body + 1
        whole = mask | seen
        x, y, w, h = _bounding_box(whole)
        if w:
            own = np.s_[y : y + h, x : x + w]
            found.append(Presence(body, (columns.start + x, rows.start + y, w, h), whole[own], seen[own]))
    return found


def _joined(covers: Sequence[Cover]) -> tuple[tuple[slice, slice], Mask]:
    """One box and mask (h, w) of all of them."""
    if len(covers) == 1:
        return covers[0].box, covers[0].mask
    top, left = (min(c.box[axis].start for c in covers) for axis in (0, 1))
    bottom, right = (max(c.box[axis].stop for c in covers) for axis in (0, 1))
    mask = np.zeros((bottom - top, right - left), bool)
    for cover in covers:
        rows, columns = cover.box
        mask[rows.start - top : rows.stop - top, columns.start - left : columns.stop - left] |= cover.mask
    return np.s_[top:bottom, left:right], mask


def _bounding_box(mask: Mask) -> Box:
    x, y, w, h = cv2.boundingRect(mask.view(np.uint8))
    return x, y, w, h


@dataclass(frozen=True)
class Extent:
    """Size of one body as drawn; px of the photo about its centre of mass, as it stands at t = 0."""

    corners: Array
    """(4, 2): the box that holds it, clockwise as seen, from its top left on."""
    hull: Array
    """(K, 2): corners of the convex hull of its pixels."""
    area: float
    """px²."""
    turns: bool
    """With its pose; the picture of a ball does not, its skin turns instead."""

    def corners_at(self, pose: Array, lens: Array) -> Array:
        """(4, 2) video px, for a pose (3,) seen through a `lens` (2, 3)."""
        return self._moved(self.corners, pose, lens)

    def bounds_at(self, pose: Array, lens: Array) -> tuple[float, float, float, float]:
        """x0, y0, x1, y1 video px of the upright box around it."""
        points = self._moved(self.hull, pose, lens)
        (x0, y0), (x1, y1) = points.min(axis=0).tolist(), points.max(axis=0).tolist()
        return x0, y0, x1, y1

    def _moved(self, points: Array, pose: Array, lens: Array) -> Array:
        turned = points @ rotation(float(pose[2])).T if self.turns else points
        return np.asarray((turned + pose[:2]) @ lens[:, :2].T + lens[:, 2])


def extents(stage: Stage, world: World) -> list[Extent | None]:
    """One per body; None where nothing of it is drawn."""
    sprites: dict[int, list[Sprite]] = {}
    for sprite in stage.sprites:
        sprites.setdefault(sprite.body, []).append(sprite)
    return [_extent(body, sprites.get(k, ()), stage.scale) for k, body in enumerate(world.bodies)]


def _extent(body: Body, sprites: Sequence[Sprite], scale: float) -> Extent | None:
    covers = []
    for sprite in sprites:
        (x, y), (height, width) = sprite.corner, sprite.coverage.shape
        covers.append(Cover(sprite.body, np.s_[y : y + height, x : x + width], sprite.coverage >= 0.5))
    if not any(cover.mask.any() for cover in covers):
        return None
    (rows, columns), mask = _joined(covers)
    pixels = np.asarray(cv2.findNonZero(mask.view(np.uint8)))
    outline = (cv2.convexHull(pixels).reshape(-1, 1, 2) + PIXEL_CORNERS).reshape(-1, 2)
    photo = (outline + np.array([columns.start, rows.start]) + 0.5) / scale - 0.5
    if body.rest is not None:
        photo = (photo - body.rest[:2]) @ rotation(float(body.rest[2])) + body.center
    hull = cv2.convexHull((photo - body.center).astype(np.float32)).reshape(-1, 2).astype(np.float64)
    turns = not all(sprite.ball is not None for sprite in sprites)
    return Extent(_oriented_box(hull), hull, len(pixels) / scale**2, turns)


def _oriented_box(hull: Array) -> Array:
    """(4, 2): the smallest box around it, upright where that is about as small."""
    (x0, y0), (x1, y1) = hull.min(axis=0), hull.max(axis=0)
    rectangle = cv2.minAreaRect(hull.astype(np.float32))
    if np.prod(rectangle[1]) > TILT_GAIN * (x1 - x0) * (y1 - y0):
        return np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1]])
    corners = cv2.boxPoints(rectangle).astype(np.float64)
    if cross(corners[1] - corners[0], corners[2] - corners[1]) < 0:
        corners = corners[::-1]
    # the top edge is the one that points most to the right
    edges = np.roll(corners, -1, axis=0) - corners
    return np.roll(corners, -int(np.argmax(edges[:, 0])), axis=0)


def amodal_box(
    extent: Extent | None, pose: Array, lens: Array, size: tuple[int, int], presence: Presence
) -> tuple[tuple[float, float, float, float], float]:
    """x0, y0, x1, y1 px from the picture's corner, beyond its borders too, and the share of the body inside, 0..1.

    What the photo's own border cuts off at t = 0 is not known and not counted.
    """
    x, y, w, h = presence.box
    sides = [float(x), float(y), float(x + w), float(y + h)]
    borders = (0, 0, *size)
    inside = 1.0
    if extent is not None and any(side == border for side, border in zip(sides, borders, strict=True)):
        bounds = extent.bounds_at(pose, lens)
        for k, (border, far, out) in enumerate(zip(borders, bounds, (-1, -1, 1, 1), strict=True)):
            if sides[k] == border and (far + CORNER - border) * out > CROSSING:
                sides[k] = far + CORNER
                inside = min(1.0, presence.whole_area / (extent.area * float(np.linalg.det(lens[:, :2]))))
    return (sides[0], sides[1], sides[2], sides[3]), inside


def compressed(mask: Mask, box: Box, size: tuple[int, int]) -> str:
    """COCO's compressed run lengths of a mask (h, w) that lies on a `box` of a picture of `size` (W, H)."""
    from pycocotools import mask as coco

    x, y, w, h = box
    picture = np.zeros((size[1], size[0]), np.uint8, order="F")
    picture[y : y + h, x : x + w] = mask
    return str(coco.encode(picture)["counts"], "ascii")
