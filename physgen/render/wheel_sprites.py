"""Pictures of wheels, which turn on the picture of their vehicle.

A wheel is a disc of the vehicle's sprite. Paint turns with it; the light on it and the
covering part of the body stay. Paint hidden by the body is copied from elsewhere around
the axle.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import ceil, cos, floor, pi, sin

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.geometry.circle_votes import circle_votes

F32 = NDArray[np.float32]
Array = NDArray[np.float64]
Mask = NDArray[np.bool_]


@dataclass(frozen=True)
class WheelConstants:
    """Constants of wheels' pictures, tuned on two cars and a toy by eye."""

    tyre_difference: float = 0.07
    """Difference of the root of light around the axle of a tyre."""
    spread: float = 3.0
    """Ratio to the usual difference above which a pixel belongs to the body."""
    deepest: float = 0.55
    """Maximum share of the radius that the body covers."""
    tyre_length: int = 3
    """Length of tyre, px, at the end of the body's cover."""
    lower: float = 0.1
    """Sine of the angle below the axle from which a wheel is certainly visible."""
    median_width: float = 0.1
    """Width of the median over the body's border, turns."""
    shading: float = 0.5
    """Maximum change of light around the axle."""
    least_light: float = 0.02
    """Linear light below which light and paint cannot be separated."""
    rims: tuple[float, ...] = (0.45, 0.5, 0.55, 0.61, 0.67, 0.74)
    """Radii of rims with a centre of their own, relative to the wheel."""
    axle_distance: float = 0.4
    """Maximum distance of a steered wheel's rim from its axle, radii."""
    concentric: float = 0.1
    """Distance from the axle, radii, within which a rim turns with the tyre."""
    edge: float = 0.3
    """Share of a rim's circle that must be an edge."""
    turning_radius: float = 1.06
    """Radius of the turning part, in radii of the rim."""
    rim_shapes: tuple[float, ...] = (1.0, 0.95, 0.9, 0.85, 0.8, 0.75, 0.7)
    """Width over height of a steered wheel's rim."""
    finer: tuple[float, ...] = (
        0.8,
        0.87,
        0.93,
        1.0,
        1.07,
        1.14,
        1.21,
        1.28,
        1.35,
        1.42,
    )
    """Tested radii of the rim, relative to its first one."""
    reach: float = 0.14
    """Search range around the rim's first centre, radii of the wheel."""


WHEEL = WheelConstants()


@dataclass(frozen=True, eq=False)
class WheelSprite:
    """A wheel on a sprite's box."""

    number: int
    """Column of `Trajectory.wheel_turns`."""
    center: tuple[float, float]
    """Centre, px of the sprite."""
    radius: float
    corner: tuple[int, int]
    """Column and row of the pictures' first pixel."""
    paint: F32
    """Linear light without shading, (h, w, 3)."""
    shading: F32
    """Fixed shading (h, w)."""
    cover: F32
    """Visible share of the wheel, (h, w) 0..1."""
    aspect: float = 1.0
    """Width over height: a steered wheel is an ellipse."""

    def draw(self, light: F32, coverage: F32, matrix: Array, turn: float) -> None:
        """Draw the wheel with a rotation of `turn` rad into `light` (h, w, 3).

        `matrix` (2, 3) leads from pixels of `light` to those of the sprite.
        """
        box = self._box(light.shape, matrix)
        if box is None:
            return
        rows, columns = box
        size = (columns.stop - columns.start, rows.stop - rows.start)
        to_picture = matrix.copy()
        to_picture[:, 2] += matrix[:, :2] @ (columns.start, rows.start) - self.corner
        axle = np.subtract(self.center, self.corner)
        # The wheel appears as an ellipse: stretch it to a circle, turn it back and
        # compress it.
        inverse_rotation = np.array(
            [
                [cos(turn), self.aspect * sin(turn)],
                [-sin(turn) / self.aspect, cos(turn)],
            ]
        )
        to_paint = inverse_rotation @ to_picture
        to_paint[:, 2] += axle - inverse_rotation @ axle
        # Paint turns with the wheel; shading and cover do not.
        paint = _warp(self.paint, to_paint, size, cv2.BORDER_REPLICATE)
        shading = _warp(self.shading, to_picture, size, cv2.BORDER_REPLICATE)
        cover = _warp(self.cover, to_picture, size, cv2.BORDER_CONSTANT)
        cover = np.clip(cover, 0, 1)[..., None]
        wheel_light = paint * shading[..., None] * coverage[box][..., None]
        light[box] = (1 - cover) * light[box] + cover * np.maximum(wheel_light, 0)

    def _box(self, shape: tuple[int, ...], matrix: Array) -> tuple[slice, slice] | None:
        """Return the pixels of a picture in which the wheel may be visible."""
        inverse = np.linalg.inv(matrix[:, :2])
        # `matrix` leads from the picture to the sprite: its inverse places the wheel in
        # the picture.
        x, y = inverse @ (np.array(self.center) - matrix[:, 2])
        # The largest row sum of the inverse bounds the extent of the transformed circle
        # along both axes.
        reach = (self.radius + 2) * float(np.abs(inverse).sum(axis=1).max())
        left = max(floor(x - reach), 0)
        right = min(ceil(x + reach) + 1, shape[1])
        top = max(floor(y - reach), 0)
        bottom = min(ceil(y + reach) + 1, shape[0])
        if left >= right or top >= bottom:
            return None
        return slice(top, bottom), slice(left, right)


def _warp(picture: F32, matrix: Array, size: tuple[int, int], border: int) -> F32:
    """Warp a picture to a box of `size` (w, h)."""
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    result = cv2.warpAffine(picture, matrix, size, flags=flags, borderMode=border)
    return np.asarray(result, np.float32)


def wheel_from_photo(
    light: F32,
    coverage: F32,
    number: int,
    center: tuple[float, float],
    radius: float,
) -> WheelSprite | None:
    """Return the wheel at `center` px of a sprite; None if it lies outside.

    `light` (h, w, 3) is linear and multiplied by `coverage` (h, w).
    """
    x0, y0, x1, y1 = _wheel_box(center, radius, coverage.shape)
    if x1 - x0 < 3 or y1 - y0 < 3:
        return None
    alpha = coverage[y0:y1, x0:x1]
    # Divide by the coverage, but not by nearly nothing at the edge of the sprite.
    opaque_light = light[y0:y1, x0:x1] / np.maximum(alpha, 0.05)[..., None]
    colour = np.asarray(opaque_light, np.float32)
    part = _turning_part(colour, alpha, (center[0] - x0, center[1] - y0), radius)
    # In polar coordinates, paint that turns with the wheel stays on its ring, which
    # separates it from the body and the shading.
    rings = _Rings.sample(colour, alpha, part)
    rings = rings.without_body().without_shading()
    distances, place = _polar_places(alpha.shape, part, rings.paint.shape)
    disc = np.clip(part.radius - distances, 0, 1)
    body = _from_rings(rings.body.astype(np.float32), place)
    return WheelSprite(
        number,
        (part.x + x0, part.y + y0),
        part.radius,
        (x0, y0),
        _from_rings(rings.paint, place),
        _from_rings(rings.shading, place),
        (disc * (1 - np.clip(body, 0, 1))).astype(np.float32),
        part.aspect,
    )


def _wheel_box(
    center: tuple[float, float], radius: float, shape: tuple[int, ...]
) -> tuple[int, int, int, int]:
    """Return x0, y0, x1, y1 px of a wheel with a margin, within a picture's shape."""
    x0 = floor(center[0] - radius) - 2
    y0 = floor(center[1] - radius) - 2
    x1 = ceil(center[0] + radius) + 3
    y1 = ceil(center[1] + radius) + 3
    return max(x0, 0), max(y0, 0), min(x1, shape[1]), min(y1, shape[0])


@dataclass(frozen=True)
class _Ellipse:
    """The visibly turning part of a wheel, upright; px of the picture."""

    x: float
    y: float
    radius: float
    """Half its height."""
    aspect: float
    """Its width over its height."""


def _turning_part(
    colour: F32, alpha: F32, axle: tuple[float, float], radius: float
) -> _Ellipse:
    """Return the visibly turning part of a wheel.

    It is the whole wheel, except for a steered wheel with its rim beside the tyre's
    centre: such a tyre would wobble, and only its rim turns.
    """
    rows, columns = np.indices(alpha.shape)
    distances = np.hypot(columns - axle[0], rows - axle[1])
    codes = (255 * np.sqrt(np.clip(colour, 0, 1)).mean(axis=2)).astype(np.float32)
    is_inner = (distances < 0.9 * radius) & (alpha > 0.5)
    radii = [max(part * radius, 2.0) for part in WHEEL.rims]
    votes = circle_votes(codes, is_inner, radii)
    # The centre of the turning part lies near the axle.
    votes[:, distances > WHEEL.axle_distance * radius] = 0
    ring, y, x = np.unravel_index(int(votes.argmax()), votes.shape)
    is_sure = votes[ring, y, x] >= WHEEL.edge
    # Without a clear rim, or with a centred one, the wheel turns as a whole.
    if not is_sure or distances[y, x] <= WHEEL.concentric * radius:
        return _Ellipse(axle[0], axle[1], radius, 1.0)
    first = _Ellipse(float(x), float(y), radii[ring], 1.0)
    rim = _best_rim(codes, first, WHEEL.reach * radius)
    return _Ellipse(rim.x, rim.y, WHEEL.turning_radius * rim.radius, rim.aspect)


def _best_rim(codes: F32, first: _Ellipse, reach: float) -> _Ellipse:
    """Return the ellipse near a circle with the most contrast at its edge.

    The rim is an edge of brightness: search the ellipse whose normal gradient is
    largest on average.
    """
    # The blur removes grain, which has strong gradients in all directions.
    blurred_codes = cv2.GaussianBlur(codes, (0, 0), 1.0)
    gx = np.asarray(cv2.Sobel(blurred_codes, cv2.CV_32F, 1, 0), np.float32)
    gy = np.asarray(cv2.Sobel(blurred_codes, cv2.CV_32F, 0, 1), np.float32)
    steps = np.arange(-ceil(reach), ceil(reach) + 1)
    shift_y, shift_x = np.meshgrid(steps, steps, indexing="ij")
    best, best_contrast = first, 0.0
    for scale in WHEEL.finer:
        for aspect in WHEEL.rim_shapes:
            height = scale * first.radius
            rim = _Ellipse(first.x, first.y, height, aspect)
            contrast = _rim_contrast(gx, gy, rim, shift_x, shift_y)
            row, column = np.unravel_index(int(contrast.argmax()), contrast.shape)
            if contrast[row, column] > best_contrast:
                best_contrast = float(contrast[row, column])
                best = _Ellipse(
                    float(first.x + shift_x[row, column]),
                    float(first.y + shift_y[row, column]),
                    height,
                    aspect,
                )
    return best


def _rim_contrast(
    gx: F32,
    gy: F32,
    rim: _Ellipse,
    shift_x: NDArray[np.int64],
    shift_y: NDArray[np.int64],
) -> NDArray[np.floating]:
    """Return the contrast (h, w) at the edge of an ellipse after shifts (h, w), px.

    `gx` and `gy` (H, W) are the gradients of brightness.
    """
    turn = 2 * pi * np.arange(64) / 64
    x = rim.x + shift_x[..., None] + rim.aspect * rim.radius * np.cos(turn)
    y = rim.y + shift_y[..., None] + rim.radius * np.sin(turn)
    columns = np.clip(np.rint(x).astype(int), 0, gx.shape[1] - 1)
    rows = np.clip(np.rint(y).astype(int), 0, gx.shape[0] - 1)
    radial_x = gx[rows, columns] * np.cos(turn)
    radial_y = gy[rows, columns] * np.sin(turn)
    # Sum with signs, so that random edges cancel each other along the rim.
    return np.asarray(np.abs(np.mean(radial_x + radial_y, axis=2)))


def drawn_wheel(
    number: int, center: tuple[float, float], radius: float, colour: F32
) -> WheelSprite:
    """Return a wheel of one colour `(3,)` with spokes, for scenes without a photo."""
    x0 = floor(center[0] - radius) - 2
    y0 = floor(center[1] - radius) - 2
    size = 2 * ceil(radius) + 6
    rows, columns = np.indices((size, size))
    x = columns + x0 - center[0]
    y = rows + y0 - center[1]
    distances = np.hypot(x, y)
    spoke_width = max(0.06 * radius, 0.7)
    is_spoke = np.minimum(np.abs(x), np.abs(y)) < spoke_width
    is_rim = distances > 0.85 * radius
    is_dark = (is_spoke | is_rim)[..., None]
    paint = np.where(is_dark, 0.3 * colour, colour).astype(np.float32)
    cover = np.clip(radius - distances + 0.5, 0, 1).astype(np.float32)
    ones = np.ones((size, size), np.float32)
    return WheelSprite(number, center, radius, (x0, y0), paint, ones, cover)


@dataclass(frozen=True, eq=False)
class _Rings:
    """A wheel in polar coordinates: a row for each px from the axle."""

    paint: F32
    """Linear light, (R, A, 3)."""
    object_mask: Mask
    """Mask (R, A) of pixels of the object in the photo."""
    body: Mask
    """Mask (R, A) of pixels of the vehicle's body in front of the wheel."""
    shading: F32
    """Shading, (R, A)."""

    @staticmethod
    def sample(colour: F32, alpha: F32, part: _Ellipse) -> _Rings:
        """Sample a picture in polar coordinates around the axle."""
        count = max(ceil(part.radius), 2)
        steps = 4 * max(ceil(pi * part.radius / 2), 8)
        radii = (np.arange(count) + 0.5) * (part.radius / count)
        turn = 2 * pi * np.arange(steps) / steps
        offsets = part.aspect * radii[:, None] * np.cos(turn)
        x = (part.x + offsets).astype(np.float32)
        offsets_down = radii[:, None] * np.sin(turn)
        y = (part.y + offsets_down).astype(np.float32)
        flags = cv2.INTER_LINEAR
        paint = cv2.remap(colour, x, y, flags, borderMode=cv2.BORDER_REPLICATE)
        cover = cv2.remap(alpha, x, y, flags, borderMode=cv2.BORDER_CONSTANT)
        ones = np.ones((count, steps), np.float32)
        no_body = np.zeros((count, steps), bool)
        return _Rings(np.asarray(paint, np.float32), cover > 0.9, no_body, ones)

    def without_body(self) -> _Rings:
        """Return the wheel without the body over its upper part."""
        count, steps = self.object_mask.shape
        level = np.sqrt(np.maximum(self.paint, 0))
        sine = np.sin(2 * pi * np.arange(steps) / steps)
        is_below = sine > WHEEL.lower
        # The lower half is always visible: it tells the usual paint and its variation
        # per ring.
        usual_level = np.median(level[:, is_below], axis=1)
        differences = np.abs(level - usual_level[:, None]).max(axis=2)
        spread = np.median(differences[:, is_below], axis=1)
        limit = np.maximum(WHEEL.tyre_difference, WHEEL.spread * spread)
        is_unlike = (differences > limit[:, None]) & ~is_below & (sine < 0)
        # The body hides a connected part from the tread inwards.
        depth = _depths(is_unlike, round(WHEEL.deepest * count))
        window = 2 * max(round(WHEEL.median_width * steps / 2), 1) + 1
        depth = _median_around(depth, window)
        depths_of_rows = count - np.arange(count)
        is_body = (depths_of_rows[:, None] <= depth) | ~self.object_mask
        paint = self._fill_hidden_paint(is_body)
        return _Rings(paint, self.object_mask, is_body & self.object_mask, self.shading)

    def _fill_hidden_paint(self, hidden_mask: Mask) -> F32:
        """Return the paint, with hidden parts copied from elsewhere on the same
        ring.
        """
        paint = self.paint.copy()
        is_open = hidden_mask.copy()
        steps = hidden_mask.shape[1]
        # Rotations by simple fractions of a turn come first, as most rims have such a
        # symmetry.
        for divisor in (2, 3, 6, 5, 4, 8, 10, 12):
            for times in range(1, divisor):
                shift = round(steps * times / divisor)
                source = np.roll(hidden_mask, shift, axis=1)
                fits = is_open & ~source
                paint[fits] = np.roll(self.paint, shift, axis=1)[fits]
                is_open &= source
            if not is_open.any():
                break
        return paint

    def without_shading(self) -> _Rings:
        """Separate paint in even light from the light that changes once around the
        axle.
        """
        steps = self.object_mask.shape[1]
        turn = 2 * pi * np.arange(steps) / steps
        brightness = self.paint.mean(axis=2) + WHEEL.least_light
        mean = brightness.mean(axis=1, keepdims=True)
        # Light from one side changes once around the axle: take the first harmonic of
        # each ring.
        cosine_mean = (brightness * np.cos(turn)).mean(axis=1, keepdims=True)
        sine_mean = (brightness * np.sin(turn)).mean(axis=1, keepdims=True)
        cosine_part = 2 * cosine_mean / mean
        sine_part = 2 * sine_mean / mean
        sigma = max(0.15 * len(brightness), 1.0)
        change = _smoothed_rows(cosine_part, sigma) * np.cos(turn)
        change = change + _smoothed_rows(sine_part, sigma) * np.sin(turn)
        shading = 1 + np.clip(change, -WHEEL.shading, WHEEL.shading)
        shading = shading.astype(np.float32)
        paint = self.paint / shading[..., None]
        return _Rings(paint, self.object_mask, self.body, shading)


def _smoothed_rows(values: NDArray[np.floating], sigma: float) -> Array:
    """Blur values `(R, 1)` along the rows."""
    reach = ceil(3 * sigma)
    places = np.arange(-reach, reach + 1) / sigma
    kernel = np.exp(-0.5 * places**2)
    padded_values = np.pad(values[:, 0], reach, mode="edge")
    return np.convolve(padded_values, kernel / kernel.sum(), mode="valid")[:, None]


def _depths(is_different: Mask, deepest: int) -> NDArray[np.int64]:
    """Return the depth `(A,)` px from the tread inwards of pixels unlike a wheel."""
    depths = np.zeros(is_different.shape[1], np.int64)
    for column in range(is_different.shape[1]):
        is_body = is_different[::-1, column]
        if not is_body[: WHEEL.tyre_length].any():
            continue
        tyre_run = np.convolve(~is_body, np.ones(WHEEL.tyre_length), mode="valid")
        ends = np.flatnonzero(tyre_run >= WHEEL.tyre_length)
        depths[column] = min(int(ends[0]) if len(ends) else deepest, deepest)
    return depths


def _median_around(values: NDArray[np.int64], window: int) -> NDArray[np.int64]:
    """Return the running median of values on a circle."""
    half_width = window // 2
    closed_values = np.concatenate([values[-half_width:], values, values[:half_width]])
    views = np.lib.stride_tricks.sliding_window_view(closed_values, 2 * half_width + 1)
    return np.asarray(np.rint(np.median(views, axis=1)), np.int64)


def _polar_places(
    shape: tuple[int, ...], part: _Ellipse, rings: tuple[int, ...]
) -> tuple[Array, tuple[F32, F32]]:
    """Return px from the axle, and the column and row in the rings, of each pixel."""
    rows, columns = np.indices(shape[:2])
    x = (columns - part.x) / part.aspect
    y = rows - part.y
    distances = np.hypot(x, y)
    share_of_turn = np.mod(np.arctan2(y, x) / (2 * pi), 1)
    turn = share_of_turn * rings[1]
    exact_ring = distances * rings[0] / part.radius - 0.5
    ring = np.clip(exact_ring, 0, rings[0] - 1)
    return distances, (turn.astype(np.float32), ring.astype(np.float32))


def _from_rings(rings: F32, place: tuple[F32, F32]) -> F32:
    """Return a picture of values `(R, A[, C])` in polar coordinates."""
    closed_rings = np.concatenate([rings, rings[:, :1]], axis=1)
    picture = cv2.remap(
        closed_rings,
        place[0],
        place[1],
        cv2.INTER_LINEAR,
        borderMode=cv2.BORDER_REPLICATE,
    )
    return np.asarray(picture, np.float32)
