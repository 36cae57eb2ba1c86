"""Backend light=shading: distant and ambient light from shading and from highlights.

The light on pairs of pixels of one object and one colour differs only by their shading
(Lambert's law), whatever their albedo. Candidate lights all over the sky are compared
by the explained share of these differences, and the best is refined. A highlight on a
glossy ball is a mirror image of the lamp and shows the direction to the lamp directly.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.geometry.polygon import Disc
from physgen.maps import F32
from physgen.perceive.roles import (
    Intrinsics,
    Labels,
    Light,
    LightGuess,
    Mask,
    PhotoObject,
    Rgb,
)
from physgen.perceive.working_size import reduce_photo_maps
from physgen.photometry import DistantLight, decode, largest_channel, luminance

FROM_ABOVE = DistantLight((0.0, -0.6, 0.8), 0.8, 0.4)
"""The usual position of lamps and the sky: above and in front of the scene."""
AMBIENT = np.array([0.06, 0.15, 0.3, 0.55, 1.0], np.float32)
"""Candidate ratios of ambient to distant light."""
TRUST = {"ball": 1.0, "bulging": 0.5, "flat": 0.12}
"""Weight of an object's shading, by the reliability of its normals."""


@dataclass(frozen=True)
class _Tuning:
    """Light is linear; costs are shares of the cost of even light."""

    # Largest number of pairs.
    pairs: int = 2400
    # Largest distance of chromaticities (logarithms of red and blue over green) in a
    # pair.
    colour_difference: float = 0.12
    # Least distance of the normals in a pair.
    turn: float = 0.35
    # Limit of an error of log light: a larger error is a print, a highlight or another
    # object's shadow.
    largest_error: float = 0.5
    # Number of candidate directions.
    sky: int = 420
    # Mean z of the normals below which an object bulges; a flat face with a rounded rim
    # has more.
    bulging: float = 0.9
    # z of the normals below which a ball's normals are ignored ...
    ball_z: float = 0.2
    # ... and those of all other objects.
    other_z: float = 0.4
    # degrees: least angle between a light and its rivals.
    rival_angle: float = 35.0
    # Cost of a light from straight below, because lamps and the sky are mostly above.
    cost_below: float = 0.1
    # Gain for highlights in full agreement.
    spot_gain: float = 0.25
    # degrees: angle of agreement between highlights.
    spot_angle: float = 12.0
    # Largest size of a highlight over a ball's radius.
    spot_size: float = 0.3
    # Least contrast of a highlight.
    spot_contrast: float = 0.2
    # Largest coloured share of a highlight's light.
    white: float = 0.35
    # Shading of a surface facing the light with its true colour.
    full: float = 1.2
    # Least explained share of the differences for a valid light.
    least_share: float = 0.1
    # Explained share above which only rivals reduce the confidence, because prints and
    # reflections always stay unexplained.
    full_share: float = 0.2


TUNING = _Tuning()


@dataclass(frozen=True)
class PixelPairs:
    """Pairs of pixels: `change` (n,) of log light from the second to the first of each
    pair.
    """

    change: F32
    # (n, 3) normals.
    first: F32
    second: F32
    # (n,).
    weight: F32
    # Sum of trust in the visible objects: 1 for a plain ball.
    trust: float


@dataclass(frozen=True)
class LightEstimate:
    """A light and the share of the photo's shading explained by it."""

    # Its intensity and ambient sum to 1.
    light: DistantLight
    # 0..1: explained share of the differences of light.
    explained_share: float
    # Number of highlights in agreement.
    spots: int
    trust: float
    # 0..1: explanation by the best distant rival relative to this one.
    rival: float


def shading() -> Light:
    """Return the backend `shading`."""
    return _shading


def _shading(
    rgb: Rgb,
    labels: Labels,
    objects: Sequence[PhotoObject],
    normals: F32,
    intrinsics: Intrinsics,
) -> LightGuess:
    """Return the light and its confidence."""
    small_photo, ids, small_normals = reduce_photo_maps(rgb, labels, normals)
    balls = {t.id: isinstance(t.outline, Disc) for t in objects}
    pairs = pixel_pairs(decode(small_photo), ids, balls, small_normals)
    estimate = fit_light(pairs, highlights(rgb, labels, objects))
    if estimate is None or (
        estimate.explained_share < TUNING.least_share and estimate.spots < 2
    ):
        return LightGuess(FROM_ABOVE, 0.1)
    # Prints and reflections always stay unexplained: the share `enough` counts as a
    # full explanation.
    explanation = min(
        1.0, (estimate.explained_share + 0.05 * estimate.spots) / TUNING.full_share
    )
    evidence = min(1.0, estimate.trust + 0.2 * estimate.spots)
    confidence = round(
        0.1 + 0.8 * explanation * (evidence * (1 - estimate.rival)) ** 0.5, 2
    )
    total = estimate.light.intensity + estimate.light.ambient
    scaled_light = DistantLight(
        estimate.light.direction,
        TUNING.full * estimate.light.intensity / total,
        TUNING.full * estimate.light.ambient / total,
    )
    return LightGuess(scaled_light, confidence)


def fit_light(
    pairs: PixelPairs | None, spots: F32 | None = None
) -> LightEstimate | None:
    """Return the best light for `pairs` and highlights, or None without evidence.

    `spots` (m, 3) are the directions of highlights.
    """
    if spots is None:
        spots = np.zeros((0, 3), np.float32)
    if pairs is None and len(spots) < 2:
        return None
    sky = _directions(TUNING.sky)
    cost = _cost(pairs, sky, spots)
    best = sky[np.unravel_index(int(cost.argmin()), cost.shape)[0]]
    # Refine the best direction among 160 neighbours.
    neighbours = best + 0.12 * _directions(160, is_sphere=True)
    neighbours = np.concatenate(
        [best[None], neighbours / np.linalg.norm(neighbours, axis=1, keepdims=True)]
    )
    neighbours = neighbours.astype(np.float32)
    fine_cost = _cost(pairs, neighbours, spots)
    low = np.unravel_index(int(fine_cost.argmin()), fine_cost.shape)
    direction = neighbours[low[0]]
    ratio = float(AMBIENT[low[1]])
    agree = int((spots @ direction > np.cos(np.radians(2 * TUNING.spot_angle))).sum())
    if pairs is None:
        explanation = 0.0
    else:
        explanation = 1 - float(_misfit(pairs, direction[None])[0, low[1]])
    # A distant direction with a similar cost makes the light ambiguous.
    rival_costs = cost[sky @ direction < np.cos(np.radians(TUNING.rival_angle))]
    if rival_costs.size:
        worth = max(1 - float(rival_costs.min()), 0) / max(1 - float(cost.min()), 1e-6)
    else:
        worth = 0.0
    trust = 0.0 if pairs is None else pairs.trust
    return LightEstimate(
        _light(direction, ratio),
        max(explanation, 0.0),
        agree,
        trust,
        round(min(worth, 1.0), 3),
    )


def _light(direction: F32, ratio: float) -> DistantLight:
    x, y, z = (
        direction.astype(np.float64) / np.linalg.norm(direction.astype(np.float64))
    ).tolist()
    return DistantLight((x, y, z), 1 / (1 + ratio), ratio / (1 + ratio))


def _cost(pairs: PixelPairs | None, sky: F32, spots: F32) -> F32:
    """Return the cost (m, ambients) of directions: unexplained share plus prior.

    Even light without any evidence costs 1.
    """
    cost = np.ones((len(sky), len(AMBIENT)), np.float32)
    if pairs is not None:
        # Little shading is weak evidence.
        share = min(1.0, 2 * pairs.trust)
        cost += np.float32(share) * (_misfit(pairs, sky) - 1)
    cost += np.float32(TUNING.cost_below) * np.maximum(sky[:, 1], -0.3)[:, None]
    if len(spots):
        angles = np.degrees(np.arccos(np.clip(sky @ spots.T, -1, 1)))
        agree = np.exp(-0.5 * (angles / TUNING.spot_angle) ** 2).sum(axis=1) / (
            len(spots) + 0.5
        )
        cost -= np.float32(TUNING.spot_gain) * agree[:, None].astype(np.float32)
    return cost


def _misfit(pairs: PixelPairs, sky: F32) -> F32:
    """Return the error (m, ambients) of the pairs' differences over that of even
    light.
    """
    first_shading = np.maximum(pairs.first @ sky.T, 0)
    second_shading = np.maximum(pairs.second @ sky.T, 0)
    even_cost = float(
        (pairs.weight * np.minimum(np.abs(pairs.change), TUNING.largest_error)).sum()
    )
    costs = np.empty((len(sky), len(AMBIENT)), np.float32)
    for k, ambient in enumerate(AMBIENT):
        prediction = np.log((first_shading + ambient) / (second_shading + ambient))
        costs[:, k] = pairs.weight @ np.minimum(
            np.abs(prediction - pairs.change[:, None]), TUNING.largest_error
        )
    return costs / np.float32(max(even_cost, 1e-9))


def _directions(count: int, is_sphere: bool = False) -> F32:
    """Return `count` directions (count, 3), evenly distributed (Fibonacci's spiral).

    Unless `is_sphere`, directions behind the scene are left out.
    """
    k = np.arange(count) + 0.5
    z = 1 - k / count * (2.0 if is_sphere else 1.05)
    angle = k * np.pi * (3 - 5**0.5)
    sine = np.sqrt(1 - z * z)
    return np.stack([sine * np.cos(angle), sine * np.sin(angle), z], -1).astype(
        np.float32
    )


@dataclass(frozen=True, eq=False)
class _PhotoMaps:
    """Maps of a photo from which pixel pairs are drawn."""

    # (H, W): log luminance.
    level: F32
    # (H, W, 2): log ratios of the channels.
    chroma: F32
    # (H, W, 3): unit normals.
    normals: F32
    # (H, W): pixels that are not overexposed.
    valid: Mask


def pixel_pairs(
    linear: F32, labels: Labels, balls: dict[int, bool], normals: F32
) -> PixelPairs | None:
    """Return pairs inside the objects of `balls` (True for spheres), or None.

    The random draw is the same each time.
    """
    random = np.random.default_rng(0)
    maps = _measure_maps(linear, normals)
    quota = max(60, TUNING.pairs // max(len(balls), 1))
    parts = []
    for i, is_ball in balls.items():
        part = _draw_pairs(maps, labels == i, is_ball, quota, random)
        if part is not None:
            parts.append(part)
    if not parts:
        return None
    return PixelPairs(
        np.concatenate([part.change for part in parts]),
        np.concatenate([part.first for part in parts]),
        np.concatenate([part.second for part in parts]),
        np.concatenate([part.weight for part in parts]),
        sum((part.trust for part in parts), 0.0),
    )


def _measure_maps(linear: F32, normals: F32) -> _PhotoMaps:
    """Return the maps of a photo (H, W, 3) in linear light."""
    level = np.log(luminance(linear) + np.float32(2e-3))
    small = linear + np.float32(4e-3)
    chroma = np.log(
        np.stack([small[..., 0] / small[..., 1], small[..., 2] / small[..., 1]], -1)
    )
    return _PhotoMaps(level, chroma, normals, largest_channel(linear) < 0.98)


def _draw_pairs(
    maps: _PhotoMaps, mask: Mask, is_ball: bool, quota: int, random: np.random.Generator
) -> PixelPairs | None:
    """Return at most `quota` pairs of equal colour and different normals, or None.

    None means that an object has too few.
    """
    rows, columns = _select_pixels(maps, mask, is_ball)
    if len(rows) < 40:
        return None
    normals = maps.normals[rows, columns]
    chroma = maps.chroma[rows, columns]
    a, b = random.integers(0, len(rows), (2, 12 * quota))
    differences = np.abs(chroma[a] - chroma[b]).max(axis=1)
    turns = np.linalg.norm(normals[a] - normals[b], axis=1)
    is_pair = (differences < TUNING.colour_difference) & (turns > TUNING.turn)
    indices = np.flatnonzero(is_pair)[:quota]
    count = len(indices)
    if count < 20:
        return None
    a = a[indices]
    b = b[indices]
    kind = _name_form(normals, is_ball)
    weight = TRUST[kind] * min(1.0, count / quota) * min(1.0, (len(rows) / 600) ** 0.5)
    level = maps.level[rows, columns]
    weights = np.full(count, weight / count, np.float32)
    return PixelPairs(level[a] - level[b], normals[a], normals[b], weights, weight)


def _select_pixels(
    maps: _PhotoMaps, mask: Mask, is_ball: bool
) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return rows and columns of an object's pixels that face the viewer.

    Border pixels are mixed with the background.
    """
    inner = cv2.erode(mask.astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
    rows, columns = np.nonzero(inner)
    if is_ball:
        least_z = TUNING.ball_z
    else:
        least_z = TUNING.other_z
    is_facing = maps.normals[rows, columns, 2] > least_z
    selection = is_facing & maps.valid[rows, columns]
    return rows[selection], columns[selection]


def _name_form(normals: F32, is_ball: bool) -> str:
    """Return the form of an object for `TRUST`, by its normals (n, 3)."""
    if is_ball:
        return "ball"
    if float(normals[:, 2].mean()) < TUNING.bulging:
        return "bulging"
    return "flat"


def highlights(rgb: Rgb, labels: Labels, objects: Sequence[PhotoObject]) -> F32:
    """Return the directions (m, 3) of lamps by the white spots on balls.

    The normal at a spot lies halfway between viewer and lamp (Blinn 1977).
    """
    directions = []
    for item in objects:
        if not isinstance(item.outline, Disc) or item.outline.radius < 8:
            continue
        x = float(item.outline.center[0])
        y = float(item.outline.center[1])
        r = float(item.outline.radius)
        x0 = max(0, int(x - r))
        y0 = max(0, int(y - r))
        part = decode(rgb[y0 : int(y + r) + 2, x0 : int(x + r) + 2])
        mask = labels[y0 : int(y + r) + 2, x0 : int(x + r) + 2] == item.id
        spot = _white_spot(part, mask, r)
        if spot is None:
            continue
        u = (spot[0] + x0 - x) / r
        v = (spot[1] + y0 - y) / r
        # Farther out it is a lamp behind the scene, or light on the rim.
        if u * u + v * v > 0.6:
            continue
        z = (1 - u * u - v * v) ** 0.5
        directions.append((2 * z * u, 2 * z * v, 2 * z * z - 1))
    return np.array(directions, np.float32).reshape(-1, 3)


def _white_spot(part: F32, mask: Mask, radius: float) -> tuple[float, float] | None:
    """Return (x, y) of the brightest small white spot of a ball, or None."""
    white_level = np.where(mask, part.min(axis=2), 0).astype(np.float32)
    size = 2 * max(1, round(TUNING.spot_size * radius)) + 1
    kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (size, size))
    # A morphological opening removes spots smaller than the kernel.
    excess = white_level - cv2.morphologyEx(white_level, cv2.MORPH_OPEN, kernel)
    peak = float(excess.max())
    if peak < TUNING.spot_contrast:
        return None
    row, column = np.unravel_index(int(excess.argmax()), excess.shape)
    colour = part[row, column]
    if float(colour.max() - colour.min()) > TUNING.white * float(colour.max()):
        return None
    count, ids = cv2.connectedComponents((excess > 0.5 * peak).astype(np.uint8))
    blob = ids == ids[row, column]
    if blob.sum() > 0.06 * mask.sum() or count > 6:
        return None
    rows, columns = np.nonzero(blob)
    weight = excess[blob]
    return float((columns * weight).sum() / weight.sum()), float(
        (rows * weight).sum() / weight.sum()
    )
