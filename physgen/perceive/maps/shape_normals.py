"""Normals of simple solids from masks: balls, solids of revolution and cushions.

Each field is (h, w, 2) float32: x and y of the unit normal (+x right, +y down); z, towards the viewer, is the rest.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from physgen.geometry.circles import robust_circle
from physgen.geometry.polygon import Array
from physgen.perceive.inpaint.poisson import harmonic_fill
from physgen.perceive.roles import F32, Mask


@dataclass(frozen=True)
class _Limits:
    """What is taken for a part of a ball."""

    tries: int = 8  # halves of the border of a hidden ball through which a circle is laid
    arc: float = 0.55  # share of its border on one circle
    fit: float = 0.03  # of the radius, that the border may be off it
    within: float = 0.97  # share of the mask inside it


LIMITS = _Limits()


def ball_tilts(shape: tuple[int, int], center: tuple[float, float], radius: float) -> F32:
    """A sphere's normals; beyond its rim those of the rim."""
    x = (np.arange(shape[1], dtype=np.float32) - center[0])[None, :] / radius
    y = (np.arange(shape[0], dtype=np.float32) - center[1])[:, None] / radius
    field = np.stack(np.broadcast_arrays(x, y), -1)
    return np.asarray(field / np.maximum(np.linalg.norm(field, axis=2, keepdims=True), 1), np.float32)


def turned_tilts(own: Mask) -> F32:
    """`own` (h, w) as a solid of revolution with an upright axis, seen from far.

    Each row is a cut across it; radii are smoothed against ripples.
    """
    rows = np.flatnonzero(own.any(axis=1))
    left = own.argmax(axis=1)[rows].astype(np.float32)
    right = own.shape[1] - 1 - own[:, ::-1].argmax(axis=1)[rows].astype(np.float32)
    every = np.arange(own.shape[0])
    middle, half = (
        np.interp(every, rows, part).astype(np.float32)
        for part in ((left + right) / 2, (right - left + 1) / 2)
    )
    flare = np.zeros(1, np.float32)
    if len(half) > 1:
        sigma = max(1.0, 0.02 * own.shape[0])
        soft = cv2.GaussianBlur(
            half[:, None], (1, 0), sigmaX=0.01, sigmaY=sigma, borderType=cv2.BORDER_REPLICATE
        )
        flare = np.gradient(np.asarray(soft[:, 0], np.float32)).astype(np.float32)
    offset = np.arange(own.shape[1], dtype=np.float32)[None, :] - middle[:, None]
    across = offset / np.maximum(half[:, None], 1)
    slope = np.broadcast_to(flare[:, None], across.shape)
    return np.asarray(
        np.stack([np.clip(across, -1, 1), -slope], -1) / np.sqrt(1 + slope[..., None] ** 2), np.float32
    )


def cushion_tilts(own: Mask) -> F32:
    """`own` (h, w) inflated like a cushion: an upright rim all around, and a sphere where it is a disc.

    Height is the root of the solution of Poisson's equation with 0 at the border (Johnston 2002, Lumo; Sykora et al.
    2014): an ellipse becomes an ellipsoid.
    """
    h, w = own.shape
    # with the squared distance from the centre added, the solution of Poisson's equation is harmonic
    y, x = np.mgrid[-1 : h + 1, -1 : w + 1].astype(np.float32)
    bowl = ((x - w / 2) ** 2 + (y - h / 2) ** 2)[..., None]
    height = (harmonic_fill(bowl, np.pad(own, 1), 0.1) - bowl)[..., 0]
    gy, gx = np.gradient(height)
    maps = np.stack([-gx / 2, -gy / 2, np.sqrt(np.maximum(height, 0))], -1)[1:-1, 1:-1]
    length = np.maximum(np.linalg.norm(maps, axis=2, keepdims=True), 1e-6)
    return np.asarray((maps / length)[..., :2], np.float32)


def without_thin_parts(own: Mask, radius: int) -> Mask:
    """`own` without parts thinner than 2 `radius` px (threads, handles); all of it where that leaves little."""
    if radius < 1:
        return own
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * radius + 1, 2 * radius + 1))
    body = cv2.morphologyEx(np.pad(own, radius).astype(np.uint8), cv2.MORPH_OPEN, disc)
    body = body[radius:-radius, radius:-radius]
    count, ids, stats, _ = cv2.connectedComponentsWithStats(body, connectivity=8)
    if count < 2:
        return own
    return np.asarray(ids == 1 + int(stats[1:, cv2.CC_STAT_AREA].argmax()))


def hidden_ball(body: Mask) -> tuple[tuple[float, float], float] | None:
    """Centre and radius px of the ball that `body` (h, w) is a part of; None where its border is no circle's."""
    contours = cv2.findContours(np.pad(body, 1).astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)[0]
    border = max(contours, key=len)[:, 0].astype(np.float64) - 1
    if len(border) < 24:
        return None
    half = np.arange(len(border) // 2)
    stretches = [(half + k * len(border) // LIMITS.tries) % len(border) for k in range(LIMITS.tries)]
    tries = [robust_circle(border[stretch]) for stretch in stretches]
    best = max(tries, key=lambda circle: np.count_nonzero(_on_circle(border, circle)))
    circle = robust_circle(border[_on_circle(border, best)])
    x, y, radius = circle.tolist()
    rows, columns = np.nonzero(body)
    within = np.hypot(columns - x, rows - y) <= radius + 1.5
    if _on_circle(border, circle).mean() < LIMITS.arc or within.mean() < LIMITS.within:
        return None
    return (x, y), radius + 0.5  # the border's pixels lie half a pixel within the outline


def _on_circle(border: Array, circle: Array) -> Mask:
    """(n,) whether points of the border lie on a circle: x, y, radius."""
    off = np.abs(np.hypot(border[:, 0] - circle[0], border[:, 1] - circle[1]) - circle[2])
    return np.asarray(off <= max(0.8, LIMITS.fit * circle[2]))
