"""sRGB and linear light, Lambert's law, and the light that explains a shading."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.arrays import F32, F64, U8, Mask


def decode(srgb: NDArray[Any]) -> F32:
    """Convert sRGB to linear light 0..1, float32 of the same shape (IEC 61966-2-1).

    uint8 goes through a table; floats are sRGB in 0..1.

    >>> float(decode(np.array(255, np.uint8)))
    1.0
    """
    if srgb.dtype == np.uint8:
        # OpenCV takes a fifth of the time of NumPy's `take`, but refuses empty arrays.
        if not srgb.size:
            return np.empty(srgb.shape, np.float32)
        light = cv2.LUT(srgb.reshape(-1, 1), _decode_table())
        return np.asarray(light, np.float32).reshape(srgb.shape)
    return _decode(srgb.astype(np.float64)).astype(np.float32)


def encode(linear: NDArray[Any]) -> F32:
    """Convert linear light to sRGB 0..1, float32; values outside 0..1 are cut."""
    light = np.clip(linear.astype(np.float64), 0.0, 1.0)
    bent = 1.055 * light ** (1 / 2.4) - 0.055
    return np.where(light <= 0.0031308, 12.92 * light, bent).astype(np.float32)


def encode_u8(linear: NDArray[Any]) -> U8:
    """Convert linear light 0..1 to the nearest sRGB code; `encode_u8(decode(c)) == c` for all 256.

    A table of 2**16 entries: at most one code off the rounded exact curve, only at the border of two codes.
    """
    index = linear.astype(np.float32, copy=False) * np.float32(65535)
    index += np.float32(0.5)
    return np.asarray(_encode_table().take(index.astype(np.int64), mode="clip"))


def largest_channel(picture: NDArray[Any]) -> NDArray[Any]:
    """Return the largest channel (...) of each pixel of a picture (..., C).

    NumPy's `max` over a short last axis takes three to seven times as long.
    """
    largest = picture[..., 0].copy()
    for channel in range(1, picture.shape[-1]):
        np.maximum(largest, picture[..., channel], out=largest)
    return largest


def channel_sum(picture: NDArray[Any]) -> NDArray[Any]:
    """Return the sum (...) of the channels of each pixel of a picture (..., C) of floats.

    The order of additions is that of NumPy's `sum`, which takes several times as long.
    """
    total = picture[..., 0].copy()
    for channel in range(1, picture.shape[-1]):
        total += picture[..., channel]
    return total


def channel_mean(picture: NDArray[Any]) -> NDArray[Any]:
    """Return the mean (...) of the channels of a picture (..., C) of floats."""
    total = channel_sum(picture)
    total /= picture.shape[-1]
    return total


def luminance(linear: NDArray[Any]) -> F32:
    """Return the relative luminance (...) of linear RGB (..., 3) (ITU-R BT.709)."""
    weights = np.array([0.2126, 0.7152, 0.0722], np.float32)
    return np.asarray(linear @ weights, np.float32)


def _decode(srgb: NDArray[Any]) -> F64:
    bent = ((np.maximum(srgb, 0.0) + 0.055) / 1.055) ** 2.4
    return np.asarray(np.where(srgb <= 0.04045, srgb / 12.92, bent))


@cache
def _decode_table() -> F32:
    table = _decode(np.arange(256) / 255.0).astype(np.float32)
    table.setflags(write=False)
    return table


@cache
def _encode_table() -> U8:
    borders = _decode((np.arange(255) + 0.5) / 255.0)
    light = np.arange(65536) / 65535.0
    table = np.searchsorted(borders, light, side="right").astype(np.uint8)
    table.setflags(write=False)
    return table


SOFT_LIGHT = 0.1
"""Direct over ambient light below which a light is soft."""


@dataclass(frozen=True)
class DistantLight:
    """One distant light and an even ambient one: shading = ambient + intensity max(0, n . direction)."""

    direction: tuple[float, float, float]
    """Unit, towards the light: +x right, +y down, +z to the viewer."""
    intensity: float
    ambient: float

    @property
    def is_soft(self) -> bool:
        """Return whether it has hardly a direction: geometry predicts few shadows."""
        return self.intensity < SOFT_LIGHT * self.ambient

    def shade(self, normals: NDArray[Any]) -> F32:
        """Return the shading `(...)`, linear, of unit normals `(..., 3)` by Lambert's law."""
        direction = np.array(self.direction, np.float32)
        facing = np.maximum(normals.astype(np.float32) @ direction, 0.0)
        shading = np.float32(self.ambient) + np.float32(self.intensity) * facing
        return np.asarray(shading, np.float32)


@dataclass(frozen=True)
class LightFit:
    """A light and how well it explains the samples."""

    light: DistantLight
    residual: float
    """Root mean square of the samples kept, linear."""
    explained: float
    """Share of the samples' weighted variance that the light explains, 0..1."""
    spread: float
    """Standard deviation of the normals along the direction in which they vary the least.

    A ball's is over 0.2.
    """


LEAST_SAMPLES = 16
"""Samples below which no light is fitted."""
HUBER = 1.345
"""Huber's constant, in standard deviations: 95 % efficient for normal errors."""
MAD_TO_DEVIATION = 1.4826
"""Standard deviation of a normal distribution, in median absolute deviations."""


def fit_light(
    shading: NDArray[Any], normals: NDArray[Any], rounds: int = 12
) -> LightFit | None:
    """Fit a directional and an ambient light to `(N,)` linear shading and `(N, 3)` unit normals, in closed form.

    On lit samples, shading = a + b . n is linear in four unknowns. Reweighted least squares (Huber) is robust
    to texture and highlights; samples that face away from the light of the last round determine only a. a and
    |b| are never negative. None for fewer than 16 samples or normals that span no volume.
    """
    values = shading.astype(np.float64).ravel()
    directions = normals.astype(np.float64).reshape(-1, 3)
    count = len(values)
    if count < LEAST_SAMPLES:
        return None
    slope, ambient = np.array([0.0, 0.0, 1e-9]), 0.0
    weights = np.ones(count)
    is_lit = np.ones(count, bool)
    for _ in range(rounds):
        solution = _solve_light(values, directions, is_lit, np.sqrt(weights))
        if solution is None:
            return None
        slope, ambient = solution
        facing = directions @ slope
        errors = np.abs(values - ambient - np.maximum(facing, 0.0))
        scale = MAD_TO_DEVIATION * float(np.median(errors)) + 1e-6
        weights = np.minimum(1.0, HUBER * scale / np.maximum(errors, 1e-12))
        is_lit = facing > 0.0
    residuals = values - ambient - np.maximum(directions @ slope, 0.0)
    mean_square = float(np.average(residuals**2, weights=weights))
    explained = _explained_share(values, weights, mean_square)
    least_variance = max(np.linalg.eigvalsh(np.cov(directions.T))[0], 0.0)
    return LightFit(
        _light_of(slope, ambient),
        float(np.sqrt(mean_square)),
        float(np.clip(explained, 0.0, 1.0)),
        float(np.sqrt(least_variance)),
    )


def _solve_light(
    values: F64, directions: F64, is_lit: Mask, root_weights: F64
) -> tuple[F64, float] | None:
    """Return b and a of one round of `fit_light`; None if the normals span no volume."""
    columns = [directions * is_lit[:, None], np.ones(len(values))]
    design = np.column_stack(columns) * root_weights[:, None]
    target = values * root_weights
    solution, _, rank, _ = np.linalg.lstsq(design, target, rcond=None)
    if rank < 4:
        return None
    slope, ambient = np.asarray(solution[:3], np.float64), float(solution[3])
    if ambient < 0.0:
        # Ambient light is not negative: the best fit lies on the border, at 0.
        ambient = 0.0
        solution = np.linalg.lstsq(design[:, :3], target, rcond=None)[0]
        slope = np.asarray(solution, np.float64)
    return slope, ambient


def _light_of(slope: F64, ambient: float) -> DistantLight:
    intensity = float(np.linalg.norm(slope))
    direction = (0.0, 0.0, 1.0)
    if intensity >= 1e-9:
        x, y, z = (slope / intensity).tolist()
        direction = (x, y, z)
    return DistantLight(direction, intensity, ambient)


def _explained_share(values: F64, weights: F64, mean_square: float) -> float:
    """Return the share of the weighted variance that a fit with this mean square residual explains."""
    mean = float(np.average(values, weights=weights))
    variance = float(np.average((values - mean) ** 2, weights=weights))
    if variance > 1e-12:
        return 1.0 - mean_square / variance
    return float(mean_square < 1e-9)


def sphere_normals(
    height: int, width: int, center: tuple[float, float], radius: float
) -> tuple[F32, Mask]:
    """Return unit normals `(H, W, 3)` of a sphere in orthographic projection, and its visible pixels `(H, W)`."""
    x = (np.arange(width, dtype=np.float32) - center[0])[None, :] / radius
    y = (np.arange(height, dtype=np.float32) - center[1])[:, None] / radius
    z_squared = 1.0 - x * x - y * y
    visible = z_squared > 0.0
    z = np.sqrt(np.maximum(z_squared, 0.0))
    normals = np.stack([x + 0 * y, y + 0 * x, z], -1).astype(np.float32)
    normals[~visible] = (0.0, 0.0, 1.0)
    return normals, visible
