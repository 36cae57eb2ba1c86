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


def discs(
    gradient: Gradient, smallest: int, largest: int, most: int = 250
) -> list[Proposal]:
    """Return at most `most` discs with the best support of their rims.

    Areas are between `smallest` and `largest` px.
    """
    height, width = gradient.strength.shape
    circles = fit(
        gradient,
        vote(gradient, np.sqrt(smallest / np.pi), np.sqrt(largest / np.pi), 4 * most),
    )
    # The mean significance of edges along the rim rates a circle.
    support = gradient.support(
        _across_rim(gradient, circles, np.linspace(0.97, 1.03, 5)).max(1)
    ).mean(1)
    x, y = np.arange(width), np.arange(height)[:, None]
    result: list[Proposal] = []
    found_circles = np.zeros((0, 3))
    for i in np.argsort(-support, kind="stable"):
        circle = circles[i]
        differences = np.abs(found_circles - circle)
        double = (np.hypot(differences[:, 0], differences[:, 1]) < 0.12 * circle[2]) & (
            differences[:, 2] < 0.12 * circle[2]
        )
        if support[i] < 0.3 or len(result) == most:
            break
        if double.any() or not (0 <= circle[0] < width and 0 <= circle[1] < height):
            continue
        found_circles = np.vstack([found_circles, circle])
        left, top = (max(0, int(circle[k] - circle[2])) for k in (0, 1))
        right, bottom = (int(circle[k] + circle[2]) + 2 for k in (0, 1))
        mask = (
            np.hypot(x[left:right] - circle[0], y[top:bottom] - circle[1]) <= circle[2]
        )
        proposal = cut_out(mask, left, top, smallest)
        if proposal is not None and proposal.area <= largest:
            result.append(proposal)
    return result


def vote(gradient: Gradient, smallest: float, largest: float, most: int) -> Circles:
    """Return maxima of the Hough transform over centre and radius, the best first.

    Edges vote along their normals.
    """
    height, width = gradient.strength.shape
    rows, columns = np.nonzero(gradient.ridge)
    strength, angle = gradient.strength[rows, columns], gradient.angle[rows, columns]
    weight = np.minimum(1, strength / (6 * gradient.noise + 1))
    radii = [smallest]
    while radii[-1] < largest:
        radii.append(1.07 * radii[-1] + 0.2)
    x_normal, y_normal = np.cos(angle), np.sin(angle)
    maxima = []
    current_layer: Layer | None = None
    # A maximum must exceed its neighbourhood in position and in the next larger radius.
    for level in range(len(radii) + 1):
        next_layer = None
        if level < len(radii):
            votes = _votes(
                (height, width), rows, columns, x_normal, y_normal, weight, radii[level]
            )
            next_layer = (
                votes,
                np.asarray(cv2.dilate(votes, np.ones((5, 5), np.uint8)), np.float32),
            )
        if current_layer is not None:
            y, x = np.nonzero(current_layer[0] > LEAST)
            neighbourhood_maximum = np.max(
                [
                    layer[1][y, x]
                    for layer in (current_layer, next_layer)
                    if layer is not None
                ],
                axis=0,
            )
            top = current_layer[0][y, x] >= neighbourhood_maximum
            y, x = y[top], x[top]
            maxima.append(
                np.stack(
                    [x, y, np.full(len(x), radii[level - 1]), current_layer[0][y, x]], 1
                )
            )
        current_layer = next_layer
    circles = np.concatenate(maxima).astype(np.float64)
    return circles[np.argsort(-circles[:, 3], kind="stable")[:most], :3]


Layer = tuple[NDArray[np.float32], NDArray[np.float32]]
"""(H, W): votes for a radius, and their maximum over 5 x 5 px."""


def _votes(
    shape: tuple[int, int],
    rows: NDArray[np.intp],
    columns: NDArray[np.intp],
    across: NDArray[np.float32],
    down: NDArray[np.float32],
    weight: NDArray[np.float32],
    radius: float,
) -> NDArray[np.float32]:
    """Return the votes (H, W) of edge pixels for a circle of a radius around each
    pixel.

    A complete rim of full weight gives 1.
    """
    height, width = shape
    votes = np.zeros(height * width)
    for side in (radius, -radius):
        x = np.rint(columns + side * across).astype(np.int64)
        y = np.rint(rows + side * down).astype(np.int64)
        inside = (x >= 0) & (y >= 0) & (x < width) & (y < height)
        votes += np.bincount((y * width + x)[inside], weight[inside], height * width)
    sigma = max(0.8, 0.08 * radius)
    blurred_votes = cv2.GaussianBlur(
        votes.reshape(height, width).astype(np.float32), (0, 0), sigma
    )
    return np.asarray(blurred_votes * (sigma * sigma / radius), np.float32)


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
    return gradient.across(x, y, ANGLES)


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
    lowest, target = height.copy(), index[1:-1, 1:-1].copy()
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

    def without(self, kept: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Return (nodes,) True except for basins that are not `kept` (basins,)."""
        return np.concatenate([kept, np.ones(len(self.parent) - len(kept), np.bool_)])


Borders = list[dict[int, tuple[int, float]]]
"""Per basin its neighbours: the number of pixel pairs across the border, and the sum of
their differences.
"""


def merge_tree(
    borders: Borders,
    areas: NDArray[np.int64] | None = None,
    means: NDArray[np.float64] | None = None,
    stale: float = STALE,
) -> MergeTree:
    """Return the tree of basins by the mean difference along their borders.

    The method is greedy additive clustering, as in Keuper et al. 2015. If given, mean
    colours (basins, 3) also count, weighted by `areas` (basins,), px. `borders` is
    consumed. `stale`: see `STALE`.
    """
    count, neighbours = len(borders), borders
    area = [] if areas is None else areas.tolist()
    mean = [] if means is None else list(means)
    # A region keeps its number while others join it.
    owner, node = (
        list(range(count)),
        list(range(count)),
    )
    height, parent = [0.0] * count, [-1] * count
    children: dict[int, tuple[int, int]] = {}

    def whole(region: int) -> int:
        while owner[region] != region:
            owner[region] = region = owner[owner[region]]
        return region

    def difference(a: int, b: int) -> float:
        length, total = neighbours[a][b]
        if not mean:
            return total / length
        step = mean[a] - mean[b]
        return total / length + COLOUR_WEIGHT * min(
            EDGE_CAP, float(np.sqrt(step @ step))
        )

    queue = [
        (difference(a, b), a, b) for a in range(count) for b in neighbours[a] if a < b
    ]
    heapq.heapify(queue)
    while queue:
        cost, a, b = heapq.heappop(queue)
        a, b = whole(a), whole(b)
        if a == b:
            continue
        current_difference = difference(a, b)
        # The queue may contain outdated differences: queue the region again.
        if current_difference > cost + stale:
            heapq.heappush(queue, (current_difference, a, b))
            continue
        # Merge the region with fewer neighbours into the other one.
        if len(neighbours[a]) < len(neighbours[b]):
            a, b = b, a
        new = len(parent)
        children[new] = node[a], node[b]
        height.append(max(current_difference, height[node[a]], height[node[b]]))
        parent[node[a]] = parent[node[b]] = new
        parent.append(-1)
        owner[b], node[a] = a, new
        if mean:
            mean[a] = (mean[a] * area[a] + mean[b] * area[b]) / (area[a] + area[b])
            area[a] += area[b]
        for other, (length, total) in neighbours[b].items():
            del neighbours[other][b]
            if other != a:
                before = neighbours[a].get(other, (0, 0.0))
                neighbours[a][other] = neighbours[other][a] = (
                    before[0] + length,
                    before[1] + total,
                )
                heapq.heappush(queue, (difference(a, other), a, other))
    return MergeTree(
        np.array(height), np.array(parent), *_spans(parent, children, count)
    )


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
    kept: NDArray[np.bool_] | None = None,
) -> Borders:
    """Return borders of basins `labels` (H, W) with the edge strength along them.

    Strengths are limited to EDGE_CAP; `kept` is as in `pair_borders`.
    """
    strength = np.minimum(edge, EDGE_CAP)
    sides = ((np.s_[:, :-1], np.s_[:, 1:]), (np.s_[:-1], np.s_[1:]))
    pairs = [
        (
            first_side,
            second_side,
            np.maximum(strength[first_side], strength[second_side]),
        )
        for first_side, second_side in sides
    ]
    return pair_borders(labels, pairs, kept)


def pair_borders(
    labels: NDArray[np.int32],
    pairs: Sequence[tuple[Any, Any, NDArray[np.float32]]],
    kept: NDArray[np.bool_] | None = None,
) -> Borders:
    """Return borders of basins `labels` (H, W) from the differences of pixel pairs.

    Each of `pairs` is two slices of the map and their differences; basins that are not
    `kept` (basins,) have no borders.
    """
    count = int(labels.max()) + 1
    keys, values = [np.zeros(0, np.int64)], [np.zeros(0, np.float32)]
    for first_side, second_side, difference in pairs:
        first_labels, second_labels = (
            labels[first_side].astype(np.int64),
            labels[second_side].astype(np.int64),
        )
        is_border = first_labels != second_labels
        if kept is not None:
            is_border &= kept[first_labels] & kept[second_labels]
        keys.append(
            np.minimum(first_labels, second_labels)[is_border] * count
            + np.maximum(first_labels, second_labels)[is_border]
        )
        values.append(difference[is_border])
    unique, inverse = np.unique(np.concatenate(keys), return_inverse=True)
    lengths, totals = np.bincount(inverse), np.bincount(inverse, np.concatenate(values))
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
    first, start = [0] * len(size), 0
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
    return [
        region
        for _, region in tree_regions(
            tree, labels, stable, smallest, largest, opening=1
        )
    ]


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
    sizes = np.concatenate(
        [[0], np.cumsum(np.bincount(ranks.ravel(), minlength=len(tree.rank)))]
    )
    rows, columns = np.indices(ranks.shape)
    # Minima of these give the bounding box of each basin.
    corners = np.stack([columns, rows, -columns, -rows], -1).reshape(-1, 4)
    boxes = np.full((len(tree.rank), 4), np.iinfo(np.int64).max)
    np.minimum.at(boxes, ranks.ravel(), corners)
    areas = sizes[tree.span[:, 1]] - sizes[tree.span[:, 0]]
    result = []
    for k in np.flatnonzero(
        nodes & (areas >= smallest) & (areas <= 1.2 * largest)
    ).tolist():
        first, last = tree.span[k].tolist()
        x, y, right, bottom = np.abs(boxes[first:last].min(0)).tolist()
        part = ranks[y : bottom + 1, x : right + 1]
        proposal = cut_out((part >= first) & (part < last), x, y, smallest, opening)
        if proposal is not None and proposal.area <= largest:
            result.append((k, proposal))
    return result
