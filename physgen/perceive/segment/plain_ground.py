"""Objects in front of one plain colour, as in product pictures.

Such a ground is known at every pixel, so that an object ends where the ground's colour
begins: the gap below a handle is not part of a bag, and none of its corners is missed.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.perceive.roles import Segments

Mask = NDArray[np.bool_]
Rgb = NDArray[np.uint8]


@dataclass(frozen=True)
class PlainConstants:
    """Constants of plain grounds, chosen on a bag and drawings."""

    # Width of the border in which the ground is tested, over the shorter side.
    frame: float = 0.02
    # 8-bit levels: largest difference of ground from its colour.
    ground_difference: float = 6.0
    # Least share of ground in the frame.
    share: float = 0.85
    # Levels: least difference of an object from that colour; shadows have less.
    object_difference: float = 40.0
    # Half the width of a mark of that colour over an object's size.
    stroke: float = 0.012
    # Least share of a gap's border with a clear edge.
    contour: float = 0.8
    # px on both sides of such an edge.
    reach: int = 3
    # Least share of a region unlike the ground inside its object.
    object_share: float = 0.5
    # Width of the ground beside an object over the object's longer side.
    band: float = 0.05
    # Largest area of a gap over its object's: the face of a plate or a clock is larger.
    gap: float = 0.45
    # Largest ratio of an object's areas after and before.
    largest_ratio: float = 1.6


PLAIN = PlainConstants()


def plain_colour(rgb: Rgb) -> NDArray[np.float32] | None:
    """Return the colour (3,) of a photo's plain ground, or None if it has none."""
    width = max(1, round(PLAIN.frame * min(rgb.shape[:2])))
    is_frame = np.ones(rgb.shape[:2], bool)
    is_frame[width:-width, width:-width] = False
    frame = rgb[is_frame].astype(np.float32)
    colour = np.median(frame, axis=0)
    ground_mask = np.abs(frame - colour).max(axis=1) <= PLAIN.ground_difference
    if ground_mask.mean() >= PLAIN.share:
        return np.asarray(colour)
    return None


def distance_from_ground(rgb: Rgb, colour: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return the difference (H, W) of pixels from the ground's colour, 8-bit levels."""
    return np.asarray(np.abs(rgb.astype(np.float32) - colour).max(axis=2))


def cut_out_on_plain(rgb: Rgb, objects: Segments) -> Segments:
    """Return the objects with borders where the plain ground begins."""
    colour = plain_colour(rgb)
    if colour is None:
        return objects
    distance = distance_from_ground(rgb, colour)
    labels = objects.labels.copy()
    regions = _regions(distance)
    for i in np.unique(labels[labels > 0]).tolist():
        mask = labels == i
        full_mask = mask | (_belonging(regions, mask) & (labels == 0))
        if full_mask.sum() <= PLAIN.largest_ratio * mask.sum():
            labels[mask] = 0
            labels[_without_gaps(full_mask, distance) & (labels == 0)] = i
    return replace(objects, labels=labels)


def _regions(distance: NDArray[np.float32]) -> NDArray[np.int32]:
    """Return numbers (H, W) of connected regions unlike the ground; 0 is ground."""
    foreground = (distance > PLAIN.object_difference).view(np.uint8)
    closed_mask = cv2.morphologyEx(
        foreground, cv2.MORPH_CLOSE, np.ones((3, 3), np.uint8)
    )
    _, names = cv2.connectedComponents(closed_mask, connectivity=8)
    return np.asarray(names, np.int32)


def _belonging(regions: NDArray[np.int32], mask: Mask) -> Mask:
    """Return the regions (H, W) that lie mostly in an object."""
    areas = np.bincount(regions.ravel())
    inside = np.bincount(regions[mask], minlength=len(areas))
    belongs = inside >= PLAIN.object_share * areas
    belongs[0] = False
    return np.asarray(belongs[regions])


def _without_gaps(mask: Mask, distance: NDArray[np.float32]) -> Mask:
    """Return an object without its gaps; marks at its border are closed."""
    gaps = _gaps(mask, distance)
    marks = cv2.morphologyEx(
        (mask & ~gaps).view(np.uint8), cv2.MORPH_CLOSE, _disc(_stroke(mask))
    )
    return np.asarray((marks > 0) & ~gaps)


def _gaps(mask: Mask, distance: NDArray[np.float32]) -> Mask:
    """Return the parts of a mask (H, W) through which the ground is visible.

    Marks of the ground's colour on an object are narrow, and a pale object has no clear
    edge inside.
    """
    is_ground = (mask & (distance <= PLAIN.ground_difference)).astype(np.uint8)
    radius = _stroke(mask)
    opened_mask = cv2.morphologyEx(is_ground, cv2.MORPH_OPEN, _disc(radius))
    ground_region = (
        cv2.dilate(opened_mask, np.ones((3, 3), np.uint8), iterations=radius) > 0
    )
    ground = (ground_region & (is_ground > 0)).astype(np.uint8)
    count, names = cv2.connectedComponents(ground, connectivity=4)
    square = np.ones((2 * PLAIN.reach + 1, 2 * PLAIN.reach + 1), np.uint8)
    farthest = cv2.dilate(distance, square)
    inner = cv2.erode(mask.astype(np.uint8), square) > 0
    gaps = np.zeros_like(mask)
    for k in range(1, count):
        gap = names == k
        if gap.sum() > PLAIN.gap * mask.sum():
            continue
        rim = gap & ~(cv2.erode(gap.view(np.uint8), np.ones((3, 3), np.uint8)) > 0)
        rim &= inner
        if (
            rim.any()
            and (farthest[rim] > PLAIN.object_difference).mean() >= PLAIN.contour
        ):
            gaps |= gap
    return gaps


def _stroke(mask: Mask) -> int:
    """Return half the width of a mark on an object (H, W), px."""
    size = float(np.sqrt(max(int(mask.sum()), 1)))
    return max(2, round(PLAIN.stroke * size))


def _disc(radius: int) -> NDArray[np.uint8]:
    size = 2 * radius + 1
    return np.asarray(
        cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (size, size)), np.uint8
    )


def shade_below(rgb: Rgb, labels: NDArray[np.uint16]) -> float:
    """Return by how many levels plain ground is darker below objects than around them.

    An object on a plain ground has its shade or mirror image below it; an object seen
    from above has shade on other sides as well. The result is 0 without a plain ground.
    """
    colour = plain_colour(rgb)
    object_mask = labels > 0
    if colour is None or not object_mask.any():
        return 0.0
    left, top, width, height = cv2.boundingRect(object_mask.view(np.uint8))
    band = max(2, round(PLAIN.band * max(width, height)))
    rows = slice(top, top + height)
    columns = slice(left, left + width)
    places = (
        np.s_[top + height : top + height + band, columns],
        np.s_[max(0, top - band) : top, columns],
        np.s_[rows, max(0, left - band) : left],
        np.s_[rows, left + width : left + width + band],
    )
    distance = distance_from_ground(rgb, colour)
    shades = []
    for band_window in places:
        if distance[band_window].size:
            shades.append(float(np.median(distance[band_window])))
    if len(shades) < len(places):
        return 0.0
    return max(0.0, shades[0] - max(shades[1:]))


def shows_ground_beyond(rgb: Rgb, mask: Mask, margin: int) -> bool:
    """Return whether plain ground lies between an object (H, W) and each near border.

    An object within `margin` px of a border may be cut off by it, unless ground is
    visible in between.
    """
    colour = plain_colour(rgb)
    if colour is None:
        return False
    is_ground = distance_from_ground(rgb, colour) <= PLAIN.ground_difference
    sides = (
        (mask[: margin + 1].any(axis=0), is_ground[0]),
        (mask[-margin - 1 :].any(axis=0), is_ground[-1]),
        (mask[:, : margin + 1].any(axis=1), is_ground[:, 0]),
        (mask[:, -margin - 1 :].any(axis=1), is_ground[:, -1]),
    )
    return all(bool(ground[side_pixels].all()) for side_pixels, ground in sides)
