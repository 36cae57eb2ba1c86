"""Cast shadows with a hard edge, measured in the photo instead of predicted.

Geometry tells about where the sun's shadow of an object lies. Its exact outline needs
the whole object: a bus is no extruded outline. Dark ground that overlaps with the
predicted shadow, beside lit ground of an even level, is the shadow; all of it gets the
light that its lit surroundings have.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from physgen.maps import F32
from physgen.perceive.inpaint.poisson import harmonic_fill
from physgen.perceive.roles import Mask, Rgb
from physgen.perceive.shadow.silhouettes import DARKEST, away_from_objects
from physgen.photometry import decode, encode_u8


@dataclass(frozen=True)
class HardShadowLimits:
    """Limits of hard shadows; lengths are in sizes of the objects, depths -log of
    light. Chosen by eye on four photos of buses; the shadows of bundled dominoes,
    whose truth is rendered, get closer to it.
    """

    core_depth: float = 0.3
    """Least predicted depth of a pixel in the shadow."""
    touched_depth: float = 0.15
    """Predicted depth of a pixel that the shadow may contain."""
    ring: tuple[float, float] = (0.03, 0.5)
    """Distances from the predicted shadow between which ground is taken for lit."""
    lit_depth: float = 0.35
    """Largest depth of lit ground below the median of its ring."""
    shadow_depth: float = 0.4
    """Least depth of the shadow below the lit ground."""
    reach: float = 0.35
    """Distance from the predicted shadow up to which dark ground is searched."""
    extent: float = 0.33
    """Largest distance of the shadow from its prediction."""
    overlap: float = 0.3
    """Least share of a dark region with a predicted shadow."""
    least_pixels: int = 100
    """Least area of a shadow and of its lit ring, px."""
    cells: int = 160
    """Number of cells along the longer side in the level of lit ground."""
    rim: int = 2
    """Half the width of the penumbra at its edge, px."""


HARD = HardShadowLimits()


def lighten_hard_shadows(
    background: Rgb, coverage: F32, darkness: F32, size: float
) -> Rgb | None:
    """Return the background (H, W, 3) without its hard shadows; None without any.

    `coverage` (H, W) of all objects, `darkness` (H, W) of their predicted shadows, -log
    of light; `size`: typical size of an object, px.
    """
    logs = np.log(decode(background) + DARKEST).astype(np.float32)
    open_mask = away_from_objects(coverage, 1)
    core_mask = darkness > HARD.core_depth
    if not core_mask.any():
        return None
    distance_px = cv2.distanceTransform((~core_mask).astype(np.uint8), cv2.DIST_L2, 5)
    distance = np.asarray(distance_px / size, np.float32)
    # The lit ground around the shadow tells how bright the ground in it would be.
    level = _lit_level(logs, open_mask, distance)
    if level is None:
        return None
    # Pixels of objects are no ground: they count as not dark.
    depth_map = np.where(open_mask[..., None], level - logs, 0)
    shadow = _find_shadow(depth_map, distance, darkness)
    if np.count_nonzero(shadow) < HARD.least_pixels:
        return None
    return _lighten(background, shadow, level - logs)


def _lighten(background: Rgb, shadow: Mask, missing_light: F32) -> Rgb:
    """Return the background (H, W, 3) without a shadow (H, W).

    `missing_light` (H, W, 3): -log of the share of the lit ground's light.
    """
    # One depth for the whole shadow keeps the texture of its ground.
    depth = np.median(missing_light[shadow], axis=0)
    umbra = _erode(shadow, HARD.rim)
    gain = np.where(umbra[..., None], depth, 0)
    # In the penumbra, the depth is that of each pixel: a mean one would leave a rim.
    penumbra = ~_erode(~shadow, HARD.rim) & ~umbra
    gain = np.where(penumbra[..., None], np.clip(missing_light, 0, depth), gain)
    light = decode(background) * np.exp(gain)
    return encode_u8(np.minimum(light, 1.0).astype(np.float32))


def _erode(mask: Mask, reach: int) -> Mask:
    """Return a mask (H, W) without its outer `reach` px."""
    square = np.ones((2 * reach + 1, 2 * reach + 1), np.uint8)
    return np.asarray(cv2.erode(mask.astype(np.uint8), square) > 0, np.bool_)


def _lit_level(logs: F32, open_mask: Mask, distance: F32) -> F32 | None:
    """Return the level (H, W, 3) of lit ground, -log of light, continued over the photo.

    `distance` (H, W) from the predicted shadow. None with hardly any lit ground.
    """
    ring = open_mask & (distance > HARD.ring[0]) & (distance < HARD.ring[1])
    if np.count_nonzero(ring) < HARD.least_pixels:
        return None
    # A part of the ring may be in the shadow, too: pixels far below the median are
    # left out.
    grey = logs.mean(axis=2)
    lit_mask = ring & (grey > np.median(grey[ring]) - HARD.lit_depth)
    height, width = grey.shape
    step = max(max(height, width) // HARD.cells, 1)
    cells = (max(width // step, 1), max(height // step, 1))
    weights = np.asarray(lit_mask, np.float32)
    share = cv2.resize(weights, cells, interpolation=cv2.INTER_AREA)
    sums = cv2.resize(logs * weights[..., None], cells, interpolation=cv2.INTER_AREA)
    means = np.asarray(sums / np.maximum(share, 1e-3)[..., None], np.float32)
    # A membrane follows slow changes of light over the ground.
    level = harmonic_fill(means, share < 1 / 2)
    size = (width, height)
    return np.asarray(
        cv2.resize(level, size, interpolation=cv2.INTER_LINEAR), np.float32
    )


def _find_shadow(depth: F32, distance: F32, darkness: F32) -> Mask:
    """Return the dark regions (H, W) that overlap with predicted shadows.

    `depth` (H, W, 3) below lit ground, `distance` (H, W) from the predicted shadow,
    `darkness` (H, W) as predicted.
    """
    dark_mask = (depth.mean(axis=2) > HARD.shadow_depth) & (distance < HARD.reach)
    square = np.ones((3, 3), np.uint8)
    dark_pixels = cv2.morphologyEx(dark_mask.astype(np.uint8), cv2.MORPH_OPEN, square)
    # Regions are judged as wholes: geometry needs to hit only a part of a shadow.
    count, regions = cv2.connectedComponents(dark_pixels)
    areas = np.bincount(regions.ravel(), minlength=count)
    touched_areas = np.bincount(regions[darkness > HARD.touched_depth], minlength=count)
    # A stripe or the shade of a shelf goes on beyond the search, a shadow ends in it.
    end_areas = np.bincount(regions[distance > HARD.extent], minlength=count)
    shadow_flags = (touched_areas > HARD.overlap * areas) & (end_areas == 0)
    shadow_flags[0] = False
    return np.asarray(shadow_flags[regions], np.bool_)
