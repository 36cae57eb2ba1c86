"""Clean-up of overlapping model masks: one mask per object without common pixels."""

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
"""Least confidence of an object's mask."""
DOUBTFUL = 0.1
"""Least confidence of a doubtful object's mask."""


@dataclass(frozen=True)
class CleanUp:
    """Constants of the clean-up; shares and IoU were chosen on the studio's photos."""

    # Least IoU of two boxes of one object.
    same_box: float = 0.8
    # Least IoU of two masks of one object.
    same_mask: float = 0.7
    # Least share of a mask inside another that contains it.
    inside: float = 0.8
    # Least area of a mask over the photo's.
    least_share: float = 0.0002
    # px: least area of a mask.
    least_area: int = 32
    # Largest area of a closed hole over the mask's.
    hole: float = 0.005
    # Largest area of a dropped piece over the largest piece's.
    speck: float = 0.02
    # Least area of a piece over the largest piece's for an object of its own.
    part: float = 0.1
    # Largest number of pieces of a mask.
    parts: int = 8
    visible: float = 0.2
    """Least share of an object that others in front leave visible; a smaller share is a
    heap, seen between its members.
    """
    # Least ratio of confidences of a smaller object in front of a larger one.
    rival: float = 0.5
    # Largest number of doubtful objects.
    doubts: int = 8


CLEANUP = CleanUp()


@dataclass(frozen=True, eq=False)
class Cut(Proposal):
    """A mask with its noun."""

    noun: str
    movable: bool
    # 0..1: probability that such an object exists.
    score: float
    # 0..1: IoU of the mask as expected by the model.
    fit: float

    @classmethod
    def from_mask(
        cls, mask: Mask, noun: str, movable: bool, score: float, fit: float
    ) -> Cut:
        """Return a cut from a mask of the photo (H, W)."""
        return cls(0, 0, mask, 0, noun, movable, score, fit).with_mask(mask)

    def with_mask(self, mask: Mask) -> Cut:
        """Return the cut with a part of its pixels; `mask` has the size of its own
        mask.
        """
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
        """Return the probability, 0..1, that the object exists and has this mask."""
        return min(max(self.score, 0.0), 1.0) * min(max(self.fit, 0.0), 1.0)

    @property
    def centroid(self) -> tuple[float, float]:
        """Return the centroid x, y, px."""
        rows, columns = np.nonzero(self.mask)
        return self.x + float(columns.mean()), self.y + float(rows.mean())

    def view_in(self, photo: NDArray[T]) -> NDArray[T]:
        """Return a view of the cut's box in an array of the photo's size."""
        left, top, right, bottom = self.box
        return photo[top:bottom, left:right]


def distinct_boxes(
    boxes: NDArray[np.float64], scores: NDArray[np.float64]
) -> list[int]:
    """Return indices of boxes (N, 4) without duplicates of any noun, most confident
    first.
    """
    valid = np.flatnonzero((boxes[:, 2:] > boxes[:, :2]).all(1))
    sides = np.hstack([boxes[valid, :2], boxes[valid, 2:] - boxes[valid, :2]])
    indices = cv2.dnn.NMSBoxes(
        sides.tolist(), scores[valid].tolist(), 0.0, CLEANUP.same_box
    )
    return [int(valid[k]) for k in indices]


def smooth_outline(mask: Mask) -> Mask:
    """Return the mask without specks and pinholes.

    Rings and contact with the photo's border are preserved.
    """
    if not mask.any():
        return mask
    inside = np.pad(mask, 1).view(np.uint8)
    area = int(inside.sum())
    count, pieces, stats, _ = cv2.connectedComponentsWithStats(
        1 - inside, connectivity=4
    )
    # Small holes are closed, but not the region around the mask.
    small = []
    for k in range(1, count):
        if k != pieces[0, 0] and stats[k, cv2.CC_STAT_AREA] < CLEANUP.hole * area + 5:
            small.append(k)
    inside[np.isin(pieces, small)] = 1
    count, pieces, stats, _ = cv2.connectedComponentsWithStats(inside, connectivity=8)
    large = max(stats[1:, cv2.CC_STAT_AREA])
    large_pieces = []
    for k in range(1, count):
        if stats[k, cv2.CC_STAT_AREA] >= CLEANUP.speck * large:
            large_pieces.append(k)
    return np.isin(pieces, large_pieces)[1:-1, 1:-1]


def parts(mask: Mask) -> list[Mask]:
    """Return the pieces of a mask that are large enough for objects, the largest first.

    Gaps of 2 px are ignored.
    """
    if not mask.size:
        return []
    dilated_mask = cv2.dilate(mask.view(np.uint8), np.ones((3, 3), np.uint8))
    count, pieces = cv2.connectedComponents(dilated_mask, connectivity=8)
    areas = np.bincount(pieces[mask], minlength=count)
    order = []
    for k in np.argsort(-areas, kind="stable"):
        if k > 0 and areas[k] >= CLEANUP.part * areas.max():
            order.append(int(k))
    return [(pieces == k) & mask for k in order[: CLEANUP.parts]]


def split(cuts: Sequence[Cut]) -> list[Cut]:
    """Return movable objects as one cut per piece (paper section 3.1)."""
    result: list[Cut] = []
    for cut in cuts:
        if cut.movable:
            pieces = parts(cut.mask)
        else:
            pieces = []
        result += list(map(cut.with_mask, pieces)) if len(pieces) > 1 else [cut]
    return result


def distinct(cuts: Sequence[Cut]) -> list[Cut]:
    """Return cuts without duplicates, most confident first, none inside another of its
    kind.

    A cut around several of its kind is a heap and is dropped; of a cut around a single
    other one, the less confident is dropped.
    """
    distinct_cuts: list[Cut] = []
    for cut in sorted(cuts, key=lambda cut: -cut.confidence):
        if cut.area and all(
            iou(cut, other) <= CLEANUP.same_mask for other in distinct_cuts
        ):
            distinct_cuts.append(cut)
    inner_cuts = {}
    for k, outer_cut in enumerate(distinct_cuts):
        inner_cuts[k] = [
            i
            for i, cut in enumerate(distinct_cuts)
            if i != k and _contains(outer_cut, cut)
        ]
    dropped_indices = set()
    for k, inner in inner_cuts.items():
        if len(inner) > 1:
            dropped_indices.add(k)
    for k, inner in inner_cuts.items():
        if (
            k not in dropped_indices
            and len(inner) == 1
            and inner[0] not in dropped_indices
        ):
            # The list is sorted: the larger index is less confident.
            dropped_indices.add(max(k, inner[0]))
    return [cut for k, cut in enumerate(distinct_cuts) if k not in dropped_indices]


def resolve_overlaps(cuts: Sequence[Cut]) -> list[Cut]:
    """Return movable objects without common pixels.

    Small objects lie in front of larger ones unless those are much more confident:
    apples stay in front of their bowl. Objects with almost no visible pixels are
    dropped.
    """
    rest = list(cuts)
    # Drop the most hidden object and start again, since others then become visible.
    while True:
        left = []
        for cut in rest:
            left.append(
                _remove_occluded_part(
                    cut, [other for other in rest if other is not cut]
                )
            )
        shares = []
        for piece, cut in zip(left, rest, strict=True):
            shares.append(int(np.count_nonzero(piece)) / cut.area)
        if not shares or min(shares) >= CLEANUP.visible:
            overlaps = []
            for cut, piece in zip(rest, left, strict=True):
                overlaps.append(cut.with_mask(smooth_outline(piece)))
            return overlaps
        del rest[int(np.argmin(shares))]


def segments(
    cuts: Iterable[Cut], size: tuple[int, int], confident: float = CONFIDENT
) -> Segments:
    """Return segments of overlapping cuts: cleaned, split, without duplicates or
    overlap.

    `size` is the photo's (H, W). `cuts` may be a generator. Ids increase from left to
    right by centroid. Cuts below `confident` are doubtful; immovable cuts are scenery.
    """
    least_area = max(CLEANUP.least_share * size[0] * size[1], CLEANUP.least_area)
    smooth_cuts = []
    for cut in cuts:
        if cut.confidence >= DOUBTFUL:
            smooth_cuts.append(cut.with_mask(smooth_outline(cut.mask)))
    cuts = distinct(
        [
            cut
            for cut in split(smooth_cuts)
            if cut.area >= least_area and cut.confidence >= DOUBTFUL
        ]
    )
    objects = resolve_overlaps(
        [cut for cut in cuts if cut.movable and cut.confidence >= confident]
    )
    objects = [cut for cut in objects if cut.area >= least_area]
    objects.sort(key=lambda cut: cut.centroid)
    labels = np.zeros(size, np.uint16)
    for k, cut in enumerate(objects, 1):
        cut.view_in(labels)[cut.mask] = k
    weak_cuts = []
    for cut in cuts:
        if cut.movable and cut.confidence < confident:
            weak_cuts.append(cut)
    doubts = [
        doubt
        for cut in weak_cuts
        if np.count_nonzero(cut.view_in(labels)[cut.mask]) <= 0.5 * cut.area
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
    """Return static surfaces: small ones in front of large ones, all behind movable
    objects.
    """
    cuts = sorted(cuts, key=lambda cut: -cut.area)
    scenery_labels = np.zeros(labels.shape, np.uint16)
    for k, cut in enumerate(cuts, 1):
        cut.view_in(scenery_labels)[cut.mask] = k
    scenery_labels[labels > 0] = 0
    return Scenery(
        scenery_labels,
        {k: cut.noun for k, cut in enumerate(cuts, 1) if (scenery_labels == k).any()},
    )


def _remove_occluded_part(cut: Cut, others: Sequence[Cut]) -> Mask:
    """Return the part of a cut's mask in front of others."""
    left = cut.mask.copy()
    for other in others:
        own_part = common(cut, other)
        other_part = common(other, cut)
        if left[own_part].size and _before(other, cut):
            left[own_part] &= ~other.mask[other_part]
    return left


def _before(cut: Cut, other: Cut) -> bool:
    """Return whether `cut` gets the common pixels; exactly one of both does."""
    if cut.area == other.area:
        return (cut.confidence, *cut.box) > (other.confidence, *other.box)
    small, large = (cut, other) if cut.area < other.area else (other, cut)
    return (small.confidence >= CLEANUP.rival * large.confidence) == (small is cut)


def _contains(cut: Cut, other: Cut) -> bool:
    """Return whether a movable object contains another of its kind."""
    kind = (
        cut.movable
        and other.movable
        and cut.noun == other.noun
        and cut.area > other.area
    )
    return kind and overlap(cut, other) >= CLEANUP.inside * other.area
