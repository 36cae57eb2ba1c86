"""How spheres on a table have turned in space: rotation vectors of many steps -> quaternions after each.

Quaternions are (w, x, y, z), unit, of the turn since t = 0 about the image axes, +z into the photo (right hand).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def turn(vector: Array) -> Array:
    """Rotation vectors (..., 3) rad -> quaternions (..., 4)."""
    half = vector / 2
    angle = np.sqrt((half**2).sum(axis=-1, keepdims=True))
    return np.concatenate([np.cos(angle), half * np.sinc(angle / np.pi)], axis=-1)


def after(later: Array, earlier: Array) -> Array:
    """The quaternions (..., 4) of turning by `earlier`, then by `later` (Hamilton's product)."""
    a, b = np.moveaxis(later, -1, 0), np.moveaxis(earlier, -1, 0)
    return np.stack(
        [
            a[0] * b[0] - a[1] * b[1] - a[2] * b[2] - a[3] * b[3],
            a[0] * b[1] + a[1] * b[0] + a[2] * b[3] - a[3] * b[2],
            a[0] * b[2] - a[1] * b[3] + a[2] * b[0] + a[3] * b[1],
            a[0] * b[3] + a[1] * b[2] - a[2] * b[1] + a[3] * b[0],
        ],
        axis=-1,
    )


def running(vectors: Array, start: Array) -> Array:
    """(S, N, 4) quaternions after each of S steps of rotation vectors (S, N, 3), begun at (N, 4).

    Products of neighbours, then of neighbours' neighbours (Hillis and Steele, Commun. ACM 29, 1170, 1986): as many
    passes as S has binary digits.
    """
    done = turn(vectors)
    reach = 1
    while reach < len(done):
        done = np.concatenate([done[:reach], after(done[reach:], done[:-reach])])
        reach *= 2
    done = after(done, np.broadcast_to(start, done.shape))
    return np.asarray(done / np.sqrt((done**2).sum(axis=-1, keepdims=True)))


def matrix(quaternion: Array) -> Array:
    """(..., 4) -> rotation matrices (..., 3, 3) about the image axes, +z into the photo."""
    w, x, y, z = np.moveaxis(quaternion, -1, 0)
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)
