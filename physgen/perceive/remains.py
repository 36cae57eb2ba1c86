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

    side: int = 800  # px: longer side of the photo when it is searched
    smallest: int = 2000  # px of an object: of a smaller one parts are too small to see
    reach: float = 1.2  # of its size (root of its area), around it, that is searched
    wide: float = 0.09  # of its size: the widest part
    narrowest: int = 5  # px: the least of that
    touches: int = 3  # px between a part and the mask
    contrast: float = 22.0  # 8-bit codes by which a part stands out
    clutter: float = 1.6  # times the strongest 5 % of other narrow things around
    even: float = 14.0  # 8-bit codes within which a background is plain
    plain: float = 0.55  # share of the surroundings that is so near to one colour
    unlike: float = 40.0  # 8-bit codes from that colour to a part
    sharp: float = 12.0  # 8-bit codes per px at the border of a part; shadows have less
    as_sharp: float = 0.6  # of the object's own border, from which a part is as sharp
    softest: float = 4.0  # 8-bit codes per px of that, at least
    as_unlike: float = (
        0.7  # of what the object's border differs, from which a part does
    )
    drops: int = 3  # fits of the ground's colours, each without what is unlike the last
    least_share: float = 0.004  # of the object's area, that such a part has
    most_share: float = 0.4
    alike: float = 30.0  # 8-bit codes between two colours that look alike
    rare: float = 0.02  # share of the surroundings that may look like a part
    report: float = 0.8  # of both limits, from which an unsure part is reported
    levels: tuple[float, ...] = (0.8, 1.0, 1.5)
    """Of the limit: at a low one a part is joined to lines behind it, at a high one torn."""
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
    height, width = labels.shape
    scale = min(1.0, REMAINS.side / max(height, width))
    size = (max(round(width * scale), 1), max(round(height * scale), 1))
    area, nearest = cv2.INTER_AREA, cv2.INTER_NEAREST_EXACT
    small = np.asarray(cv2.resize(rgb, size, interpolation=area), np.uint8)
    small_labels = np.asarray(
        cv2.resize(labels, size, interpolation=nearest), np.uint16
    )
    remains: list[Remain] = []
    for i in ids:
        for remain in _remains_of(small, small_labels, i):
            mask = cv2.resize(
                remain.mask.astype(np.uint8),
                (width, height),
                interpolation=nearest,
            )
            is_free = (labels == 0) & (mask > 0)
            if is_free.any():
                remains.append(Remain(i, is_free, remain.is_sure))
    return remains


def attach_remains(
    labels: Labels, remains: Sequence[Remain]
) -> tuple[Labels, list[Remain]]:
    """Return the label map with sure parts as their objects', and the unsure parts."""
    attached = labels.copy()
    unsure = []
    for remain in remains:
        if remain.is_sure:
            attached[remain.mask & (attached == 0)] = remain.owner
        else:
            unsure.append(remain)
    return attached, unsure


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
    away = cv2.distanceTransform((~mine).astype(np.uint8), cv2.DIST_L2, 5)
    free = (away > 1) & (away <= reach) & ~others
    if not free.any():
        return []
    beside = cv2.dilate(others.astype(np.uint8), np.ones((7, 7), np.uint8)) > 0
    candidates = []
    for response in _narrow(rgb[window], mine, size):
        usual = float(np.percentile(response[free], 95))
        limit = max(REMAINS.contrast, REMAINS.clutter * usual)
        for level in REMAINS.levels:
            for part in _parts(response, free, away, limit * level, size):
                if not (part & beside).any():
                    strength = float(np.median(response[part])) / limit
                    candidates.append((strength, part))
    found = []
    taken = np.zeros_like(mine)
    for part in _unlike_plain(rgb[window], mine, free, away):
        if not (part & beside).any():
            taken |= part
            full = np.zeros(labels.shape, bool)
            full[window] = part
            found.append(Remain(i, full, True))
    narrow_area = 0
    for strength, part in sorted(candidates, key=lambda one: -one[0]):
        if (part & taken).any():
            continue
        taken |= part
        narrow_area += int(np.count_nonzero(part))
        is_sure = strength >= 1 and _is_rare(rgb[window], part, free & ~part)
        if not is_sure and np.count_nonzero(part) < REMAINS.least_share * area:
            continue
        full = np.zeros(labels.shape, bool)
        full[window] = part
        found.append(Remain(i, full, is_sure))
    if len(found) > REMAINS.most or narrow_area > REMAINS.share * area:
        return []
    return found


def _unlike_plain(rgb: Rgb, own: Mask, free: Mask, away: F32) -> list[Mask]:
    """Return parts of any width that start at an object before a plain ground.

    The ground may be shaded evenly. Shadows and reflections have softer borders than
    the object and are not parts.
    """
    off = _off_ground(rgb, free)
    if float((off[free] < REMAINS.even).mean()) < REMAINS.plain:
        return []
    unlike = ((off > _least_unlike(off, own)) & free).astype(np.uint8)
    closed = cv2.morphologyEx(unlike, cv2.MORPH_CLOSE, np.ones((5, 5), np.uint8))
    count, pieces, stats, _ = cv2.connectedComponentsWithStats(closed, connectivity=8)
    slope = _slope(rgb)
    area = int(np.count_nonzero(own))
    sharp = _border_sharpness(slope, off, away)
    parts = []
    for k in range(1, count):
        piece = pieces == k
        size = int(stats[k, cv2.CC_STAT_AREA])
        if not REMAINS.least_share * area <= size <= REMAINS.most_share * area:
            continue
        starts = away[piece].min() <= REMAINS.touches
        ends = away[piece].max() <= REMAINS.longest * REMAINS.reach * np.sqrt(area)
        if not (starts and ends):
            continue
        inner = cv2.erode(piece.astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
        border = piece & ~inner & (away > 2 * REMAINS.touches)
        if border.any() and float(np.median(slope[border])) >= sharp:
            parts.append(piece & (away > 0))
    return parts


def _off_ground(rgb: Rgb, free: Mask) -> F32:
    """Return `(h, w)` 8-bit codes from a photo to the shaded colour of its ground.

    The colour is a polynomial of degree two in the position.
    """
    height, width = free.shape
    x, y = np.meshgrid(np.linspace(-1, 1, width), np.linspace(-1, 1, height))
    terms = np.stack([np.ones_like(x), x, y, x * x, x * y, y * y], axis=-1)
    colours = rgb.astype(np.float64)
    colour = np.median(rgb[free], axis=0)
    off = np.abs(colours - colour).max(axis=2)
    limit = REMAINS.unlike
    for _ in range(REMAINS.drops):
        ground = free & (off < limit)
        if np.count_nonzero(ground) < REMAINS.plain * np.count_nonzero(free):
            break
        weights, *_ = np.linalg.lstsq(terms[ground], colours[ground], rcond=None)
        off = np.abs(colours - terms @ weights).max(axis=2)
        limit = 2 * REMAINS.even
    return off.astype(np.float32)


def _least_unlike(off: F32, own: Mask) -> float:
    """Return the 8-bit codes by which parts of an object differ from its ground.

    What is dark differs by more than the shadow at its feet.
    """
    inner = cv2.erode(own.astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
    deep = cv2.erode(own.astype(np.uint8), np.ones((9, 9), np.uint8)) > 0
    border = off[inner & ~deep]
    if not border.size:
        return REMAINS.unlike
    return max(REMAINS.unlike, REMAINS.as_unlike * float(np.median(border)))


def _border_sharpness(slope: F32, off: F32, away: F32) -> float:
    """Return the slope, 8-bit codes per px, from which a part's border is sharp.

    That of a part out of focus is as soft as the border of its object.
    """
    band = (away > 0) & (away <= 2 * REMAINS.touches)
    unlike = cv2.dilate((off > REMAINS.unlike).astype(np.uint8), np.ones((3, 3))) > 0
    own = slope[band & unlike]
    if not own.size:
        return REMAINS.sharp
    as_own = REMAINS.as_sharp * float(np.median(own))
    return float(np.clip(as_own, REMAINS.softest, REMAINS.sharp))


def _slope(rgb: Rgb) -> F32:
    """Return `(h, w)` 8-bit codes per px by which a photo changes."""
    grey = cv2.cvtColor(rgb, cv2.COLOR_RGB2GRAY).astype(np.float32)
    across = cv2.Sobel(grey, cv2.CV_32F, 1, 0) / 8
    down = cv2.Sobel(grey, cv2.CV_32F, 0, 1) / 8
    return np.hypot(across, down)


def _is_rare(rgb: Rgb, part: Mask, around: Mask) -> bool:
    """Return whether hardly anything around has the colour of a part.

    A gap between boards looks like the other gaps.
    """
    colour = np.median(rgb[part], axis=0)
    off = np.abs(rgb[around].astype(np.float32) - colour).max(axis=1)
    return float((off < REMAINS.alike).mean()) < REMAINS.rare


def _narrow(rgb: Rgb, own: Mask, size: float) -> list[F32]:
    """Return by how much what is narrow stands out from both of its sides.

    Pictures `(h, w)`: brighter and darker in each channel. An orange antenna is the only
    thing darker in blue than the sky and the road behind it.
    """
    wide = max(REMAINS.narrowest, round(REMAINS.wide * size)) | 1
    kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (wide, wide))
    beside = _without_object(rgb, own)
    bright = cv2.morphologyEx(beside, cv2.MORPH_TOPHAT, kernel)
    dark = cv2.morphologyEx(beside, cv2.MORPH_BLACKHAT, kernel)
    responses = [*cv2.split(bright), *cv2.split(dark)]
    return [np.where(own, 0, one).astype(np.float32) for one in responses]


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
    closed = cv2.morphologyEx(strong, cv2.MORPH_CLOSE, np.ones((3, 3), np.uint8))
    count, pieces, stats, _ = cv2.connectedComponentsWithStats(closed, connectivity=8)
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
