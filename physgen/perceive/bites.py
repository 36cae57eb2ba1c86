"""Bites in masks: a base ring, a joint or a rim that the cut-out of an object misses.

A network draws the object in a box and marks the pixels of all objects of the photo.
Each of the two maps alone is too unsure: the first one ends early at dark and shiny
parts, the second one includes neighbours and mirror images. A region beside the mask is
filled if both maps support it, if it differs from the ground around it, if its colour
is not that of shaded ground, and if it does not stick out of the object.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.maps import F32
from physgen.perceive.roles import Labels, Mask, Rgb
from physgen.perceive.segment.network import (
    box_of,
    follow_edges,
    object_chances,
    run_network,
)

Box = tuple[float, float, float, float]
"""Left, top, right, bottom px."""


@dataclass(frozen=True)
class BiteConstants:
    """Constants of the search, tuned on half of 86 labelled objects.

    The size of an object is the root of its area.
    """

    # px: longer side of an object's surroundings in the search.
    side: int = 300
    # Width of these surroundings over the object's size.
    surroundings: float = 0.4
    # Largest distance of a bite's pixels from the mask over the object's size.
    reach: float = 0.13
    # Least area of an object over the photo's.
    least_area: float = 0.01
    # Number of searched objects, the largest ones.
    objects: int = 5
    # Chances of the object at the border of a bite: the lowest level gives the
    # largest bites, and each higher level separates bites from the soft outline.
    levels: tuple[float, ...] = (0.15, 0.25, 0.35, 0.5)
    # Least mean chance in a bite, and its least difference from the level.
    chance: float = 0.28
    height: float = 0.1
    # Additional chance of a bite with the colour of shaded ground.
    shade_chance: float = 0.07
    # Probability that a pixel is on any object: least value, and least mean of a bite.
    foreground: float = 0.55
    mean_foreground: float = 0.7
    # Least width of a bite over the object's size.
    width: float = 0.02
    # Largest area of a bite over the object's.
    largest: float = 0.05
    # Largest ratio of a bite's new outline to the outline that it closes.
    convex: float = 1.2
    # Largest contact with other objects over the contact with its own object: a larger
    # one is a gap between objects, or a part of the others.
    shared_contact: float = 0.3
    # px at reduced size: distance that counts as contact with another object.
    contact_distance: int = 2
    # 8-bit levels: least median difference from the ground's mean colour.
    colour_difference: float = 20.0
    # 8-bit levels: a smaller difference is ground, seen through a gap.
    ground_colour: float = 12.0
    # Width of the average of the ground over the reach.
    ground: float = 0.8
    # Colour channels of shaded ground over those of the ground: largest and least
    # ratio, and largest difference between the channels.
    brightest: float = 1.03
    darkest: float = 0.45
    tint: float = 0.12
    # px at reduced size: width of the filter that moves borders to edges.
    edge_radius: int = 5
    # Blur of the border over the object's size.
    smoothing: float = 0.008
    # px at reduced size: largest shift of a border.
    shift: int = 2


BITES = BiteConstants()


def fill_bites(photo: Rgb, labels: Labels) -> Labels:
    """Return the label map (H, W) with bites in the masks of large objects filled."""
    result = labels.copy()
    foreground = None
    for label in _large_objects(labels):
        if foreground is None:
            foreground = run_network(photo).foreground
        box = _surroundings(labels == label)
        bites = _bites(photo, result, label, box, foreground)
        free = result[box] == 0
        result[box][bites & free] = label
    return result


def _large_objects(labels: Labels) -> Iterator[int]:
    """Yield the ids of the objects that are large enough, the largest first."""
    areas = np.bincount(labels.ravel())
    areas[0] = 0
    order = np.argsort(-areas, kind="stable")[: BITES.objects]
    for label in order.tolist():
        if areas[label] >= BITES.least_area * labels.size:
            yield label


def _surroundings(mask: Mask) -> tuple[slice, slice]:
    """Return rows and columns of an object (H, W) and its surroundings."""
    margin = round(BITES.surroundings * float(np.sqrt(np.count_nonzero(mask))))
    left, top, right, bottom = box_of(mask)
    rows = slice(max(0, top - margin), min(mask.shape[0], bottom + margin))
    columns = slice(max(0, left - margin), min(mask.shape[1], right + margin))
    return rows, columns


def _bites(
    photo: Rgb,
    labels: Labels,
    label: int,
    box: tuple[slice, slice],
    foreground: F32,
) -> Mask:
    """Return the bites (h, w) of an object in the `box` of its surroundings."""
    object_mask = labels[box] == label
    height, width = object_mask.shape
    scale = min(1.0, BITES.side / max(height, width))
    size = max(1, round(width * scale)), max(1, round(height * scale))
    chances, crop = object_chances(photo, box_of(labels == label))
    photo_box = 0.0, 0.0, float(photo.shape[1]), float(photo.shape[0])
    top = float(box[0].start)
    left = float(box[1].start)
    window = left, top, left + width, top + height
    surroundings = _Surroundings(
        np.asarray(cv2.resize(photo[box], size, interpolation=cv2.INTER_AREA)),
        _reduce(object_mask, size),
        _reduce((labels[box] > 0) & ~object_mask, size),
        _resample(chances, crop, window, size),
        _resample(foreground, photo_box, window, size),
    )
    bites = surroundings.bites()
    if not bites.any():
        return np.zeros_like(object_mask)
    return _sharpen(photo[box], object_mask, surroundings, bites)


def _sharpen(
    photo: Rgb, object_mask: Mask, surroundings: _Surroundings, bites: Mask
) -> Mask:
    """Return bites (h, w) with borders along the edges of a photo (H, W), at its size.

    The object and its bites are enlarged together, so that no slit remains.
    """
    joint_mask = (bites | surroundings.object_mask).astype(np.float32)
    weights = follow_edges(surroundings.photo, joint_mask, BITES.edge_radius)
    weights = np.asarray(cv2.resize(weights, object_mask.shape[::-1]), np.float32)
    coverage = (weights[..., :3] * photo).sum(axis=-1) + weights[..., 3]
    coverage = np.clip(np.where(object_mask, 1, coverage), 0, 1).astype(np.float32)
    sigma = BITES.smoothing * float(np.sqrt(np.count_nonzero(object_mask)))
    zone = _enlarge(_dilate(bites, BITES.shift), object_mask.shape)
    return np.asarray((_blur(coverage, sigma) >= 0.5) & zone & ~object_mask)


def _reduce(mask: Mask, size: tuple[int, int]) -> Mask:
    small_mask = cv2.resize(mask.view(np.uint8), size, interpolation=cv2.INTER_NEAREST)
    return np.asarray(small_mask > 0)


def _enlarge(mask: Mask, shape: tuple[int, ...]) -> Mask:
    large_mask = cv2.resize(mask.astype(np.float32), shape[1::-1])
    return np.asarray(large_mask >= 0.5)


def _resample(values: F32, source: Box, window: Box, size: tuple[int, int]) -> F32:
    """Return a map of the box `source` on a grid of `size` (w, h) over a `window`.

    Pixels outside the source are 0.
    """
    rows = []
    for axis in (0, 1):
        step = (window[axis + 2] - window[axis]) / size[axis]
        cell = (source[axis + 2] - source[axis]) / values.shape[1 - axis]
        first = (window[axis] + step / 2 - source[axis]) / cell - 0.5
        row = [0.0, 0.0, first]
        row[axis] = step / cell
        rows.append(row)
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    return np.asarray(cv2.warpAffine(values, np.array(rows), size, flags=flags))


def _dilate(mask: Mask, radius: int) -> Mask:
    square = np.ones((2 * radius + 1, 2 * radius + 1), np.uint8)
    return np.asarray(cv2.dilate(mask.view(np.uint8), square) > 0)


def _erode(mask: Mask) -> Mask:
    square = np.ones((3, 3), np.uint8)
    return np.asarray(cv2.erode(mask.view(np.uint8), square) > 0)


@dataclass(frozen=True)
class _Surroundings:
    """An object and its surroundings at reduced size, (h, w)."""

    photo: Rgb
    object_mask: Mask
    neighbours: Mask
    """Pixels of other objects."""
    chances: F32
    """0..1: probability of the object."""
    foreground: F32
    """0..1: probability of any object."""

    @property
    def size(self) -> float:
        """Return the root of the object's area, px."""
        return float(np.sqrt(np.count_nonzero(self.object_mask)))

    def bites(self) -> Mask:
        """Return the pixels (h, w) of all bites."""
        result = np.zeros_like(self.object_mask)
        if not self.object_mask.any():
            return result
        distance = np.asarray(
            cv2.distanceTransform((~self.object_mask).view(np.uint8), cv2.DIST_L2, 5),
            np.float32,
        )
        colour, ground = self._colours(distance)
        contrast = np.abs(colour - ground).max(axis=2)
        shade = _is_shade(colour, ground)
        for level in BITES.levels:
            for piece in self._pieces(distance, level):
                least_chance = max(BITES.chance, level + BITES.height)
                if np.median(shade[piece]):
                    least_chance += BITES.shade_chance
                if (
                    self._closes_outline(piece)
                    and self.chances[piece].mean() >= least_chance
                    and self.foreground[piece].mean() >= BITES.mean_foreground
                    and np.median(contrast[piece]) >= BITES.colour_difference
                ):
                    result |= piece
        return np.asarray(result & (contrast >= BITES.ground_colour))

    def _pieces(self, distance: F32, level: float) -> Iterator[Mask]:
        """Yield regions (h, w) beside the object with a chance above a level.

        `distance` (h, w) is the distance from the object, px.
        """
        is_free = ~self.object_mask & ~self.neighbours
        is_within_reach = distance <= max(3.0, BITES.reach * self.size)
        is_object = (self.chances > level) & (self.foreground > BITES.foreground)
        region = (is_free & is_within_reach & is_object).view(np.uint8)
        # Odd, since OpenCV shifts the result of even kernels.
        width = 2 * max(1, round(BITES.width * self.size / 2)) + 1
        square = np.ones((width, width), np.uint8)
        opened_mask = cv2.morphologyEx(region, cv2.MORPH_OPEN, square)
        count, names = cv2.connectedComponents(opened_mask, connectivity=8)
        for k in range(1, count):
            yield names == k

    def _closes_outline(self, piece: Mask) -> bool:
        """Return whether a piece is not too large and barely lengthens the outline."""
        if np.count_nonzero(piece) > BITES.largest * self.size**2:
            return False
        seam = int(np.count_nonzero(piece & _dilate(self.object_mask, 1)))
        neighbourhood = _dilate(self.neighbours, BITES.contact_distance)
        contact = int(np.count_nonzero(piece & neighbourhood))
        if not seam or contact > BITES.shared_contact * seam:
            return False
        border = piece & ~_erode(piece) & ~_dilate(self.object_mask, 2)
        return int(np.count_nonzero(border)) <= BITES.convex * seam

    def _colours(self, distance: F32) -> tuple[F32, F32]:
        """Return the colours (h, w, 3) of pixels and of the ground nearby, 8-bit levels.

        The ground is the average of the pixels beyond the reach of bites. `distance`
        (h, w) is the distance from the object, px.
        """
        reach = max(3.0, BITES.reach * self.size)
        share = ((distance > reach) & ~self.neighbours).astype(np.float32)
        photo = self.photo.astype(np.float32)
        sigma = max(3.0, BITES.ground * reach)
        total = _blur(photo * share[..., None], sigma)
        ground = total / (_blur(share, sigma)[..., None] + 1e-4)
        return np.asarray(cv2.blur(photo, (3, 3)), np.float32), ground


def _is_shade(colour: F32, ground: F32) -> Mask:
    """Return the pixels (h, w) with the colour of shaded ground."""
    ratio = colour / np.maximum(ground, 1)
    high = ratio.max(axis=2)
    low = ratio.min(axis=2)
    is_darker = (high < BITES.brightest) & (low > BITES.darkest)
    return np.asarray(is_darker & (high - low < BITES.tint))


def _blur(values: NDArray[np.float32], sigma: float) -> F32:
    return np.asarray(cv2.GaussianBlur(values, (0, 0), sigma), np.float32)
