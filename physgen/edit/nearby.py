"""What changes of a photo -> the part of it that is worked on: a correction costs what it touches."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from physgen.compile.reach import moved
from physgen.outline.outline import Outline
from physgen.outline.touching import fit_outlines

Window = tuple[slice, slice]
"""Rows and columns."""
U16 = NDArray[np.uint16]

AROUND = 128
"""px beside what changes that are looked at, at least; or half its size."""


def window(mask: NDArray[np.bool_]) -> Window:
    """Rows and columns of what a mask (H, W) holds, and of enough around it; all where it holds nothing."""
    rows, columns = (np.flatnonzero(mask.any(axis=axis)) for axis in (1, 0))
    if not len(rows):
        return slice(0, mask.shape[0]), slice(0, mask.shape[1])
    by = max(AROUND, int(rows[-1] - rows[0]) // 2, int(columns[-1] - columns[0]) // 2)
    return tuple(  # type: ignore[return-value]
        slice(max(0, int(held[0]) - by), min(side, int(held[-1]) + by + 1))
        for held, side in zip((rows, columns), mask.shape, strict=True)
    )


def corner(part: Window) -> NDArray[np.float64]:
    """(2,) px: x and y of its first pixel."""
    return np.array([part[1].start, part[0].start], np.float64)


def fitted(labels: U16, ids: Sequence[int]) -> dict[int, Outline]:
    """As `fit_outlines` of these ids alone, looking at no more of the photo (H, W) than they need."""
    table = np.zeros(2**16, np.bool_)
    table[list(ids)] = True
    part = window(table[labels])
    found = fit_outlines(labels[part], ids)
    return {i: moved(outline, corner(part)) for i, outline in found.items()}
