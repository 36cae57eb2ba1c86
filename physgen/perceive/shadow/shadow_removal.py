"""Removal of shadows and reflections from the background, its refilling, and shadows'
assignment to objects.

The light of a place without its shadow is read off the same kind of surface nearby:
along the row first, since a floor seen from the side changes least that way. The
missing light follows the prediction of geometry; where the photo differs by more than
the surface's own grain, the photo is believed. Finer detail is grain, and stays.

A shadow lies where light was removed; its owner is the object that blocks most light
from the place. Where geometry predicts no shadow, the place goes to the owner of the
nearest that it predicts.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.geometry.shadows import PixelBox
from physgen.maps import F32
from physgen.perceive.inpaint.poisson import fill_from_surroundings, nearest_piece
from physgen.perceive.roles import Inpaint, Labels, Mask, Rgb
from physgen.perceive.shadow.silhouettes import DARKEST, away_from_objects
from physgen.photometry import decode, encode_u8, luminance

Reaches = Sequence[tuple[float, float, float]]
"""px across and down over which like surfaces are averaged, and the weight of each."""
HUES = 6  # Kinds of surface that are separated
FAINT = 0.08  # -log of light, smoothed: less is no visible shadow
PREDICTED = 0.02  # -log of light from which geometry predicts a shadow
# weight of geometry: the photo alone leaves the soft ends of shadows to its grain
SHARE = 0.3
SMOOTH = 2.0  # px: standard deviation of the blur; finer detail is grain
GROUND_REACH = 20.0  # px: standard deviation of the blur over which grain is measured
GROUND_GRAIN = 2.0  # standard deviations that single grains may be brighter
SPECK = 16  # px: a smaller patch is none


@dataclass(frozen=True)
class _Tuning:
    """Sizes are shares of an object's, depths are -log of light."""

    shaded: float = 0.03  # predicted depth from which a place counts as shaded
    reaches: tuple[tuple[float, float, float], ...] = (
        (0.6, 0.03, 1.0), (2.0, 0.06, 0.05), (5.0, 0.12, 2e-3), (1.5, 0.5, 1e-4), (6.0, 1.0, 1e-6),
    )  # fmt: skip
    # standard deviations of the grain up to which a difference is grain
    loud: float = 2.0
    # a wider difference is a shadow that geometry missed, a finer one an edge, or grain
    wide: float = 0.3
    faint: float = 0.1  # depth from which a patch is dark
    part: float = 0.45  # the same, of the depth predicted close by
    most: float = 1.7  # of the depth predicted close by: darker patches are no shadows
    # depth from which a dark patch is of another surface: no shadow is so deep
    other: float = 2.5
    # share of a dark patch that must be predicted; then all of it is removed
    own: float = 0.3
    # how far beside the prediction a shadow may lie; half as far above and below
    astray: float = 0.15
    # px in from its border over which a dark patch is believed as it is seen
    rim: float = 3.0
    # px over which slopes are smoothed, so that grain does not count
    smooth: float = 2.0
    # of one channel's darkening over the average
    tint: tuple[float, float] = (
        0.6,
        1.35,
    )


@dataclass(frozen=True)
class _Refill:
    """What is filled again behind objects once shadows are removed."""

    ring: int = 3  # px around objects where removal is unreliable
    # px: half the width of gaps between objects that are too dark to show anything
    gap: int = 6
    near: int = 8  # px from an object within which shadows have entered the first fill
    # share of its light below which, near an object, nothing is seen in a shadow
    deep: float = 0.45
    # a fill that is so many times more brighter than a shadow beside it was dark is another surface, no lit one; a
    # part of either is left out, where they are compared
    brighter: float = 1.5
    outliers: float = 0.1
    visible: int = 3  # grey levels: a smaller change is no shadow


@dataclass(frozen=True)
class _Reflection:
    """What a floor mirrors, chosen on the studio's photos: backgrounds of dominoes and
    bottle-book gain, none loses.
    """

    # share of an object's width on another object from which it stands on that, on no
    # floor
    another: float = 0.3
    # light added before logarithms, so that noise in the dark does not count
    dark: float = 0.01
    smooth: float = 1.5  # px: finer differences are grain
    # times the texture of the rows around it, from which a difference is a reflection
    loud: float = 2.5
    least: float = 0.1  # -log of light: a fainter one is not seen
    # mean -log of light: a floor mirrors no more, what differs more is another surface
    most: float = 0.5
    inside: float = 0.9  # share of it that lies in the object's mirror image
    foot: float = 0.1  # of the object's height, that counts as its foot
    # of the foot's width: a narrower difference is the floor's own pattern
    wide: float = 0.7


TUNING, REFILL, REFLECTION = _Tuning(), _Refill(), _Reflection()


def hue_weights(linear: F32, plain: F32 | Mask, most: int) -> list[F32]:
    """(h, w) 0..1 for each kind of surface: the pixels of `linear` (h, w, 3) that
    belong to it, by hue.

    Kinds are learned from about `most` pixels where `plain` (h, w) is not 0.
    """
    grey = linear.sum(axis=2) + 3 * DARKEST
    hue = cv2.GaussianBlur(
        np.dstack([(linear[..., c] + DARKEST) / grey for c in (0, 2)]), (0, 0), 2
    )
    sample = np.ascontiguousarray(
        hue[plain > 0][:: max(1, int(plain.sum()) // most)], np.float32
    )
    if len(sample) < HUES:
        return [np.ones(plain.shape, np.float32)]
    cv2.setRNGSeed(1)
    start = np.zeros((len(sample), 1), np.int32)
    _, names, centers = cv2.kmeans(
        sample, HUES, start, (3, 20, 1e-3), 1, cv2.KMEANS_PP_CENTERS
    )
    width = max(0.03, 2 * float(np.abs(sample - centers[names.ravel()]).mean()))
    return [
        np.exp(-((hue - c) ** 2).sum(-1) / (2 * width * width)).astype(np.float32)
        for c in centers
    ]


def blur_wide(picture: F32, across: float, down: float) -> F32:
    """Gaussian blur of two widths, px; wide ones on a coarser grid."""
    h, w = picture.shape
    right, lower = (
        max(1, min(int(across / 3), w // 8)),
        max(1, min(int(down / 3), h // 8)),
    )
    small = picture
    if right > 1 or lower > 1:
        size = (-(-w // right), -(-h // lower))
        small = np.asarray(
            cv2.resize(picture, size, interpolation=cv2.INTER_AREA), np.float32
        )
    x, y = max(across / right, 0.3), max(down / lower, 0.3)
    soft = cv2.GaussianBlur(
        small, (0, 0), sigmaX=x, sigmaY=y, borderType=cv2.BORDER_REFLECT
    )
    if soft.shape != picture.shape:
        soft = cv2.resize(soft, (w, h), interpolation=cv2.INTER_LINEAR)
    return np.asarray(soft, np.float32)


def mean_of_kind(
    values: F32,
    plain: F32,
    kinds: Sequence[F32],
    reaches: Reaches,
    *,
    tiny: float,
    prior: tuple[float, float] = (0.0, 1e-9),
    blur: Callable[[F32, float, float], F32] = blur_wide,
) -> F32:
    """(h, w): the mean of `values` on surfaces of each pixel's kind nearby, from where
    they are `plain`.

    `tiny` weight of a pixel's own value where none is near; `prior`: the same, and a
    weight, where it is of no kind.
    """
    result = (
        np.float32(prior[0]) * values
        if prior[0]
        else np.zeros(values.shape, np.float32)
    )
    total = np.full(values.shape, prior[1], np.float32)
    for kind in kinds:
        sums, weights = tiny * values, np.full(values.shape, tiny, np.float32)
        weight = plain * kind
        for across, down, gain in reaches:
            sums = sums + gain * blur(values * weight, across, down)
            weights = weights + gain * blur(weight, across, down)
        result = result + kind * sums / weights
        total = total + kind
    return np.asarray(result / total, np.float32)


def remove_shadows(background: Rgb, coverage: F32, predicted: F32, size: float) -> Rgb:
    """Return the background without shadows; `predicted` (H, W): -log of the light
    left; `size`: px of a typical object.
    """
    free = away_from_objects(coverage).astype(np.float32)
    shaded = predicted > 0.01
    rows, columns = (
        np.flatnonzero(shaded.any(axis=1)),
        np.flatnonzero(shaded.any(axis=0)),
    )
    if not len(rows):
        return background
    pad = int(4 * size)
    part = np.s_[
        max(rows[0] - pad // 2, 0) : rows[-1] + pad // 2,
        max(columns[0] - pad, 0) : columns[-1] + pad,
    ]
    linear = decode(background[part])
    dark, clean = _Removal(linear, free[part], predicted[part], size).darkness()
    result = background.copy()
    result[part] = lightened(background[part], dark, clean, free[part])
    return result


def lightened(background: Rgb, dark: F32, clean: F32, free: F32) -> Rgb:
    """(h, w, 3) without the shadow `dark` (h, w), -log of light, of surfaces that are
    `clean` (h, w, 3) in full light.

    The blocked light has one colour, which is read off where the background is `free`
    (h, w).
    """
    linear, gone, there = decode(background), 1 - np.exp(-dark), dark > 1e-3
    left = 1 - gone[..., None] * _tint(linear, clean, gone, free)
    light = linear / np.maximum(left, 0.04)
    most = np.maximum(linear, _brightest_ground(linear, clean, free * (dark < FAINT)))
    return np.where(there[..., None], encode_u8(np.minimum(light, most)), background)


def _brightest_ground(linear: F32, clean: F32, lit: F32) -> F32:
    """(h, w, 3): how bright the ground is with its grain, by where it is `lit` (h, w).

    Beside an object nothing is measured, and geometry alone may remove too much.
    """
    grain = ((linear - clean) * lit[..., None]) ** 2
    result = np.empty_like(clean)
    for channel in range(3):
        spread = _mean(grain[..., channel], lit, GROUND_REACH, GROUND_REACH) ** 0.5
        result[..., channel] = clean[..., channel] + GROUND_GRAIN * spread
    return result


def edge_ratio(background: Rgb, clean: Rgb, coverage: F32) -> float:
    """Slopes of the logarithm of light after removal over those before, where anything
    was removed.

    Less than 1 where a shadow's edges went; more where new edges came. 1 where nothing
    was removed.
    """
    free = away_from_objects(coverage, 3)
    logs = [
        np.log(luminance(decode(picture)) + DARKEST) for picture in (background, clean)
    ]
    there = (
        cv2.dilate(
            (np.abs(logs[1] - logs[0]) > 0.02).astype(np.uint8),
            np.ones((7, 7), np.uint8),
        )
        > 0
    )
    known = free.astype(np.float32)
    near = np.maximum(cv2.GaussianBlur(known, (0, 0), TUNING.smooth), 0.05)
    sums = []
    for part in logs:
        slopes = np.gradient(
            cv2.GaussianBlur(part * known, (0, 0), TUNING.smooth) / near
        )
        sums.append(float(np.hypot(*slopes)[there & free].sum()))
    before, after = sums
    return after / before if before > 0 else 1.0


@dataclass(frozen=True)
class _Removal:
    """One part of the photo, its objects, and the shadows predicted there."""

    linear: F32
    free: F32
    predicted: F32
    size: float

    def darkness(self) -> tuple[F32, F32]:
        """(h, w) -log of the light that is missing, and (h, w, 3) the light of surfaces
        of that kind elsewhere.
        """
        free, predicted, size = self.free, self.predicted, self.size
        bright = np.log(luminance(self.linear) + DARKEST).astype(np.float32)
        plain = free * (predicted < TUNING.shaded)
        kinds = hue_weights(self.linear, plain, 8000)
        near = 3 * size, 0.5 * size
        level = self._level(bright, plain, kinds)
        noise = _mean(((level - bright) * plain) ** 2, plain, *near) ** 0.5
        around = (
            2 * round(TUNING.astray * size) + 1,
            2 * round(0.5 * TUNING.astray * size) + 1,
        )
        expected = np.asarray(
            cv2.dilate(predicted, np.ones(around[::-1], np.uint8)), np.float32
        )
        least = np.maximum(2.5 * noise, TUNING.part * expected)
        for _ in range(
            2
        ):  # a place that turns out to be dark is no reference for lit ones
            missing = np.asarray(cv2.medianBlur(level - bright, 3), np.float32)
            patch = _dark_patches(missing, free * (expected > 0.05), predicted, least)
            plain = plain * (1 - cv2.dilate(patch, np.ones((7, 7), np.uint8)))
            level = self._level(bright, plain, kinds)
        logs = np.log(self.linear + DARKEST).astype(np.float32)
        elsewhere = [self._level(logs[..., c], plain, kinds) for c in range(3)]
        clean = np.asarray(np.exp(np.stack(elsewhere, axis=-1)) - DARKEST, np.float32)
        # the photo's difference from the prediction, wide and fine, against the grain of the surroundings
        beyond = (missing - predicted) * free
        grain = (level - bright) * plain
        wide = _mean(beyond, free, TUNING.wide * size, 0.15 * size)
        fine = np.asarray(cv2.medianBlur(beyond - wide * free, 3), np.float32)
        noise_wide = _mean(grain, plain, TUNING.wide * size, 0.15 * size)
        noise_fine = cv2.medianBlur(grain, 3) - noise_wide
        dark = predicted + _above_noise(wide, _mean(noise_wide**2, plain, *near), 1.0)
        quiet = _mean(noise_fine**2, plain, *near)
        dark = dark + _above_noise(fine, quiet, TUNING.loud)
        # a dark patch that is predicted in part is a shadow in all its shape: its edge as seen, its inside smooth
        depth = cv2.distanceTransform(patch, cv2.DIST_L2, 3)
        inside = np.clip((depth - TUNING.rim) / 2, 0, 1).astype(np.float32)
        even = _mean(missing * inside, inside, 0.12 * size, 0.04 * size)
        seen = missing + inside * (
            even + _above_noise(missing - even, quiet, TUNING.loud) - missing
        )
        belongs = (
            blur_wide(
                cv2.dilate(patch, np.ones((5, 5), np.uint8)).astype(np.float32),
                1.0,
                1.0,
            )
            * free
        )
        dark = belongs * seen + (1 - belongs) * dark
        other = cv2.dilate(
            ((missing > TUNING.other) & (free > 0)).astype(np.uint8),
            np.ones((5, 5), np.uint8),
        )
        window = np.maximum(self._reach(), belongs) * (
            1 - blur_wide(other.astype(np.float32), 1.0, 1.0)
        )
        dark = np.clip(dark, 0, TUNING.most * expected + TUNING.faint) * window
        return np.asarray(dark, np.float32), clean

    def _level(self, values: F32, plain: F32, kinds: Sequence[F32]) -> F32:
        """(h, w): the mean of like surfaces nearby, along the rows first."""
        reaches = [
            (a * self.size, max(d * self.size, 0.7), gain)
            for a, d, gain in TUNING.reaches
        ]
        return mean_of_kind(values, plain, kinds, reaches, tiny=1e-12)

    def _reach(self) -> F32:
        """(h, w) 0..1: where shadows may be."""
        side = 2 * max(1, round(0.06 * self.size)) + 1
        wide = cv2.dilate(
            self.predicted, cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (side, side))
        )
        soft = blur_wide(
            np.asarray(wide, np.float32), 0.05 * self.size, 0.03 * self.size
        )
        return np.asarray(np.clip(soft / 0.06, 0, 1), np.float32)


def _above_noise(value: F32, variance: F32, times: float) -> F32:
    """Return the part of a value that stands out of noise: Wiener's rule with a
    threshold.
    """
    share = np.clip(1 - times**2 * variance / np.maximum(value * value, 1e-6), 0, 1)
    return np.asarray(value * share, np.float32)


def _dark_patches(
    missing: F32, free: F32, predicted: F32, least: F32
) -> NDArray[np.uint8]:
    """(h, w) 1 in dark patches that are predicted in part; `least`: the depth that
    counts as dark.
    """
    foreseen = (predicted > 0.02) & (free > 0)
    dark = ((missing > np.maximum(least, TUNING.faint)) & (free > 0)).astype(np.uint8)
    _, names, stats, _ = cv2.connectedComponentsWithStats(dark, connectivity=4)
    area = stats[:, cv2.CC_STAT_AREA]
    counts = np.bincount(names.ravel(), weights=foreseen.ravel(), minlength=len(stats))
    taken = (counts > TUNING.own * area) & (area > 12)
    taken[0] = False
    return np.asarray(taken[names].astype(np.uint8))


def _mean(values: F32, weight: F32, across: float, down: float) -> F32:
    """Local mean of what is known; `values` are 0 where it is not."""
    near = blur_wide(weight, across, max(down, 0.7))
    return np.asarray(
        blur_wide(values, across, max(down, 0.7)) / np.maximum(near, 1e-3), np.float32
    )


def _tint(linear: F32, clean: F32, gone: F32, free: F32) -> F32:
    """(3,) the darkening of each channel over that of the luminance: the colour of the
    blocked light.
    """
    seen = (gone > 0.2) & (free > 0) & (clean.min(axis=2) > 5e-3)
    if np.count_nonzero(seen) < 100:
        return np.ones(3, np.float32)
    each, all_ = 1 - linear[seen] / clean[seen], gone[seen][:, None]
    share = (each * all_).sum(axis=0) / (all_ * all_).sum()
    return np.asarray(np.clip(share, *TUNING.tint), np.float32)


def refill_background(
    removed: Rgb,
    background: Rgb,
    coverage: F32,
    inpaint: Inpaint,
    standing: Labels | None = None,
) -> Rgb:
    """Return the background with what lies behind and between objects filled again,
    from surroundings without shadows.

    Only where a shadow was removed beside it, and the new fill suits its surroundings:
    the first fill is from a smaller hole. Then reflections of objects that are
    `standing` on a floor (H, W) go.
    """
    refilled = _refilled(removed, background, coverage, inpaint)
    return (
        refilled
        if standing is None
        else remove_reflections(refilled, standing, coverage, inpaint)
    )


def _refilled(removed: Rgb, background: Rgb, coverage: F32, inpaint: Inpaint) -> Rgb:
    plan = plan_refill(removed, background, coverage)
    old = np.where(plan.dark[..., None], background, removed)
    if not plan.hole.any():
        return old
    filled = inpaint(old, plan.hole)
    new = plan.hole & ~plan.unlike(luminance(decode(filled)), luminance(decode(old)))
    return np.where(new[..., None], filled, old)


@dataclass(frozen=True, eq=False)
class RefillPlan:
    """Where a background without shadows is filled again, and how bright it may be."""

    hole: Mask
    """(H, W): pieces beside a removed shadow."""
    dark: Mask
    """(H, W): all that lies behind objects, or too close to them to be read off."""
    pieces: NDArray[np.int32]
    """(H, W): the number of the nearest piece of `dark`."""
    shadows: Mask
    """(H, W): where light was added beside objects."""
    left: F32
    """(H, W): share of the light that shadows left."""

    def unlike(self, filled: F32, old: F32) -> Mask:
        """Return the pieces (H, W) that are another surface than their surroundings.

        `filled` and `old` are the luminances (H, W) of the new and the first fill.
        """
        result = np.zeros_like(self.hole)
        brighter = (filled + np.float32(1e-3)) / (old + np.float32(1e-3))
        for piece in np.unique(self.pieces[self.hole]):
            near = self.pieces == piece
            beside = self.shadows & near
            most = 0.0
            if beside.any():
                most = float(np.quantile(1 / self.left[beside], 1 - REFILL.outliers))
            share = np.quantile(brighter[self.hole & near], 1 - REFILL.outliers)
            if share > REFILL.brighter * most:
                result |= near
        return result


def plan_refill(removed: Rgb, background: Rgb, coverage: F32) -> RefillPlan:
    """Return what is filled again where `removed` lacks shadows of `background`."""
    covered = (coverage > 0).astype(np.uint8)
    difference = cv2.absdiff(removed, background).max(axis=2)
    changed = difference > REFILL.visible
    shadows = changed & (covered == 0)
    near = _widened(shadows.astype(np.uint8), REFILL.near)
    gap = np.ones((2 * REFILL.gap + 1, 2 * REFILL.gap + 1), np.uint8)
    ring = _widened(covered, REFILL.ring)
    grown = np.asarray(cv2.morphologyEx(ring, cv2.MORPH_CLOSE, gap), np.uint8)
    left = (luminance(decode(background)) + 1e-3) / (luminance(decode(removed)) + 1e-3)
    deep = (left < REFILL.deep) & (_widened(covered, REFILL.near) > 0)
    dark = (covered | (grown & near) | _widened(deep.astype(np.uint8), 1)) > 0
    pieces = nearest_piece(dark) if dark.any() else np.zeros(dark.shape, np.int32)
    beside = np.unique(pieces[dark & (near > 0)])
    hole = dark & np.isin(pieces, beside)
    return RefillPlan(hole, dark, pieces, shadows, np.asarray(left, np.float32))


def _widened(mask: NDArray[np.uint8], reach: int) -> NDArray[np.uint8]:
    """Return a mask (H, W) of 0 and 1, widened by `reach` px to all sides."""
    kernel = np.ones((2 * reach + 1, 2 * reach + 1), np.uint8)
    return np.asarray(cv2.dilate(mask, kernel), np.uint8)


def remove_reflections(
    clean: Rgb, labels: Labels, coverage: F32, inpaint: Inpaint
) -> Rgb:
    """`clean` (H, W, 3) of a photo from the side, without what a floor mirrors of the
    objects on it.

    A reflection lies within the object's own mirror image below its foot, begins at the
    foot and differs from its rows by more than their texture.
    """
    mirrored, widths = np.zeros_like(labels), np.zeros(int(labels.max()) + 1)
    height, areas = len(labels), np.bincount(labels.ravel())[1:]
    size = float(np.median(areas[areas > 0]) ** 0.5) if areas.any() else 1.0
    for number in np.unique(labels[labels > 0]):
        own = np.where(labels == number, number, 0).astype(labels.dtype)
        left, top, width, tall = cv2.boundingRect((own > 0).astype(np.uint8))
        foot, deep = top + tall, min(tall, height - top - tall)
        on_another = (
            np.mean(labels[min(foot + 2, height - 1), left : left + width] > 0)
            > REFLECTION.another
        )
        if deep > REFILL.ring and not on_another:
            np.maximum(
                mirrored[foot : foot + deep],
                own[foot - deep : foot][::-1],
                out=mirrored[foot : foot + deep],
            )
            widths[number] = np.ptp(
                np.flatnonzero(
                    own[foot - 1 - int(REFLECTION.foot * tall) : foot].any(axis=0)
                )
            )
    mirrored = np.asarray(
        cv2.dilate(mirrored, np.ones((1, 2 * REFILL.ring + 1), np.uint8)), labels.dtype
    )
    free = away_from_objects(coverage, REFILL.ring).astype(np.float32)
    plain = free * (mirrored == 0)
    reaches = [(a * size, max(d * size, 0.7), gain) for a, d, gain in TUNING.reaches]
    every = [np.ones_like(free)]
    logs = cv2.split(np.log(decode(clean) + REFLECTION.dark))
    rests = [
        part - mean_of_kind(part, plain, every, reaches, tiny=1e-12) for part in logs
    ]
    rests = [
        _mean(rest * free, free, REFLECTION.smooth, REFLECTION.smooth) for rest in rests
    ]
    differs = np.asarray(np.max(np.abs(rests), axis=0), np.float32)
    texture = np.sqrt(mean_of_kind(differs**2, plain, every, reaches[1:], tiny=1e-12))
    seen = (
        (differs > np.maximum(REFLECTION.loud * texture, REFLECTION.least)) & (free > 0)
    ).astype(np.uint8)
    count, names, stats, _ = cv2.connectedComponentsWithStats(seen, connectivity=4)
    area, inside = (
        stats[:, cv2.CC_STAT_AREA],
        np.bincount(names.ravel(), (mirrored > 0).ravel(), count),
    )
    beside = (mirrored > 0) & ~away_from_objects(coverage, 2 * REFILL.ring)
    owner = np.zeros(count, np.int64)
    owner[names[beside]] = mirrored[beside]
    wide = stats[:, cv2.CC_STAT_WIDTH] > REFLECTION.wide * widths[owner]
    level = (
        np.abs(np.bincount(names.ravel(), np.mean(rests, axis=0).ravel(), count)) / area
    )
    taken = (
        (area > SPECK)
        & (inside > REFLECTION.inside * area)
        & (owner > 0)
        & wide
        & (level < REFLECTION.most)
    )
    taken[0] = False
    if not taken.any():
        return clean
    hole = cv2.dilate(taken[names].astype(np.uint8), np.ones((5, 5), np.uint8)) > 0
    filled = fill_from_surroundings(clean, hole, inpaint)
    return np.where(hole[..., None], filled, clean)


# assignment


def shadow_owners(
    background: Rgb,
    clean: Rgb,
    coverage: F32,
    casts: Iterable[tuple[int, PixelBox, F32]],
) -> Labels | None:
    """(H, W) the id of the object whose shadow lies there, 0 = none; None where no
    shadow is seen.

    `casts`: of each object its id and -log of the light that it leaves in a box of the
    photo.
    """
    owner, most = _strongest(casts, coverage.shape)
    dark = (1 - SHARE) * removed_light(
        background, clean, coverage
    ) + SHARE * most > FAINT
    return assign_regions(dark & (coverage < 0.5), owner)


def shadow_owners_by_model(
    coverage: F32, casts: Iterable[tuple[int, PixelBox, F32]], dark: F32
) -> Labels | None:
    """Return the same where `dark` (H, W), -log of light, is known, and the photo too
    coarse to say more.
    """
    owner, _ = _strongest(casts, coverage.shape)
    return assign_regions((dark > FAINT) & (coverage < 0.5), owner)


def _strongest(
    casts: Iterable[tuple[int, PixelBox, F32]], shape: tuple[int, ...]
) -> tuple[Labels, F32]:
    """(H, W) the object that blocks most light, and -log of the light left."""
    owner, most = np.zeros(shape, np.uint16), np.zeros(shape, np.float32)
    for number, (x0, y0, x1, y1), values in casts:
        part = np.s_[y0:y1, x0:x1]
        more = values > np.maximum(most[part], PREDICTED)
        owner[part][more] = number
        most[part][more] = values[more]
    return owner, most


def removed_light(background: Rgb, clean: Rgb, coverage: F32) -> F32:
    """(H, W) -log of light that was removed, smooth; right beside objects, where none
    is, the light missing there.

    Contact shadows lie there.
    """
    logs = [
        np.log(luminance(decode(picture)) + DARKEST) for picture in (clean, background)
    ]
    free = away_from_objects(coverage).astype(np.float32)
    near = np.maximum(cv2.GaussianBlur(free, (0, 0), SMOOTH), 1e-2)
    removed, level = (
        cv2.GaussianBlur(part.astype(np.float32) * free, (0, 0), SMOOTH) / near
        for part in (logs[0] - logs[1], logs[0])
    )
    contact = np.where(
        (free == 0) & (near > 0.05), level - cv2.GaussianBlur(logs[1], (0, 0), 0.7), 0
    )
    return np.asarray(np.maximum(removed, contact), np.float32)


def assign_regions(dark: Mask, owner: Labels) -> Labels | None:
    """`owner` (H, W) where it is `dark`, elsewhere the nearest; specks left out.

    None where nothing is left.
    """
    if not owner.any():
        return None
    count, names, stats, _ = cv2.connectedComponentsWithStats(
        dark.astype(np.uint8), connectivity=8
    )
    # a patch that no object predicts is no shadow
    owned = np.bincount(names[owner > 0], minlength=count) > 0
    kept = owned & (stats[:, cv2.CC_STAT_AREA] >= SPECK)
    kept[0] = False
    there = kept[names]
    if not there.any():
        return None
    _, nearest = cv2.distanceTransformWithLabels(
        (owner == 0).astype(np.uint8), cv2.DIST_L2, 5, labelType=cv2.DIST_LABEL_PIXEL
    )
    ids = np.zeros(int(nearest.max()) + 1, np.uint16)
    ids[nearest[owner > 0]] = owner[owner > 0]
    return np.where(there, ids[nearest], 0).astype(np.uint16)
