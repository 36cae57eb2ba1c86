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
    narrow: int = 3


LIMITS = _Limits()


def replace_odd_pieces(
    labels: NDArray[np.int64], offsets: Offsets, photo: ReducedPhoto
) -> NDArray[np.int64]:
    """Return `labels` (h, w) with the guide in place of odd pieces.

    Where few sources remain, the least bad copy may be coarser than all of its
    surroundings, e.g. near boards among distant ones. There the guide is better.
    """
    guide = len(offsets)
    composed = _compose_texture(labels, offsets, photo)
    result = labels.copy()
    square = np.ones((LIMITS.narrow, LIMITS.narrow), np.uint8)
    for piece in _pieces(labels, guide):
        ring = (cv2.dilate(piece.view(np.uint8), np.ones((3, 3))) > 0) & ~piece
        if not (cv2.erode(piece.view(np.uint8), square).any() and ring.any()):
            continue
        own = np.median(composed[piece], axis=0)
        around = composed[ring]
        excess = (own - around).mean(axis=1)
        if (excess < LIMITS.coarser).mean() > LIMITS.like:
            continue
        usual = np.median(around, axis=0)
        guide_gap = np.abs(np.median(photo.texture[piece], axis=0) - usual).mean()
        if guide_gap < np.abs(own - usual).mean():
            result[piece] = guide
    return result


def _compose_texture(
    labels: NDArray[np.int64], offsets: Offsets, photo: ReducedPhoto
) -> F32:
    """Return the texture (h, w, c) that `labels` (h, w) copy."""
    composed = photo.texture.copy()
    rows, columns = np.nonzero((labels >= 0) & (labels < len(offsets)))
    down, right = offsets[labels[rows, columns]].T
    composed[rows, columns] = photo.texture[rows + down, columns + right]
    return composed


def _pieces(labels: NDArray[np.int64], guide: int) -> Iterator[Mask]:
    """Yield the connected pixels (h, w) of each label below `guide`."""
    for number in np.unique(labels[(labels >= 0) & (labels < guide)]):
        count, names = cv2.connectedComponents(
            (labels == number).astype(np.uint8), connectivity=4
        )
        for name in range(1, count):
            yield names == name
