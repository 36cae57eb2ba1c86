"""Shade of soft light around the feet and rims of objects."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import inf, radians, tan
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.geometry.shadows import ShadowSetting as Place
from physgen.geometry.shadows import Silhouette
from physgen.perceive.roles import Rgb
from physgen.perceive.shadow.shadow_fit import predicted_darkness
from physgen.perceive.shadow.shadow_removal import DARKEST, hue_weights
from physgen.perceive.shadow.silhouettes import typical_size
from physgen.photometry import DistantLight, decode, luminance

# ----------------------------------------------------------------------
# Background -> by how much its surfaces are darker somewhere than the same surfaces are elsewhere; no light
# is asked.
#
# The light of a place without its shadow is read off like-coloured surface near by, from where nothing is
# suspected of
# lying in shadow. Paint is dark as well; but it does not lie just where a thing's shadow must.

F32 = NDArray[np.float32]
Mask = NDArray[np.bool_]

ALONG = ((0.7, 0.08, 1.0), (2.0, 0.16, 0.05), (4.0, 0.6, 2e-3), (8.0, 2.0, 1e-5))
"""Of an object's size, across and down: how far like surfaces are looked for; and how little the farther ones count.

On a floor seen from the side, what lies in one row is equally far.
"""
AROUND = ((0.5, 0.5, 1.0), (1.0, 1.0, 0.05), (3.0, 3.0, 2e-3))
"""The same on a table seen from above."""
SMOOTH = 3.0, 1.2
"""px across and down: standard deviations of the blur; finer is grain. From above the mean of both, both ways."""
SEEN = 0.4
"""Share of a place that must be free to say anything."""
LEAST = 40
"""px: the same."""
QUIET = 5e-3
"""-log of light: no surface is more even."""


def missing_light(background: Rgb, free: F32, suspect: Mask, size: float, *, from_above: bool) -> F32:
    """(H, W) -log of the light that is missing, smooth.

    `free`: 1 where no object is near. `suspect`: what may lie in shadow, and says nothing of surfaces in the light.
    """
    linear = decode(background)
    bright = np.log(luminance(linear) + DARKEST).astype(np.float32)
    plain = free * ~suspect
    level = np.zeros(bright.shape, np.float32)
    total = np.full(bright.shape, 1e-9, np.float32)
    for kin in hue_weights(linear, plain, 4000):
        weight = plain * kin
        sums, weights = 1e-9 * bright, np.full(bright.shape, 1e-9, np.float32)
        for across, down, gain in AROUND if from_above else ALONG:
            sums = sums + gain * _blurred(bright * weight, across * size, down * size)
            weights = weights + gain * _blurred(weight, across * size, down * size)
        level += kin * sums / weights
        total += kin
    across, down = (sum(SMOOTH) / 2,) * 2 if from_above else SMOOTH
    near = np.maximum(_blurred(free, across, down), 1e-2)
    return np.asarray(_blurred((level / total - bright) * free, across, down) / near, np.float32)


def contrast_over_chance(
    dark: F32, free: Mask, within: Mask, around: Mask, shifts: Sequence[tuple[int, int]]
) -> tuple[float, float]:
    """By how much it is darker `within` a place than `around` it, and against what is so elsewhere.

    Elsewhere are the same two places moved by `shifts`, px right and down; the second number is by how many times
    more than there, and 0 where the places are out of sight or something elsewhere is as dark.
    """
    own = _contrast(dark, free, within, around)
    other = free & ~within
    moved = [_contrast(dark, other, _rolled(within, dx, dy), _rolled(around, dx, dy)) for dx, dy in shifts]
    others = np.array([one for one in moved if one is not None])
    if own is None or len(others) < max(1, len(shifts) // 4) or own <= others.max():
        return own or 0.0, 0.0
    # what is lighter than around is paint, and hides no shadow
    chance = float(np.sqrt(np.mean(np.maximum(others, 0) ** 2)))
    return own, own / max(chance, QUIET)


def _contrast(dark: F32, free: Mask, within: Mask, around: Mask) -> float | None:
    seen, plain = within & free, around & free
    if seen.sum() < max(LEAST, SEEN * within.sum()) or plain.sum() < LEAST:
        return None
    return float(np.median(dark[seen]) - np.median(dark[plain]))


def _rolled(mask: Mask, dx: int, dy: int) -> Mask:
    """Moved; what leaves the picture is gone."""
    h, w = mask.shape
    result = np.zeros_like(mask)
    if abs(dx) >= w or abs(dy) >= h:
        return result
    result[max(dy, 0) : h + min(dy, 0), max(dx, 0) : w + min(dx, 0)] = mask[
        max(-dy, 0) : h + min(-dy, 0), max(-dx, 0) : w + min(-dx, 0)
    ]
    return result


def _blurred(picture: F32, across: float, down: float) -> F32:
    """Gaussian blur of two widths, px; wide ones on a coarser grid."""
    h, w = picture.shape
    right, lower = max(1, min(int(across / 3), w // 8)), max(1, min(int(down / 3), h // 8))
    small: NDArray[Any] = picture
    if right > 1 or lower > 1:
        small = cv2.resize(picture, (-(-w // right), -(-h // lower)), interpolation=cv2.INTER_AREA)
    sigmas = max(across / right, 0.3), max(down / lower, 0.3)
    small = cv2.GaussianBlur(small, (0, 0), sigmaX=sigmas[0], sigmaY=sigmas[1], borderType=cv2.BORDER_REFLECT)
    if small.shape != picture.shape:
        small = cv2.resize(small, (w, h), interpolation=cv2.INTER_LINEAR)
    return np.asarray(small, np.float32)


# ----------------------------------------------------------------------
# Background and what stands on it -> the shade of soft light about feet and rims, where no one light tells of
# shadows.
#
# An overcast sky, or lamps on all sides, leave a thing's surroundings dark where they see least of the sky.
# Where that
# must lie is known without a light. It is believed where the photo is darker just there than in all like
# places near by.

LONGEST = 512
"""px: longer side of the picture that is looked at."""
RING = 2
"""px around objects where the background still shows traces of them."""
EVEN = 1.2
"""Shading of a surface that faces the light."""
SKIES = ((0.0, 5.7), (0.6, 9.6))
"""How much of the light is direct, from straight above; and degrees by which the camera looks down on a floor."""
WIDE = 40.0
"""degrees: half the width of such a light."""
DEEP, FAINT = 0.05, 0.02
"""-log of foretold light: what is darker is looked at, and compared with what is lighter."""
SHADED = 0.03
"""From which a place says nothing of surfaces in the light."""
BESIDE = (0.4, 0.15), (0.3, 0.3)
"""Of an object's size, across and down: how far from there; seen from the side, and from above."""
NEAR_BY = (0.5, 1.0, 1.5, 2.0)
"""Of an object's size: how far off shadows might lie as well, if they were chance."""
SURE = 6.0
"""Times what chance gives, from which on it is believed (studio photos of the split `tune`)."""
CONTACT_SEEN = 0.025
"""-log of light: less is not believed."""
RIMS = (30.0, 8.0, 2.0)
"""px: standard deviations, the widest first, of the means by which a rim's darkness is carried behind a thing."""
STRENGTHS = (0.3, 3.0)
"""By how much less or more than foretold may be dark."""


@dataclass(frozen=True)
class AmbientShade:
    """Shade of soft light, in px of the photo."""

    place: Place
    factor: float
    """By how much more is dark than foretold, as a logarithm."""
    sure: float
    """Times what chance gives."""
    missing: F32
    """(H, W) -log of the light that the photo misses, smooth."""

    @property
    def confidence(self) -> float:
        """0..1."""
        return round(min(0.7, 0.1 * self.sure), 2)

    @property
    def reason(self) -> str:
        """A sentence for the scene's comments."""
        return f"soft light from all sides: dark about feet and rims, {self.sure:.0f} times what chance gives"


def find_ambient_shade(
    background: Rgb, coverage: F32, silhouettes: Callable[[float], Sequence[Silhouette]], *, from_above: bool
) -> AmbientShade | None:
    """`silhouettes` gives them on a picture so many times smaller. None where nothing tells."""
    H, W = coverage.shape
    scale = max(max(H, W) / LONGEST, 1.0)
    things = silhouettes(scale)
    if not things:
        return None
    w, h = max(1, round(W / scale)), max(1, round(H / scale))
    picture = np.asarray(cv2.resize(background, (w, h), interpolation=cv2.INTER_AREA), np.uint8)
    ring = np.ones((2 * RING + 1, 2 * RING + 1), np.uint8)
    near = np.asarray(cv2.dilate((coverage > 0).astype(np.uint8), ring), np.float32)
    free = np.asarray(cv2.resize(near, (w, h), interpolation=cv2.INTER_AREA) == 0)
    size = typical_size(things)
    best: AmbientShade | None = None
    for direct, down in SKIES:
        place = _sky(direct, down, (w, h), from_above)
        model = predicted_darkness(things, place)
        seen = model[free & (model > FAINT)]
        if not seen.size:
            continue
        deep = (model > max(DEEP, float(np.median(seen)))) & free
        wide = tuple(2 * int(part * size) + 1 for part in BESIDE[from_above])
        beside = cv2.dilate((model > SHADED).astype(np.uint8), np.ones(wide[::-1], np.uint8)) > 0
        beside &= model < FAINT
        dark = missing_light(picture, free.astype(np.float32), model > SHADED, size, from_above=from_above)
        contrast, sure = contrast_over_chance(dark, free, deep, beside, _elsewhere(size, from_above))
        if contrast < CONTACT_SEEN or sure < SURE or (best is not None and best.sure >= sure):
            continue
        told = float(np.median(model[deep]) - np.median(model[beside & free]))
        factor = min(max(contrast / max(told, 1e-3), STRENGTHS[0]), STRENGTHS[1])
        full = np.asarray(cv2.resize(dark, (W, H), interpolation=cv2.INTER_LINEAR), np.float32)
        best = AmbientShade(_sky(direct, down, (W, H), from_above), factor, sure, full)
    return best


def extend_behind_objects(dark: F32, coverage: F32) -> F32:
    """(H, W): behind things as dark as about their rims, from where the background was filled there."""
    free = (coverage == 0).astype(np.float32)
    values = dark * free
    result = dark.copy()
    for sigma in RIMS:
        near = cv2.GaussianBlur(free, (0, 0), sigma)
        hidden = (free == 0) & (near > 1e-3)
        result[hidden] = (cv2.GaussianBlur(values, (0, 0), sigma) / np.maximum(near, 1e-6))[hidden]
    return np.asarray(result, np.float32)


def _sky(direct: float, down: float, size: tuple[int, int], from_above: bool) -> Place:
    towards = (0.0, 0.0, 1.0) if from_above else (0.0, -1.0, 0.0)
    light = DistantLight(towards, EVEN * direct, EVEN * (1 - direct))
    return Place(light, WIDE, from_above, tan(radians(down)), inf, size)


def _elsewhere(size: float, from_above: bool) -> list[tuple[int, int]]:
    """px right and down: where else shadows might lie. Seen from the side they are flat, and lie apart a row away."""
    steps = [0.0, *NEAR_BY, *(-part for part in NEAR_BY)]
    downs = steps if from_above else [0.6 * part for part in steps if 0 < abs(part) <= 1]
    least = 1.0 if from_above else 0.3
    return [(int(a * size), int(b * size)) for b in downs for a in steps if abs(a) + abs(b) >= least]
