"""Where an object keeps light away: from the floor it stands over, from an upright wall behind, from a table.

Simple geometry under one distant light of some width and an even ambient one. A surface that gets the share d of its
light directly, of which v is blocked, and of whose sky the part a is hidden, keeps (1 - d v) (1 - (1 - d) a) of it.
Logarithms of such shares add up over objects.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import ceil, exp, floor, radians, tan

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.photometry import DistantLight

F32 = NDArray[np.float32]
Array = NDArray[np.float64]
Box = tuple[int, int, int, int]
"""First and last + 1 column and row: x0, y0, x1, y1."""

LEVELS = 8
"""Heights at which an object's silhouette is looked at."""
LOWEST = 0.2
"""Least sine of the light's height over a surface: lower lights throw shadows without end."""
FARTHEST = 0.98
"""Of the direct or the ambient light, no more is taken away."""


@dataclass(frozen=True)
class Setting:
    """What light falls on, beside the objects."""

    light: DistantLight
    softness: float
    """degrees: half the width of the light as the objects see it."""
    top: bool
    """Seen from above: a table behind everything."""
    tilt: float
    """Side view: px by which a floor's point appears higher for each px that it lies farther back."""
    backdrop: float
    """Side view: px from the plane of motion back to an upright wall; infinite without."""
    size: tuple[int, int]
    """Width and height of the photo, px."""

    def direct(self, normal: tuple[float, float, float]) -> float:
        """Share of a surface's light that is direct."""
        facing = sum(a * b for a, b in zip(self.light.direction, normal, strict=True))
        straight = self.light.intensity * max(facing, 0.0)
        return straight / max(straight + self.light.ambient, 1e-9)


@dataclass(frozen=True)
class Silhouette:
    """An object as it stands now."""

    coverage: F32
    """(h, w) in 0..1."""
    corner: tuple[int, int]
    """Photo column and row of its first pixel."""
    center: tuple[float, float]
    """px."""
    radius: float | None
    """px, of a sphere; None for all others."""
    thick: float
    """px that it reaches through the plane of motion (side view), or above the table (top view)."""
    floor: float | None
    """Side view: the row, px, at which the floor below it is; None where nothing lies below."""


def darkness(what: Silhouette, setting: Setting) -> tuple[Box, F32] | None:
    """Box of the photo and (h, w) -log of the light that is left there; None where it throws no shadow."""
    if setting.top:
        parts = [_on_table(what, setting)]
    else:
        parts = [_on_floor(what, setting), _on_wall(what, setting)]
    found = [part for part in parts if part is not None]
    if not found:
        return None
    if len(found) == 1:
        return found[0]
    x0, y0 = (min(part[0][k] for part in found) for k in (0, 1))
    x1, y1 = (max(part[0][k] for part in found) for k in (2, 3))
    total = np.zeros((y1 - y0, x1 - x0), np.float32)
    for (a, b, c, d), dark in found:
        total[b - y0 : d - y0, a - x0 : c - x0] += dark
    return (x0, y0, x1, y1), total


def _spread(setting: Setting, height: float, rise: float) -> float:
    """px, standard deviation of a shadow's edge that is thrown from so far along the light."""
    return 0.35 + 0.6 * tan(radians(min(setting.softness, 60.0))) * max(height, 0.0) / rise


def _clip(box: tuple[float, float, float, float], size: tuple[int, int]) -> Box | None:
    x0, y0 = max(floor(box[0]), 0), max(floor(box[1]), 0)
    x1, y1 = min(ceil(box[2]) + 1, size[0]), min(ceil(box[3]) + 1, size[1])
    return (x0, y0, x1, y1) if x1 > x0 and y1 > y0 else None


def _log(direct: float, blocked: F32, hidden: F32) -> F32:
    left = (1 - np.float32(direct * FARTHEST) * blocked) * (1 - np.float32((1 - direct) * FARTHEST) * hidden)
    return np.asarray(-np.log(left), np.float32)


def _on_table(what: Silhouette, setting: Setting) -> tuple[Box, F32] | None:
    lx, ly, lz = setting.light.direction
    rise = max(lz, LOWEST)
    ax, ay = -lx / rise, -ly / rise  # px of shadow for each px of height
    direct = setting.direct((0.0, 0.0, 1.0))
    if what.radius is not None:
        r, (cx, cy) = what.radius, what.center
        soft = _spread(setting, r, rise)
        reach = r / rise + 2.5 * soft + r
        box = _clip(
            (
                cx + min(0, ax * r) - reach,
                cy + min(0, ay * r) - reach,
                cx + max(0, ax * r) + reach,
                cy + max(0, ay * r) + reach,
            ),
            setting.size,
        )
        if box is None:
            return None
        x = (np.arange(box[0], box[2], dtype=np.float32) - np.float32(cx))[None, :]
        y = (np.arange(box[1], box[3], dtype=np.float32) - np.float32(cy))[:, None]
        # a point sees the light past the sphere by how far its ray to the light passes the centre
        px, py = x - np.float32(ax * r), y - np.float32(ay * r)
        along = px * np.float32(lx) + py * np.float32(ly)
        miss = np.sqrt(np.maximum(px * px + py * py - along * along, 0)) - np.float32(r)
        width = np.float32(max(0.35, soft * rise))
        blocked = 1 / (1 + np.exp(np.clip(miss / (0.6 * width), -30, 30)))
        # cosine-weighted solid angle of a sphere that lies on the table
        near = np.float32(r * r) / (x * x + y * y + np.float32(r * r))
        return box, _log(direct, blocked, near * np.sqrt(near) * _faded(x, y, 2.2 * r))
    h, w = what.coverage.shape
    t = what.thick
    most = _spread(setting, t, rise)
    pad = ceil(2.5 * most + 0.8 * t) + 1
    x0, y0 = what.corner
    box = _clip(
        (
            x0 - pad + min(0, ax * t),
            y0 - pad + min(0, ay * t),
            x0 + w + pad + max(0, ax * t),
            y0 + h + pad + max(0, ay * t),
        ),
        setting.size,
    )
    if box is None:
        return None
    blocked = np.zeros((box[3] - box[1], box[2] - box[0]), np.float32)
    for part in (0.0, 0.33, 0.67, 1.0):
        cast = _moved(what, box, ax * t * part, ay * t * part, _spread(setting, t * part, rise))
        np.maximum(blocked, cast, out=blocked)
    hidden = 0.9 * _moved(what, box, 0, 0, max(0.4, 0.35 * t))
    return box, _log(direct, blocked, hidden)


def _faded(x: F32, y: F32, reach: float) -> F32:
    """1 near the origin, 0 from `reach` on: an end to what thins out for ever."""
    return np.asarray(np.clip(1.5 - 1.5 * np.sqrt(x * x + y * y) / np.float32(reach), 0, 1), np.float32)


def _moved(what: Silhouette, box: Box, dx: float, dy: float, blur: float) -> F32:
    """The silhouette, moved and blurred, in a box of the photo."""
    size = (box[2] - box[0], box[3] - box[1])
    shift = np.array([[1.0, 0, what.corner[0] + dx - box[0]], [0, 1, what.corner[1] + dy - box[1]]])
    there = cv2.warpAffine(what.coverage, shift, size, flags=cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT)
    return blurred(np.asarray(there, np.float32), blur)


def blurred(picture: F32, sigma: float) -> F32:
    """Gaussian blur; a wide one on a coarser grid."""
    if sigma < 0.3:
        return picture
    step = int(sigma / 3)
    if step < 2 or min(picture.shape) < 4 * step:
        return np.asarray(
            cv2.GaussianBlur(picture, (0, 0), sigma, borderType=cv2.BORDER_CONSTANT), np.float32
        )
    h, w = picture.shape
    small = cv2.resize(picture, (ceil(w / step), ceil(h / step)), interpolation=cv2.INTER_AREA)
    small = cv2.GaussianBlur(small, (0, 0), sigma / step, borderType=cv2.BORDER_CONSTANT)
    return np.asarray(cv2.resize(small, (w, h), interpolation=cv2.INTER_LINEAR), np.float32)


def _on_floor(what: Silhouette, setting: Setting) -> tuple[Box, F32] | None:
    if what.floor is None:
        return None
    lx, ly, lz = setting.light.direction
    rise = max(-ly, LOWEST)
    ax, az = -lx / rise, -lz / rise  # px sideways and towards the viewer for each px of height
    direct = setting.direct((0.0, -1.0, 0.0))
    w = what.coverage.shape[1]
    x0, y0 = what.corner
    ground = what.floor
    rows = np.flatnonzero(what.coverage.max(axis=1) > 0.5)
    if not len(rows):
        return None
    top, bottom = y0 + rows[0], y0 + rows[-1] + 1
    low, high = max(ground - bottom, 0.0), max(ground - top, 1.0)
    if low > 4 * setting.size[1]:
        return None
    tilt = setting.tilt
    half = what.thick / 2
    most = _spread(setting, high, rise)
    size = max(high - low, w)
    near = 0.45 * min(size, 4 * what.thick) + low
    back, front = max(half - az * high, half) + 2 * most, half + near + 2 * most
    if az > 0:
        back, front = half + near + 2 * most, half + az * high + 2 * most
    behind = min(back, setting.backdrop)
    box = _clip(
        (
            x0 - near - 2 * most + min(0, ax * high),
            ground - tilt * max(behind, near) - 1,
            x0 + w + near + 2 * most + max(0, ax * high),
            ground + tilt * max(front, near) + 2,
        ),
        setting.size,
    )
    if box is None:
        return None
    xs = np.arange(box[0], box[2], dtype=np.float32)
    # px towards the viewer of each row of the floor
    z = ((np.arange(box[1], box[3], dtype=np.float32) - np.float32(ground)) / np.float32(max(tilt, 1e-3)))[
        :, None
    ]
    blocked = np.zeros((box[3] - box[1], box[2] - box[0]), np.float32)
    bands = np.array_split(rows, min(LEVELS, len(rows)))
    for band in bands:
        profile = what.coverage[band[0] : band[-1] + 1].max(axis=0)
        height = max(ground - (y0 + (band[0] + band[-1] + 1) / 2), 0.0)
        soft = _spread(setting, height, rise)
        line = np.interp(xs - ax * height, np.arange(x0 - 1, x0 + w + 1), np.pad(profile, 1)).astype(
            np.float32
        )
        line = blurred(line[None], max(soft, 0.6 * abs(ax) * len(band)))
        edge = np.float32(0.6 * max(soft, 0.5 * abs(az) * len(band), 0.6 / max(tilt, 1e-3)))
        middle = np.float32(az * height)
        away = (np.abs(z - middle) - np.float32(half)) / edge
        np.maximum(blocked, line / (1 + np.exp(np.clip(away, -30, 30))), out=blocked)
    base = what.coverage[bands[-1][0] : bands[-1][-1] + 1].max(axis=0)
    hidden = _sky(what, xs, z, base, low, size)
    if np.isfinite(setting.backdrop):
        upon = np.clip((z + np.float32(setting.backdrop)) * np.float32(tilt) + 0.5, 0, 1)
        blocked, hidden = blocked * upon, hidden * upon
    return box, _log(direct, blocked, hidden)


def _sky(what: Silhouette, xs: F32, z: F32, base: F32, low: float, size: float) -> F32:
    """(h, w) how much of the floor's sky the object hides."""
    if what.radius is not None:
        r = np.float32(what.radius)
        x = (xs - np.float32(what.center[0]))[None, :]
        height = np.float32(low) + r
        square = x * x + z * z + height * height
        return np.asarray(
            (r / np.sqrt(square)) ** 2 * height / np.sqrt(square) * _faded(x, z, 2.2 * float(height)),
            np.float32,
        )
    x0 = what.corner[0]
    columns = np.flatnonzero(base > 0.5)
    if not len(columns):
        return np.zeros((len(z), len(xs)), np.float32)
    left, right = x0 + columns[0] - 0.5, x0 + columns[-1] + 0.5
    beside = np.maximum(np.maximum(left - xs, xs - right), 0)[None, :]
    before = np.maximum(np.abs(z) - np.float32(what.thick / 2), 0)
    away = np.sqrt(beside * beside + before * before + np.float32(low * low))
    reach = 0.22 * min(size, 4 * what.thick) + 1
    # beside an upright side half the sky is hidden; under a thing that floats more and more of it comes back
    inside = ((beside <= 0) & (before <= 0)).astype(np.float32)
    return np.asarray(
        np.exp(-away / np.float32(reach)) * (0.5 + 0.45 * inside * np.float32(exp(-low / reach))), np.float32
    )


def _on_wall(what: Silhouette, setting: Setting) -> tuple[Box, F32] | None:
    lx, ly, lz = setting.light.direction
    if not np.isfinite(setting.backdrop) or lz < 0.05:
        return None
    away = setting.backdrop
    rise = max(lz, LOWEST)
    dx, dy = (
        -lx / rise * away,
        -ly / rise * away - setting.tilt * away,
    )  # what lies farther back appears higher
    soft = _spread(setting, away, rise)
    h, w = what.coverage.shape
    pad = ceil(2.5 * soft) + 1
    x0, y0 = what.corner
    box = _clip((x0 + dx - pad, y0 + dy - pad, x0 + w + dx + pad, y0 + h + dy + pad), setting.size)
    if box is None:
        return None
    blocked = _moved(what, box, dx, dy, soft)
    if what.floor is not None:  # the wall ends where the floor begins
        rows = np.arange(box[1], box[3], dtype=np.float32)[:, None]
        blocked = blocked * np.clip(what.floor - setting.tilt * away - rows + 0.5, 0, 1)
    direct = setting.direct((0.0, 0.0, 1.0))
    return box, _log(direct, np.asarray(blocked, np.float32), np.zeros_like(blocked))
