"""Clean-up of overlapping model masks into a label map: smoothing, splitting, de-duplication and overlap
resolution.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
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
Again = Callable[[Sequence[Box]], Sequence[tuple[Mask, float]]]
"""Boxes -> what is in each, and how well its mask fits, 0..1."""

SURE, DOUBTFUL = 0.25, 0.1
"""Confidence from which a mask is an object, and from which it is worth a comment."""
SAME_BOX, SAME_MASK = 0.8, 0.7
"""Intersection over union from which two boxes, two masks are of one thing."""
WITHIN = 0.8
"""Of a mask, in another, for it to be in there."""
SMALLEST, LEAST = 0.0002, 32
"""Of the photo, and px: what is smaller is nothing to move."""
HOLE, SPECK = 0.005, 0.02
"""Of a mask: smaller holes are closed, smaller pieces left out."""
PART, PARTS = 0.1, 8
"""Of a mask's largest piece: larger pieces are things of their own; the largest so many of them."""
FOUND_AGAIN = 0.5
"""Intersection over union that a piece and what its box was asked for must have, else the piece stays as it is."""
LEFT = 0.2
"""Of a thing, that others before it must leave: a heap is less, seen between the things that it is of."""
RIVAL = 0.5
"""Times its confidence: what is that sure may lie before a larger thing."""
DOUBTS = 8
"""At most, that are told of."""
STRAIGHT = 0.01
"""Of an outline's length that a doubtful one's polygon may be off."""


@dataclass(frozen=True, eq=False)
class Cut:
    """One mask, kept as its own window: a large photo's many masks would fill the memory. And what it is said to be."""

    piece: Mask
    """(h, w): the window's."""
    x: int
    y: int
    """Column and row of the window's first pixel."""
    noun: str
    movable: bool
    score: float
    """0..1, that there is such a thing."""
    fit: float
    """0..1, that this is its mask: the intersection over union that the model expects."""

    @classmethod
    def of(cls, mask: Mask, noun: str, movable: bool, score: float, fit: float) -> Cut:
        """From a mask of the photo (H, W)."""
        x0, y0, x1, y1 = window(mask)
        return cls(mask[y0:y1, x0:x1].copy(), x0, y0, noun, movable, score, fit)

    def with_piece(self, piece: Mask) -> Cut:
        """With some of its pixels; `piece` is of its window."""
        x0, y0, x1, y1 = window(piece)
        return replace(self, piece=piece[y0:y1, x0:x1].copy(), x=self.x + x0, y=self.y + y0)

    @cached_property
    def confidence(self) -> float:
        """0..1, that it is there and that this is its mask."""
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
        """Its window of something of the photo's size: a view."""
        x0, y0, x1, y1 = self.window
        return photo[y0:y1, x0:x1]


def window(mask: Mask) -> tuple[int, int, int, int]:
    """Left, top, right, bottom of a mask's pixels, the last two just outside; zeros where it is empty."""
    x, y, width, height = (
        cv2.boundingRect(np.ascontiguousarray(mask).view(np.uint8)) if mask.size else (0, 0, 0, 0)
    )
    return int(x), int(y), int(x + width), int(y + height)


def distinct_boxes(boxes: NDArray[np.float64], scores: NDArray[np.float64]) -> list[int]:
    """Of boxes (N, 4), whatever they are said to hold, those that no surer one means too; the surest first."""
    low, high = boxes[:, :2], boxes[:, 2:]
    area = np.clip(high - low, 0, None).prod(1)
    kept: list[int] = []
    for k in np.argsort(-scores, kind="stable").tolist():
        sides = np.clip(np.minimum(high[k], high[kept]) - np.maximum(low[k], low[kept]), 0, None)
        both = sides.prod(1)
        if area[k] > 0 and (both <= SAME_BOX * (area[k] + area[kept] - both)).all():
            kept.append(k)
    return kept


def smoothed(mask: Mask) -> Mask:
    """Without specks and pinholes; what is a ring stays one, and what touches the border goes on doing so."""
    x0, y0, x1, y1 = window(mask)
    result = np.zeros_like(mask)
    if x1 == x0:
        return result
    inside = np.pad(mask[y0:y1, x0:x1], 1).view(np.uint8)
    area = int(inside.sum())
    count, pieces, told, _ = cv2.connectedComponentsWithStats(1 - inside, connectivity=4)
    small = [k for k in range(1, count) if k != pieces[0, 0] and told[k, cv2.CC_STAT_AREA] < HOLE * area + 5]
    inside[np.isin(pieces, small)] = 1
    count, pieces, told, _ = cv2.connectedComponentsWithStats(inside, connectivity=8)
    large = max(told[1:, cv2.CC_STAT_AREA])
    kept = [k for k in range(1, count) if told[k, cv2.CC_STAT_AREA] >= SPECK * large]
    result[y0:y1, x0:x1] = np.isin(pieces, kept)[1:-1, 1:-1]
    return result


def parts(mask: Mask) -> list[Mask]:
    """The pieces of a mask that are large enough to be things, the largest first; gaps of 2 px part nothing."""
    if not mask.size:
        return []
    near = cv2.dilate(mask.view(np.uint8), np.ones((3, 3), np.uint8))
    count, pieces = cv2.connectedComponents(near, connectivity=8)
    areas = np.bincount(pieces[mask], minlength=count)
    order = [int(k) for k in np.argsort(-areas, kind="stable") if k > 0 and areas[k] >= PART * areas.max()]
    return [(pieces == k) & mask for k in order[:PARTS]]


def split(cuts: Sequence[Cut], again: Again) -> list[Cut]:
    """Movable things in one piece each: of masks in more, the pieces' boxes are asked for `again` (section 3.1)."""
    whole: list[Cut] = []
    pieces: list[Cut] = []
    for cut in cuts:
        found = parts(cut.piece) if cut.movable else []
        if len(found) > 1:
            pieces += [cut.with_piece(part) for part in found]
        else:
            whole.append(cut)
    answers = again([part.window for part in pieces]) if pieces else []
    for part, (mask, fit) in zip(pieces, answers, strict=True):
        answer = Cut.of(smoothed(mask), part.noun, part.movable, part.score, fit)
        ones = [answer.with_piece(one) for one in parts(answer.piece)]
        better = max(ones, key=lambda one: _shared(one, part), default=part)
        whole.append(better if _union(part, better) >= FOUND_AGAIN else part)
    return whole


def distinct(cuts: Sequence[Cut]) -> list[Cut]:
    """Those that mean no surer one's thing, the surest first; nothing holds one of its own kind.

    What holds several of its kind is a heap and goes, what holds one goes or makes it go, as they are sure.
    """
    kept: list[Cut] = []
    for cut in sorted(cuts, key=lambda cut: -cut.confidence):
        if cut.area and all(_union(cut, other) <= SAME_MASK for other in kept):
            kept.append(cut)
    held = {k: [i for i, cut in enumerate(kept) if i != k and _holds(one, cut)] for k, one in enumerate(kept)}
    gone = {k for k, inner in held.items() if len(inner) > 1}
    for k, inner in held.items():
        if k not in gone and len(inner) == 1 and inner[0] not in gone:
            gone.add(max(k, inner[0]))  # the surest come first
    return [cut for k, cut in enumerate(kept) if k not in gone]


def resolved(cuts: Sequence[Cut]) -> list[Cut]:
    """Movable things of which no two share a pixel: small ones lie before larger ones that are not much surer.

    A bowl gives way to the apples in it; what the others leave almost nothing of goes.
    """
    rest = list(cuts)
    while True:
        left = [_behind(cut, [other for other in rest if other is not cut]) for cut in rest]
        shares = [int(np.count_nonzero(piece)) / cut.area for piece, cut in zip(left, rest, strict=True)]
        if not shares or min(shares) >= LEFT:
            return [cut.with_piece(smoothed(piece)) for cut, piece in zip(rest, left, strict=True)]
        del rest[int(np.argmin(shares))]


def segments(cuts: Iterable[Cut], size: tuple[int, int], again: Again, sure: float = SURE) -> Segments:
    """All of it: masks cleaned, split, each thing once, no overlaps; `size` is the photo's (H, W).

    `cuts` may come one at a time. Ids run left to right by centroid. What is less than `sure` is doubtful; what is
    not movable is scenery.
    """
    least = max(SMALLEST * size[0] * size[1], LEAST)
    smooth = [cut.with_piece(smoothed(cut.piece)) for cut in cuts if cut.confidence >= DOUBTFUL]
    whole = split(smooth, again)
    cuts = distinct([cut for cut in whole if cut.area >= least and cut.confidence >= DOUBTFUL])
    things = resolved([cut for cut in cuts if cut.movable and cut.confidence >= sure])
    things = [cut for cut in things if cut.area >= least]
    things.sort(key=lambda cut: cut.centroid)
    labels = np.zeros(size, np.uint16)
    for k, cut in enumerate(things, 1):
        cut.seen_in(labels)[cut.piece] = k
    weak = [cut for cut in cuts if cut.movable and cut.confidence < sure]
    doubts = [
        doubt
        for cut in weak
        if np.count_nonzero(cut.seen_in(labels)[cut.piece]) <= 0.5 * cut.area
        for doubt in _doubt(cut)
    ]
    return Segments(
        labels,
        np.array([cut.confidence for cut in things], np.float64),
        tuple(doubts[:DOUBTS]),
        {k: Name(cut.noun, round(cut.confidence, 3)) for k, cut in enumerate(things, 1)},
        _scenery([cut for cut in cuts if not cut.movable and cut.confidence >= sure], labels),
    )


def _scenery(cuts: Sequence[Cut], labels: NDArray[np.uint16]) -> Scenery:
    """What stands still, small before large, and behind all that moves."""
    cuts = sorted(cuts, key=lambda cut: -cut.area)
    seen = np.zeros(labels.shape, np.uint16)
    for k, cut in enumerate(cuts, 1):
        cut.seen_in(seen)[cut.piece] = k
    seen[labels > 0] = 0
    return Scenery(seen, {k: cut.noun for k, cut in enumerate(cuts, 1) if (seen == k).any()})


def _doubt(cut: Cut) -> list[Doubt]:
    """Its outline in few corners; none for what is too thin to have one."""
    found, _ = cv2.findContours(cut.piece.view(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    contour = max(found, key=len)
    corners = cv2.approxPolyDP(contour, STRAIGHT * cv2.arcLength(contour, True), True)[:, 0]
    if len(corners) < 3:
        return []
    return [Doubt([(float(cut.x + x), float(cut.y + y)) for x, y in corners], round(cut.confidence, 3))]


def _behind(cut: Cut, others: Sequence[Cut]) -> Mask:
    """What is left of its piece where others lie before it."""
    left = cut.piece.copy()
    for other in others:
        common = _common(cut, other)
        if common and _before(other, cut):
            mine, its = common
            left[mine] &= ~other.piece[its]
    return left


def _before(one: Cut, other: Cut) -> bool:
    """Whether `one` gets the pixels that both have; of two, exactly one does."""
    if one.area == other.area:
        return (one.confidence, *one.window) > (other.confidence, *other.window)
    small, large = (one, other) if one.area < other.area else (other, one)
    return (small.confidence >= RIVAL * large.confidence) == (small is one)


def _holds(one: Cut, other: Cut) -> bool:
    """Whether a movable thing holds another of its kind."""
    kind = one.movable and other.movable and one.noun == other.noun and one.area > other.area
    return kind and _shared(one, other) >= WITHIN * other.area


def _common(one: Cut, other: Cut) -> tuple[tuple[slice, slice], tuple[slice, slice]] | None:
    """Where two windows overlap, in the piece of each; None where they do not."""
    x0, y0 = max(one.x, other.x), max(one.y, other.y)
    x1, y1 = min(one.window[2], other.window[2]), min(one.window[3], other.window[3])
    if x1 <= x0 or y1 <= y0:
        return None
    mine, its = ((slice(y0 - cut.y, y1 - cut.y), slice(x0 - cut.x, x1 - cut.x)) for cut in (one, other))
    return mine, its


def _shared(one: Cut, other: Cut) -> int:
    """px that are in both."""
    common = _common(one, other)
    return int(np.count_nonzero(one.piece[common[0]] & other.piece[common[1]])) if common else 0


def _union(one: Cut, other: Cut) -> float:
    """Intersection over union, 0..1."""
    both = _shared(one, other)
    return both / max(one.area + other.area - both, 1)
