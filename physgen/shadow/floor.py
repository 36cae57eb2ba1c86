"""The shadow of a thing on the floor that it stands or flies over, seen from the side.

A point of the floor is dark where its ray to the light meets the thing: a ball, or a silhouette that reaches evenly
through the plane of motion. The higher it meets it, the softer.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import ceil

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.shadow.cast import LOWEST, Box, Setting, Silhouette, behind_ball, clipped, faded, kept, spread

F32 = NDArray[np.float32]

LEVELS = 10
"""Heights at which an object's silhouette is looked at."""
FINER = 2
"""Lines of the floor in a row of pixels: seen from the side, a row is deep."""
SUNK = 3.0
"""px by which a thing's picture may reach farther below its floor than its thickness tells."""
FAR = 1e4
"""px: a sky without anything in it."""
UNDER, BESIDE = 0.9, 0.4
"""Of the sky that a thing hides, what it does not give back by its own light: from under it, and beside it."""


@dataclass(frozen=True)
class Stand:
    """The floor below a thing, px."""

    row: float
    """Of the photo, where the plane of motion meets the floor."""
    foot: float
    """Row at which a thing that stands there ends: its near edge, lower than `row`."""
    half: float
    """How far the thing reaches to either side of the plane of motion."""
    low: float
    """Height of its lowest point over the floor."""
    high: float
    """And of its highest."""


def stand(what: Silhouette, tilt: float) -> Stand | None:
    """None where there is no floor, or nothing to be seen of the thing."""
    if what.floor is None:
        return None
    if what.radius is not None:
        low = max(what.floor - what.center[1] - what.radius, 0.0)
        return Stand(what.floor, what.floor, what.radius, low, low + 2 * what.radius)
    rows = what.rows
    if not len(rows):
        return None
    top, bottom = what.corner[1] + rows[0] - 0.5, what.corner[1] + rows[-1] + 0.5
    thick = min(what.thick, 1.13 * what.area**0.5)  # no deeper than a disc of its area
    # a floor may be drawn where the plane of motion meets it, or where things are seen to end
    sunk = min(max(bottom - what.floor, 0.0), tilt * thick / 2 + SUNK)
    half = max(thick / 2, sunk / tilt)
    foot = what.floor + sunk
    row = min(what.floor, foot - (tilt * half if bottom > foot - 1 else tilt * half / 2))
    return Stand(row, foot, half, max(foot - bottom, 0.0), max(foot - top, 1.0))


def on_floor(what: Silhouette, setting: Setting) -> tuple[Box, F32] | None:
    """Box of the photo and (h, w) -log of the light that is left; None where there is no floor below."""
    tilt = max(setting.tilt, 1e-3)
    at = stand(what, tilt)
    if at is None or at.low > 4 * setting.size[1]:
        return None
    ax, az, rise = _slopes(setting)
    x0, w = what.corner[0], what.coverage.shape[1]
    near = 0.45 * min(max(at.high - at.low, w), 4 * what.thick) + at.low
    wide, deep = 2 * spread(setting, at.high, rise, ax), 2 * spread(setting, at.high, rise, az)
    box = clipped(
        (
            x0 + min(ax * at.high - wide, -near),
            at.row - tilt * min(at.half + max(deep - az * at.high, near), setting.backdrop) - 1,
            x0 + w + max(ax * at.high + wide, near),
            at.row + tilt * (at.half + max(deep + az * at.high, near)) + 2,
        ),
        setting.size,
    )
    if box is None:
        return None
    xs = np.arange(box[0], box[2], dtype=np.float32)
    # px towards the viewer, of each row and of the lines of the floor that it holds
    z = (np.arange(box[1], box[3], dtype=np.float32)[:, None] - np.float32(at.row)) / np.float32(tilt)
    within = (np.arange(FINER, dtype=np.float32) - (FINER - 1) / 2) / np.float32(FINER * tilt)
    lines = np.asarray((z + within).reshape(-1, 1), np.float32)
    if what.radius is not None:
        right = (xs - np.float32(what.center[0]))[None]
        blocked = behind_ball(what.radius, setting, right, at.row - what.center[1], lines)
    else:
        blocked = _behind(what, setting, at, xs, lines)
    blocked = np.asarray(blocked.reshape(len(z), FINER, len(xs)).mean(axis=1), np.float32)
    hidden = _sky(what, at, xs, z)
    if np.isfinite(setting.backdrop):
        upon = np.clip((z + np.float32(setting.backdrop)) * np.float32(tilt) + np.float32(0.5), 0, 1)
        blocked, hidden = blocked * upon, hidden * upon
    return box, kept(setting.direct((0.0, -1.0, 0.0)), blocked, hidden)


def _slopes(setting: Setting) -> tuple[float, float, float]:
    """px sideways and towards the viewer by which a shadow moves for each px of height; sine of the light's height."""
    lx, ly, lz = setting.light.direction
    rise = max(-ly, LOWEST)
    return -lx / rise, -lz / rise, rise


def _behind(what: Silhouette, setting: Setting, at: Stand, xs: F32, z: F32) -> F32:
    """(h, w) how much of the light the thing hides from columns `xs` and depths `z` (h, 1) of the floor."""
    ax, az, rise = _slopes(setting)
    x0, y0 = what.corner
    rows = what.rows
    heights = np.maximum(at.foot - (y0 + rows), 0.0)
    # every row moves as far as its height throws it
    shear = np.array([[1.0, -ax, x0 + ax * (at.foot - y0) - float(xs[0])], [0, 1, 0]])
    there = cv2.warpAffine(what.coverage, shear, (len(xs), what.coverage.shape[0]), flags=cv2.INTER_LINEAR)
    # bands of rows, each with the heights that it spans, its shadow's softness and its place on the floor
    parts = min(LEVELS, len(rows))
    ends = np.cumsum(len(rows) // parts + (np.arange(parts) < len(rows) % parts))
    firsts, lasts = np.append(0, ends[:-1]), ends - 1
    upper, lower = heights[firsts] + 0.5, np.maximum(heights[lasts] - 0.5, 0.0)
    height = (upper + lower) / 2
    near = spread(setting, 0.0, rise)  # it grows evenly with the height
    soft, edge = (near + (spread(setting, 1.0, rise, slope) - near) * height for slope in (ax, az))
    profiles = np.maximum.reduceat(there[: rows[-1] + 1], rows[firsts], axis=0)
    lines = _softened(profiles, soft)
    away = np.abs(z.T - (az * height)[:, None].astype(np.float32))
    away -= (at.half + abs(az) * (upper - lower) / 2)[:, None].astype(np.float32)
    away /= 0.55 * edge[:, None].astype(np.float32)
    across = np.where(away < 5, 1 / (1 + np.exp(np.clip(away, -30, 30))), 0).astype(np.float32)
    return np.asarray((across[:, :, None] * lines[:, None]).max(axis=0, initial=0), np.float32)


def _softened(profiles: F32, sigma: NDArray[np.float64]) -> F32:
    """(n, w) rows, each blurred by its own Gaussian of `sigma` (n,) px; beyond their ends is nothing."""
    w = profiles.shape[1]
    size = cv2.getOptimalDFTSize(w + 2 * ceil(3 * float(sigma.max(initial=0.0))))
    waves = 2 * np.pi * np.fft.rfftfreq(size)
    there = np.fft.rfft(profiles, size, axis=1) * np.exp(-((waves * sigma[:, None]) ** 2) / 2)
    return np.asarray(np.maximum(np.fft.irfft(there, size, axis=1)[:, :w], 0), np.float32)


def _sky(what: Silhouette, at: Stand, xs: F32, z: F32) -> F32:
    """(h, w) how much of the floor's sky the thing hides."""
    if what.radius is not None:
        r, height = np.float32(what.radius), np.float32(at.low + what.radius)
        x = (xs - np.float32(what.center[0]))[None]
        apart = np.sqrt(x * x + z * z + height * height)
        return np.asarray((r / apart) ** 2 * height / apart * faded(x, z, 2.2 * float(height)), np.float32)
    left, lowest = what.lowest
    if not len(lowest):
        return np.zeros((len(z), len(xs)), np.float32)
    right = left + len(lowest)
    gap = np.maximum(at.foot - (what.corner[1] + lowest - 0.5), 0.5).astype(np.float32)
    gap[lowest == 0] = FAR
    # beside its feet an upright side hides half the sky
    feet = (what.corner[0] + left + np.flatnonzero(gap < gap.min() + 1 + 0.1 * (at.high - at.low))).astype(
        np.float32
    )
    after = np.searchsorted(feet, xs)
    to_left = np.abs(xs - feet[np.maximum(after - 1, 0)])
    to_right = np.abs(feet[np.minimum(after, len(feet) - 1)] - xs)
    beside = np.maximum(np.minimum(to_left, to_right) - np.float32(0.5), 0)[None]
    before = np.maximum(np.abs(z) - np.float32(at.half), 0)
    reach = np.float32(0.22 * min(max(at.high - at.low, right - left), 8 * at.half) + 1)
    away = np.sqrt(beside * beside + before * before + np.float32(at.low**2))
    hidden = np.float32(BESIDE) * np.exp(-away / reach)
    # under it a rectangle, so high over the floor, hides as much as its four sides say
    x0, x1 = np.float32(what.corner[0] + left - 0.5), np.float32(what.corner[0] + right - 0.5)
    gap = np.asarray(cv2.blur(gap[None], (5, 1))[0], np.float32)
    high = np.interp(xs, np.arange(right - left) + float(x0) + 0.5, gap).astype(np.float32)
    a, b = np.searchsorted(xs, (x0 - 2 * high[0], x1 + 2 * high[-1]))
    if b > a:
        x, c = xs[a:b], high[a:b]
        along = (x - x0) / np.hypot(x - x0, c) + (x1 - x) / np.hypot(x1 - x, c)
        front, back, c = np.float32(at.half) - z, np.float32(at.half) + z, c * c
        across = front / np.sqrt(front * front + c) + back / np.sqrt(back * back + c)
        np.maximum(hidden[:, a:b], np.float32(UNDER / 4) * along * across, out=hidden[:, a:b])
    return np.asarray(hidden, np.float32)
