"""Clean-up of overlapping model masks: one mask for each object, each pixel in at most one of them."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TypeVar

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.perceive.roles import Doubt, Name, Scenery, Segments

Mask = NDArray[np.bool_]
"""(H, W)."""
T = TypeVar("T", bound=np.generic)
Box = tuple[float, float, float, float]
"""Left, top, right, bottom px; 0 and the photo's width are its borders."""
CONFIDENT = 0.25
"""Confidence from which a mask is an object."""
DOUBTFUL = 0.1
"""Confidence from which a mask is a doubtful object."""


@dataclass(frozen=True)
class CleanUp:
    """Constants of the clean-up; shares and IoU were chosen on the studio's photos."""

    same_box: float = 0.8
    """IoU from which two boxes mean one object."""
    same_mask: float = 0.7
    """IoU from which two masks mean one object."""
    inside: float = 0.8
    """Share of a mask within another, from which it is inside."""
    least_share: float = 0.0002
    """Of the photo: smaller masks are dropped."""
    least_area: int = 32
    """px: smaller masks are dropped."""
    hole: float = 0.005
    """Of a mask: smaller holes are closed."""
    speck: float = 0.02
    """Of a mask's largest piece: smaller pieces are dropped."""
    part: float = 0.1
    """Of a mask's largest piece: larger pieces are objects of their own."""
    parts: int = 8
    """Pieces of a mask, at most."""
    visible: float = 0.2
    """Share of an object that others in front must leave; less is a heap, seen between its members."""
    rival: float = 0.5
    """Ratio of confidences from which a smaller object lies in front of a larger one."""
    doubts: int = 8
    """Doubtful objects at most."""
    straight: float = 0.01
    """Of an outline's length: tolerance of a doubtful object's polygon."""


CLEANUP = CleanUp()


@dataclass(frozen=True, eq=False)
class Cut:
    """One mask with its noun, kept as its window: many masks of a large photo would fill the memory."""

    piece: Mask
    """(h, w): the window's."""
    x: int
    y: int
    """Column and row of the window's first pixel."""
    noun: str
    movable: bool
    score: float
    """0..1, that there is such an object."""
    fit: float
    """0..1: the IoU of the mask that the model expects."""

    @classmethod
    def of(cls, mask: Mask, noun: str, movable: bool, score: float, fit: float) -> Cut:
        """From a mask of the photo (H, W)."""
        x0, y0, x1, y1 = window(mask)
        return cls(mask[y0:y1, x0:x1].copy(), x0, y0, noun, movable, score, fit)

    def with_piece(self, piece: Mask) -> Cut:
        """The cut with some of its pixels; `piece` has the window's size."""
        x0, y0, x1, y1 = window(piece)
        return replace(self, piece=piece[y0:y1, x0:x1].copy(), x=self.x + x0, y=self.y + y0)

    @cached_property
    def confidence(self) -> float:
        """0..1, that the object exists and that this is its mask."""
        return min(max(self.score, 0.0), 1.0) * min(max(self.fit, 0.0), 1.0)

    @cached_property
    def area(self) -> int:
        """px."""
        return int(np.count_nonzero(self.piece))

    @cached_property
    def window(self) -> tuple[int, int, int, int]:
        """Left, top, right, bottom px of its pixels, the last two just outside."""
        return self.x, self.y, self.x + self.piece.shape[1], self.y + self.piece.shape[0]

    @property
    def centroid(self) -> tuple[float, float]:
        """x, y px."""
        rows, columns = np.nonzero(self.piece)
        return self.x + float(columns.mean()), self.y + float(rows.mean())

    def seen_in(self, photo: NDArray[T]) -> NDArray[T]:
        """A view of its window in an array of the photo's size."""
        x0, y0, x1, y1 = self.window
        return photo[y0:y1, x0:x1]


def window(mask: Mask) -> tuple[int, int, int, int]:
    """Left, top, right, bottom of a mask's pixels, the last two just outside; zeros where it is empty."""
    x, y, width, height = (
        cv2.boundingRect(np.ascontiguousarray(mask).view(np.uint8)) if mask.size else (0, 0, 0, 0)
    )
    return int(x), int(y), int(x + width), int(y + height)


def distinct_boxes(boxes: NDArray[np.float64], scores: NDArray[np.float64]) -> list[int]:
    """Indices of boxes (N, 4) without duplicates, whatever their nouns; the most confident first."""
    low, high = boxes[:, :2], boxes[:, 2:]
    area = np.clip(high - low, 0, None).prod(1)
    kept: list[int] = []
    for k in np.argsort(-scores, kind="stable").tolist():
        sides = np.clip(np.minimum(high[k], high[kept]) - np.maximum(low[k], low[kept]), 0, None)
        both = sides.prod(1)
        if area[k] > 0 and (both <= CLEANUP.same_box * (area[k] + area[kept] - both)).all():
            kept.append(k)
    return kept


def smoothed(mask: Mask) -> Mask:
    """The mask without specks and pinholes; rings and contact with the photo's border are kept."""
    x0, y0, x1, y1 = window(mask)
    result = np.zeros_like(mask)
    if x1 == x0:
        return result
    inside = np.pad(mask[y0:y1, x0:x1], 1).view(np.uint8)
    area = int(inside.sum())
    count, pieces, stats, _ = cv2.connectedComponentsWithStats(1 - inside, connectivity=4)
    small = [
        k
        for k in range(1, count)
        if k != pieces[0, 0] and stats[k, cv2.CC_STAT_AREA] < CLEANUP.hole * area + 5
    ]
    inside[np.isin(pieces, small)] = 1
    count, pieces, stats, _ = cv2.connectedComponentsWithStats(inside, connectivity=8)
    large = max(stats[1:, cv2.CC_STAT_AREA])
    kept = [k for k in range(1, count) if stats[k, cv2.CC_STAT_AREA] >= CLEANUP.speck * large]
    result[y0:y1, x0:x1] = np.isin(pieces, kept)[1:-1, 1:-1]
    return result


def parts(mask: Mask) -> list[Mask]:
    """The pieces of a mask that are large enough to be objects, the largest first; gaps of 2 px are ignored."""
    if not mask.size:
        return []
    near = cv2.dilate(mask.view(np.uint8), np.ones((3, 3), np.uint8))
    count, pieces = cv2.connectedComponents(near, connectivity=8)
    areas = np.bincount(pieces[mask], minlength=count)
    order = [
        int(k) for k in np.argsort(-areas, kind="stable") if k > 0 and areas[k] >= CLEANUP.part * areas.max()
    ]
    return [(pieces == k) & mask for k in order[: CLEANUP.parts]]


def split(cuts: Sequence[Cut]) -> list[Cut]:
    """Movable objects in one piece each (paper section 3.1)."""
    found: list[Cut] = []
    for cut in cuts:
        pieces = parts(cut.piece) if cut.movable else []
        found += [cut.with_piece(part) for part in pieces] if len(pieces) > 1 else [cut]
    return found


def distinct(cuts: Sequence[Cut]) -> list[Cut]:
    """Cuts without duplicates, the most confident first, none inside another of its kind.

    A cut around several of its kind is a heap and is dropped; of one around another, the less confident is dropped.
    """
    kept: list[Cut] = []
    for cut in sorted(cuts, key=lambda cut: -cut.confidence):
        if cut.area and all(_union(cut, other) <= CLEANUP.same_mask for other in kept):
            kept.append(cut)
    inner_cuts = {
        k: [i for i, cut in enumerate(kept) if i != k and _contains(one, cut)] for k, one in enumerate(kept)
    }
    gone = {k for k, inner in inner_cuts.items() if len(inner) > 1}
    for k, inner in inner_cuts.items():
        if k not in gone and len(inner) == 1 and inner[0] not in gone:
            gone.add(max(k, inner[0]))  # the most confident come first
    return [cut for k, cut in enumerate(kept) if k not in gone]


def resolved(cuts: Sequence[Cut]) -> list[Cut]:
    """Movable objects without common pixels: small ones lie in front of larger ones that are not much more confident.

    A bowl gives way to the apples in it. Objects of which almost nothing is left are dropped.
    """
    rest = list(cuts)
    while True:
        left = [_behind(cut, [other for other in rest if other is not cut]) for cut in rest]
        shares = [int(np.count_nonzero(piece)) / cut.area for piece, cut in zip(left, rest, strict=True)]
        if not shares or min(shares) >= CLEANUP.visible:
            return [cut.with_piece(smoothed(piece)) for cut, piece in zip(rest, left, strict=True)]
        del rest[int(np.argmin(shares))]


def segments(cuts: Iterable[Cut], size: tuple[int, int], confident: float = CONFIDENT) -> Segments:
    """Segments from overlapping cuts: cleaned, split, without duplicates or overlaps; `size` is the photo's (H, W).

    `cuts` may be a generator. Ids run left to right by centroid. Cuts below `confident` are doubtful; cuts that are not
    movable are scenery.
    """
    least = max(CLEANUP.least_share * size[0] * size[1], CLEANUP.least_area)
    smooth = [cut.with_piece(smoothed(cut.piece)) for cut in cuts if cut.confidence >= DOUBTFUL]
    cuts = distinct([cut for cut in split(smooth) if cut.area >= least and cut.confidence >= DOUBTFUL])
    objects = resolved([cut for cut in cuts if cut.movable and cut.confidence >= confident])
    objects = [cut for cut in objects if cut.area >= least]
    objects.sort(key=lambda cut: cut.centroid)
    labels = np.zeros(size, np.uint16)
    for k, cut in enumerate(objects, 1):
        cut.seen_in(labels)[cut.piece] = k
    weak = [cut for cut in cuts if cut.movable and cut.confidence < confident]
    doubts = [
        doubt
        for cut in weak
        if np.count_nonzero(cut.seen_in(labels)[cut.piece]) <= 0.5 * cut.area
        for doubt in _doubt(cut)
    ]
    return Segments(
        labels,
        np.array([cut.confidence for cut in objects], np.float64),
        tuple(doubts[: CLEANUP.doubts]),
        {k: Name(cut.noun, round(cut.confidence, 3)) for k, cut in enumerate(objects, 1)},
        _scenery([cut for cut in cuts if not cut.movable and cut.confidence >= confident], labels),
    )


def _scenery(cuts: Sequence[Cut], labels: NDArray[np.uint16]) -> Scenery:
    """Static surfaces: small ones in front of large ones, all behind the movable objects."""
    cuts = sorted(cuts, key=lambda cut: -cut.area)
    seen = np.zeros(labels.shape, np.uint16)
    for k, cut in enumerate(cuts, 1):
        cut.seen_in(seen)[cut.piece] = k
    seen[labels > 0] = 0
    return Scenery(seen, {k: cut.noun for k, cut in enumerate(cuts, 1) if (seen == k).any()})


def _doubt(cut: Cut) -> list[Doubt]:
    """The outline with few corners; none where it is too thin."""
    found, _ = cv2.findContours(cut.piece.view(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    contour = max(found, key=len)
    corners = cv2.approxPolyDP(contour, CLEANUP.straight * cv2.arcLength(contour, True), True)[:, 0]
    if len(corners) < 3:
        return []
    return [Doubt([(float(cut.x + x), float(cut.y + y)) for x, y in corners], round(cut.confidence, 3))]


def _behind(cut: Cut, others: Sequence[Cut]) -> Mask:
    """The part of a piece that is not behind others."""
    left = cut.piece.copy()
    for other in others:
        common = _common(cut, other)
        if common and _before(other, cut):
            mine, its = common
            left[mine] &= ~other.piece[its]
    return left


def _before(one: Cut, other: Cut) -> bool:
    """Whether `one` gets the common pixels; of two, exactly one does."""
    if one.area == other.area:
        return (one.confidence, *one.window) > (other.confidence, *other.window)
    small, large = (one, other) if one.area < other.area else (other, one)
    return (small.confidence >= CLEANUP.rival * large.confidence) == (small is one)


def _contains(one: Cut, other: Cut) -> bool:
    """Whether a movable object contains another of its kind."""
    kind = one.movable and other.movable and one.noun == other.noun and one.area > other.area
    return kind and _shared(one, other) >= CLEANUP.inside * other.area


def _common(one: Cut, other: Cut) -> tuple[tuple[slice, slice], tuple[slice, slice]] | None:
    """The overlap of two windows, as slices of each piece; None where there is none."""
    x0, y0 = max(one.x, other.x), max(one.y, other.y)
    x1, y1 = min(one.window[2], other.window[2]), min(one.window[3], other.window[3])
    if x1 <= x0 or y1 <= y0:
        return None
    mine, its = ((slice(y0 - cut.y, y1 - cut.y), slice(x0 - cut.x, x1 - cut.x)) for cut in (one, other))
    return mine, its


def _shared(one: Cut, other: Cut) -> int:
    """Common px."""
    common = _common(one, other)
    return int(np.count_nonzero(one.piece[common[0]] & other.piece[common[1]])) if common else 0


def _union(one: Cut, other: Cut) -> float:
    """Intersection over union, 0..1."""
    both = _shared(one, other)
    return both / max(one.area + other.area - both, 1)
