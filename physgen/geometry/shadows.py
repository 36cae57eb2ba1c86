"""Cast shadows of a silhouette on a floor, an upright wall or a table, under one distant light of some width.

A surface that gets the share d of its light directly, of which v is blocked, and of whose sky the part a is hidden,
keeps 1 - d v - (1 - d) a of it. Negative logarithms of such shares ("darkness") add up over objects. A point of
a floor is dark where its ray to the light meets the object: a ball, or a silhouette that reaches evenly through the
plane of motion; the higher it meets it, the softer the shadow.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from math import ceil, floor, hypot, inf, radians, tan

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.photometry import DistantLight

F32 = NDArray[np.float32]
PixelBox = tuple[
    int, int, int, int
]  # first and last + 1 column and row: x0, y0, x1, y1

LEAST_LIGHT_HEIGHT = 0.2
"""Least sine of the light's height over a surface: lower lights throw shadows without end."""
MOST_BLOCKED = 0.98  # of the direct or the ambient light, no more is taken away


@dataclass(frozen=True)
class ShadowModel:
    """Resolution and limits of cast shadows."""

    sky: float = (
        0.5  # by how much more ambient light falls on what faces up: skies are brighter
    )
    levels: int = 10  # heights at which an object's silhouette is looked at
    finer: int = (
        2  # lines of the floor in a row of pixels: seen from the side, a row is deep
    )
    wall: int = 4  # columns of a wall beside in a column of pixels: it goes back, and is foreshortened
    sunk: float = 3.0
    """px by which an object's picture may reach farther below its floor than its thickness implies."""
    far: float = 1e4  # px: a sky without anything in it
    under: float = 0.9
    beside: float = 0.4
    """Of the sky that an object hides, what it does not give back by its own light: from under it, and beside it."""


MODEL = ShadowModel()


@dataclass(frozen=True)
class ShadowSetting:
    """What light falls on, beside the objects."""

    light: DistantLight
    softness: float  # degrees: half the width of the light as the objects see it
    top: bool  # seen from above: a table behind everything
    tilt: float  # side view: px by which a floor's point appears higher for each px that it lies farther back
    backdrop: float  # side view: px from the plane of motion back to an upright wall; infinite without
    size: tuple[int, int]  # width and height of the photo, px
    lacking: float = 1.0  # share of the direct light that shadows lack: some comes back from other surfaces

    def direct(self, normal: tuple[float, float, float]) -> float:
        """Share of a surface's light that is direct."""
        facing = sum(a * b for a, b in zip(self.light.direction, normal, strict=True))
        straight = self.light.intensity * max(facing, 0.0)
        around = self.light.ambient * (
            1 if self.top else 1 + MODEL.sky * max(-normal[1], 0.0)
        )
        return min(self.lacking * straight / max(straight + around, 1e-9), 1.0)

    def distance(self, row: float) -> float:
        """px of a camera, which is taken to look level at the picture's middle, over a floor whose line is at `row`.

        No camera sees more than as wide as it is far.
        """
        return float(max((row - self.size[1] / 2) / max(self.tilt, 1e-3), self.size[0]))

    @cached_property
    def shade(self) -> np.float32:
        """-log of the light left where none comes straight, at most."""
        faces = ((0.0, 0.0, 1.0),) if self.top else ((0.0, 0.0, 1.0), (0.0, -1.0, 0.0))
        return np.float32(-np.log(1 - MOST_BLOCKED * max(map(self.direct, faces))))


@dataclass(frozen=True)
class Silhouette:
    """An object as it stands now."""

    coverage: F32  # (h, w) in 0..1.
    corner: tuple[int, int]  # photo column and row of its first pixel
    center: tuple[float, float]  # px
    radius: float | None  # px, of a sphere; None for all others
    thick: float  # px that it reaches through the plane of motion (side view), or above the table (top view)
    floor: float | None
    """Side view: the row, px, at which the floor below it is; None where nothing lies below."""
    ends: tuple[float, float] = (
        -inf,
        inf,
    )  # the columns, px, between which that floor goes on
    walls: tuple[bool, bool] = (
        False,
        False,
    )  # whether one stands at either end of that floor, and goes back
    id: int = 0  # of the object in the label map; 0 where it is not needed, or where it is several

    @cached_property
    def rows(self) -> NDArray[np.intp]:
        """Rows of `coverage` that show it."""
        return np.flatnonzero(self.coverage.max(axis=1) > 0.5)

    @cached_property
    def lowest(self) -> tuple[int, NDArray[np.intp]]:
        """The first column of `coverage` that shows it, and of each to the last the row below its lowest pixel.

        0 in a column between that shows nothing; no columns at all where none shows anything.
        """
        solid = self.coverage > 0.5
        columns = np.flatnonzero(solid.any(axis=0))
        if not len(columns):
            return 0, columns
        solid = solid[:, columns[0] : columns[-1] + 1]
        rows = solid.shape[0] - np.argmax(solid[::-1], axis=0)
        return int(columns[0]), np.where(solid.any(axis=0), rows, 0)

    @cached_property
    def area(self) -> float:
        """px²."""
        return float(self.coverage.sum())


def penumbra_width(
    setting: ShadowSetting, height: float, rise: float, slope: float = 0.66
) -> float:
    """px, standard deviation of a shadow's edge that is thrown from so far away; `slope` px sideways for each px."""
    far = tan(radians(min(setting.softness, 60.0))) * max(height, 0.0) / rise
    return float(0.35 + 0.5 * far * (1 + slope * slope) ** 0.5)


def clipped_box(
    box: tuple[float, float, float, float], size: tuple[int, int]
) -> PixelBox | None:
    """Whole pixels of a photo of `size` (w, h) that a box touches; None where it lies outside."""
    x0, y0 = max(floor(box[0]), 0), max(floor(box[1]), 0)
    x1, y1 = min(ceil(box[2]) + 1, size[0]), min(ceil(box[3]) + 1, size[1])
    return (x0, y0, x1, y1) if x1 > x0 and y1 > y0 else None


def attenuation(direct: float, blocked: F32, hidden: F32) -> F32:
    """-log of the light that is left where so much of direct and ambient light is taken away."""
    left = 1 - np.float32(MOST_BLOCKED) * (
        np.float32(direct) * blocked + np.float32(1 - direct) * hidden
    )
    return np.asarray(-np.log(left), np.float32)


def faded_out(x: F32, y: F32, reach: float) -> F32:
    """1 near the origin, 0 from `reach` on: an end to what thins out for ever."""
    return np.asarray(
        np.clip(1.5 - 1.5 * np.sqrt(x * x + y * y) / np.float32(reach), 0, 1),
        np.float32,
    )


def moved_silhouette(
    what: Silhouette, box: PixelBox, dx: float, dy: float, blur: float
) -> F32:
    """The silhouette, moved and blurred, in a box of the photo."""
    size = (box[2] - box[0], box[3] - box[1])
    shift = np.array(
        [[1.0, 0, what.corner[0] + dx - box[0]], [0, 1, what.corner[1] + dy - box[1]]]
    )
    there = cv2.warpAffine(
        what.coverage,
        shift,
        size,
        flags=cv2.INTER_LINEAR,
        borderMode=cv2.BORDER_CONSTANT,
    )
    return blurred(np.asarray(there, np.float32), blur)


def blurred(picture: F32, sigma: float) -> F32:
    """Return a Gaussian blur; a wide one is computed on a grid of at least 4 by 4 cells."""
    if sigma < 0.3:
        return picture
    step = min(int(sigma / 3), min(picture.shape) // 4)
    if step < 2:
        return np.asarray(
            cv2.GaussianBlur(picture, (0, 0), sigma, borderType=cv2.BORDER_CONSTANT),
            np.float32,
        )
    h, w = picture.shape
    small = cv2.resize(
        picture, (ceil(w / step), ceil(h / step)), interpolation=cv2.INTER_AREA
    )
    small = cv2.GaussianBlur(
        small, (0, 0), sigma / step, borderType=cv2.BORDER_CONSTANT
    )
    return np.asarray(
        cv2.resize(small, (w, h), interpolation=cv2.INTER_LINEAR), np.float32
    )


def blocked_by_ball(
    radius: float,
    setting: ShadowSetting,
    x: F32 | np.float32,
    y: F32 | float,
    z: F32 | float,
) -> F32:
    """How much of the light a ball hides from points that lie so far (px) right of, below and before its centre."""
    lx, ly, lz = setting.light.direction
    along = np.asarray(
        -(x * np.float32(lx) + y * np.float32(ly) + z * np.float32(lz)), np.float32
    )
    apart = np.sqrt(np.maximum(x * x + y * y + z * z - along * along, 0))
    # of two discs, the ball's and the light's as it shines past there
    disc = np.maximum(
        np.float32(tan(radians(min(setting.softness, 60.0)))) * along, np.float32(0.35)
    )
    small = np.minimum(np.float32(radius), disc)
    away = (apart - np.maximum(np.float32(radius), disc)) / (0.28 * small)
    return np.asarray(
        (small / disc) ** 2 / (1 + np.exp(np.clip(away, -30, 30))) * (along > 0),
        np.float32,
    )


@dataclass(frozen=True)
class FloorContact:
    """The floor below an object, px."""

    row: float  # of the photo, where the plane of motion meets the floor
    foot: float  # row at which an object that stands there ends: its near edge, lower than `row`
    half: float  # how far the object reaches to either side of the plane of motion
    low: float  # height of its lowest point over the floor
    high: float  # and of its highest


def floor_contact(what: Silhouette, tilt: float) -> FloorContact | None:
    """None where there is no floor, or nothing to be seen of the object."""
    if what.floor is None:
        return None
    if what.radius is not None:
        low = max(what.floor - what.center[1] - what.radius, 0.0)
        return FloorContact(
            what.floor, what.floor, what.radius, low, low + 2 * what.radius
        )
    rows = what.rows
    if not len(rows):
        return None
    top, bottom = what.corner[1] + rows[0] - 0.5, what.corner[1] + rows[-1] + 0.5
    thick = min(what.thick, 1.13 * what.area**0.5)  # no deeper than a disc of its area
    # a floor may be drawn where the plane of motion meets it, or where objects are seen to end
    sunk = min(max(bottom - what.floor, 0.0), tilt * thick / 2 + MODEL.sunk)
    half = max(thick / 2, sunk / tilt)
    foot = what.floor + sunk
    row = min(
        what.floor, foot - (tilt * half if bottom > foot - 1 else tilt * half / 2)
    )
    return FloorContact(row, foot, half, max(foot - bottom, 0.0), max(foot - top, 1.0))


def shadow_on_floor(
    what: Silhouette, setting: ShadowSetting
) -> tuple[PixelBox, F32] | None:
    """Box of the photo and (h, w) -log of the light that is left; None where there is no floor below."""
    tilt = max(setting.tilt, 1e-3)
    at = floor_contact(what, tilt)
    if at is None or at.low > 4 * setting.size[1]:
        return None
    ax, az, rise = _slopes(setting)
    x0, w = what.corner[0], what.coverage.shape[1]
    near = 0.45 * min(max(at.high - at.low, w), 4 * what.thick) + at.low
    wide = 2 * penumbra_width(setting, at.high, rise, ax)
    deep = 2 * penumbra_width(setting, at.high, rise, az)
    box = clipped_box(
        (
            x0 + min(ax * at.high - wide, -near),
            at.row
            - tilt * min(at.half + max(deep - az * at.high, near), setting.backdrop)
            - 1,
            x0 + w + max(ax * at.high + wide, near),
            at.row + tilt * (at.half + max(deep + az * at.high, near)) + 2,
        ),
        setting.size,
    )
    if box is None:
        return None
    xs = np.arange(box[0], box[2], dtype=np.float32)
    # px towards the viewer, of each row and of the lines of the floor that it holds
    z = (
        np.arange(box[1], box[3], dtype=np.float32)[:, None] - np.float32(at.row)
    ) / np.float32(tilt)
    within = (
        np.arange(MODEL.finer, dtype=np.float32) - (MODEL.finer - 1) / 2
    ) / np.float32(MODEL.finer * tilt)
    lines = np.asarray((z + within).reshape(-1, 1), np.float32)
    if what.radius is not None:
        right = (xs - np.float32(what.center[0]))[None]
        blocked = blocked_by_ball(
            what.radius, setting, right, at.row - what.center[1], lines
        )
    else:
        blocked = _behind(what, setting, at, xs, lines)
    blocked = np.asarray(
        blocked.reshape(len(z), MODEL.finer, len(xs)).mean(axis=1), np.float32
    )
    upon = floor_share(what.ends, setting, box, at.row)
    if np.isfinite(setting.backdrop):
        upon = upon * np.clip(
            (z + np.float32(setting.backdrop)) * np.float32(tilt) + np.float32(0.5),
            0,
            1,
        )
    hidden = _sky(what, at, xs, z) * upon
    return box, attenuation(setting.direct((0.0, -1.0, 0.0)), blocked * upon, hidden)


def floor_share(
    ends: tuple[float, float], setting: ShadowSetting, box: PixelBox, row: float
) -> F32:
    """(h, w) 0..1: how much of a box's pixels is a floor, whose line at `row` px goes on between the columns `ends`.

    What lies farther back is seen nearer to the middle of the picture.
    """
    middle, tilt, distance = (
        setting.size[0] / 2,
        max(setting.tilt, 1e-3),
        setting.distance(row),
    )
    x = np.arange(box[0], box[2], dtype=np.float32)
    back = (
        np.float32(row) - np.arange(box[1], box[3], dtype=np.float32)[:, None]
    ) / np.float32(tilt)
    scale = np.float32(distance) / np.maximum(distance + back, 1)
    left, right = (
        np.float32(middle) + np.float32(end - middle) * scale for end in ends
    )
    return np.asarray(np.clip(np.minimum(x - left, right - x) + 0.5, 0, 1), np.float32)


def _slopes(setting: ShadowSetting) -> tuple[float, float, float]:
    """px sideways and towards the viewer by which a shadow moves for each px of height; sine of the light's height."""
    lx, ly, lz = setting.light.direction
    rise = max(-ly, LEAST_LIGHT_HEIGHT)
    return -lx / rise, -lz / rise, rise


def _behind(
    what: Silhouette, setting: ShadowSetting, at: FloorContact, xs: F32, z: F32
) -> F32:
    """(h, w) how much of the light the object hides from columns `xs` and depths `z` (h, 1) of the floor."""
    ax, az, rise = _slopes(setting)
    x0, y0 = what.corner
    rows = what.rows
    heights = np.maximum(at.foot - (y0 + rows), 0.0)
    # every row moves as far as its height throws it
    shear = np.array([[1.0, -ax, x0 + ax * (at.foot - y0) - float(xs[0])], [0, 1, 0]])
    there = cv2.warpAffine(
        what.coverage, shear, (len(xs), what.coverage.shape[0]), flags=cv2.INTER_LINEAR
    )
    # bands of rows, each with the heights that it spans, its shadow's softness and its place on the floor
    parts = min(MODEL.levels, len(rows))
    ends = np.cumsum(len(rows) // parts + (np.arange(parts) < len(rows) % parts))
    firsts, lasts = np.append(0, ends[:-1]), ends - 1
    upper, lower = heights[firsts] + 0.5, np.maximum(heights[lasts] - 0.5, 0.0)
    height = (upper + lower) / 2
    near = penumbra_width(setting, 0.0, rise)  # it grows evenly with the height
    soft, edge = (
        near + (penumbra_width(setting, 1.0, rise, slope) - near) * height
        for slope in (ax, az)
    )
    profiles = np.maximum.reduceat(there[: rows[-1] + 1], rows[firsts], axis=0)
    lines = _softened(profiles, soft)
    away = np.abs(z.T - (az * height)[:, None].astype(np.float32))
    away -= (at.half + abs(az) * (upper - lower) / 2)[:, None].astype(np.float32)
    away /= 0.55 * edge[:, None].astype(np.float32)
    across = np.where(away < 5, 1 / (1 + np.exp(np.clip(away, -30, 30))), 0).astype(
        np.float32
    )
    return np.asarray(
        (across[:, :, None] * lines[:, None]).max(axis=0, initial=0), np.float32
    )


def _softened(profiles: F32, sigma: NDArray[np.float64]) -> F32:
    """(n, w) rows, each blurred by its own Gaussian of `sigma` (n,) px; beyond their ends is nothing."""
    w = profiles.shape[1]
    size = cv2.getOptimalDFTSize(w + 2 * ceil(3 * float(sigma.max(initial=0.0))))
    waves = 2 * np.pi * np.fft.rfftfreq(size)
    there = np.fft.rfft(profiles, size, axis=1) * np.exp(
        -((waves * sigma[:, None]) ** 2) / 2
    )
    return np.asarray(
        np.maximum(np.fft.irfft(there, size, axis=1)[:, :w], 0), np.float32
    )


def _sky(what: Silhouette, at: FloorContact, xs: F32, z: F32) -> F32:
    """(h, w) how much of the floor's sky the object hides."""
    if what.radius is not None:
        r, height = np.float32(what.radius), np.float32(at.low + what.radius)
        x = (xs - np.float32(what.center[0]))[None]
        apart = np.sqrt(x * x + z * z + height * height)
        return np.asarray(
            (r / apart) ** 2 * height / apart * faded_out(x, z, 2.2 * float(height)),
            np.float32,
        )
    left, lowest = what.lowest
    if not len(lowest):
        return np.zeros((len(z), len(xs)), np.float32)
    right = left + len(lowest)
    gap = np.maximum(at.foot - (what.corner[1] + lowest - 0.5), 0.5).astype(np.float32)
    gap[lowest == 0] = MODEL.far
    # beside its feet an upright side hides half the sky
    feet = (
        what.corner[0]
        + left
        + np.flatnonzero(gap < gap.min() + 1 + 0.1 * (at.high - at.low))
    ).astype(np.float32)
    after = np.searchsorted(feet, xs)
    to_left = np.abs(xs - feet[np.maximum(after - 1, 0)])
    to_right = np.abs(feet[np.minimum(after, len(feet) - 1)] - xs)
    beside = np.maximum(np.minimum(to_left, to_right) - np.float32(0.5), 0)[None]
    before = np.maximum(np.abs(z) - np.float32(at.half), 0)
    reach = np.float32(0.22 * min(max(at.high - at.low, right - left), 8 * at.half) + 1)
    away = np.sqrt(beside * beside + before * before + np.float32(at.low**2))
    hidden = np.float32(MODEL.beside) * np.exp(-away / reach)
    # under it a rectangle, so high over the floor, hides as much as its four sides say
    x0, x1 = (
        np.float32(what.corner[0] + left - 0.5),
        np.float32(what.corner[0] + right - 0.5),
    )
    gap = np.asarray(cv2.blur(gap[None], (5, 1))[0], np.float32)
    high = np.interp(xs, np.arange(right - left) + float(x0) + 0.5, gap).astype(
        np.float32
    )
    a, b = np.searchsorted(xs, (x0 - 2 * high[0], x1 + 2 * high[-1]))
    if b > a:
        x, c = xs[a:b], high[a:b]
        along = (x - x0) / np.hypot(x - x0, c) + (x1 - x) / np.hypot(x1 - x, c)
        front, back, c = np.float32(at.half) - z, np.float32(at.half) + z, c * c
        across = front / np.sqrt(front * front + c) + back / np.sqrt(back * back + c)
        np.maximum(
            hidden[:, a:b],
            np.float32(MODEL.under / 4) * along * across,
            out=hidden[:, a:b],
        )
    return np.asarray(hidden, np.float32)


def shadow_on_table(
    what: Silhouette, setting: ShadowSetting
) -> tuple[PixelBox, F32] | None:
    """Box of the photo and (h, w) -log of the light that is left; None where it lies outside the photo.

    Of the sky that an object hides beside its shadow, less is missed in the shadow: table and object light each other.
    """
    lx, ly, lz = setting.light.direction
    rise = max(lz, LEAST_LIGHT_HEIGHT)
    ax, ay = -lx / rise, -ly / rise  # px of shadow for each px of height
    direct = setting.direct((0.0, 0.0, 1.0))
    if what.radius is not None:
        r, (cx, cy) = what.radius, what.center
        soft = penumbra_width(setting, r, rise)
        reach = r / rise + 2.5 * soft + r
        box = clipped_box(
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
        blocked = blocked_by_ball(r, setting, x, y, -r)
        # cosine-weighted solid angle of a sphere that lies on the table
        near = np.float32(r * r) / (x * x + y * y + np.float32(r * r))
        hidden = near * np.sqrt(near) * faded_out(x, y, 2.2 * r)
        return box, attenuation(
            direct, blocked, hidden * (1 - np.float32(direct) * blocked)
        )
    h, w = what.coverage.shape
    t = what.thick
    most = penumbra_width(setting, t, rise)
    pad = ceil(2.5 * most + 0.8 * t) + 1
    x0, y0 = what.corner
    box = clipped_box(
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
        cast = moved_silhouette(
            what,
            box,
            ax * t * part,
            ay * t * part,
            penumbra_width(setting, t * part, rise),
        )
        np.maximum(blocked, cast, out=blocked)
    hidden = 0.9 * moved_silhouette(what, box, 0, 0, max(0.4, 0.35 * t))
    return box, attenuation(
        direct, blocked, hidden * (1 - np.float32(direct) * blocked)
    )


def shadow_on_wall(
    what: Silhouette, setting: ShadowSetting
) -> tuple[PixelBox, F32] | None:
    """Box of the photo and (h, w) -log of the light that is left; None where there is no wall, or no shadow on it."""
    lx, ly, lz = setting.light.direction
    if not np.isfinite(setting.backdrop) or lz < 0.05:
        return None
    away, rise = setting.backdrop, max(lz, LEAST_LIGHT_HEIGHT)
    ax, ay = -lx / rise, -ly / rise  # px sideways and down for each px back
    lean = setting.tilt * away  # what lies farther back appears higher
    soft = penumbra_width(setting, away, rise, hypot(ax, ay))
    if what.radius is not None:
        x, y, reach = (
            what.center[0] + ax * away,
            what.center[1] + ay * away - lean,
            what.radius / rise + 2 * soft,
        )
        box = clipped_box((x - reach, y - reach, x + reach, y + reach), setting.size)
        if box is None:
            return None
        right = np.arange(box[0], box[2], dtype=np.float32)[None] - np.float32(
            what.center[0]
        )
        below = np.arange(box[1], box[3], dtype=np.float32)[:, None] - np.float32(
            what.center[1] - lean
        )
        blocked = blocked_by_ball(what.radius, setting, right, below, -away)
    else:
        (x0, y0), (h, w) = what.corner, what.coverage.shape
        half = min(what.thick / 2, away)
        pad = ceil(2.5 * soft + half * hypot(ax, ay)) + 1
        dx, dy = ax * away, ay * away - lean
        box = clipped_box(
            (x0 + dx - pad, y0 + dy - pad, x0 + w + dx + pad, y0 + h + dy + pad),
            setting.size,
        )
        if box is None:
            return None
        blocked = moved_silhouette(what, box, dx, dy, 0.0)
        for back in (-half, half) if half * hypot(ax, ay) > 1 else ():
            np.maximum(
                blocked,
                moved_silhouette(what, box, dx + ax * back, dy + ay * back, 0.0),
                out=blocked,
            )
        blocked = blurred(blocked, soft)
    if what.floor is not None:  # the wall ends where the floor begins
        rows = np.arange(box[1], box[3], dtype=np.float32)[:, None]
        blocked = blocked * np.clip(np.float32(what.floor - lean + 0.5) - rows, 0, 1)
    return box, attenuation(
        setting.direct((0.0, 0.0, 1.0)),
        np.asarray(blocked, np.float32),
        np.zeros_like(blocked),
    )


def shadows_on_sides(
    what: Silhouette, setting: ShadowSetting
) -> Iterator[tuple[PixelBox, F32]]:
    """Box of the photo and (h, w) -log of the light that is left on each wall beside, which goes straight back."""
    (lx, ly, lz), (x0, y0), (h, w) = (
        setting.light.direction,
        what.corner,
        what.coverage.shape,
    )
    if what.floor is None or lz < LEAST_LIGHT_HEIGHT:
        return
    far, mx, my = setting.distance(what.floor), setting.size[0] / 2, setting.size[1] / 2
    for end, stands, facing in zip(what.ends, what.walls, (1.0, -1.0), strict=True):
        if not stands or (end - mx) * facing >= 0 or lx * facing < LEAST_LIGHT_HEIGHT:
            continue  # not there, not seen, or not in the light
        way = np.maximum((np.array([x0, x0 + w]) - end) / lx, 0.0)[
            :, None
        ]  # px along the light
        small = far / (far + way * lz)
        across, down = (
            mx + (end - mx) * small,
            my + (np.array([y0, y0 + h]) - way * ly - my) * small,
        )
        box = clipped_box(
            (across.min() - 2, down.min() - 2, across.max() + 2, down.max() + 2),
            setting.size,
        )
        if box is None:
            continue
        columns = (
            box[0]
            - 0.5
            + (np.arange(MODEL.wall * (box[2] - box[0]))[None] + 0.5) / MODEL.wall
        )
        size = np.maximum((columns - mx) / (end - mx), 1e-3).astype(np.float32)
        back = np.asarray(far * (1 / size - 1), np.float32)
        rows = np.arange(box[1], box[3], dtype=np.float32)[:, None]
        y = np.float32(my) + (rows - np.float32(my)) / size
        if what.radius is not None:
            right, below = (
                np.float32(end - what.center[0]),
                y - np.float32(what.center[1]),
            )
            blocked = blocked_by_ball(what.radius, setting, right, below, -back)
        else:
            soft = blurred(
                what.coverage, penumbra_width(setting, float(np.median(back)) / lz, 1.0)
            )
            x = (np.float32(end - x0) + back * np.float32(lx / lz)).repeat(
                len(y), axis=0
            )
            down = y + back * np.float32(ly / lz) - np.float32(y0)
            blocked = np.asarray(cv2.remap(soft, x, down, cv2.INTER_LINEAR), np.float32)
        upon = ((back >= 0) & (back <= setting.backdrop)) * np.clip(
            np.float32(what.floor + 0.5) - y, 0, 1
        )
        mean = (
            (blocked * upon)
            .reshape(len(y), -1, MODEL.wall)
            .mean(axis=2, dtype=np.float32)
        )
        yield (
            box,
            attenuation(setting.direct((facing, 0.0, 0.0)), mean, np.zeros_like(mean)),
        )


def shadow_darkness(
    what: Silhouette, setting: ShadowSetting
) -> tuple[PixelBox, NDArray[np.float32]] | None:
    """Box of the photo and (h, w) -log of the light that is left there; None where it throws no shadow."""
    parts = (
        [shadow_on_table(what, setting)]
        if setting.top
        else [
            shadow_on_floor(what, setting),
            shadow_on_wall(what, setting),
            *shadows_on_sides(what, setting),
        ]
    )
    found = [part for part in parts if part is not None]
    return joined_pictures(found) if found else None


def joined_pictures(parts: Sequence[tuple[PixelBox, F32]]) -> tuple[PixelBox, F32]:
    """The sum of pictures, each with its box."""
    x0, y0 = (min(box[k] for box, _ in parts) for k in (0, 1))
    x1, y1 = (max(box[k] for box, _ in parts) for k in (2, 3))
    total = np.zeros((y1 - y0, x1 - x0), np.float32)
    for (a, b, c, d), dark in parts:
        total[b - y0 : d - y0, a - x0 : c - x0] += dark
    return (x0, y0, x1, y1), total
