"""Masks with confidences, and true masks -> which of the said ones are right: greedy, as COCO's evaluation does
it.

T.-Y. Lin et al., "Microsoft COCO: Common Objects in Context" (2014), and `pycocotools.cocoeval`, with which
tests compare. Masks may overlap; nothing here knows of label maps but `patches`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Mask = NDArray[np.bool_]
Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Patch:
    """A mask, kept as the cut-out that bounds it."""

    x: int
    y: int
    mask: Mask
    """(h, w), its top-left pixel at (x, y) of the photo."""

    @classmethod
    def of(cls, mask: Mask, x: int = 0, y: int = 0) -> Patch:
        """Of a mask (h, w) whose top-left pixel lies at (x, y); an empty one has no rows and columns."""
        rows, columns = np.flatnonzero(mask.any(1)), np.flatnonzero(mask.any(0))
        if not len(rows):
            return cls(x, y, np.zeros((0, 0), np.bool_))
        top, left = int(rows[0]), int(columns[0])
        return cls(x + left, y + top, mask[top : rows[-1] + 1, left : columns[-1] + 1].copy())

    @property
    def area(self) -> int:
        """px."""
        return int(np.count_nonzero(self.mask))

    @property
    def box(self) -> tuple[int, int, int, int]:
        """Left, top, right, bottom px; the last two just outside."""
        return self.x, self.y, self.x + self.mask.shape[1], self.y + self.mask.shape[0]

    def cut_by(self, size: tuple[int, int]) -> bool:
        """Whether it touches the border of a photo of `size` (W, H), which then probably cuts the object off."""
        left, top, right, bottom = self.box
        return bool(self.mask.size) and (left <= 0 or top <= 0 or right >= size[0] or bottom >= size[1])

    def part(self, where: Mask) -> Mask:
        """(h, w): the pixels of a whole photo's `where` (H, W) below the cut-out."""
        left, top, right, bottom = self.box
        return where[top:bottom, left:right]


def patches(labels: NDArray[np.integer]) -> dict[int, Patch]:
    """The mask of every id above 0 of a label map (H, W), by id."""
    height, width = labels.shape
    rows, columns = np.nonzero(labels)
    ids = labels[rows, columns]
    found: dict[int, Patch] = {}
    known, inverse = np.unique(ids, return_inverse=True)
    low = np.full((len(known), 2), max(height, width))
    high = np.zeros((len(known), 2), np.int64)
    for axis, values in enumerate((columns, rows)):
        np.minimum.at(low[:, axis], inverse, values)
        np.maximum.at(high[:, axis], inverse, values)
    for i, (x, y), (right, bottom) in zip(known.tolist(), low.tolist(), high.tolist(), strict=True):
        found[i] = Patch(x, y, labels[y : bottom + 1, x : right + 1] == i)
    return found


def shared(a: Patch, b: Patch) -> int:
    """Pixels that two masks share."""
    left, top = max(a.x, b.x), max(a.y, b.y)
    right, bottom = min(a.box[2], b.box[2]), min(a.box[3], b.box[3])
    if right <= left or bottom <= top:
        return 0
    one = a.mask[top - a.y : bottom - a.y, left - a.x : right - a.x]
    other = b.mask[top - b.y : bottom - b.y, left - b.x : right - b.x]
    return int(np.count_nonzero(one & other))


def overlaps(said: Sequence[Patch], true: Sequence[Patch]) -> Floats:
    """(N, M): intersection over union of each said with each true mask; 0 where both are empty."""
    result = np.zeros((len(said), len(true)))
    said_areas, true_areas = [one.area for one in said], [one.area for one in true]
    for i, one in enumerate(said):
        for j, other in enumerate(true):
            common = shared(one, other)
            if common:
                result[i, j] = common / (said_areas[i] + true_areas[j] - common)
    return result


@dataclass(frozen=True, eq=False)
class Judged:
    """What became of one photo's masks at one threshold of overlap."""

    confidence: Floats
    """(N,), as said."""
    match: NDArray[np.int64]
    """(N,): the true mask that each is matched with; -1 for none."""
    counted: Mask
    """(N,): false for what is matched with an ignored true mask: neither right nor false."""
    overlap: Floats
    """(N,): IoU with the match; 0 without."""
    ignored: Mask
    """(M,): true masks that may be found or missed without harm."""

    @property
    def right(self) -> Mask:
        """(N,): which are matched and counted."""
        return self.counted & (self.match >= 0)

    @property
    def missed(self) -> list[int]:
        """True masks, not ignored ones, that nothing is matched with."""
        found = set(self.match.tolist())
        return [j for j, out in enumerate(self.ignored.tolist()) if not out and j not in found]


def judge(overlap: Floats, confidence: Floats, ignored: Mask, threshold: float = 0.5) -> Judged:
    """Match masks by falling confidence, each with the true mask of largest `overlap` (N, M) that is still free.

    At `threshold` or above; a true mask that counts goes before an ignored one (M,); of equals the last one wins,
    and of equal confidences the first one chooses, as in COCO. Without crowds: every true mask is matched once.
    """
    said, true = overlap.shape
    match = np.full(said, -1, np.int64)
    counted, free = np.ones(said, np.bool_), np.ones(true, np.bool_)
    least = min(threshold, 1 - 1e-10)
    for i in np.argsort(-confidence, kind="stable").tolist():
        for group in (free & ~ignored, free & ignored):
            near = np.flatnonzero(group & (overlap[i] >= least))
            if len(near):
                best = overlap[i, near]
                j = int(near[len(near) - 1 - int(best[::-1].argmax())])
                match[i], free[j], counted[i] = j, False, not ignored[j]
                break
    achieved = np.where(match >= 0, overlap[np.arange(said), match] if true else 0.0, 0.0)
    return Judged(np.asarray(confidence, np.float64), match, counted, achieved, ignored)
