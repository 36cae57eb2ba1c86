"""Shade around one object on an even ground of unknown geometry.

On a carpet or a cloth in an oblique photo no floor is found, so that a fitted light has
no surface for shadows. However, light varies slowly over such a ground: a plane through
the logarithm of the lit ground gives its brightness without shade. A region that is
darker, is connected to the object and fades away from it is the object's shade.
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
from physgen.perceive.shadow.seams import without_seams
from physgen.perceive.shadow.silhouettes import DARKEST, away_from_objects
from physgen.photometry import decode, encode_u8


@dataclass(frozen=True)
class _Tuning:
    """Sizes are shares of an object's (the root of its area), depths are -log of
    light.
    """

    # px: size of an object in the search.
    size: float = 100.0
    # px: least area.
    smallest: int = 2500
    # Width of the searched surroundings.
    reach: float = 1.0
    # Width at the end of the reach over which removal fades.
    fade: float = 0.15
    # Part of its height, from the top, with a wall rather than ground beside it.
    upper: float = 0.35
    # Standard deviation of the blur against grain.
    blur_width: float = 0.04
    hues: tuple[float, float] = (0.05, 0.12)
    """Largest distance of chromaticities on one ground, and in its shade, which has
    another light.
    """
    levels: tuple[float, float, float] = (2.5, 0.3, 1.2)
    """Logarithms of light of a ground: largest darkening, least darkening of shade,
    largest brightening.
    """
    # Least share of ground in the surroundings.
    ground: float = 0.6
    # Quantile of the ground's light, counted as lit.
    quantile: float = 0.7
    # Rounds of the reweighted fit.
    rounds: int = 12
    # Least depth of shade ...
    least_depth: float = 0.12
    # ... and least standard deviations of the lit ground.
    loud: float = 2.0
    deepest: float = 2.2
    # Least share of shaded pixels connected to the object.
    connected_share: float = 0.6
    # Largest shaded area over the object's.
    area_ratio: float = 1.8
    distances: tuple[float, float] = (0.15, 0.6)
    """Shade is deepest within the first distance and has mostly faded beyond the
    second.
    """
    shares: tuple[float, float] = (0.25, 1.2)
    """Least shaded share of the near ground, and its least ratio to the far ground's
    share.
    """


TUNING = _Tuning()
Darkness = NDArray[np.float32]
"""(H, W, 3): -log of light in each channel."""


def find_smooth_shade(
    background: Rgb, coverage: F32, labels: Labels, objects: Sequence[PhotoObject]
) -> tuple[Rgb, Labels] | None:
    """Return the background without shade, and the ids (H, W) of its objects, or None.

    None means that no object has such a shade.
    """
    result = background
    owners = np.zeros_like(labels)
    for item in objects:
        area = mass_properties(item.outline).area
        if item.cut or area < TUNING.smallest:
            continue
        shade = _shade_of(result, coverage, labels == item.id)
        if shade is None:
            continue
        window, depth = shade
        light = decode(result[window]) * np.exp(depth)
        lit_picture = result.copy()
        lit_picture[window] = encode_u8(np.minimum(light, 1.0).astype(np.float32))
        result = lit_picture
        shade_mask = depth.mean(axis=2) > TUNING.least_depth / 2
        owners[window][shade_mask & (coverage[window] < 0.5)] = item.id
    if owners.any():
        return (result, owners)
    return None


@dataclass(frozen=True)
class _Surroundings:
    """The ground around an object, on a coarse grid."""

    smooth_light: F32
    """(h, w, 3): logarithm of light without grain."""
    own_mask: Mask
    ground_mask: Mask
    distances: F32
    """(h, w): distance from the object over its size."""
    size: float
    """px: size of the object on this grid."""

    @property
    def grey(self) -> F32:
        """Return the mean (h, w) of the channels."""
        return np.asarray(self.smooth_light.mean(axis=2), np.float32)


def _shade_of(
    background: Rgb, coverage: F32, own_mask: Mask
) -> tuple[tuple[slice, slice], Darkness] | None:
    """Return a window around an object and -log of the light that it blocks in the
    window.
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
    surroundings = _surroundings(
        reduced(decode(rgb)), open_mask, small_mask, size / scale
    )
    depth = None if surroundings is None else _depth(surroundings)
    if depth is None:
        return None
    full = cv2.resize(depth, rgb.shape[1::-1], interpolation=cv2.INTER_LINEAR)
    return window, np.asarray(full * free[..., None], np.float32)


def _window(own_mask: Mask, reach: int) -> tuple[slice, slice]:
    """Return rows and columns of an object and the ground around it."""
    left, top, width, height = cv2.boundingRect(own_mask.astype(np.uint8))
    high = max(top + round(TUNING.upper * height), 0)
    rows = slice(high, top + height + reach)
    return rows, slice(max(left - reach, 0), left + width + reach)


def _surroundings(
    linear: F32, open_mask: Mask, own_mask: Mask, size: float
) -> _Surroundings | None:
    """Return the ground around an object, or None if there are several kinds of
    ground.
    """
    outside = (~own_mask).astype(np.uint8)
    distance_px = cv2.distanceTransform(outside, cv2.DIST_L2, 5)
    distances = np.asarray(distance_px / size, np.float32)
    ring = open_mask & (distances < TUNING.reach)
    if not ring.any() or not own_mask.any():
        return None
    logs = np.log(linear + DARKEST).astype(np.float32)
    sigma = max(TUNING.blur_width * size, 1.0)
    # Single grains have many hues, so that hues of a local mean are compared.
    mean = np.exp(_blur_known(logs, ring, sigma)) - DARKEST
    ground = ring & _find_even_ground(np.asarray(mean, np.float32), ring)
    if np.count_nonzero(ground) < TUNING.ground * np.count_nonzero(ring):
        return None
    smooth_logs = _blur_known(logs, ground, sigma)
    return _Surroundings(smooth_logs, own_mask, ground, distances, size)


def _depth(surroundings: _Surroundings) -> Darkness | None:
    """Return -log (h, w, 3) of the missing light, or None without shade."""
    ground = surroundings.ground_mask
    shade = _shade_mask(surroundings)
    connected_shade = _connect(shade, surroundings.own_mask)
    if not _is_shade(surroundings, shade, connected_shade):
        return None
    lit_mask = _select_unshaded_ground(shade, ground)
    planes = [_plane(surroundings.smooth_light[..., c], lit_mask) for c in range(3)]
    depth = np.clip(
        np.stack(planes, axis=-1) - surroundings.smooth_light, 0, TUNING.deepest
    )
    depth = without_seams(
        depth.astype(np.float32), surroundings.own_mask, surroundings.size
    )
    inside = cv2.dilate(connected_shade.astype(np.uint8), np.ones((5, 5), np.uint8))
    sigma = max(TUNING.blur_width * surroundings.size, 1.0)
    weight = cv2.GaussianBlur(inside.astype(np.float32), (0, 0), sigma)
    rows = np.arange(len(weight), dtype=np.float32)[:, None] / surroundings.size
    margin = np.minimum(TUNING.reach - surroundings.distances, rows)
    # Removal fades at the border of the searched surroundings.
    weight *= np.clip(margin / TUNING.fade, 0, 1) * ground
    return _spread(depth * weight[..., None], ground, surroundings.own_mask)


def _shade_mask(surroundings: _Surroundings) -> Mask:
    """Return the pixels (h, w) darker than the plane through the lit ground."""
    ground = surroundings.ground_mask
    grey = surroundings.grey
    level, spread = _lit_plane(grey, ground)
    limit = max(TUNING.least_depth, TUNING.loud * spread)
    # The first plane contains some shade; a second one is fitted without it.
    first_mask = ground & (level - grey > limit)
    level = _plane(grey, _select_unshaded_ground(first_mask, ground))
    dark_mask = (ground & (level - grey > limit)).astype(np.float32)
    wide_mask = without_seams(
        dark_mask[..., None], surroundings.own_mask, surroundings.size
    )
    return (wide_mask[..., 0] > 0) & ground


def _is_shade(surroundings: _Surroundings, shade_mask: Mask, joined_mask: Mask) -> bool:
    """Return whether dark pixels are an object's shade: around it, and not
    elsewhere.
    """
    area = np.count_nonzero(joined_mask)
    touches_object = area >= TUNING.connected_share * np.count_nonzero(shade_mask)
    is_small = area <= TUNING.area_ratio * np.count_nonzero(surroundings.own_mask)
    if not area or not touches_object or not is_small:
        return False
    low, high = TUNING.distances
    near_ground = surroundings.ground_mask & (surroundings.distances < low)
    far_ground = surroundings.ground_mask & (surroundings.distances > high)
    if not near_ground.any() or not far_ground.any():
        return False
    near_share = joined_mask[near_ground].mean()
    far_share = joined_mask[far_ground].mean()
    least_share, times = TUNING.shares
    return bool(near_share >= max(least_share, times * far_share))


def _select_unshaded_ground(shade_mask: Mask, ground_mask: Mask) -> Mask:
    """Return the ground (h, w) away from shade."""
    wide_shade = cv2.dilate(shade_mask.astype(np.uint8), np.ones((7, 7), np.uint8)) > 0
    lit_mask = ground_mask & ~wide_shade
    if lit_mask.sum() > TUNING.size:
        return lit_mask
    return ground_mask & ~shade_mask


def _find_even_ground(linear: F32, ring_mask: Mask) -> Mask:
    """Return the pixels (h, w) with the hue and about the light of most of a ring."""
    total = linear.sum(axis=2) + 3 * DARKEST
    hue = (linear[..., [0, 2]] + DARKEST) / total[..., None]
    middle = np.median(hue[ring_mask], axis=0)
    light = np.log(total)
    offset = light - np.median(light[ring_mask])
    darker, shade_level, brighter = TUNING.levels
    lit_hue, shade_hue = TUNING.hues
    # Shade is lit by other parts of the sky, so that its hue may differ more.
    limit = np.where(offset < -shade_level, shade_hue, lit_hue)
    has_ground_hue = np.hypot(*np.moveaxis(hue - middle, -1, 0)) < limit
    return np.asarray(has_ground_hue & (offset > -darker) & (offset < brighter))


def _blur_known(values: F32, known_mask: Mask, sigma: float) -> F32:
    """Return a blur of (h, w, 3) from known pixels only."""
    weight = known_mask.astype(np.float32)
    weights = cv2.GaussianBlur(weight, (0, 0), sigma)[..., None]
    sums = cv2.GaussianBlur(values * weight[..., None], (0, 0), sigma)
    return np.asarray(sums / np.maximum(weights, 1e-3), np.float32)


def _lit_plane(values: F32, ground_mask: Mask) -> tuple[F32, float]:
    """Return a plane (h, w) through the lit part of a ground, and the residual spread.

    Weights fit a quantile (Koenker and Bassett 1978), so that shade counts less.
    """
    base = _base(values.shape)
    x = base[ground_mask]
    y = values[ground_mask]
    weights = np.ones(len(y))
    for _ in range(TUNING.rounds):
        root = np.sqrt(weights)
        fit = np.linalg.lstsq(x * root[:, None], y * root, rcond=None)[0]
        rest = y - x @ fit
        side = np.where(rest > 0, TUNING.quantile, 1 - TUNING.quantile)
        weights = side / np.maximum(np.abs(rest), 0.01)
    lit_residuals = rest[rest > -TUNING.least_depth / 2]
    if len(lit_residuals):
        spread = float(np.sqrt(np.mean(lit_residuals**2)))
    else:
        spread = 0.0
    return np.asarray(base @ fit, np.float32), spread


def _plane(values: F32, lit_mask: Mask) -> F32:
    """Return the least-squares plane (h, w) through the lit pixels."""
    base = _base(values.shape)
    fit = np.linalg.lstsq(base[lit_mask], values[lit_mask], rcond=None)[0]
    return np.asarray(base @ fit, np.float32)


def _base(shape: tuple[int, ...]) -> NDArray[np.float64]:
    """Return the basis functions (h, w, 3) of a plane."""
    rows, columns = np.mgrid[: shape[0], : shape[1]]
    constant = np.ones(shape[:2])
    return np.stack([constant, columns / shape[1], rows / shape[1]], axis=-1)


def _connect(shade_mask: Mask, own_mask: Mask) -> Mask:
    """Return the shaded pixels connected to the object."""
    wide_object = cv2.dilate(own_mask.astype(np.uint8), np.ones((9, 9), np.uint8)) > 0
    _, names = cv2.connectedComponents((shade_mask | wide_object).astype(np.uint8))
    component_ids = np.unique(names[own_mask])
    return np.asarray(shade_mask & np.isin(names, component_ids[component_ids > 0]))


def _spread(dark: F32, ground_mask: Mask, own_mask: Mask) -> F32:
    """Return depths extended from the object's surroundings to its border."""
    visible = (ground_mask & ~own_mask)[..., None]
    weight = visible.astype(np.float32)
    weights = cv2.GaussianBlur(weight, (0, 0), 2.0).reshape(weight.shape)
    sums = cv2.GaussianBlur(dark * weight, (0, 0), 2.0)
    return np.where(visible, dark, sums / np.maximum(weights, 1e-2)).astype(np.float32)
