"""Mirror images of objects on a glossy ground: their detection and their removal.

A photo from the side shows below an object on ice, glass or lacquer what the ground
mirrors of it: the object upside down, weak and blurred. The mirror image stays in the
photo when the object leaves, unless the clean background lacks it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.maps import F32
from physgen.perceive.roles import Inpaint, Labels, Mask, Rgb


@dataclass(frozen=True)
class MirrorLimits:
    """Limits of mirror images; lengths are shares of the object's height or width.

    Chosen by eye on 21 photos and the bundled scenes: a can on ice is the only object
    with both correlations above 0.6 and a share of 0.04 to 0.5.
    """

    shallow: float = 0.15
    """Height of the ground below an object, at least."""
    beside: float = 0.25
    """Width of the ground at either side that shows its own colour."""
    gap: float = 0.03
    """Height below the foot that contact shadows may spoil."""
    near: float = 0.5
    """Height in which a mirror image is looked for."""
    blur: float = 0.05
    """Standard deviation of the blur: a ground is less sharp than a mirror."""
    likeness: float = 0.6
    """Correlation with the object upside down, as differences from the ground."""
    structure: float = 0.6
    """The same without the mean difference: a shadow has no structure."""
    weakest: float = 0.04
    """Share of the object's difference from the ground that is mirrored, at least."""
    strongest: float = 0.5
    visible: float = 1.5
    """Difference from the ground over the ground's own texture."""
    least: float = 4.0
    """8-bit codes of that difference."""
    covered: float = 0.05
    """Share of the mirror image that other objects may hide."""
    margin: float = 0.06
    """Width around the mirror image that is removed, too."""
    smallest: int = 400
    """px of a mirror image."""


MIRROR = MirrorLimits()


def remove_mirror_images(
    rgb: Rgb,
    clean: Rgb,
    labels: Labels,
    coverage: F32,
    ids: Sequence[int],
    inpaint: Inpaint,
) -> Rgb | None:
    """Return `clean` (H, W, 3) without the mirror images of the objects `ids`.

    None if the photo shows none.
    """
    hole = np.zeros(labels.shape, bool)
    for number in ids:
        image = find_mirror_image(rgb, labels, number)
        if image is not None:
            hole |= image
    if not hole.any():
        return None
    return np.asarray(inpaint(clean, hole | (coverage > 0)), np.uint8)


def find_mirror_image(rgb: Rgb, labels: Labels, number: int) -> Mask | None:
    """Return the pixels (H, W) of an object's mirror image below it, if it has one."""
    own = labels == number
    left, top, width, height = cv2.boundingRect(own.view(np.uint8))
    windows = _windows((left, top, width, height), labels.shape)
    if windows is None:
        return None
    below, upright = windows
    mirrored = own[upright][::-1]
    part = _visible_part(mirrored, labels[below] > 0, height)
    ground = _ground(rgb[below], left - below[1].start, width)
    if part is None or ground is None:
        return None
    if not _shows_mirror_image(rgb[below], rgb[upright][::-1], part, ground):
        return None
    image = np.zeros(labels.shape, np.uint8)
    image[below] = mirrored
    widened = _widened(image, max(1, round(MIRROR.margin * width)))
    return np.asarray(widened & (labels == 0))


def _windows(
    box: tuple[int, int, int, int], shape: tuple[int, ...]
) -> tuple[tuple[slice, slice], tuple[slice, slice]] | None:
    """Return rows and columns below the foot of a box, and as many rows above it.

    None if the photo shows too little ground below it.
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
    """Return the px beside an object that show its ground."""
    return round(MIRROR.beside * width) + 4


def _visible_part(mirrored: Mask, is_hidden: Mask, height: int) -> Mask | None:
    """Return the pixels of a mirror image that are compared; None if too few are
    seen.
    """
    hidden = mirrored & is_hidden
    if hidden.sum() > MIRROR.covered * mirrored.sum():
        return None
    part = mirrored & ~hidden
    part[: max(2, round(MIRROR.gap * height))] = False
    part[max(2, round(MIRROR.near * height)) :] = False
    return part if np.count_nonzero(part) >= MIRROR.smallest else None


def _widened(image: NDArray[np.uint8], reach: int) -> Mask:
    """Return a mask (H, W), widened by `reach` px to all sides."""
    kernel = np.ones((2 * reach + 1, 2 * reach + 1), np.uint8)
    return np.asarray(cv2.dilate(image, kernel) > 0)


def _shows_mirror_image(below: Rgb, turned: Rgb, part: Mask, ground: _Ground) -> bool:
    """Return whether the ground (h, w, 3) shows an object that is turned upside
    down.
    """
    height = round(np.count_nonzero(part.any(axis=1)) / MIRROR.near)
    image, item = (
        _blurred(picture.astype(np.float32) - ground.colours, part, height)[part]
        for picture in (below, turned)
    )
    return _is_mirrored(image, item, ground.texture)


@dataclass(frozen=True, eq=False)
class _Ground:
    """The ground below an object, as it is at both sides."""

    colours: F32
    """(h, w, 3) 8-bit codes."""
    texture: float
    """8-bit codes: its median deviation from them."""


def _ground(below: Rgb, left: int, width: int) -> _Ground | None:
    """Return the ground below an object from a column on; None if none is seen."""
    right, margin = left + width, _margin(width)
    columns = np.arange(below.shape[1])
    sides = [
        (columns < left - 4) & (columns >= left - margin - 4),
        (columns >= right + 4) & (columns < right + margin + 4),
    ]
    if min(int(side.sum()) for side in sides) < 4:
        return None
    rows = [np.median(below[:, side], axis=1) for side in sides]
    way = np.clip((columns - left) / max(right - left, 1), 0, 1)[None, :, None]
    colours = rows[0][:, None] * (1 - way) + rows[1][:, None] * way
    off = [
        np.abs(below[:, side] - row[:, None])
        for side, row in zip(sides, rows, strict=True)
    ]
    texture = float(np.median(np.concatenate(off, axis=1)))
    return _Ground(colours.astype(np.float32), texture)


def _blurred(differences: F32, part: Mask, height: int) -> NDArray[np.float32]:
    """Return differences (h, w, 3), blurred within a part."""
    sigma = max(2.0, MIRROR.blur * height)
    weights = part.astype(np.float32)
    total = cv2.GaussianBlur(weights, (0, 0), sigma)
    summed = cv2.GaussianBlur(differences * weights[..., None], (0, 0), sigma)
    return np.asarray(summed / np.maximum(total, 1e-3)[..., None], np.float32)


def _is_mirrored(
    image: NDArray[np.float32], item: NDArray[np.float32], texture: float
) -> bool:
    """Return whether differences (n, 3) below an object are like its own, upside
    down.
    """
    strength = float(np.sqrt((image**2).mean()))
    if strength < max(MIRROR.least, MIRROR.visible * texture):
        return False
    share = float((image * item).sum() / max((item**2).sum(), 1e-9))
    if not MIRROR.weakest <= share <= MIRROR.strongest:
        return False
    structure = _correlation(image - image.mean(axis=0), item - item.mean(axis=0))
    likeness = _correlation(image, item)
    return likeness >= MIRROR.likeness and structure >= MIRROR.structure


def _correlation(one: NDArray[np.float32], other: NDArray[np.float32]) -> float:
    """Return the cosine between two sets of differences (n, 3)."""
    lengths = float((one**2).sum()) * float((other**2).sum())
    return float((one * other).sum() / max(np.sqrt(lengths), 1e-9))
