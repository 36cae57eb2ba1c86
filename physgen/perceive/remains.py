"""Thin parts that a mask misses: stems, antennas, handles, straps, legs.

A part is narrow, starts at the outline of an object, stands out from the background on
both sides and ends nearby. A confident part is added to the object; a doubtful one is
reported, so that the user sees that it would stay behind.
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

    # px: longer side of the photo in the search.
    side: int = 800
    # px of an object: parts of smaller objects are too small to detect.
    smallest: int = 2000
    # Width of the searched surroundings over the object's size (root of its area).
    reach: float = 1.2
    # Largest width of a part over the object's size.
    wide: float = 0.09
    # px: least value of that width.
    narrowest: int = 5
    # px: largest gap between a part and the mask.
    touches: int = 3
    # Least contrast of a part, 8-bit levels.
    contrast: float = 22.0
    # Least contrast as a multiple of the strongest 5 % of other narrow structures.
    clutter: float = 1.6
    # 8-bit levels: largest variation of a plain background.
    even: float = 14.0
    # Least share of the surroundings with one plain colour.
    plain: float = 0.55
    # 8-bit levels: least difference of a part from that colour.
    unlike: float = 40.0
    # 8-bit levels per px at the border of a part; shadows have softer borders.
    sharp: float = 12.0
    # Least sharpness of a part over that of the object's own border.
    as_sharp: float = 0.6
    # 8-bit levels per px: least value of that sharpness.
    softest: float = 4.0
    # Least difference of a part from the background over that of the object's border.
    as_unlike: float = 0.7
    # Fits of the background's colours, each without the outliers of the last one.
    drops: int = 3
    # Least area of such a part as a share of the object's.
    least_share: float = 0.004
    most_share: float = 0.4
    # 8-bit levels: largest difference between similar colours.
    alike: float = 30.0
    # Largest share of the surroundings with the colour of a part.
    rare: float = 0.02
    # Least share of both limits at which a doubtful part is reported.
    report: float = 0.8
    levels: tuple[float, ...] = (0.8, 1.0, 1.5)
    """Multiples of the limit: at a low one a part merges with lines behind it, at a
    high one it breaks.
    """
    # Largest distance of its end over the reach: longer structures are lines in the
    # background.
    longest: float = 0.95
    # Least length over the object's size.
    shortest: float = 0.1
    # Least ratio of length to mean width.
    slender: float = 2.5
    # Largest number of parts of an object; more are texture.
    most: int = 4
    # Largest total area as a share of the object's.
    share: float = 0.2
    # Lowest share of the object's height: a flat part in it is a line on the ground.
    foot: float = 0.1


REMAINS = RemainConstants()


@dataclass(frozen=True)
class Remain:
    """A narrow part beside an object."""

    owner: int
    """Id of the object at its start."""
    mask: Mask
    """(H, W)."""
    is_sure: bool
    """Whether it is added to the object; otherwise it is reported."""

    @property
    def place(self) -> tuple[int, int]:
        """Return column and row of its middle."""
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
    """Return the label map with confident parts added to their objects, and the other
    parts.
    """
    result = labels.copy()
    doubtful_parts = []
    for remain in remains:
        if remain.is_sure:
            result[remain.mask & (result == 0)] = remain.owner
        else:
            doubtful_parts.append(remain)
    return result, doubtful_parts


def _remains_of(rgb: Rgb, labels: Labels, i: int) -> list[Remain]:
    """Return the narrow parts of object `i`."""
    mask = labels == i
    area = int(np.count_nonzero(mask))
    if area < REMAINS.smallest:
        return []
    size = float(np.sqrt(area))
    reach = round(REMAINS.reach * size)
    x, y, width, height = cv2.boundingRect(mask.astype(np.uint8))
    window = np.s_[
        max(y - reach, 0) : y + height + reach, max(x - reach, 0) : x + width + reach
    ]
    window_mask, others = mask[window], (labels[window] > 0) & ~mask[window]
    distance = cv2.distanceTransform((~window_mask).astype(np.uint8), cv2.DIST_L2, 5)
    free = (distance > 1) & (distance <= reach) & ~others
    if not free.any():
        return []
    near_others = cv2.dilate(others.astype(np.uint8), np.ones((7, 7), np.uint8)) > 0
    candidates = []
    # Several levels are tried, because no single limit separates parts from all
    # backgrounds.
    for response in _measure_narrow_contrast(rgb[window], window_mask, size):
        usual = float(np.percentile(response[free], 95))
        limit = max(REMAINS.contrast, REMAINS.clutter * usual)
        for level in REMAINS.levels:
            for part in _parts(response, free, distance, limit * level, size):
                if not (part & near_others).any():
                    strength = float(np.median(response[part])) / limit
                    candidates.append((strength, part))
    remains = []
    used_mask = np.zeros_like(window_mask)
    # On a plain background a part may also be wide.
    for part in _find_parts_on_plain(rgb[window], window_mask, free, distance):
        if not (part & near_others).any():
            used_mask |= part
            full = np.zeros(labels.shape, bool)
            full[window] = part
            remains.append(Remain(i, full, True))
    narrow_area = 0
    for strength, part in sorted(candidates, key=lambda one: -one[0]):
        if (part & used_mask).any():
            continue
        used_mask |= part
        narrow_area += int(np.count_nonzero(part))
        is_confident = strength >= 1 and _is_rare(rgb[window], part, free & ~part)
        is_confident = is_confident and not _lies_at_foot(part, window_mask)
        if not is_confident and np.count_nonzero(part) < REMAINS.least_share * area:
            continue
        full = np.zeros(labels.shape, bool)
        full[window] = part
        remains.append(Remain(i, full, is_confident))
    # Many parts, or large ones, are the texture of the background.
    if len(remains) > REMAINS.most or narrow_area > REMAINS.share * area:
        return []
    return remains


def _lies_at_foot(part: Mask, own: Mask) -> bool:
    """Return whether a part lies flat beside the foot of an object (h, w).

    For example, a streak on a tray or a seam between boards is no part of a vase: the
    vase would collide by it.
    """
    own_rows = np.flatnonzero(own.any(axis=1))
    height = int(np.ptp(own_rows)) + 1
    rows, columns = np.nonzero(part)
    is_low = rows.min() > own_rows[-1] - REMAINS.foot * height
    return bool(is_low and np.ptp(columns) > np.ptp(rows))


def _find_parts_on_plain(rgb: Rgb, own: Mask, free: Mask, away: F32) -> list[Mask]:
    """Return parts of any width that start at an object in front of a plain background.

    The background may be shaded smoothly. Shadows and reflections have softer borders
    than the object and are excluded.
    """
    differences = _background_differences(rgb, free)
    if float((differences[free] < REMAINS.even).mean()) < REMAINS.plain:
        return []
    candidates = ((differences > _least_difference(differences, own)) & free).astype(
        np.uint8
    )
    closed_mask = cv2.morphologyEx(
        candidates, cv2.MORPH_CLOSE, np.ones((5, 5), np.uint8)
    )
    count, pieces, stats, _ = cv2.connectedComponentsWithStats(
        closed_mask, connectivity=8
    )
    slope = _slope(rgb)
    area = int(np.count_nonzero(own))
    least_slope = _border_sharpness(slope, differences, away)
    parts = []
    for k in range(1, count):
        size = int(stats[k, cv2.CC_STAT_AREA])
        if not REMAINS.least_share * area <= size <= REMAINS.most_share * area:
            continue
        piece = pieces == k
        starts = away[piece].min() <= REMAINS.touches
        ends = away[piece].max() <= REMAINS.longest * REMAINS.reach * np.sqrt(area)
        if not (starts and ends):
            continue
        inner = cv2.erode(piece.astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
        border = piece & ~inner & (away > 2 * REMAINS.touches)
        if border.any() and float(np.median(slope[border])) >= least_slope:
            parts.append(piece & (away > 0))
    return parts


def _background_differences(rgb: Rgb, free: Mask) -> F32:
    """Return `(h, w)` 8-bit levels between a photo and the colour of its background.

    The colour of the background is a polynomial of degree two in the position.
    """
    height, width = free.shape
    x, y = np.meshgrid(np.linspace(-1, 1, width), np.linspace(-1, 1, height))
    terms = np.stack([np.ones_like(x), x, y, x * x, x * y, y * y], axis=-1)
    colours = rgb.astype(np.float64)
    colour = np.median(rgb[free], axis=0)
    differences = np.abs(colours - colour).max(axis=2)
    limit = REMAINS.unlike
    for _ in range(REMAINS.drops):
        ground = free & (differences < limit)
        if np.count_nonzero(ground) < REMAINS.plain * np.count_nonzero(free):
            break
        weights, *_ = np.linalg.lstsq(terms[ground], colours[ground], rcond=None)
        differences = np.abs(colours - terms @ weights).max(axis=2)
        limit = 2 * REMAINS.even
    return np.asarray(differences, np.float32)


def _least_difference(differences: F32, own: Mask) -> float:
    """Return the least difference of parts of an object from its background, levels.

    A dark object differs by more than the shadow at its feet.
    """
    inner = cv2.erode(own.astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
    deep = cv2.erode(own.astype(np.uint8), np.ones((9, 9), np.uint8)) > 0
    border = differences[inner & ~deep]
    if not border.size:
        return REMAINS.unlike
    return max(REMAINS.unlike, REMAINS.as_unlike * float(np.median(border)))


def _border_sharpness(slope: F32, differences: F32, away: F32) -> float:
    """Return the least slope at the border of a part, 8-bit levels per px.

    Out of focus, the border of a part is as soft as that of its object.
    """
    band = (away > 0) & (away <= 2 * REMAINS.touches)
    unlike = (
        cv2.dilate((differences > REMAINS.unlike).astype(np.uint8), np.ones((3, 3))) > 0
    )
    own = slope[band & unlike]
    if not own.size:
        return REMAINS.sharp
    as_own = REMAINS.as_sharp * float(np.median(own))
    return float(np.clip(as_own, REMAINS.softest, REMAINS.sharp))


def _slope(rgb: Rgb) -> F32:
    """Return the gradient `(h, w)` of a photo, 8-bit levels per px."""
    grey = cv2.cvtColor(rgb, cv2.COLOR_RGB2GRAY).astype(np.float32)
    x_gradient = cv2.Sobel(grey, cv2.CV_32F, 1, 0) / 8
    down = cv2.Sobel(grey, cv2.CV_32F, 0, 1) / 8
    return np.hypot(x_gradient, down)


def _is_rare(rgb: Rgb, part: Mask, around: Mask) -> bool:
    """Return whether the colour of a part is rare in the surroundings.

    For example, a gap between boards looks like the other gaps.
    """
    colour = np.median(rgb[part], axis=0)
    differences = np.abs(rgb[around].astype(np.float32) - colour).max(axis=1)
    return float((differences < REMAINS.alike).mean()) < REMAINS.rare


def _measure_narrow_contrast(rgb: Rgb, own: Mask, size: float) -> list[F32]:
    """Return the contrast of narrow structures against both of their sides.

    The pictures `(h, w)` are brighter and darker responses of each channel. For
    example, an orange antenna is darker in blue than both the sky and the road behind
    it.
    """
    width = max(REMAINS.narrowest, round(REMAINS.wide * size)) | 1
    kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (width, width))
    background = _without_object(rgb, own)
    bright_response = cv2.morphologyEx(background, cv2.MORPH_TOPHAT, kernel)
    dark_response = cv2.morphologyEx(background, cv2.MORPH_BLACKHAT, kernel)
    responses = [*cv2.split(bright_response), *cv2.split(dark_response)]
    return [np.where(own, 0, response).astype(np.float32) for response in responses]


def _without_object(rgb: Rgb, own: Mask) -> Rgb:
    """Return the photo with each pixel of an object replaced by its nearest
    surroundings.
    """
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
    response_mask = ((response >= limit) & free).astype(np.uint8)
    closed_mask = cv2.morphologyEx(
        response_mask, cv2.MORPH_CLOSE, np.ones((3, 3), np.uint8)
    )
    count, pieces, stats, _ = cv2.connectedComponentsWithStats(
        closed_mask, connectivity=8
    )
    parts = []
    for k in range(1, count):
        x, y, width, height, area = stats[k].tolist()
        on_edge = x == 0 or y == 0 or x + width == away.shape[1]
        on_edge = on_edge or y + height == away.shape[0]
        if on_edge:
            continue
        # A window has hundreds of pieces. Comparisons inside the box of each are
        # quick.
        box = np.s_[y : y + height, x : x + width]
        distance = away[box][pieces[box] == k]
        length = float(distance.max() - distance.min())
        starts = distance.min() <= REMAINS.touches
        ends = distance.max() <= REMAINS.longest * REMAINS.reach * size
        if not (starts and ends):
            continue
        is_long = length >= REMAINS.shortest * size
        if is_long and length * length >= REMAINS.slender * area:
            parts.append(pieces == k)
    return parts
