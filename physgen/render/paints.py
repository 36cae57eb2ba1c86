"""A painted ball's pixels -> how its shading departs from Lambert's law: light from floor and walls, its dark foot.

A ball wears few paints. With each pixel's paint known, what else changes evenly over the ball is light; with light
known, paints tell apart. Both are found in turn, in logarithms, where light and paint add up.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

F32 = NDArray[np.float32]
Array = NDArray[np.float64]
Ids = NDArray[np.int64]

PAINTS = 5
"""At most, on one ball."""
DIM = 0.03
"""Linear light below which colours hardly tell paints apart."""
MOST_PIXELS = 500
"""Of a ball, that are asked."""
ROUNDS = 4
STIFF = 0.02
"""Weight, in shares of the ball's pixels, that keeps shading near Lambert's."""
ODD = 0.15
"""Departure in log light from which a pixel counts less: a highlight, a seam, a mixed pixel."""
SAME = 0.25
"""Distance in log light up to which two paints are one."""
UNDECIDED = 0.4
"""Of the distance to the second nearest paint, beyond which a pixel is hardly nearer to the first."""
MOST = 1.0
"""Of the departure from Lambert, in log light."""


def basis(u: F32, v: F32, z: F32) -> list[F32]:
    """Real harmonics of first and second degree on the unit sphere, unnormalised: 8 pictures."""
    return [u, v, z - np.float32(0.5), u * v, u * z, v * z, u * u - v * v, 3 * z * z - 1]


@dataclass(frozen=True)
class Paints:
    """What a ball wears, and in what light."""

    even: F32
    """(8, 3) weights of `basis`: log of what each channel's light does beyond Lambert's law."""
    colours: F32
    """(K, 3) linear, in full light."""
    between: float
    """Share of pixels that are hardly nearer to one paint than to another: few on a painted ball."""


def paints(bare: F32, u: F32, v: F32, z: F32, use: NDArray[np.bool_]) -> Paints | None:
    """`bare` (h, w, 3) is light over Lambert's shading of the normals (u, v, z), told by the pixels in `use`."""
    told = np.flatnonzero(use)
    if len(told) < 80:
        return None
    told = told[:: -(-len(told) // MOST_PIXELS)]
    level: Array = np.log(np.maximum(bare.reshape(-1, 3)[told], 0) + np.float32(DIM)).astype(np.float64)
    pictures = [np.broadcast_to(b, use.shape).ravel()[told] for b in basis(u, v, z)]
    rows: Array = np.column_stack(pictures).astype(np.float64)
    grey = level.mean(axis=1)
    # first paints by colour above all, of which light changes little
    paint = _split(np.column_stack([2 * (level - grey[:, None]), 0.7 * grey]))
    even, trust = np.zeros(8), np.ones(len(grey))
    for _ in range(ROUNDS):
        left = grey - rows @ even
        trust = 1 / np.maximum(np.abs(left - _each(np.median, left, paint)[paint]) / ODD, 1)
        even = _solved(rows, grey, paint, trust)
        bare_now = level - (rows @ even)[:, None]
        paint = _nearest(bare_now, _apart(_each(np.median, bare_now, paint)))
    # then each channel's own light, with the paints as they are: what stands near lends its colour
    each = even[:, None] + _solved(rows, level - (rows @ even)[:, None], paint, trust)
    left = level - rows @ each
    colours = _each(np.median, left, paint)
    away = np.sort([np.sqrt(((left - c) ** 2).sum(axis=1)) for c in colours], axis=0)
    between = float((away[0] > UNDECIDED * away[1]).mean()) if len(colours) > 1 else 0.0
    return Paints(each.astype(np.float32), np.maximum(np.exp(colours) - DIM, 0).astype(np.float32), between)


def _solved(rows: Array, level: Array, paint: Ids, trust: Array) -> Array:
    """(8, ...) weights of `rows` (n, 8) that explain `level` (n, ...) within each paint, by weighted least squares.

    What is even over one paint tells nothing of light: each paint's own mean is left out.
    """
    a, b, w = rows.copy(), level.copy(), trust[:, None]
    for k in range(paint.max() + 1):
        mine = paint == k
        a[mine] -= np.average(a[mine], axis=0, weights=trust[mine])
        b[mine] -= np.average(b[mine], axis=0, weights=trust[mine])
    normal = (a * w).T @ a + STIFF * len(rows) * np.eye(rows.shape[1])
    return np.asarray(np.linalg.solve(normal, (a * w).T @ b))


def _each(of: Callable[..., Any], points: Array, paint: Ids) -> Array:
    """(K, ...) a mean or median of the points of each paint."""
    return np.array([of(points[paint == k], axis=0) for k in range(paint.max() + 1)])


def _split(points: Array) -> Ids:
    """Paint of each point: the farthest from those chosen makes the next one, then means (Lloyd)."""
    middles = [np.median(points, axis=0)]
    for _ in range(PAINTS - 1):
        away = np.min([((points - m) ** 2).sum(axis=1) for m in middles], axis=0)
        far = np.argsort(away)[int(0.97 * len(away))]
        if away[far] < 0.3**2:
            break
        middles.append(points[far])
    centers = np.array(middles)
    paint = _nearest(points, centers)
    for _ in range(4):
        paint = _nearest(points, _each(np.mean, points, paint))
    return paint


def _apart(centers: Array) -> Array:
    """Centres of which none is another one over again."""
    kept: list[Array] = []
    for center in centers:
        if all(np.linalg.norm(center - other) > SAME for other in kept):
            kept.append(center)
    return np.array(kept)


def _nearest(points: Array, centers: Array) -> Ids:
    """Number of the nearest centre; of those that nobody is near, none is kept."""
    away = np.stack([((points - c) ** 2).sum(axis=1) for c in centers])
    return np.unique(np.argmin(away, axis=0), return_inverse=True)[1].astype(np.int64).ravel()
