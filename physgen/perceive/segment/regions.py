"""Regions from merge trees of basins, by colour or by the affinity of pixels, and circles by a Hough transform."""

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
"""(72, 3): how far the rim moves out at each angle when x, y or the radius grows by 1."""
LEAST = 0.13
"""Of a rim, that must vote for a circle."""


def discs(
    gradient: Gradient, smallest: int, largest: int, most: int = 250
) -> list[Proposal]:
    """The discs of an area within bounds (px) that the most of a rim supports, at most `most` of them."""
    height, width = gradient.strength.shape
    circles = fit(
        gradient,
        vote(gradient, np.sqrt(smallest / np.pi), np.sqrt(largest / np.pi), 4 * most),
    )
    support = gradient.support(
        _across_rim(gradient, circles, np.linspace(0.97, 1.03, 5)).max(1)
    ).mean(1)
    x, y = np.arange(width), np.arange(height)[:, None]
    kept: list[Proposal] = []
    seen = np.zeros((0, 3))
    for i in np.argsort(-support, kind="stable"):
        one = circles[i]
        off = np.abs(seen - one)
        double = (np.hypot(off[:, 0], off[:, 1]) < 0.12 * one[2]) & (
            off[:, 2] < 0.12 * one[2]
        )
        if support[i] < 0.3 or len(kept) == most:
            break
        if double.any() or not (0 <= one[0] < width and 0 <= one[1] < height):
            continue
        seen = np.vstack([seen, one])
        left, top = (max(0, int(one[k] - one[2])) for k in (0, 1))
        right, bottom = (int(one[k] + one[2]) + 2 for k in (0, 1))
        mask = np.hypot(x[left:right] - one[0], y[top:bottom] - one[1]) <= one[2]
        proposal = cut_out(mask, left, top, smallest)
        if proposal is not None and proposal.area <= largest:
            kept.append(proposal)
    return kept


def vote(gradient: Gradient, smallest: float, largest: float, most: int) -> Circles:
    """Maxima of the Hough transform of edges along their normals, over centre and radius; best first."""
    height, width = gradient.strength.shape
    rows, columns = np.nonzero(gradient.ridge)
    strength, angle = gradient.strength[rows, columns], gradient.angle[rows, columns]
    weight = np.minimum(1, strength / (6 * gradient.noise + 1))
    radii = [smallest]
    while radii[-1] < largest:
        radii.append(1.07 * radii[-1] + 0.2)
    across, down = np.cos(angle), np.sin(angle)
    found = []
    here: Layer | None = None
    for level in range(
        len(radii) + 1
    ):  # maxima over place, and over the next larger radius
        after = None
        if level < len(radii):
            votes = _votes(
                (height, width), rows, columns, across, down, weight, radii[level]
            )
            after = (
                votes,
                np.asarray(cv2.dilate(votes, np.ones((5, 5), np.uint8)), np.float32),
            )
        if here is not None:
            y, x = np.nonzero(here[0] > LEAST)
            most_near = np.max(
                [layer[1][y, x] for layer in (here, after) if layer is not None], axis=0
            )
            top = here[0][y, x] >= most_near
            y, x = y[top], x[top]
            found.append(
                np.stack([x, y, np.full(len(x), radii[level - 1]), here[0][y, x]], 1)
            )
        here = after
    every = np.concatenate(found).astype(np.float64)
    return every[np.argsort(-every[:, 3], kind="stable")[:most], :3]


Layer = tuple[NDArray[np.float32], NDArray[np.float32]]
"""(H, W) votes for a radius, and their greatest over 5 x 5 px."""


def _votes(
    shape: tuple[int, int],
    rows: NDArray[np.intp],
    columns: NDArray[np.intp],
    across: NDArray[np.float32],
    down: NDArray[np.float32],
    weight: NDArray[np.float32],
    radius: float,
) -> NDArray[np.float32]:
    """(H, W): how much of a rim of a radius edge pixels put about each pixel; 1: a whole rim of full weight."""
    height, width = shape
    votes = np.zeros(height * width)
    for side in (radius, -radius):
        x = np.rint(columns + side * across).astype(np.int64)
        y = np.rint(rows + side * down).astype(np.int64)
        inside = (x >= 0) & (y >= 0) & (x < width) & (y < height)
        votes += np.bincount((y * width + x)[inside], weight[inside], height * width)
    sigma = max(0.8, 0.08 * radius)
    blurred = cv2.GaussianBlur(
        votes.reshape(height, width).astype(np.float32), (0, 0), sigma
    )
    return np.asarray(blurred * (sigma * sigma / radius), np.float32)


def fit(gradient: Gradient, circles: Circles) -> Circles:
    """Each circle moved to the strongest edges near its rim: robust least squares, three bands."""
    for band, steps in ((0.14, 15), (0.08, 13), (0.05, 11)):
        factor = np.linspace(1 - band, 1 + band, steps)
        edge = _across_rim(gradient, circles, factor)
        near = 1 - 0.5 * np.linspace(-1, 1, steps)[:, None] ** 2
        at = (edge / (edge + 8) * near).argmax(1)
        strength = np.take_along_axis(edge, at[:, None], 1)[:, 0]
        radius = circles[:, 2:]
        out = radius * (factor[at] - 1)  # (n, 72) px by which the rim should move
        weight = certain = np.minimum(strength, 5) * (strength > 2 * gradient.noise)
        for _ in range(3):
            normal = np.einsum("nt,ti,tj->nij", weight, RIM, RIM) + 1e-3 * np.eye(3)
            move = np.linalg.solve(
                normal, np.einsum("nt,nt,ti->ni", weight, out, RIM)[..., None]
            )[..., 0]
            weight = certain / (
                1 + ((out - move @ RIM.T) / (0.025 * radius + 0.7)) ** 2
            )
        circles = circles + np.clip(move, -0.2 * radius, 0.2 * radius)
    return circles


def _across_rim(
    gradient: Gradient, circles: Circles, factor: NDArray[np.float64]
) -> NDArray[np.float32]:
    """(n, k, 72): edge strength across the rim of each circle, its radius multiplied by each of k factors."""
    radius = (circles[:, 2:] * factor)[..., None]
    x = circles[:, 0, None, None] + radius * np.cos(ANGLES)
    y = circles[:, 1, None, None] + radius * np.sin(ANGLES)
    return gradient.across(x, y, ANGLES)


COLOUR_WEIGHT = 0.25
"""Weight of the difference of mean colour against the gradient along the boundary; chosen on photos."""
STALE = 0.05
"""CIELAB units by which a queued difference may have grown before it is queued again."""
EDGE_CAP = 20.0
"""CIELAB units at which edge strength is cut off."""


def basins(height: NDArray[np.float32]) -> NDArray[np.int32]:
    """(H, W) int32, 0..n-1: watershed basins of a relief by steepest descent; a flat bottom is one basin."""
    rows, columns = height.shape
    wide = np.pad(height, 1, constant_values=np.inf)
    index = np.pad(np.arange(height.size, dtype=np.int32).reshape(height.shape), 1)
    lowest, target = height.copy(), index[1:-1, 1:-1].copy()
    for dy, dx in ((0, 1), (1, 0), (1, 2), (2, 1), (0, 0), (0, 2), (2, 0), (2, 2)):
        beside = wide[dy : dy + rows, dx : dx + columns]
        target = np.where(
            beside < lowest, index[dy : dy + rows, dx : dx + columns], target
        )
        lowest = np.minimum(beside, lowest)
    bottom = lowest == height
    _, bottoms = cv2.connectedComponents(bottom.astype(np.uint8), connectivity=8)
    _, first = np.unique(bottoms[bottom], return_index=True)
    target[bottom] = np.flatnonzero(bottom)[first][bottoms[bottom] - 1]
    flow = target.ravel()
    while not np.array_equal(flow, flow[flow]):
        flow = flow[flow]
    return (
        np.unique(flow, return_inverse=True)[1].reshape(height.shape).astype(np.int32)
    )


@dataclass(frozen=True, eq=False)
class MergeTree:
    """Basins joined two by two, the least different neighbours first; nodes 0..n-1 are the basins."""

    height: NDArray[np.float64]
    """(nodes,): the difference at which a node came about, CIELAB units; never below its children's."""
    parent: NDArray[np.int64]  # (nodes,), -1 for a root
    span: NDArray[
        np.int64
    ]  # (nodes, 2): the node holds the basins of rank first..last-1
    rank: NDArray[np.int64]  # (basins,): the place of each basin in the tree's order

    def without(self, kept: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """(nodes,): all but the basins that are not `kept` (basins,)."""
        return np.concatenate([kept, np.ones(len(self.parent) - len(kept), np.bool_)])


Borders = list[dict[int, tuple[int, float]]]
"""For each basin its neighbours: how many pairs of pixels lie across the border, and their differences summed."""


def merge_tree(
    borders: Borders,
    areas: NDArray[np.int64] | None = None,
    means: NDArray[np.float64] | None = None,
    stale: float = STALE,
) -> MergeTree:
    """The tree of basins by the mean difference along their borders (greedy additive clustering, as in Keuper et al.
    2015), and, where they are given, by their mean colours (basins, 3), weighted by `areas` (basins,), px.

    `borders` is used up. `stale`: see `STALE`.
    """
    count, beside = len(borders), borders
    area = [] if areas is None else areas.tolist()
    mean = [] if means is None else list(means)
    owner, node = (
        list(range(count)),
        list(range(count)),
    )  # a region keeps its number while others join it
    height, parent = [0.0] * count, [-1] * count
    children: dict[int, tuple[int, int]] = {}

    def whole(region: int) -> int:
        while owner[region] != region:
            owner[region] = region = owner[owner[region]]
        return region

    def difference(a: int, b: int) -> float:
        length, total = beside[a][b]
        if not mean:
            return total / length
        step = mean[a] - mean[b]
        return total / length + COLOUR_WEIGHT * min(
            EDGE_CAP, float(np.sqrt(step @ step))
        )

    queue = [(difference(a, b), a, b) for a in range(count) for b in beside[a] if a < b]
    heapq.heapify(queue)
    while queue:
        cost, a, b = heapq.heappop(queue)
        a, b = whole(a), whole(b)
        if a == b:
            continue
        now = difference(a, b)
        if now > cost + stale:
            heapq.heappush(queue, (now, a, b))
            continue
        if len(beside[a]) < len(beside[b]):
            a, b = b, a
        new = len(parent)
        children[new] = node[a], node[b]
        height.append(max(now, height[node[a]], height[node[b]]))
        parent[node[a]] = parent[node[b]] = new
        parent.append(-1)
        owner[b], node[a] = a, new
        if mean:
            mean[a] = (mean[a] * area[a] + mean[b] * area[b]) / (area[a] + area[b])
            area[a] += area[b]
        for other, (length, total) in beside[b].items():
            del beside[other][b]
            if other != a:
                before = beside[a].get(other, (0, 0.0))
                beside[a][other] = beside[other][a] = (
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
    """The tree of basins `labels` (H, W) by the mean edge strength along their borders and their mean colour."""
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
    """Borders of basins `labels` (H, W) with the edge strength along them, up to EDGE_CAP; `kept` as `pair_borders`."""
    strength = np.minimum(edge, EDGE_CAP)
    sides = ((np.s_[:, :-1], np.s_[:, 1:]), (np.s_[:-1], np.s_[1:]))
    pairs = [
        (here, there, np.maximum(strength[here], strength[there]))
        for here, there in sides
    ]
    return pair_borders(labels, pairs, kept)


def pair_borders(
    labels: NDArray[np.int32],
    pairs: Sequence[tuple[Any, Any, NDArray[np.float32]]],
    kept: NDArray[np.bool_] | None = None,
) -> Borders:
    """Borders of basins `labels` (H, W) from the differences of pairs of pixels, each two slices of the map and the
    differences; basins that are not `kept` (basins,) have none."""
    count = int(labels.max()) + 1
    keys, values = [np.zeros(0, np.int64)], [np.zeros(0, np.float32)]
    for here, there, difference in pairs:
        ours, theirs = labels[here].astype(np.int64), labels[there].astype(np.int64)
        across = ours != theirs
        if kept is not None:
            across &= kept[ours] & kept[theirs]
        keys.append(
            np.minimum(ours, theirs)[across] * count + np.maximum(ours, theirs)[across]
        )
        values.append(difference[across])
    unique, inverse = np.unique(np.concatenate(keys), return_inverse=True)
    lengths, totals = np.bincount(inverse), np.bincount(inverse, np.concatenate(values))
    beside: Borders = [{} for _ in range(count)]
    for key, length, total in zip(
        unique.tolist(), lengths.tolist(), totals.tolist(), strict=True
    ):
        a, b = divmod(key, count)
        beside[a][b] = beside[b][a] = (length, total)
    return beside


def _spans(
    parent: list[int], children: dict[int, tuple[int, int]], count: int
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Order the basins so that every node is a run of them: (nodes, 2) the runs and (basins,) the ranks."""
    size = [1] * count
    for a, b in children.values():
        size.append(size[a] + size[b])
    first, start = [0] * len(size), 0
    for node in reversed(
        range(len(size))
    ):  # parents have larger numbers than their children
        if parent[node] < 0:
            first[node], start = start, start + size[node]
        if node in children:
            a, b = children[node]
            first[a], first[b] = first[node], first[node] + size[a]
    return np.stack([first, np.add(first, size)], 1), np.array(first[:count], np.int64)


def stable_regions(
    colour: NDArray[np.float32], gradient: Gradient, smallest: int, largest: int
) -> list[Proposal]:
    """Every node of the merge tree of an area within bounds (px) that outlives a rise of the threshold."""
    labels = basins(
        np.maximum(cv2.GaussianBlur(gradient.strength, (0, 0), 0.8), gradient.noise)
    )
    tree = colour_tree(labels, colour, gradient.strength)
    above = tree.height[tree.parent]
    stable = (tree.parent >= 0) & (above >= 1.08 * tree.height + 0.3)
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
    """Some `nodes` of the tree of basins `labels` (H, W), each with its largest part, of an area within bounds (px)."""
    ranks = tree.rank[labels]
    sizes = np.concatenate(
        [[0], np.cumsum(np.bincount(ranks.ravel(), minlength=len(tree.rank)))]
    )
    rows, columns = np.indices(ranks.shape)
    corners = np.stack([columns, rows, -columns, -rows], -1).reshape(-1, 4)
    boxes = np.full((len(tree.rank), 4), np.iinfo(np.int64).max)
    np.minimum.at(boxes, ranks.ravel(), corners)
    areas = sizes[tree.span[:, 1]] - sizes[tree.span[:, 0]]
    found = []
    for k in np.flatnonzero(
        nodes & (areas >= smallest) & (areas <= 1.2 * largest)
    ).tolist():
        first, last = tree.span[k].tolist()
        x, y, right, bottom = np.abs(boxes[first:last].min(0)).tolist()
        part = ranks[y : bottom + 1, x : right + 1]
        one = cut_out((part >= first) & (part < last), x, y, smallest, opening)
        if one is not None and one.area <= largest:
            found.append((k, one))
    return found
