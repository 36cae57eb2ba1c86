"""Clean-up of overlapping model masks: one mask for each object, each pixel in at most one of them."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import TypeVar

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.perceive.roles import Name, Scenery, Segments
from physgen.perceive.segment.proposals import (
    Mask,
    Proposal,
    common,
    doubt_about,
    iou,
    overlap,
)

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

    same_box: float = 0.8  # IoU from which two boxes mean one object
    same_mask: float = 0.7  # IoU from which two masks mean one object
    inside: float = 0.8  # share of a mask within another, from which it is inside
    least_share: float = 0.0002  # of the photo: smaller masks are dropped
    least_area: int = 32  # px: smaller masks are dropped
    hole: float = 0.005  # of a mask: smaller holes are closed
    speck: float = 0.02  # of a mask's largest piece: smaller pieces are dropped
    part: float = (
        0.1  # of a mask's largest piece: larger pieces are objects of their own
    )
    parts: int = 8  # pieces of a mask, at most
    visible: float = 0.2
    """Share of an object that others in front must leave; less is a heap, seen between its members."""
    rival: float = 0.5  # ratio of confidences from which a smaller object lies in front of a larger one
    doubts: int = 8  # doubtful objects at most


CLEANUP = CleanUp()


@dataclass(frozen=True, eq=False)
class Cut(Proposal):
    """One mask with its noun."""

    noun: str
    movable: bool
    score: float  # 0..1, that there is such an object
    fit: float  # 0..1: the IoU of the mask that the model expects

    @classmethod
    def of(cls, mask: Mask, noun: str, movable: bool, score: float, fit: float) -> Cut:
        """From a mask of the photo (H, W)."""
        return cls(0, 0, mask, 0, noun, movable, score, fit).with_mask(mask)

    def with_mask(self, mask: Mask) -> Cut:
        """The cut with some of its pixels; `mask` has the size of its own."""
        x, y, width, height = (
            cv2.boundingRect(mask.view(np.uint8)) if mask.size else (0, 0, 0, 0)
        )
        part = mask[y : y + height, x : x + width].copy()
        return replace(
            self,
            x=self.x + x,
            y=self.y + y,
            mask=part,
            area=int(np.count_nonzero(part)),
        )

    @property
    def confidence(self) -> float:
        """0..1, that the object exists and that this is its mask."""
        return min(max(self.score, 0.0), 1.0) * min(max(self.fit, 0.0), 1.0)

    @property
    def centroid(self) -> tuple[float, float]:
        """x, y px."""
        rows, columns = np.nonzero(self.mask)
        return self.x + float(columns.mean()), self.y + float(rows.mean())

    def seen_in(self, photo: NDArray[T]) -> NDArray[T]:
        """A view of its box in an array of the photo's size."""
        left, top, right, bottom = self.box
        return photo[top:bottom, left:right]


def distinct_boxes(
    boxes: NDArray[np.float64], scores: NDArray[np.float64]
) -> list[int]:
    """Indices of boxes (N, 4) without duplicates, whatever their nouns; the most confident first."""
    some = np.flatnonzero((boxes[:, 2:] > boxes[:, :2]).all(1))
    sides = np.hstack([boxes[some, :2], boxes[some, 2:] - boxes[some, :2]])
    kept = cv2.dnn.NMSBoxes(
        sides.tolist(), scores[some].tolist(), 0.0, CLEANUP.same_box
    )
    return [int(some[k]) for k in kept]


def smoothed(mask: Mask) -> Mask:
    """The mask without specks and pinholes; rings and contact with the photo's border are kept."""
    if not mask.any():
        return mask
    inside = np.pad(mask, 1).view(np.uint8)
    area = int(inside.sum())
    count, pieces, stats, _ = cv2.connectedComponentsWithStats(
        1 - inside, connectivity=4
    )
    small = [
        k
        for k in range(1, count)
        if k != pieces[0, 0] and stats[k, cv2.CC_STAT_AREA] < CLEANUP.hole * area + 5
    ]
    inside[np.isin(pieces, small)] = 1
    count, pieces, stats, _ = cv2.connectedComponentsWithStats(inside, connectivity=8)
    large = max(stats[1:, cv2.CC_STAT_AREA])
    kept = [
        k
        for k in range(1, count)
        if stats[k, cv2.CC_STAT_AREA] >= CLEANUP.speck * large
    ]
    return np.isin(pieces, kept)[1:-1, 1:-1]


def parts(mask: Mask) -> list[Mask]:
    """The pieces of a mask that are large enough to be objects, the largest first; gaps of 2 px are ignored."""
    if not mask.size:
        return []
    near = cv2.dilate(mask.view(np.uint8), np.ones((3, 3), np.uint8))
    count, pieces = cv2.connectedComponents(near, connectivity=8)
    areas = np.bincount(pieces[mask], minlength=count)
    order = [
        int(k)
        for k in np.argsort(-areas, kind="stable")
        if k > 0 and areas[k] >= CLEANUP.part * areas.max()
    ]
    return [(pieces == k) & mask for k in order[: CLEANUP.parts]]


def split(cuts: Sequence[Cut]) -> list[Cut]:
    """Movable objects in one piece each (paper section 3.1)."""
    found: list[Cut] = []
    for cut in cuts:
        pieces = parts(cut.mask) if cut.movable else []
        found += [cut.with_mask(part) for part in pieces] if len(pieces) > 1 else [cut]
    return found


def distinct(cuts: Sequence[Cut]) -> list[Cut]:
    """Cuts without duplicates, the most confident first, none inside another of its kind.

    A cut around several of its kind is a heap and is dropped; of one around another, the less confident is dropped.
    """
    kept: list[Cut] = []
    for cut in sorted(cuts, key=lambda cut: -cut.confidence):
        if cut.area and all(iou(cut, other) <= CLEANUP.same_mask for other in kept):
            kept.append(cut)
    inner_cuts = {
        k: [i for i, cut in enumerate(kept) if i != k and _contains(one, cut)]
        for k, one in enumerate(kept)
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
        left = [
            _behind(cut, [other for other in rest if other is not cut]) for cut in rest
        ]
        shares = [
            int(np.count_nonzero(piece)) / cut.area
            for piece, cut in zip(left, rest, strict=True)
        ]
        if not shares or min(shares) >= CLEANUP.visible:
            return [
                cut.with_mask(smoothed(piece))
                for cut, piece in zip(rest, left, strict=True)
            ]
        del rest[int(np.argmin(shares))]


def segments(
    cuts: Iterable[Cut], size: tuple[int, int], confident: float = CONFIDENT
) -> Segments:
    """Segments from overlapping cuts: cleaned, split, without duplicates or overlaps; `size` is the photo's (H, W).

    `cuts` may be a generator. Ids run left to right by centroid. Cuts below `confident` are doubtful; cuts that are not
    movable are scenery.
    """
    least = max(CLEANUP.least_share * size[0] * size[1], CLEANUP.least_area)
    smooth = [
        cut.with_mask(smoothed(cut.mask)) for cut in cuts if cut.confidence >= DOUBTFUL
    ]
    cuts = distinct(
        [
            cut
            for cut in split(smooth)
            if cut.area >= least and cut.confidence >= DOUBTFUL
        ]
    )
    objects = resolved(
        [cut for cut in cuts if cut.movable and cut.confidence >= confident]
    )
    objects = [cut for cut in objects if cut.area >= least]
    objects.sort(key=lambda cut: cut.centroid)
    labels = np.zeros(size, np.uint16)
    for k, cut in enumerate(objects, 1):
        cut.seen_in(labels)[cut.mask] = k
    weak = [cut for cut in cuts if cut.movable and cut.confidence < confident]
    doubts = [
        doubt
        for cut in weak
        if np.count_nonzero(cut.seen_in(labels)[cut.mask]) <= 0.5 * cut.area
        for doubt in doubt_about(cut, cut.confidence)
    ]
    return Segments(
        labels,
        np.array([cut.confidence for cut in objects], np.float64),
        tuple(doubts[: CLEANUP.doubts]),
        {
            k: Name(cut.noun, round(cut.confidence, 3))
            for k, cut in enumerate(objects, 1)
        },
        _scenery(
            [cut for cut in cuts if not cut.movable and cut.confidence >= confident],
            labels,
        ),
    )


def _scenery(cuts: Sequence[Cut], labels: NDArray[np.uint16]) -> Scenery:
    """Static surfaces: small ones in front of large ones, all behind the movable objects."""
    cuts = sorted(cuts, key=lambda cut: -cut.area)
    seen = np.zeros(labels.shape, np.uint16)
    for k, cut in enumerate(cuts, 1):
        cut.seen_in(seen)[cut.mask] = k
    seen[labels > 0] = 0
    return Scenery(
        seen, {k: cut.noun for k, cut in enumerate(cuts, 1) if (seen == k).any()}
    )


def _behind(cut: Cut, others: Sequence[Cut]) -> Mask:
    """The part of a piece that is not behind others."""
    left = cut.mask.copy()
    for other in others:
        mine, its = common(cut, other), common(other, cut)
        if left[mine].size and _before(other, cut):
            left[mine] &= ~other.mask[its]
    return left


def _before(one: Cut, other: Cut) -> bool:
    """Whether `one` gets the common pixels; of two, exactly one does."""
    if one.area == other.area:
        return (one.confidence, *one.box) > (other.confidence, *other.box)
    small, large = (one, other) if one.area < other.area else (other, one)
    return (small.confidence >= CLEANUP.rival * large.confidence) == (small is one)


def _contains(one: Cut, other: Cut) -> bool:
    """Whether a movable object contains another of its kind."""
    kind = (
        one.movable
        and other.movable
        and one.noun == other.noun
        and one.area > other.area
    )
    return kind and overlap(one, other) >= CLEANUP.inside * other.area
