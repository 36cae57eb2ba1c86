"""The skin all around a sphere, continued from the half in the photo.

Colours are separated into a smooth base and fine detail, in logarithms. The base of the
hidden half is the harmonic function with the values of the visible rim. Its detail
consists of round pieces of the visible detail, rotated at random and blended with
weights that preserve its variance (Heitz and Neyret, High-performance by-example noise,
2018).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

F32 = NDArray[np.float32]
Array = NDArray[np.float64]
Mask = NDArray[np.bool_]


@dataclass(frozen=True)
class TextureConstants:
    """Constants of the continuation, tuned on apples, oranges and dates by eye."""

    least_light: float = 0.03
    """Smallest linear light with reliable colours in logarithms."""
    blur_width: float = 0.18
    """Standard deviation of the base, radii."""
    rim: float = 0.85
    """Distance from the centre, radii, at which the base for the hidden half is
    read.
    """
    photo_radius: float = 0.8
    """Distance from the centre, radii, up to which the skin of the photo is used
    unchanged.
    """
    visible: float = 0.92
    """Distance from the centre, radii, beyond which the skin is too foreshortened."""
    modes: int = 8
    """Number of Fourier modes of the base along the rim; higher ones are detail."""
    directions: int = 64
    """Number of pieces of detail all around."""
    piece: float = 0.66
    """Radius of a piece, rad, about an eighth of the sphere."""
    off_centre: float = 0.26
    """Maximum distance of a piece's source from the visible middle, rad."""
    unusual: float = 4.0
    """Ratio to the median detail above which it is a stem or a mark, and not copied."""
    highlight: float = 0.35
    """Smallest height of a highlight in log light; a lower peak may be paint."""
    whiter: float = 0.6
    """Maximum share of a peak in the strongest channel."""
    margin: int = 2
    """Margin of a highlight, px."""
    rim_gap: float = 0.1
    """Smallest distance of a highlight from the rim, radii. The seam of a tennis ball
    and a stripe run to the rim."""
    seed: int = 7


TEXTURE = TextureConstants()


def part_highlights(skin: F32, inside: Mask, radius: float) -> F32:
    """Remove peaks from a skin `(h, w, 3)` that are brighter and whiter than the skin.

    These are fixed reflections of lamps and windows.
    """
    level = np.log(np.maximum(skin, 0) + np.float32(TEXTURE.least_light))
    base = _blur_known(level, inside, TEXTURE.blur_width * radius)
    excess = level - base
    dimmest = skin.argmin(axis=2)[..., None]
    brightest = skin.argmax(axis=2)[..., None]
    # A mirrored lamp adds white light and raises the darkest channel most.
    rise = np.take_along_axis(excess, dimmest, axis=2)[..., 0]
    coloured_rise = np.take_along_axis(excess, brightest, axis=2)[..., 0]
    usual_rise = float(np.median(np.abs(rise[inside]))) if inside.any() else 0.0
    threshold = max(TEXTURE.highlight, TEXTURE.unusual * usual_rise)
    peaks = inside & (rise > threshold) & (coloured_rise < TEXTURE.whiter * rise)
    peaks = _without_stripes(peaks, inside, TEXTURE.rim_gap * radius)
    size = 2 * TEXTURE.margin + 1
    kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (size, size))
    # Include the blurred border of a highlight, and fill it with smooth surroundings.
    hole = (cv2.dilate(peaks.astype(np.uint8), kernel) > 0) & inside
    if not hole.any():
        return skin
    smooth_level = _blur_known(level, inside & ~hole, TEXTURE.blur_width * radius / 2)
    level_without_peaks = np.where(
        hole[..., None], np.minimum(smooth_level, level), level
    )
    return np.asarray(
        np.exp(level_without_peaks) - np.float32(TEXTURE.least_light), np.float32
    )


def _without_stripes(peaks: Mask, inside: Mask, rim_gap: float) -> Mask:
    """Remove the peaks that come within `rim_gap` px of the rim."""
    rim_distance = cv2.distanceTransform(
        np.pad(inside, 1).astype(np.uint8), cv2.DIST_L2, 5
    )[1:-1, 1:-1]
    _, pieces = cv2.connectedComponents(peaks.astype(np.uint8), connectivity=8)
    stripes = np.unique(pieces[rim_distance < rim_gap])
    return peaks & ~np.isin(pieces, stripes)


def continue_skin(skin: F32, center: Sequence[float], radius: float) -> list[F32]:
    """Return the near and the far side of a sphere in the equal-area projection.

    `skin` (h, w, 3): linear light over shading in the photo; `center`: px in it. The
    projection is that of `atlas.equal_area`.
    """
    level = np.log(np.maximum(skin, 0) + np.float32(TEXTURE.least_light))
    source = _Source.separate(level, np.asarray(center, np.float64), radius)
    rows, columns = np.indices(skin.shape[:2])
    u = (columns - center[0]) / radius
    v = (rows - center[1]) / radius
    z = np.clip(1 - u * u - v * v, -1, 1)
    # Lambert's azimuthal equal-area projection keeps pixels of equal size up to the
    # rim.
    factor = np.sqrt(1 + z)
    sides = []
    for side in (1.0, -1.0):
        points = np.dstack([factor * u, factor * v, side * z])
        picture = np.exp(source.level_at(points)) - np.float32(TEXTURE.least_light)
        sides.append(np.asarray(np.maximum(picture, 0), np.float32))
    return sides


def _weighted_detail(detail: F32, is_visible: Mask, radius: float) -> F32:
    """Return limited detail (h, w, 3) with the weight of each pixel, (h, w, 4)."""
    detail_size = np.abs(detail).max(axis=2)
    usual_size = 0.0
    if is_visible.any():
        usual_size = float(np.median(detail_size[is_visible]))
    # Marks much stronger than the usual grain are no texture to repeat on the back.
    is_unusual = is_visible & (detail_size > TEXTURE.unusual * usual_size + 1e-6)
    reach = max(1.0, 0.03 * radius)
    spread = cv2.GaussianBlur(is_unusual.astype(np.float32), (0, 0), reach)
    weight = is_visible * np.clip(1 - 4 * spread, 0.02, 1)
    limit = TEXTURE.unusual * usual_size
    limited_detail = np.clip(detail, -limit, limit)
    return np.dstack([limited_detail, weight]).astype(np.float32)


def _rim_waves(base: F32, center: Array, radius: float) -> NDArray[np.complex128]:
    """Return the first Fourier modes (modes, 3) of the base along the rim."""
    count = 4 * TEXTURE.modes
    angles = 2 * np.pi * np.arange(count) / count
    directions = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    ring = center + TEXTURE.rim * radius * directions
    # The base at the rim, as a few waves along the angle, continues to the back.
    samples = _sample(base, ring[None])[0]
    waves = np.fft.rfft(samples, axis=0)[: TEXTURE.modes] / count
    # Each wave but the mean stands for two modes of opposite sense.
    waves[1:] *= 2
    return np.asarray(waves)


@dataclass(frozen=True)
class _Source:
    """The visible part of a sphere's skin, in logarithms."""

    level: F32
    """Log light, (h, w, 3)."""
    base: F32
    """Smooth base, (h, w, 3)."""
    detail: F32
    """Detail (h, w, 4) with the weight of each pixel, 0 for unusual ones."""
    waves: NDArray[np.complex128]
    """Fourier modes of the base along the rim, (modes, 3)."""
    center: Array
    radius: float

    @staticmethod
    def separate(level: F32, center: Array, radius: float) -> _Source:
        """Separate log light (h, w, 3) into base and detail."""
        rows, columns = np.indices(level.shape[:2])
        distance = np.hypot(columns - center[0], rows - center[1]) / radius
        is_visible = distance < TEXTURE.visible
        base = _blur_known(level, is_visible, TEXTURE.blur_width * radius)
        detail = _weighted_detail(level - base, is_visible, radius)
        waves = _rim_waves(base, center, radius)
        return _Source(level, base, detail, waves, center, radius)

    def level_at(self, points: Array) -> F32:
        """Return log light of points `(h, w, 3)` of the unit sphere."""
        distance = np.hypot(points[..., 0], points[..., 1])
        is_near_side = points[..., 2] > 0
        # Near the rim the photo blends into the continuation, since its pixels are
        # compressed.
        blend_radius = (TEXTURE.visible + TEXTURE.photo_radius) / 2
        blend_width = blend_radius - TEXTURE.photo_radius
        share = np.clip((blend_radius - distance) / blend_width, 0, 1)
        share = (share * is_near_side)[..., None].astype(np.float32)
        places = self.center + self.radius * points[..., :2]
        photo_level = _sample(self.level, places)
        continued_level = self._base_at(points) + self._detail_at(points)
        return np.asarray(
            share * photo_level + (1 - share) * continued_level, np.float32
        )

    def _base_at(self, points: Array) -> F32:
        """Return the base at points `(h, w, 3)`: of the photo, or harmonic on the
        hidden part.
        """
        x, y, z = np.moveaxis(points, 2, 0)
        distance = np.hypot(x, y)
        edge = np.sqrt(1 - TEXTURE.rim**2)
        # A stereographic map of the hidden part to the unit disc, with its rim at 1:
        # harmonic functions stay harmonic, and are sums of powers there.
        disc_radius = np.sqrt(np.clip((1 + z) / (1 + edge), 0, 1))
        rotation = np.exp(1j * np.arctan2(y, x))
        hidden_base = np.zeros(points.shape)
        step = np.ones_like(rotation)
        for wave in self.waves:
            hidden_base += (step[..., None] * wave).real
            step = step * rotation * disc_radius
        places = self.center + self.radius * points[..., :2]
        is_visible = (z > edge) & (distance < TEXTURE.rim)
        photo_base = _sample(self.base, places)
        return np.asarray(
            np.where(is_visible[..., None], photo_base, hidden_base), np.float32
        )

    def _detail_at(self, points: Array) -> F32:
        """Return the blended detail at points `(h, w, 3)`."""
        total = np.zeros(points.shape, np.float32)
        power = np.full(points.shape[:2], 1e-6, np.float32)
        nearest = np.cos(TEXTURE.piece)
        for direction, turn in _pieces():
            cosine = points @ direction
            rows = np.flatnonzero((cosine > nearest).any(axis=1))
            columns = np.flatnonzero((cosine > nearest).any(axis=0))
            if not len(rows) or not len(columns):
                continue
            box = np.s_[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
            source_points = points[box] @ turn.T
            piece = _sample(
                self.detail, self.center + self.radius * source_points[..., :2]
            )
            angle = np.arccos(np.clip(cosine[box], -1, 1)) / TEXTURE.piece
            weight = piece[..., 3] * np.square(np.clip(1 - angle, 0, 1))
            weight = weight.astype(np.float32)
            total[box] += weight[..., None] * piece[..., :3]
            power[box] += weight * weight
        # Division by the root of the sum of squared weights preserves the variance.
        return np.asarray(total / np.sqrt(power)[..., None], np.float32)


def _pieces() -> list[tuple[Array, Array]]:
    """Return the middle `(3,)` of each piece, with the rotation `(3, 3)` to its
    source.
    """
    random = np.random.default_rng(TEXTURE.seed)
    steps = np.arange(TEXTURE.directions) + 0.5
    # A Fibonacci lattice distributes the pieces evenly.
    height = 1 - 2 * steps / TEXTURE.directions
    turn = np.pi * (1 + 5**0.5) * steps
    ring_radii = np.sqrt(1 - height**2)
    middles = np.column_stack(
        [ring_radii * np.cos(turn), ring_radii * np.sin(turn), height]
    )
    pieces = []
    for middle in middles:
        to_front = _rotation_between(middle, np.array([0.0, 0.0, 1.0]))
        roll = cv2.Rodrigues(np.array([0, 0, random.uniform(0, 2 * np.pi)]))[0]
        azimuth = random.uniform(0, 2 * np.pi)
        lean = TEXTURE.off_centre * random.uniform() ** 0.5
        shift = cv2.Rodrigues(lean * np.array([np.cos(azimuth), np.sin(azimuth), 0.0]))[
            0
        ]
        pieces.append((middle, shift @ roll @ to_front))
    return pieces


def _rotation_between(start: Array, end: Array) -> Array:
    """Return the shortest rotation `(3, 3)` from one unit vector to another."""
    axis = np.cross(start, end)
    sine = float(np.linalg.norm(axis))
    angle = float(np.arctan2(sine, start @ end))
    if sine < 1e-9:
        axis = np.array([1.0, 0.0, 0.0])
        sine = 1.0
    return np.asarray(cv2.Rodrigues(angle * axis / sine)[0], np.float64)


def _sample(picture: F32, places: Array) -> F32:
    """Sample a picture `(h, w, C)` at px `(..., 2)`; its edge is continued outwards."""
    x = places[..., 0].astype(np.float32)
    y = places[..., 1].astype(np.float32)
    values = cv2.remap(picture, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(values, np.float32)


def _blur_known(level: F32, mask: Mask, sigma: float) -> F32:
    """Return the local mean `(h, w, 3)` of the known pixels."""
    weight = mask.astype(np.float32)
    weight_sum = cv2.GaussianBlur(weight, (0, 0), max(sigma, 1.0))
    total = cv2.GaussianBlur(level * weight[..., None], (0, 0), max(sigma, 1.0))
    mean_level = level[mask].mean(axis=0) if mask.any() else level.mean(axis=(0, 1))
    total += np.float32(1e-4) * mean_level
    return np.asarray(total / (weight_sum + np.float32(1e-4))[..., None], np.float32)
