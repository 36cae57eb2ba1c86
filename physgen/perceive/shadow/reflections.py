"""Removal of reflections on a floor."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.maps import F32
from physgen.perceive.inpaint.poisson import fill_from_surroundings
from physgen.perceive.roles import Inpaint, Labels, Mask, Rgb
from physgen.perceive.shadow.shadow_owners import SPECK
from physgen.perceive.shadow.shadow_removal import TUNING
from physgen.perceive.shadow.silhouettes import away_from_objects
from physgen.perceive.shadow.surface_kinds import (
    local_mean,
    mean_of_kind,
)
from physgen.photometry import decode


@dataclass(frozen=True)
class _Reflection:
    """Limits of reflections on a floor.

    They were chosen on the studio's photos: the backgrounds of dominoes and bottle-book
    improve, and none gets worse.
    """

    # Least share of an object's width on another object instead of a floor.
    support_share: float = 0.3
    # Light added before logarithms, so that noise in the dark does not count.
    least_light: float = 0.01
    # px: finer differences are grain.
    blur: float = 1.5
    # Least ratio of a reflection and the texture of its rows.
    noise_ratio: float = 2.5
    # -log of light: a fainter reflection is invisible.
    least_depth: float = 0.1
    # Largest mean -log of light: a floor reflects no more, and a larger difference is
    # another surface.
    largest_depth: float = 0.5
    # Least share of it inside the object's mirror image.
    image_share: float = 0.9
    # Height of an object's foot as a share of its height.
    foot: float = 0.1
    # Least width over the foot's: a narrower difference is the floor's pattern.
    least_width: float = 0.7


# px around objects in which removal is unreliable.
RING = 3
REFLECTION = _Reflection()


@dataclass(frozen=True)
class _MirrorImages:
    """The mirror images of the objects on a floor."""

    # (H, W): the object's number; 0 without an image.
    labels: Labels
    # (n,): per number, the width of the object's foot, px.
    foot_widths: NDArray[np.float64]


@dataclass(frozen=True)
class _FloorDifferences:
    """The departures of a floor from its rows, logarithms of light."""

    # (H, W): mean over the channels, signed.
    mean: F32
    # (H, W): whether it exceeds the texture of the rows.
    is_visible: Mask


def remove_reflections(
    clean: Rgb, labels: Labels, coverage: F32, inpaint: Inpaint
) -> Rgb:
    """Return `clean` (H, W, 3) of a photo from the side without reflections on the
    floor.

    A reflection lies inside the object's mirror image below its foot, begins at the
    foot and differs from its rows by more than their texture.
    """
    images = _mirror_objects(labels)
    areas = np.bincount(labels.ravel())[1:]
    if areas.any():
        size = float(np.median(areas[areas > 0]) ** 0.5)
    else:
        size = 1.0
    differences = _floor_differences(clean, images.labels == 0, coverage, size)
    reflections = _find_reflections(differences, images, coverage)
    if not reflections.any():
        return clean
    hole = cv2.dilate(reflections.astype(np.uint8), np.ones((5, 5), np.uint8)) > 0
    fill_result = fill_from_surroundings(clean, hole, inpaint)
    return np.where(hole[..., None], fill_result, clean)


def _mirror_objects(labels: Labels) -> _MirrorImages:
    """Return the images of objects that stand on the floor, mirrored at their feet."""
    images = np.zeros_like(labels)
    foot_widths = np.zeros(int(labels.max()) + 1)
    for number in np.unique(labels[labels > 0]):
        object_mask = np.where(labels == number, number, 0).astype(labels.dtype)
        left, top, width, height = cv2.boundingRect((object_mask > 0).astype(np.uint8))
        foot = top + height
        depth = min(height, len(labels) - foot)
        ground = labels[min(foot + 2, len(labels) - 1), left : left + width]
        if depth <= RING or np.mean(ground > 0) > REFLECTION.support_share:
            continue
        image = images[foot : foot + depth]
        np.maximum(image, object_mask[foot - depth : foot][::-1], out=image)
        foot_top = foot - 1 - int(REFLECTION.foot * height)
        columns = np.flatnonzero(object_mask[foot_top:foot].any(axis=0))
        foot_widths[number] = np.ptp(columns)
    kernel = np.ones((1, 2 * RING + 1), np.uint8)
    return _MirrorImages(
        np.asarray(cv2.dilate(images, kernel), labels.dtype), foot_widths
    )


def _floor_differences(
    clean: Rgb, open_ground: Mask, coverage: F32, size: float
) -> _FloorDifferences:
    """Return how the floor differs from its rows.

    The light of the floor without reflections comes from `open_ground` (H, W), outside
    all mirror images; `size` is the size of a typical object, px.
    """
    free = away_from_objects(coverage, RING).astype(np.float32)
    reference = free * open_ground
    reaches = [(a * size, max(d * size, 0.7), gain) for a, d, gain in TUNING.reaches]
    single_kind = [np.ones_like(free)]
    logs = cv2.split(np.log(decode(clean) + REFLECTION.least_light))
    rests = []
    for part in logs:
        rests.append(
            part - mean_of_kind(part, reference, single_kind, reaches, tiny=1e-12)
        )
    rests = [
        local_mean(rest * free, free, REFLECTION.blur, REFLECTION.blur)
        for rest in rests
    ]
    largest_rest = np.asarray(np.max(np.abs(rests), axis=0), np.float32)
    texture = np.sqrt(
        mean_of_kind(largest_rest**2, reference, single_kind, reaches[1:], tiny=1e-12)
    )
    least_rest = np.maximum(REFLECTION.noise_ratio * texture, REFLECTION.least_depth)
    is_visible = (largest_rest > least_rest) & (free > 0)
    return _FloorDifferences(np.mean(rests, axis=0), is_visible)


def _find_reflections(
    differences: _FloorDifferences, images: _MirrorImages, coverage: F32
) -> Mask:
    """Return the visible differences (H, W) that are reflections."""
    count, names, stats, _ = cv2.connectedComponentsWithStats(
        differences.is_visible.astype(np.uint8), connectivity=4
    )
    area = stats[:, cv2.CC_STAT_AREA]
    inside = np.bincount(names.ravel(), (images.labels > 0).ravel(), count)
    rim_mask = (images.labels > 0) & ~away_from_objects(coverage, 2 * RING)
    owner = np.zeros(count, np.int64)
    owner[names[rim_mask]] = images.labels[rim_mask]
    widths = stats[:, cv2.CC_STAT_WIDTH]
    level = np.abs(np.bincount(names.ravel(), differences.mean.ravel(), count)) / area
    is_reflection = (
        (area > SPECK)
        & (inside > REFLECTION.image_share * area)
        & (owner > 0)
        & (widths > REFLECTION.least_width * images.foot_widths[owner])
        & (level < REFLECTION.largest_depth)
    )
    is_reflection[0] = False
    return np.asarray(is_reflection[names])
