"""A clip longer than the model sees at a time -> overlapping windows, and their predictions blended into one.

All windows take each step together, so that they agree where they overlap at every level of noise, and no joint shows
(MultiDiffusion, Bar-Tal et al. 2023, along time).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from math import ceil

import numpy as np
from numpy.typing import NDArray

F32 = NDArray[np.float32]
Span = tuple[int, int]
"""First latent frame, and the one behind the last."""


def spans(total: int, window: int, overlap: int, group: int = 1) -> list[Span]:
    """Windows of `window` latent frames that cover `total`, `overlap` of them shared by neighbours at least.

    All begin at multiples of `group`; `total` and `window` are such multiples.

    >>> spans(30, 16, 8)
    [(0, 16), (7, 23), (14, 30)]
    """
    if total <= window:
        return [(0, total)]
    total, window, overlap = total // group, window // group, min(overlap, window - group) // group
    count = 1 + ceil((total - window) / (window - overlap))
    starts = np.floor(np.linspace(0, total - window, count)).astype(int).tolist()
    return [(group * start, group * (start + window)) for start in starts]


def weights(span: Span, total: int) -> F32:
    """(last - first,): how much of a window's say counts: less towards an end that another window goes beyond.

    Not towards the clip's own ends: there a neighbour's first frame would count for a large share, all at once.

    >>> weights((2, 6), 8).tolist(), weights((0, 4), 8).tolist()
    ([1.0, 2.0, 2.0, 1.0], [4.0, 3.0, 2.0, 1.0])
    """
    first, last = span
    at = np.arange(first, last)
    rising = at - first + 1 if first else np.full(len(at), total)
    falling = last - at if last < total else np.full(len(at), total)
    return np.asarray(np.minimum(rising, falling), np.float32)


def blended(predict: Callable[[F32, int], F32], z: F32, windows: Sequence[Span]) -> F32:
    """(F', C, h, w): the mean of what `predict(z[first:last], first)` says in each window, by `weights`."""
    if len(windows) == 1:
        return predict(z, 0)
    total, sums = np.zeros_like(z), np.zeros((len(z), 1, 1, 1), np.float32)
    for first, last in windows:
        weight = weights((first, last), len(z))[:, None, None, None]
        total[first:last] += weight * predict(z[first:last], first)
        sums[first:last] += weight
    return total / sums
