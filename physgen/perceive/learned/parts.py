"""What the network sees -> masks that may be objects: basins between its borders, joined the likeliest first."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.perceive.learned.network import OFFSETS, Seen
from physgen.perceive.proposals.proposal import Proposal, cut_out
from physgen.perceive.proposals.regions import CAP, basins, merge_tree

F32 = NDArray[np.float32]

ON = 0.3
"""Foreground from which a basin may be of an object."""
LEVELS = (0.35, 0.5, 0.65, 0.8)
"""Foreground above which what hangs together is a proposal, too."""
GROUND = 0.6
"""Share of the relief that is the border's; the rest is how little neighbours belong together."""


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
    count = int(labels.max()) + 1
    area = np.bincount(labels.ravel(), minlength=count)
    on = np.bincount(labels.ravel(), seen.foreground.ravel(), count) / area
    # all that is no object is one region, which nothing joins
    kept = on >= ON
    names = np.where(kept, np.cumsum(kept) - int(kept.all()), 0)
    labels = names[labels].astype(np.int32)
    found: list[Proposal | None] = []
    if kept.any():
        nothing = np.zeros((*labels.shape, 3), np.float32)
        tree = merge_tree(
            labels, nothing, np.where(kept.all() | (labels > 0), height * np.float32(CAP), np.float32(CAP))
        )
        ranks = tree.rank[labels]
        ground = int(tree.rank[0]) if not kept.all() else -1
        rows, columns = np.indices(labels.shape)
        corner = np.stack([columns, rows, -columns, -rows], -1).reshape(-1, 4)
        boxes = np.full((len(tree.rank), 4), np.iinfo(np.int64).max)
        np.minimum.at(boxes, ranks.ravel(), corner)
        sizes = np.concatenate([[0], np.cumsum(np.bincount(ranks.ravel(), minlength=len(tree.rank)))])
        for first, last in tree.span.tolist():
            if first <= ground < last or not smallest <= sizes[last] - sizes[first] <= 1.2 * largest:
                continue
            x, y, right, bottom = np.abs(boxes[first:last].min(0)).tolist()
            part = ranks[y : bottom + 1, x : right + 1]
            found.append(cut_out((part >= first) & (part < last), x, y, smallest))
    for level in LEVELS:
        mask = seen.foreground > level
        _, pieces, stats, _ = cv2.connectedComponentsWithStats(mask.astype(np.uint8), connectivity=4)
        for k, (x, y, w, h, size) in enumerate(stats.tolist()):
            if k and smallest <= size <= 1.2 * largest:
                found.append(cut_out(pieces[y : y + h, x : x + w] == k, x, y, smallest))
    return [one for one in found if one is not None and one.area <= largest]
