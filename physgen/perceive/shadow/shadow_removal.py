"""Removal of shadows from the background, and refilling of what lay in them."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.perceive.roles import Inpaint, Rgb
from physgen.photometry import decode, encode_u8, luminance

# ----------------------------------------------------------------------
# Linear light -> kinds of surface by their hue, so that like is compared with like.

F32 = NDArray[np.float32]

DARKEST = 2e-3
"""Linear light added before a logarithm or a ratio: black has neither."""
HUES = 6
"""Kinds of surface that are told apart."""


def hue_weights(linear: F32, plain: F32, most: int) -> list[F32]:
    """(h, w) 0..1 a kind of surface: which pixels of `linear` (h, w, 3) belong to it.

    Kinds are learned where `plain` (h, w) is not 0, from `most` pixels there, about.
    """
    grey = linear.sum(axis=2) + 3 * DARKEST
    hue = cv2.GaussianBlur(np.dstack([(linear[..., c] + DARKEST) / grey for c in (0, 2)]), (0, 0), 2)
    sample = np.ascontiguousarray(hue[plain > 0][:: max(1, int(plain.sum()) // most)], np.float32)
    if len(sample) < HUES:
        return [np.ones(plain.shape, np.float32)]
    cv2.setRNGSeed(1)
    _, names, centers = cv2.kmeans(
        sample, HUES, np.zeros((len(sample), 1), np.int32), (3, 20, 1e-3), 1, cv2.KMEANS_PP_CENTERS
    )
    width = max(0.03, 2 * float(np.abs(sample - centers[names.ravel()]).mean()))
    return [np.exp(-((hue - c) ** 2).sum(-1) / (2 * width * width)).astype(np.float32) for c in centers]


# ----------------------------------------------------------------------
# A background whose shadows were lifted -> the same with what lies under and between objects filled anew.

Mask = NDArray[np.uint8]

RING = 3
"""px around objects where lifting is not to be trusted."""
GAP = 6
"""px: half the width of gaps between objects, too dark to tell what is there."""
NEAR = 8
"""px from an object within which shadows have been taken up by the first fill."""
DEEP = 0.45
"""Share of its light: where a shadow leaves less, and an object is near, nobody sees what is there."""
FADE = 0.03
"""Of the photo's longer side: how far into a hole from the nearest lifted shadow it is filled anew; then it fades."""
LIFTED = 3
"""Grey levels: less is no shadow."""


def refill_background(lifted: Rgb, background: Rgb, coverage: NDArray[np.float32], inpaint: Inpaint) -> Rgb:
    """What the photo hid lay in shadow when `background` was filled; now it is filled from lifted surroundings.

    Only close to where a shadow was lifted: the first fill knew as much of the rest, from a smaller hole. So the rest
    stays, and what is filled anew meets it.
    """
    covered: Mask = (coverage > 0).astype(np.uint8)
    bright = np.abs(lifted.astype(np.int16) - background).max(axis=2) > LIFTED
    near = np.asarray(cv2.dilate((bright & (covered == 0)).astype(np.uint8), _square(NEAR)), np.uint8)
    grown = np.asarray(cv2.dilate(covered, _square(RING)), np.uint8)
    grown = np.asarray(cv2.morphologyEx(grown, cv2.MORPH_CLOSE, _square(GAP)), np.uint8)
    left = (luminance(decode(background)) + 1e-3) / (luminance(decode(lifted)) + 1e-3)
    deep = ((left < DEEP) & (cv2.dilate(covered, _square(NEAR)) > 0)).astype(np.uint8)
    hole = covered | (grown & near) | np.asarray(cv2.dilate(deep, _square(1)), np.uint8)
    away = cv2.distanceTransform(1 - (near & hole), cv2.DIST_L2, 3)
    new = np.clip(2 - away / (FADE * max(hole.shape)), 0, 1) * (hole > 0)
    old = np.where(hole[..., None] > 0, background, lifted)
    if not new.any():
        return old
    filled = inpaint(old, new > 0)
    return np.asarray(np.rint(new[..., None] * filled + (1 - new[..., None]) * old), np.uint8)


def _square(half: int) -> Mask:
    return np.ones((2 * half + 1, 2 * half + 1), np.uint8)


# ----------------------------------------------------------------------
# Background with shadows, and where geometry foretells them -> how dark they are in the photo.
#
# The light of a place without its shadow is read off the same kind of surface nearby: along the row first,
# since a floor
# seen from the side changes least that way. What is missing there follows what geometry foretells; where the
# photo says
# otherwise, louder than the surface's own grain does, the photo is believed. What is finer is grain, and
# stays.

SHADED = 0.03
"""-log of light from which a place counts as foretold to be dark."""
UNSHADED_RING = 2
"""px around objects where the background still shows traces of them."""
REACHES = ((0.6, 0.03, 1.0), (2.0, 0.06, 0.05), (5.0, 0.12, 2e-3), (1.5, 0.5, 1e-4), (6.0, 1.0, 1e-6))
"""Of an object's size, across and down: how far like surfaces are looked for; and how little the farther ones count."""
LOUD = 2.0
"""Of the grain's standard deviation: what is less is grain."""
ROUND = 0.3
"""Of an object's size: what is wider is a shadow that geometry missed, what is finer an edge of one, or grain."""
FAINT, PART = 0.1, 0.45
"""-log of light from which a patch is dark; and of what is foretold close by."""
MOST = 1.7
"""Of what is foretold close by: no more is lifted. Darker still are other things."""
OWN = 0.3
"""Share of a dark patch that must be foretold; then all of it is lifted."""
ASTRAY = 0.15
"""Of an object's size: how far beside where it is foretold a shadow may lie; half as far above and below."""
RIM = 3.0
"""px: how far in from its border a dark patch is believed as it is seen."""
SMOOTH = 2.0
"""px over which slopes are smoothed: grain is not what counts."""
TINT = (0.6, 1.35)
"""By how much less or more than the average a channel may darken."""


def remove_shadows(background: Rgb, coverage: F32, foretold: F32, size: float) -> Rgb:
    """`foretold` (H, W): -log of the light left; `size`: px of a typical object."""
    ring = np.ones((2 * UNSHADED_RING + 1, 2 * UNSHADED_RING + 1), np.uint8)
    free = (cv2.dilate((coverage > 0).astype(np.uint8), ring) == 0).astype(np.float32)
    rows, columns = (
        np.flatnonzero((foretold > 0.01).any(axis=1)),
        np.flatnonzero((foretold > 0.01).any(axis=0)),
    )
    if not len(rows):
        return background
    pad = int(4 * size)
    part = np.s_[
        max(rows[0] - pad // 2, 0) : rows[-1] + pad // 2, max(columns[0] - pad, 0) : columns[-1] + pad
    ]
    linear = decode(background[part])
    dark, clean = _dark(linear, free[part], foretold[part], size)
    gone = 1 - np.exp(-dark)
    left = 1 - gone[..., None] * _colour(linear, clean, gone, free[part])
    result = background.copy()
    there = dark > 1e-3
    result[part][there] = encode_u8(linear / np.maximum(left, 0.04))[there]
    return result


def edge_ratio(background: Rgb, clean: Rgb, coverage: F32) -> float:
    """Slopes of the logarithm of light after lifting over those before, where anything was lifted.

    Less than 1 where a shadow's edges went; more where edges came that were not there. 1 where nothing was lifted.
    """
    free = cv2.dilate((coverage > 0).astype(np.uint8), np.ones((7, 7), np.uint8)) == 0
    logs = [np.log(luminance(decode(picture)) + DARKEST) for picture in (background, clean)]
    there = cv2.dilate((np.abs(logs[1] - logs[0]) > 0.02).astype(np.uint8), np.ones((7, 7), np.uint8)) > 0
    known = free.astype(np.float32)
    near = np.maximum(cv2.GaussianBlur(known, (0, 0), SMOOTH), 0.05)
    before, after = (
        float(
            np.hypot(*np.gradient(cv2.GaussianBlur(part * known, (0, 0), SMOOTH) / near))[there & free].sum()
        )
        for part in logs
    )
    return after / before if before > 0 else 1.0


def _dark(linear: F32, free: F32, foretold: F32, size: float) -> tuple[F32, F32]:
    """(h, w) -log of the light that is missing, and (h, w, 3) what light surfaces of that kind have elsewhere."""
    bright = np.log(luminance(linear) + DARKEST).astype(np.float32)
    plain = free * (foretold < SHADED)
    like = hue_weights(_provisional(linear, bright, plain, foretold, size), plain, 8000)
    near = 3 * size, 0.5 * size
    level = _along(bright, plain, like, size)
    noise = _mean(((level - bright) * plain) ** 2, plain, *near) ** 0.5
    patch = np.zeros(foretold.shape, np.uint8)
    around = 2 * round(ASTRAY * size) + 1, 2 * round(0.5 * ASTRAY * size) + 1
    expected = np.asarray(cv2.dilate(foretold, np.ones(around[::-1], np.uint8)), np.float32)
    for _ in range(2):  # what turns out to be dark says nothing of what is not
        missing = np.asarray(cv2.medianBlur(level - bright, 3), np.float32)
        patch = _patches(
            missing, free * (expected > 0.05), foretold, np.maximum(2.5 * noise, PART * expected)
        )
        plain = plain * (1 - cv2.dilate(patch, np.ones((7, 7), np.uint8)))
        level = _along(bright, plain, like, size)
    logs = np.log(linear + DARKEST).astype(np.float32)
    elsewhere = [_along(logs[..., c], plain, like, size) for c in range(3)]
    clean = np.asarray(np.exp(np.stack(elsewhere, axis=-1)) - DARKEST, np.float32)
    # what the photo says beyond the geometry, wide and fine, against the grain of what lies around
    beyond = (missing - foretold) * free
    grain = (level - bright) * plain
    wide = _mean(beyond, free, ROUND * size, 0.15 * size)
    fine = np.asarray(cv2.medianBlur(beyond - wide * free, 3), np.float32)
    noise_wide = _mean(grain, plain, ROUND * size, 0.15 * size)
    noise_fine = cv2.medianBlur(grain, 3) - noise_wide
    dark = foretold + _loud(wide, _mean(noise_wide**2, plain, *near), 1.0)
    quiet = _mean(noise_fine**2, plain, *near)
    dark = dark + _loud(fine, quiet, LOUD)
    # a dark patch that is foretold in part is a shadow in all its shape: its edge as it is seen, its inside smooth
    depth = cv2.distanceTransform(patch, cv2.DIST_L2, 3)
    inside = np.clip((depth - RIM) / 2, 0, 1).astype(np.float32)
    even = _mean(missing * inside, inside, 0.12 * size, 0.04 * size)
    seen = missing + inside * (even + _loud(missing - even, quiet, LOUD) - missing)
    belongs = _blurred(cv2.dilate(patch, np.ones((5, 5), np.uint8)).astype(np.float32), 1.0, 1.0) * free
    dark = belongs * seen + (1 - belongs) * dark
    dark = np.clip(dark, 0, MOST * expected + FAINT) * np.maximum(_reach(foretold, size), belongs)
    return np.asarray(dark, np.float32), clean


def _loud(value: F32, variance: F32, times: float) -> F32:
    """What of a value stands out of noise: Wiener's rule with a threshold."""
    return np.asarray(
        value * np.clip(1 - times**2 * variance / np.maximum(value * value, 1e-6), 0, 1), np.float32
    )


def _reach(foretold: F32, size: float) -> F32:
    """(h, w) 0..1: where shadows may be."""
    side = 2 * max(1, round(0.06 * size)) + 1
    wide = cv2.dilate(foretold, cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (side, side)))
    return np.asarray(
        np.clip(_blurred(np.asarray(wide, np.float32), 0.05 * size, 0.03 * size) / 0.06, 0, 1), np.float32
    )


def _patches(missing: F32, free: F32, foretold: F32, least: F32) -> NDArray[np.uint8]:
    """(h, w) 1 where dark patches are that are foretold in part; `least`: what counts as dark."""
    told = (foretold > 0.02) & (free > 0)
    dark = ((missing > np.maximum(least, FAINT)) & (free > 0)).astype(np.uint8)
    _, names, stats, _ = cv2.connectedComponentsWithStats(dark, connectivity=4)
    area = stats[:, cv2.CC_STAT_AREA]
    taken = (np.bincount(names.ravel(), weights=told.ravel(), minlength=len(stats)) > OWN * area) & (
        area > 12
    )
    taken[0] = False
    return np.asarray(taken[names].astype(np.uint8))


def _provisional(linear: F32, bright: F32, plain: F32, foretold: F32, size: float) -> F32:
    """(h, w, 3): shadows lifted in the rough, so that a surface has one hue in and out of them."""
    level = _along(bright, plain, [np.ones(bright.shape, np.float32)], size)
    wide = cv2.dilate(foretold, np.ones((5, 5), np.uint8))
    dark = np.clip(level - bright, 0, 1.3 * wide + 0.1) * _reach(foretold, size)
    slopes = [np.gradient(cv2.GaussianBlur(part, (0, 0), 1.5)) for part in (foretold, bright)]
    total = -sum(float((told * seen).sum()) for told, seen in zip(*slopes, strict=True))
    tint = np.ones(3, np.float32)
    for c in range(3):
        channel = np.gradient(cv2.GaussianBlur(np.log(linear[..., c] + DARKEST), (0, 0), 1.5))
        own = -sum(float((told * seen).sum()) for told, seen in zip(slopes[0], channel, strict=True))
        tint[c] = np.clip(own / max(total, 1e-3), *TINT)
    return np.asarray(linear * np.exp(dark[..., None] * tint), np.float32)


def _along(values: F32, plain: F32, like: list[F32], size: float) -> F32:
    """(h, w): the mean of like surfaces near by, along the rows first, where they are `plain`."""
    result = np.zeros(values.shape, np.float32)
    total = np.full(values.shape, 1e-9, np.float32)
    for kin in like:
        sums, weights = 1e-12 * values, np.full(values.shape, 1e-12, np.float32)
        for across, down, gain in REACHES:
            weight = plain * kin
            sums = sums + gain * _blurred(values * weight, across * size, max(down * size, 0.7))
            weights = weights + gain * _blurred(weight, across * size, max(down * size, 0.7))
        result += kin * sums / weights
        total += kin
    return np.asarray(result / total, np.float32)


def _mean(values: F32, weight: F32, across: float, down: float) -> F32:
    """Of what is known; `values` are 0 where it is not."""
    near = _blurred(weight, across, max(down, 0.7))
    return np.asarray(_blurred(values, across, max(down, 0.7)) / np.maximum(near, 1e-3), np.float32)


def _blurred(picture: F32, across: float, down: float) -> F32:
    """Gaussian blur of two widths, px; wide ones on a coarser grid."""
    h, w = picture.shape
    right, lower = max(1, min(int(across / 3), w // 8)), max(1, min(int(down / 3), h // 8))
    sigmas = max(across / right, 0.3), max(down / lower, 0.3)
    if right == lower == 1:
        return _gauss(picture, sigmas)
    small = cv2.resize(picture, (-(-w // right), -(-h // lower)), interpolation=cv2.INTER_AREA)
    small = _gauss(np.asarray(small, np.float32), sigmas)
    return np.asarray(cv2.resize(small, (w, h), interpolation=cv2.INTER_LINEAR), np.float32)


def _gauss(picture: F32, sigmas: tuple[float, float]) -> F32:
    across, down = sigmas
    soft = cv2.GaussianBlur(picture, (0, 0), sigmaX=across, sigmaY=down, borderType=cv2.BORDER_REFLECT)
    return np.asarray(soft, np.float32)


def _colour(linear: F32, clean: F32, gone: F32, free: F32) -> F32:
    """(3,) how much more or less of its light each channel misses than the luminance: the colour of what is blocked."""
    seen = (gone > 0.2) & (free > 0) & (clean.min(axis=2) > 5e-3)
    if np.count_nonzero(seen) < 100:
        return np.ones(3, np.float32)
    each, all_ = 1 - linear[seen] / clean[seen], gone[seen][:, None]
    return np.asarray(np.clip((each * all_).sum(axis=0) / (all_ * all_).sum(), *TINT), np.float32)
