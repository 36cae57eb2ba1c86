"""Mirror images of objects on a glossy ground: detection and removal.

On ice, glass or lacquer, a photo from the side shows a mirror image below an object:
the object upside down, weak and blurred. When the object moves away, its mirror image
would stay, unless the clean background lacks it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.maps import F32
from physgen.perceive.inpaint.poisson import close_gaps
from physgen.perceive.roles import Inpaint, Labels, Mask, Rgb


@dataclass(frozen=True)
class MirrorLimits:
    """Limits of mirror images; lengths are shares of the object's height or width.

    Chosen by eye on 21 photos and the bundled scenes: a can on ice is the only object
    with both correlations above 0.6 and a share of 0.04 to 0.5.
    """

    shallow: float = 0.05
    """Least height of the ground below an object."""
    side_width: float = 0.25
    """Width of the visible ground on either side."""
    gap: float = 0.03
    """Height below the foot that contact shadows may spoil."""
    search_height: float = 0.5
    """Height of the search for a mirror image."""
    blur: float = 0.05
    """Standard deviation of the blur: a ground is less sharp than a mirror."""
    likeness: float = 0.6
    """Least correlation with the inverted object, as differences from the ground."""
    structure: float = 0.6
    """The same without the mean difference: a shadow has no structure."""
    outline: float = 0.6
    """Least step across the inverted outline over the difference within it, if the
    image has no structure: a shadow has no such outline. A bag above white lacquer has
    1.0; shadows and grounds in 14 photos have up to 0.4.
    """
    edge: float = 0.01
    """Width of the bands on both sides of that outline."""
    weakest: float = 0.04
    """Least and largest share of the object's difference from the ground in the mirror
    image.
    """
    strongest: float = 0.5
    visible: float = 1.5
    """Least ratio of the difference from the ground and the ground's texture."""
    least_difference: float = 4.0
    """Least difference, 8-bit levels."""
    hidden_share: float = 0.05
    """Largest share of the mirror image behind other objects."""
    margin: float = 0.06
    """Removed width around the mirror image."""
    step_height: float = 0.1
    """Largest height above the foot of parts on the ground farther back."""
    smallest: int = 400
    """px: least area of a mirror image."""


MIRROR = MirrorLimits()


def remove_mirror_images(
    rgb: Rgb,
    clean: Rgb,
    labels: Labels,
    coverage: F32,
    ids: Sequence[int],
    inpaint: Inpaint,
) -> Rgb | None:
    """Return `clean` (H, W, 3) without mirror images of the objects `ids`, or None.

    None means that the photo shows no mirror image.
    """
    hole = np.zeros(labels.shape, bool)
    for number in ids:
        image = find_mirror_image(rgb, labels, number)
        if image is not None:
            hole |= image
    if not hole.any():
        return None
    # Visible remains between an object and its mirror image belong to both.
    return np.asarray(inpaint(clean, close_gaps(hole | (coverage > 0))), np.uint8)


def find_mirror_image(rgb: Rgb, labels: Labels, number: int) -> Mask | None:
    """Return the pixels (H, W) of an object's mirror image below it, or None."""
    mask = labels == number
    left, top, width, height = cv2.boundingRect(mask.view(np.uint8))
    # Compare the ground below the foot with the object above it, turned upside down.
    windows = _windows((left, top, width, height), labels.shape)
    if windows is None:
        return None
    lower_window, upright = windows
    mirrored_mask = mask[upright][::-1]
    part = _visible_part(mirrored_mask, labels[lower_window] > 0, height)
    ground = _ground(rgb[lower_window], left - lower_window[1].start, width)
    if part is None or ground is None:
        return None
    free_ground = np.asarray((labels[lower_window] == 0) & ~mirrored_mask)
    pictures = rgb[lower_window], rgb[upright][::-1]
    if not _shows_mirror_image(pictures, part, ground, free_ground):
        return None
    image = _below_raised_parts(mask, lower_window[0], height)
    image[lower_window] |= mirrored_mask.view(np.uint8)
    # The blurred border of the mirror image is removed, too.
    full_image = _dilate_mask(image, max(1, round(MIRROR.margin * width)))
    return np.asarray(full_image & (labels == 0))


def _below_raised_parts(mask: Mask, rows: slice, height: int) -> NDArray[np.uint8]:
    """Return the pixels (H, W) down to the end of `rows`, below parts of an object that
    end a little above its foot.

    Such a part, e.g. a strap, touches the ground farther back.
    """
    last_rows = len(mask) - 1 - np.argmax(mask[::-1], axis=0)
    highest_row = rows.start - MIRROR.step_height * height
    has_part = mask.any(axis=0) & (last_rows >= highest_row)
    row_numbers = np.arange(len(mask))[:, None]
    ground = (row_numbers > last_rows) & (row_numbers < rows.stop) & has_part
    return np.asarray(ground, np.uint8)


def _windows(
    box: tuple[int, int, int, int], shape: tuple[int, ...]
) -> tuple[tuple[slice, slice], tuple[slice, slice]] | None:
    """Return a window below an object's foot and an equally high one above it, or None.

    None means that the photo shows too little ground below the object.
    """
    left, top, width, height = box
    foot = top + height
    depth = min(height, shape[0] - foot)
    if depth < MIRROR.shallow * height:
        return None
    reach = 2 * _margin(width)
    columns = slice(max(left - reach, 0), min(left + width + reach, shape[1]))
    return (slice(foot, foot + depth), columns), (slice(foot - depth, foot), columns)


def _margin(width: int) -> int:
    """Return the width of the visible ground beside an object, px."""
    return round(MIRROR.side_width * width) + 4


def _visible_part(mirrored: Mask, is_hidden: Mask, height: int) -> Mask | None:
    """Return the compared pixels of a mirror image, or None if too few are visible."""
    hidden_pixels = mirrored & is_hidden
    if hidden_pixels.sum() > MIRROR.hidden_share * mirrored.sum():
        return None
    part = mirrored & ~hidden_pixels
    part[: max(2, round(MIRROR.gap * height))] = False
    part[max(2, round(MIRROR.search_height * height)) :] = False
    if np.count_nonzero(part) >= MIRROR.smallest:
        return part
    return None


def _dilate_mask(image: NDArray[np.uint8], reach: int) -> Mask:
    """Return a mask (H, W) dilated by `reach` px in all directions."""
    kernel = np.ones((2 * reach + 1, 2 * reach + 1), np.uint8)
    return np.asarray(cv2.dilate(image, kernel) > 0)


def _has_outline(differences: F32, part: Mask, free_ground: Mask) -> bool:
    """Return whether `differences` (h, w, 3) step between `part` (h, w) and the ground
    beside it.
    """
    width = max(3.0, MIRROR.edge * part.shape[1])
    grey = differences.mean(axis=2)
    mean = float(grey[part].mean())
    compared_ground = free_ground & part.any(axis=1).reshape(-1, 1)
    inner_band = part & _dilate(compared_ground, width)
    outer_band = compared_ground & _dilate(part, width)
    if (
        abs(mean) < MIRROR.least_difference
        or not inner_band.any()
        or not outer_band.any()
    ):
        return False
    step = float(grey[inner_band].mean() - grey[outer_band].mean())
    return step / mean >= MIRROR.outline


def _dilate(mask: Mask, distance: float) -> Mask:
    """Return the pixels (h, w) at most `distance` px from `mask` (h, w)."""
    distances = cv2.distanceTransform((~mask).view(np.uint8), cv2.DIST_L2, 5)
    return np.asarray(distances <= distance)


def _shows_mirror_image(
    pictures: tuple[Rgb, Rgb], part: Mask, ground: _Ground, free_ground: Mask
) -> bool:
    """Return whether the ground shows the inverted object.

    `pictures` (h, w, 3) are those of the ground and of the inverted object.
    """
    # The end of a large object may have no structure itself, but an outline.
    has_outline = _has_outline(pictures[0] - ground.colours, part, free_ground)
    least_structure = -1.0 if has_outline else MIRROR.structure
    height = round(np.count_nonzero(part.any(axis=1)) / MIRROR.search_height)
    image, item = (
        _blur_within_part(picture.astype(np.float32) - ground.colours, part, height)[
            part
        ]
        for picture in pictures
    )
    return _is_mirror_image(image, item, ground.texture, least_structure)


@dataclass(frozen=True, eq=False)
class _Ground:
    """The ground below an object, interpolated from both sides."""

    colours: F32
    """(h, w, 3) 8-bit levels."""
    texture: float
    """Median deviation from these colours, 8-bit levels."""


def _ground(picture: Rgb, left: int, width: int) -> _Ground | None:
    """Return the ground below an object whose left column is `left`, or None if it is
    hidden.
    """
    right = left + width
    margin = _margin(width)
    columns = np.arange(picture.shape[1])
    sides = [
        (columns < left - 4) & (columns >= left - margin - 4),
        (columns >= right + 4) & (columns < right + margin + 4),
    ]
    if min(int(side.sum()) for side in sides) < 4:
        return None
    # Each row of the ground has the median colours of both sides ...
    rows = [np.median(picture[:, side], axis=1) for side in sides]
    way = np.clip((columns - left) / max(right - left, 1), 0, 1)[None, :, None]
    # ... interpolated across the object's width.
    colours = rows[0][:, None] * (1 - way) + rows[1][:, None] * way
    deviations = [
        np.abs(picture[:, side] - row[:, None])
        for side, row in zip(sides, rows, strict=True)
    ]
    texture = float(np.median(np.concatenate(deviations, axis=1)))
    return _Ground(colours.astype(np.float32), texture)


def _blur_within_part(differences: F32, part: Mask, height: int) -> NDArray[np.float32]:
    """Return differences (h, w, 3), blurred inside a part."""
    sigma = max(2.0, MIRROR.blur * height)
    weights = part.astype(np.float32)
    total = cv2.GaussianBlur(weights, (0, 0), sigma)
    sums = cv2.GaussianBlur(differences * weights[..., None], (0, 0), sigma)
    return np.asarray(sums / np.maximum(total, 1e-3)[..., None], np.float32)


def _is_mirror_image(
    image: NDArray[np.float32],
    item: NDArray[np.float32],
    texture: float,
    least_structure: float,
) -> bool:
    """Return whether differences (n, 3) below an object resemble those of the inverted
    object.
    """
    strength = float(np.sqrt((image**2).mean()))
    if strength < max(MIRROR.least_difference, MIRROR.visible * texture):
        return False
    share = float((image * item).sum() / max((item**2).sum(), 1e-9))
    if not MIRROR.weakest <= share <= MIRROR.strongest:
        return False
    # A shadow is uniformly darker: without the mean difference it correlates with
    # nothing.
    structure = _correlation(image - image.mean(axis=0), item - item.mean(axis=0))
    likeness = _correlation(image, item)
    return likeness >= MIRROR.likeness and structure >= least_structure


def _correlation(first: NDArray[np.float32], other: NDArray[np.float32]) -> float:
    """Return the cosine between two sets of differences (n, 3)."""
    lengths = float((first**2).sum()) * float((other**2).sum())
    return float((first * other).sum() / max(np.sqrt(lengths), 1e-9))
