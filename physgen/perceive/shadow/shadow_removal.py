"""Removal of shadows from a background.

The light of a place without its shadow comes from the same kind of surface nearby,
first along the row, since a floor seen from the side changes least in that direction.
The missing light follows the prediction of geometry; if the photo differs by more than
the surface's grain, the photo is used. Finer detail is grain and stays.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.maps import F32
from physgen.perceive.roles import Rgb
from physgen.perceive.shadow.silhouettes import DARKEST, away_from_objects
from physgen.perceive.shadow.surface_kinds import (
    blur_wide,
    hue_weights,
    local_mean,
    mean_of_kind,
)
from physgen.photometry import decode, encode_u8, luminance

# -log of light, smoothed: the faintest visible shadow.
FAINT = 0.08
# px: standard deviation of the blur over which grain is measured.
GROUND_REACH = 20.0
# Standard deviations by which single grains may be brighter.
GROUND_GRAIN = 2.0
# px: standard deviation of the blur over which ground is as bright as similar ground.
LEVEL_REACH = 6.0


@dataclass(frozen=True)
class _Tuning:
    """Sizes are shares of an object's, depths are -log of light."""

    # Least predicted depth of a shaded place.
    shade_depth: float = 0.03
    reaches: tuple[tuple[float, float, float], ...] = (
        (0.6, 0.03, 1.0), (2.0, 0.06, 0.05), (5.0, 0.12, 2e-3), (1.5, 0.5, 1e-4), (6.0, 1.0, 1e-6),
    )  # fmt: skip
    # Standard deviations of the grain up to which a difference is grain.
    noise_ratio: float = 2.0
    # Width of the blur: a wider difference is a shadow missed by geometry, a finer one
    # an edge or grain.
    blur_width: float = 0.3
    # Least depth of a dark patch ...
    least_depth: float = 0.1
    # ... also as a share of the depth predicted nearby.
    least_share: float = 0.45
    # Largest depth over the depth predicted nearby: darker patches are not shadows.
    largest_ratio: float = 1.7
    # Depth above which a dark patch is another surface, because no shadow is as deep.
    largest_depth: float = 2.5
    # Least predicted share of a completely removed dark patch.
    own_share: float = 0.3
    # Largest distance of a shadow from its prediction; half as much vertically.
    shift: float = 0.15
    # px from its border in which the measured depth of a dark patch is used.
    rim: float = 3.0
    # px: width of the smoothing of gradients against grain.
    slope_blur: float = 2.0
    # Least and largest darkening of one channel over the average.
    tint: tuple[float, float] = (
        0.6,
        1.35,
    )


TUNING = _Tuning()


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
    rows = np.flatnonzero(shadow_mask.any(axis=1))
    columns = np.flatnonzero(shadow_mask.any(axis=0))
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
    light_part = lighten(background[part], darkness, clean_light, free[part])
    if is_soft:
        light_part = _not_brighter(light_part, background[part], clean_light)
    result[part] = light_part
    return result


def _not_brighter(lifted: Rgb, background: Rgb, clean: F32) -> Rgb:
    """Return `lifted` (h, w, 3), locally at most as bright as similar ground `clean`.

    It stays at least as bright as the `background`, and keeps its grain.
    """
    light = decode(lifted)
    before = decode(background)
    levels = [cv2.GaussianBlur(part, (0, 0), LEVEL_REACH) for part in (clean, light)]
    gain = np.minimum(levels[0] / np.maximum(levels[1], DARKEST), 1)
    limited_light = np.maximum(light * gain, before).astype(np.float32)
    is_lifted = (lifted != background).any(axis=2, keepdims=True)
    return np.where(is_lifted, encode_u8(limited_light), background)


def lighten(background: Rgb, dark: F32, clean: F32, free: F32) -> Rgb:
    """Return the background (h, w, 3) without the shadow `dark` (h, w), -log of light.

    The surfaces are `clean` (h, w, 3) in full light. The blocked light has one colour,
    which is measured where the background is `free` (h, w).
    """
    linear = decode(background)
    blocked_share = 1 - np.exp(-dark)
    in_shadow = dark > 1e-3
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
        spread = local_mean(grain[..., channel], lit, GROUND_REACH, GROUND_REACH) ** 0.5
        result[..., channel] = clean[..., channel] + GROUND_GRAIN * spread
    return result


def edge_ratio(background: Rgb, clean: Rgb, coverage: F32) -> float:
    """Return the ratio of gradients after and before removal in the changed region.

    The ratio is below 1 if a shadow's edges disappeared, above 1 if new edges appeared,
    and 1 without a change.
    """
    free = away_from_objects(coverage, 3)
    logs = []
    for picture in (background, clean):
        logs.append(np.log(luminance(decode(picture)) + DARKEST))
    changed_region = (
        cv2.dilate(
            (np.abs(logs[1] - logs[0]) > 0.02).astype(np.uint8),
            np.ones((7, 7), np.uint8),
        )
        > 0
    )
    known_weights = free.astype(np.float32)
    known_share = np.maximum(
        cv2.GaussianBlur(known_weights, (0, 0), TUNING.slope_blur), 0.05
    )
    sums = []
    for part in logs:
        slopes = np.gradient(
            cv2.GaussianBlur(part * known_weights, (0, 0), TUNING.slope_blur)
            / known_share
        )
        sums.append(float(np.hypot(*slopes)[changed_region & free].sum()))
    before, after = sums
    if before > 0:
        return after / before
    return 1.0


@dataclass(frozen=True)
class _Measurement:
    """The light of a part of the photo, compared with similar surfaces in full light.

    All maps are (h, w), logarithms of light.
    """

    # 1 on lit ground, else 0.
    reference: F32
    # Light of similar surfaces minus the photo's light.
    difference: F32
    # The same without its finest detail, before the last dark patches were excluded.
    missing_light: F32
    # (h, w, 3), linear: light of similar surfaces.
    clean_light: F32
    # 1 in dark patches that are partly predicted.
    patches: NDArray[np.uint8]


@dataclass(frozen=True)
class _Removal:
    """One part of the photo, its objects, and the shadows predicted in it."""

    linear: F32
    free: F32
    prediction: F32
    size: float

    def darkness(self) -> tuple[F32, F32]:
        """Return -log (h, w) of the missing light, and the light (h, w, 3) of such
        surfaces elsewhere.
        """
        local_prediction = self._local_prediction()
        measurement = self._measure(local_prediction)
        depth_map, quiet = self._corrected_prediction(measurement)
        patches = cv2.dilate(measurement.patches, np.ones((5, 5), np.uint8))
        belongs = blur_wide(patches.astype(np.float32), 1.0, 1.0) * self.free
        patch_depth = self._patch_depth(measurement, quiet)
        depth_map = belongs * patch_depth + (1 - belongs) * depth_map
        # Regions darker than any shadow are other surfaces and stay.
        other = cv2.dilate(
            (
                (measurement.missing_light > TUNING.largest_depth) & (self.free > 0)
            ).astype(np.uint8),
            np.ones((5, 5), np.uint8),
        )
        window = np.maximum(self._reach(), belongs) * (
            1 - blur_wide(other.astype(np.float32), 1.0, 1.0)
        )
        largest_depth = TUNING.largest_ratio * local_prediction + TUNING.least_depth
        depth_map = np.clip(depth_map, 0, largest_depth) * window
        return np.asarray(depth_map, np.float32), measurement.clean_light

    def _local_prediction(self) -> F32:
        """Return the largest predicted depth (h, w) nearby."""
        search_size = (
            2 * round(TUNING.shift * self.size) + 1,
            2 * round(0.5 * TUNING.shift * self.size) + 1,
        )
        kernel = np.ones(search_size[::-1], np.uint8)
        return np.asarray(cv2.dilate(self.prediction, kernel), np.float32)

    def _measure(self, local_prediction: F32) -> _Measurement:
        """Return the missing light; `local_prediction` (h, w) is predicted nearby."""
        light_level = np.log(luminance(self.linear) + DARKEST).astype(np.float32)
        reference = self.free * (self.prediction < TUNING.shade_depth)
        kinds = hue_weights(self.linear, reference, 8000)
        level = self._level(light_level, reference, kinds)
        noise = self._variance((level - light_level) * reference, reference) ** 0.5
        least_depth = np.maximum(2.5 * noise, TUNING.least_share * local_prediction)
        searched_ground = self.free * (local_prediction > 0.05)
        # A dark patch is not a reference for lit surfaces: exclude it and repeat.
        for _ in range(2):
            missing_light = np.asarray(
                cv2.medianBlur(level - light_level, 3), np.float32
            )
            patches = _dark_patches(
                missing_light, searched_ground, self.prediction, least_depth
            )
            reference = reference * (1 - cv2.dilate(patches, np.ones((7, 7), np.uint8)))
            level = self._level(light_level, reference, kinds)
        clean_light = self._clean_light(reference, kinds)
        return _Measurement(
            reference, level - light_level, missing_light, clean_light, patches
        )

    def _clean_light(self, reference: F32, kinds: Sequence[F32]) -> F32:
        """Return the light (h, w, 3) of surfaces like each pixel's on the reference."""
        logs = np.log(self.linear + DARKEST).astype(np.float32)
        channel_levels = [self._level(logs[..., c], reference, kinds) for c in range(3)]
        return np.asarray(
            np.exp(np.stack(channel_levels, axis=-1)) - DARKEST, np.float32
        )

    def _corrected_prediction(self, measurement: _Measurement) -> tuple[F32, F32]:
        """Return the prediction (h, w), corrected where the photo differs by more than
        the grain, and the variance of fine grain.

        The difference is compared wide and fine with the grain around.
        """
        reference = measurement.reference
        residual = (measurement.missing_light - self.prediction) * self.free
        grain = measurement.difference * reference
        wide_residual = self._wide_mean(residual, self.free)
        fine_residual = np.asarray(
            cv2.medianBlur(residual - wide_residual * self.free, 3), np.float32
        )
        noise_wide = self._wide_mean(grain, reference)
        noise_fine = cv2.medianBlur(grain, 3) - noise_wide
        depth_map = self.prediction + _above_noise(
            wide_residual, self._variance(noise_wide, reference), 1.0
        )
        quiet = self._variance(noise_fine, reference)
        depth_map = depth_map + _above_noise(fine_residual, quiet, TUNING.noise_ratio)
        return depth_map, quiet

    def _patch_depth(self, measurement: _Measurement, quiet: F32) -> F32:
        """Return the depth (h, w) of dark patches; `quiet` is the variance of grain.

        A dark patch that is partly predicted is a shadow in its whole shape: use the
        measured depth at its edge and a smooth depth inside.
        """
        size = self.size
        missing_light = measurement.missing_light
        depth = cv2.distanceTransform(measurement.patches, cv2.DIST_L2, 3)
        inside = np.clip((depth - TUNING.rim) / 2, 0, 1).astype(np.float32)
        smooth_depth = local_mean(
            missing_light * inside, inside, 0.12 * size, 0.04 * size
        )
        return missing_light + inside * (
            smooth_depth
            + _above_noise(missing_light - smooth_depth, quiet, TUNING.noise_ratio)
            - missing_light
        )

    def _variance(self, noise: F32, weight: F32) -> F32:
        """Return the local mean (h, w) of squared noise."""
        return local_mean(noise**2, weight, 3 * self.size, 0.5 * self.size)

    def _wide_mean(self, values: F32, weight: F32) -> F32:
        """Return the local mean (h, w) in which a difference is wide."""
        return local_mean(
            values, weight, TUNING.blur_width * self.size, 0.15 * self.size
        )

    def _level(self, values: F32, plain: F32, kinds: Sequence[F32]) -> F32:
        """Return the mean (h, w) of similar surfaces nearby, mainly along the rows."""
        reaches = []
        for a, d, gain in TUNING.reaches:
            reaches.append((a * self.size, max(d * self.size, 0.7), gain))
        return mean_of_kind(values, plain, kinds, reaches, tiny=1e-12)

    def _reach(self) -> F32:
        """Return a weight (h, w), 0..1, of possible shadows."""
        side = 2 * max(1, round(0.06 * self.size)) + 1
        dilated_prediction = cv2.dilate(
            self.prediction, cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (side, side))
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
    dark_mask = ((missing > np.maximum(least, TUNING.least_depth)) & (free > 0)).astype(
        np.uint8
    )
    _, names, stats, _ = cv2.connectedComponentsWithStats(dark_mask, connectivity=4)
    area = stats[:, cv2.CC_STAT_AREA]
    counts = np.bincount(
        names.ravel(), weights=prediction_mask.ravel(), minlength=len(stats)
    )
    chosen_patches = (counts > TUNING.own_share * area) & (area > 12)
    chosen_patches[0] = False
    return np.asarray(chosen_patches[names].astype(np.uint8))


def _tint(linear: F32, clean: F32, gone: F32, free: F32) -> F32:
    """Return the darkening (3,) of each channel over the luminance's: the blocked
    light's colour.
    """
    measured_mask = (gone > 0.2) & (free > 0) & (clean.min(axis=2) > 5e-3)
    if np.count_nonzero(measured_mask) < 100:
        return np.ones(3, np.float32)
    channel_loss = 1 - linear[measured_mask] / clean[measured_mask]
    total_loss = gone[measured_mask][:, None]
    share = (channel_loss * total_loss).sum(axis=0) / (total_loss * total_loss).sum()
    return np.asarray(np.clip(share, *TUNING.tint), np.float32)
