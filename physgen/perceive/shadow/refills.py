"""Second fill of a background behind objects, after shadows are removed."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.maps import F32
from physgen.perceive.inpaint.poisson import nearest_piece
from physgen.perceive.roles import Inpaint, Labels, Mask, Rgb
from physgen.perceive.shadow.reflections import RING, remove_reflections
from physgen.photometry import decode, luminance


@dataclass(frozen=True)
class _Refill:
    """Limits of the second fill behind objects, after shadows are removed."""

    # px: half the width of gaps between objects too dark for a measurement.
    gap: int = 6
    # px around an object with a first fill spoilt by shadows.
    reach: int = 8
    # Share of its light below which a shadow near an object shows no detail.
    deep_share: float = 0.45
    # Largest ratio of the fill's brightening and the shadow's darkness beside it; above
    # it the fill is another surface.
    largest_gain: float = 1.5
    # Ignored share of either in the comparison.
    outlier_share: float = 0.1
    # Grey levels: a smaller change is not a shadow.
    least_change: int = 3


REFILL = _Refill()


@dataclass(frozen=True, eq=False)
class RefillPlan:
    """The pieces of a background that are filled again, and their possible
    brightness.
    """

    hole: Mask
    """(H, W): pieces beside a removed shadow."""
    unknown_mask: Mask
    """(H, W): all pixels behind objects, or too close to them to be measured."""
    pieces: NDArray[np.int32]
    """(H, W): number of the nearest piece of `unknown_mask`."""
    shadows: Mask
    """(H, W): pixels beside objects with added light."""
    left: F32
    """(H, W): share of the light in the shadows."""

    def find_misfits(self, filled: F32, old: F32) -> Mask:
        """Return the pieces (H, W) that are another surface than their surroundings.

        `filled` and `old` are the luminances (H, W) of the new and the first fill.
        """
        result = np.zeros_like(self.hole)
        brighter = (filled + np.float32(1e-3)) / (old + np.float32(1e-3))
        for piece in np.unique(self.pieces[self.hole]):
            region = self.pieces == piece
            shadow_beside = self.shadows & region
            largest_gain = 0.0
            if shadow_beside.any():
                largest_gain = float(
                    np.quantile(1 / self.left[shadow_beside], 1 - REFILL.outlier_share)
                )
            share = np.quantile(brighter[self.hole & region], 1 - REFILL.outlier_share)
            if share > REFILL.largest_gain * largest_gain:
                result |= region
        return result


def refill_background(
    removed: Rgb,
    background: Rgb,
    coverage: F32,
    inpaint: Inpaint,
    standing: Labels | None = None,
) -> Rgb:
    """Return the background with a second fill behind and between objects.

    The second fill uses surroundings without shadows. It is used only beside removed
    shadows and if it suits its surroundings, because the first fill is from a smaller
    hole. Then reflections of objects `standing` on a floor (H, W) are removed.
    """
    result = _refill_shadow(removed, background, coverage, inpaint)
    if standing is None:
        return result
    return remove_reflections(result, standing, coverage, inpaint)


def _refill_shadow(
    removed: Rgb, background: Rgb, coverage: F32, inpaint: Inpaint
) -> Rgb:
    plan = plan_refill(removed, background, coverage)
    old = np.where(plan.unknown_mask[..., None], background, removed)
    if not plan.hole.any():
        return old
    fill_result = inpaint(old, plan.hole)
    new = plan.hole & ~plan.find_misfits(
        luminance(decode(fill_result)), luminance(decode(old))
    )
    return np.where(new[..., None], fill_result, old)


def plan_refill(removed: Rgb, background: Rgb, coverage: F32) -> RefillPlan:
    """Return the plan of the second fill, where `removed` lacks shadows of
    `background`.
    """
    object_mask = (coverage > 0).astype(np.uint8)
    difference = cv2.absdiff(removed, background).max(axis=2)
    change_mask = difference > REFILL.least_change
    shadows = change_mask & (object_mask == 0)
    near_shadow = _dilate(shadows.astype(np.uint8), REFILL.reach)
    gap = np.ones((2 * REFILL.gap + 1, 2 * REFILL.gap + 1), np.uint8)
    ring = _dilate(object_mask, RING)
    closed_ring = np.asarray(cv2.morphologyEx(ring, cv2.MORPH_CLOSE, gap), np.uint8)
    left = (luminance(decode(background)) + 1e-3) / (luminance(decode(removed)) + 1e-3)
    deep_shadow = (left < REFILL.deep_share) & (_dilate(object_mask, REFILL.reach) > 0)
    unknown_mask = (
        object_mask
        | (closed_ring & near_shadow)
        | _dilate(deep_shadow.astype(np.uint8), 1)
    ) > 0
    if unknown_mask.any():
        pieces = nearest_piece(unknown_mask)
    else:
        pieces = np.zeros(unknown_mask.shape, np.int32)
    piece_numbers = np.unique(pieces[unknown_mask & (near_shadow > 0)])
    hole = unknown_mask & np.isin(pieces, piece_numbers)
    return RefillPlan(hole, unknown_mask, pieces, shadows, np.asarray(left, np.float32))


def _dilate(mask: NDArray[np.uint8], reach: int) -> NDArray[np.uint8]:
    """Return a mask (H, W) of 0 and 1, dilated by `reach` px in all directions."""
    kernel = np.ones((2 * reach + 1, 2 * reach + 1), np.uint8)
    return np.asarray(cv2.dilate(mask, kernel), np.uint8)
