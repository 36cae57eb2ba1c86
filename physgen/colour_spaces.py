"""Colour spaces that are given by primaries and a transfer function, and their conversion to sRGB.

Code points are those of ITU-T H.273, which PNG's cICP chunk and the colour boxes of HEIF and AVIF contain.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from physgen.arrays import F32, F64, U8
from physgen.photometry import decode, encode_u8

Curve = Callable[[F64], F64]
"""Stored values 0..1 -> linear light 0..1."""
Chromaticity = tuple[float, float]
"""CIE 1931 x, y."""

D65 = (0.3127, 0.3290)
ILLUMINANT_C = (0.310, 0.316)
BRADFORD = np.array(
    [
        [0.8951, 0.2664, -0.1614],
        [-0.7502, 1.7135, 0.0367],
        [0.0389, -0.0685, 1.0296],
    ]
)
"""XYZ -> the cone responses in which white points are adapted (ICC.1:2022, Annex E)."""
SRGB_GAMMA = 1 / 2.2
"""The gAMA value that files with sRGB's curve contain (PNG, section 11.3.2.5)."""
GAMMA_TOLERANCE = 0.05
"""Relative difference from `SRGB_GAMMA` below which libpng takes the curve for sRGB's, too."""
NARROW_BLACK, NARROW_SPAN = 16, 219
"""Black, and the distance from black to white, of narrow-range values of 8 bits (H.273, section 8.3)."""


@dataclass(frozen=True)
class Primaries:
    """Chromaticities of the three primaries and of white."""

    red: Chromaticity
    green: Chromaticity
    blue: Chromaticity
    white: Chromaticity = D65

    def matrix_to_xyz(self) -> F64:
        """Return the matrix (3, 3) from linear RGB to XYZ, whose white has Y = 1.

        Raises numpy.linalg.LinAlgError if the primaries span no area.
        """
        columns = list(map(_xyz, (self.red, self.green, self.blue)))
        primaries = np.stack(columns, axis=1)
        scale = np.linalg.solve(primaries, _xyz(self.white))
        return np.asarray(primaries * scale, np.float64)


def _xyz(point: Chromaticity) -> F64:
    """Return XYZ of a chromaticity, with Y = 1, or X + Y + Z = 1 for a point without luminance."""
    x, y = point
    xyz = np.array([x, y, 1 - x - y])
    return xyz / y if y > 0 else xyz


SRGB = Primaries((0.64, 0.33), (0.30, 0.60), (0.15, 0.06))
_SMPTE_170M = Primaries((0.630, 0.340), (0.310, 0.595), (0.155, 0.070))
PRIMARIES = {
    1: SRGB,
    4: Primaries((0.67, 0.33), (0.21, 0.71), (0.14, 0.08), ILLUMINANT_C),
    5: Primaries((0.64, 0.33), (0.29, 0.60), (0.15, 0.06)),
    6: _SMPTE_170M,
    7: _SMPTE_170M,
    8: Primaries((0.681, 0.319), (0.243, 0.692), (0.145, 0.049), ILLUMINANT_C),
    9: Primaries((0.708, 0.292), (0.170, 0.797), (0.131, 0.046)),
    10: Primaries((1.0, 0.0), (0.0, 1.0), (0.0, 0.0), (1 / 3, 1 / 3)),
    11: Primaries((0.680, 0.320), (0.265, 0.690), (0.150, 0.060), (0.314, 0.351)),
    12: Primaries((0.680, 0.320), (0.265, 0.690), (0.150, 0.060)),
    22: Primaries((0.630, 0.340), (0.295, 0.605), (0.155, 0.077)),
}
"""H.273, table 2: 1 is BT.709, 9 BT.2020, 11 DCI-P3, 12 Display P3."""


def _decode_srgb(values: F64) -> F64:
    return np.asarray(decode(values), np.float64)


def power_curve(exponent: float) -> Curve:
    """Return the curve light = value ** exponent."""
    return lambda values: np.asarray(values**exponent)


def _decode_bt709(values: F64) -> F64:
    """Invert the curve of a BT.709 camera (H.273, table 3)."""
    alpha, beta = 1.099296826809442, 0.018053968510807
    bent = ((values + alpha - 1) / alpha) ** (1 / 0.45)
    return np.where(values < 4.5 * beta, values / 4.5, bent)


def _decode_smpte240(values: F64) -> F64:
    """Invert the curve of SMPTE ST 240 (H.273, table 3)."""
    bent = ((values + 0.1115) / 1.1115) ** (1 / 0.45)
    return np.where(values < 4 * 0.0228, values / 4, bent)


CURVES: dict[int, Curve] = {
    1: _decode_bt709,
    4: power_curve(2.2),
    5: power_curve(2.8),
    6: _decode_bt709,
    7: _decode_smpte240,
    8: power_curve(1.0),
    13: _decode_srgb,
    14: _decode_bt709,
    15: _decode_bt709,
}
"""H.273, table 3, without logarithmic curves, extended ranges and high dynamic range."""
SRGB_PRIMARIES_CODE, SRGB_CURVE_CODE, UNSPECIFIED_CODE = 1, 13, 2
CAMERA_CURVES = (1, 6, 14, 15)
"""Curves of cameras: BT.709, BT.601, and BT.2020 of 10 and 12 bits."""
HDR_TRANSFERS = (16, 18)
"""PQ and HLG (H.273, table 3)."""


class ColourError(Exception):
    """A description of colours that cannot be used."""


class HighDynamicRangeError(ColourError):
    """The picture has a high dynamic range, which needs tone mapping."""


@dataclass(frozen=True)
class ColourSpace:
    """An RGB colour space; grey pictures use its curve alone."""

    primaries: Primaries
    curve: Curve
    is_full_range: bool = True
    """Whether black and white are the least and the greatest number; else as in video."""

    @cached_property
    def _matrix(self) -> F64:
        """Return the matrix (3, 3) from linear RGB to linear sRGB, white to white.

        Raises ColourError for impossible primaries.
        """
        try:
            white, target = _xyz(self.primaries.white), _xyz(D65)
            cones = np.diag((BRADFORD @ target) / (BRADFORD @ white))
            adapt = np.linalg.inv(BRADFORD) @ cones @ BRADFORD
            to_srgb = np.linalg.inv(SRGB.matrix_to_xyz())
            matrix = np.asarray(to_srgb @ adapt @ self.primaries.matrix_to_xyz())
        except np.linalg.LinAlgError:
            raise ColourError from None
        if not np.isfinite(matrix).all():
            raise ColourError
        return matrix

    def check(self) -> None:
        """Raise ColourError for impossible primaries."""
        _ = self._matrix

    def to_srgb(self, levels: NDArray[Any]) -> U8:
        """Convert stored numbers (H, W, 1 or 3) of 8 or 16 bits to (H, W, 3) sRGB.

        Other colours are clipped.
        """
        light = self._light_table(levels.dtype)[levels]
        if levels.shape[2] == 1:
            return np.repeat(encode_u8(light), 3, axis=2)
        return encode_u8(light @ self._matrix.T.astype(np.float32))

    def _light_table(self, dtype: np.dtype[Any]) -> F32:
        """Return linear light by stored number."""
        most = np.iinfo(dtype).max
        values = np.arange(most + 1, dtype=np.float64)
        if self.is_full_range:
            values /= most
        else:
            unit = (most + 1) / 256
            values = (values / unit - NARROW_BLACK) / NARROW_SPAN
        return self.curve(np.clip(values, 0, 1)).astype(np.float32)


def coded_space(
    primaries: int, transfer: int, is_full_range: bool = True
) -> ColourSpace:
    """Return the space of H.273's code points.

    Raises ColourError for unknown ones, HighDynamicRangeError for PQ and HLG.
    """
    if transfer in HDR_TRANSFERS:
        raise HighDynamicRangeError
    if primaries not in PRIMARIES or transfer not in CURVES:
        raise ColourError
    return ColourSpace(PRIMARIES[primaries], CURVES[transfer], is_full_range)


def measured_space(
    gamma: float | None, chromaticities: tuple[float, ...] | None
) -> ColourSpace:
    """Return the space of PNG's gAMA, and of cHRM: x and y of white, red, green and blue.

    A missing chunk means sRGB's curve or primaries. Raises ColourError for impossible values.
    """
    curve: Curve = _decode_srgb
    if gamma and abs(gamma / SRGB_GAMMA - 1) > GAMMA_TOLERANCE:
        curve = power_curve(1 / gamma)
    if chromaticities is None:
        return ColourSpace(SRGB, curve)
    if len(chromaticities) != 8:
        raise ColourError
    white, red, green, blue = zip(
        chromaticities[::2], chromaticities[1::2], strict=True
    )
    if min(white) <= 0:
        raise ColourError
    space = ColourSpace(Primaries(red, green, blue, white), curve)
    space.check()
    return space
