"""Masks on their boxes -> run lengths as COCO has them: down the columns, background first (Lin et al., 2014).

Runs are found on the box alone; pycocotools makes characters of them.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from physgen.export.presence import Box

Mask = NDArray[np.bool_]


def run_lengths(mask: Mask, box: Box, size: tuple[int, int]) -> list[int]:
    """Counts of a mask (h, w) that lies on a `box` of a picture of `size` (W, H); they fill it.

    >>> run_lengths(np.array([[True, True], [False, True]]), (1, 0, 2, 2), (4, 3))
    [3, 1, 2, 2, 4]
    """
    left, top, width, height = box
    down = np.zeros((width, height + 2), bool)
    down[:, 1:-1] = mask.T
    # every column begins and ends outside: an odd change enters the body, an even one leaves it
    column, row = np.nonzero(down[:, 1:] != down[:, :-1])
    at = (left + column) * size[1] + top + row
    if height == size[1]:  # what leaves at a column's foot may go on at the next one's head
        again = np.flatnonzero(at[1:-1:2] == at[2::2]) * 2 + 1
        at = np.delete(at, np.concatenate([again, again + 1]))
    ends = [*at.tolist(), size[0] * size[1]]
    counts = [ends[0], *(end - start for start, end in pairwise(ends))]
    return counts if counts[-1] or len(counts) == 1 else counts[:-1]


def compressed(mask: Mask, box: Box, size: tuple[int, int]) -> str:
    """The same as COCO's characters; as `pycocotools.mask.encode` of the whole picture's mask."""
    from pycocotools import mask as coco

    width, height = size
    plain = {"size": [height, width], "counts": run_lengths(mask, box, size)}
    return str(coco.frPyObjects(plain, height, width)["counts"], "ascii")
