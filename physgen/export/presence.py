"""Covers and ids of a picture -> where each body is in it: all of it, and what is seen."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.render.stage import Cover

Mask = NDArray[np.bool_]
Box = tuple[int, int, int, int]
"""The first column and row, and how many of them."""


@dataclass(frozen=True)
class Presence:
    """One body that reaches into a picture."""

    body: int
    box: Box
    """The least that holds all of it that is in the picture."""
    whole: Mask
    """(h, w) on the box: what hides it taken away."""
    seen: Mask
    """(h, w) on the box: what nothing hides."""

    @cached_property
    def whole_area(self) -> int:
        """px²."""
        return int(np.count_nonzero(self.whole))

    @cached_property
    def seen_area(self) -> int:
        """px²; 0 where it is hidden altogether."""
        return int(np.count_nonzero(self.seen))

    @property
    def visible(self) -> float:
        """Share of what is in the picture that nothing hides, 0..1."""
        return self.seen_area / self.whole_area

    @cached_property
    def seen_box(self) -> Box:
        """The least that holds what is seen; its sides are 0 where nothing is."""
        if self.seen_area == self.whole_area:
            return self.box
        x, y, w, h = _least(self.seen)
        return self.box[0] + x, self.box[1] + y, w, h


def presences(covers: Iterable[Cover], ids: NDArray[np.uint16]) -> list[Presence]:
    """Of the bodies that `covers` name, in their order; those that cover no pixel are none.

    What is seen of a body belongs to it in any case.
    """
    parts: dict[int, list[Cover]] = {}
    for cover in covers:
        if cover.mask.size:
            parts.setdefault(cover.body, []).append(cover)
    found = []
    for body, some in sorted(parts.items()):
        (rows, columns), mask = joined(some)
        seen = ids[rows, columns] == body + 1
        whole = mask | seen
        x, y, w, h = _least(whole)
        if w:
            own = np.s_[y : y + h, x : x + w]
            found.append(Presence(body, (columns.start + x, rows.start + y, w, h), whole[own], seen[own]))
    return found


def joined(covers: Sequence[Cover]) -> tuple[tuple[slice, slice], Mask]:
    """One box and mask (h, w) of all of them."""
    if len(covers) == 1:
        return covers[0].box, covers[0].mask
    rows, columns = (
        slice(min(c.box[axis].start for c in covers), max(c.box[axis].stop for c in covers))
        for axis in (0, 1)
    )
    mask = np.zeros((rows.stop - rows.start, columns.stop - columns.start), bool)
    for (down, along), own in ((cover.box, cover.mask) for cover in covers):
        mask[
            down.start - rows.start : down.stop - rows.start,
            along.start - columns.start : along.stop - columns.start,
        ] |= own
    return (rows, columns), mask


def _least(mask: Mask) -> Box:
    x, y, w, h = cv2.boundingRect(mask.view(np.uint8))
    return x, y, w, h
