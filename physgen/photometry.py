"""sRGB <-> linear light, Lambert's law, and the light that explains a shading; numpy only."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

Float = NDArray[np.float32]


def decode(srgb: NDArray[Any]) -> Float:
    """sRGB -> linear light 0..1, float32 of the same shape (IEC 61966-2-1).

    uint8 goes through a table; floats are sRGB in 0..1.

    >>> float(decode(np.array(255, np.uint8)))
    1.0
    """
    if srgb.dtype == np.uint8:
        return np.asarray(_decode_table().take(srgb))
    return _decode(srgb.astype(np.float64)).astype(np.float32)


def encode(linear: NDArray[Any]) -> Float:
    """Linear light -> sRGB 0..1, float32; values outside 0..1 are cut."""
    v = np.clip(linear.astype(np.float64), 0.0, 1.0)
    return np.where(v <= 0.0031308, 12.92 * v, 1.055 * v ** (1 / 2.4) - 0.055).astype(
        np.float32
    )


def encode_u8(linear: NDArray[Any]) -> NDArray[np.uint8]:
    """Linear light 0..1 -> the nearest sRGB code, uint8; `encode_u8(decode(c)) == c` for all 256.

    A table of 2**16 entries: at most one code off the rounded exact curve, only at the border of two codes.
    """
    index = linear.astype(np.float32, copy=False) * np.float32(65535)
    index += np.float32(0.5)
    return np.asarray(_encode_table().take(index.astype(np.int64), mode="clip"))


def luminance(linear: NDArray[Any]) -> Float:
    """(..., 3) linear RGB -> (...) relative luminance (ITU-R BT.709)."""
    weights = np.array([0.2126, 0.7152, 0.0722], np.float32)
    return np.asarray(linear @ weights, np.float32)


def _decode(v: NDArray[Any]) -> NDArray[np.float64]:
    bent = ((np.maximum(v, 0.0) + 0.055) / 1.055) ** 2.4
    return np.asarray(np.where(v <= 0.04045, v / 12.92, bent))


@cache
def _decode_table() -> Float:
    table = _decode(np.arange(256) / 255.0).astype(np.float32)
    table.setflags(write=False)
    return table


@cache
def _encode_table() -> NDArray[np.uint8]:
    between = _decode((np.arange(255) + 0.5) / 255.0)
    table = np.searchsorted(between, np.arange(65536) / 65535.0, side="right").astype(
        np.uint8
    )
    table.setflags(write=False)
    return table


@dataclass(frozen=True)
class DistantLight:
    """One distant light and an even ambient one: shading = ambient + intensity max(0, n . direction)."""

    direction: tuple[float, float, float]
    """Unit, towards the light: +x right, +y down, +z to the viewer."""
    intensity: float
    ambient: float

    def shade(self, normals: NDArray[Any]) -> Float:
        """Lambert's law: unit normals `(..., 3)` -> shading `(...)`, linear."""
        facing = np.maximum(
            normals.astype(np.float32) @ np.array(self.direction, np.float32), 0.0
        )
        return np.asarray(
            np.float32(self.ambient) + np.float32(self.intensity) * facing, np.float32
        )


@dataclass(frozen=True)
class LightFit:
    """A light and how well it explains the samples."""

    light: DistantLight
    residual: float
    """Root mean square of the samples kept, linear."""
    explained: float
    """Share of the samples' weighted variance that the light explains, 0..1."""
    spread: float
    """Standard deviation of the normals along the direction in which they vary the least; a ball's is over 0.2."""


def fit_light(
    shading: NDArray[Any], normals: NDArray[Any], rounds: int = 12
) -> LightFit | None:
    """Directional and ambient light from `(N,)` linear shading and `(N, 3)` unit normals, in closed form.

    Where the light reaches, shading = a + b . n is linear in four unknowns. Reweighted least squares (Huber)
    bears with texture and highlights; samples turned away from the light found so far are in its shadow and
    tell only a. a and |b| are never negative. None for fewer than 16 samples or normals that span no volume.
    """
    s = shading.astype(np.float64).ravel()
    n = normals.astype(np.float64).reshape(-1, 3)
    if len(s) < 16:
        return None
    b, a, weight = np.array([0.0, 0.0, 1e-9]), 0.0, np.ones(len(s))
    lit = np.ones(len(s), bool)
    for _ in range(rounds):
        design = (
            np.column_stack([n * lit[:, None], np.ones(len(s))])
            * np.sqrt(weight)[:, None]
        )
        solution, _, rank, _ = np.linalg.lstsq(design, s * np.sqrt(weight), rcond=None)
        if rank < 4:
            return None
        b, a = solution[:3], float(solution[3])
        if (
            a < 0.0
        ):  # darker than no light at all: the best fit on the border of what is allowed
            a = 0.0
            b = np.linalg.lstsq(design[:, :3], s * np.sqrt(weight), rcond=None)[0]
        facing = n @ b
        error = np.abs(s - a - np.maximum(facing, 0.0))
        scale = 1.4826 * float(np.median(error)) + 1e-6
        weight = np.minimum(1.0, 1.345 * scale / np.maximum(error, 1e-12))
        lit = facing > 0.0
    intensity = float(np.linalg.norm(b))
    if intensity < 1e-9:
        direction = (0.0, 0.0, 1.0)
    else:
        x, y, z = (b / intensity).tolist()
        direction = (x, y, z)
    light = DistantLight(direction, intensity, a)
    rest = s - a - np.maximum(n @ b, 0.0)
    mean = float(np.average(s, weights=weight))
    spread = float(np.average((s - mean) ** 2, weights=weight))
    left = float(np.average(rest**2, weights=weight))
    explained = 1.0 - left / spread if spread > 1e-12 else float(left < 1e-9)
    normal_spread = float(np.sqrt(max(np.linalg.eigvalsh(np.cov(n.T))[0], 0.0)))
    return LightFit(
        light, float(np.sqrt(left)), float(np.clip(explained, 0.0, 1.0)), normal_spread
    )


def sphere_normals(
    height: int, width: int, center: tuple[float, float], radius: float
) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
    """Unit normals `(H, W, 3)` of a sphere seen from far, and where it is seen `(H, W)`."""
    x = (np.arange(width, dtype=np.float32) - center[0])[None, :] / radius
    y = (np.arange(height, dtype=np.float32) - center[1])[:, None] / radius
    z2 = 1.0 - x * x - y * y
    inside = z2 > 0.0
    z = np.sqrt(np.maximum(z2, 0.0))
    normals = np.stack([x + 0 * y, y + 0 * x, z], -1).astype(np.float32)
    normals[~inside] = (0.0, 0.0, 1.0)
    return normals, inside
