"""Objects before one plain colour, as in pictures of goods.

Such a ground is known at every pixel, so that an object ends where its colour begins:
the gap below a handle is no part of a bag, and no corner of it stays behind.
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

    frame: float = 0.02  # of the shorter side: the border on which a ground is judged
    even: float = 6.0  # 8-bit codes from its colour, within which a pixel is ground
    share: float = 0.85  # of the frame's pixels that are ground
    unlike: float = 40.0  # codes from it, from which a pixel is none; shadows have less
    stroke: float = (
        0.012  # of an object's size: half the width of a mark of that colour
    )
    contour: float = 0.8  # of a gap's border that is a clear edge
    reach: int = 3  # px to either side of such an edge
    own: float = 0.5  # share of a region unlike the ground that lies in its object
    band: float = 0.05  # of an object's longer side: ground beside it
    gap: float = 0.45  # of its object: the face of a plate or a clock is larger
    most: float = 1.6  # area that an object may have after, over that before


PLAIN = PlainConstants()


def plain_colour(rgb: Rgb) -> NDArray[np.float32] | None:
    """Return the colour (3,) of a photo's plain ground; None if it has none."""
    width = max(1, round(PLAIN.frame * min(rgb.shape[:2])))
    is_frame = np.ones(rgb.shape[:2], bool)
    is_frame[width:-width, width:-width] = False
    frame = rgb[is_frame].astype(np.float32)
    colour = np.median(frame, axis=0)
    is_even = np.abs(frame - colour).max(axis=1) <= PLAIN.even
    return np.asarray(colour) if is_even.mean() >= PLAIN.share else None


def distance_from_ground(rgb: Rgb, colour: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return 8-bit codes (H, W) by which pixels differ from the ground's colour."""
    return np.asarray(np.abs(rgb.astype(np.float32) - colour).max(axis=2))


def cut_out_on_plain(rgb: Rgb, objects: Segments) -> Segments:
    """Return the objects with the borders that a plain ground shows."""
    colour = plain_colour(rgb)
    if colour is None:
        return objects
    distance = distance_from_ground(rgb, colour)
    labels = objects.labels.copy()
    regions = _regions(distance)
    for i in np.unique(labels[labels > 0]).tolist():
        own = labels == i
        whole = own | (_belonging(regions, own) & (labels == 0))
        if whole.sum() <= PLAIN.most * own.sum():
            labels[own] = 0
            labels[_without_gaps(whole, distance) & (labels == 0)] = i
    return replace(objects, labels=labels)


def _regions(distance: NDArray[np.float32]) -> NDArray[np.int32]:
    """Return numbers (H, W) of connected regions unlike the ground; 0 = ground."""
    unlike = (distance > PLAIN.unlike).view(np.uint8)
    closed = cv2.morphologyEx(unlike, cv2.MORPH_CLOSE, np.ones((3, 3), np.uint8))
    _, names = cv2.connectedComponents(closed, connectivity=8)
    return np.asarray(names, np.int32)


def _belonging(regions: NDArray[np.int32], own: Mask) -> Mask:
    """Return the regions (H, W) that lie mostly in an object."""
    areas = np.bincount(regions.ravel())
    inside = np.bincount(regions[own], minlength=len(areas))
    belongs = inside >= PLAIN.own * areas
    belongs[0] = False
    return np.asarray(belongs[regions])


def _without_gaps(whole: Mask, distance: NDArray[np.float32]) -> Mask:
    """Return an object without the gaps in it; marks at its border are closed."""
    gaps = _gaps(whole, distance)
    marks = cv2.morphologyEx(
        (whole & ~gaps).view(np.uint8), cv2.MORPH_CLOSE, _disc(_stroke(whole))
    )
    return np.asarray((marks > 0) & ~gaps)


def _gaps(mask: Mask, distance: NDArray[np.float32]) -> Mask:
    """Return the parts of a mask (H, W) through which the ground is seen.

    Marks of the ground's colour on an object are narrow, and a pale object has no clear
    edge inside.
    """
    is_ground = (mask & (distance <= PLAIN.even)).astype(np.uint8)
    radius = _stroke(mask)
    wide = cv2.morphologyEx(is_ground, cv2.MORPH_OPEN, _disc(radius))
    near = cv2.dilate(wide, np.ones((3, 3), np.uint8), iterations=radius) > 0
    ground = (near & (is_ground > 0)).astype(np.uint8)
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
        if rim.any() and (farthest[rim] > PLAIN.unlike).mean() >= PLAIN.contour:
            gaps |= gap
    return gaps


def _stroke(mask: Mask) -> int:
    """Return half the width (px) of a mark on an object (H, W)."""
    size = float(np.sqrt(max(int(mask.sum()), 1)))
    return max(2, round(PLAIN.stroke * size))


def _disc(radius: int) -> NDArray[np.uint8]:
    size = 2 * radius + 1
    return np.asarray(
        cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (size, size)), np.uint8
    )


def shade_below(rgb: Rgb, labels: NDArray[np.uint16]) -> float:
    """Return 8-bit codes by which plain ground is darker below objects than around.

    What stands on a plain ground has its shade or its mirror image below it; what lies
    on it has shade at other sides, too. 0 without a plain ground.
    """
    colour = plain_colour(rgb)
    own = labels > 0
    if colour is None or not own.any():
        return 0.0
    left, top, width, height = cv2.boundingRect(own.view(np.uint8))
    band = max(2, round(PLAIN.band * max(width, height)))
    rows, columns = slice(top, top + height), slice(left, left + width)
    places = (
        np.s_[top + height : top + height + band, columns],
        np.s_[max(0, top - band) : top, columns],
        np.s_[rows, max(0, left - band) : left],
        np.s_[rows, left + width : left + width + band],
    )
    distance = distance_from_ground(rgb, colour)
    shades = [float(np.median(distance[at])) for at in places if distance[at].size]
    if len(shades) < len(places):
        return 0.0
    return max(0.0, shades[0] - max(shades[1:]))


def shows_ground_beyond(rgb: Rgb, own: Mask, near: int) -> bool:
    """Return whether plain ground lies between an object (H, W) and each border nearby.

    `near` px from a border, an object may be cut off by it; not if ground is seen there.
    """
    colour = plain_colour(rgb)
    if colour is None:
        return False
    is_ground = distance_from_ground(rgb, colour) <= PLAIN.even
    sides = (
        (own[: near + 1].any(axis=0), is_ground[0]),
        (own[-near - 1 :].any(axis=0), is_ground[-1]),
        (own[:, : near + 1].any(axis=1), is_ground[:, 0]),
        (own[:, -near - 1 :].any(axis=1), is_ground[:, -1]),
    )
    return all(bool(ground[beside].all()) for beside, ground in sides)
