"""Removal of shadows from the background, and refilling of what lay in them.

The light of a place without its shadow is read off the same kind of surface nearby: along the row first on a floor seen
from the side, since it changes least that way. What is missing there, within reach of what geometry predicts, is given
back to all channels alike. Finer detail is grain, and stays.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.perceive.roles import F32, Inpaint, Mask, Rgb
from physgen.perceive.shadow.silhouettes import DARKEST, away_from_objects
from physgen.photometry import decode, encode_u8, luminance

Reaches = Sequence[tuple[float, float, float]]
"""px across and down over which like surfaces are averaged, and the weight of each."""


@dataclass(frozen=True)
class _Tuning:
    """Sizes are shares of an object's, depths are -log of light; chosen on studio photos of the split `tune`."""

    hues: int = 6  # kinds of surface that are separated
    shaded: float = 0.03  # predicted depth from which a place is no reference for lit surfaces
    # reach of like surfaces, across and down, and their weight: on a floor seen from the side a row is equally far ...
    along: tuple[tuple[float, float, float], ...] = (
        (0.6, 0.03, 1.0), (2.0, 0.06, 0.05), (5.0, 0.12, 2e-3), (1.5, 0.5, 1e-4), (6.0, 1.0, 1e-6),
    )  # fmt: skip
    # ... and on a table seen from above
    around: tuple[tuple[float, float, float], ...] = ((0.4, 0.4, 1.0), (1.0, 1.0, 0.05), (3.0, 3.0, 0.002))
    astray: float = 0.15  # how far beside the prediction a shadow may lie; half as far down a floor
    soft: float = 0.04  # over which removal ends beyond that
    full: float = 0.04  # predicted depth from which a place is wholly within reach of shadows
    most: float = 1.7  # of the depth predicted close by: darker places are no shadows ...
    faint: float = 0.1  # ... and so much more
    smooth: float = 2.0  # px over which slopes are smoothed, so that grain does not count


@dataclass(frozen=True)
class _Refill:
    """What is filled again behind objects once shadows are removed."""

    ring: int = 3  # px around objects where removal is unreliable
    gap: int = 6  # px: half the width of gaps between objects that are too dark to show anything
    near: int = 8  # px from an object within which shadows have entered the first fill
    deep: float = 0.45  # share of its light below which, near an object, nothing is seen in a shadow
    # of the photo's longer side: how far into a hole from a removed shadow it is filled again
    fade: float = 0.03
    visible: int = 3  # grey levels: a smaller change is no shadow


TUNING, REFILL = _Tuning(), _Refill()


def hue_weights(linear: F32, plain: F32 | Mask, most: int) -> list[F32]:
    """(h, w) 0..1 for each kind of surface: the pixels of `linear` (h, w, 3) that belong to it, by hue.

    Kinds are learned from about `most` pixels where `plain` (h, w) is not 0.
    """
    grey = linear.sum(axis=2) + 3 * DARKEST
    hue = cv2.GaussianBlur(np.dstack([(linear[..., c] + DARKEST) / grey for c in (0, 2)]), (0, 0), 2)
    sample = np.ascontiguousarray(hue[plain > 0][:: max(1, int(plain.sum()) // most)], np.float32)
    if len(sample) < TUNING.hues:
        return [np.ones(plain.shape, np.float32)]
    cv2.setRNGSeed(1)
    start = np.zeros((len(sample), 1), np.int32)
    _, names, centers = cv2.kmeans(sample, TUNING.hues, start, (3, 20, 1e-3), 1, cv2.KMEANS_PP_CENTERS)
    width = max(0.03, 2 * float(np.abs(sample - centers[names.ravel()]).mean()))
    return [np.exp(-((hue - c) ** 2).sum(-1) / (2 * width * width)).astype(np.float32) for c in centers]


def blur_wide(picture: F32, across: float, down: float) -> F32:
    """Gaussian blur of two widths, px; wide ones on a coarser grid."""
    h, w = picture.shape
    right, lower = max(1, min(int(across / 3), w // 8)), max(1, min(int(down / 3), h // 8))
    small = picture
    if right > 1 or lower > 1:
        size = (-(-w // right), -(-h // lower))
        small = np.asarray(cv2.resize(picture, size, interpolation=cv2.INTER_AREA), np.float32)
    x, y = max(across / right, 0.3), max(down / lower, 0.3)
    soft = cv2.GaussianBlur(small, (0, 0), sigmaX=x, sigmaY=y, borderType=cv2.BORDER_REFLECT)
    if soft.shape != picture.shape:
        soft = cv2.resize(soft, (w, h), interpolation=cv2.INTER_LINEAR)
    return np.asarray(soft, np.float32)


def mean_of_kind(values: F32, plain: F32, kinds: Sequence[F32], reaches: Reaches) -> F32:
    """(h, w): the mean of `values` on surfaces of each pixel's kind nearby, from where they are `plain`.

    A pixel's own value where none is near.
    """
    result, total = np.float32(1e-6) * values, np.full(values.shape, 1e-6, np.float32)
    for kind in kinds:
        sums, weights = np.float32(1e-9) * values, np.full(values.shape, 1e-9, np.float32)
        weight = plain * kind
        for across, down, gain in reaches:
            sums = sums + gain * blur_wide(values * weight, across, max(down, 0.7))
            weights = weights + gain * blur_wide(weight, across, max(down, 0.7))
        result = result + kind * sums / weights
        total = total + kind
    return np.asarray(result / total, np.float32)


def remove_shadows(background: Rgb, coverage: F32, predicted: F32, size: float, *, top: bool) -> Rgb:
    """The background without shadows; `predicted` (H, W): -log of the light left; `size`: px of a typical object."""
    linear = decode(background)
    bright = np.asarray(cv2.medianBlur(np.log(luminance(linear) + DARKEST), 3), np.float32)
    around = [2 * max(1, round(TUNING.astray * size * flat)) + 1 for flat in (1.0, 1.0 if top else 0.5)]
    kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, tuple(around))
    expected = np.asarray(cv2.dilate(predicted, kernel), np.float32)
    reach = np.asarray(cv2.GaussianBlur(expected, (0, 0), max(2.0, TUNING.soft * size)), np.float32)
    plain = away_from_objects(coverage) & (reach <= TUNING.shaded)
    if np.count_nonzero(plain) < TUNING.hues:
        return background
    reaches = [(a * size, d * size, gain) for a, d, gain in (TUNING.around if top else TUNING.along)]
    kinds = hue_weights(linear, plain, 8000)
    level = mean_of_kind(bright, plain.astype(np.float32), kinds, reaches)
    dark = np.clip(level - bright, 0, TUNING.most * np.maximum(predicted, reach) + TUNING.faint)
    dark *= np.clip(reach / TUNING.full, 0, 1)
    return encode_u8(linear * np.exp(dark)[..., None])


def edge_ratio(background: Rgb, clean: Rgb, coverage: F32) -> float:
    """Slopes of the logarithm of light after removal over those before, where anything was removed.

    Less than 1 where a shadow's edges went; more where new edges came. 1 where nothing was removed.
    """
    free = away_from_objects(coverage, 3)
    logs = [np.log(luminance(decode(picture)) + DARKEST) for picture in (background, clean)]
    there = cv2.dilate((np.abs(logs[1] - logs[0]) > 0.02).astype(np.uint8), np.ones((7, 7), np.uint8)) > 0
    known = free.astype(np.float32)
    near = np.maximum(cv2.GaussianBlur(known, (0, 0), TUNING.smooth), 0.05)
    sums = []
    for part in logs:
        slopes = np.gradient(cv2.GaussianBlur(part * known, (0, 0), TUNING.smooth) / near)
        sums.append(float(np.hypot(*slopes)[there & free].sum()))
    before, after = sums
    return after / before if before > 0 else 1.0


def refill_background(removed: Rgb, background: Rgb, coverage: F32, inpaint: Inpaint) -> Rgb:
    """The background with what lies behind and between objects filled again, from surroundings without shadows.

    Only close to where a shadow was removed: the first fill was as good elsewhere, from a smaller hole. So the rest
    stays, and the new fill meets it.
    """

    def widened(mask: NDArray[np.uint8], by: int) -> NDArray[np.uint8]:
        return np.asarray(cv2.dilate(mask, np.ones((2 * by + 1, 2 * by + 1), np.uint8)), np.uint8)

    covered = (coverage > 0).astype(np.uint8)
    changed = np.abs(removed.astype(np.int16) - background).max(axis=2) > REFILL.visible
    near = widened((changed & (covered == 0)).astype(np.uint8), REFILL.near)
    gap = np.ones((2 * REFILL.gap + 1, 2 * REFILL.gap + 1), np.uint8)
    grown = np.asarray(cv2.morphologyEx(widened(covered, REFILL.ring), cv2.MORPH_CLOSE, gap), np.uint8)
    left = (luminance(decode(background)) + 1e-3) / (luminance(decode(removed)) + 1e-3)
    deep = ((left < REFILL.deep) & (widened(covered, REFILL.near) > 0)).astype(np.uint8)
    hole = covered | (grown & near) | widened(deep, 1)
    away = cv2.distanceTransform(1 - (near & hole), cv2.DIST_L2, 3)
    new = np.clip(2 - away / (REFILL.fade * max(hole.shape)), 0, 1) * (hole > 0)
    old = np.where(hole[..., None] > 0, background, removed)
    if not new.any():
        return old
    filled = inpaint(old, new > 0)
    return np.asarray(np.rint(new[..., None] * filled + (1 - new[..., None]) * old), np.uint8)
