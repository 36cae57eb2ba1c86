"""Backend intrinsic=retinex: albedo and shading from colour changes and normals.

Where colour changes, paint does (Land & McCann 1971; Funt, Drew & Brockington 1992 for
colour): such gradients are albedo's, the rest is mostly shading's. Places far apart but
of one colour have mostly one albedo (Garces et al. 2012), so that differences of light
within a colour are shading's, and those between colours mostly are not. The normals and
the light that explains them (`light=shading`) give the shading of objects; a screened
Poisson equation, solved by cosine transforms, holds all of it together. The light on
whole surfaces beside each other, which no gradient shows, follows from how they stand:
tables, what lies behind them, objects. After Barron & Malik 2015 in its priors, not in
its method.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from physgen.maps import F32
from physgen.perceive.backends.light_shading import fit_light, pixel_pairs
from physgen.perceive.roles import Intrinsic, Intrinsics, Labels, Rgb
from physgen.perceive.working_size import reduce_photo_maps
from physgen.photometry import DistantLight, decode, luminance


@dataclass(frozen=True)
class _Priors:
    """Lengths are px of the grid, light and colour are logarithms."""

    side: int = 256  # the longer side of the grid
    darkest: float = 4e-3  # linear light added before logarithms of luminance
    greyest: float = 1e-2  # and of ratios of colours
    calm: float = 1.5  # blur of colours before they are compared, against noise
    # change of colour a px at which a gradient is albedo's rather than shading's
    paint: float = 0.15
    # share of a gradient without a change of colour that is shading's
    shade: float = 0.6
    outline: float = 0.2  # the same at an object's outline, where both change
    # share of the differences of light within one colour that are shading's
    within: float = 0.7
    between: float = 0.3  # and of those between colours
    colours: int = 64  # bins a side of the table of colours, over ratios of e^-3 to e^3
    reach: float = 3.0  # over which those differences are taken together
    hold: float = 0.03  # 1/px²: weight of differences far apart beside gradients
    # trust in Lambert's shading, on objects; around them normals are too uncertain
    trust: float = 0.6
    upwards: float = -0.5  # y of the normals of tables
    # light on a table over that behind it: lamps are above, and it faces them
    lift: float = 0.55
    kept: float = 0.55  # share of how much lighter a table looks that is shading's, too
    stood: float = -0.15  # light on objects over that on the table they stand on
    flat: float = -0.15  # and over that behind them, without a table
    # share of how much lighter an object looks that is shading's: neighbours are lit
    # alike
    own: float = 0.15
    even: float = 0.5  # the least share of ambient light: rooms are bright in the shade
    brightest: float = 0.9  # albedo of the photo's lightest surfaces


PRIORS = _Priors()
LIKELY = DistantLight((0.0, -0.6, 0.8), 0.5, 0.5)
"""Where nothing shows the light."""


def retinex() -> Intrinsic:
    """Return the backend `retinex`."""
    return _retinex


def _retinex(rgb: Rgb, labels: Labels, normals: F32) -> Intrinsics:
    linear = decode(rgb)
    height, width = labels.shape
    scale = min(1.0, PRIORS.side / max(height, width))
    # cv2.dct wants even sides
    size = max(2, round(width * scale / 2)) * 2, max(2, round(height * scale / 2)) * 2
    small = np.asarray(
        cv2.resize(linear, size, interpolation=cv2.INTER_AREA), np.float32
    )
    level = _level(small)
    reduced, ids, normals = reduce_photo_maps(rgb, labels, normals)
    lambert = _lambert(decode(reduced), ids, normals, size)
    ids = np.asarray(
        cv2.resize(labels, size, interpolation=cv2.INTER_NEAREST), np.uint16
    )
    log_shading = _levelled(_parted(small, level, lambert, ids), level, normals, ids)
    shading = np.exp(
        cv2.resize(log_shading, (width, height), interpolation=cv2.INTER_LINEAR)
    )
    most = linear.max(axis=2)
    shading *= np.float32(
        max(float(np.percentile(most / shading, 99.5)), 1e-6) / PRIORS.brightest
    )
    shading = np.maximum(shading, most)  # no surface reflects more light than it gets
    albedo = linear / np.maximum(shading, 1e-6)[..., None]
    return Intrinsics(
        np.clip(albedo, 0, 1).astype(np.float32), shading.astype(np.float32)
    )


def _level(linear: F32) -> F32:
    return np.asarray(
        np.log(luminance(linear) + np.float32(PRIORS.darkest)), np.float32
    )


def _lambert(linear: F32, labels: Labels, normals: F32, size: tuple[int, int]) -> F32:
    """(h, w) on the grid: the logarithm of the shading by normals, weighted by the
    trust in it.
    """
    ids = [int(i) for i in np.flatnonzero(np.bincount(labels.ravel())) if i]
    found = (
        fit_light(pixel_pairs(linear, labels, dict.fromkeys(ids, False), normals))
        if ids
        else None
    )
    light = LIKELY if found is None or found.explained < 0.05 else found.light
    ambient = max(light.ambient, PRIORS.even)
    lit = DistantLight(light.direction, 1 - ambient, ambient)
    coarse = cv2.resize(normals, size, interpolation=cv2.INTER_AREA)
    own = cv2.resize(
        (labels > 0).astype(np.float32), size, interpolation=cv2.INTER_AREA
    )
    return np.asarray(PRIORS.trust * own * np.log(lit.shade(coarse)), np.float32)


def _levelled(shading: F32, level: F32, normals: F32, ids: Labels) -> F32:
    """(h, w) of the grid: the logarithm of `shading`, with the likely light on surfaces
    beside each other.

    Gradients across outlines are of paint and shading both. Within a surface nothing
    changes.
    """
    free = ids == 0
    upright = cv2.resize(normals[..., 1], ids.shape[::-1], interpolation=cv2.INTER_AREA)
    table = free & (upright < PRIORS.upwards)
    rows = np.flatnonzero(table.mean(axis=1) > 0.3)
    behind = free.copy()
    behind[rows[0] if len(rows) else 0 :] = False
    change = np.zeros_like(shading)
    stands = bool(behind.any())
    ground, offset = (table, PRIORS.stood) if stands else (free, PRIORS.flat)
    if not ground.any():
        return shading
    light, seen = float(shading[ground].mean()), float(level[ground].mean())
    if stands:
        darker = -PRIORS.lift + PRIORS.kept * (float(level[behind].mean()) - seen)
        change[behind] = min(0.0, darker) - (float(shading[behind].mean()) - light)
    for i in np.flatnonzero(np.bincount(ids.ravel())):
        if i:
            own = ids == i
            lighter = offset + PRIORS.own * (float(level[own].mean()) - seen)
            change[own] = lighter - (float(shading[own].mean()) - light)
    return np.asarray(shading + change, np.float32)


def _parted(linear: F32, level: F32, lambert: F32, ids: Labels) -> F32:
    """(h, w): the logarithm of shading, from light (h, w, 3), its `level`, Lambert's
    shading, and labels.
    """
    green = linear[..., 1] + np.float32(PRIORS.greyest)
    colour = np.log((linear[..., ::2] + np.float32(PRIORS.greyest)) / green[..., None])
    colour = np.asarray(cv2.GaussianBlur(colour, (0, 0), PRIORS.calm), np.float32)
    usual = _mean_level_of_colour(level, colour)
    mixed = np.asarray(
        PRIORS.within * (level - usual) + PRIORS.between * usual, np.float32
    )
    far = cv2.GaussianBlur(mixed, (0, 0), PRIORS.reach)
    parts = []
    for axis in (1, 0):
        step = np.diff(level, axis=axis)
        change = np.linalg.norm(np.diff(colour, axis=axis), axis=2)
        shares = PRIORS.shade * np.exp(-((change / PRIORS.paint) ** 2))
        shares[np.diff(ids.astype(np.int32), axis=axis) != 0] = PRIORS.outline
        parts.append(shares * step + (1 - shares) * np.diff(lambert, axis=axis))
    return _screened_poisson(parts[0], parts[1], far + lambert)


def _mean_level_of_colour(level: F32, colour: F32) -> F32:
    """(h, w): the mean level of all pixels of a pixel's colour (h, w, 2)."""
    bins_a_side = PRIORS.colours
    place = np.clip((colour + 3) / 6 * (bins_a_side - 1), 0, bins_a_side - 1).astype(
        np.float32
    )
    bins = np.rint(place).astype(np.intp)
    index = (bins[..., 0] * bins_a_side + bins[..., 1]).ravel()
    shape = bins_a_side, bins_a_side
    count, total = (
        cv2.GaussianBlur(
            np.bincount(index, weights, bins_a_side**2)
            .reshape(shape)
            .astype(np.float32),
            (0, 0),
            1.0,
        )
        for weights in (None, level.ravel())
    )
    mean = total / np.maximum(count, 1e-6)
    return np.asarray(
        cv2.remap(mean, place[..., 1], place[..., 0], cv2.INTER_LINEAR), np.float32
    )


def _screened_poisson(across: F32, down: F32, far: F32) -> F32:
    """(h, w) nearest to `far` whose differences are nearest to `across` (h, w-1) and
    `down` (h-1, w).

    The cosine transform turns the screened Poisson equation with a free border into a
    division (Bhat et al. 2008).
    """
    h, w = far.shape
    right = (PRIORS.hold * far).astype(np.float64)
    right[:, :-1] -= across
    right[:, 1:] += across
    right[:-1] -= down
    right[1:] += down
    waves = (2 - 2 * np.cos(np.pi * np.arange(h) / h))[:, None] + (
        2 - 2 * np.cos(np.pi * np.arange(w) / w)
    )
    return np.asarray(cv2.idct(cv2.dct(right) / (PRIORS.hold + waves)), np.float32)
