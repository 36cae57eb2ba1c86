"""Candidate objects from edges and from the segmentation network, and the judge that predicts their fit."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.perceive.segment.gradient import Gradient
from physgen.perceive.segment.network import F32, OFFSETS, NetworkMaps
from physgen.perceive.segment.proposals import (
    Mask,
    Proposal,
    cut_out,
    distinct,
    outline,
)
from physgen.perceive.segment.regions import (
    EDGE_CAP,
    basins,
    edge_borders,
    merge_tree,
    pair_borders,
    tree_regions,
)
from physgen.perceive.segment.selection import WIDEST_AREAS, EdgeSearch

Array = NDArray[np.float64]

FEATURES = (
    "foreground", "foreground, weakest tenth", "foreground around", "border along the rim",
    "border along its weakest quarter", "border inside", "border inside, strongest fiftieth",
    "together, near", "together, farther", "together, far", "with others, near", "with others, farther",
    "with others, far", "log size", "cut by the photo", "solidity", "compactness", "facing the viewer",
)  # fmt: skip
RANGES = (range(0, 2), range(2, 6), range(6, 8))
"""Indices of OFFSETS: near, farther and far pairs."""


@dataclass(frozen=True)
class CandidateConstants:
    """Constants of proposals from the network; areas are in px of its grid."""

    surroundings: int = (
        3  # px of the grid around a proposal that count as its surroundings
    )
    on: float = 0.3  # foreground from which a basin may be part of an object
    border_share: float = 0.6
    """Share of the boundary map in the relief; the rest is the lack of affinity of neighbours."""
    edge_share: float = 0.7  # share of a border that needs an edge in the photo, which fixes its exact course
    score_middle: float = 0.8
    """Score of the selection by edges whose confidence is a half; chosen on tune and validation data."""
    score_width: float = 0.05  # width of the logistic from score to confidence
    least_foreground: float = (
        0.2  # mean foreground of a proposal below which it is dropped
    )
    joining: int = 9  # px of the grid: pairs of pixels up to so far apart say which basins belong together
    whole: float = 0.4  # mean affinity from which parts are one object
    smallest: int = 14  # px of the network's grid, of the smallest proposal


CANDIDATES = CandidateConstants()


def proposal_features(proposals: Sequence[Proposal], seen: NetworkMaps) -> Array:
    """(n, len(FEATURES)) for proposals on the grid of the network's output."""
    rim = np.asarray(cv2.dilate(seen.boundary, np.ones((3, 3), np.uint8)), np.float32)
    reach = max(max(abs(down), abs(right)) for down, right in OFFSETS)
    return np.array(
        [_features(proposal, seen, rim, reach) for proposal in proposals]
    ).reshape(-1, len(FEATURES))


def _features(one: Proposal, seen: NetworkMaps, rim: F32, reach: int) -> list[float]:
    height, width = seen.foreground.shape
    left, top, right, bottom = one.box
    x0, y0 = max(left - reach, 0), max(top - reach, 0)
    box = np.s_[y0 : min(bottom + reach, height), x0 : min(right + reach, width)]
    mask = np.zeros(seen.foreground[box].shape, bool)
    mask[top - y0 : bottom - y0, left - x0 : right - x0] = one.mask
    near = np.s_[
        max(top - CANDIDATES.surroundings - y0, 0) : bottom
        + CANDIDATES.surroundings
        - y0,
        max(left - CANDIDATES.surroundings - x0, 0) : right
        + CANDIDATES.surroundings
        - x0,
    ]
    small = mask[near].astype(np.uint8)
    foreground, boundary = seen.foreground[box], seen.boundary[box]
    on = foreground[mask]
    kernel = np.ones(
        (2 * CANDIDATES.surroundings + 1, 2 * CANDIDATES.surroundings + 1), np.uint8
    )
    around = (cv2.dilate(small, kernel) > 0) & (small == 0)
    inner = (
        cv2.erode(
            small,
            np.ones((5, 5), np.uint8),
            borderType=cv2.BORDER_CONSTANT,
            borderValue=0,
        )
        > 0
    )
    contour = outline(one.mask)
    x, y = contour[:, 0] + left, contour[:, 1] + top
    free = (x > 0) & (y > 0) & (x < width - 1) & (y < height - 1)
    along = np.sort(rim[y[free], x[free]]) if free.any() else np.zeros(1, np.float32)
    inside = boundary[near][inner] if inner.any() else np.zeros(1, np.float32)
    together, others = _pairs(mask, foreground, seen.pairs[(slice(None), *box)])
    hull = cv2.convexHull(contour)
    area, length = (
        max(float(one.area), 1.0),
        max(float(cv2.arcLength(contour, True)), 1.0),
    )
    return [
        float(on.mean()),
        _lowest(on, 0.1),
        float(foreground[near][around].mean()) if around.any() else 0.0,
        float(along.mean()),
        float(along[: max(1, len(along) // 4)].mean()),
        float(inside.mean()),
        -_lowest(-inside, 0.02),
        *together,
        *others,
        float(np.log(area / (height * width))),
        1 - float(free.mean()),
        area / max(float(cv2.contourArea(hull)) + length / 2 + 1, area),
        float(np.sqrt(4 * np.pi * area) / length),
        float(seen.normals[box][..., 2][mask].mean()),
    ]


def _lowest(values: F32, share: float) -> float:
    """The greatest of the lowest `share` of some values."""
    k = int(share * (len(values) - 1))
    return float(np.partition(values, k)[k])


def _pairs(mask: Mask, foreground: F32, pairs: F32) -> tuple[list[float], list[float]]:
    """Mean affinity of pixels within the proposal, and with other foreground, for near, farther and far pairs."""
    h, w = mask.shape
    within, across = [], []
    for some in RANGES:
        own = other = own_count = other_count = 0.0
        for n in some:
            down, right = OFFSETS[n]
            if down >= h or abs(right) >= w:
                continue
            here = np.s_[: h - down, max(-right, 0) : w - max(right, 0)]
            there = np.s_[down:, max(right, 0) : w + min(right, 0)]
            a, b, affinity = mask[here], mask[there], pairs[n][here]
            both = a & b
            own += float(affinity[both].sum())
            own_count += int(both.sum())
            one = a != b
            if one.any():
                weight = np.where(a, foreground[there], foreground[here])[one]
                other += float((affinity[one] * weight).sum())
                other_count += float(weight.sum())
        within.append((own + 0.5) / (own_count + 1.0))
        across.append(other / (other_count + 1.0))
    return within, across


JUDGE = "judge.json"


def expected_fit(evidence: Array, numbers: Mapping[str, Any] | None = None) -> Array:
    """(n,) 0..1: expected IoU with the best object, from features (n, k) by a network of two hidden layers.

    `numbers` replace those of the shipped judge.
    """
    judge = _judge() if numbers is None else numbers
    value = (evidence - judge["mean"]) / judge["spread"]
    for weights, bias in zip(judge["weights"][:-1], judge["biases"][:-1], strict=True):
        value = np.maximum(value @ weights + bias, 0)
    out = value @ judge["weights"][-1] + judge["biases"][-1]
    return np.asarray(1 / (1 + np.exp(-np.clip(out[:, 0], -30, 30))))


def confidence(fit: Array) -> Array:
    """(n,) 0..1: the counted share of chosen proposals of such a fit (n,) that are right."""
    judge = _judge()
    return np.asarray(np.interp(fit, judge["fit"], judge["right"]))


@cache
def _judge() -> dict[str, Any]:
    numbers = json.loads(Path(__file__).with_name(JUDGE).read_text(encoding="utf-8"))
    return {
        name: [np.array(part) for part in value]
        if name in ("weights", "biases")
        else np.array(value)
        for name, value in numbers.items()
        if not isinstance(value, str)
    }


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


def guided_proposals(
    gradient: Gradient, seen: NetworkMaps, smallest: int, largest: int
) -> list[Proposal]:
    """Proposals on the photo's own grid: bounded by its edges, joined by the network's borders."""
    size = gradient.strength.shape[::-1]
    border = cv2.dilate(
        border_relief(seen), np.ones((3, 3), np.uint8)
    )  # the network may be a pixel off
    border = np.clip(cv2.resize(border, size, interpolation=cv2.INTER_LINEAR), 0, 1)
    foreground = np.clip(
        cv2.resize(seen.foreground, size, interpolation=cv2.INTER_LINEAR), 0, 1
    )
    labels = basins(
        np.maximum(cv2.GaussianBlur(gradient.strength, (0, 0), 0.8), gradient.noise)
    )
    share = np.float32(CANDIDATES.edge_share)
    sharp = np.minimum(gradient.strength, EDGE_CAP) / np.float32(EDGE_CAP)
    edge = np.float32(EDGE_CAP) * border * (1 - share + share * sharp)
    kept = _on_objects(labels, np.asarray(foreground, np.float32))
    tree = merge_tree(edge_borders(labels, edge.astype(np.float32), kept))
    return [
        one
        for _, one in tree_regions(tree, labels, tree.without(kept), smallest, largest)
    ]


def _on_objects(labels: NDArray[np.int32], foreground: F32) -> NDArray[np.bool_]:
    """(basins,): which basins (h, w) may be parts of objects."""
    on = np.bincount(labels.ravel(), foreground.ravel())
    return np.asarray(on >= CANDIDATES.on * np.bincount(labels.ravel()))


@dataclass(frozen=True, eq=False)
class Candidates:
    """Proposals on a grid of `shape`, with the network's features."""

    shape: tuple[int, int]
    proposals: Sequence[Proposal]
    evidence: NDArray[np.float64]  # (n, k), see `FEATURES`
    edges: NDArray[np.float64]
    """(n,) 0..1: confidence of the selection by edges alone; 0 where it did not select the proposal."""
    movable: NDArray[np.float64]  # (n,) 0..1: mean movability
    whole: NDArray[
        np.bool_
    ]  # (n,): the largest groups whose parts the network sees as one


def candidates(by_edges: EdgeSearch, seen: NetworkMaps) -> Candidates:
    """Of a photo, from its edges and from what the network sees in it."""
    shape, grid = by_edges.shape, seen.foreground.shape
    cells = grid[0] * grid[1]
    least, most = WIDEST_AREAS
    own, wholes = network_proposals(
        seen, max(CANDIDATES.smallest, round(least * cells)), round(most * cells)
    )
    bounds = (max(12, round(part * shape[0] * shape[1])) for part in (least, most))
    both_ways = distinct(
        [*by_edges.proposals, *guided_proposals(by_edges.gradient, seen, *bounds)]
    )
    pool: list[tuple[Proposal | None, Proposal | None]] = [
        (one, rescaled(one, shape, grid)) for one in (*by_edges.chosen, *both_ways)
    ]
    of_photo = len(pool)
    pool += [(rescaled(one, grid, shape), one) for one in (*wholes, *distinct(own))]
    agreed = np.zeros(len(pool))
    agreed[: len(by_edges.chosen)] = 1 / (
        1 + np.exp((CANDIDATES.score_middle - by_edges.scores) / CANDIDATES.score_width)
    )
    both = [
        (k, fine, rough)
        for k, (fine, rough) in enumerate(pool)
        if fine is not None
        and rough is not None
        and _mean(seen.foreground, rough) >= CANDIDATES.least_foreground
    ]
    kept = np.array([k for k, _, _ in both], np.intp)
    roughs = [rough for _, _, rough in both]
    return Candidates(
        shape,
        [fine for _, fine, _ in both],
        proposal_features(roughs, seen),
        agreed[kept],
        np.array([_mean(seen.movable, rough) for rough in roughs], np.float64),
        np.asarray((kept >= of_photo) & (kept < of_photo + len(wholes))),
    )


def _mean(values: F32, one: Proposal) -> float:
    """Mean of a map of the network (h, w) on a proposal of its grid."""
    left, top, right, bottom = one.box
    return float(values[top:bottom, left:right][one.mask].mean())


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
