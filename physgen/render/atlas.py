"""Pictures of about one size, side by side: one warp for all of them instead of one for each."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import ceil, log

import cv2
import numpy as np
from numpy.typing import NDArray

F32 = NDArray[np.float32]
Array = NDArray[np.float64]

GAP = 3
"""px of an atlas on each side of a picture, as far as Lanczos' kernel looks."""
PIXELS = 60_000
"""Of the pictures of an atlas; a single one may have more."""
WIDEST = 4_000
"""Half pixels along an atlas: the farther along, the coarser is a float of 32 bits."""
ALIKE = 1.3
"""Sizes that share an atlas are within this ratio."""


def shared(sizes: Sequence[tuple[int, int]]) -> list[list[int]]:
    """Which of some pictures, of so many columns and rows, go into each atlas."""
    alike: dict[int, list[int]] = {}
    for k, size in enumerate(sizes):
        alike.setdefault(ceil(log(max(*size, 1)) / log(ALIKE)), []).append(k)
    found = []
    for members in alike.values():
        side = max(max(sizes[k]) for k in members)
        most = max(1, min(PIXELS // side**2, WIDEST // (2 * side + 4 * GAP)))
        found += [members[first : first + most] for first in range(0, len(members), most)]
    return found


def laid(pictures: Sequence[F32], border: int) -> tuple[F32, Array]:
    """(H, W, ...) pictures in a row, and (n,) px of the first column of each; its row is GAP.

    Between them is what OpenCV's `border` says.
    """
    height = max(len(picture) for picture in pictures) + 2 * GAP
    row = [
        cv2.copyMakeBorder(picture, GAP, height - GAP - len(picture), GAP, GAP, border)
        for picture in pictures
    ]
    starts = np.cumsum([0] + [picture.shape[1] for picture in row[:-1]]) + GAP
    return np.ascontiguousarray(np.concatenate(row, axis=1), np.float32), starts.astype(np.float64)


@dataclass(frozen=True)
class Strip:
    """The grid on which some pictures are warped: `n` cells of (h, w) px side by side, `fine` samples a pixel."""

    n: int
    size: tuple[int, int]
    fine: int = 1

    def along(self, values: Array) -> F32:
        """(n,) -> one value for each column of the strip."""
        return np.repeat(values.astype(np.float32), self.size[1] * self.fine)

    @property
    def columns(self) -> F32:
        """(W,) px from the left of each cell."""
        return np.tile(self._steps(1), self.n)

    @property
    def rows(self) -> F32:
        """(H, 1) px from the top."""
        return self._steps(0)[:, None]

    def _steps(self, axis: int) -> F32:
        steps = np.arange(self.size[axis] * self.fine, dtype=np.float32) + np.float32(0.5 - self.fine / 2)
        return steps / np.float32(self.fine)

    def empty(self) -> F32:
        """(H, W) to be filled."""
        return np.empty((self.size[0] * self.fine, self.n * self.size[1] * self.fine), np.float32)


def warped(picture: F32, x: F32, y: F32) -> F32:
    """(h, w[, 4]) of a picture (H, W[, 4]) at px `x`, `y` (h, w)."""
    found = cv2.remap(picture, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT)
    return np.asarray(found, np.float32)
