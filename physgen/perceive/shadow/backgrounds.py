"""Backgrounds behind objects, with and without their shadows, from a single fill.

Shadows are measured beside objects, so that a smooth estimate behind the objects
suffices for them. The background without shadows is then filled once, from surroundings
without shadows; the background with shadows is that fill in the remaining light around
it.
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
from physgen.perceive.shadow.refills import plan_refill
from physgen.perceive.working_size import enlarge, reduce_known
from physgen.photometry import decode, encode_u8, luminance

GUESS_ERROR = 0.5
"""Levels: tolerance of the estimate."""
LIGHT_ERROR = 0.01
"""-log of light: tolerance of the extended shadows."""
GRAIN = 5.0
"""px: standard deviation of the blur against texture, before fills are compared."""
SCENERY_REACH = 0.015
"""Distance between an object and its scenery as a share of the photo's longer side."""
DARKEST = 2e-3
"""Linear light added before ratios, because black has none."""


@dataclass(frozen=True, eq=False)
class Surroundings:
    """A photo with an estimate of its hidden background."""

    photo: Rgb
    coverage: F32
    """(H, W): coverage by the objects."""
    hole: Mask
    """(H, W): objects with their rims."""
    guess: Rgb
    """(H, W, 3): the photo with a smooth fill of the hole."""


@dataclass(frozen=True, eq=False)
class Backgrounds:
    """The photo behind the objects, (H, W, 3)."""

    shaded_picture: Rgb
    """With the shadows of the objects."""
    clean_picture: Rgb | None
    """Without shadows; None if no shadow was found."""


def find_surroundings(photo: Rgb, coverage: F32) -> Surroundings:
    """Return a photo (H, W, 3) with an estimate of the background behind objects."""
    hole = with_rim(photo, coverage > 0)
    if not hole.any() or hole.all():
        return Surroundings(photo, coverage, hole, photo.copy())
    smooth_fill = _smooth_fill(photo.astype(np.float32), hole, GUESS_ERROR)
    guess = np.clip(smooth_fill + np.float32(0.5), 0, 255).astype(np.uint8)
    return Surroundings(photo, coverage, hole, guess)


def fill_backgrounds(
    surroundings: Surroundings, shadows: Shadows, inpaint: Inpaint
) -> Backgrounds:
    """Return both backgrounds; `shadows` come from the estimate."""
    hole = surroundings.hole
    clean_guess = shadows.clean_background
    if not hole.any() or hole.all():
        return Backgrounds(surroundings.guess, clean_guess)
    if clean_guess is None:
        return Backgrounds(inpaint(surroundings.photo, hole), None)
    if shadows.is_faint_shadow:
        return _fill_shaded(surroundings, clean_guess, inpaint)
    return _fill_clean(surroundings, clean_guess, inpaint)


def find_scenery(labels: Labels, fixed: Sequence[int]) -> list[int]:
    """Return the ids of `fixed` objects near others in the label map (H, W).

    A distant object, e.g. a cup behind a pot, is not part of the background that others
    hide.
    """
    is_loose = (labels > 0) & ~np.isin(labels, list(fixed))
    if not is_loose.any():
        return list(fixed)
    distance = cv2.distanceTransform((~is_loose).view(np.uint8), cv2.DIST_L2, 5)
    scenery_band = distance <= SCENERY_REACH * max(labels.shape)
    present = set(np.unique(labels[scenery_band]).tolist())
    return [i for i in fixed if i in present]


def fill_before_scenery(
    surroundings: Surroundings, scenery_mask: Mask, shadows: Shadows, inpaint: Inpaint
) -> Backgrounds:
    """Return both backgrounds if objects of `scenery_mask` (H, W) do not move.

    The scenery is filled last, because an object in front of scenery hides the scenery
    rather than the background behind it.
    """
    fixed_mask = scenery_mask[..., None]
    # First fill behind the movable objects, with the scenery as part of the photo ...
    coverage = np.where(scenery_mask, np.float32(0), surroundings.coverage)
    hole = with_rim(surroundings.photo, coverage > 0)
    guess = np.where(hole[..., None], surroundings.guess, surroundings.photo)
    clean_guess = shadows.clean_background
    if clean_guess is not None:
        shadows = replace(
            shadows,
            clean_background=np.where(fixed_mask, surroundings.photo, clean_guess),
        )
    before = Surroundings(surroundings.photo, coverage, hole, guess)
    backgrounds = fill_backgrounds(before, shadows, inpaint)
    # ... then behind the scenery, in the picture without the movable objects.
    rest = with_rim(surroundings.photo, scenery_mask)
    if backgrounds.clean_picture is None:
        lit_picture = backgrounds.shaded_picture
    else:
        lit_picture = backgrounds.clean_picture
    fill_result = inpaint(lit_picture, rest)
    shaded_picture = np.where(rest[..., None], fill_result, backgrounds.shaded_picture)
    return Backgrounds(
        shaded_picture, None if backgrounds.clean_picture is None else fill_result
    )


def _fill_shaded(
    surroundings: Surroundings, lifted: Rgb, inpaint: Inpaint
) -> Backgrounds:
    """Return the backgrounds for faint shadows: the fill contains the shadows."""
    shaded_fill = inpaint(surroundings.photo, surroundings.hole)
    light = (decode(lifted) + DARKEST) / (decode(surroundings.guess) + DARKEST)
    clean_fill = encode_u8(np.minimum(decode(shaded_fill) * light, 1))
    clean_fill = np.where(surroundings.hole[..., None], clean_fill, lifted)
    return Backgrounds(shaded_fill, clean_fill)


def _fill_clean(
    surroundings: Surroundings, lifted: Rgb, inpaint: Inpaint
) -> Backgrounds:
    """Return the backgrounds from a fill without shadows.

    If a piece of the fill differs from its surroundings like another surface, the piece
    is filled again, with its shadows.
    """
    before = reduce_photo(surroundings.guess, surroundings.coverage)
    after = reduce_photo(lifted, surroundings.coverage)
    # The comparison of surfaces needs no detail and runs at reduced size.
    plan = plan_refill(after.background, before.background, before.coverage)
    shape = surroundings.hole.shape
    full_hole = surroundings.hole | _enlarge_mask(plan.hole, shape)
    if full_hole.all():
        full_hole = surroundings.hole
    clean_fill = inpaint(lifted, full_hole)
    small_fill = reduce_photo(clean_fill, surroundings.coverage).background
    old = luminance(decode(before.background))
    # A fill without shadows must not be brighter than the removed shadow explains.
    rejected_pieces = plan.find_misfits(_blur(luminance(decode(small_fill))), old)
    rejected_mask = _enlarge_mask(rejected_pieces, shape) & full_hole
    if rejected_mask.any():
        masked_photo = np.where(
            (full_hole & ~rejected_mask)[..., None], clean_fill, surroundings.photo
        )
        small_fill = fill_from_surroundings(masked_photo, rejected_mask, inpaint)
        clean_fill = np.where(rejected_mask[..., None], small_fill, clean_fill)
    # The background with shadows is the same fill in the remaining light.
    shaded_picture = surroundings.photo.copy()
    dimmed_mask = surroundings.hole & ~rejected_mask
    light = np.exp(
        enlarge(_measure_darkness(surroundings, lifted, full_hole), shape)[dimmed_mask]
    )
    shaded_picture[dimmed_mask] = encode_u8(decode(clean_fill[dimmed_mask]) * light)
    shaded_picture[rejected_mask] = clean_fill[rejected_mask]
    return Backgrounds(shaded_picture, clean_fill)


def _enlarge_mask(mask: Mask, shape: tuple[int, ...]) -> Mask:
    """Return a mask of the reduced photo at full size `shape` (H, W)."""
    size = shape[1], shape[0]
    large = cv2.resize(mask.view(np.uint8), size, interpolation=cv2.INTER_NEAREST_EXACT)
    return np.asarray(large > 0)


def _measure_darkness(surroundings: Surroundings, lifted: Rgb, hole: Mask) -> F32:
    """Return the negative -log (h, w, 3) of the light that shadows leave, extended into
    `hole`.

    The result has the size of the reduced photo.
    """
    share = hole.astype(np.float32)
    before = reduce_photo(surroundings.photo, share)
    after = reduce_photo(lifted, share)
    logs = []
    for reduced_photo in (before, after):
        logs.append(cv2.log(decode(reduced_photo.background) + np.float32(DARKEST)))
    hidden_mask = before.coverage > 0
    log_ratio = np.where(hidden_mask[..., None], np.float32(0), logs[0] - logs[1])
    return harmonic_fill(log_ratio, hidden_mask, LIGHT_ERROR)


def _smooth_fill(picture: F32, hole: Mask, tolerance: float) -> F32:
    """Return a harmonic fill of `hole` (H, W), made at reduced size if it is large."""
    reduced = reduce_known(picture, hole)
    if reduced is None:
        return harmonic_fill(picture, hole, tolerance)
    smooth = enlarge(harmonic_fill(*reduced, tolerance), hole.shape)
    return np.where(hole[..., None], smooth, picture)


def _blur(values: F32) -> F32:
    return np.asarray(cv2.GaussianBlur(values, (0, 0), GRAIN), np.float32)
