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
    around: float = 0.4
    # Largest distance of a bite's pixels from the mask over the object's size.
    reach: float = 0.13
    # Least area of an object over the photo's.
    least: float = 0.01
    # Number of searched objects, the largest ones.
    objects: int = 5
    # Chances of the object at the border of a bite: the lowest level gives the
    # largest bites, and each higher level separates bites from the soft outline.
    levels: tuple[float, ...] = (0.15, 0.25, 0.35, 0.5)
    # Least mean chance in a bite, and its least difference from the level.
    chance: float = 0.28
    above: float = 0.1
    # Additional chance of a bite with the colour of shaded ground.
    shaded: float = 0.07
    # Foreground of any object: least value of a pixel, and least mean of a bite.
    foreground: float = 0.55
    mean_foreground: float = 0.7
    # Least width of a bite over the object's size.
    width: float = 0.02
    # Smallest and largest area of a bite over the object's.
    smallest: float = 0.001
    largest: float = 0.05
    # px at reduced size: least area of a bite.
    pixels: int = 8
    # Largest ratio of a bite's new outline to the outline that it closes.
    convex: float = 1.2
    # Largest contact with other objects over the contact with its own object: a larger
    # one is a gap between objects, or a part of the others.
    shared: float = 0.3
    # px at reduced size: distance that counts as contact with another object.
    apart: int = 2
    # 8-bit levels: least median difference from the ground's mean colour.
    unlike: float = 20.0
    # 8-bit levels: a smaller difference is ground, seen through a gap.
    ground_colour: float = 12.0
    # Width of the average of the ground over the reach.
    ground: float = 0.8
    # Colour channels of shaded ground over those of the ground: largest and least
    # ratio, and largest difference between the channels.
    brightest: float = 1.03
    darkest: float = 0.45
    tint: float = 0.12
    # Share of such pixels in a bite that looks like shade.
    shade: float = 0.6
    # px at reduced size, and 8-bit levels: width and noise of the filter that moves
    # borders to edges.
    edge_radius: int = 5
    edge_noise: float = 8.0
    # Blur of the border over the object's size.
    smoothing: float = 0.008
    # px at reduced size: largest shift of a border.
    nearby: int = 2


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
        if areas[label] >= BITES.least * labels.size:
            yield label


def _surroundings(own: Mask) -> tuple[slice, slice]:
    """Return rows and columns of an object (H, W) and its surroundings."""
    margin = round(BITES.around * float(np.sqrt(np.count_nonzero(own))))
    left, top, right, bottom = box_of(own)
    rows = slice(max(0, top - margin), min(own.shape[0], bottom + margin))
    columns = slice(max(0, left - margin), min(own.shape[1], right + margin))
    return rows, columns


def _bites(
    photo: Rgb,
    labels: Labels,
    label: int,
    box: tuple[slice, slice],
    foreground: F32,
) -> Mask:
    """Return the bites (h, w) of an object in the `box` of its surroundings."""
    own = labels[box] == label
    height, width = own.shape
    scale = min(1.0, BITES.side / max(height, width))
    size = max(1, round(width * scale)), max(1, round(height * scale))
    chances, crop = object_chances(photo, box_of(labels == label))
    photo_box = 0.0, 0.0, float(photo.shape[1]), float(photo.shape[0])
    top, left = float(box[0].start), float(box[1].start)
    window = left, top, left + width, top + height
    surroundings = _Surroundings(
        np.asarray(cv2.resize(photo[box], size, interpolation=cv2.INTER_AREA)),
        _reduce(own, size),
        _reduce((labels[box] > 0) & ~own, size),
        _resample(chances, crop, window, size),
        _resample(foreground, photo_box, window, size),
    )
    bites = surroundings.bites()
    if not bites.any():
        return np.zeros_like(own)
    return _sharpen(photo[box], own, surroundings, bites)


def _sharpen(photo: Rgb, own: Mask, surroundings: _Surroundings, bites: Mask) -> Mask:
    """Return bites (h, w) with borders along the edges of a photo (H, W), at its size.

    The object and its bites are enlarged together, so that no slit remains.
    """
    size = own.shape[1], own.shape[0]
    joint_mask = (bites | surroundings.own).astype(np.float32)
    affine = follow_edges(
        surroundings.photo, joint_mask, BITES.edge_radius, BITES.edge_noise
    )
    affine = np.asarray(cv2.resize(affine, size), np.float32)
    coverage = (affine[..., :3] * photo).sum(axis=-1) + affine[..., 3]
    coverage = np.clip(np.where(own, 1, coverage), 0, 1).astype(np.float32)
    sigma = BITES.smoothing * float(np.sqrt(np.count_nonzero(own)))
    nearby = _enlarge(_dilate(bites, BITES.nearby), own.shape)
    return np.asarray((_blur(coverage, sigma) >= 0.5) & nearby & ~own)


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
    own: Mask
    others: Mask
    """Pixels of other objects."""
    chances: F32
    """0..1: probability of the object."""
    foreground: F32
    """0..1: probability of any object."""

    def bites(self) -> Mask:
        """Return the pixels (h, w) of all bites."""
        result = np.zeros_like(self.own)
        size = float(np.sqrt(np.count_nonzero(self.own)))
        if not size:
            return result
        reach = max(3.0, BITES.reach * size)
        distance = cv2.distanceTransform((~self.own).view(np.uint8), cv2.DIST_L2, 5)
        band = (distance <= reach) & ~self.own & ~self.others
        ground = (distance > reach) & ~self.others
        # Odd, since OpenCV shifts the result of even kernels.
        width = 2 * max(1, round(BITES.width * size / 2)) + 1
        square = np.ones((width, width), np.uint8)
        unlike, shade = self._compare_with_ground(ground, reach)
        for level in BITES.levels:
            region = band & (self.chances > level)
            region &= self.foreground > BITES.foreground
            opened_mask = cv2.morphologyEx(
                region.view(np.uint8), cv2.MORPH_OPEN, square
            )
            count, names = cv2.connectedComponents(opened_mask, connectivity=8)
            for k in range(1, count):
                piece = names == k
                if not self._closes_outline(piece, size):
                    continue
                least_chance = max(BITES.chance, level + BITES.above)
                if shade[piece].mean() > BITES.shade:
                    least_chance += BITES.shaded
                if (
                    self.chances[piece].mean() >= least_chance
                    and self.foreground[piece].mean() >= BITES.mean_foreground
                    and float(np.median(unlike[piece])) >= BITES.unlike
                ):
                    result |= piece
        result &= unlike >= BITES.ground_colour
        return np.asarray(
            cv2.morphologyEx(result.view(np.uint8), cv2.MORPH_OPEN, square) > 0
        )

    def _closes_outline(self, piece: Mask, size: float) -> bool:
        """Return whether a piece has a bite's area and barely lengthens the outline."""
        area = np.count_nonzero(piece)
        least_area = max(float(BITES.pixels), BITES.smallest * size**2)
        if not least_area <= area <= BITES.largest * size**2:
            return False
        seam = int(np.count_nonzero(piece & _dilate(self.own, 1)))
        shared = int(np.count_nonzero(piece & _dilate(self.others, BITES.apart)))
        if not seam or shared > BITES.shared * seam:
            return False
        border = piece & ~_erode(piece) & ~_dilate(self.own, 2)
        return int(np.count_nonzero(border)) <= BITES.convex * seam

    def _compare_with_ground(self, ground: Mask, reach: float) -> tuple[F32, Mask]:
        """Return the difference (h, w) from the ground, 8-bit levels, and shade.

        The ground is the average colour of its pixels nearby; `reach` is in px.
        """
        share = ground.astype(np.float32)
        sigma = max(3.0, BITES.ground * reach)
        photo = self.photo.astype(np.float32)
        total = _blur(photo * share[..., None], sigma)
        average = total / (_blur(share, sigma)[..., None] + 1e-4)
        colour = np.asarray(cv2.blur(photo, (3, 3)), np.float32)
        unlike = np.abs(colour - average).max(axis=2)
        ratio = colour / np.maximum(average, 1)
        brightest, darkest = ratio.max(axis=2), ratio.min(axis=2)
        shade = (brightest < BITES.brightest) & (darkest > BITES.darkest)
        shade &= brightest - darkest < BITES.tint
        return np.asarray(unlike, np.float32), np.asarray(shade)


def _blur(values: NDArray[np.float32], sigma: float) -> F32:
    return np.asarray(cv2.GaussianBlur(values, (0, 0), sigma), np.float32)
