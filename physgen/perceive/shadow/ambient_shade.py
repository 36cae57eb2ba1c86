"""Shade of soft light around the feet and rims of objects.

Under an overcast sky, or lamps on all sides, an object's surroundings are dark where
they are exposed to the least of the sky. Geometry predicts these places without a known
light. The shade is accepted if the photo is darker at these places than at all similar
places nearby. The light without shade comes from surfaces of the same colour outside
these places. Paint can be dark as well, but rarely at exactly the predicted places.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import inf, radians, tan

import cv2
import numpy as np

from physgen.geometry.shadows import ShadowSetting, Silhouette
from physgen.maps import F32
from physgen.perceive.roles import Mask, Rgb
from physgen.perceive.shadow.shadow_fit import FULL
from physgen.perceive.shadow.silhouettes import (
    DARKEST,
    MARGIN,
    away_from_objects,
    predicted_darkness,
    typical_size,
)
from physgen.perceive.shadow.surface_kinds import blur_wide, hue_weights, mean_of_kind
from physgen.photometry import DistantLight, decode, luminance


@dataclass(frozen=True)
class _Tuning:
    """Sizes are shares of an object's, horizontal and vertical; depths are -log of
    light.
    """

    # px: longer side of the analysed picture.
    longest: int = 512
    # Candidate skies: direct share, and tilt of the camera in degrees.
    skies: tuple[tuple[float, float], ...] = ((0.0, 5.7), (0.6, 9.6))
    # degrees: angular radius of such a light.
    light_radius: float = 40.0
    # Least predicted depth of places for the comparison with ...
    shade_depth: float = 0.05
    # ... places below this depth.
    reference_depth: float = 0.02
    # Predicted depth above which a place is no reference for full light.
    possible_shade_depth: float = 0.03
    # Reach of the comparison in a side view ...
    beside_side: tuple[float, float] = (
        0.4,
        0.15,
    )
    # ... and in a top view.
    beside_top: tuple[float, float] = (0.3, 0.3)
    # Shifts at which dark places occur only by chance.
    nearby: tuple[float, ...] = (
        0.5,
        1.0,
        1.5,
        2.0,
    )
    # Least ratio of contrast to chance (studio photos of the split `tune`).
    least_ratio: float = 6.0
    # Least contrast of shade.
    least_contrast: float = 0.025
    # Least and largest ratio of measured to predicted depth: a darker place is another
    # surface, or shade of the objects' support.
    least_factor: float = 0.3
    most_factor: float = 1.5
    side_reaches: tuple[tuple[float, float, float], ...] = (
        (0.7, 0.08, 1.0), (2.0, 0.16, 0.05), (4.0, 0.6, 2e-3), (8.0, 2.0, 1e-5),
    )  # fmt: skip
    """Reach and weight of similar surfaces on a floor seen from the side, where a row
    has one distance.
    """
    top_reaches: tuple[tuple[float, float, float], ...] = (
        (0.5, 0.5, 1.0),
        (1.0, 1.0, 0.05),
        (3.0, 3.0, 2e-3),
    )
    """The same on a table seen from above."""
    # px: standard deviations; from above the mean of both in both directions.
    smoothing_widths: tuple[float, float] = (3.0, 1.2)
    # Least free share of a place ...
    visible: float = 0.4
    # ... and its least free px.
    least_count: int = 40
    # Contrast below which no surface is more even.
    quiet: float = 5e-3
    # px: widths of the means that extend a rim's depth behind the object.
    rims: tuple[float, ...] = (30.0, 8.0, 2.0)


TUNING = _Tuning()


@dataclass(frozen=True)
class AmbientShade:
    """Shade of soft light, in px of the photo."""

    setting: ShadowSetting
    # Ratio of measured and predicted depth, as logarithms of light.
    factor: float
    # Ratio of contrast and chance.
    chance_ratio: float
    # (H, W): -log of the missing light, smoothed.
    depth: F32

    @property
    def confidence(self) -> float:
        """Return the confidence, 0..1."""
        return round(min(0.7, 0.1 * self.chance_ratio), 2)


@dataclass(frozen=True)
class _ReducedGround:
    """The reduced photo in which shade is searched, and its objects."""

    picture: Rgb
    # (h, w): pixels away from objects.
    free: Mask
    # px: size of a typical object.
    size: float
    is_top_view: bool

    def contrast(self, model: F32) -> _ShadeContrast | None:
        """Return the contrast of shade predicted by `model` (h, w), or None if it is
        not visible.
        """
        depths = model[self.free & (model > TUNING.reference_depth)]
        if not depths.size:
            return None
        shade_mask = (
            model > max(TUNING.shade_depth, float(np.median(depths)))
        ) & self.free
        possible_shade = model > TUNING.possible_shade_depth
        reach = TUNING.beside_top if self.is_top_view else TUNING.beside_side
        kernel_size = tuple(2 * int(part * self.size) + 1 for part in reach)
        kernel = np.ones(kernel_size[::-1], np.uint8)
        reference_mask = cv2.dilate(possible_shade.astype(np.uint8), kernel) > 0
        reference_mask &= model < TUNING.reference_depth
        darkness = missing_light(
            self.picture,
            self.free.astype(np.float32),
            possible_shade,
            self.size,
            is_top_view=self.is_top_view,
        )
        shifts = _shifts(self.size, self.is_top_view)
        contrast, ratio = contrast_over_chance(
            darkness, self.free, shade_mask, reference_mask, shifts
        )
        if contrast < TUNING.least_contrast or ratio < TUNING.least_ratio:
            return None
        model_contrast = float(
            np.median(model[shade_mask]) - np.median(model[reference_mask & self.free])
        )
        return _ShadeContrast(contrast, ratio, model_contrast, darkness)


@dataclass(frozen=True)
class _ShadeContrast:
    """The contrast of shade and the ground beside it, as logarithms of light."""

    contrast: float
    # Ratio of contrast and chance.
    ratio: float
    # The contrast that geometry predicts.
    model_contrast: float
    # (h, w): missing light.
    darkness: F32

    @property
    def factor(self) -> float:
        """Return the ratio of measured and predicted depth, limited below."""
        return max(self.contrast / max(self.model_contrast, 1e-3), TUNING.least_factor)


def find_ambient_shade(
    background: Rgb,
    coverage: F32,
    silhouettes_at: Callable[[float], Sequence[Silhouette]],
    *,
    is_top_view: bool,
) -> AmbientShade | None:
    """Return the shade of soft light in a photo, or None if none is visible.

    `silhouettes_at` gives the silhouettes on a picture reduced by a factor.
    """
    H, W = coverage.shape
    scale = max(max(H, W) / TUNING.longest, 1.0)
    silhouettes = silhouettes_at(scale)
    if not silhouettes:
        return None
    ground = _reduce_ground(
        background, coverage, scale, typical_size(silhouettes), is_top_view
    )
    size = ground.free.shape[1], ground.free.shape[0]
    best: AmbientShade | None = None
    # Each candidate sky predicts places in shade; the most significant one is used.
    for direct, down in TUNING.skies:
        sky = _sky(direct, down, size, is_top_view)
        shade = ground.contrast(predicted_darkness(silhouettes, sky))
        if shade is None or (best is not None and best.chance_ratio >= shade.ratio):
            continue
        if shade.factor <= TUNING.most_factor:
            full = cv2.resize(shade.darkness, (W, H), interpolation=cv2.INTER_LINEAR)
            best = AmbientShade(
                _sky(direct, down, (W, H), is_top_view),
                shade.factor,
                shade.ratio,
                np.asarray(full, np.float32),
            )
    return best


def _reduce_ground(
    background: Rgb,
    coverage: F32,
    scale: float,
    size: float,
    is_top_view: bool,
) -> _ReducedGround:
    """Return the photo at 1 / `scale` of its side; `size` is a typical object's."""
    H, W = coverage.shape
    shape = max(1, round(W / scale)), max(1, round(H / scale))
    picture = cv2.resize(background, shape, interpolation=cv2.INTER_AREA)
    object_margin = (~away_from_objects(coverage, MARGIN)).astype(np.float32)
    free = cv2.resize(object_margin, shape, interpolation=cv2.INTER_AREA) == 0
    return _ReducedGround(
        np.asarray(picture, np.uint8), np.asarray(free), size, is_top_view
    )


def extend_behind_objects(dark: F32, coverage: F32) -> F32:
    """Return depths (H, W) extended from the objects' rims behind the objects."""
    free = (coverage == 0).astype(np.float32)
    values = dark * free
    result = dark.copy()
    # Wide means come first, narrow ones overwrite them near the rims.
    for sigma in TUNING.rims:
        weights = cv2.GaussianBlur(free, (0, 0), sigma)
        behind_object = (free == 0) & (weights > 1e-3)
        result[behind_object] = (
            cv2.GaussianBlur(values, (0, 0), sigma) / np.maximum(weights, 1e-6)
        )[behind_object]
    return np.asarray(result, np.float32)


def _sky(
    direct: float, down: float, size: tuple[int, int], is_top_view: bool
) -> ShadowSetting:
    if is_top_view:
        direction = (0.0, 0.0, 1.0)
    else:
        direction = (0.0, -1.0, 0.0)
    light = DistantLight(direction, FULL * direct, FULL * (1 - direct))
    return ShadowSetting(
        light, TUNING.light_radius, is_top_view, tan(radians(down)), inf, size
    )


def _shifts(size: float, is_top_view: bool) -> list[tuple[int, int]]:
    """Return the shifts, px right and down, at which dark places occur only by chance.

    From the side a shade is flat, so that a row away is already another place.
    """
    steps = [0.0, *TUNING.nearby, *(-part for part in TUNING.nearby)]
    if is_top_view:
        downs = steps
    else:
        downs = [0.6 * part for part in steps if 0 < abs(part) <= 1]
    least_distance = 1.0 if is_top_view else 0.3
    result: list[tuple[int, int]] = []
    for b in downs:
        for a in steps:
            if abs(a) + abs(b) >= least_distance:
                result.append((int(a * size), int(b * size)))
    return result


def missing_light(
    background: Rgb, free: F32, possible_shade: Mask, size: float, *, is_top_view: bool
) -> F32:
    """Return -log (H, W) of the light missing relative to similar surfaces nearby,
    smoothed.

    `free` is 1 away from objects. `possible_shade` marks places possibly in shade, which are no
    reference.
    """
    linear = decode(background)
    level_of_pixel = np.log(luminance(linear) + DARKEST).astype(np.float32)
    reference_weights = free * ~possible_shade
    reaches = []
    for a, d, gain in TUNING.top_reaches if is_top_view else TUNING.side_reaches:
        reaches.append((a * size, d * size, gain))
    level = mean_of_kind(
        level_of_pixel,
        reference_weights,
        hue_weights(linear, reference_weights, 4000),
        reaches,
        tiny=1e-9,
    )
    width, down = (
        (sum(TUNING.smoothing_widths) / 2,) * 2
        if is_top_view
        else TUNING.smoothing_widths
    )
    weights = np.maximum(blur_wide(free, width, down), 1e-2)
    return np.asarray(
        blur_wide((level - level_of_pixel) * free, width, down) / weights, np.float32
    )


def contrast_over_chance(
    dark: F32, free: Mask, within: Mask, around: Mask, shifts: Sequence[tuple[int, int]]
) -> tuple[float, float]:
    """Return the extra darkness `within` a place over `around` it, and its ratio to
    chance.

    Chance is the same contrast with both places moved by `shifts`, px right and down.
    The ratio is 0 if a place is hidden or a moved contrast is as large.
    """
    contrast = _contrast(dark, free, within, around)
    other = free & ~within
    shifted_contrasts = []
    for dx, dy in shifts:
        shifted_contrasts.append(
            _contrast(dark, other, _move(within, dx, dy), _move(around, dx, dy))
        )
    others = np.array([value for value in shifted_contrasts if value is not None])
    if (
        contrast is None
        or len(others) < max(1, len(shifts) // 4)
        or contrast <= others.max()
    ):
        return contrast or 0.0, 0.0
    # A place lighter than its surroundings is paint and cannot imitate a shadow.
    chance = float(np.sqrt(np.mean(np.maximum(others, 0) ** 2)))
    return contrast, contrast / max(chance, TUNING.quiet)


def _contrast(dark: F32, free: Mask, within: Mask, around: Mask) -> float | None:
    """Return the difference of median darkness, or None if too few pixels are free."""
    inner_pixels = within & free
    outer_pixels = around & free
    if (
        inner_pixels.sum() < max(TUNING.least_count, TUNING.visible * within.sum())
        or outer_pixels.sum() < TUNING.least_count
    ):
        return None
    return float(np.median(dark[inner_pixels]) - np.median(dark[outer_pixels]))


def _move(mask: Mask, dx: int, dy: int) -> Mask:
    """Return a shifted mask; pixels outside the picture are lost."""
    h, w = mask.shape
    result = np.zeros_like(mask)
    if abs(dx) < w and abs(dy) < h:
        target = _common_part(h, dy), _common_part(w, dx)
        source = _common_part(h, -dy), _common_part(w, -dx)
        result[target] = mask[source]
    return result


def _common_part(length: int, shift: int) -> slice:
    """Return the pixels of a row that a copy shifted by `shift` px covers."""
    return slice(max(shift, 0), length + min(shift, 0))
