"""Regions from merge trees of basins, and circles by a Hough transform.

Basins are merged by colour or by the affinity of pixels.
"""

from __future__ import annotations

import heapq
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.perceive.segment.gradient import Gradient
from physgen.perceive.segment.proposals import Proposal, cut_out

Circles = NDArray[np.float64]
"""(n, 3): centre x, centre y, radius, px."""

ANGLES = np.arange(72) * 2 * np.pi / 72
RIM = np.stack([np.cos(ANGLES), np.sin(ANGLES), np.ones(72)], 1)
"""(72, 3): outward motion of the rim at each angle if x, y or the radius grows by 1."""
LEAST = 0.13
"""Least share of votes from the rim of a circle."""


@dataclass(frozen=True)
class _DiscLimits:
    """Limits of discs; distances are shares of the radius."""

    # Largest distance from another disc's centre, and largest difference of the radii,
    # of a second circle of one disc.
    repetition: float = 0.12
    # Least mean significance of edges along the rim.
    support: float = 0.3
    # Range and number of radii at which the rim is searched.
    rim_band: float = 0.03
    rim_steps: int = 5


DISC = _DiscLimits()


def discs(
    gradient: Gradient, smallest: int, largest: int, count: int = 250
) -> list[Proposal]:
    """Return at most `count` discs with the best support of their rims.

    Areas are between `smallest` and `largest` px.
    """
    height, width = gradient.strength.shape
    smallest_radius, largest_radius = np.sqrt(np.array([smallest, largest]) / np.pi)
    circles = fit(gradient, vote(gradient, smallest_radius, largest_radius, 4 * count))
    support = _measure_rim_support(gradient, circles)
    result: list[Proposal] = []
    unique_circles = np.zeros((0, 3))
    for i in np.argsort(-support, kind="stable"):
        circle = circles[i]
        if support[i] < DISC.support or len(result) == count:
            break
        x, y, _ = circle
        if _is_repetition(circle, unique_circles):
            continue
        if not (0 <= x < width and 0 <= y < height):
            continue
        unique_circles = np.vstack([unique_circles, circle])
        proposal = _draw_disc(circle, (height, width), smallest)
        if proposal is not None and proposal.area <= largest:
            result.append(proposal)
    return result


def _measure_rim_support(gradient: Gradient, circles: Circles) -> NDArray[np.float64]:
    """Return the mean significance (n,) of edges along the rim of each circle."""
    factor = np.linspace(1 - DISC.rim_band, 1 + DISC.rim_band, DISC.rim_steps)
    edges = _across_rim(gradient, circles, factor).max(1)
    return np.asarray(gradient.support(edges).mean(1))


def _is_repetition(circle: NDArray[np.float64], circles: Circles) -> bool:
    """Return whether a circle (3,) is almost equal to one of `circles`."""
    x, y, radius = np.abs(circles - circle).T
    limit = DISC.repetition * circle[2]
    return bool(((np.hypot(x, y) < limit) & (radius < limit)).any())


def _draw_disc(
    circle: NDArray[np.float64], shape: tuple[int, int], smallest: int
) -> Proposal | None:
    """Return a circle (3,) as a proposal, or None if it is too small."""
    height, width = shape
    x = np.arange(width)
    y = np.arange(height)[:, None]
    left = max(0, int(circle[0] - circle[2]))
    top = max(0, int(circle[1] - circle[2]))
    right = int(circle[0] + circle[2]) + 2
    bottom = int(circle[1] + circle[2]) + 2
    distances = np.hypot(x[left:right] - circle[0], y[top:bottom] - circle[1])
    return cut_out(distances <= circle[2], left, top, smallest)


@dataclass(frozen=True, eq=False)
class _EdgePixels:
    """The edge pixels of a photo, which vote for circles."""

    # (height, width) of the photo, px.
    shape: tuple[int, int]
    rows: NDArray[np.intp]  # (n,)
    columns: NDArray[np.intp]  # (n,)
    # (n,): components of the unit normals of the edges.
    x_normal: NDArray[np.float32]
    y_normal: NDArray[np.float32]
    weight: NDArray[np.float32]  # (n,)


def vote(gradient: Gradient, smallest: float, largest: float, count: int) -> Circles:
    """Return `count` maxima of the Hough transform over centre and radius, the best
    first.

    Edges vote along their normals.
    """
    pixels = _select_edge_pixels(gradient)
    radii = [smallest]
    while radii[-1] < largest:
        radii.append(1.07 * radii[-1] + 0.2)
    maxima = []
    previous_layer: Layer | None = None
    # A maximum must exceed its neighbourhood in position and in the next larger radius.
    for k, radius in enumerate(radii):
        layer = _count_votes(pixels, radius)
        if previous_layer is not None:
            maxima.append(_find_maxima(radii[k - 1], previous_layer, layer))
        previous_layer = layer
    if previous_layer is not None:
        maxima.append(_find_maxima(radii[-1], previous_layer, None))
    circles = np.concatenate(maxima).astype(np.float64)
    return circles[np.argsort(-circles[:, 3], kind="stable")[:count], :3]


def _select_edge_pixels(gradient: Gradient) -> _EdgePixels:
    """Return the pixels on ridges of a gradient."""
    height, width = gradient.strength.shape
    rows, columns = np.nonzero(gradient.ridge)
    angle = gradient.angle[rows, columns]
    weight = np.minimum(1, gradient.strength[rows, columns] / (6 * gradient.noise + 1))
    return _EdgePixels(
        (height, width), rows, columns, np.cos(angle), np.sin(angle), weight
    )


def _find_maxima(
    radius: float, layer: Layer, next_layer: Layer | None
) -> NDArray[np.float64]:
    """Return (n, 4) x, y, radius and votes of maxima in position and radius."""
    votes = layer[0]
    y, x = np.nonzero(votes > LEAST)
    neighbourhoods = [layer[1][y, x]]
    if next_layer is not None:
        neighbourhoods.append(next_layer[1][y, x])
    is_top = votes[y, x] >= np.max(neighbourhoods, axis=0)
    y = y[is_top]
    x = x[is_top]
    return np.stack([x, y, np.full(len(x), radius), votes[y, x]], 1)


Layer = tuple[NDArray[np.float32], NDArray[np.float32]]
"""(H, W): votes for a radius, and their maximum over 5 x 5 px."""


def _count_votes(pixels: _EdgePixels, radius: float) -> Layer:
    """Return the votes of edge pixels for a circle of a radius around each pixel.

    A complete rim of full weight gives 1.
    """
    height, width = pixels.shape
    votes = np.zeros(height * width)
    for side in (radius, -radius):
        x = np.rint(pixels.columns + side * pixels.x_normal).astype(np.int64)
        y = np.rint(pixels.rows + side * pixels.y_normal).astype(np.int64)
        inside = (x >= 0) & (y >= 0) & (x < width) & (y < height)
        centers = (y * width + x)[inside]
        votes += np.bincount(centers, pixels.weight[inside], height * width)
    sigma = max(0.8, 0.08 * radius)
    blurred_votes = cv2.GaussianBlur(
        votes.reshape(height, width).astype(np.float32), (0, 0), sigma
    )
    layer = np.asarray(blurred_votes * (sigma * sigma / radius), np.float32)
    maximum = cv2.dilate(layer, np.ones((5, 5), np.uint8))
    return layer, np.asarray(maximum, np.float32)


def fit(gradient: Gradient, circles: Circles) -> Circles:
    """Return each circle after robust least-squares moves to the strongest edges near
    its rim.

    There are three bands of decreasing width.
    """
    for band, steps in ((0.14, 15), (0.08, 13), (0.05, 11)):
        factor = np.linspace(1 - band, 1 + band, steps)
        edge = _across_rim(gradient, circles, factor)
        window = 1 - 0.5 * np.linspace(-1, 1, steps)[:, None] ** 2
        best_step = (edge / (edge + 8) * window).argmax(1)
        strength = np.take_along_axis(edge, best_step[:, None], 1)[:, 0]
        radius = circles[:, 2:]
        out = radius * (
            factor[best_step] - 1
        )  # (n, 72) px by which the rim should move
        weight = base_weight = np.minimum(strength, 5) * (strength > 2 * gradient.noise)
        # Reweighted least squares: distant edges belong to other objects.
        for _ in range(3):
            normal = np.einsum("nt,ti,tj->nij", weight, RIM, RIM) + 1e-3 * np.eye(3)
            move = np.linalg.solve(
                normal, np.einsum("nt,nt,ti->ni", weight, out, RIM)[..., None]
            )[..., 0]
            weight = base_weight / (
                1 + ((out - move @ RIM.T) / (0.025 * radius + 0.7)) ** 2
            )
        circles = circles + np.clip(move, -0.2 * radius, 0.2 * radius)
    return circles


def _across_rim(
    gradient: Gradient, circles: Circles, factor: NDArray[np.float64]
) -> NDArray[np.float32]:
    """Return edge strengths (n, k, 72) across the rim of each circle.

    The radius is multiplied by each of k factors.
    """
    radius = (circles[:, 2:] * factor)[..., None]
    x = circles[:, 0, None, None] + radius * np.cos(ANGLES)
    y = circles[:, 1, None, None] + radius * np.sin(ANGLES)
    return gradient.measure_across(x, y, ANGLES)


COLOUR_WEIGHT = 0.25
"""Weight of the difference of mean colours relative to the gradient along the border;
chosen on photos.
"""
STALE = 0.05
"""CIELAB units: largest tolerated growth of a queued difference."""
EDGE_CAP = 20.0
"""CIELAB units: limit of edge strength."""


def basins(height: NDArray[np.float32]) -> NDArray[np.int32]:
    """Return watershed basins (H, W) int32, 0..n-1, of a relief by steepest descent.

    A flat bottom is one basin.
    """
    rows, columns = height.shape
    padded_relief = np.pad(height, 1, constant_values=np.inf)
    index = np.pad(np.arange(height.size, dtype=np.int32).reshape(height.shape), 1)
    lowest = height.copy()
    target = index[1:-1, 1:-1].copy()
    for dy, dx in ((0, 1), (1, 0), (1, 2), (2, 1), (0, 0), (0, 2), (2, 0), (2, 2)):
        neighbour = padded_relief[dy : dy + rows, dx : dx + columns]
        target = np.where(
            neighbour < lowest, index[dy : dy + rows, dx : dx + columns], target
        )
        lowest = np.minimum(neighbour, lowest)
    bottom = lowest == height
    _, bottoms = cv2.connectedComponents(bottom.astype(np.uint8), connectivity=8)
    _, first = np.unique(bottoms[bottom], return_index=True)
    target[bottom] = np.flatnonzero(bottom)[first][bottoms[bottom] - 1]
    flow = target.ravel()
    # Pointer doubling leads every pixel to its bottom in few rounds.
    while not np.array_equal(flow, flow[flow]):
        flow = flow[flow]
    return (
        np.unique(flow, return_inverse=True)[1].reshape(height.shape).astype(np.int32)
    )


@dataclass(frozen=True, eq=False)
class MergeTree:
    """Basins merged in pairs, the least different neighbours first; nodes 0..n-1 are
    basins.
    """

    height: NDArray[np.float64]
    """(nodes,): difference at which a node was merged, CIELAB units; never below that
    of its children.
    """
    # (nodes,): -1 for a root.
    parent: NDArray[np.int64]
    # (nodes, 2): the node contains the basins of rank first..last-1.
    span: NDArray[np.int64]
    # (basins,): position of each basin in the tree's order.
    rank: NDArray[np.int64]

    def exclude_basins(self, selection: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Return (nodes,) True except for basins outside the `selection` (basins,)."""
        inner_nodes = np.ones(len(self.parent) - len(selection), np.bool_)
        return np.concatenate([selection, inner_nodes])


Borders = list[dict[int, tuple[int, float]]]
"""Per basin its neighbours: the number of pixel pairs across the border, and the sum of
their differences.
"""


def merge_tree(
    borders: Borders,
    areas: NDArray[np.int64] | None = None,
    means: NDArray[np.float64] | None = None,
    tolerance: float = STALE,
) -> MergeTree:
    """Return the tree of basins by the mean difference along their borders.

    The method is greedy additive clustering, as in Keuper et al. 2015. If given, mean
    colours (basins, 3) also count, weighted by `areas` (basins,), px. `borders` is
    consumed. `tolerance`: see `STALE`.
    """
    merging = _Merging(borders, areas, means)
    queue = [
        (merging.difference(a, b), a, b)
        for a in range(len(borders))
        for b in borders[a]
        if a < b
    ]
    heapq.heapify(queue)
    while queue:
        cost, a, b = heapq.heappop(queue)
        a = merging.find_owner(a)
        b = merging.find_owner(b)
        if a == b:
            continue
        difference = merging.difference(a, b)
        # The queue may contain outdated differences: queue the region again.
        if difference > cost + tolerance:
            heapq.heappush(queue, (difference, a, b))
            continue
        for entry in merging.merge(a, b, difference):
            heapq.heappush(queue, entry)
    return MergeTree(
        np.array(merging.height),
        np.array(merging.parent),
        *_spans(merging.parent, merging.children, len(borders)),
    )


class _Merging:
    """The regions of a merge tree while it grows.

    A region keeps its number while others join it.
    """

    def __init__(
        self,
        borders: Borders,
        areas: NDArray[np.int64] | None,
        means: NDArray[np.float64] | None,
    ) -> None:
        count = len(borders)
        self.neighbours = borders
        self.area = [] if areas is None else areas.tolist()
        self.mean = [] if means is None else list(means)
        self.owner = list(range(count))
        self.node = list(range(count))
        self.height = [0.0] * count
        self.parent = [-1] * count
        self.children: dict[int, tuple[int, int]] = {}

    def find_owner(self, region: int) -> int:
        """Return the region that contains a region."""
        owner = self.owner
        while owner[region] != region:
            owner[region] = region = owner[owner[region]]
        return region

    def difference(self, a: int, b: int) -> float:
        """Return the difference of two neighbours."""
        length, total = self.neighbours[a][b]
        if not self.mean:
            return total / length
        step = self.mean[a] - self.mean[b]
        return total / length + COLOUR_WEIGHT * min(
            EDGE_CAP, float(np.sqrt(step @ step))
        )

    def merge(self, a: int, b: int, difference: float) -> list[tuple[float, int, int]]:
        """Merge two regions; return the differences from the neighbours of the result.

        The region with fewer neighbours is merged into the other one.
        """
        neighbours = self.neighbours
        if len(neighbours[a]) < len(neighbours[b]):
            a, b = b, a
        self._add_node(a, b, difference)
        if self.mean:
            self._mix_colours(a, b)
        entries = []
        for other, (length, total) in neighbours[b].items():
            del neighbours[other][b]
            if other != a:
                before = neighbours[a].get(other, (0, 0.0))
                neighbours[a][other] = neighbours[other][a] = (
                    before[0] + length,
                    before[1] + total,
                )
                entries.append((self.difference(a, other), a, other))
        return entries

    def _add_node(self, a: int, b: int, difference: float) -> None:
        """Add the node that joins region b to region a."""
        first = self.node[a]
        second = self.node[b]
        new = len(self.parent)
        self.children[new] = first, second
        self.height.append(max(difference, self.height[first], self.height[second]))
        self.parent[first] = self.parent[second] = new
        self.parent.append(-1)
        self.owner[b] = a
        self.node[a] = new

    def _mix_colours(self, a: int, b: int) -> None:
        """Add the colours of region b to region a."""
        area = self.area
        mean = self.mean
        joint_area = area[a] + area[b]
        mean[a] = (mean[a] * area[a] + mean[b] * area[b]) / joint_area
        area[a] = joint_area


def colour_tree(
    labels: NDArray[np.int32], colour: NDArray[np.float32], edge: NDArray[np.float32]
) -> MergeTree:
    """Return the tree of basins `labels` (H, W) by edge strength along borders and mean
    colour.
    """
    areas = np.bincount(labels.ravel())
    means = np.stack(
        [np.bincount(labels.ravel(), colour[..., c].ravel()) / areas for c in range(3)],
        1,
    )
    return merge_tree(edge_borders(labels, edge), areas, means)


def edge_borders(
    labels: NDArray[np.int32],
    edge: NDArray[np.float32],
    selection: NDArray[np.bool_] | None = None,
) -> Borders:
    """Return borders of basins `labels` (H, W) with the edge strength along them.

    Strengths are limited to EDGE_CAP; `selection` is as in `pair_borders`.
    """
    strength = np.minimum(edge, EDGE_CAP)
    sides = ((np.s_[:, :-1], np.s_[:, 1:]), (np.s_[:-1], np.s_[1:]))
    pairs = []
    for first_side, second_side in sides:
        pairs.append(
            (
                first_side,
                second_side,
                np.maximum(strength[first_side], strength[second_side]),
            )
        )
    return pair_borders(labels, pairs, selection)


def pair_borders(
    labels: NDArray[np.int32],
    pairs: Sequence[tuple[Any, Any, NDArray[np.float32]]],
    selection: NDArray[np.bool_] | None = None,
) -> Borders:
    """Return borders of basins `labels` (H, W) from the differences of pixel pairs.

    Each of `pairs` is two slices of the map and their differences; basins outside the
    `selection` (basins,) have no borders.
    """
    count = int(labels.max()) + 1
    keys = [np.zeros(0, np.int64)]
    values = [np.zeros(0, np.float32)]
    for first_side, second_side, difference in pairs:
        first_labels = labels[first_side].astype(np.int64)
        second_labels = labels[second_side].astype(np.int64)
        is_border = first_labels != second_labels
        if selection is not None:
            is_border &= selection[first_labels] & selection[second_labels]
        low = np.minimum(first_labels, second_labels)[is_border]
        high = np.maximum(first_labels, second_labels)[is_border]
        keys.append(low * count + high)
        values.append(difference[is_border])
    return _sum_borders(np.concatenate(keys), np.concatenate(values), count)


def _sum_borders(
    keys: NDArray[np.int64], values: NDArray[np.float32], count: int
) -> Borders:
    """Return the borders of `count` basins.

    `keys` (n,) are a * count + b for pixel pairs of basins a and b, and `values` (n,)
    their differences.
    """
    unique, inverse = np.unique(keys, return_inverse=True)
    lengths = np.bincount(inverse)
    totals = np.bincount(inverse, values)
    neighbours: Borders = [{} for _ in range(count)]
    for key, length, total in zip(
        unique.tolist(), lengths.tolist(), totals.tolist(), strict=True
    ):
        a, b = divmod(key, count)
        neighbours[a][b] = neighbours[b][a] = (length, total)
    return neighbours


def _spans(
    parent: list[int], children: dict[int, tuple[int, int]], count: int
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return an order of the basins in which every node is a contiguous run.

    The results are the runs (nodes, 2) and the ranks (basins,).
    """
    size = [1] * count
    for a, b in children.values():
        size.append(size[a] + size[b])
    first = [0] * len(size)
    start = 0
    # Parents have larger numbers than their children.
    for node in reversed(range(len(size))):
        if parent[node] < 0:
            first[node], start = start, start + size[node]
        if node in children:
            a, b = children[node]
            first[a], first[b] = first[node], first[node] + size[a]
    return np.stack([first, np.add(first, size)], 1), np.array(first[:count], np.int64)


def stable_regions(
    colour: NDArray[np.float32], gradient: Gradient, smallest: int, largest: int
) -> list[Proposal]:
    """Return the nodes of the merge tree that survive a rise of the threshold.

    Their areas are between `smallest` and `largest` px.
    """
    labels = basins(
        np.maximum(cv2.GaussianBlur(gradient.strength, (0, 0), 0.8), gradient.noise)
    )
    tree = colour_tree(labels, colour, gradient.strength)
    parent_height = tree.height[tree.parent]
    stable = (tree.parent >= 0) & (parent_height >= 1.08 * tree.height + 0.3)
    regions = []
    for _, region in tree_regions(tree, labels, stable, smallest, largest, opening=1):
        regions.append(region)
    return regions


def tree_regions(
    tree: MergeTree,
    labels: NDArray[np.int32],
    nodes: NDArray[np.bool_],
    smallest: int,
    largest: int,
    opening: int = 0,
) -> list[tuple[int, Proposal]]:
    """Return the largest part of each of some `nodes` of the tree of basins `labels`
    (H, W).

    Areas are between `smallest` and `largest` px.
    """
    # In the tree's order each node is an interval of ranks.
    ranks = tree.rank[labels]
    count = len(tree.rank)
    sizes = np.bincount(ranks.ravel(), minlength=count)
    ends = np.concatenate([[0], np.cumsum(sizes)])
    areas = ends[tree.span[:, 1]] - ends[tree.span[:, 0]]
    boxes = _find_boxes(ranks, count)
    result = []
    for k in np.flatnonzero(
        nodes & (areas >= smallest) & (areas <= 1.2 * largest)
    ).tolist():
        first, last = tree.span[k].tolist()
        box = np.abs(boxes[first:last].min(0)).tolist()
        part = ranks[box[1] : box[3] + 1, box[0] : box[2] + 1]
        mask = (part >= first) & (part < last)
        proposal = cut_out(mask, box[0], box[1], smallest, opening)
        if proposal is not None and proposal.area <= largest:
            result.append((k, proposal))
    return result


def _find_boxes(ranks: NDArray[np.int64], count: int) -> NDArray[np.int64]:
    """Return (count, 4) left, top, -right and -bottom of each rank of a map (H, W).

    The minimum over several ranks gives their common box.
    """
    rows, columns = np.indices(ranks.shape)
    corners = np.stack([columns, rows, -columns, -rows], -1).reshape(-1, 4)
    boxes = np.full((count, 4), np.iinfo(np.int64).max)
    np.minimum.at(boxes, ranks.ravel(), corners)
    return boxes
