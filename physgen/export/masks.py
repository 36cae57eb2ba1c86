"""Masks, boxes and extents of objects in a frame, whole and visible, and their COCO run-length encoding."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.compile.world import Body, World
from physgen.geometry.polygon import cross, rotation
from physgen.render.sprites import Sprite
from physgen.render.stage import Cover, Stage

# ----------------------------------------------------------------------
# Covers and ids of a picture -> where each body is in it: all of it, and what is seen.

Mask = NDArray[np.bool_]
Box = tuple[int, int, int, int]
"""The first column and row, and how many of them."""


@dataclass(frozen=True)
class Presence:
    """One body that reaches into a picture."""

    body: int
    box: Box
    """The least that holds all of it that is in the picture."""
    whole: Mask
    """(h, w) on the box: what hides it taken away."""
    seen: Mask
    """(h, w) on the box: what nothing hides."""

    @cached_property
    def whole_area(self) -> int:
        """px²."""
        return int(np.count_nonzero(self.whole))

    @cached_property
    def seen_area(self) -> int:
        """px²; 0 where it is hidden altogether."""
        return int(np.count_nonzero(self.seen))

    @property
    def visible(self) -> float:
        """Share of what is in the picture that nothing hides, 0..1."""
        return self.seen_area / self.whole_area

    @cached_property
    def seen_box(self) -> Box:
        """The least that holds what is seen; its sides are 0 where nothing is."""
        if self.seen_area == self.whole_area:
            return self.box
        x, y, w, h = _least(self.seen)
        return self.box[0] + x, self.box[1] + y, w, h


def presences(covers: Iterable[Cover], ids: NDArray[np.uint16]) -> list[Presence]:
    """Of the bodies that `covers` name, in their order; those that cover no pixel are none.

    What is seen of a body belongs to it in any case.
    """
    parts: dict[int, list[Cover]] = {}
    for cover in covers:
        if cover.mask.size:
            parts.setdefault(cover.body, []).append(cover)
    found = []
    for body, some in sorted(parts.items()):
        (rows, columns), mask = joined(some)
        seen = ids[rows, columns] == body + 1
        whole = mask | seen
        x, y, w, h = _least(whole)
        if w:
            own = np.s_[y : y + h, x : x + w]
            found.append(Presence(body, (columns.start + x, rows.start + y, w, h), whole[own], seen[own]))
    return found


def joined(covers: Sequence[Cover]) -> tuple[tuple[slice, slice], Mask]:
    """One box and mask (h, w) of all of them."""
    if len(covers) == 1:
        return covers[0].box, covers[0].mask
    rows, columns = (
        slice(min(c.box[axis].start for c in covers), max(c.box[axis].stop for c in covers))
        for axis in (0, 1)
    )
    mask = np.zeros((rows.stop - rows.start, columns.stop - columns.start), bool)
    for (down, along), own in ((cover.box, cover.mask) for cover in covers):
        mask[
            down.start - rows.start : down.stop - rows.start,
            along.start - columns.start : along.stop - columns.start,
        ] |= own
    return (rows, columns), mask


def _least(mask: Mask) -> Box:
    x, y, w, h = cv2.boundingRect(mask.view(np.uint8))
    return x, y, w, h


# ----------------------------------------------------------------------
# What is drawn of bodies at t = 0 -> how large each is, wherever it moves: beyond the picture's borders too.

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


# ----------------------------------------------------------------------
# Masks on their boxes -> run lengths as COCO has them: down the columns, background first (Lin et al., 2014).
#
# Runs are found on the box alone; pycocotools makes characters of them.


def run_lengths(mask: Mask, box: Box, size: tuple[int, int]) -> list[int]:
    """Counts of a mask (h, w) that lies on a `box` of a picture of `size` (W, H); they fill it.

    >>> run_lengths(np.array([[True, True], [False, True]]), (1, 0, 2, 2), (4, 3))
    [3, 1, 2, 2, 4]
    """
    left, top, width, height = box
    down = np.zeros((width, height + 2), bool)
    down[:, 1:-1] = mask.T
    # every column begins and ends outside: an odd change enters the body, an even one leaves it
    column, row = np.nonzero(down[:, 1:] != down[:, :-1])
    at = (left + column) * size[1] + top + row
    if height == size[1]:  # what leaves at a column's foot may go on at the next one's head
        again = np.flatnonzero(at[1:-1:2] == at[2::2]) * 2 + 1
        at = np.delete(at, np.concatenate([again, again + 1]))
    ends = [*at.tolist(), size[0] * size[1]]
    counts = [ends[0], *(end - start for start, end in pairwise(ends))]
    return counts if counts[-1] or len(counts) == 1 else counts[:-1]


def compressed(mask: Mask, box: Box, size: tuple[int, int]) -> str:
    """The same as COCO's characters; as `pycocotools.mask.encode` of the whole picture's mask."""
    from pycocotools import mask as coco

    width, height = size
    plain = {"size": [height, width], "counts": run_lengths(mask, box, size)}
    return str(coco.frPyObjects(plain, height, width)["counts"], "ascii")


# ----------------------------------------------------------------------
# What a picture has of a body -> what it would have if it went on beyond its borders.

CORNER = 0.5
"""px from the corner of a picture to the first pixel's centre, our origin."""
LEAST = 0.5
"""px beyond a border from which on a body is cut: what reaches less far covers no pixel there."""


@dataclass(frozen=True)
class AmodalBox:
    """All of a body."""

    box: tuple[float, float, float, float]
    """x0, y0, x1, y1 px from the picture's corner on; that of its pixels but at borders that it crosses."""
    inside: float
    """Share of it that is in the picture, 0..1."""


def amodal_box(
    extent: Extent | None, pose: Array, lens: Array, size: tuple[int, int], thing: Presence
) -> AmodalBox:
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
    return AmodalBox((sides[0], sides[1], sides[2], sides[3]), inside)
