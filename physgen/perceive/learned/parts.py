"""What the network sees -> masks that may be objects: basins between its borders, joined the likeliest first."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.perceive.learned.network import OFFSETS, Seen
from physgen.perceive.proposals.gradient import Gradient
from physgen.perceive.proposals.proposal import Proposal, cut_out
from physgen.perceive.proposals.regions import CAP, basins, merge_tree

F32 = NDArray[np.float32]

ON = 0.3
"""Foreground from which a basin may be of an object."""
LEVELS = (0.35, 0.5, 0.65, 0.8)
"""Foreground above which what hangs together is a proposal, too."""
GROUND = 0.6
"""Share of the relief that is the border's; the rest is how little neighbours belong together."""
LINE = 0.7
"""Share of a border that stands only where the photo has an edge: where exactly it runs."""


def relief(seen: Seen) -> F32:
    """(h, w) 0..1: how surely a border runs here."""
    apart = np.zeros_like(seen.boundary)
    for n, (down, right) in enumerate(OFFSETS):
        if (
            max(abs(down), abs(right)) <= 3
        ):  # between a pixel and one three further: the border is in the middle
            middle = np.array([[1, 0, right / 2], [0, 1, down / 2]])
            size = apart.shape[::-1]
            there = cv2.warpAffine(1 - seen.pairs[n], middle, size, borderMode=cv2.BORDER_REPLICATE)
            apart = np.maximum(apart, there)
    apart = apart * seen.foreground
    return np.asarray(GROUND * seen.boundary + (1 - GROUND) * apart, np.float32)


def parts(seen: Seen, smallest: int, largest: int) -> list[Proposal]:
    """Proposals on the grid of the network's output, of `smallest` to `largest` px of it."""
    height = relief(seen)
    labels = basins(cv2.GaussianBlur(height, (0, 0), 1.0).astype(np.float32))
    found = _joined(labels, seen.foreground, height * np.float32(CAP), smallest, largest)
    for level in LEVELS:
        mask = seen.foreground > level
        _, pieces, stats, _ = cv2.connectedComponentsWithStats(mask.astype(np.uint8), connectivity=4)
        for k, (x, y, w, h, size) in enumerate(stats.tolist()):
            if k and smallest <= size <= 1.2 * largest:
                found.append(cut_out(pieces[y : y + h, x : x + w] == k, x, y, smallest))
    return [one for one in found if one is not None and one.area <= largest]


def guided(gradient: Gradient, seen: Seen, smallest: int, largest: int) -> list[Proposal]:
    """Proposals on the photo's own grid: bounded by its edges, joined as the network says."""
    size = gradient.strength.shape[::-1]
    border = cv2.dilate(relief(seen), np.ones((3, 3), np.uint8))  # the network is a pixel off, here and there
    border = np.clip(cv2.resize(border, size, interpolation=cv2.INTER_LINEAR), 0, 1)
    foreground = np.clip(cv2.resize(seen.foreground, size, interpolation=cv2.INTER_LINEAR), 0, 1)
    labels = basins(np.maximum(cv2.GaussianBlur(gradient.strength, (0, 0), 0.8), gradient.noise))
    sharp = np.minimum(gradient.strength, CAP) / CAP
    edge = np.float32(CAP) * border * (np.float32(1 - LINE) + np.float32(LINE) * sharp)
    found = _joined(labels, foreground.astype(np.float32), edge.astype(np.float32), smallest, largest)
    return [one for one in found if one is not None and one.area <= largest]


def _joined(
    labels: NDArray[np.int32], foreground: F32, edge: F32, smallest: int, largest: int
) -> list[Proposal | None]:
    """Basins (h, w) on objects, joined two by two where `edge` (h, w) between them is least: every union."""
    count = int(labels.max()) + 1
    on = np.bincount(labels.ravel(), foreground.ravel(), count) / np.bincount(labels.ravel(), minlength=count)
    kept = on >= ON
    if not kept.any():
        return []
    # all that is no object is one region, which nothing joins
    names = np.where(kept, np.cumsum(kept) - int(kept.all()), 0)[labels].astype(np.int32)
    nothing = np.zeros((*names.shape, 3), np.float32)
    tree = merge_tree(names, nothing, np.where(kept.all() | (names > 0), edge, np.float32(CAP)))
    ranks = tree.rank[names]
    ground = int(tree.rank[0]) if not kept.all() else -1
    rows, columns = np.indices(names.shape)
    corner = np.stack([columns, rows, -columns, -rows], -1).reshape(-1, 4)
    boxes = np.full((len(tree.rank), 4), np.iinfo(np.int64).max)
    np.minimum.at(boxes, ranks.ravel(), corner)
    sizes = np.concatenate([[0], np.cumsum(np.bincount(ranks.ravel(), minlength=len(tree.rank)))])
    found = []
    for first, last in tree.span.tolist():
        if first <= ground < last or not smallest <= sizes[last] - sizes[first] <= 1.2 * largest:
            continue
        x, y, right, bottom = np.abs(boxes[first:last].min(0)).tolist()
        part = ranks[y : bottom + 1, x : right + 1]
        found.append(cut_out((part >= first) & (part < last), x, y, smallest))
    return found
