"""Removal of shadows and reflections, refills, and owners of shadows.

The light of a place without its shadow comes from the same kind of surface nearby,
first along the row, since a floor seen from the side changes least in that direction.
The missing light follows the prediction of geometry; if the photo differs by more than
the surface's grain, the photo is used. Finer detail is grain and stays. A shadow lies
where light was added; its owner is the object that blocks most light there, or else at
the nearest predicted place.
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
"""px, horizontal and vertical, over which similar surfaces are averaged, and their
weights.
"""
# Number of surface kinds.
HUES = 6
# -log of light, smoothed: the faintest visible shadow.
FAINT = 0.08
# Least -log of light of a predicted shadow.
PREDICTED = 0.02
# Weight of geometry: with the photo alone, grain would decide the soft ends of shadows.
SHARE = 0.3
# px: standard deviation of the blur; finer detail is grain.
SMOOTH = 2.0
# px: standard deviation of the blur over which grain is measured.
GROUND_REACH = 20.0
# Standard deviations by which single grains may be brighter.
GROUND_GRAIN = 2.0
# px: standard deviation of the blur over which ground is as bright as similar ground.
LEVEL_REACH = 6.0
# px: smaller patches are noise.
SPECK = 16


@dataclass(frozen=True)
class _Tuning:
    """Sizes are shares of an object's, depths are -log of light."""

    # Least predicted depth of a shaded place.
    shaded: float = 0.03
    reaches: tuple[tuple[float, float, float], ...] = (
        (0.6, 0.03, 1.0), (2.0, 0.06, 0.05), (5.0, 0.12, 2e-3), (1.5, 0.5, 1e-4), (6.0, 1.0, 1e-6),
    )  # fmt: skip
    # Standard deviations of the grain up to which a difference is grain.
    loud: float = 2.0
    # Width of the blur: a wider difference is a shadow missed by geometry, a finer one
    # an edge or grain.
    wide: float = 0.3
    # Least depth of a dark patch ...
    faint: float = 0.1
    # ... also as a share of the depth predicted nearby.
    part: float = 0.45
    # Largest depth over the depth predicted nearby: darker patches are not shadows.
    most: float = 1.7
    # Depth above which a dark patch is another surface, because no shadow is as deep.
    other: float = 2.5
    # Least predicted share of a completely removed dark patch.
    own: float = 0.3
    # Largest distance of a shadow from its prediction; half as much vertically.
    astray: float = 0.15
    # px from its border in which the measured depth of a dark patch is used.
    rim: float = 3.0
    # px: width of the smoothing of gradients against grain.
    smooth: float = 2.0
    # Least and largest darkening of one channel over the average.
    tint: tuple[float, float] = (
        0.6,
        1.35,
    )


@dataclass(frozen=True)
class _Refill:
    """Limits of the second fill behind objects, after shadows are removed."""

    # px around objects in which removal is unreliable.
    ring: int = 3
    # px: half the width of gaps between objects too dark for a measurement.
    gap: int = 6
    # px around an object with a first fill spoilt by shadows.
    near: int = 8
    # Share of its light below which a shadow near an object shows no detail.
    deep: float = 0.45
    # Largest ratio of the fill's brightening and the shadow's darkness beside it; above
    # it the fill is another surface.
    brighter: float = 1.5
    # Ignored share of either in the comparison.
    outliers: float = 0.1
    # Grey levels: a smaller change is not a shadow.
    visible: int = 3


@dataclass(frozen=True)
class _Reflection:
    """Limits of reflections on a floor.

    They were chosen on the studio's photos: the backgrounds of dominoes and bottle-book
    improve, and none gets worse.
    """

    # Least share of an object's width on another object instead of a floor.
    another: float = 0.3
    # Light added before logarithms, so that noise in the dark does not count.
    dark: float = 0.01
    # px: finer differences are grain.
    smooth: float = 1.5
    # Least ratio of a reflection and the texture of its rows.
    loud: float = 2.5
    # -log of light: a fainter reflection is invisible.
    least: float = 0.1
    # Largest mean -log of light: a floor reflects no more, and a larger difference is
    # another surface.
    most: float = 0.5
    # Least share of it inside the object's mirror image.
    inside: float = 0.9
    # Height of an object's foot as a share of its height.
    foot: float = 0.1
    # Least width over the foot's: a narrower difference is the floor's pattern.
    wide: float = 0.7


TUNING, REFILL, REFLECTION = _Tuning(), _Refill(), _Reflection()


def hue_weights(linear: F32, plain: F32 | Mask, most: int) -> list[F32]:
    """Return one weight map (h, w), 0..1, per kind of surface in `linear` (h, w, 3), by
    hue.

    Kinds are learnt from about `most` pixels with `plain` (h, w) above 0.
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
    """Return a Gaussian blur of two widths, px; wide blurs use a coarser grid."""
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
    blurred_picture = cv2.GaussianBlur(
        small, (0, 0), sigmaX=x, sigmaY=y, borderType=cv2.BORDER_REFLECT
    )
    if blurred_picture.shape != picture.shape:
        blurred_picture = cv2.resize(
            blurred_picture, (w, h), interpolation=cv2.INTER_LINEAR
        )
    return np.asarray(blurred_picture, np.float32)


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
    """Return the mean (h, w) of `values` on `plain` surfaces of each pixel's kind
    nearby.

    `tiny` is the weight of a pixel's own value if no such surface is near; `prior` is
    the same, with a weight, for pixels of no kind.
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
        for width, down, gain in reaches:
            sums = sums + gain * blur(values * weight, width, down)
            weights = weights + gain * blur(weight, width, down)
        result = result + kind * sums / weights
        total = total + kind
    return np.asarray(result / total, np.float32)


def remove_shadows(
    background: Rgb,
    coverage: F32,
    predicted: F32,
    size: float,
    *,
    is_soft: bool = False,
) -> Rgb:
    """Return the background without shadows.

    `predicted` (H, W) is -log of the remaining light; `size` is the size of a typical
    object, px. Soft shade (`is_soft`) has no edges that would show how deep it is: its
    ground becomes at most as bright as similar ground nearby.
    """
    free = away_from_objects(coverage).astype(np.float32)
    shadow_mask = predicted > 0.01
    rows, columns = (
        np.flatnonzero(shadow_mask.any(axis=1)),
        np.flatnonzero(shadow_mask.any(axis=0)),
    )
    if not len(rows):
        return background
    pad = int(4 * size)
    part = np.s_[
        max(rows[0] - pad // 2, 0) : rows[-1] + pad // 2,
        max(columns[0] - pad, 0) : columns[-1] + pad,
    ]
    linear = decode(background[part])
    darkness, clean_light = _Removal(
        linear, free[part], predicted[part], size
    ).darkness()
    result = background.copy()
    light_part = lightened(background[part], darkness, clean_light, free[part])
    if is_soft:
        light_part = _not_brighter(light_part, background[part], clean_light)
    result[part] = light_part
    return result


def _not_brighter(lifted: Rgb, background: Rgb, clean: F32) -> Rgb:
    """Return `lifted` (h, w, 3), locally at most as bright as similar ground `clean`.

    It stays at least as bright as the `background`, and keeps its grain.
    """
    light, before = decode(lifted), decode(background)
    levels = [cv2.GaussianBlur(part, (0, 0), LEVEL_REACH) for part in (clean, light)]
    gain = np.minimum(levels[0] / np.maximum(levels[1], DARKEST), 1)
    limited_light = np.maximum(light * gain, before).astype(np.float32)
    is_lifted = (lifted != background).any(axis=2, keepdims=True)
    return np.where(is_lifted, encode_u8(limited_light), background)


def lightened(background: Rgb, dark: F32, clean: F32, free: F32) -> Rgb:
    """Return the background (h, w, 3) without the shadow `dark` (h, w), -log of light.

    The surfaces are `clean` (h, w, 3) in full light. The blocked light has one colour,
    which is measured where the background is `free` (h, w).
    """
    linear, blocked_share, in_shadow = (
        decode(background),
        1 - np.exp(-dark),
        dark > 1e-3,
    )
    left = 1 - blocked_share[..., None] * _tint(linear, clean, blocked_share, free)
    light = linear / np.maximum(left, 0.04)
    limit = np.maximum(linear, _brightest_ground(linear, clean, free * (dark < FAINT)))
    return np.where(
        in_shadow[..., None], encode_u8(np.minimum(light, limit)), background
    )


def _brightest_ground(linear: F32, clean: F32, lit: F32) -> F32:
    """Return the brightness (h, w, 3) of the ground with its grain, measured where it
    is `lit`.

    Beside an object the shadow is not measured, and geometry alone may remove too much.
    """
    grain = ((linear - clean) * lit[..., None]) ** 2
    result = np.empty_like(clean)
    for channel in range(3):
        spread = _mean(grain[..., channel], lit, GROUND_REACH, GROUND_REACH) ** 0.5
        result[..., channel] = clean[..., channel] + GROUND_GRAIN * spread
    return result


def edge_ratio(background: Rgb, clean: Rgb, coverage: F32) -> float:
    """Return the ratio of gradients after and before removal in the changed region.

    The ratio is below 1 if a shadow's edges disappeared, above 1 if new edges appeared,
    and 1 without a change.
    """
    free = away_from_objects(coverage, 3)
    logs = [
        np.log(luminance(decode(picture)) + DARKEST) for picture in (background, clean)
    ]
    changed_region = (
        cv2.dilate(
            (np.abs(logs[1] - logs[0]) > 0.02).astype(np.uint8),
            np.ones((7, 7), np.uint8),
        )
        > 0
    )
    known_weights = free.astype(np.float32)
    known_share = np.maximum(
        cv2.GaussianBlur(known_weights, (0, 0), TUNING.smooth), 0.05
    )
    sums = []
    for part in logs:
        slopes = np.gradient(
            cv2.GaussianBlur(part * known_weights, (0, 0), TUNING.smooth) / known_share
        )
        sums.append(float(np.hypot(*slopes)[changed_region & free].sum()))
    before, after = sums
    return after / before if before > 0 else 1.0


@dataclass(frozen=True)
class _Removal:
    """One part of the photo, its objects, and the shadows predicted in it."""

    linear: F32
    free: F32
    predicted: F32
    size: float

    def darkness(self) -> tuple[F32, F32]:
        """Return -log (h, w) of the missing light, and the light (h, w, 3) of such
        surfaces elsewhere.
        """
        free, prediction, size = self.free, self.predicted, self.size
        light_level = np.log(luminance(self.linear) + DARKEST).astype(np.float32)
        reference = free * (prediction < TUNING.shaded)
        kinds = hue_weights(self.linear, reference, 8000)
        reach = 3 * size, 0.5 * size
        level = self._level(light_level, reference, kinds)
        noise = (
            _mean(((level - light_level) * reference) ** 2, reference, *reach) ** 0.5
        )
        search_size = (
            2 * round(TUNING.astray * size) + 1,
            2 * round(0.5 * TUNING.astray * size) + 1,
        )
        local_prediction = np.asarray(
            cv2.dilate(prediction, np.ones(search_size[::-1], np.uint8)), np.float32
        )
        least_depth = np.maximum(2.5 * noise, TUNING.part * local_prediction)
        # A dark patch is not a reference for lit surfaces: exclude it and repeat.
        for _ in range(2):
            missing_light = np.asarray(
                cv2.medianBlur(level - light_level, 3), np.float32
            )
            patch = _dark_patches(
                missing_light, free * (local_prediction > 0.05), prediction, least_depth
            )
            reference = reference * (1 - cv2.dilate(patch, np.ones((7, 7), np.uint8)))
            level = self._level(light_level, reference, kinds)
        logs = np.log(self.linear + DARKEST).astype(np.float32)
        channel_levels = [self._level(logs[..., c], reference, kinds) for c in range(3)]
        clean_light = np.asarray(
            np.exp(np.stack(channel_levels, axis=-1)) - DARKEST, np.float32
        )
        # Compare the photo's difference from the prediction, wide and fine, with the
        # grain around.
        residual = (missing_light - prediction) * free
        grain = (level - light_level) * reference
        wide_residual = _mean(residual, free, TUNING.wide * size, 0.15 * size)
        fine_residual = np.asarray(
            cv2.medianBlur(residual - wide_residual * free, 3), np.float32
        )
        noise_wide = _mean(grain, reference, TUNING.wide * size, 0.15 * size)
        noise_fine = cv2.medianBlur(grain, 3) - noise_wide
        depth_map = prediction + _above_noise(
            wide_residual, _mean(noise_wide**2, reference, *reach), 1.0
        )
        quiet = _mean(noise_fine**2, reference, *reach)
        depth_map = depth_map + _above_noise(fine_residual, quiet, TUNING.loud)
        # A dark patch that is partly predicted is a shadow in its whole shape: use the
        # measured depth at its edge and a smooth depth inside.
        depth = cv2.distanceTransform(patch, cv2.DIST_L2, 3)
        inside = np.clip((depth - TUNING.rim) / 2, 0, 1).astype(np.float32)
        smooth_depth = _mean(missing_light * inside, inside, 0.12 * size, 0.04 * size)
        patch_depth = missing_light + inside * (
            smooth_depth
            + _above_noise(missing_light - smooth_depth, quiet, TUNING.loud)
            - missing_light
        )
        belongs = (
            blur_wide(
                cv2.dilate(patch, np.ones((5, 5), np.uint8)).astype(np.float32),
                1.0,
                1.0,
            )
            * free
        )
        depth_map = belongs * patch_depth + (1 - belongs) * depth_map
        # Regions darker than any shadow are other surfaces and stay.
        other = cv2.dilate(
            ((missing_light > TUNING.other) & (free > 0)).astype(np.uint8),
            np.ones((5, 5), np.uint8),
        )
        window = np.maximum(self._reach(), belongs) * (
            1 - blur_wide(other.astype(np.float32), 1.0, 1.0)
        )
        depth_map = (
            np.clip(depth_map, 0, TUNING.most * local_prediction + TUNING.faint)
            * window
        )
        return np.asarray(depth_map, np.float32), clean_light

    def _level(self, values: F32, plain: F32, kinds: Sequence[F32]) -> F32:
        """Return the mean (h, w) of similar surfaces nearby, mainly along the rows."""
        reaches = [
            (a * self.size, max(d * self.size, 0.7), gain)
            for a, d, gain in TUNING.reaches
        ]
        return mean_of_kind(values, plain, kinds, reaches, tiny=1e-12)

    def _reach(self) -> F32:
        """Return a weight (h, w), 0..1, of possible shadows."""
        side = 2 * max(1, round(0.06 * self.size)) + 1
        dilated_prediction = cv2.dilate(
            self.predicted, cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (side, side))
        )
        smooth_reach = blur_wide(
            np.asarray(dilated_prediction, np.float32),
            0.05 * self.size,
            0.03 * self.size,
        )
        return np.asarray(np.clip(smooth_reach / 0.06, 0, 1), np.float32)


def _above_noise(value: F32, variance: F32, times: float) -> F32:
    """Return the part of a value above noise: Wiener's rule with a threshold."""
    share = np.clip(1 - times**2 * variance / np.maximum(value * value, 1e-6), 0, 1)
    return np.asarray(value * share, np.float32)


def _dark_patches(
    missing: F32, free: F32, predicted: F32, least: F32
) -> NDArray[np.uint8]:
    """Return 1 (h, w) in dark patches that are partly predicted, else 0.

    `least` is the least depth of a dark pixel.
    """
    prediction_mask = (predicted > 0.02) & (free > 0)
    dark_mask = ((missing > np.maximum(least, TUNING.faint)) & (free > 0)).astype(
        np.uint8
    )
    _, names, stats, _ = cv2.connectedComponentsWithStats(dark_mask, connectivity=4)
    area = stats[:, cv2.CC_STAT_AREA]
    counts = np.bincount(
        names.ravel(), weights=prediction_mask.ravel(), minlength=len(stats)
    )
    chosen_patches = (counts > TUNING.own * area) & (area > 12)
    chosen_patches[0] = False
    return np.asarray(chosen_patches[names].astype(np.uint8))


def _mean(values: F32, weight: F32, across: float, down: float) -> F32:
    """Return the local mean of known values; `values` are 0 at unknown pixels."""
    weights = blur_wide(weight, across, max(down, 0.7))
    return np.asarray(
        blur_wide(values, across, max(down, 0.7)) / np.maximum(weights, 1e-3),
        np.float32,
    )


def _tint(linear: F32, clean: F32, gone: F32, free: F32) -> F32:
    """Return the darkening (3,) of each channel over the luminance's: the blocked
    light's colour.
    """
    measured_mask = (gone > 0.2) & (free > 0) & (clean.min(axis=2) > 5e-3)
    if np.count_nonzero(measured_mask) < 100:
        return np.ones(3, np.float32)
    channel_loss, total_loss = (
        1 - linear[measured_mask] / clean[measured_mask],
        gone[measured_mask][:, None],
    )
    share = (channel_loss * total_loss).sum(axis=0) / (total_loss * total_loss).sum()
    return np.asarray(np.clip(share, *TUNING.tint), np.float32)


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
    return (
        result
        if standing is None
        else remove_reflections(result, standing, coverage, inpaint)
    )


def _refill_shadow(
    removed: Rgb, background: Rgb, coverage: F32, inpaint: Inpaint
) -> Rgb:
    plan = plan_refill(removed, background, coverage)
    old = np.where(plan.dark[..., None], background, removed)
    if not plan.hole.any():
        return old
    fill_result = inpaint(old, plan.hole)
    new = plan.hole & ~plan.unlike(
        luminance(decode(fill_result)), luminance(decode(old))
    )
    return np.where(new[..., None], fill_result, old)


@dataclass(frozen=True, eq=False)
class RefillPlan:
    """The pieces of a background that are filled again, and their possible
    brightness.
    """

    hole: Mask
    """(H, W): pieces beside a removed shadow."""
    dark: Mask
    """(H, W): all pixels behind objects, or too close to them to be measured."""
    pieces: NDArray[np.int32]
    """(H, W): number of the nearest piece of `dark`."""
    shadows: Mask
    """(H, W): pixels beside objects with added light."""
    left: F32
    """(H, W): share of the light in the shadows."""

    def unlike(self, filled: F32, old: F32) -> Mask:
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
                    np.quantile(1 / self.left[shadow_beside], 1 - REFILL.outliers)
                )
            share = np.quantile(brighter[self.hole & region], 1 - REFILL.outliers)
            if share > REFILL.brighter * largest_gain:
                result |= region
        return result


def plan_refill(removed: Rgb, background: Rgb, coverage: F32) -> RefillPlan:
    """Return the plan of the second fill, where `removed` lacks shadows of
    `background`.
    """
    object_mask = (coverage > 0).astype(np.uint8)
    difference = cv2.absdiff(removed, background).max(axis=2)
    change_mask = difference > REFILL.visible
    shadows = change_mask & (object_mask == 0)
    near_shadow = _widened(shadows.astype(np.uint8), REFILL.near)
    gap = np.ones((2 * REFILL.gap + 1, 2 * REFILL.gap + 1), np.uint8)
    ring = _widened(object_mask, REFILL.ring)
    closed_ring = np.asarray(cv2.morphologyEx(ring, cv2.MORPH_CLOSE, gap), np.uint8)
    left = (luminance(decode(background)) + 1e-3) / (luminance(decode(removed)) + 1e-3)
    deep_shadow = (left < REFILL.deep) & (_widened(object_mask, REFILL.near) > 0)
    unknown_mask = (
        object_mask
        | (closed_ring & near_shadow)
        | _widened(deep_shadow.astype(np.uint8), 1)
    ) > 0
    pieces = (
        nearest_piece(unknown_mask)
        if unknown_mask.any()
        else np.zeros(unknown_mask.shape, np.int32)
    )
    piece_numbers = np.unique(pieces[unknown_mask & (near_shadow > 0)])
    hole = unknown_mask & np.isin(pieces, piece_numbers)
    return RefillPlan(hole, unknown_mask, pieces, shadows, np.asarray(left, np.float32))


def _widened(mask: NDArray[np.uint8], reach: int) -> NDArray[np.uint8]:
    """Return a mask (H, W) of 0 and 1, dilated by `reach` px in all directions."""
    kernel = np.ones((2 * reach + 1, 2 * reach + 1), np.uint8)
    return np.asarray(cv2.dilate(mask, kernel), np.uint8)


def remove_reflections(
    clean: Rgb, labels: Labels, coverage: F32, inpaint: Inpaint
) -> Rgb:
    """Return `clean` (H, W, 3) of a photo from the side without reflections on the
    floor.

    A reflection lies inside the object's mirror image below its foot, begins at the
    foot and differs from its rows by more than their texture.
    """
    mirror_labels, widths = np.zeros_like(labels), np.zeros(int(labels.max()) + 1)
    height, areas = len(labels), np.bincount(labels.ravel())[1:]
    size = float(np.median(areas[areas > 0]) ** 0.5) if areas.any() else 1.0
    # Mirror each object that stands on the floor at its foot.
    for number in np.unique(labels[labels > 0]):
        object_mask = np.where(labels == number, number, 0).astype(labels.dtype)
        left, top, width, object_height = cv2.boundingRect(
            (object_mask > 0).astype(np.uint8)
        )
        foot, depth = (
            top + object_height,
            min(object_height, height - top - object_height),
        )
        stands_on_object = (
            np.mean(labels[min(foot + 2, height - 1), left : left + width] > 0)
            > REFLECTION.another
        )
        if depth > REFILL.ring and not stands_on_object:
            np.maximum(
                mirror_labels[foot : foot + depth],
                object_mask[foot - depth : foot][::-1],
                out=mirror_labels[foot : foot + depth],
            )
            widths[number] = np.ptp(
                np.flatnonzero(
                    object_mask[
                        foot - 1 - int(REFLECTION.foot * object_height) : foot
                    ].any(axis=0)
                )
            )
    mirror_labels = np.asarray(
        cv2.dilate(mirror_labels, np.ones((1, 2 * REFILL.ring + 1), np.uint8)),
        labels.dtype,
    )
    free = away_from_objects(coverage, REFILL.ring).astype(np.float32)
    # The light of the floor without reflections comes from pixels outside all mirror
    # images.
    reference = free * (mirror_labels == 0)
    reaches = [(a * size, max(d * size, 0.7), gain) for a, d, gain in TUNING.reaches]
    single_kind = [np.ones_like(free)]
    logs = cv2.split(np.log(decode(clean) + REFLECTION.dark))
    rests = [
        part - mean_of_kind(part, reference, single_kind, reaches, tiny=1e-12)
        for part in logs
    ]
    rests = [
        _mean(rest * free, free, REFLECTION.smooth, REFLECTION.smooth) for rest in rests
    ]
    differs = np.asarray(np.max(np.abs(rests), axis=0), np.float32)
    texture = np.sqrt(
        mean_of_kind(differs**2, reference, single_kind, reaches[1:], tiny=1e-12)
    )
    # A reflection differs by more than the texture of the rows.
    difference_mask = (
        (differs > np.maximum(REFLECTION.loud * texture, REFLECTION.least)) & (free > 0)
    ).astype(np.uint8)
    count, names, stats, _ = cv2.connectedComponentsWithStats(
        difference_mask, connectivity=4
    )
    area, inside = (
        stats[:, cv2.CC_STAT_AREA],
        np.bincount(names.ravel(), (mirror_labels > 0).ravel(), count),
    )
    rim_mask = (mirror_labels > 0) & ~away_from_objects(coverage, 2 * REFILL.ring)
    owner = np.zeros(count, np.int64)
    owner[names[rim_mask]] = mirror_labels[rim_mask]
    broad_pieces = stats[:, cv2.CC_STAT_WIDTH] > REFLECTION.wide * widths[owner]
    level = (
        np.abs(np.bincount(names.ravel(), np.mean(rests, axis=0).ravel(), count)) / area
    )
    reflections = (
        (area > SPECK)
        & (inside > REFLECTION.inside * area)
        & (owner > 0)
        & broad_pieces
        & (level < REFLECTION.most)
    )
    reflections[0] = False
    if not reflections.any():
        return clean
    hole = (
        cv2.dilate(reflections[names].astype(np.uint8), np.ones((5, 5), np.uint8)) > 0
    )
    fill_result = fill_from_surroundings(clean, hole, inpaint)
    return np.where(hole[..., None], fill_result, clean)


# Owners of shadows.


def shadow_owners(
    background: Rgb,
    clean: Rgb,
    coverage: F32,
    casts: Iterable[tuple[int, PixelBox, F32]],
) -> Labels | None:
    """Return the id (H, W) of the object that casts each shadow, 0 = none, or None.

    `casts` gives, per object, its id and -log of its remaining light in a box of the
    photo. None means that no shadow is visible.
    """
    owner, strongest = _strongest(casts, coverage.shape)
    shadow_mask = (1 - SHARE) * removed_light(
        background, clean, coverage
    ) + SHARE * strongest > FAINT
    return assign_regions(shadow_mask & (coverage < 0.5), owner)


def shadow_owners_by_model(
    coverage: F32, casts: Iterable[tuple[int, PixelBox, F32]], dark: F32
) -> Labels | None:
    """Return the owners if `dark` (H, W), -log of light, is known from the model.

    The photo is then too coarse to correct the model.
    """
    owner, _ = _strongest(casts, coverage.shape)
    return assign_regions((dark > FAINT) & (coverage < 0.5), owner)


def _strongest(
    casts: Iterable[tuple[int, PixelBox, F32]], shape: tuple[int, ...]
) -> tuple[Labels, F32]:
    """Return the object (H, W) that blocks most light, and -log of the remaining
    light.
    """
    owner, strongest = np.zeros(shape, np.uint16), np.zeros(shape, np.float32)
    for number, (x0, y0, x1, y1), values in casts:
        part = np.s_[y0:y1, x0:x1]
        is_stronger = values > np.maximum(strongest[part], PREDICTED)
        owner[part][is_stronger] = number
        strongest[part][is_stronger] = values[is_stronger]
    return owner, strongest


def removed_light(background: Rgb, clean: Rgb, coverage: F32) -> F32:
    """Return -log (H, W) of the removed light, smoothed.

    Directly beside objects, where none is removed, the missing light counts: contact
    shadows lie there.
    """
    logs = [
        np.log(luminance(decode(picture)) + DARKEST) for picture in (clean, background)
    ]
    free = away_from_objects(coverage).astype(np.float32)
    known_share = np.maximum(cv2.GaussianBlur(free, (0, 0), SMOOTH), 1e-2)
    log_gain, level = (
        cv2.GaussianBlur(part.astype(np.float32) * free, (0, 0), SMOOTH) / known_share
        for part in (logs[0] - logs[1], logs[0])
    )
    contact = np.where(
        (free == 0) & (known_share > 0.05),
        level - cv2.GaussianBlur(logs[1], (0, 0), 0.7),
        0,
    )
    return np.asarray(np.maximum(log_gain, contact), np.float32)


def assign_regions(dark: Mask, owner: Labels) -> Labels | None:
    """Return `owner` (H, W) inside `dark` regions, elsewhere in them the nearest owner,
    or None.

    Specks are removed.
    """
    if not owner.any():
        return None
    count, names, stats, _ = cv2.connectedComponentsWithStats(
        dark.astype(np.uint8), connectivity=8
    )
    # A patch that no object predicts is not a shadow.
    has_owner = np.bincount(names[owner > 0], minlength=count) > 0
    valid_patches = has_owner & (stats[:, cv2.CC_STAT_AREA] >= SPECK)
    valid_patches[0] = False
    region = valid_patches[names]
    if not region.any():
        return None
    _, nearest = cv2.distanceTransformWithLabels(
        (owner == 0).astype(np.uint8), cv2.DIST_L2, 5, labelType=cv2.DIST_LABEL_PIXEL
    )
    ids = np.zeros(int(nearest.max()) + 1, np.uint16)
    ids[nearest[owner > 0]] = owner[owner > 0]
    return np.where(region, ids[nearest], 0).astype(np.uint16)
