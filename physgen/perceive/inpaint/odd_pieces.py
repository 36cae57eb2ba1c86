"""Copied pieces whose texture is coarser than everything beside them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.maps import F32
from physgen.perceive.inpaint.copy_offsets import Offsets
from physgen.perceive.inpaint.offset_labels import ReducedPhoto
from physgen.perceive.roles import Mask


@dataclass(frozen=True)
class _Limits:
    """Limits of odd pieces, chosen on the tuning half of `benchmarks/fills.py`."""

    # Logarithm: least excess of a piece's squared differences, a factor of two.
    coarser: float = 0.7
    # Largest share of the pixels beside an odd piece with less excess.
    like: float = 0.1
    # px: narrower pieces may be edges rather than texture.
    least_width: int = 3


LIMITS = _Limits()


def replace_odd_pieces(
    labels: NDArray[np.int64], offsets: Offsets, photo: ReducedPhoto
) -> NDArray[np.int64]:
    """Return `labels` (h, w) with the guide in place of odd pieces.

    Where few sources remain, the least bad copy may be coarser than all of its
    surroundings, e.g. near boards among distant ones. There the guide is better.
    """
    guide = len(offsets)
    texture = _compose_texture(labels, offsets, photo)
    result = labels.copy()
    for piece in _pieces(labels, guide):
        if _is_odd(piece, texture, photo.texture):
            result[piece] = guide
    return result


def _is_odd(piece: Mask, composed: F32, guide: F32) -> bool:
    """Return whether a piece (h, w) is coarser than all around it in the texture
    `composed` (h, w, c), and more unlike it than the texture of the `guide` (h, w, c).
    """
    square = np.ones((LIMITS.least_width, LIMITS.least_width), np.uint8)
    ring = (cv2.dilate(piece.view(np.uint8), np.ones((3, 3))) > 0) & ~piece
    if not (cv2.erode(piece.view(np.uint8), square).any() and ring.any()):
        return False
    piece_texture, ring_texture = np.median(composed[piece], axis=0), composed[ring]
    excess = (piece_texture - ring_texture).mean(axis=1)
    if (excess < LIMITS.coarser).mean() > LIMITS.like:
        return False
    guide_texture = np.median(guide[piece], axis=0)
    gap, guide_gap = (
        float(np.abs(texture - np.median(ring_texture, axis=0)).mean())
        for texture in (piece_texture, guide_texture)
    )
    return guide_gap < gap


def _compose_texture(
    labels: NDArray[np.int64], offsets: Offsets, photo: ReducedPhoto
) -> F32:
    """Return the texture (h, w, c) that `labels` (h, w) copy."""
    texture = photo.texture.copy()
    rows, columns = np.nonzero((labels >= 0) & (labels < len(offsets)))
    down, right = offsets[labels[rows, columns]].T
    texture[rows, columns] = photo.texture[rows + down, columns + right]
    return texture


def _pieces(labels: NDArray[np.int64], guide: int) -> Iterator[Mask]:
    """Yield the connected pixels (h, w) of each label below `guide`."""
    for number in np.unique(labels[(labels >= 0) & (labels < guide)]):
        count, names = cv2.connectedComponents(
            (labels == number).astype(np.uint8), connectivity=4
        )
        for name in range(1, count):
            yield names == name
