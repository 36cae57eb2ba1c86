"""Cast shadows of a silhouette on a floor, a wall or a table, under one distant light.

A surface gets the share d of its light directly. If v of it is blocked, and the part a
of its sky is hidden, the surface keeps 1 - d v - (1 - d) a of its light. Negative
logarithms of such shares ("darkness") add up over objects. A point of a floor is dark
if its ray to the light meets the object: a ball, or a silhouette of constant thickness
across the plane of motion. The higher the ray meets the object, the softer is the
shadow.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from math import ceil, floor, hypot, inf, radians, tan

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.arrays import F32 as F32
from physgen.photometry import DistantLight

PixelBox = tuple[
    int, int, int, int
]  # first and last + 1 column and row: x0, y0, x1, y1

LEAST_LIGHT_HEIGHT = 0.2
"""Minimum sine of the light's height over a surface: lower lights cast endless
shadows.
"""
MOST_BLOCKED = 0.98
"""Maximum blocked share of the direct or the ambient light."""


@dataclass(frozen=True)
class ShadowModel:
    """Resolution and limits of cast shadows."""

    sky: float = 0.5
    """Additional share of ambient light on upward surfaces, since skies are
    brighter.
    """
    levels: int = 10
    """Number of heights at which an object's silhouette is sampled."""
    finer: int = 2
    """Lines of the floor per row of pixels: in the side view, a row is deep."""
    wall: int = 4
    """Columns of a side wall per column of pixels: the wall is foreshortened."""
    sunk_depth: float = 3.0
    """Depth of an object's picture below its floor, px, beyond that by its
    thickness.
    """
    sky_distance: float = 1e4
    """Distance of an open sky, px."""
    share_below: float = 0.9
    side_share: float = 0.4
    """Share of the hidden sky that an object does not replace by its own light: below
    it, and beside it."""


MODEL = ShadowModel()


@dataclass(frozen=True)
class ShadowSetting:
    """The surroundings of the objects: light, floor, wall or table."""

    light: DistantLight
    softness: float
    """Half the angular width of the light, degrees."""
    top: bool
    """True in the top view: the background is a table."""
    tilt: float
    """Side view: rise of a floor's point in the picture per px of distance."""
    backdrop: float
    """Side view: distance from the plane of motion back to a wall, px; infinite without
    one.
    """
    size: tuple[int, int]
    """Width and height of the photo, px."""
    lacking: float = 1.0
    """Blocked share of the direct light in shadows: some light returns from other
    surfaces.
    """

    def direct(self, normal: tuple[float, float, float]) -> float:
        """Return the direct share of a surface's light."""
        pairs = zip(self.light.direction, normal, strict=True)
        facing = sum(a * b for a, b in pairs)
        direct_light = self.light.intensity * max(facing, 0.0)
        brightening = 1.0
        if not self.top:
            # Skies are brighter than their surroundings.
            brightening = 1 + MODEL.sky * max(-normal[1], 0.0)
        ambient = self.light.ambient * brightening
        return min(self.lacking * direct_light / max(direct_light + ambient, 1e-9), 1.0)

    def distance(self, row: float) -> float:
        """Return the distance of a level camera from a floor with its line at `row`,
        px.

        The field of view is at most as wide as the distance.
        """
        width, height = self.size
        rows_below_middle = row - height / 2
        return float(max(rows_below_middle / max(self.tilt, 1e-3), width))

    @property
    def light_radius(self) -> float:
        """Return the light's radius relative to its distance."""
        return tan(radians(min(self.softness, 60.0)))

    @cached_property
    def shade(self) -> np.float32:
        """Return -log of the light left in the darkest shadow."""
        faces = [(0.0, 0.0, 1.0)]
        if not self.top:
            faces.append((0.0, -1.0, 0.0))
        direct_share = max(map(self.direct, faces))
        return np.float32(-np.log(1 - MOST_BLOCKED * direct_share))


@dataclass(frozen=True)
class Silhouette:
    """An object at its present pose."""

    coverage: F32
    """Coverage, (h, w) in 0..1."""
    corner: tuple[int, int]
    """Column and row of its first pixel in the photo."""
    center: tuple[float, float]
    """Centre, px."""
    radius: float | None
    """Radius of a sphere, px; None for other objects."""
    thickness: float
    """Thickness across the plane of motion (side view), or above the table (top view),
    px.
    """
    floor: float | None
    """Side view: row of the floor below it, px; None without a floor."""
    ends: tuple[float, float] = (-inf, inf)
    """Columns of both ends of that floor, px."""
    walls: tuple[bool, bool] = (False, False)
    """Whether a wall stands at either end of that floor, and leads backwards."""
    id: int = 0
    """Id of the object in the label map; 0 if unknown, or for several objects."""

    @cached_property
    def rows(self) -> NDArray[np.intp]:
        """Return the rows of `coverage` with the object."""
        return np.flatnonzero(self.coverage.max(axis=1) > 0.5)

    @cached_property
    def lowest(self) -> tuple[int, NDArray[np.intp]]:
        """Return the first column with the object, and in each column the row below its
        foot.

        0 in empty columns between; no columns for an empty silhouette.
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
        """Return the area, px²."""
        return float(self.coverage.sum())


def _pixel_grid(box: PixelBox) -> tuple[F32, F32]:
    """Return the columns (w,) and the rows (h, 1) of a box's pixels."""
    x0, y0, x1, y1 = box
    columns = np.arange(x0, x1, dtype=np.float32)
    rows = np.arange(y0, y1, dtype=np.float32)
    return columns, rows[:, None]


def _pixel_offsets(box: PixelBox, center: tuple[float, float]) -> tuple[F32, F32]:
    """Return the offsets (1, w) and (h, 1) px of a box's pixels from a point."""
    columns, rows = _pixel_grid(box)
    x, y = center
    right = (columns - np.float32(x))[None, :]
    return np.asarray(right), np.asarray(rows - np.float32(y))


def penumbra_width(
    setting: ShadowSetting, height: float, rise: float, slope: float = 0.66
) -> float:
    """Return the standard deviation, px, of a shadow's edge at this distance from its caster.

    `slope`: px sideways for each px of height.
    """
    radius = setting.light_radius * max(height, 0.0) / rise
    return float(0.35 + 0.5 * radius * (1 + slope * slope) ** 0.5)


def clipped_box(
    box: tuple[float, float, float, float], size: tuple[int, int]
) -> PixelBox | None:
    """Return the whole pixels of a photo of `size` (w, h) in a box; None outside the
    photo.
    """
    x0 = max(floor(box[0]), 0)
    y0 = max(floor(box[1]), 0)
    x1 = min(ceil(box[2]) + 1, size[0])
    y1 = min(ceil(box[3]) + 1, size[1])
    if x1 > x0 and y1 > y0:
        return (x0, y0, x1, y1)
    return None


def attenuation(direct: float, blocked_share: F32, hidden_share: F32) -> F32:
    """Return -log of the remaining light, from lost shares of direct and
    ambient light.
    """
    lost_share = (
        np.float32(direct) * blocked_share + np.float32(1 - direct) * hidden_share
    )
    return np.asarray(-np.log(1 - np.float32(MOST_BLOCKED) * lost_share), np.float32)


def faded_out(x: F32, y: F32, reach: float) -> F32:
    """Return 1 near the origin and 0 beyond `reach`: the end of a very wide shadow."""
    distance = np.sqrt(x * x + y * y) / np.float32(reach)
    return np.asarray(np.clip(1.5 - 1.5 * distance, 0, 1), np.float32)


def moved_silhouette(
    silhouette: Silhouette, box: PixelBox, dx: float, dy: float, blur: float
) -> F32:
    """Return the silhouette, moved and blurred, in a box of the photo."""
    size = (box[2] - box[0], box[3] - box[1])
    shift_x = silhouette.corner[0] + dx - box[0]
    shift_y = silhouette.corner[1] + dy - box[1]
    picture = cv2.warpAffine(
        silhouette.coverage,
        np.array([[1.0, 0, shift_x], [0, 1, shift_y]]),
        size,
        flags=cv2.INTER_LINEAR,
        borderMode=cv2.BORDER_CONSTANT,
    )
    return blurred(np.asarray(picture, np.float32), blur)


def blurred(picture: F32, sigma: float) -> F32:
    """Blur a picture by a Gaussian; a wide one on a coarser grid of at least 4 by 4
    cells.
    """
    if sigma < 0.3:
        return picture
    # A wide blur has no detail that a coarse grid would lose.
    step = min(int(sigma / 3), min(picture.shape) // 4)
    if step < 2:
        return _gaussian(picture, sigma)
    height, width = picture.shape
    grid = (ceil(width / step), ceil(height / step))
    small = cv2.resize(picture, grid, interpolation=cv2.INTER_AREA)
    small = _gaussian(np.asarray(small, np.float32), sigma / step)
    large = cv2.resize(small, (width, height), interpolation=cv2.INTER_LINEAR)
    return np.asarray(large, np.float32)


def _gaussian(picture: F32, sigma: float) -> F32:
    """Blur a picture by a Gaussian of `sigma` px."""
    result = cv2.GaussianBlur(picture, (0, 0), sigma, borderType=cv2.BORDER_CONSTANT)
    return np.asarray(result, np.float32)


def blocked_by_ball(
    radius: float,
    setting: ShadowSetting,
    x: F32 | np.float32,
    y: F32 | float,
    z: F32 | float,
) -> F32:
    """Return the share of light that a ball blocks at points.

    `x`, `y`, `z`: px to the right of, below and in front of its centre.
    """
    lx, ly, lz = setting.light.direction
    depth_against_light = x * np.float32(lx) + y * np.float32(ly) + z * np.float32(lz)
    depth_to_ball = np.asarray(-depth_against_light, np.float32)
    # Distance of the ball's centre from the ray to the light.
    squared_length = x * x + y * y + z * z
    squared_distance = squared_length - depth_to_ball * depth_to_ball
    distance = np.sqrt(np.maximum(squared_distance, 0))
    # A point sees two discs: the ball, and the light at the ball's distance.
    light_at_ball = np.float32(setting.light_radius) * depth_to_ball
    light = np.maximum(light_at_ball, np.float32(0.35))
    smaller = np.minimum(np.float32(radius), light)
    larger = np.maximum(np.float32(radius), light)
    # A logistic function approximates the common area of the discs.
    gap = (distance - larger) / (0.28 * smaller)
    overlap = 1 + np.exp(np.clip(gap, -30, 30))
    share = (smaller / light) ** 2 / overlap
    return np.asarray(share * (depth_to_ball > 0), np.float32)


@dataclass(frozen=True)
class FloorContact:
    """The floor below an object, px."""

    row: float
    """Row of the photo at which the plane of motion meets the floor."""
    foot: float
    """Row of the foot of a standing object: its near edge, lower than `row`."""
    half_thickness: float
    """Half the thickness of the object."""
    low: float
    """Height of its lowest point over the floor."""
    high: float
    """Height of its highest point."""


def floor_contact(silhouette: Silhouette, tilt: float) -> FloorContact | None:
    """Return the floor below an object; None without a floor, or without visible
    pixels.
    """
    floor = silhouette.floor
    if floor is None:
        return None
    radius = silhouette.radius
    if radius is not None:
        low = max(floor - silhouette.center[1] - radius, 0.0)
        return FloorContact(floor, floor, radius, low, low + 2 * radius)
    rows = silhouette.rows
    if not len(rows):
        return None
    top = silhouette.corner[1] + rows[0] - 0.5
    bottom = silhouette.corner[1] + rows[-1] + _row_share(silhouette)
    # An object is at most as thick as a disc of its area.
    thickness = min(silhouette.thickness, 1.13 * silhouette.area**0.5)
    # Users draw floors either at the plane of motion, or at the visible feet of
    # objects.
    largest_height = tilt * thickness / 2 + MODEL.sunk_depth
    hidden_height = min(max(bottom - floor, 0.0), largest_height)
    # Feet far below the line of the floor belong to a deep object.
    half_depth = max(thickness / 2, hidden_height / tilt)
    foot = floor + hidden_height
    lift = min(max(foot - bottom, 0.0), 1.0)
    rise = tilt * half_depth * (1 - lift / 2)
    low = max(foot - bottom, 0.0)
    high = max(foot - top, 1.0)
    return FloorContact(min(floor, foot - rise), foot, half_depth, low, high)


def _row_share(silhouette: Silhouette) -> float:
    """Return px from the last row's middle to the lower edge of an object.

    The edge is at a coverage of one half.
    """
    last = int(silhouette.rows[-1])
    row_maxima = silhouette.coverage.max(axis=1)
    last_maximum = float(row_maxima[last])
    next_maximum = 0.0
    if last + 1 < len(row_maxima):
        next_maximum = float(row_maxima[last + 1])
    slope = max(last_maximum - next_maximum, 0.5)
    return (last_maximum - 0.5) / slope


def shadow_on_floor(
    silhouette: Silhouette, setting: ShadowSetting
) -> tuple[PixelBox, F32] | None:
    """Return a shadow as a box of the photo and -log of the remaining light (h, w).

    None without a floor.
    """
    tilt = max(setting.tilt, 1e-3)
    contact = floor_contact(silhouette, tilt)
    if contact is None or contact.low > 4 * setting.size[1]:
        return None
    box = _floor_shadow_box(silhouette, setting, contact, tilt)
    if box is None:
        return None
    columns, rows = _pixel_grid(box)
    # Coordinate of each row towards the viewer, px.
    depths = (rows - np.float32(contact.row)) / np.float32(tilt)
    blocked_share = _blocked_on_floor(silhouette, setting, contact, columns, depths)
    upon = floor_share(silhouette.ends, setting, box, contact.row)
    if np.isfinite(setting.backdrop):
        before_wall = (depths + np.float32(setting.backdrop)) * np.float32(tilt)
        upon = upon * np.clip(before_wall + np.float32(0.5), 0, 1)
    hidden_share = _hidden_sky(silhouette, contact, columns, depths) * upon
    direct = setting.direct((0.0, -1.0, 0.0))
    return box, attenuation(direct, blocked_share * upon, hidden_share)


def _floor_shadow_box(
    silhouette: Silhouette, setting: ShadowSetting, contact: FloorContact, tilt: float
) -> PixelBox | None:
    """Return the box of a shadow on the floor and of the hidden sky beside it."""
    ax, az, rise = _slopes(setting)
    left = silhouette.corner[0]
    width = silhouette.coverage.shape[1]
    height = contact.high - contact.low
    size = min(max(height, width), 4 * silhouette.thickness)
    sky = 0.45 * size + contact.low
    soft_x = 2 * penumbra_width(setting, contact.high, rise, ax)
    soft_z = 2 * penumbra_width(setting, contact.high, rise, az)
    # The tip of the shadow is shifted by the light's slant over the object's height.
    shift_x = ax * contact.high
    shift_z = az * contact.high
    back = contact.half_thickness + max(soft_z - shift_z, sky)
    front = contact.half_thickness + max(soft_z + shift_z, sky)
    box = (
        left + min(shift_x - soft_x, -sky),
        contact.row - tilt * min(back, setting.backdrop) - 1,
        left + width + max(shift_x + soft_x, sky),
        contact.row + tilt * front + 2,
    )
    return clipped_box(box, setting.size)


def _blocked_on_floor(
    silhouette: Silhouette,
    setting: ShadowSetting,
    contact: FloorContact,
    columns: F32,
    depths: F32,
) -> F32:
    """Return the share of direct light (h, w) that an object blocks on the floor.

    `depths` (h, 1) px towards the viewer.
    """
    # In the side view a row of pixels is deep: average several lines of the floor.
    tilt = max(setting.tilt, 1e-3)
    middle_line = (MODEL.finer - 1) / 2
    offsets = np.arange(MODEL.finer, dtype=np.float32) - middle_line
    offset_rows = offsets / np.float32(MODEL.finer * tilt)
    fine_depths = (depths + offset_rows).reshape(-1, 1)
    # The mean over the lines of a row is taken at the end.
    lines = np.asarray(fine_depths, np.float32)
    if silhouette.radius is not None:
        right = (columns - np.float32(silhouette.center[0]))[None]
        row_below = contact.row - silhouette.center[1]
        blocked_share = blocked_by_ball(
            silhouette.radius, setting, right, row_below, lines
        )
    else:
        blocked_share = _blocked_by_silhouette(
            silhouette, setting, contact, columns, lines
        )
    fine_shares = blocked_share.reshape(len(depths), MODEL.finer, len(columns))
    return np.asarray(fine_shares.mean(axis=1), np.float32)


def floor_share(
    ends: tuple[float, float], setting: ShadowSetting, box: PixelBox, row: float
) -> F32:
    """Return the share 0..1 of a box's pixels on a floor, (h, w).

    The floor's line at `row` px spans the columns `ends`; farther parts are nearer to
    the middle of the picture.
    """
    middle = setting.size[0] / 2
    tilt = max(setting.tilt, 1e-3)
    distance = setting.distance(row)
    x, rows = _pixel_grid(box)
    back = (np.float32(row) - rows) / np.float32(tilt)
    scale = np.float32(distance) / np.maximum(distance + back, 1)
    left_end, right_end = ends
    left = np.float32(middle) + np.float32(left_end - middle) * scale
    right = np.float32(middle) + np.float32(right_end - middle) * scale
    inside = np.minimum(x - left, right - x) + 0.5
    return np.asarray(np.clip(inside, 0, 1), np.float32)


def _slopes(setting: ShadowSetting) -> tuple[float, float, float]:
    """Return the shift of a shadow per px of height, and the sine of the light's
    height.

    The shift is px sideways and px towards the viewer.
    """
    lx, ly, lz = setting.light.direction
    rise = max(-ly, LEAST_LIGHT_HEIGHT)
    return -lx / rise, -lz / rise, rise


@dataclass(frozen=True)
class _Bands:
    """Bands of a silhouette's rows, px; each casts a shadow from its own height."""

    first: NDArray[np.intp]
    """First row of each band."""
    upper: NDArray[np.float64]
    lower: NDArray[np.float64]
    """Heights of both ends of a band over the floor."""

    @property
    def height(self) -> NDArray[np.float64]:
        return (self.upper + self.lower) / 2


def _split_rows(silhouette: Silhouette, contact: FloorContact) -> _Bands:
    """Split the rows of a silhouette into `MODEL.levels` bands, or fewer for a small
    one.
    """
    rows = silhouette.rows
    photo_rows = silhouette.corner[1] + rows
    heights = np.maximum(contact.foot - photo_rows, 0.0)
    count = min(MODEL.levels, len(rows))
    size, remainder = divmod(len(rows), count)
    sizes = size + (np.arange(count) < remainder)
    ends = np.cumsum(sizes)
    first = np.append(0, ends[:-1])
    last = ends - 1
    lower = np.maximum(heights[last] - 0.5, 0.0)
    return _Bands(rows[first], heights[first] + 0.5, lower)


def _blocked_by_silhouette(
    silhouette: Silhouette,
    setting: ShadowSetting,
    contact: FloorContact,
    columns: F32,
    depths: F32,
) -> F32:
    """Return the share of light (h, w) that an object blocks on the floor.

    The points are at `columns`, and at `depths` (h, 1) px.
    """
    ax, az, rise = _slopes(setting)
    bands = _split_rows(silhouette, contact)
    sheared_coverage = _shear(silhouette, contact, ax, columns)
    # Each band of rows casts one line, blurred sideways and in depth by its own height.
    covered_rows = sheared_coverage[: silhouette.rows[-1] + 1]
    profiles = np.maximum.reduceat(covered_rows, bands.first, axis=0)
    lines = _soften(profiles, _penumbra_widths(setting, rise, ax, bands.height))
    depth_widths = _penumbra_widths(setting, rise, az, bands.height)
    weights = _depth_weights(bands, contact.half_thickness, az, depth_widths, depths)
    shares = weights[:, :, None] * lines[:, None]
    return np.asarray(shares.max(axis=0, initial=0), np.float32)


def _shear(
    silhouette: Silhouette, contact: FloorContact, ax: float, columns: F32
) -> F32:
    """Return the coverage (rows, w) of a silhouette, sheared along its shadow.

    The shadow of each row moves sideways in proportion to its height.
    """
    x0, y0 = silhouette.corner
    shift = x0 + ax * (contact.foot - y0) - float(columns[0])
    shear = np.array([[1.0, -ax, shift], [0, 1, 0]])
    size = (len(columns), silhouette.coverage.shape[0])
    sheared_coverage = cv2.warpAffine(
        silhouette.coverage, shear, size, flags=cv2.INTER_LINEAR
    )
    return np.asarray(sheared_coverage, np.float32)


def _depth_weights(
    bands: _Bands,
    half_thickness: float,
    az: float,
    widths: NDArray[np.float64],
    depths: F32,
) -> F32:
    """Return the share (bands, h) of each band's shadow at depths (h, 1) px.

    `widths` (bands,) px are those of the soft edges in depth.
    """
    # Distances in depth from the bands' shadows, in widths of their soft edges.
    shifts = az * bands.height
    gap = np.abs(depths.T - shifts[:, None].astype(np.float32))
    half_lengths = abs(az) * (bands.upper - bands.lower) / 2
    reach = half_thickness + half_lengths
    gap -= reach[:, None].astype(np.float32)
    gap /= 0.55 * widths[:, None].astype(np.float32)
    fade = 1 / (1 + np.exp(np.clip(gap, -30, 30)))
    return np.where(gap < 5, fade, 0).astype(np.float32)


def _penumbra_widths(
    setting: ShadowSetting, rise: float, slope: float, height: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the widths of the soft edges of bands, px; they grow linearly with
    height.
    """
    smallest_width = penumbra_width(setting, 0.0, rise)
    growth = penumbra_width(setting, 1.0, rise, slope) - smallest_width
    return smallest_width + growth * height


def _soften(profiles: F32, sigma: NDArray[np.float64]) -> F32:
    """Blur rows (n, w), each by its own Gaussian of `sigma` (n,) px; zero beyond the
    ends.
    """
    width = profiles.shape[1]
    margin = ceil(3 * float(sigma.max(initial=0.0)))
    size = cv2.getOptimalDFTSize(width + 2 * margin)
    waves = 2 * np.pi * np.fft.rfftfreq(size)
    # A Gaussian of any width costs the same as a product of spectra.
    damping = np.exp(-((waves * sigma[:, None]) ** 2) / 2)
    spectrum = np.fft.rfft(profiles, size, axis=1) * damping
    rows = np.fft.irfft(spectrum, size, axis=1)[:, :width]
    return np.asarray(np.maximum(rows, 0), np.float32)


def _hidden_sky(
    silhouette: Silhouette, contact: FloorContact, columns: F32, depths: F32
) -> F32:
    """Return the share of the floor's sky that an object hides, (h, w)."""
    if silhouette.radius is not None:
        return _sky_behind_ball(silhouette, contact, columns, depths)
    left, lowest = silhouette.lowest
    if not len(lowest):
        return np.zeros((len(depths), len(columns)), np.float32)
    # Gap between the object and the floor in each of its columns, px.
    gaps = contact.foot - (silhouette.corner[1] + lowest - 0.5)
    gaps = np.maximum(gaps, 0.5).astype(np.float32)
    # Columns without the object hide no sky.
    gaps[lowest == 0] = MODEL.sky_distance
    first_column = silhouette.corner[0] + left
    hidden_share = _sky_beside_feet(gaps, first_column, contact, columns, depths)
    _add_sky_below(
        hidden_share, gaps, first_column, contact.half_thickness, columns, depths
    )
    return np.asarray(hidden_share, np.float32)


def _sky_behind_ball(
    ball: Silhouette, contact: FloorContact, columns: F32, depths: F32
) -> F32:
    """Return the cosine-weighted share of the sky that a ball hides."""
    assert ball.radius is not None
    radius = np.float32(ball.radius)
    height = np.float32(contact.low + ball.radius)
    x = (columns - np.float32(ball.center[0]))[None]
    distance = np.sqrt(x * x + depths * depths + height * height)
    solid_angle = (radius / distance) ** 2
    fade = faded_out(x, depths, 2.2 * float(height))
    share = solid_angle * height / distance * fade
    return np.asarray(share, np.float32)


def _sky_beside_feet(
    gaps: F32, first_column: int, contact: FloorContact, columns: F32, depths: F32
) -> F32:
    """Return the share of sky that an object hides beside its feet.

    An upright side hides half the sky at its foot.
    """
    height = contact.high - contact.low
    is_foot = gaps < gaps.min() + 1 + 0.1 * height
    feet = (first_column + np.flatnonzero(is_foot)).astype(np.float32)
    gap_row = _distance_to_feet(feet, columns)[None]
    depth_before = np.abs(depths) - np.float32(contact.half_thickness)
    before = np.maximum(depth_before, 0)
    low = np.float32(contact.low**2)
    distance = np.sqrt(gap_row * gap_row + before * before + low)
    size = min(max(height, len(gaps)), 8 * contact.half_thickness)
    reach = np.float32(0.22 * size + 1)
    hidden_share = np.float32(MODEL.side_share) * np.exp(-distance / reach)
    return np.asarray(hidden_share, np.float32)


def _distance_to_feet(feet: F32, columns: F32) -> F32:
    """Return the distance (w,) px of columns from the edge of the nearest foot."""
    following = np.searchsorted(feet, columns)
    left_feet = feet[np.maximum(following - 1, 0)]
    right_feet = feet[np.minimum(following, len(feet) - 1)]
    to_left = np.abs(columns - left_feet)
    to_right = np.abs(right_feet - columns)
    nearest = np.minimum(to_left, to_right) - np.float32(0.5)
    return np.asarray(np.maximum(nearest, 0), np.float32)


def _add_sky_below(
    hidden_share: F32,
    gaps: F32,
    first_column: int,
    half_thickness: float,
    columns: F32,
    depths: F32,
) -> None:
    """Raise `hidden_share` below the object, in place.

    The object is taken for a rectangle at its height over the floor.
    """
    x0 = np.float32(first_column - 0.5)
    x1 = np.float32(first_column + len(gaps) - 0.5)
    heights = _smooth_gaps(gaps, float(x0), columns)
    span = (x0 - 2 * heights[0], x1 + 2 * heights[-1])
    start, end = np.searchsorted(columns, span)
    if end <= start:
        return
    # The view factor of a rectangle is the sum over its sides of sines of their angles.
    x = columns[start:end]
    height = heights[start:end]
    side_share = _sine(x - x0, height) + _sine(x1 - x, height)
    half = np.float32(half_thickness)
    depth_share = _sine_of_depth(half - depths, height)
    depth_share = depth_share + _sine_of_depth(half + depths, height)
    part = hidden_share[:, start:end]
    view_factor = np.float32(MODEL.share_below / 4) * side_share * depth_share
    np.maximum(part, view_factor, out=part)


def _smooth_gaps(gaps: F32, left: float, columns: F32) -> F32:
    """Return the gap (w,) below an object at columns; `gaps` (n,) start at `left` px."""
    gap_row = cv2.blur(gaps[None], (5, 1))
    smooth_gaps = np.asarray(gap_row[0], np.float32)
    places = np.arange(len(gaps)) + left + 0.5
    return np.interp(columns, places, smooth_gaps).astype(np.float32)


def _sine(distance: F32, height: F32) -> F32:
    """Return the sine of the angle to a side at a distance and a height, px."""
    return np.asarray(distance / np.hypot(distance, height))


def _sine_of_depth(distance: F32, height: F32) -> F32:
    """Return `_sine` by squares, which are faster for many pixels."""
    return np.asarray(distance / np.sqrt(distance * distance + height * height))


def shadow_on_table(
    silhouette: Silhouette, setting: ShadowSetting
) -> tuple[PixelBox, F32] | None:
    """Return a shadow as a box and -log of the remaining light (h, w); None outside the
    photo.

    In the shadow, the hidden sky counts less: table and object illuminate each other.
    """
    if silhouette.radius is not None:
        parts = _ball_on_table(silhouette, silhouette.radius, setting)
    else:
        parts = _silhouette_on_table(silhouette, setting)
    if parts is None:
        return None
    box, blocked_share, hidden_share = parts
    direct = setting.direct((0.0, 0.0, 1.0))
    hidden_share = hidden_share * (1 - np.float32(direct) * blocked_share)
    return box, attenuation(direct, blocked_share, hidden_share)


def _slopes_before(setting: ShadowSetting) -> tuple[float, float, float]:
    """Return the shift of a shadow per px of distance from a table or a wall, and the
    light's z.

    The shift is px right and px down.
    """
    lx, ly, lz = setting.light.direction
    rise = max(lz, LEAST_LIGHT_HEIGHT)
    return -lx / rise, -ly / rise, rise


def _ball_on_table(
    ball: Silhouette, radius: float, setting: ShadowSetting
) -> tuple[PixelBox, F32, F32] | None:
    """Return a box, and the shares of direct light and of sky that a ball
    blocks there.
    """
    ax, ay, rise = _slopes_before(setting)
    blur_width = penumbra_width(setting, radius, rise)
    reach = radius / rise + 2.5 * blur_width + radius
    center_box = (*ball.center, *ball.center)
    surroundings = _swept_box(center_box, ax * radius, ay * radius, reach)
    box = clipped_box(surroundings, setting.size)
    if box is None:
        return None
    x, y = _pixel_offsets(box, ball.center)
    blocked_share = blocked_by_ball(radius, setting, x, y, -radius)
    # The cosine-weighted solid angle of a sphere on the table.
    square = np.float32(radius * radius)
    contact_share = square / (x * x + y * y + square)
    hidden_share = (
        contact_share * np.sqrt(contact_share) * faded_out(x, y, 2.2 * radius)
    )
    return box, blocked_share, hidden_share


LEVELS_ON_TABLE = (0.0, 0.33, 0.67, 1.0)
"""Heights, as shares of an object's, at which its silhouette casts a shadow on
a table.
"""


def _silhouette_on_table(
    silhouette: Silhouette, setting: ShadowSetting
) -> tuple[PixelBox, F32, F32] | None:
    """Return a box, and the shares of direct light and of sky that an object blocks
    there.
    """
    ax, ay, rise = _slopes_before(setting)
    thickness = silhouette.thickness
    box = _silhouette_box(silhouette, _margin_on_table(setting, thickness, rise))
    surroundings = _swept_box(box, ax * thickness, ay * thickness)
    photo_box = clipped_box(surroundings, setting.size)
    if photo_box is None:
        return None
    # Add up the shadows of slices of the object, since higher slices cast wider
    # penumbrae farther away.
    slices = []
    for level in LEVELS_ON_TABLE:
        blur_width = penumbra_width(setting, thickness * level, rise)
        dx = ax * thickness * level
        dy = ay * thickness * level
        slices.append(moved_silhouette(silhouette, photo_box, dx, dy, blur_width))
    blocked_share = np.maximum.reduce(slices)
    # Around its foot, an object also hides a part of the sky.
    foot_blur = max(0.4, 0.35 * thickness)
    hidden_share = 0.9 * moved_silhouette(silhouette, photo_box, 0, 0, foot_blur)
    return photo_box, blocked_share, hidden_share


def _swept_box(
    box: tuple[float, float, float, float], dx: float, dy: float, margin: float = 0.0
) -> tuple[float, float, float, float]:
    """Return the box of a box moved by up to (dx, dy) px, with a margin."""
    x0, y0, x1, y1 = box
    return (
        x0 + min(0, dx) - margin,
        y0 + min(0, dy) - margin,
        x1 + max(0, dx) + margin,
        y1 + max(0, dy) + margin,
    )


def _margin_on_table(setting: ShadowSetting, thickness: float, rise: float) -> int:
    """Return the reach of a shadow beyond its silhouette, px."""
    widest = penumbra_width(setting, thickness, rise)
    return ceil(2.5 * widest + 0.8 * thickness) + 1


def _silhouette_box(
    silhouette: Silhouette, margin: int = 0
) -> tuple[int, int, int, int]:
    """Return the box of a silhouette with a margin: x0, y0, x1, y1 px."""
    x, y = silhouette.corner
    height, width = silhouette.coverage.shape
    return x - margin, y - margin, x + width + margin, y + height + margin


def shadow_on_wall(
    silhouette: Silhouette, setting: ShadowSetting
) -> tuple[PixelBox, F32] | None:
    """Return a shadow as a box and -log of the remaining light (h, w).

    None without a wall, or without a shadow on it.
    """
    if not np.isfinite(setting.backdrop) or setting.light.direction[2] < 0.05:
        return None
    lean = setting.tilt * setting.backdrop  # farther points appear higher
    if silhouette.radius is not None:
        shadow = _ball_on_wall(silhouette, silhouette.radius, setting, lean)
    else:
        shadow = _silhouette_on_wall(silhouette, setting, lean)
    if shadow is None:
        return None
    box, blocked_share = shadow
    if silhouette.floor is not None:
        # The wall ends at the floor.
        _, rows = _pixel_grid(box)
        end = np.float32(silhouette.floor - lean + 0.5)
        blocked_share = blocked_share * np.clip(end - rows, 0, 1)
    direct = setting.direct((0.0, 0.0, 1.0))
    zeros = np.zeros_like(blocked_share)
    return box, attenuation(direct, np.asarray(blocked_share, np.float32), zeros)


def _ball_on_wall(
    ball: Silhouette, radius: float, setting: ShadowSetting, lean: float
) -> tuple[PixelBox, F32] | None:
    """Return a box, and the share of direct light that a ball blocks there."""
    ax, ay, rise = _slopes_before(setting)
    distance = setting.backdrop
    blur_width = penumbra_width(setting, distance, rise, hypot(ax, ay))
    x = ball.center[0] + ax * distance
    y = ball.center[1] + ay * distance - lean
    reach = radius / rise + 2 * blur_width
    surroundings = (x - reach, y - reach, x + reach, y + reach)
    box = clipped_box(surroundings, setting.size)
    if box is None:
        return None
    columns, rows = _pixel_grid(box)
    right = columns[None] - np.float32(ball.center[0])
    rows_below = rows - np.float32(ball.center[1] - lean)
    return box, blocked_by_ball(radius, setting, right, rows_below, -distance)


def _silhouette_on_wall(
    silhouette: Silhouette, setting: ShadowSetting, lean: float
) -> tuple[PixelBox, F32] | None:
    """Return a box, and the share of direct light that an object blocks there."""
    ax, ay, rise = _slopes_before(setting)
    distance = setting.backdrop
    slope = hypot(ax, ay)
    blur_width = penumbra_width(setting, distance, rise, slope)
    half_depth = min(silhouette.thickness / 2, distance)
    margin = ceil(2.5 * blur_width + half_depth * slope) + 1
    dx = ax * distance
    dy = ay * distance - lean
    box = _moved_box(silhouette, (dx, dy), margin, setting.size)
    if box is None:
        return None
    blocked_share = moved_silhouette(silhouette, box, dx, dy, 0.0)
    if half_depth * slope > 1:
        # The near and the far side of a thick object cast separate shadows.
        for back in (-half_depth, half_depth):
            side = moved_silhouette(
                silhouette, box, dx + ax * back, dy + ay * back, 0.0
            )
            np.maximum(blocked_share, side, out=blocked_share)
    return box, blurred(blocked_share, blur_width)


def _moved_box(
    silhouette: Silhouette,
    shift: tuple[float, float],
    margin: float,
    size: tuple[int, int],
) -> PixelBox | None:
    """Return the box of a shifted silhouette with a margin, in a photo of `size`."""
    dx, dy = shift
    x0, y0, x1, y1 = _silhouette_box(silhouette)
    surroundings = (
        x0 + dx - margin,
        y0 + dy - margin,
        x1 + dx + margin,
        y1 + dy + margin,
    )
    return clipped_box(surroundings, size)


def shadows_on_sides(
    silhouette: Silhouette, setting: ShadowSetting
) -> Iterator[tuple[PixelBox, F32]]:
    """Yield a box and -log of the remaining light (h, w) for each side wall.

    Such a wall leads straight backwards.
    """
    lx, _, lz = setting.light.direction
    if silhouette.floor is None or lz < LEAST_LIGHT_HEIGHT:
        return
    middle = setting.size[0] / 2
    sides = zip(silhouette.ends, silhouette.walls, (1.0, -1.0), strict=True)
    for end, has_wall, facing in sides:
        # The camera sees only the side walls that face the middle of the photo.
        is_visible = has_wall and (end - middle) * facing < 0
        faces_light = lx * facing >= LEAST_LIGHT_HEIGHT
        if not (is_visible and faces_light):
            continue
        box = _side_wall_box(silhouette, setting, silhouette.floor, end)
        if box is None:
            continue
        blocked_share = _blocked_on_side(
            silhouette, setting, silhouette.floor, end, box
        )
        direct = setting.direct((facing, 0.0, 0.0))
        yield box, attenuation(direct, blocked_share, np.zeros_like(blocked_share))


def _side_wall_box(
    silhouette: Silhouette, setting: ShadowSetting, floor: float, end: float
) -> PixelBox | None:
    """Return the box of the shadow on a side wall at column `end`."""
    lx, ly, lz = setting.light.direction
    x0, y0, x1, y1 = _silhouette_box(silhouette)
    wall_distance = setting.distance(floor)
    mx = setting.size[0] / 2
    my = setting.size[1] / 2
    # Length of the light's path from the object to the wall, px.
    path = np.maximum((np.array([x0, x1]) - end) / lx, 0.0)[:, None]
    # Farther points are smaller in perspective.
    shrink = wall_distance / (wall_distance + path * lz)
    x = mx + (end - mx) * shrink
    y = my + (np.array([y0, y1]) - path * ly - my) * shrink
    surroundings = (
        x.min() - 2,
        y.min() - 2,
        x.max() + 2,
        y.max() + 2,
    )
    return clipped_box(surroundings, setting.size)


def _blocked_on_side(
    silhouette: Silhouette,
    setting: ShadowSetting,
    floor: float,
    end: float,
    box: PixelBox,
) -> F32:
    """Return the share of direct light (h, w) that an object blocks on a side wall."""
    wall_distance = setting.distance(floor)
    my = setting.size[1] / 2
    shrink = _shrink_along_wall(setting, end, box)
    back = np.asarray(wall_distance * (1 / shrink - 1), np.float32)
    _, rows = _pixel_grid(box)
    y = np.float32(my) + (rows - np.float32(my)) / shrink
    if silhouette.radius is not None:
        right = np.float32(end - silhouette.center[0])
        row_offsets = y - np.float32(silhouette.center[1])
        blocked_share = blocked_by_ball(
            silhouette.radius, setting, right, row_offsets, -back
        )
    else:
        blocked_share = _cast_sideways(silhouette, setting, end, back, y)
    is_wall = (back >= 0) & (back <= setting.backdrop)
    above_floor = np.float32(floor + 0.5) - y
    upon = is_wall * np.clip(above_floor, 0, 1)
    fine_shares = (blocked_share * upon).reshape(len(y), -1, MODEL.wall)
    return np.asarray(fine_shares.mean(axis=2, dtype=np.float32), np.float32)


def _shrink_along_wall(setting: ShadowSetting, end: float, box: PixelBox) -> F32:
    """Return the size (1, n) of a side wall's columns relative to its near end.

    The wall is foreshortened, so that a column of pixels has several of its columns.
    """
    middle = setting.size[0] / 2
    fine_count = MODEL.wall * (box[2] - box[0])
    steps = np.arange(fine_count)[None] + 0.5
    columns = box[0] - 0.5 + steps / MODEL.wall
    relative_columns = (columns - middle) / (end - middle)
    return np.maximum(relative_columns, 1e-3).astype(np.float32)


def _cast_sideways(
    silhouette: Silhouette, setting: ShadowSetting, end: float, back: F32, y: F32
) -> F32:
    """Project the silhouette along the light to points of a side wall.

    `back` (1, w) and `y` (h, w): distance from the plane of motion, and row.
    """
    lx, ly, lz = setting.light.direction
    x0, y0 = silhouette.corner
    distance = float(np.median(back)) / lz
    blur_width = penumbra_width(setting, distance, 1.0)
    blurred_coverage = blurred(silhouette.coverage, blur_width)
    wall_column = np.float32(end - x0) + back * np.float32(lx / lz)
    right = wall_column.repeat(len(y), axis=0)
    down = y + back * np.float32(ly / lz) - np.float32(y0)
    picture = cv2.remap(blurred_coverage, right, down, cv2.INTER_LINEAR)
    return np.asarray(picture, np.float32)


def shadow_darkness(
    silhouette: Silhouette, setting: ShadowSetting
) -> tuple[PixelBox, F32] | None:
    """Return a shadow as a box and -log of the remaining light (h, w); None without a
    shadow.
    """
    if setting.top:
        return shadow_on_table(silhouette, setting)
    parts = [
        shadow_on_floor(silhouette, setting),
        shadow_on_wall(silhouette, setting),
        *shadows_on_sides(silhouette, setting),
    ]
    shadows = []
    for part in parts:
        if part is not None:
            shadows.append(part)
    if shadows:
        return joined_pictures(shadows)
    return None


def joined_pictures(parts: Sequence[tuple[PixelBox, F32]]) -> tuple[PixelBox, F32]:
    """Return the sum of pictures, each with its box."""
    boxes = np.array([box for box, _ in parts])
    left, top = boxes[:, :2].min(axis=0).tolist()
    right, bottom = boxes[:, 2:].max(axis=0).tolist()
    total = np.zeros((bottom - top, right - left), np.float32)
    for (x0, y0, x1, y1), picture in parts:
        total[y0 - top : y1 - top, x0 - left : x1 - left] += picture
    return (left, top, right, bottom), total
