"""Backend intrinsic=retinex: albedo and shading from colour changes and normals."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.perceive.maps.lambert import fit_light, pixel_pairs
from physgen.perceive.roles import Intrinsic, Intrinsics, Labels, Rgb
from physgen.photometry import DistantLight, decode, luminance

F32 = NDArray[np.float32]

SIDE = 256
"""px, the longer side of the grid on which the photo is parted."""
DARKEST, GREYEST = 4e-3, 1e-2
"""Linear light added before logarithms are taken: of luminance, of ratios of colours."""
CALM = 1.5
"""px of the grid: blur of colours before they are compared, against noise."""
PAINT = 0.15
"""Change of colour (logarithm) a px of the grid at which a gradient is albedo's rather than shading's."""
SHADE = 0.6
"""Share of a gradient without a change of colour that is shading's."""
OUTLINE = 0.2
"""The same at a thing's outline, where both change."""
WITHIN, BETWEEN = 0.7, 0.3
"""Shares of the differences of light that are shading's: of those within one colour, of those between colours."""
COLOURS = 64
"""Bins a side of the table of colours, over ratios of e^-3 to e^3."""
REACH = 3.0
"""px of the grid over which those differences are taken together."""
HOLD = 0.03
"""1/px²: how strongly differences far apart count beside gradients."""
THING = 0.6
"""How much of Lambert's shading is believed, on things; around them normals are known too little."""
UPWARDS = -0.5
"""y of the normals of tables."""
LIFT, KEPT = 0.55, 0.55
"""How much more light (logarithm) a table gets than what lies behind it: lamps are above, and it faces them; and the
share of how much lighter it looks that is shading's, too."""
STOOD, FLAT = -0.15, -0.15
"""Light (logarithm) on things beside that on the table they stand on, and on what lies behind them without a table."""
OWN = 0.15
"""Share of how much lighter a thing looks that is shading's: neighbours are lit alike, and painted not."""
EVEN = 0.5
"""The least share of ambient light: rooms are bright in the shade."""
LIKELY = DistantLight((0.0, -0.6, 0.8), 0.5, 0.5)
"""Where nothing shows the light."""
WINDOW = 5
"""px of the grid, in which fine detail is parted as its surroundings are (He et al. 2013, guided filter)."""
BRIGHTEST = 0.9
"""Albedo of the photo's lightest surfaces."""


def retinex() -> Intrinsic:
    """The backend `retinex`."""
    return _retinex


def _retinex(rgb: Rgb, labels: Labels, normals: F32) -> Intrinsics:
    linear = decode(rgb)
    height, width = labels.shape
    scale = min(1.0, SIDE / max(height, width))
    # cv2.dct wants even sides
    size = max(2, round(width * scale / 2)) * 2, max(2, round(height * scale / 2)) * 2
    small = _resized(linear, size, cv2.INTER_AREA)
    level = _level(small)
    told = _lambert(linear, labels, normals, size)
    ids = np.asarray(cv2.resize(labels, size, interpolation=cv2.INTER_NEAREST), np.uint16)
    log_shading = _levelled(_parted(small, level, told, ids), level, normals, ids)
    parts = _detail(log_shading, level)
    slope, base = (_resized(part, (width, height), cv2.INTER_LINEAR) for part in parts)
    shading = np.asarray(np.exp(slope * _level(linear) + base), np.float32)
    most = linear.max(axis=2)
    shading *= np.float32(max(float(np.percentile(most / shading, 99.5)), 1e-6) / BRIGHTEST)
    shading = np.maximum(shading, most)  # nothing sends back more than it gets
    albedo = linear / np.maximum(shading, 1e-6)[..., None]
    return Intrinsics(np.clip(albedo, 0, 1).astype(np.float32), shading.astype(np.float32))


def _resized(values: F32, size: tuple[int, int], how: int) -> F32:
    return np.asarray(cv2.resize(values, size, interpolation=how), np.float32)


def _level(linear: F32) -> F32:
    return np.asarray(np.log(luminance(linear) + np.float32(DARKEST)), np.float32)


def _lambert(linear: F32, labels: Labels, normals: F32, size: tuple[int, int]) -> F32:
    """(h, w) on the grid: the logarithm of the shading that normals tell, as far as it is believed."""
    ids = [int(i) for i in np.flatnonzero(np.bincount(labels.ravel())) if i]
    found = fit_light(pixel_pairs(linear, labels, dict.fromkeys(ids, False), normals)) if ids else None
    light = LIKELY if found is None or found.explained < 0.05 else found.light
    ambient = max(light.ambient, EVEN)
    lit = DistantLight(light.direction, 1 - ambient, ambient)
    coarse = cv2.resize(normals, size, interpolation=cv2.INTER_AREA)
    own = cv2.resize((labels > 0).astype(np.float32), size, interpolation=cv2.INTER_AREA)
    return np.asarray(THING * own * np.log(lit.shade(coarse)), np.float32)


def _levelled(shading: F32, level: F32, normals: F32, ids: Labels) -> F32:
    """(h, w) of the grid: the logarithm of `shading`, with as much light on surfaces as is likely beside each other.

    Their own paint tells nothing of that: gradients across outlines are of both. Within a surface nothing changes.
    """
    free = ids == 0
    upright = cv2.resize(normals[..., 1], ids.shape[::-1], interpolation=cv2.INTER_AREA)
    table = free & (upright < UPWARDS)
    rows = np.flatnonzero(table.mean(axis=1) > 0.3)
    behind = free.copy()
    behind[rows[0] if len(rows) else 0 :] = False
    change = np.zeros_like(shading)
    stands = bool(behind.any())
    ground, offset = (table, STOOD) if stands else (free, FLAT)
    if not ground.any():
        return shading
    light, seen = float(shading[ground].mean()), float(level[ground].mean())
    if stands:
        darker = -LIFT + KEPT * (float(level[behind].mean()) - seen)
        change[behind] = min(0.0, darker) - (float(shading[behind].mean()) - light)
    for i in np.flatnonzero(np.bincount(ids.ravel())):
        if i:
            own = ids == i
            lighter = offset + OWN * (float(level[own].mean()) - seen)
            change[own] = lighter - (float(shading[own].mean()) - light)
    return np.asarray(shading + change, np.float32)


def _parted(linear: F32, level: F32, told: F32, ids: Labels) -> F32:
    """(h, w): the logarithm of shading, from light (h, w, 3), its `level`, what normals tell, and labels."""
    green = linear[..., 1] + np.float32(GREYEST)
    colour = np.log((linear[..., ::2] + np.float32(GREYEST)) / green[..., None])
    colour = np.asarray(cv2.GaussianBlur(colour, (0, 0), CALM), np.float32)
    usual = _usual(level, colour)
    far = cv2.GaussianBlur(np.asarray(WITHIN * (level - usual) + BETWEEN * usual, np.float32), (0, 0), REACH)
    parts = []
    for axis in (1, 0):
        step = np.diff(level, axis=axis)
        change = np.linalg.norm(np.diff(colour, axis=axis), axis=2)
        shares = SHADE * np.exp(-((change / PAINT) ** 2))
        shares[np.diff(ids.astype(np.int32), axis=axis) != 0] = OUTLINE
        parts.append(shares * step + (1 - shares) * np.diff(told, axis=axis))
    return _screened(parts[0], parts[1], far + told)


def _usual(level: F32, colour: F32) -> F32:
    """(h, w): the mean level of all that has a pixel's colour (h, w, 2)."""
    place = np.clip((colour + 3) / 6 * (COLOURS - 1), 0, COLOURS - 1).astype(np.float32)
    bins = np.rint(place).astype(np.intp)
    index = (bins[..., 0] * COLOURS + bins[..., 1]).ravel()
    shape = COLOURS, COLOURS
    count, total = (
        cv2.GaussianBlur(
            np.bincount(index, weights, COLOURS**2).reshape(shape).astype(np.float32), (0, 0), 1.0
        )
        for weights in (None, level.ravel())
    )
    mean = total / np.maximum(count, 1e-6)
    return np.asarray(cv2.remap(mean, place[..., 1], place[..., 0], cv2.INTER_LINEAR), np.float32)


def _screened(across: F32, down: F32, far: F32) -> F32:
    """(h, w) nearest to `far` whose differences are nearest to `across` (h, w-1) and `down` (h-1, w).

    The cosine transform turns the screened Poisson equation with a free border into a division (Bhat et al. 2008).
    """
    h, w = far.shape
    right = (HOLD * far).astype(np.float64)
    right[:, :-1] -= across
    right[:, 1:] += across
    right[:-1] -= down
    right[1:] += down
    waves = (2 - 2 * np.cos(np.pi * np.arange(h) / h))[:, None] + (2 - 2 * np.cos(np.pi * np.arange(w) / w))
    return np.asarray(cv2.idct(cv2.dct(right) / (HOLD + waves)), np.float32)


def _detail(shading: F32, level: F32) -> tuple[F32, F32]:
    """(h, w) slope and base with shading = slope x level + base in each window."""

    def mean(values: NDArray[Any]) -> F32:
        return np.asarray(cv2.blur(values, (WINDOW, WINDOW)), np.float32)

    m, s = mean(level), mean(shading)
    slope = (mean(level * shading) - m * s) / (mean(level * level) - m * m + np.float32(0.01))
    slope = np.clip(slope, 0, 1).astype(np.float32)
    return mean(slope), mean(s - slope * m)
