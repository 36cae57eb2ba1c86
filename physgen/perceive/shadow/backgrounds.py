"""Backgrounds behind objects, with and without their shadows, from one fill.

Shadows are found beside objects, so that a smooth guess behind them is enough for it. What
lies behind is then filled once, from surroundings without shadows; the background with
shadows is that fill in the light that is left around it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np

from physgen.maps import F32
from physgen.perceive.inpaint.poisson import harmonic_fill, with_rim
from physgen.perceive.roles import Inpaint, Mask, Rgb, Shadows
from physgen.perceive.shadow.shadow_removal import plan_refill
from physgen.photometry import decode, encode_u8, luminance

GUESS_ERROR = 0.5
"""Levels by which the guess may be off."""
LIGHT_ERROR = 0.01
"""-log of light by which the extended shadows may be off."""
GRAIN = 5.0
"""px: standard deviation of the blur against texture, before fills are compared."""
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
    smooth = harmonic_fill(photo.astype(np.float32), hole, GUESS_ERROR)
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
    """Return the backgrounds from a fill without shadows."""
    plan = plan_refill(lifted, around.guess, around.coverage)
    whole = around.hole | plan.hole
    if whole.all():
        whole = around.hole
    clean = inpaint(lifted, whole)
    old = luminance(decode(around.guess))
    unlike = plan.unlike(_smoothed(luminance(decode(clean))), old) & whole
    if unlike.any():
        known = np.where((whole & ~unlike)[..., None], clean, around.photo)
        clean = np.where(unlike[..., None], inpaint(known, unlike), clean)
    dimmed = encode_u8(decode(clean) * _light_left(around, lifted, whole))
    behind = (around.hole & ~unlike)[..., None]
    shaded = np.where(behind, dimmed, around.photo)
    shaded = np.where(unlike[..., None], clean, shaded)
    return Backgrounds(shaded, clean)


def _light_left(around: Surroundings, lifted: Rgb, hole: Mask) -> F32:
    """Return the share (H, W, 3) of light that shadows leave, extended into `hole`."""
    before, after = (
        cv2.log(decode(picture) + np.float32(DARKEST))
        for picture in (around.photo, lifted)
    )
    dark = np.where(hole[..., None], np.float32(0), before - after)
    return np.asarray(np.exp(harmonic_fill(dark, hole, LIGHT_ERROR)), np.float32)


def _smoothed(values: F32) -> F32:
    return np.asarray(cv2.GaussianBlur(values, (0, 0), GRAIN), np.float32)
