"""Shade of soft light around the feet and rims of objects.

An overcast sky, or lamps on all sides, leave an object's surroundings dark where they
see least of the sky. Where that must lie is known without a light. It is believed where
the photo is darker just there than in all like places nearby. The light of a place
without its shade is read off like-coloured surfaces outside of it. Paint is dark as
well; but it does not lie just where an object's shade must.
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
from physgen.perceive.shadow.shadow_removal import blur_wide, hue_weights, mean_of_kind
from physgen.perceive.shadow.silhouettes import (
    DARKEST,
    MARGIN,
    away_from_objects,
    predicted_darkness,
    typical_size,
)
from physgen.photometry import DistantLight, decode, luminance


@dataclass(frozen=True)
class _Tuning:
    """Sizes are shares of an object's, across and down; depths are -log of light."""

    longest: int = 512  # px: longer side of the picture that is analysed
    # direct share; degrees the camera looks down
    skies: tuple[tuple[float, float], ...] = ((0.0, 5.7), (0.6, 9.6))
    wide: float = 40.0  # degrees: half the width of such a light
    deep: float = 0.05  # predicted depth that is compared with ...
    faint: float = 0.02  # ... places of less than this
    # predicted depth from which a place is no reference for lit surfaces
    shaded: float = 0.03
    # reach of the comparison in a side view
    beside_side: tuple[float, float] = (
        0.4,
        0.15,
    )
    beside_top: tuple[float, float] = (0.3, 0.3)  # and in a top view
    # shifts at which shade might lie as well, by chance
    nearby: tuple[float, ...] = (
        0.5,
        1.0,
        1.5,
        2.0,
    )
    # times chance from which shade is believed (studio photos of the split `tune`)
    sure: float = 6.0
    seen: float = 0.025  # contrast from which it is believed
    # of seen over predicted depth: what is darker is another surface, or the shade of what carries the objects
    least_factor: float = 0.3
    most_factor: float = 1.5
    along: tuple[tuple[float, float, float], ...] = (
        (0.7, 0.08, 1.0), (2.0, 0.16, 0.05), (4.0, 0.6, 2e-3), (8.0, 2.0, 1e-5),
    )  # fmt: skip
    """Reach and weight of like surfaces on a floor seen from the side: a row is equally
    far.
    """
    around: tuple[tuple[float, float, float], ...] = (
        (0.5, 0.5, 1.0),
        (1.0, 1.0, 0.05),
        (3.0, 3.0, 2e-3),
    )
    """The same on a table seen from above."""
    # px, standard deviations; from above the mean of both, both ways
    smooth: tuple[float, float] = (3.0, 1.2)
    visible: float = 0.4  # share of a place that must be free ...
    least: int = 40  # ... and px of it, to count
    quiet: float = 5e-3  # contrast: no surface is more even
    # px: widths of the means by which a rim's depth is carried behind it
    rims: tuple[float, ...] = (30.0, 8.0, 2.0)


TUNING = _Tuning()


@dataclass(frozen=True)
class AmbientShade:
    """Shade of soft light, in px of the photo."""

    setting: ShadowSetting
    factor: float  # Seen over predicted depth, as a logarithm
    sure: float  # Contrast over that of chance
    missing: F32  # (H, W) -log of the light that the photo misses, smooth

    @property
    def confidence(self) -> float:
        """0..1."""
        return round(min(0.7, 0.1 * self.sure), 2)


def find_ambient_shade(
    background: Rgb,
    coverage: F32,
    at: Callable[[float], Sequence[Silhouette]],
    *,
    from_above: bool,
) -> AmbientShade | None:
    """`at` gives the silhouettes on a picture so many times smaller.

    None where no shade is seen.
    """
    H, W = coverage.shape
    scale = max(max(H, W) / TUNING.longest, 1.0)
    silhouettes = at(scale)
    if not silhouettes:
        return None
    w, h = max(1, round(W / scale)), max(1, round(H / scale))
    picture = np.asarray(
        cv2.resize(background, (w, h), interpolation=cv2.INTER_AREA), np.uint8
    )
    near = (~away_from_objects(coverage, MARGIN)).astype(np.float32)
    free = np.asarray(cv2.resize(near, (w, h), interpolation=cv2.INTER_AREA) == 0)
    size = typical_size(silhouettes)
    reach = TUNING.beside_top if from_above else TUNING.beside_side
    wide = tuple(2 * int(part * size) + 1 for part in reach)
    best: AmbientShade | None = None
    for direct, down in TUNING.skies:
        model = predicted_darkness(silhouettes, _sky(direct, down, (w, h), from_above))
        seen = model[free & (model > TUNING.faint)]
        if not seen.size:
            continue
        deep = (model > max(TUNING.deep, float(np.median(seen)))) & free
        shaded = model > TUNING.shaded
        beside = cv2.dilate(shaded.astype(np.uint8), np.ones(wide[::-1], np.uint8)) > 0
        beside &= model < TUNING.faint
        dark = missing_light(
            picture, free.astype(np.float32), shaded, size, from_above=from_above
        )
        contrast, sure = contrast_over_chance(
            dark, free, deep, beside, _shifts(size, from_above)
        )
        if (
            contrast < TUNING.seen
            or sure < TUNING.sure
            or (best is not None and best.sure >= sure)
        ):
            continue
        predicted = float(np.median(model[deep]) - np.median(model[beside & free]))
        factor = max(contrast / max(predicted, 1e-3), TUNING.least_factor)
        if factor > TUNING.most_factor:
            continue
        full = np.asarray(
            cv2.resize(dark, (W, H), interpolation=cv2.INTER_LINEAR), np.float32
        )
        best = AmbientShade(_sky(direct, down, (W, H), from_above), factor, sure, full)
    return best


def extend_behind_objects(dark: F32, coverage: F32) -> F32:
    """(H, W): behind objects as dark as about their rims, from where the background was
    filled there.
    """
    free = (coverage == 0).astype(np.float32)
    values = dark * free
    result = dark.copy()
    for sigma in TUNING.rims:
        near = cv2.GaussianBlur(free, (0, 0), sigma)
        hidden = (free == 0) & (near > 1e-3)
        result[hidden] = (
            cv2.GaussianBlur(values, (0, 0), sigma) / np.maximum(near, 1e-6)
        )[hidden]
    return np.asarray(result, np.float32)


def _sky(
    direct: float, down: float, size: tuple[int, int], from_above: bool
) -> ShadowSetting:
    towards = (0.0, 0.0, 1.0) if from_above else (0.0, -1.0, 0.0)
    light = DistantLight(towards, FULL * direct, FULL * (1 - direct))
    return ShadowSetting(light, TUNING.wide, from_above, tan(radians(down)), inf, size)


def _shifts(size: float, from_above: bool) -> list[tuple[int, int]]:
    """px right and down: where else shade might lie.

    Seen from the side it is flat, and lies apart a row away.
    """
    steps = [0.0, *TUNING.nearby, *(-part for part in TUNING.nearby)]
    downs = (
        steps if from_above else [0.6 * part for part in steps if 0 < abs(part) <= 1]
    )
    least = 1.0 if from_above else 0.3
    return [
        (int(a * size), int(b * size))
        for b in downs
        for a in steps
        if abs(a) + abs(b) >= least
    ]


def missing_light(
    background: Rgb, free: F32, shaded: Mask, size: float, *, from_above: bool
) -> F32:
    """(H, W) -log of the light that surfaces miss against like ones nearby, smooth.

    `free`: 1 where no object is near. `shaded`: places that may lie in shade, and are
    no reference.
    """
    linear = decode(background)
    bright = np.log(luminance(linear) + DARKEST).astype(np.float32)
    plain = free * ~shaded
    reaches = [
        (a * size, d * size, gain)
        for a, d, gain in (TUNING.around if from_above else TUNING.along)
    ]
    level = mean_of_kind(
        bright, plain, hue_weights(linear, plain, 4000), reaches, tiny=1e-9
    )
    across, down = (sum(TUNING.smooth) / 2,) * 2 if from_above else TUNING.smooth
    near = np.maximum(blur_wide(free, across, down), 1e-2)
    return np.asarray(
        blur_wide((level - bright) * free, across, down) / near, np.float32
    )


def contrast_over_chance(
    dark: F32, free: Mask, within: Mask, around: Mask, shifts: Sequence[tuple[int, int]]
) -> tuple[float, float]:
    """By how much it is darker `within` a place than `around` it, and that over the
    same elsewhere.

    Elsewhere are both places moved by `shifts`, px right and down; the second number is
    0 where the places are out of sight or a moved one is as dark.
    """
    own = _contrast(dark, free, within, around)
    other = free & ~within
    moved = [
        _contrast(dark, other, _moved(within, dx, dy), _moved(around, dx, dy))
        for dx, dy in shifts
    ]
    others = np.array([one for one in moved if one is not None])
    if own is None or len(others) < max(1, len(shifts) // 4) or own <= others.max():
        return own or 0.0, 0.0
    # a place lighter than its surroundings is paint, and hides no shadow
    chance = float(np.sqrt(np.mean(np.maximum(others, 0) ** 2)))
    return own, own / max(chance, TUNING.quiet)


def _contrast(dark: F32, free: Mask, within: Mask, around: Mask) -> float | None:
    seen, plain = within & free, around & free
    if (
        seen.sum() < max(TUNING.least, TUNING.visible * within.sum())
        or plain.sum() < TUNING.least
    ):
        return None
    return float(np.median(dark[seen]) - np.median(dark[plain]))


def _moved(mask: Mask, dx: int, dy: int) -> Mask:
    """Moved; what leaves the picture is lost."""
    h, w = mask.shape
    result = np.zeros_like(mask)
    if abs(dx) < w and abs(dy) < h:
        to = np.s_[max(dy, 0) : h + min(dy, 0), max(dx, 0) : w + min(dx, 0)]
        result[to] = mask[max(-dy, 0) : h + min(-dy, 0), max(-dx, 0) : w + min(-dx, 0)]
    return result
