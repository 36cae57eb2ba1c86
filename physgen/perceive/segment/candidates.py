"""Candidate objects: groups of pixels, cut-outs of boxes, and selections by edges."""

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

    # Least mean foreground of a basin as a possible part of an object.
    basin_foreground: float = 0.3
    border_share: float = 0.6
    """Share of the boundary map in the relief; the rest is the lack of affinity between
    neighbours.
    """
    # px of the grid: largest distance of pixel pairs that join basins.
    joining: int = 9
    # Least mean affinity between parts of one object.
    whole_affinity: float = 0.4
    # px of the network's grid: least area of a candidate.
    smallest: int = 14
    # Largest area of a candidate over the photo's.
    largest: float = 0.8
    least_foreground: float = 0.2
    """Least mean foreground of a group."""
    score_middle: float = 0.8
    """Score of a selection by edges with a confidence of one half."""
    # Width of the logistic function from score to confidence.
    score_width: float = 0.05
    cut_outs: int = 9
    """Number of the best boxes for cut-outs in any photo: each costs 35 ms."""
    # Score of a movable whole above which more boxes are cut out.
    likely_score: float = 0.3
    # Largest number of cut-outs.
    likely_cut_outs: int = 20
    same_group: float = 0.9
    """Least IoU of a box with the box of a group in its place."""


CANDIDATES = CandidateConstants()


@dataclass(frozen=True, eq=False)
class EdgeSelection:
    """A candidate selected by the photo's edges."""

    # On the network's grid.
    grid_proposal: Proposal
    # On the grid of the edges.
    mask: Proposal
    # (h, w) of that grid.
    shape: tuple[int, int]
    # 0..1: confidence of the selection by edges.
    confidence: float


@dataclass(frozen=True, eq=False)
class CutOut:
    """A candidate from a cut-out in a box."""

    # On the network's grid.
    mask: Proposal
    # (4,) px: the box on the photo.
    corners: Array


@dataclass(frozen=True, eq=False)
class Candidates:
    """Candidates on the network's grid of `shape` (h, w), with the judge's features."""

    shape: tuple[int, int]
    proposals: Sequence[Proposal]
    features: Array  # (n, len(FEATURES))
    edges: Array
    """(n,) 0..1: confidence of the selection by edges, 0 for other candidates."""
    edge_selections: Mapping[int, EdgeSelection] = field(default_factory=dict)
    """Selections by edges, by index."""
    corners: Mapping[int, Array] = field(default_factory=dict)
    """Boxes (4,) of cut-outs on the photo, by index."""

    def on_photo(self, k: int, size: tuple[int, int]) -> Mask:
        """Return the mask of a candidate on a photo of `size` (H, W)."""
        mask = self.proposals[k].on(self.shape)
        if k in self.edge_selections:
            edge_selection = self.edge_selections[k]
            mask = edge_selection.mask.on(edge_selection.shape)
        return cv2.resize(mask.astype(np.uint8), size[::-1]) > 0


def find_candidates(
    rgb: NDArray[np.uint8],
    maps: NetworkMaps,
    boxes: DetectedBoxes,
    edges: EdgeSearch | None = None,
) -> Candidates:
    """Return the candidates of a photo (H, W, 3) sRGB.

    Selections by `edges` come last; the judge is trained without them.
    """
    shape = maps.foreground.shape
    evidence = gather_evidence(rgb, maps, boxes)
    groups = find_groups(maps)
    cut_outs = cut_out_boxes(rgb, evidence, groups)
    first = len(groups) + len(cut_outs)
    if edges:
        edge_selections = edge_candidates(edges, maps)
    else:
        edge_selections = []
    cut_masks = [selection.mask for selection in cut_outs]
    proposals = [
        *groups,
        *cut_masks,
        *(selection.grid_proposal for selection in edge_selections),
    ]
    agreement = np.array(
        [0.0] * first + [selection.confidence for selection in edge_selections]
    )
    return Candidates(
        shape,
        proposals,
        judge_features(proposals, evidence),
        agreement,
        {first + k: selection for k, selection in enumerate(edge_selections)},
        {len(groups) + k: selection.corners for k, selection in enumerate(cut_outs)},
    )


def edge_candidates(edges: EdgeSearch, maps: NetworkMaps) -> list[EdgeSelection]:
    """Return the selections by edges in the network's foreground."""
    shape = maps.foreground.shape
    confidences = 1 / (
        1 + np.exp((CANDIDATES.score_middle - edges.scores) / CANDIDATES.score_width)
    )
    selections = []
    for proposal, confidence in zip(edges.proposals, confidences.tolist(), strict=True):
        grid_proposal = rescale_proposal(proposal, edges.shape, shape)
        if (
            grid_proposal
            and _mean(maps.foreground, grid_proposal) >= CANDIDATES.least_foreground
        ):
            selections.append(
                EdgeSelection(grid_proposal, proposal, edges.shape, confidence)
            )
    return selections


def find_groups(maps: NetworkMaps) -> list[Proposal]:
    """Return groups of pixels from the network's affinities: parts, wholes and
    piles.
    """
    cells = maps.foreground.size
    largest = round(CANDIDATES.largest * cells)
    groups, wholes = network_proposals(maps, CANDIDATES.smallest, largest)
    result: list[Proposal] = []
    for proposal in distinct([*groups, *wholes]):
        if _mean(maps.foreground, proposal) >= CANDIDATES.least_foreground:
            result.append(proposal)
    return result


def cut_out_boxes(
    rgb: NDArray[np.uint8], evidence: Evidence, groups: Sequence[Proposal]
) -> list[CutOut]:
    """Cut out the best boxes, except boxes that match a group."""
    boxes = evidence.boxes
    shape = evidence.colours.shape
    group_boxes = np.array([group.box for group in groups], np.float64).reshape(-1, 4)
    fit = box_overlap(evidence.corners, group_boxes).max(axis=1, initial=0.0)
    free = np.flatnonzero(fit < CANDIDATES.same_group)
    promise = np.maximum(boxes.movable, 0.5 * boxes.immovable)[free]
    likely_count = np.count_nonzero(boxes.movable[free] > CANDIDATES.likely_score)
    count = max(CANDIDATES.cut_outs, min(int(likely_count), CANDIDATES.likely_cut_outs))
    best = free[np.argsort(-promise, kind="stable")][:count]
    cut_outs = []
    for k in best.tolist():
        mask = rough_mask_in_box(rgb, boxes.corners[k], shape)
        if mask is not None:
            cut_outs.append(CutOut(mask, boxes.corners[k]))
    return cut_outs


def _mean(values: F32, proposal: Proposal) -> float:
    """Return the mean of a map (h, w) over a proposal on the same grid."""
    left, top, right, bottom = proposal.box
    return float(values[top:bottom, left:right][proposal.mask].mean())


def border_relief(maps: NetworkMaps) -> F32:
    """Return the probability (h, w) of a border at each pixel."""
    separation = np.zeros_like(maps.boundary)
    for n, (down, right) in enumerate(OFFSETS):
        # The border lies in the middle of the pair.
        if max(abs(down), abs(right)) <= 3:
            middle = np.array([[1, 0, right / 2], [0, 1, down / 2]])
            size = separation.shape[::-1]
            centred_map = cv2.warpAffine(
                1 - maps.pairs[n], middle, size, borderMode=cv2.BORDER_REPLICATE
            )
            separation = np.maximum(separation, centred_map)
    separation = separation * maps.foreground
    return np.asarray(
        CANDIDATES.border_share * maps.boundary
        + (1 - CANDIDATES.border_share) * separation,
        np.float32,
    )


def network_proposals(
    maps: NetworkMaps, smallest: int, largest: int
) -> tuple[list[Proposal], list[Proposal]]:
    """Return parts and piles, and wholes, of `smallest` to `largest` px of the
    network's grid.

    They are groups of basins, merged by affinity; wholes are the largest groups with
    high affinity between all parts.
    """
    smooth_relief = cv2.GaussianBlur(border_relief(maps), (0, 0), 1.0)
    labels = basins(smooth_relief.astype(np.float32))
    object_basins = _on_objects(labels, maps.foreground)
    borders = pair_borders(labels, _pixel_pairs(maps), object_basins)
    tree = merge_tree(borders, tolerance=0)
    limit = 1 - CANDIDATES.whole_affinity
    parent_height = np.where(tree.parent >= 0, tree.height[tree.parent], 1.0)
    whole_nodes = (tree.height < limit) & (parent_height >= limit)
    tree_proposals = tree_regions(
        tree, labels, tree.exclude_basins(object_basins), smallest, largest
    )
    parts: list[Proposal] = []
    wholes: list[Proposal] = []
    for k, proposal in tree_proposals:
        group = wholes if whole_nodes[k] else parts
        group.append(proposal)
    return parts, wholes


def _pixel_pairs(
    maps: NetworkMaps,
) -> list[tuple[tuple[slice, slice], tuple[slice, slice], F32]]:
    """Return, per offset that joins basins, the windows of the first and second pixels
    of all pairs, and the lack of affinity between them.
    """
    height, width = maps.foreground.shape
    pairs = []
    for (down, right), affinity in zip(OFFSETS, maps.pairs, strict=True):
        is_short = max(down, abs(right)) <= CANDIDATES.joining
        if not is_short or down >= height or abs(right) >= width:
            continue
        first_columns = slice(max(-right, 0), width - max(right, 0))
        second_columns = slice(max(right, 0), width + min(right, 0))
        first_side = (slice(0, height - down), first_columns)
        second_side = (slice(down, height), second_columns)
        pairs.append((first_side, second_side, 1 - affinity[first_side]))
    return pairs


def _on_objects(labels: NDArray[np.int32], foreground: F32) -> NDArray[np.bool_]:
    """Return (basins,) whether basins (h, w) may be parts of objects."""
    foreground_sums = np.bincount(labels.ravel(), foreground.ravel())
    return np.asarray(
        foreground_sums >= CANDIDATES.basin_foreground * np.bincount(labels.ravel())
    )


def rescale_proposal(
    proposal: Proposal, shape: tuple[int, int], target_shape: tuple[int, int]
) -> Proposal | None:
    """Return a proposal on a grid of `shape` (h, w), moved to the grid `target_shape`, or None.

    None means that no pixel remains.
    """
    down = target_shape[0] / shape[0]
    right = target_shape[1] / shape[1]
    left, top, end, bottom = proposal.box
    x0 = int(left * right)
    y0 = int(top * down)
    x1 = min(int(np.ceil(end * right)), target_shape[1])
    y1 = min(int(np.ceil(bottom * down)), target_shape[0])
    # Maps pixel centres of the target to those of the proposal.
    matrix = np.array(
        [
            [1 / right, 0, (x0 + 0.5) / right - 0.5 - left],
            [0, 1 / down, (y0 + 0.5) / down - 0.5 - top],
        ]
    )
    soft_mask = proposal.mask.astype(np.float32)
    # Blur before many pixels become one, against aliasing.
    if right < 1:
        blur = cv2.GaussianBlur(
            soft_mask, (0, 0), 0.4 / right, borderType=cv2.BORDER_CONSTANT
        )
        soft_mask = np.asarray(blur, np.float32)
    grid_mask = cv2.warpAffine(
        soft_mask,
        matrix,
        (x1 - x0, y1 - y0),
        flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP,
        borderMode=cv2.BORDER_CONSTANT,
    )
    return cut_out(grid_mask >= 0.5, x0, y0, 1)
