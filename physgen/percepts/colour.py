"""What the numbers of a picture mean -> sRGB: ICC profiles with a matrix or for grey, PNG's gamma and primaries.

Colours keep their place relative to white (relative colorimetric); what sRGB does not reach is cut, channel by channel.
Black is 0 in all these spaces, so black point compensation changes nothing in them.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.photometry import decode, encode_u8

F64 = NDArray[np.float64]
Curve = Callable[[F64], F64]
"""Stored values 0..1 -> linear light 0..1."""

D50 = (0.9642, 1.0, 0.8249)
"""XYZ of white where ICC profiles meet (ICC.1:2022, 7.2.16)."""
BRADFORD = np.array([[0.8951, 0.2664, -0.1614], [-0.7502, 1.7135, 0.0367], [0.0389, -0.0685, 1.0296]])
"""XYZ -> cone responses, in which one white is scaled to another (ICC.1:2022, annex E)."""
SRGB_PRIMARIES = (0.3127, 0.3290, 0.64, 0.33, 0.30, 0.60, 0.15, 0.06)
"""x, y of white, red, green and blue, in the order of PNG's cHRM (IEC 61966-2-1)."""
ADOBE_PRIMARIES = (0.3127, 0.3290, 0.64, 0.33, 0.21, 0.71, 0.15, 0.06)
ADOBE_GAMMA = 563 / 256
"""Adobe RGB (1998), 4.3."""
USUAL_GAMMA = (0.43, 0.48)
"""PNG writers store 1/2.2 = 0.45455 where they mean sRGB; what lies as near is taken for it."""
TABLES = (b"A2B0", b"A2B1", b"A2B2", b"D2B0", b"D2B1", b"D2B2")
"""Tags of a profile that only a colour engine reads."""


class ProfileError(Exception):
    """A profile that is damaged, or of tables, or not for these pixels."""


@dataclass(frozen=True, eq=False)
class Space:
    """A grey or RGB space: curves to linear light, then a matrix."""

    curves: tuple[Curve, ...]
    """One for grey, three for RGB."""
    matrix: F64 | None = None
    """(3, 3) linear light of the space -> linear light of sRGB; None: the same primaries."""

    @cached_property
    def is_srgb(self) -> bool:
        """Whether no colour of 8 bits moves by more than one level."""
        step = np.arange(0, 256, 15, dtype=np.uint8)
        if len(self.curves) == 1:
            colours = step[:, None, None]
        else:
            colours = np.stack(np.meshgrid(step, step, step), axis=-1).reshape(-1, 1, 3)
        moved = encode_u8(self.reader(256)(colours)).astype(int) - colours
        return bool(np.abs(moved).max() <= 1)

    def reader(self, codes: int) -> Callable[[NDArray[Any]], NDArray[np.float32]]:
        """A function of pixels (H, W, 1 or 3) of 0 .. codes - 1 -> (H, W, 3) linear light of sRGB.

        Grey pixels may stand in an RGB space.
        """
        with np.errstate(all="ignore"):  # a damaged profile bends without measure
            bent = [np.nan_to_num(curve(np.arange(codes) / (codes - 1)), posinf=1.0) for curve in self.curves]
        tables = [np.clip(light, 0.0, 1.0).astype(np.float32) for light in bent]

        def linear(pixels: NDArray[Any]) -> NDArray[np.float32]:
            light = np.empty((*pixels.shape[:2], 3), np.float32)
            for c in range(3):
                light[:, :, c] = tables[c % len(tables)][pixels[:, :, c % pixels.shape[2]]]
            return light if self.matrix is None else np.asarray(cv2.transform(light, self.matrix), np.float32)

        return linear


def power(gamma: float) -> Curve:
    """A pure power."""
    return lambda v: np.asarray(v**gamma)


def to_d50(primaries: Sequence[float]) -> F64:
    """(3, 3): linear RGB of `primaries` (x, y of white, red, green, blue) -> XYZ, white brought to D50."""
    xy = np.array(primaries, float).reshape(4, 2)
    white, red, green, blue = (np.array([x / y, 1.0, (1 - x - y) / y]) for x, y in xy)
    matrix = np.stack([red, green, blue], axis=1)
    matrix = matrix * np.linalg.solve(matrix, white)
    cones = np.diag((BRADFORD @ np.array(D50)) / (BRADFORD @ white))
    return np.asarray(np.linalg.solve(BRADFORD, cones @ BRADFORD @ matrix))


def from_d50() -> F64:
    """(3, 3): XYZ with white at D50 -> linear light of sRGB."""
    return np.asarray(np.linalg.inv(to_d50(SRGB_PRIMARIES)))


SRGB = Space((lambda v: decode(v).astype(np.float64),))


def adobe_rgb() -> Space:
    """What cameras mean by Adobe RGB, which many say in EXIF data alone."""
    return Space((power(ADOBE_GAMMA),) * 3, from_d50() @ to_d50(ADOBE_PRIMARIES))


def png_space(gamma: float | None, primaries: Sequence[float] | None) -> Space | None:
    """The space of a PNG by its gAMA (what the file's values are a power of) and cHRM chunks; None: nothing said.

    Without gAMA, cHRM says nothing that could be used.
    """
    if gamma is None or not 0.05 <= gamma <= 5:
        return None
    curve = SRGB.curves[0] if USUAL_GAMMA[0] < gamma < USUAL_GAMMA[1] else power(1 / gamma)
    if primaries is None or np.allclose(primaries, SRGB_PRIMARIES, atol=0.005):
        return Space((curve,) * 3)
    try:
        matrix = from_d50() @ to_d50(primaries)
    except (ZeroDivisionError, np.linalg.LinAlgError):
        return Space((curve,) * 3)
    return Space((curve,) * 3, matrix if np.isfinite(matrix).all() else None)


def icc_kind(profile: bytes) -> str:
    """The colours that a profile is of, `RGB`, `GRAY`, `CMYK`, ...; raises ProfileError for what is no profile."""
    if len(profile) < 132 or profile[36:40] != b"acsp":
        raise ProfileError
    return profile[16:20].decode("latin-1").strip()


def icc_space(profile: bytes) -> Space:
    """The space of a matrix profile, or of one for grey. Raises ProfileError for others (ICC.1:2022, 8.3 and 8.4)."""
    kind, connects = icc_kind(profile), profile[20:24]
    try:
        (count,) = struct.unpack_from(">I", profile, 128)
        rows = [struct.unpack_from(">4sII", profile, 132 + 12 * k) for k in range(min(count, 200))]
        tags: Mapping[bytes, bytes] = {name: profile[at : at + size] for name, at, size in rows}
        if any(name in tags for name in TABLES):
            raise ProfileError
        if kind == "GRAY":
            curve = _curve(tags[b"kTRC"])
            return Space((curve if connects == b"XYZ " else _lightness(curve),))
        if kind != "RGB" or connects != b"XYZ ":
            raise ProfileError
        matrix = np.stack([_xyz(tags[name]) for name in (b"rXYZ", b"gXYZ", b"bXYZ")], axis=1)
        curves = tuple(_curve(tags[name]) for name in (b"rTRC", b"gTRC", b"bTRC"))
    except (KeyError, struct.error, ValueError) as error:
        raise ProfileError from error
    return Space(curves, from_d50() @ matrix)


def _xyz(tag: bytes) -> F64:
    """`XYZType`."""
    return np.array(struct.unpack_from(">3i", tag, 8)) / 65536


def _curve(tag: bytes) -> Curve:
    """`curveType`: a power or a table; `parametricCurveType`: a power with a straight foot (10.6 and 10.18)."""
    kind, count = struct.unpack_from(">4s4xI", tag)
    if kind == b"curv":
        if count == 0:
            return power(1.0)
        if count == 1:
            return power(struct.unpack_from(">H", tag, 12)[0] / 256)
        table = np.array(struct.unpack_from(f">{count}H", tag, 12)) / 65535
        return lambda v: np.interp(v, np.linspace(0, 1, count), table)
    shape = count >> 16
    if kind != b"para" or shape > 4:
        raise ProfileError
    given = [value / 65536 for value in struct.unpack_from(f">{(1, 3, 4, 5, 7)[shape]}i", tag, 12)]
    g, a, b, c, d, e, f = given + [1.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0][len(given) :]
    if shape in (1, 2):  # (a v + b)^g + c from -b/a on, c before
        d, e, f, c = (-b / a if a else 0.0), c, c, 0.0

    def parametric(v: F64) -> F64:
        bent = np.maximum(a * v + b, 0.0) ** g + e
        return np.asarray(np.clip(np.where(v >= d, bent, c * v + f), 0.0, 1.0))

    return parametric


def _lightness(curve: Curve) -> Curve:
    """A curve to CIE lightness, 0..1 for L* = 0..100 -> one to linear light (ISO 11664-4)."""

    def light(v: F64) -> F64:
        f = (100 * curve(v) + 16) / 116
        return np.asarray(np.where(f > 6 / 29, f**3, 3 * (6 / 29) ** 2 * (f - 4 / 29)))

    return light
