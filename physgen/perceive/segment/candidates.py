"""Candidate objects: groups of pixels that belong together, cut-outs of boxes, and what edges select."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.perceive.segment.detector import DetectedBoxes, box_overlap
from physgen.perceive.segment.edges import EdgeSearch
from physgen.perceive.segment.evidence import (
    Evidence,
    gather_evidence,
    judge_features,
)
from physgen.perceive.segment.network import (
    F32,
    OFFSETS,
    NetworkMaps,
    rough_mask_in_box,
)
from physgen.perceive.segment.proposals import Mask, Proposal, cut_out, distinct
from physgen.perceive.segment.regions import (
    basins,
    merge_tree,
    pair_borders,
    tree_regions,
)

Array = NDArray[np.float64]


@dataclass(frozen=True)
class CandidateConstants:
    """Constants of candidates; areas are in px of the network's grid."""

    on: float = 0.3  # foreground from which a basin may be part of an object
    border_share: float = 0.6
    """Share of the boundary map in the relief; the rest is the lack of affinity of neighbours."""
    joining: int = 9  # px of the grid: pairs of pixels up to so far apart say which basins belong together
    whole: float = 0.4  # mean affinity from which parts are one object
    smallest: int = 14  # px of the network's grid, of the smallest candidate
    largest: float = 0.8  # of the photo: the largest candidate
    least_foreground: float = 0.2
    """Mean foreground of a group below which it is dropped."""
    score_middle: float = 0.8
    """Score of the selection by edges whose confidence is a half."""
    score_width: float = 0.05  # width of the logistic from score to confidence
    cut_outs: int = 9
    """Boxes that are cut out in any photo, the best ones: each costs 35 ms."""
    likely: float = 0.3  # score of a movable whole from which more boxes are cut out
    likely_cut_outs: int = 20  # boxes that are cut out at most
    same_group: float = 0.9
    """IoU of a box with a group's from which the group stands for it."""


CANDIDATES = CandidateConstants()


@dataclass(frozen=True, eq=False)
class Outlined:
    """A candidate that the photo's edges selected."""

    rough: Proposal  # on the network's grid
    mask: Proposal  # on the grid of the edges
    shape: tuple[int, int]  # (h, w) of that grid
    confidence: float  # 0..1, of the selection by edges


@dataclass(frozen=True, eq=False)
class CutOut:
    """A candidate that was cut out in a box."""

    mask: Proposal  # on the network's grid
    corners: Array  # (4,) px: the box on the photo


@dataclass(frozen=True, eq=False)
class Candidates:
    """Candidates on the network's grid of `shape` (h, w), with what the judge reads."""

    shape: tuple[int, int]
    proposals: Sequence[Proposal]
    features: Array  # (n, len(FEATURES))
    edges: Array
    """(n,) 0..1: confidence of the selection by edges; 0 where it did not select it."""
    outlined: Mapping[int, Outlined] = field(default_factory=dict)
    """What edges selected, by index."""
    corners: Mapping[int, Array] = field(default_factory=dict)
    """Boxes (4,) on the photo in which candidates were cut out, by index."""

    def on_photo(self, k: int, size: tuple[int, int]) -> Mask:
        """Return the mask of a candidate on a photo of `size` (H, W)."""
        mask = self.proposals[k].on(self.shape)
        if k in self.outlined:
            fine = self.outlined[k]
            mask = fine.mask.on(fine.shape)
        return cv2.resize(mask.astype(np.uint8), size[::-1]) > 0


def find_candidates(
    rgb: NDArray[np.uint8],
    seen: NetworkMaps,
    boxes: DetectedBoxes,
    edges: EdgeSearch | None = None,
) -> Candidates:
    """Return the candidates of a photo (H, W, 3) sRGB.

    Those that `edges` selected come last; the judge learns without them.
    """
    shape = seen.foreground.shape
    evidence = gather_evidence(rgb, seen, boxes)
    groups = find_groups(seen)
    cut_outs = cut_out_boxes(rgb, evidence, groups)
    first = len(groups) + len(cut_outs)
    outlined = edge_candidates(edges, seen) if edges else []
    cut_masks = [one.mask for one in cut_outs]
    proposals = [*groups, *cut_masks, *(one.rough for one in outlined)]
    agreement = np.array([0.0] * first + [one.confidence for one in outlined])
    return Candidates(
        shape,
        proposals,
        judge_features(proposals, evidence),
        agreement,
        {first + k: one for k, one in enumerate(outlined)},
        {len(groups) + k: one.corners for k, one in enumerate(cut_outs)},
    )


def edge_candidates(edges: EdgeSearch, seen: NetworkMaps) -> list[Outlined]:
    """Return what the photo's edges selected on what the network sees as objects."""
    shape = seen.foreground.shape
    sure = 1 / (
        1 + np.exp((CANDIDATES.score_middle - edges.scores) / CANDIDATES.score_width)
    )
    outlined = []
    for one, confidence in zip(edges.chosen, sure.tolist(), strict=True):
        rough = rescaled(one, edges.shape, shape)
        if rough and _mean(seen.foreground, rough) >= CANDIDATES.least_foreground:
            outlined.append(Outlined(rough, one, edges.shape, confidence))
    return outlined


def find_groups(seen: NetworkMaps) -> list[Proposal]:
    """Return groups of pixels that the network sees as one: parts, wholes and piles."""
    cells = seen.foreground.size
    largest = round(CANDIDATES.largest * cells)
    groups, wholes = network_proposals(seen, CANDIDATES.smallest, largest)
    return [
        one
        for one in distinct([*groups, *wholes])
        if _mean(seen.foreground, one) >= CANDIDATES.least_foreground
    ]


def cut_out_boxes(
    rgb: NDArray[np.uint8], evidence: Evidence, groups: Sequence[Proposal]
) -> list[CutOut]:
    """Cut out the best boxes, without those that a group already fits."""
    boxes, shape = evidence.boxes, evidence.colours.shape
    group_boxes = np.array([one.box for one in groups], np.float64).reshape(-1, 4)
    fit = box_overlap(evidence.corners, group_boxes).max(axis=1, initial=0.0)
    free = np.flatnonzero(fit < CANDIDATES.same_group)
    promise = np.maximum(boxes.movable, 0.5 * boxes.immovable)[free]
    likely = np.count_nonzero(boxes.movable[free] > CANDIDATES.likely)
    count = max(CANDIDATES.cut_outs, min(int(likely), CANDIDATES.likely_cut_outs))
    best = free[np.argsort(-promise, kind="stable")][:count]
    cut_outs = []
    for k in best.tolist():
        mask = rough_mask_in_box(rgb, boxes.corners[k], shape)
        if mask is not None:
            cut_outs.append(CutOut(mask, boxes.corners[k]))
    return cut_outs


def _mean(values: F32, one: Proposal) -> float:
    """Mean of a map of the network (h, w) on a proposal of its grid."""
    left, top, right, bottom = one.box
    return float(values[top:bottom, left:right][one.mask].mean())


def border_relief(seen: NetworkMaps) -> F32:
    """(h, w) 0..1: how likely a border runs here."""
    apart = np.zeros_like(seen.boundary)
    for n, (down, right) in enumerate(OFFSETS):
        if max(abs(down), abs(right)) <= 3:  # the border lies in the middle of the pair
            middle = np.array([[1, 0, right / 2], [0, 1, down / 2]])
            size = apart.shape[::-1]
            there = cv2.warpAffine(
                1 - seen.pairs[n], middle, size, borderMode=cv2.BORDER_REPLICATE
            )
            apart = np.maximum(apart, there)
    apart = apart * seen.foreground
    return np.asarray(
        CANDIDATES.border_share * seen.boundary + (1 - CANDIDATES.border_share) * apart,
        np.float32,
    )


def network_proposals(
    seen: NetworkMaps, smallest: int, largest: int
) -> tuple[list[Proposal], list[Proposal]]:
    """Proposals on the network's grid, of `smallest` to `largest` px of it: parts and piles, and wholes.

    They are groups of basins by affinity; wholes are the largest groups whose parts all belong together.
    """
    height, width = seen.foreground.shape
    labels = basins(
        cv2.GaussianBlur(border_relief(seen), (0, 0), 1.0).astype(np.float32)
    )
    pairs = []
    for (down, right), affinity in zip(OFFSETS, seen.pairs, strict=True):
        if (
            max(down, abs(right)) <= CANDIDATES.joining
            and down < height
            and abs(right) < width
        ):
            here = slice(0, height - down), slice(max(-right, 0), width - max(right, 0))
            there = slice(down, height), slice(max(right, 0), width + min(right, 0))
            pairs.append((here, there, 1 - affinity[here]))
    kept = _on_objects(labels, seen.foreground)
    tree = merge_tree(pair_borders(labels, pairs, kept), stale=0)
    apart = 1 - CANDIDATES.whole
    beyond = np.where(tree.parent >= 0, tree.height[tree.parent], 1.0)
    whole = (tree.height < apart) & (beyond >= apart)
    found = tree_regions(tree, labels, tree.without(kept), smallest, largest)
    return [one for k, one in found if not whole[k]], [
        one for k, one in found if whole[k]
    ]


def _on_objects(labels: NDArray[np.int32], foreground: F32) -> NDArray[np.bool_]:
    """(basins,): which basins (h, w) may be parts of objects."""
    on = np.bincount(labels.ravel(), foreground.ravel())
    return np.asarray(on >= CANDIDATES.on * np.bincount(labels.ravel()))


def rescaled(
    one: Proposal, shape: tuple[int, int], onto: tuple[int, int]
) -> Proposal | None:
    """A proposal on a grid of `shape` (h, w) as it lies on the grid `onto`; None where nothing is left of it."""
    down, right = onto[0] / shape[0], onto[1] / shape[1]
    left, top, end, bottom = one.box
    x0, y0 = int(left * right), int(top * down)
    x1, y1 = (
        min(int(np.ceil(end * right)), onto[1]),
        min(int(np.ceil(bottom * down)), onto[0]),
    )
    # canvas pixel centres to those of the proposal
    matrix = np.array(
        [
            [1 / right, 0, (x0 + 0.5) / right - 0.5 - left],
            [0, 1 / down, (y0 + 0.5) / down - 0.5 - top],
        ]
    )
    soft = one.mask.astype(np.float32)
    if right < 1:  # many pixels become one
        blur = cv2.GaussianBlur(
            soft, (0, 0), 0.4 / right, borderType=cv2.BORDER_CONSTANT
        )
        soft = np.asarray(blur, np.float32)
    there = cv2.warpAffine(
        soft,
        matrix,
        (x1 - x0, y1 - y0),
        flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP,
        borderMode=cv2.BORDER_CONSTANT,
    )
    return cut_out(there >= 0.5, x0, y0, 1)
