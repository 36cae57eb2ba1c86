"""Shade around one object on an even ground, whose geometry is unknown.

On a carpet or a cloth that the camera sees at an angle, no floor is found, and the fit
of a light has nothing to cast shadows on. Light still varies slowly over such a ground:
a plane through the logarithm of the lit ground states how bright it is without shade.
What is darker, is joined to the object and fades away from it is the object's shade.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.geometry.polygon import mass_properties
from physgen.maps import F32
from physgen.perceive.roles import Labels, Mask, PhotoObject, Rgb
from physgen.perceive.shadow.silhouettes import DARKEST, away_from_objects
from physgen.photometry import decode, encode_u8


@dataclass(frozen=True)
class _Tuning:
    """Sizes are shares of an object's (the root of its area), depths are -log of
    light.
    """

    size: float = 100.0  # px of an object when its ground is searched
    smallest: int = 2500  # px of its area
    reach: float = 1.0  # around it, that is searched
    fade: float = 0.15  # at the end of the reach, over which removal fades
    upper: float = 0.35  # of its height, above which the surroundings are a wall
    smooth: float = 0.04  # standard deviation of the blur that averages grain
    hues: tuple[float, float] = (0.05, 0.12)
    """Distance of chromaticities of one ground, and in its shade, of another light."""
    levels: tuple[float, float, float] = (2.5, 0.3, 1.2)
    """Logarithms of light, by which a ground is darker, is in shade and is brighter."""
    ground: float = 0.6  # share of the surroundings that must be ground
    quantile: float = 0.7  # of the ground's light, that counts as lit
    rounds: int = 12  # of the reweighted fit
    least: float = 0.12  # depth from which a place is shaded
    loud: float = 2.0  # standard deviations of the lit ground, from which it is
    deepest: float = 2.2
    joined: float = 0.6  # share of shaded places that must join the object
    most: float = 1.8  # shaded area over the object's, at most
    distances: tuple[float, float] = (0.15, 0.6)
    """Within the first shade is deepest, beyond the second it has mostly faded."""
    shares: tuple[float, float] = (0.25, 1.2)
    """Of the near ground that must be shaded, and that over the share of the far
    one.
    """


TUNING = _Tuning()
Darkness = NDArray[np.float32]
"""(H, W, 3): -log of light in each channel."""


def find_smooth_shade(
    background: Rgb, coverage: F32, labels: Labels, objects: Sequence[PhotoObject]
) -> tuple[Rgb, Labels] | None:
    """Return the background without shade, and (H, W) the ids of its objects.

    None if no object has such a shade.
    """
    clean = background
    owners = np.zeros_like(labels)
    for item in objects:
        area = mass_properties(item.outline).area
        if item.cut or area < TUNING.smallest:
            continue
        found = _shade_of(clean, coverage, labels == item.id)
        if found is None:
            continue
        window, dark = found
        light = decode(clean[window]) * np.exp(dark)
        lit = clean.copy()
        lit[window] = encode_u8(np.minimum(light, 1.0).astype(np.float32))
        clean = lit
        is_shaded = dark.mean(axis=2) > TUNING.least / 2
        owners[window][is_shaded & (coverage[window] < 0.5)] = item.id
    return (clean, owners) if owners.any() else None


@dataclass(frozen=True)
class _Surroundings:
    """The ground around an object, on a coarse grid."""

    smooth: F32
    """(h, w, 3) logarithm of light without grain."""
    own_mask: Mask
    ground_mask: Mask
    distances: F32
    """(h, w) from the object, as shares of its size."""
    size: float
    """px of the object on this grid."""

    @property
    def grey(self) -> F32:
        """(h, w): the mean of the channels."""
        return np.asarray(self.smooth.mean(axis=2), np.float32)


def _shade_of(
    background: Rgb, coverage: F32, own_mask: Mask
) -> tuple[tuple[slice, slice], Darkness] | None:
    """Return a window around an object and -log of the light that it keeps away
    there.
    """
    size = float(np.sqrt(np.count_nonzero(own_mask)))
    window = _window(own_mask, round(TUNING.reach * size))
    rgb = background[window]
    free = away_from_objects(coverage, 1)[window].astype(np.float32)
    scale = max(size / TUNING.size, 1.0)
    shape = max(round(rgb.shape[1] / scale), 2), max(round(rgb.shape[0] / scale), 2)

    def reduced(picture: F32) -> F32:
        small = cv2.resize(picture, shape, interpolation=cv2.INTER_AREA)
        return np.asarray(small, np.float32)

    open_mask = reduced(free) > 0.95
    small_mask = reduced(own_mask[window].astype(np.float32)) > 0.5
    around = _surroundings(reduced(decode(rgb)), open_mask, small_mask, size / scale)
    depth = None if around is None else _depth(around)
    if depth is None:
        return None
    full = cv2.resize(depth, rgb.shape[1::-1], interpolation=cv2.INTER_LINEAR)
    return window, np.asarray(full * free[..., None], np.float32)


def _window(own_mask: Mask, reach: int) -> tuple[slice, slice]:
    """Return the rows and columns of an object and the ground around it."""
    left, top, width, height = cv2.boundingRect(own_mask.astype(np.uint8))
    high = max(top + round(TUNING.upper * height), 0)
    rows = slice(high, top + height + reach)
    return rows, slice(max(left - reach, 0), left + width + reach)


def _surroundings(
    linear: F32, open_mask: Mask, own_mask: Mask, size: float
) -> _Surroundings | None:
    """Return the ground around an object; None if it is of several kinds."""
    outside = (~own_mask).astype(np.uint8)
    far = cv2.distanceTransform(outside, cv2.DIST_L2, 5)
    distances = np.asarray(far / size, np.float32)
    ring = open_mask & (distances < TUNING.reach)
    if not ring.any() or not own_mask.any():
        return None
    logs = np.log(linear + DARKEST).astype(np.float32)
    sigma = max(TUNING.smooth * size, 1.0)
    mean = np.exp(_smoothed(logs, ring, sigma)) - DARKEST  # grains have many hues
    ground = ring & _alike(np.asarray(mean, np.float32), ring)
    if np.count_nonzero(ground) < TUNING.ground * np.count_nonzero(ring):
        return None
    smooth = _smoothed(logs, ground, sigma)
    return _Surroundings(smooth, own_mask, ground, distances, size)


def _depth(around: _Surroundings) -> Darkness | None:
    """Return -log of the light that is missing (h, w, 3); None if there is no shade."""
    ground = around.ground_mask
    shade = _shade_mask(around)
    joined = _joined(shade, around.own_mask)
    if not _is_shade(around, shade, joined):
        return None
    lit = _away_from(shade, ground)
    planes = [_plane(around.smooth[..., c], lit) for c in range(3)]
    dark = np.clip(np.stack(planes, axis=-1) - around.smooth, 0, TUNING.deepest)
    inside = cv2.dilate(joined.astype(np.uint8), np.ones((5, 5), np.uint8))
    sigma = max(TUNING.smooth * around.size, 1.0)
    weight = cv2.GaussianBlur(inside.astype(np.float32), (0, 0), sigma)
    rows = np.arange(len(weight), dtype=np.float32)[:, None] / around.size
    margin = np.minimum(TUNING.reach - around.distances, rows)
    weight *= np.clip(margin / TUNING.fade, 0, 1) * ground
    return _spread(dark * weight[..., None], ground, around.own_mask)


def _shade_mask(around: _Surroundings) -> Mask:
    """Return the places (h, w) that are darker than the plane through the lit
    ground.
    """
    ground, grey = around.ground_mask, around.grey
    level, spread = _lit_plane(grey, ground)
    limit = max(TUNING.least, TUNING.loud * spread)
    rough = ground & (level - grey > limit)
    level = _plane(grey, _away_from(rough, ground))
    return np.asarray(ground & (level - grey > limit))


def _is_shade(around: _Surroundings, shade_mask: Mask, joined_mask: Mask) -> bool:
    """Return whether dark places are an object's shade: around it, and not
    elsewhere.
    """
    area = np.count_nonzero(joined_mask)
    is_joined = area >= TUNING.joined * np.count_nonzero(shade_mask)
    is_small = area <= TUNING.most * np.count_nonzero(around.own_mask)
    if not area or not is_joined or not is_small:
        return False
    low, high = TUNING.distances
    near = around.ground_mask & (around.distances < low)
    far = around.ground_mask & (around.distances > high)
    if not near.any() or not far.any():
        return False
    near_share, far_share = joined_mask[near].mean(), joined_mask[far].mean()
    least, times = TUNING.shares
    return bool(near_share >= max(least, times * far_share))


def _away_from(shade_mask: Mask, ground_mask: Mask) -> Mask:
    """Return the ground (h, w) that is not shaded, nor next to shade."""
    wide = cv2.dilate(shade_mask.astype(np.uint8), np.ones((7, 7), np.uint8)) > 0
    lit = ground_mask & ~wide
    return lit if lit.sum() > TUNING.size else ground_mask & ~shade_mask


def _alike(linear: F32, ring_mask: Mask) -> Mask:
    """Return the pixels (h, w) of the hue and about the light of most of a ring."""
    total = linear.sum(axis=2) + 3 * DARKEST
    hue = (linear[..., [0, 2]] + DARKEST) / total[..., None]
    middle = np.median(hue[ring_mask], axis=0)
    light = np.log(total)
    offset = light - np.median(light[ring_mask])
    darker, dim, brighter = TUNING.levels
    lit_hue, shade_hue = TUNING.hues
    limit = np.where(offset < -dim, shade_hue, lit_hue)
    is_near = np.hypot(*np.moveaxis(hue - middle, -1, 0)) < limit
    return np.asarray(is_near & (offset > -darker) & (offset < brighter))


def _smoothed(values: F32, known_mask: Mask, sigma: float) -> F32:
    """Return the blur of (h, w, 3) from known pixels alone."""
    weight = known_mask.astype(np.float32)
    near = cv2.GaussianBlur(weight, (0, 0), sigma)[..., None]
    sums = cv2.GaussianBlur(values * weight[..., None], (0, 0), sigma)
    return np.asarray(sums / np.maximum(near, 1e-3), np.float32)


def _lit_plane(values: F32, ground_mask: Mask) -> tuple[F32, float]:
    """Return a plane (h, w) through the lit part of a ground, and how far that differs.

    A quantile is fitted by weights (Koenker and Bassett 1978), so that shade counts
    less.
    """
    base = _base(values.shape)
    x, y = base[ground_mask], values[ground_mask]
    weights = np.ones(len(y))
    for _ in range(TUNING.rounds):
        root = np.sqrt(weights)
        fit = np.linalg.lstsq(x * root[:, None], y * root, rcond=None)[0]
        rest = y - x @ fit
        side = np.where(rest > 0, TUNING.quantile, 1 - TUNING.quantile)
        weights = side / np.maximum(np.abs(rest), 0.01)
    above = rest[rest > -TUNING.least / 2]
    spread = float(np.sqrt(np.mean(above**2))) if len(above) else 0.0
    return np.asarray(base @ fit, np.float32), spread


def _plane(values: F32, lit_mask: Mask) -> F32:
    """Return the plane (h, w) by least squares through the lit pixels."""
    base = _base(values.shape)
    fit = np.linalg.lstsq(base[lit_mask], values[lit_mask], rcond=None)[0]
    return np.asarray(base @ fit, np.float32)


def _base(shape: tuple[int, ...]) -> NDArray[np.float64]:
    """Return the functions (h, w, 3) of a plane."""
    rows, columns = np.mgrid[: shape[0], : shape[1]]
    ones = np.ones(shape[:2])
    return np.stack([ones, columns / shape[1], rows / shape[1]], axis=-1)


def _joined(shade_mask: Mask, own_mask: Mask) -> Mask:
    """Return the shaded pixels that are joined to the object."""
    wide = cv2.dilate(own_mask.astype(np.uint8), np.ones((9, 9), np.uint8)) > 0
    _, names = cv2.connectedComponents((shade_mask | wide).astype(np.uint8))
    own = np.unique(names[own_mask])
    return np.asarray(shade_mask & np.isin(names, own[own > 0]))


def _spread(dark: F32, ground_mask: Mask, own_mask: Mask) -> F32:
    """Return depths with those beside the object carried on to its border."""
    visible = (ground_mask & ~own_mask)[..., None]
    weight = visible.astype(np.float32)
    near = cv2.GaussianBlur(weight, (0, 0), 2.0).reshape(weight.shape)
    soft = cv2.GaussianBlur(dark * weight, (0, 0), 2.0)
    return np.where(visible, dark, soft / np.maximum(near, 1e-2)).astype(np.float32)
