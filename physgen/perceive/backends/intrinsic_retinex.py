"""Backend intrinsic=retinex: albedo and shading from colour changes and normals.

A change of colour is a change of paint (Land & McCann 1971; Funt, Drew & Brockington
1992 for colour): such gradients belong to albedo, the others mostly to shading. Distant
places of one colour mostly have one albedo (Garces et al. 2012). Therefore differences
of light within a colour belong to shading, and differences between colours mostly do
not. The normals and the estimated light (`light=shading`) give the shading of objects.
A screened Poisson equation, solved by cosine transforms, combines all of this. No
gradient shows the light on whole surfaces side by side; it follows from their
orientation: tables, backgrounds, objects. The priors, but not the method, follow Barron
& Malik 2015.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from physgen.maps import F32
from physgen.perceive.backends.light_shading import fit_light, pixel_pairs
from physgen.perceive.roles import Intrinsic, Intrinsics, Labels, Rgb
from physgen.perceive.working_size import reduce_photo_maps
from physgen.photometry import DistantLight, decode, largest_channel, luminance


@dataclass(frozen=True)
class _Priors:
    """Lengths are px of the grid, light and colour are logarithms."""

    # Longer side of the grid.
    side: int = 256
    # Linear light added before logarithms of luminance ...
    darkest: float = 4e-3
    # ... and before ratios of colours.
    greyest: float = 1e-2
    # Blur of colours before comparison, against noise.
    blur: float = 1.5
    # Change of colour per px at which a gradient belongs to albedo rather than shading.
    paint: float = 0.15
    # Shading's share of a gradient without a change of colour ...
    shade: float = 0.6
    # ... and of a gradient at an object's outline, where both change.
    outline: float = 0.2
    # Shading's share of the differences of light within one colour ...
    share_within: float = 0.7
    # ... and between colours.
    share_between: float = 0.3
    # Bins per side of the table of colours, over ratios of e^-3 to e^3.
    colours: int = 64
    # Blur of these differences.
    reach: float = 3.0
    # 1/px²: weight of distant differences relative to gradients.
    hold: float = 0.03
    # Trust in Lambert's shading on objects; normals of the background are too
    # uncertain.
    trust: float = 0.6
    # Largest y of a table's normals.
    upwards: float = -0.5
    # Light on a table over the light behind it, because lamps are above and the table
    # faces them.
    lift: float = 0.55
    # Shading's share of a table's extra brightness.
    table_share: float = 0.55
    # Light on objects over the light on their table.
    table_offset: float = -0.15
    # Light on objects over the light behind them, without a table.
    background_offset: float = -0.15
    # Shading's share of an object's extra brightness: neighbours have similar light.
    object_share: float = 0.15
    # Least share of ambient light: rooms are bright in the shade.
    ambient_share: float = 0.5
    # Albedo of the photo's lightest surfaces.
    brightest: float = 0.9


PRIORS = _Priors()
LIKELY = DistantLight((0.0, -0.6, 0.8), 0.5, 0.5)
"""The assumed light without evidence."""


def retinex() -> Intrinsic:
    """Return the backend `retinex`."""
    return _retinex


def _retinex(rgb: Rgb, labels: Labels, normals: F32) -> Intrinsics:
    """Return albedo and shading of a photo at full size."""
    linear = decode(rgb)
    height, width = labels.shape
    scale = min(1.0, PRIORS.side / max(height, width))
    # cv2.dct requires even sides.
    size = max(2, round(width * scale / 2)) * 2, max(2, round(height * scale / 2)) * 2
    small = np.asarray(
        cv2.resize(linear, size, interpolation=cv2.INTER_AREA), np.float32
    )
    level = _level(small)
    small_photo, ids, normals = reduce_photo_maps(rgb, labels, normals)
    lambert = _lambert(decode(small_photo), ids, normals, size)
    ids = np.asarray(
        cv2.resize(labels, size, interpolation=cv2.INTER_NEAREST), np.uint16
    )
    log_shading = _align_surface_shading(
        _separate_shading(small, level, lambert, ids), level, normals, ids
    )
    shading = np.exp(
        cv2.resize(log_shading, (width, height), interpolation=cv2.INTER_LINEAR)
    )
    brightest_channel = largest_channel(linear)
    shading *= np.float32(
        max(float(np.percentile(brightest_channel / shading, 99.5)), 1e-6)
        / PRIORS.brightest
    )
    # No surface reflects more light than it receives.
    shading = np.maximum(shading, brightest_channel)
    albedo = linear / np.maximum(shading, 1e-6)[..., None]
    return Intrinsics(
        np.clip(albedo, 0, 1).astype(np.float32), shading.astype(np.float32)
    )


def _level(linear: F32) -> F32:
    """Return the logarithm of luminance (h, w)."""
    return np.asarray(
        np.log(luminance(linear) + np.float32(PRIORS.darkest)), np.float32
    )


def _lambert(linear: F32, labels: Labels, normals: F32, size: tuple[int, int]) -> F32:
    """Return the log shading (h, w) on the grid by normals, weighted by the trust in
    it.
    """
    ids = []
    for i in np.flatnonzero(np.bincount(labels.ravel())):
        if i:
            ids.append(int(i))
    estimate = None
    if ids:
        estimate = fit_light(
            pixel_pairs(linear, labels, dict.fromkeys(ids, False), normals)
        )
    if estimate is None or estimate.explained_share < 0.05:
        light = LIKELY
    else:
        light = estimate.light
    ambient = max(light.ambient, PRIORS.ambient_share)
    light_model = DistantLight(light.direction, 1 - ambient, ambient)
    small_normals = cv2.resize(normals, size, interpolation=cv2.INTER_AREA)
    object_share = cv2.resize(
        (labels > 0).astype(np.float32), size, interpolation=cv2.INTER_AREA
    )
    return np.asarray(
        PRIORS.trust * object_share * np.log(light_model.shade(small_normals)),
        np.float32,
    )


def _align_surface_shading(shading: F32, level: F32, normals: F32, ids: Labels) -> F32:
    """Return the log shading (h, w) with the likely light on surfaces side by side.

    Gradients across outlines mix paint and shading. Inside a surface nothing changes.
    """
    free = ids == 0
    upright = cv2.resize(normals[..., 1], ids.shape[::-1], interpolation=cv2.INTER_AREA)
    table = free & (upright < PRIORS.upwards)
    # Everything above the table's first rows lies behind it.
    rows = np.flatnonzero(table.mean(axis=1) > 0.3)
    background = free.copy()
    background[rows[0] if len(rows) else 0 :] = False
    change = np.zeros_like(shading)
    stands = bool(background.any())
    ground, offset = (
        (table, PRIORS.table_offset) if stands else (free, PRIORS.background_offset)
    )
    if not ground.any():
        return shading
    light = float(shading[ground].mean())
    ground_level = float(level[ground].mean())
    if stands:
        darker = -PRIORS.lift + PRIORS.table_share * (
            float(level[background].mean()) - ground_level
        )
        change[background] = min(0.0, darker) - (
            float(shading[background].mean()) - light
        )
    for i in np.flatnonzero(np.bincount(ids.ravel())):
        if i:
            object_mask = ids == i
            lighter = offset + PRIORS.object_share * (
                float(level[object_mask].mean()) - ground_level
            )
            change[object_mask] = lighter - (float(shading[object_mask].mean()) - light)
    return np.asarray(shading + change, np.float32)


def _separate_shading(linear: F32, level: F32, lambert: F32, ids: Labels) -> F32:
    """Return the log shading (h, w) from light (h, w, 3), its `level`, Lambert's
    shading and labels.
    """
    green = linear[..., 1] + np.float32(PRIORS.greyest)
    colour = np.log((linear[..., ::2] + np.float32(PRIORS.greyest)) / green[..., None])
    colour = np.asarray(cv2.GaussianBlur(colour, (0, 0), PRIORS.blur), np.float32)
    usual = _mean_level_of_colour(level, colour)
    target = np.asarray(
        PRIORS.share_within * (level - usual) + PRIORS.share_between * usual, np.float32
    )
    smooth_target = cv2.GaussianBlur(target, (0, 0), PRIORS.reach)
    parts = []
    # Divide each gradient between shading and paint by the change of colour.
    for axis in (1, 0):
        step = np.diff(level, axis=axis)
        change = np.linalg.norm(np.diff(colour, axis=axis), axis=2)
        shares = PRIORS.shade * np.exp(-((change / PRIORS.paint) ** 2))
        shares[np.diff(ids.astype(np.int32), axis=axis) != 0] = PRIORS.outline
        parts.append(shares * step + (1 - shares) * np.diff(lambert, axis=axis))
    return _screened_poisson(parts[0], parts[1], smooth_target + lambert)


def _mean_level_of_colour(level: F32, colour: F32) -> F32:
    """Return the mean level (h, w) of all pixels with a pixel's colour (h, w, 2)."""
    bins_a_side = PRIORS.colours
    last_bin = bins_a_side - 1
    place = np.clip((colour + 3) / 6 * last_bin, 0, last_bin).astype(np.float32)
    bins = np.rint(place).astype(np.intp)
    index = (bins[..., 0] * bins_a_side + bins[..., 1]).ravel()
    shape = bins_a_side, bins_a_side

    def smooth_sums(weights: F32 | None) -> F32:
        sums = np.bincount(index, weights, bins_a_side**2).reshape(shape)
        blurred_sums = cv2.GaussianBlur(sums.astype(np.float32), (0, 0), 1.0)
        return np.asarray(blurred_sums, np.float32)

    count = smooth_sums(None)
    mean = smooth_sums(level.ravel()) / np.maximum(count, 1e-6)
    result = cv2.remap(mean, place[..., 1], place[..., 0], cv2.INTER_LINEAR)
    return np.asarray(result, np.float32)


def _screened_poisson(x_steps: F32, down: F32, weights: F32) -> F32:
    """Return the map (h, w) nearest to `weights` with differences nearest to `x_steps` and
    `down`.

    `x_steps` is (h, w-1) and `down` is (h-1, w). The cosine transform turns the screened
    Poisson equation with a free border into a division (Bhat et al. 2008).
    """
    h, w = weights.shape
    right = (PRIORS.hold * weights).astype(np.float64)
    right[:, :-1] -= x_steps
    right[:, 1:] += x_steps
    right[:-1] -= down
    right[1:] += down
    waves = (2 - 2 * np.cos(np.pi * np.arange(h) / h))[:, None] + (
        2 - 2 * np.cos(np.pi * np.arange(w) / w)
    )
    return np.asarray(cv2.idct(cv2.dct(right) / (PRIORS.hold + waves)), np.float32)
