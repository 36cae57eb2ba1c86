"""Backgrounds behind objects, with and without their shadows, from one fill.

Shadows are found beside objects, so that a smooth guess behind them is enough for it.
What lies behind is then filled once, from surroundings without shadows; the background
with shadows is that fill in the light that is left around it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np

from physgen.maps import F32
from physgen.perceive.inpaint.poisson import (
    fill_from_surroundings,
    harmonic_fill,
    with_rim,
)
from physgen.perceive.roles import Inpaint, Labels, Mask, Rgb, Shadows
from physgen.perceive.shadow.reduced import reduce_photo
from physgen.perceive.shadow.shadow_removal import plan_refill
from physgen.perceive.working_size import enlarge, reduce_known
from physgen.photometry import decode, encode_u8, luminance

GUESS_ERROR = 0.5
"""Levels by which the guess may be off."""
LIGHT_ERROR = 0.01
"""-log of light by which the extended shadows may be off."""
GRAIN = 5.0
"""px: standard deviation of the blur against texture, before fills are compared."""
SCENERY_REACH = 0.015
"""Share of the longer side between an object and what it may stand on or before."""
DARKEST = 2e-3
"""Linear light that is added before ratios: black has none."""


@dataclass(frozen=True, eq=False)
class Surroundings:
    """A photo and what of it lies behind objects."""

    photo: Rgb
    coverage: F32
    """(H, W): that of the objects."""
    hole: Mask
    """(H, W): objects with their rims."""
    guess: Rgb
    """(H, W, 3): the photo with a smooth fill of the hole."""


@dataclass(frozen=True, eq=False)
class Backgrounds:
    """The photo behind the objects, (H, W, 3)."""

    shaded: Rgb
    """With the shadows of the objects."""
    clean: Rgb | None
    """Without them; None if no shadow was found."""


def find_surroundings(photo: Rgb, coverage: F32) -> Surroundings:
    """Return a photo (H, W, 3) with a guess of what objects hide."""
    hole = with_rim(photo, coverage > 0)
    if not hole.any() or hole.all():
        return Surroundings(photo, coverage, hole, photo.copy())
    smooth = _smooth_fill(photo.astype(np.float32), hole, GUESS_ERROR)
    guess = np.clip(smooth + np.float32(0.5), 0, 255).astype(np.uint8)
    return Surroundings(photo, coverage, hole, guess)


def fill_backgrounds(
    around: Surroundings, shadows: Shadows, inpaint: Inpaint
) -> Backgrounds:
    """Return both backgrounds; `shadows` are those found on the guess."""
    hole, lifted = around.hole, shadows.clean
    if not hole.any() or hole.all():
        return Backgrounds(around.guess, lifted)
    if lifted is None:
        return Backgrounds(inpaint(around.photo, hole), None)
    if shadows.faint:
        return _fill_shaded(around, lifted, inpaint)
    return _fill_clean(around, lifted, inpaint)


def find_scenery(labels: Labels, fixed: Sequence[int]) -> list[int]:
    """Return the ids of `fixed` objects that are near others in the label map (H, W).

    What is far from all others, as a cup beyond a pot, is no part of what they hide.
    """
    is_loose = (labels > 0) & ~np.isin(labels, list(fixed))
    if not is_loose.any():
        return list(fixed)
    away = cv2.distanceTransform((~is_loose).view(np.uint8), cv2.DIST_L2, 5)
    is_near = away <= SCENERY_REACH * max(labels.shape)
    present = set(np.unique(labels[is_near]).tolist())
    return [i for i in fixed if i in present]


def fill_before_scenery(
    around: Surroundings, scenery_mask: Mask, shadows: Shadows, inpaint: Inpaint
) -> Backgrounds:
    """Return both backgrounds; `scenery_mask` (H, W) are objects that do not move.

    They are filled last: what stands on them or before them leaves them behind, and not
    what they hide.
    """
    fixed = scenery_mask[..., None]
    coverage = np.where(scenery_mask, np.float32(0), around.coverage)
    hole = with_rim(around.photo, coverage > 0)
    guess = np.where(hole[..., None], around.guess, around.photo)
    clean = shadows.clean
    if clean is not None:
        shadows = replace(shadows, clean=np.where(fixed, around.photo, clean))
    before = Surroundings(around.photo, coverage, hole, guess)
    backgrounds = fill_backgrounds(before, shadows, inpaint)
    rest = with_rim(around.photo, scenery_mask)
    lit = backgrounds.shaded if backgrounds.clean is None else backgrounds.clean
    filled = inpaint(lit, rest)
    shaded = np.where(rest[..., None], filled, backgrounds.shaded)
    return Backgrounds(shaded, None if backgrounds.clean is None else filled)


def _fill_shaded(around: Surroundings, lifted: Rgb, inpaint: Inpaint) -> Backgrounds:
    """Return the backgrounds if shadows are faint: the fill is made with them."""
    shaded = inpaint(around.photo, around.hole)
    light = (decode(lifted) + DARKEST) / (decode(around.guess) + DARKEST)
    clean = encode_u8(np.minimum(decode(shaded) * light, 1))
    clean = np.where(around.hole[..., None], clean, lifted)
    return Backgrounds(shaded, clean)


def _fill_clean(around: Surroundings, lifted: Rgb, inpaint: Inpaint) -> Backgrounds:
    """Return the backgrounds from a fill without shadows.

    A piece of the fill that is another surface than its surroundings is filled again,
    with its shadows.
    """
    before = reduce_photo(around.guess, around.coverage)
    after = reduce_photo(lifted, around.coverage)
    plan = plan_refill(after.background, before.background, before.coverage)
    shape = around.hole.shape
    whole = around.hole | _enlarge_mask(plan.hole, shape)
    if whole.all():
        whole = around.hole
    clean = inpaint(lifted, whole)
    filled = reduce_photo(clean, around.coverage).background
    old = luminance(decode(before.background))
    unlike = plan.unlike(_smooth(luminance(decode(filled))), old)
    again = _enlarge_mask(unlike, shape) & whole
    if again.any():
        known = np.where((whole & ~again)[..., None], clean, around.photo)
        filled = fill_from_surroundings(known, again, inpaint)
        clean = np.where(again[..., None], filled, clean)
    shaded, dimmed = around.photo.copy(), around.hole & ~again
    light = np.exp(enlarge(_measure_darkness(around, lifted, whole), shape)[dimmed])
    shaded[dimmed] = encode_u8(decode(clean[dimmed]) * light)
    shaded[again] = clean[again]
    return Backgrounds(shaded, clean)


def _enlarge_mask(mask: Mask, shape: tuple[int, ...]) -> Mask:
    """Return a mask of the reduced photo as one of `shape` (H, W)."""
    size = shape[1], shape[0]
    large = cv2.resize(mask.view(np.uint8), size, interpolation=cv2.INTER_NEAREST_EXACT)
    return np.asarray(large > 0)


def _measure_darkness(around: Surroundings, lifted: Rgb, hole: Mask) -> F32:
    """Return -log of light that shadows leave, negative, extended into `hole`.

    (h, w, 3) of the reduced photo.
    """
    share = hole.astype(np.float32)
    before, after = (reduce_photo(picture, share) for picture in (around.photo, lifted))
    logs = [
        cv2.log(decode(one.background) + np.float32(DARKEST)) for one in (before, after)
    ]
    hidden = before.coverage > 0
    dark = np.where(hidden[..., None], np.float32(0), logs[0] - logs[1])
    return harmonic_fill(dark, hidden, LIGHT_ERROR)


def _smooth_fill(picture: F32, hole: Mask, tolerance: float) -> F32:
    """Return a harmonic fill of `hole` (H, W), made at reduced size if it is large."""
    reduced = reduce_known(picture, hole)
    if reduced is None:
        return harmonic_fill(picture, hole, tolerance)
    smooth = enlarge(harmonic_fill(*reduced, tolerance), hole.shape)
    return np.where(hole[..., None], smooth, picture)


def _smooth(values: F32) -> F32:
    return np.asarray(cv2.GaussianBlur(values, (0, 0), GRAIN), np.float32)
