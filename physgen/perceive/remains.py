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
from numpy.typing import NDArray

from physgen.maps import F32
from physgen.perceive.roles import Labels, Mask, Rgb
from physgen.photometry import largest_channel


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
    largest_width: float = 0.09
    # px: least value of that width.
    narrowest: int = 5
    # px: largest gap between a part and the mask.
    touches: int = 3
    # Least contrast of a part, 8-bit levels.
    contrast: float = 22.0
    # Least contrast as a multiple of the strongest 5 % of other narrow structures.
    clutter: float = 1.6
    # 8-bit levels: largest variation of a plain background.
    variation: float = 14.0
    # Least share of the surroundings with one plain colour.
    plain_share: float = 0.55
    # 8-bit levels: least difference of a part from that colour.
    difference: float = 40.0
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
    similarity: float = 30.0
    # Largest share of the surroundings with the colour of a part.
    colour_share: float = 0.02
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
    slenderness: float = 2.5
    # Largest number of parts of an object; more are texture.
    largest_count: int = 4
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
    is_confident: bool
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
    area = cv2.INTER_AREA
    nearest = cv2.INTER_NEAREST_EXACT
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
                remains.append(Remain(i, is_free, remain.is_confident))
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
        if remain.is_confident:
            result[remain.mask & (result == 0)] = remain.owner
        else:
            doubtful_parts.append(remain)
    return result, doubtful_parts


@dataclass(frozen=True, eq=False)
class _Surroundings:
    """An object and its surroundings, in a window of the photo."""

    rgb: Rgb
    mask: Mask  # (h, w)
    # (h, w): searched pixels outside all objects.
    free: Mask
    # (h, w): pixels at other objects.
    near_others: Mask
    # (h, w): distance from the object, px.
    distance: F32
    # Slices of the window in the photo.
    window: tuple[slice, slice]

    @property
    def area(self) -> int:
        """Return the area of the object, px."""
        return int(np.count_nonzero(self.mask))

    def paste(self, part: Mask, shape: tuple[int, ...]) -> Mask:
        """Return a part (h, w) as a mask of the photo's shape."""
        mask = np.zeros(shape, bool)
        mask[self.window] = part
        return mask


def _remains_of(rgb: Rgb, labels: Labels, i: int) -> list[Remain]:
    """Return the narrow parts of object `i`."""
    surroundings = _crop_surroundings(rgb, labels, i)
    if surroundings is None:
        return []
    free = surroundings.free
    area = surroundings.area
    candidates = _find_narrow_parts(surroundings)
    remains = []
    used_mask = np.zeros_like(surroundings.mask)
    # On a plain background a part may also be wide.
    for part in _find_parts_on_plain(surroundings):
        if not (part & surroundings.near_others).any():
            used_mask |= part
            remains.append(Remain(i, surroundings.paste(part, labels.shape), True))
    narrow_area = 0
    for strength, part in candidates:
        if (part & used_mask).any():
            continue
        used_mask |= part
        narrow_area += int(np.count_nonzero(part))
        is_sure = strength >= 1 and _has_rare_colour(
            surroundings.rgb, part, free & ~part
        )
        is_sure = is_sure and not _lies_at_foot(part, surroundings.mask)
        if is_sure or np.count_nonzero(part) >= REMAINS.least_share * area:
            mask = surroundings.paste(part, labels.shape)
            remains.append(Remain(i, mask, is_sure))
    # Many parts, or large ones, are the texture of the background.
    if len(remains) > REMAINS.largest_count or narrow_area > REMAINS.share * area:
        return []
    return remains


def _lies_at_foot(part: Mask, object_mask: Mask) -> bool:
    """Return whether a part lies flat beside the foot of an object (h, w).

    For example, a streak on a tray or a seam between boards is no part of a vase: the
    vase would collide by it.
    """
    object_rows = np.flatnonzero(object_mask.any(axis=1))
    height = int(np.ptp(object_rows)) + 1
    rows, columns = np.nonzero(part)
    is_low = rows.min() > object_rows[-1] - REMAINS.foot * height
    return bool(is_low and np.ptp(columns) > np.ptp(rows))


def _crop_surroundings(rgb: Rgb, labels: Labels, i: int) -> _Surroundings | None:
    """Return object `i` and its surroundings, or None if it is too small or hidden."""
    mask = labels == i
    area = int(np.count_nonzero(mask))
    if area < REMAINS.smallest:
        return None
    reach = round(REMAINS.reach * float(np.sqrt(area)))
    x, y, width, height = cv2.boundingRect(mask.astype(np.uint8))
    window = np.s_[
        max(y - reach, 0) : y + height + reach, max(x - reach, 0) : x + width + reach
    ]
    window_mask = mask[window]
    others = (labels[window] > 0) & ~window_mask
    distance = np.asarray(
        cv2.distanceTransform((~window_mask).astype(np.uint8), cv2.DIST_L2, 5),
        np.float32,
    )
    free = (distance > 1) & (distance <= reach) & ~others
    if not free.any():
        return None
    near_others = cv2.dilate(others.astype(np.uint8), np.ones((7, 7), np.uint8)) > 0
    return _Surroundings(rgb[window], window_mask, free, near_others, distance, window)


def _find_narrow_parts(surroundings: _Surroundings) -> list[tuple[float, Mask]]:
    """Return narrow parts with their contrast relative to the limit, strongest first.

    Several levels are tried, because no single limit separates parts from all
    backgrounds.
    """
    size = float(np.sqrt(surroundings.area))
    free = surroundings.free
    candidates = []
    for response in _measure_narrow_contrast(surroundings.rgb, surroundings.mask, size):
        typical_response = float(np.percentile(response[free], 95))
        limit = max(REMAINS.contrast, REMAINS.clutter * typical_response)
        for level in REMAINS.levels:
            for part in _find_connected_parts(
                response, free, surroundings.distance, limit * level, size
            ):
                if not (part & surroundings.near_others).any():
                    strength = float(np.median(response[part])) / limit
                    candidates.append((strength, part))
    return sorted(candidates, key=lambda candidate: -candidate[0])


def _find_parts_on_plain(surroundings: _Surroundings) -> list[Mask]:
    """Return parts of any width that start at an object in front of a plain background.

    The background may be shaded smoothly. Shadows and reflections have softer borders
    than the object and are excluded.
    """
    free = surroundings.free
    distance = surroundings.distance
    differences = _background_differences(surroundings.rgb, free)
    if float((differences[free] < REMAINS.variation).mean()) < REMAINS.plain_share:
        return []
    least_difference = _least_difference(differences, surroundings.mask)
    pieces, stats = _connect_pixels((differences > least_difference) & free, 5)
    slope = _slope(surroundings.rgb)
    area = surroundings.area
    least_slope = _border_sharpness(slope, differences, distance)
    parts = []
    for k in range(1, len(stats)):
        size = int(stats[k, cv2.CC_STAT_AREA])
        if not REMAINS.least_share * area <= size <= REMAINS.most_share * area:
            continue
        piece = pieces == k
        if not _ends_nearby(distance[piece], float(np.sqrt(area))):
            continue
        inner = cv2.erode(piece.astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
        border = piece & ~inner & (distance > 2 * REMAINS.touches)
        if border.any() and float(np.median(slope[border])) >= least_slope:
            parts.append(piece & (distance > 0))
    return parts


def _connect_pixels(
    mask: Mask, gap: int
) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    """Return the pieces (h, w) of a mask without gaps of `gap` px, and statistics of
    each.
    """
    closed_mask = cv2.morphologyEx(
        mask.astype(np.uint8), cv2.MORPH_CLOSE, np.ones((gap, gap), np.uint8)
    )
    _, pieces, stats, _ = cv2.connectedComponentsWithStats(closed_mask, connectivity=8)
    return np.asarray(pieces, np.int32), np.asarray(stats, np.int32)


def _ends_nearby(distance: F32, size: float) -> bool:
    """Return whether pixels at distances (n,) start at the object and end nearby."""
    starts = distance.min() <= REMAINS.touches
    ends = distance.max() <= REMAINS.longest * REMAINS.reach * size
    return bool(starts and ends)


def _background_differences(rgb: Rgb, free: Mask) -> F32:
    """Return `(h, w)` 8-bit levels between a photo and the colour of its background.

    The colour of the background is a polynomial of degree two in the position.
    """
    height, width = free.shape
    x, y = np.meshgrid(np.linspace(-1, 1, width), np.linspace(-1, 1, height))
    terms = np.stack([np.ones_like(x), x, y, x * x, x * y, y * y], axis=-1)
    colours = rgb.astype(np.float64)
    colour = np.median(rgb[free], axis=0)
    differences = largest_channel(np.abs(colours - colour))
    limit = REMAINS.difference
    for _ in range(REMAINS.drops):
        ground = free & (differences < limit)
        if np.count_nonzero(ground) < REMAINS.plain_share * np.count_nonzero(free):
            break
        weights, *_ = np.linalg.lstsq(terms[ground], colours[ground], rcond=None)
        differences = largest_channel(np.abs(colours - terms @ weights))
        limit = 2 * REMAINS.variation
    return np.asarray(differences, np.float32)


def _least_difference(differences: F32, mask: Mask) -> float:
    """Return the least difference of parts of an object from its background, levels.

    A dark object differs by more than the shadow at its feet.
    """
    inner = cv2.erode(mask.astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
    deep = cv2.erode(mask.astype(np.uint8), np.ones((9, 9), np.uint8)) > 0
    border = differences[inner & ~deep]
    if not border.size:
        return REMAINS.difference
    return max(REMAINS.difference, REMAINS.as_unlike * float(np.median(border)))


def _border_sharpness(slope: F32, differences: F32, distance: F32) -> float:
    """Return the least slope at the border of a part, 8-bit levels per px.

    Out of focus, the border of a part is as soft as that of its object.
    """
    band = (distance > 0) & (distance <= 2 * REMAINS.touches)
    unlike = (
        cv2.dilate((differences > REMAINS.difference).astype(np.uint8), np.ones((3, 3)))
        > 0
    )
    own_slopes = slope[band & unlike]
    if not own_slopes.size:
        return REMAINS.sharp
    as_own = REMAINS.as_sharp * float(np.median(own_slopes))
    return float(np.clip(as_own, REMAINS.softest, REMAINS.sharp))


def _slope(rgb: Rgb) -> F32:
    """Return the gradient `(h, w)` of a photo, 8-bit levels per px."""
    grey = cv2.cvtColor(rgb, cv2.COLOR_RGB2GRAY).astype(np.float32)
    x_gradient = cv2.Sobel(grey, cv2.CV_32F, 1, 0) / 8
    down = cv2.Sobel(grey, cv2.CV_32F, 0, 1) / 8
    return np.hypot(x_gradient, down)


def _has_rare_colour(rgb: Rgb, part: Mask, surroundings: Mask) -> bool:
    """Return whether the colour of a part is rare in the surroundings.

    For example, a gap between boards looks like the other gaps.
    """
    colour = np.median(rgb[part], axis=0)
    differences = np.abs(rgb[surroundings].astype(np.float32) - colour).max(axis=1)
    return float((differences < REMAINS.similarity).mean()) < REMAINS.colour_share


def _measure_narrow_contrast(rgb: Rgb, mask: Mask, size: float) -> list[F32]:
    """Return the contrast of narrow structures against both of their sides.

    The pictures `(h, w)` are brighter and darker responses of each channel. For
    example, an orange antenna is darker in blue than both the sky and the road behind
    it.
    """
    width = max(REMAINS.narrowest, round(REMAINS.largest_width * size)) | 1
    kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (width, width))
    background = _without_object(rgb, mask)
    bright_response = cv2.morphologyEx(background, cv2.MORPH_TOPHAT, kernel)
    dark_response = cv2.morphologyEx(background, cv2.MORPH_BLACKHAT, kernel)
    responses = [*cv2.split(bright_response), *cv2.split(dark_response)]
    return [np.where(mask, 0, response).astype(np.float32) for response in responses]


def _without_object(rgb: Rgb, mask: Mask) -> Rgb:
    """Return the photo with each pixel of an object replaced by its nearest
    surroundings.
    """
    inside = cv2.dilate(mask.astype(np.uint8), np.ones((3, 3), np.uint8))
    _, nearest = cv2.distanceTransformWithLabels(
        inside, cv2.DIST_L2, 5, labelType=cv2.DIST_LABEL_PIXEL
    )
    places = np.zeros((int(nearest.max()) + 1, 2), np.int64)
    outside = inside == 0
    places[nearest[outside]] = np.argwhere(outside)
    source = places[nearest]
    return np.asarray(rgb[source[..., 0], source[..., 1]])


def _find_connected_parts(
    response: F32, free: Mask, distance: F32, limit: float, size: float
) -> list[Mask]:
    """Return the connected narrow parts that start at the object and end nearby."""
    pieces, stats = _connect_pixels((response >= limit) & free, 3)
    parts = []
    for k in range(1, len(stats)):
        x, y, width, height, area = stats[k].tolist()
        if _is_at_edge((x, y, width, height), distance.shape):
            continue
        # A window has hundreds of pieces. Comparisons inside the box of each are
        # quick.
        box = np.s_[y : y + height, x : x + width]
        piece_distance = distance[box][pieces[box] == k]
        if not _ends_nearby(piece_distance, size):
            continue
        length = float(piece_distance.max() - piece_distance.min())
        is_long = length >= REMAINS.shortest * size
        if is_long and length * length >= REMAINS.slenderness * area:
            parts.append(pieces == k)
    return parts


def _is_at_edge(box: tuple[int, int, int, int], shape: tuple[int, ...]) -> bool:
    """Return whether a box (x, y, width, height) touches the edge of a window."""
    x, y, width, height = box
    return x == 0 or y == 0 or x + width == shape[1] or y + height == shape[0]
