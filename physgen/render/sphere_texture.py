"""The skin of a sphere all around, continued from the half that the photo shows.

Colours are parted into a smooth base and fine detail, in logarithms. The base of the
hidden half is the harmonic function that meets the base at the visible rim. Its detail
consists of round pieces of the visible detail, turned at random and blended with weights
that preserve its variance (Heitz and Neyret, High-performance by-example noise, 2018).
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

    dark: float = 0.03
    """Linear light: colours below tell little in logarithms."""
    smooth: float = 0.18
    """Of the radius: standard deviation of the base."""
    rim: float = 0.85
    """Of the radius, at which the base is read for the hidden half."""
    sure: float = 0.8
    """Of the radius, up to which the skin stays as the photo shows it."""
    visible: float = 0.92
    """Of the radius: farther out the skin is too foreshortened."""
    modes: int = 8
    """Of the base along the rim; higher ones are detail."""
    directions: int = 64
    """All around, in which pieces of detail lie."""
    piece: float = 0.66
    """rad: radius of a piece, about an eighth of the sphere."""
    off_centre: float = 0.26
    """rad: how far its source is from the visible middle."""
    unusual: float = 4.0
    """Times the median detail: a stem, a mark; no piece has it."""
    highlight: float = 0.35
    """Of log light: a smaller peak may be paint."""
    whiter: float = 0.6
    """Share of a peak that the strongest channel has, at most."""
    grown: int = 2
    """px around a highlight that belong to it."""
    seed: int = 7


TEXTURE = TextureConstants()


def part_highlights(skin: F32, inside: Mask, radius: float) -> F32:
    """Return the skin `(h, w, 3)` without peaks that are brighter and whiter than it.

    These are lamps and windows that the sphere reflects; they do not turn with it.
    """
    level = np.log(np.maximum(skin, 0) + np.float32(TEXTURE.dark))
    base = _blurred(level, inside, TEXTURE.smooth * radius)
    excess = level - base
    dimmest = skin.argmin(axis=2)[..., None]
    brightest = skin.argmax(axis=2)[..., None]
    rise = np.take_along_axis(excess, dimmest, axis=2)[..., 0]
    coloured_rise = np.take_along_axis(excess, brightest, axis=2)[..., 0]
    usual = float(np.median(np.abs(rise[inside]))) if inside.any() else 0.0
    least = max(TEXTURE.highlight, TEXTURE.unusual * usual)
    peaks = inside & (rise > least) & (coloured_rise < TEXTURE.whiter * rise)
    size = 2 * TEXTURE.grown + 1
    kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (size, size))
    hole = (cv2.dilate(peaks.astype(np.uint8), kernel) > 0) & inside
    if not hole.any():
        return skin
    plain = _blurred(level, inside & ~hole, TEXTURE.smooth * radius / 2)
    filled = np.where(hole[..., None], np.minimum(plain, level), level)
    return np.asarray(np.exp(filled) - np.float32(TEXTURE.dark), np.float32)


def continue_skin(skin: F32, center: Sequence[float], radius: float) -> list[F32]:
    """Return the near and the far side of a sphere in the equal-area projection.

    `skin` (h, w, 3) is linear light over shading as the photo shows it, `center` px in
    it. The projection is that of `atlas.equal_area`.
    """
    level = np.log(np.maximum(skin, 0) + np.float32(TEXTURE.dark))
    source = _Source.of(level, np.asarray(center, np.float64), radius)
    rows, columns = np.indices(skin.shape[:2])
    u = (columns - center[0]) / radius
    v = (rows - center[1]) / radius
    z = np.clip(1 - u * u - v * v, -1, 1)
    out = np.sqrt(1 + z)
    sides = []
    for side in (1.0, -1.0):
        points = np.dstack([out * u, out * v, side * z])
        picture = np.exp(source.level_at(points)) - np.float32(TEXTURE.dark)
        sides.append(np.asarray(np.maximum(picture, 0), np.float32))
    return sides


@dataclass(frozen=True)
class _Source:
    """What the photo shows of a sphere's skin, in logarithms."""

    level: F32
    """(h, w, 3)."""
    base: F32
    """(h, w, 3)."""
    detail: F32
    """(h, w, 4): with the weight of each pixel, 0 for what is unusual."""
    waves: NDArray[np.complex128]
    """(modes, 3) of the base along the rim."""
    center: Array
    radius: float

    @staticmethod
    def of(level: F32, center: Array, radius: float) -> _Source:
        rows, columns = np.indices(level.shape[:2])
        away = np.hypot(columns - center[0], rows - center[1]) / radius
        visible = away < TEXTURE.visible
        base = _blurred(level, visible, TEXTURE.smooth * radius)
        detail = level - base
        size = np.abs(detail).max(axis=2)
        usual = float(np.median(size[visible])) if visible.any() else 0.0
        unusual = visible & (size > TEXTURE.unusual * usual + 1e-6)
        reach = max(1.0, 0.03 * radius)
        spread = cv2.GaussianBlur(unusual.astype(np.float32), (0, 0), reach)
        weight = visible * np.clip(1 - 4 * spread, 0.02, 1)
        most = TEXTURE.unusual * usual
        tame = np.clip(detail, -most, most)
        turns = 2 * np.pi * np.arange(4 * TEXTURE.modes) / (4 * TEXTURE.modes)
        ring = center + TEXTURE.rim * radius * np.stack(
            [np.cos(turns), np.sin(turns)], axis=1
        )
        samples = _sampled(base, ring[None])[0]
        waves = np.fft.rfft(samples, axis=0)[: TEXTURE.modes] / len(turns)
        waves[1:] *= 2
        packed = np.dstack([tame, weight]).astype(np.float32)
        return _Source(level, base, packed, waves, center, radius)

    def level_at(self, points: Array) -> F32:
        """Return log light of points `(h, w, 3)` of the unit sphere."""
        away = np.hypot(points[..., 0], points[..., 1])
        front = points[..., 2] > 0
        outer = (TEXTURE.visible + TEXTURE.sure) / 2
        share = np.clip((outer - away) / (outer - TEXTURE.sure), 0, 1) * front
        share = share[..., None].astype(np.float32)
        places = self.center + self.radius * points[..., :2]
        shown = _sampled(self.level, places)
        continued = self._base_at(points) + self._detail_at(points)
        return np.asarray(share * shown + (1 - share) * continued, np.float32)

    def _base_at(self, points: Array) -> F32:
        x, y, z = np.moveaxis(points, 2, 0)
        away = np.hypot(x, y)
        edge = np.sqrt(1 - TEXTURE.rim**2)
        # radii about the hidden middle, 1 at the rim: there the base is harmonic
        inward = np.sqrt(np.clip((1 + z) / (1 + edge), 0, 1))
        turn = np.exp(1j * np.arctan2(y, x))
        hidden = np.zeros(points.shape)
        step = np.ones_like(turn)
        for wave in self.waves:
            hidden += (step[..., None] * wave).real
            step = step * turn * inward
        places = self.center + self.radius * points[..., :2]
        visible = (z > edge) & (away < TEXTURE.rim)
        shown = _sampled(self.base, places)
        return np.asarray(np.where(visible[..., None], shown, hidden), np.float32)

    def _detail_at(self, points: Array) -> F32:
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
            turned = points[box] @ turn.T
            piece = _sampled(self.detail, self.center + self.radius * turned[..., :2])
            angle = np.arccos(np.clip(cosine[box], -1, 1)) / TEXTURE.piece
            weight = piece[..., 3] * np.square(np.clip(1 - angle, 0, 1))
            weight = weight.astype(np.float32)
            total[box] += weight[..., None] * piece[..., :3]
            power[box] += weight * weight
        return np.asarray(total / np.sqrt(power)[..., None], np.float32)


def _pieces() -> list[tuple[Array, Array]]:
    """Return the middle `(3,)` of each piece and the rotation `(3, 3)` to its source."""
    random = np.random.default_rng(TEXTURE.seed)
    steps = np.arange(TEXTURE.directions) + 0.5
    height = 1 - 2 * steps / TEXTURE.directions
    turn = np.pi * (1 + 5**0.5) * steps
    across = np.sqrt(1 - height**2)
    middles = np.column_stack([across * np.cos(turn), across * np.sin(turn), height])
    pieces = []
    for middle in middles:
        to_front = _rotation_between(middle, np.array([0.0, 0.0, 1.0]))
        roll = cv2.Rodrigues(np.array([0, 0, random.uniform(0, 2 * np.pi)]))[0]
        way = random.uniform(0, 2 * np.pi)
        lean = TEXTURE.off_centre * random.uniform() ** 0.5
        shift = cv2.Rodrigues(lean * np.array([np.cos(way), np.sin(way), 0.0]))[0]
        pieces.append((middle, shift @ roll @ to_front))
    return pieces


def _rotation_between(start: Array, end: Array) -> Array:
    """Return the rotation `(3, 3)` by the shortest way between two unit vectors."""
    axis = np.cross(start, end)
    sine = float(np.linalg.norm(axis))
    angle = float(np.arctan2(sine, start @ end))
    if sine < 1e-9:
        axis, sine = np.array([1.0, 0.0, 0.0]), 1.0
    return np.asarray(cv2.Rodrigues(angle * axis / sine)[0], np.float64)


def _sampled(picture: F32, places: Array) -> F32:
    """Return values of a picture `(h, w, C)` at px `(..., 2)`, its edge beyond it."""
    x = places[..., 0].astype(np.float32)
    y = places[..., 1].astype(np.float32)
    values = cv2.remap(picture, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(values, np.float32)


def _blurred(level: F32, known: Mask, sigma: float) -> F32:
    """Return the local mean `(h, w, 3)` of the known pixels."""
    weight = known.astype(np.float32)
    near = cv2.GaussianBlur(weight, (0, 0), max(sigma, 1.0))
    total = cv2.GaussianBlur(level * weight[..., None], (0, 0), max(sigma, 1.0))
    usual = level[known].mean(axis=0) if known.any() else level.mean(axis=(0, 1))
    total += np.float32(1e-4) * usual
    return np.asarray(total / (near + np.float32(1e-4))[..., None], np.float32)
