"""Thin parts that a mask leaves out: stems, antennas, handles, straps, legs.

A part is narrow, starts at the outline of an object, stands out from what is behind it
on both of its sides, and ends nearby. It belongs to the object; one that is less sure is
reported, so that it does not stay behind unseen.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from physgen.maps import F32
from physgen.perceive.roles import Labels, Mask, Rgb


@dataclass(frozen=True)
class RemainConstants:
    """Constants of the search, tuned on three photos of toys and fruit by eye."""

    smallest: int = 2000  # px of an object: of a smaller one parts are too small to see
    reach: float = 1.2  # of its size (root of its area), around it, that is searched
    wide: float = 0.09  # of its size: the widest part
    narrowest: int = 5  # px: the least of that
    touches: int = 3  # px between a part and the mask
    contrast: float = 22.0  # 8-bit codes by which a part stands out
    clutter: float = 1.6  # times the strongest 5 % of other narrow things around
    report: float = 0.6  # of both limits, from which an unsure part is reported
    longest: float = 0.95  # of the reach: what goes on farther is a line behind
    shortest: float = 0.1  # of its size
    slender: float = 2.5  # length over mean width, at least
    most: int = 4  # parts of an object; more are texture
    share: float = 0.2  # of the object's area, at most


REMAINS = RemainConstants()


@dataclass(frozen=True)
class Remain:
    """A narrow part beside an object."""

    owner: int
    """Id of the object that it starts at."""
    mask: Mask
    """(H, W)."""
    is_sure: bool
    """Whether it belongs to the object; else it is reported."""

    @property
    def place(self) -> tuple[int, int]:
        """Column and row of its middle."""
        rows, columns = np.nonzero(self.mask)
        return int(np.median(columns)), int(np.median(rows))


def find_remains(rgb: Rgb, labels: Labels, ids: Sequence[int]) -> list[Remain]:
    """Return the narrow parts that start at the outlines of objects and end nearby."""
    remains: list[Remain] = []
    for i in ids:
        remains += _remains_of(rgb, labels, i)
    return remains


def _remains_of(rgb: Rgb, labels: Labels, i: int) -> list[Remain]:
    own = labels == i
    area = int(np.count_nonzero(own))
    if area < REMAINS.smallest:
        return []
    size = float(np.sqrt(area))
    reach = round(REMAINS.reach * size)
    x, y, width, height = cv2.boundingRect(own.astype(np.uint8))
    window = np.s_[
        max(y - reach, 0) : y + height + reach, max(x - reach, 0) : x + width + reach
    ]
    mine, others = own[window], (labels[window] > 0) & ~own[window]
    response = _narrow(rgb[window], mine, size)
    away = cv2.distanceTransform((~mine).astype(np.uint8), cv2.DIST_L2, 5)
    free = (away > 1) & (away <= reach) & ~others
    usual = float(np.percentile(response[free], 95)) if free.any() else 0.0
    limit = max(REMAINS.contrast, REMAINS.clutter * usual)
    found = []
    for part in _parts(response, free, away, limit * REMAINS.report, size):
        strength = float(np.median(response[part]))
        full = np.zeros(labels.shape, bool)
        full[window] = part
        found.append(Remain(i, full, strength >= limit))
    found.sort(key=lambda one: -int(np.count_nonzero(one.mask)))
    taken = sum(int(np.count_nonzero(one.mask)) for one in found)
    if len(found) > REMAINS.most or taken > REMAINS.share * area:
        return []
    return found


def _narrow(rgb: Rgb, own: Mask, size: float) -> F32:
    """Return `(h, w)` by how much what is narrow stands out from both of its sides."""
    wide = max(REMAINS.narrowest, round(REMAINS.wide * size)) | 1
    kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (wide, wide))
    beside = _without_object(rgb, own)
    bright = cv2.morphologyEx(beside, cv2.MORPH_TOPHAT, kernel)
    dark = cv2.morphologyEx(beside, cv2.MORPH_BLACKHAT, kernel)
    strength = np.maximum(bright, dark).max(axis=2).astype(np.float32)
    return np.asarray(np.where(own, 0, strength), np.float32)


def _without_object(rgb: Rgb, own: Mask) -> Rgb:
    """Return the photo with the nearest surroundings in place of an object."""
    inside = cv2.dilate(own.astype(np.uint8), np.ones((3, 3), np.uint8))
    _, nearest = cv2.distanceTransformWithLabels(
        inside, cv2.DIST_L2, 5, labelType=cv2.DIST_LABEL_PIXEL
    )
    places = np.zeros((int(nearest.max()) + 1, 2), np.int64)
    outside = inside == 0
    places[nearest[outside]] = np.argwhere(outside)
    source = places[nearest]
    return np.asarray(rgb[source[..., 0], source[..., 1]])


def _parts(
    response: F32, free: Mask, away: F32, limit: float, size: float
) -> list[Mask]:
    """Return the connected narrow parts that start at the object and end nearby."""
    strong = ((response >= limit) & free).astype(np.uint8)
    strong = cv2.morphologyEx(strong, cv2.MORPH_CLOSE, np.ones((3, 3), np.uint8))
    count, pieces, stats, _ = cv2.connectedComponentsWithStats(strong, connectivity=8)
    parts = []
    for k in range(1, count):
        piece = pieces == k
        distance = away[piece]
        length = float(distance.max() - distance.min())
        starts = distance.min() <= REMAINS.touches
        ends = distance.max() <= REMAINS.longest * REMAINS.reach * size
        x, y, width, height, area = stats[k].tolist()
        on_edge = x == 0 or y == 0 or x + width == away.shape[1]
        on_edge = on_edge or y + height == away.shape[0]
        if not (starts and ends) or on_edge:
            continue
        is_long = length >= REMAINS.shortest * size
        if is_long and length * length >= REMAINS.slender * area:
            parts.append(piece)
    return parts
