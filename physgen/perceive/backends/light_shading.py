"""Backend light=shading: distant and ambient light from the shading of objects
(Lambert's law) and from highlights.

Pairs of pixels of one object and one colour differ in light by their shading alone,
whatever their albedo. Lights all over the sky are compared by how well they explain
those differences, and the best is refined. A bright spot on a glossy ball is a mirror
image of the lamp, and shows where that is by itself.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

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
from physgen.photometry import DistantLight, decode, luminance

FROM_ABOVE = DistantLight((0.0, -0.6, 0.8), 0.8, 0.4)
"""The usual place of lamps and skies: above and in front of the scene."""
AMBIENT = np.array([0.06, 0.15, 0.3, 0.55, 1.0], np.float32)
"""Over the intensity of the distant light: those tried."""
TRUST = {"ball": 1.0, "bulging": 0.5, "flat": 0.12}
"""Weight of an object's shading, by how well its normals are known."""


@dataclass(frozen=True)
class _Tuning:
    """Light is linear, costs are shares of what would explain everything."""

    pairs: int = 2400  # in all, at most
    # between the chromaticities (logarithms of red and blue over green) of a pair, at most
    alike: float = 0.12
    turned: float = 0.35  # between its normals, at least
    # of the logarithm of light: a larger error is a print, a highlight or another object's shadow
    most: float = 0.5
    sky: int = 420  # directions tried
    # mean z of the normals, under which an object has more to it than a face's rounded rim
    bulging: float = 0.9
    ball_z: float = 0.2  # z of the normals under which a ball's are not trusted
    other_z: float = 0.4  # and those of all others
    elsewhere: float = 35.0  # degrees from a light at which others are its rivals
    # cost of a light from straight below: lamps and skies are mostly above
    below: float = 0.1
    spot_gain: float = 0.25  # of highlights that all agree
    spot_angle: float = 12.0  # degrees within which they agree
    # of a ball's radius: the size under which a bright spot is a highlight
    spot_size: float = 0.3
    bright: float = 0.2  # by which a highlight stands out, at least
    white: float = 0.35  # share of its light that is not white, at most
    # shading of a surface that faces the light: there it shows its own colour
    full: float = 1.2
    # of the differences of light, that must be explained for a light to be found
    least: float = 0.1
    # of the same, from which only rivals make the light unsure: prints and reflections stay unexplained
    enough: float = 0.2


TUNING = _Tuning()


@dataclass(frozen=True)
class PixelPairs:
    """Pixels compared: `change` (n,) of the logarithm of light from the second to the
    first of each pair.
    """

    change: F32
    first: F32  # (n, 3) normals
    second: F32
    weight: F32  # (n,)
    trust: float  # the sum of trust in the objects seen: 1 for a plain ball


@dataclass(frozen=True)
class LightEstimate:
    """A light and how well it explains the photo."""

    light: DistantLight  # its intensity and ambient sum to 1
    explained: float  # 0..1 of the differences of light
    spots: int  # highlights that agree
    trust: float
    # 0..1: the share of its explanation that the best light from elsewhere reaches
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
    reduced, ids, small_normals = reduce_photo_maps(rgb, labels, normals)
    balls = {t.id: isinstance(t.outline, Disc) for t in objects}
    pairs = pixel_pairs(decode(reduced), ids, balls, small_normals)
    found = fit_light(pairs, highlights(rgb, labels, objects))
    if found is None or (found.explained < TUNING.least and found.spots < 2):
        return LightGuess(FROM_ABOVE, 0.1)
    explained = min(1.0, (found.explained + 0.05 * found.spots) / TUNING.enough)
    known = min(1.0, found.trust + 0.2 * found.spots)
    sure = round(0.1 + 0.8 * explained * (known * (1 - found.rival)) ** 0.5, 2)
    total = found.light.intensity + found.light.ambient
    scaled = DistantLight(
        found.light.direction,
        TUNING.full * found.light.intensity / total,
        TUNING.full * found.light.ambient / total,
    )
    return LightGuess(scaled, sure)


def fit_light(
    pairs: PixelPairs | None, spots: F32 | None = None
) -> LightEstimate | None:
    """Return the best light for `pairs`, with `spots` (m, 3) the directions of
    highlights; None where nothing shows any.
    """
    spots = np.zeros((0, 3), np.float32) if spots is None else spots
    if pairs is None and len(spots) < 2:
        return None
    sky = _directions(TUNING.sky)
    cost = _cost(pairs, sky, spots)
    best = sky[np.unravel_index(int(cost.argmin()), cost.shape)[0]]
    around = best + 0.12 * _directions(160, whole=True)
    around = np.concatenate(
        [best[None], around / np.linalg.norm(around, axis=1, keepdims=True)]
    )
    around = around.astype(np.float32)
    fine = _cost(pairs, around, spots)
    low = np.unravel_index(int(fine.argmin()), fine.shape)
    direction, ratio = around[low[0]], float(AMBIENT[low[1]])
    agree = int((spots @ direction > np.cos(np.radians(2 * TUNING.spot_angle))).sum())
    explained = (
        0.0 if pairs is None else 1 - float(_misfit(pairs, direction[None])[0, low[1]])
    )
    elsewhere = cost[sky @ direction < np.cos(np.radians(TUNING.elsewhere))]
    worth = (
        max(1 - float(elsewhere.min()), 0) / max(1 - float(cost.min()), 1e-6)
        if elsewhere.size
        else 0.0
    )
    trust = 0.0 if pairs is None else pairs.trust
    return LightEstimate(
        _light(direction, ratio),
        max(explained, 0.0),
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
    """(m, ambients): the unexplained share, 1 for even light, and the prior cost of
    each direction.
    """
    cost = np.ones((len(sky), len(AMBIENT)), np.float32)
    if pairs is not None:
        share = min(1.0, 2 * pairs.trust)  # little shading is weak evidence
        cost += np.float32(share) * (_misfit(pairs, sky) - 1)
    cost += np.float32(TUNING.below) * np.maximum(sky[:, 1], -0.3)[:, None]
    if len(spots):
        off = np.degrees(np.arccos(np.clip(sky @ spots.T, -1, 1)))
        agree = np.exp(-0.5 * (off / TUNING.spot_angle) ** 2).sum(axis=1) / (
            len(spots) + 0.5
        )
        cost -= np.float32(TUNING.spot_gain) * agree[:, None].astype(np.float32)
    return cost


def _misfit(pairs: PixelPairs, sky: F32) -> F32:
    """(m, ambients): the mean error of the pairs' differences, over that of even light."""
    one, two = (np.maximum(part @ sky.T, 0) for part in (pairs.first, pairs.second))
    even = float((pairs.weight * np.minimum(np.abs(pairs.change), TUNING.most)).sum())
    found = np.empty((len(sky), len(AMBIENT)), np.float32)
    for k, ambient in enumerate(AMBIENT):
        predicted = np.log((one + ambient) / (two + ambient))
        found[:, k] = pairs.weight @ np.minimum(
            np.abs(predicted - pairs.change[:, None]), TUNING.most
        )
    return found / np.float32(max(even, 1e-9))


def _directions(count: int, whole: bool = False) -> F32:
    """(count, 3) directions, evenly (Fibonacci's spiral), all but those behind the
    scene unless `whole`.
    """
    k = np.arange(count) + 0.5
    z = 1 - k / count * (2.0 if whole else 1.05)
    angle = k * np.pi * (3 - 5**0.5)
    wide = np.sqrt(1 - z * z)
    return np.stack([wide * np.cos(angle), wide * np.sin(angle), z], -1).astype(
        np.float32
    )


def pixel_pairs(
    linear: F32, labels: Labels, balls: dict[int, bool], normals: F32
) -> PixelPairs | None:
    """Pairs in the objects of `balls`, True for spheres; drawn at random, the same each
    time.
    """
    random = np.random.default_rng(0)
    level = np.log(luminance(linear) + np.float32(2e-3))
    small = linear + np.float32(4e-3)
    chroma = np.log(
        np.stack([small[..., 0] / small[..., 1], small[..., 2] / small[..., 1]], -1)
    )
    full = linear.max(axis=2) < 0.98
    parts, trusts = [], 0.0
    each = max(60, TUNING.pairs // max(len(balls), 1))
    for i, ball in balls.items():
        inner: Mask = (
            cv2.erode((labels == i).astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
        )
        rows, columns = np.nonzero(inner)
        least = TUNING.ball_z if ball else TUNING.other_z
        keep = (normals[rows, columns, 2] > least) & full[rows, columns]
        rows, columns = rows[keep], columns[keep]
        if len(rows) < 40:
            continue
        z = float(normals[rows, columns, 2].mean())
        kind = "ball" if ball else "bulging" if z < TUNING.bulging else "flat"
        a, b = random.integers(0, len(rows), (2, 12 * each))
        n, m = normals[rows[a], columns[a]], normals[rows[b], columns[b]]
        same = (
            np.abs(chroma[rows[a], columns[a]] - chroma[rows[b], columns[b]]).max(
                axis=1
            )
            < TUNING.alike
        )
        good = np.flatnonzero(same & (np.linalg.norm(n - m, axis=1) > TUNING.turned))[
            :each
        ]
        if len(good) < 20:
            continue
        a, b = a[good], b[good]
        weight = (
            TRUST[kind]
            * min(1.0, len(good) / each)
            * min(1.0, (len(rows) / 600) ** 0.5)
        )
        trusts += weight
        change = level[rows[a], columns[a]] - level[rows[b], columns[b]]
        parts.append(
            (
                change,
                n[good],
                m[good],
                np.full(len(good), weight / len(good), np.float32),
            )
        )
    if not parts:
        return None
    change, first, second, weights = (
        np.concatenate(part) for part in zip(*parts, strict=True)
    )
    return PixelPairs(change, first, second, weights, trusts)


def highlights(rgb: Rgb, labels: Labels, objects: Sequence[PhotoObject]) -> F32:
    """(m, 3) directions of the lamp whose mirror images are the bright white spots on
    balls.

    The normal there lies halfway between viewer and lamp (Blinn 1977).
    """
    found = []
    for item in objects:
        if not isinstance(item.outline, Disc) or item.outline.radius < 8:
            continue
        x, y, r = (
            float(item.outline.center[0]),
            float(item.outline.center[1]),
            float(item.outline.radius),
        )
        x0, y0 = max(0, int(x - r)), max(0, int(y - r))
        part = decode(rgb[y0 : int(y + r) + 2, x0 : int(x + r) + 2])
        own = labels[y0 : int(y + r) + 2, x0 : int(x + r) + 2] == item.id
        spot = _white_spot(part, own, r)
        if spot is None:
            continue
        u, v = (spot[0] + x0 - x) / r, (spot[1] + y0 - y) / r
        if u * u + v * v > 0.6:  # beyond: a lamp behind the scene, or a rim's light
            continue
        z = (1 - u * u - v * v) ** 0.5
        found.append((2 * z * u, 2 * z * v, 2 * z * z - 1))
    return np.array(found, np.float32).reshape(-1, 3)


def _white_spot(part: F32, own: Mask, radius: float) -> tuple[float, float] | None:
    """(x, y) of the brightest white spot much smaller than the ball; None where there
    is none.
    """
    least = np.where(own, part.min(axis=2), 0).astype(np.float32)
    size = 2 * max(1, round(TUNING.spot_size * radius)) + 1
    kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (size, size))
    stands = least - cv2.morphologyEx(least, cv2.MORPH_OPEN, kernel)
    peak = float(stands.max())
    if peak < TUNING.bright:
        return None
    row, column = np.unravel_index(int(stands.argmax()), stands.shape)
    colour = part[row, column]
    if float(colour.max() - colour.min()) > TUNING.white * float(colour.max()):
        return None
    count, ids = cv2.connectedComponents((stands > 0.5 * peak).astype(np.uint8))
    blob = ids == ids[row, column]
    if blob.sum() > 0.06 * own.sum() or count > 6:
        return None
    rows, columns = np.nonzero(blob)
    weight = stands[blob]
    return float((columns * weight).sum() / weight.sum()), float(
        (rows * weight).sum() / weight.sum()
    )
