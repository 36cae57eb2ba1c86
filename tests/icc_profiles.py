"""ICC profiles as bytes, written by hand from the specification (ICC.1:2022): no reader of ours wrote them."""

from __future__ import annotations

import struct
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

P3 = (
    (0.51512, 0.24120, -0.00105),
    (0.29198, 0.69225, 0.04189),
    (0.15710, 0.06657, 0.78407),
)
ADOBE = (
    (0.60974, 0.31111, 0.01947),
    (0.20528, 0.62567, 0.06087),
    (0.14919, 0.06322, 0.74457),
)
SRGB = (
    (0.43607, 0.22249, 0.01392),
    (0.38515, 0.71687, 0.09708),
    (0.14307, 0.06061, 0.71410),
)
"""XYZ at D50 of red, green and blue, as Apple's, Adobe's and HP's profiles hold them."""
D50 = (0.9642, 1.0, 0.8249)


def s15(*values: float) -> bytes:
    return struct.pack(f">{len(values)}i", *(round(v * 65536) for v in values))


def xyz(value: Sequence[float]) -> bytes:
    return b"XYZ \0\0\0\0" + s15(*value)


def gamma(value: float) -> bytes:
    return b"curv\0\0\0\0" + struct.pack(">IH", 1, round(value * 256))


def table(values: NDArray[np.float64]) -> bytes:
    return b"curv\0\0\0\0" + struct.pack(
        f">I{len(values)}H", len(values), *np.round(values * 65535).astype(int)
    )


LINEAR = b"curv\0\0\0\0" + struct.pack(">I", 0)
SRGB_CURVE = (
    b"para\0\0\0\0"
    + struct.pack(">HH", 3, 0)
    + s15(2.4, 1 / 1.055, 0.055 / 1.055, 1 / 12.92, 0.04045)
)


def text(name: str) -> bytes:
    said = name.encode() + b"\0"
    return b"desc\0\0\0\0" + struct.pack(">I", len(said)) + said + bytes(78)


def profile(
    space: bytes, connects: bytes, kind: bytes, tags: dict[bytes, bytes]
) -> bytes:
    tags = {
        b"desc": text("by hand"),
        b"cprt": b"text\0\0\0\0none\0",
        b"wtpt": xyz(D50),
        **tags,
    }
    place = 128 + 4 + 12 * len(tags)
    rows, bodies = b"", b""
    for name, body in tags.items():
        body += bytes(-len(body) % 4)
        rows += struct.pack(">4sII", name, place + len(bodies), len(body))
        bodies += body
    size = place + len(bodies)
    head = struct.pack(
        ">I4sI4s4s4s", size, b"\0\0\0\0", 0x02400000, kind, space, connects
    )
    head += struct.pack(">6H", 2024, 1, 1, 0, 0, 0) + b"acsp" + bytes(28) + s15(*D50)
    return head.ljust(128, b"\0") + struct.pack(">I", len(tags)) + rows + bodies


def rgb(primaries: Sequence[Sequence[float]], curve: bytes) -> bytes:
    tags = {
        name: xyz(value)
        for name, value in zip((b"rXYZ", b"gXYZ", b"bXYZ"), primaries, strict=True)
    }
    return profile(
        b"RGB ",
        b"XYZ ",
        b"mntr",
        tags | dict.fromkeys((b"rTRC", b"gTRC", b"bTRC"), curve),
    )


def grey(curve: bytes) -> bytes:
    return profile(b"GRAY", b"XYZ ", b"mntr", {b"kTRC": curve})
