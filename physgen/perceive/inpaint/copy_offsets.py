"""Offsets between repeated parts of a photo: candidates for copies into a hole.

There are two kinds: frequent offsets between known patches and their most similar
patches (He and Sun 2012, Statistics of patch offsets for image completion), and offsets
at which the surroundings of the hole, or an arc of them, match known pixels. Both are
also searched among level offsets, because in a side view equal heights mean equal
distance and equal sharpness.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.maps import F32
from physgen.perceive.roles import Mask

Offsets = NDArray[np.int64]
"""(K, 2): rows and columns from a pixel of the hole to its source."""
I64 = NDArray[np.int64]


@dataclass(frozen=True)
class _Tuning:
    """Parameters chosen on the tuning half of `benchmarks/fills.py`; px of the reduced
    picture.
    """

    # px: patches are 7 px wide.
    patch_radius: int = 3
    # Patches with searched matches; half of them are the nearest to the hole.
    queries: int = 1200
    # Queries per comparison.
    chunk: int = 200
    least_shift: float = 0.07
    """Least offset over the picture's longer side (He and Sun: 1/15): nearer matches
    overlap the patch.
    """
    # px up or down of a level offset.
    level_rows: int = 1
    # Largest number of frequent offsets.
    dominant: int = 40
    # Least share of the hole that an offset can fill.
    least_use: float = 0.1
    # Separately matched parts of the hole's surroundings.
    arcs: int = 8
    # px: width of the matched surroundings.
    ring: int = 3
    # Offsets for each arc ...
    per_arc: int = 2
    # ... and for the complete ring.
    whole_ring: int = 6
    # px: least distance between two offsets of one arc.
    least_distance: int = 2
    # Weight of vertical relative to horizontal distance.
    height_weight: float = 2.0


TUNING = _Tuning()
UNUSABLE = np.float32(1e9)
"""Squared levels: larger than any difference of colours."""
COLOURS = 3
"""Colours of a pixel; squared differences are sums over them."""


def offset_cost(offsets: Offsets, shape: tuple[int, ...]) -> F32:
    """Return the weighted length (K,) of offsets as a share of a picture of `shape`."""
    length = np.hypot(TUNING.height_weight * offsets[..., 0], offsets[..., 1])
    return np.asarray(length / max(shape[:2]), np.float32)


@dataclass(frozen=True, eq=False)
class PatchMatches:
    """The most similar other patches of known patches."""

    votes: F32
    """(2 H - 1, 2 W - 1): histogram of the offsets to them, smoothed by 1 px."""
    rarity: F32
    """(H, W) squared levels: difference of the nearest searched patch from its match.

    A copy of a rare patch, e.g. the tip of a saucer, shows an object twice.
    """


def copy_offsets(
    picture: F32, hole: Mask, blocked: Mask, far: float
) -> tuple[Offsets, F32]:
    """Return candidate offsets for the `hole` (H, W) of `picture` (H, W, 3), and the
    rarity (H, W) of patches.

    `blocked` (H, W) is the hole and other pixels that must not be copied. `far` is the
    penalty of distance in squared levels per longer side of the picture.
    """
    offsets: list[tuple[int, int]] = []
    rarity = np.zeros(hole.shape, np.float32)
    matches = match_patches(picture, hole, blocked)
    if matches is not None:
        offsets += _dominant_offsets(matches.votes, hole, blocked)
        rarity = matches.rarity
    offsets += _ring_offsets(picture, hole, blocked, far)
    unique = list(dict.fromkeys(offsets))
    return np.array(unique, np.int64).reshape(-1, 2), rarity


def _dominant_offsets(
    votes: F32, hole: Mask, blocked: Mask
) -> Iterator[tuple[int, int]]:
    """Yield the most frequent offsets of `votes`, most frequent first."""
    height, width = hole.shape
    # Peaks of the histogram of offsets.
    rows, columns = np.nonzero(
        (votes == cv2.dilate(votes, np.ones((3, 3)))) & (votes > 0)
    )
    order = np.argsort(-votes[rows, columns], kind="stable")
    inside = np.argwhere(hole)
    count = 0
    for index in order:
        offset = np.array([rows[index] - height + 1, columns[index] - width + 1])
        sources = inside + offset
        legal = ((sources >= 0) & (sources < hole.shape)).all(axis=1)
        usable = ~blocked[sources[legal, 0], sources[legal, 1]]
        if usable.sum() < TUNING.least_use * len(inside):
            continue
        yield int(offset[0]), int(offset[1])
        count += 1
        if count == TUNING.dominant:
            return


def match_patches(picture: F32, hole: Mask, blocked: Mask) -> PatchMatches | None:
    """Return matches of the patches around `hole` (H, W), or None if too few are
    known.
    """
    height, width = hole.shape
    places, features = _known_patches(picture, blocked)
    if len(places) < 2 * (2 * TUNING.patch_radius + 1) ** 2:
        return None
    votes = np.zeros((2 * height - 1, 2 * width - 1), np.float32)
    least_shift = max(TUNING.patch_radius, TUNING.least_shift * max(hole.shape))
    queries = _queries(places, hole)
    differences = []
    for start in range(0, len(queries), TUNING.chunk):
        part = queries[start : start + TUNING.chunk]
        shift = places[None, :, :].astype(np.int16) - places[part, None, :].astype(
            np.int16
        )
        gap = _patch_differences(features, part)
        gap[(np.abs(shift) < least_shift).all(axis=2)] = UNUSABLE
        differences.append(gap.min(axis=1))
        _add_votes(votes, shift, gap)
        # A second vote considers only level offsets.
        gap[np.abs(shift[..., 0]) > TUNING.level_rows] = UNUSABLE
        _add_votes(votes, shift, gap)
    rarity = np.asarray(np.concatenate(differences), np.float32)
    smooth_votes = cv2.GaussianBlur(votes, (0, 0), 1.0)
    return PatchMatches(
        np.asarray(smooth_votes, np.float32),
        _spread_values(places[queries], rarity, hole.shape),
    )


def _patch_differences(features: F32, part: I64) -> F32:
    """Return the squared differences (k, n) per pixel of the patches `part` (k,) and
    all patches with `features` (n, m).
    """
    square = (features**2).sum(axis=1)
    gap = square[part, None] + square[None, :] - 2 * (features[part] @ features.T)
    # The colours of features are halved.
    return np.asarray(4 * COLOURS / features.shape[1] * gap, np.float32)


def _spread_values(places: I64, values: F32, shape: tuple[int, ...]) -> F32:
    """Return a map (H, W) with the value of the nearest of `places` (n, 2)."""
    is_free = np.ones(shape, np.uint8)
    is_free[places[:, 0], places[:, 1]] = 0
    _, labels = cv2.distanceTransformWithLabels(
        is_free, cv2.DIST_L2, 5, labelType=cv2.DIST_LABEL_PIXEL
    )
    nearest_values = np.zeros(labels.max() + 1, np.float32)
    nearest_values[labels[places[:, 0], places[:, 1]]] = values
    return np.asarray(nearest_values[labels], np.float32)


def _add_votes(votes: F32, shift: NDArray[np.int16], gap: F32) -> None:
    """Count the offset of the best match of each row of `gap` (n, m)."""
    rows = np.arange(len(gap))
    best = gap.argmin(axis=1)
    usable = gap[rows, best] < UNUSABLE
    best_shifts = shift[rows, best][usable].astype(np.int64)
    middle = np.array(votes.shape) // 2
    np.add.at(votes, tuple((best_shifts + middle).T), 1)


def _known_patches(picture: F32, blocked: Mask) -> tuple[I64, F32]:
    """Return centres (n, 2) of known patches and their colours (n, m) as whole numbers.

    Sums of their products stay below 2^24, so that their order changes nothing.
    """
    radius = TUNING.patch_radius
    size = 2 * radius + 1
    outside = np.pad(blocked, radius, constant_values=True).astype(np.uint8)
    incomplete = cv2.dilate(outside, np.ones((size, size), np.uint8))
    places = np.argwhere(incomplete[radius:-radius, radius:-radius] == 0)
    edges = ((radius, radius), (radius, radius), (0, 0))
    padded_picture = np.pad(np.round(picture / 2) - 64, edges, mode="edge").astype(
        np.float32
    )
    steps = range(0, size, 2)
    taps = [
        padded_picture[places[:, 0] + down, places[:, 1] + right]
        for down in steps
        for right in steps
    ]
    return places, np.concatenate(taps, axis=1)


def _queries(places: I64, hole: Mask) -> I64:
    """Return the indices of query patches: half near the hole, half evenly
    distributed.
    """
    distance = cv2.distanceTransform((~hole).astype(np.uint8), cv2.DIST_L2, 3)
    order = np.argsort(distance[places[:, 0], places[:, 1]], kind="stable")
    half_count = TUNING.queries // 2
    nearest, rest = order[:half_count], order[half_count:]
    if len(rest) > half_count:
        rest = rest[np.linspace(0, len(rest) - 1, half_count).astype(np.int64)]
    return np.asarray(np.concatenate([nearest, rest]), np.int64)


def _ring_offsets(
    picture: F32, hole: Mask, blocked: Mask, far: float
) -> list[tuple[int, int]]:
    """Return offsets with the best match of the ring around the hole, or of an arc of
    it.
    """
    size = 2 * TUNING.ring + 1
    ring = cv2.dilate(hole.astype(np.uint8), np.ones((size, size), np.uint8)) > 0
    ring &= ~blocked
    rows, columns = np.indices(hole.shape)
    middle = np.argwhere(hole).mean(axis=0)
    angle = np.arctan2(rows - middle[0], columns - middle[1])
    offsets = _matching_offsets(picture, ring, blocked, far, TUNING.whole_ring)
    for arc in range(TUNING.arcs):
        centre = 2 * np.pi * arc / TUNING.arcs
        turn = np.abs((angle - centre + np.pi) % (2 * np.pi) - np.pi)
        part = ring & (turn < 1.6 * np.pi / TUNING.arcs)
        offsets += _matching_offsets(picture, part, blocked, far, TUNING.per_arc)
    return offsets


def _matching_offsets(
    picture: F32, part: Mask, blocked: Mask, far: float, count: int
) -> list[tuple[int, int]]:
    """Return the `count` best offsets of the known pixels in `part` (H, W)."""
    if part.sum() < 2 * TUNING.ring:
        return []
    costs, corner = _match_costs(picture, part, blocked)
    down, right = np.indices(costs.shape)
    offsets = np.stack([down - corner[0], right - corner[1]], axis=-1)
    costs = costs + far * offset_cost(offsets, blocked.shape)
    costs[(np.abs(offsets) < TUNING.ring).all(axis=-1)] = UNUSABLE
    result = []
    for _ in range(count):
        row, column = np.unravel_index(int(costs.argmin()), costs.shape)
        if costs[row, column] >= UNUSABLE:
            break
        result.append((int(row) - corner[0], int(column) - corner[1]))
        radius = TUNING.least_distance
        top, left = max(0, row - radius), max(0, column - radius)
        # Suppress offsets close to the chosen one.
        costs[top : row + radius + 1, left : column + radius + 1] = UNUSABLE
    return result


def _match_costs(
    picture: F32, part: Mask, blocked: Mask
) -> tuple[F32, tuple[int, int]]:
    """Return mean squared differences of `part` and every position of its box, and its
    corner.
    """
    values = np.where(blocked[..., None], 0, np.round(picture / 2) - 64)
    values = values.astype(np.float32)
    left, top, width, height = cv2.boundingRect(part.astype(np.uint8))
    box = np.s_[top : top + height, left : left + width]
    weight = part[box].astype(np.float32)
    square = np.ascontiguousarray((values**2).sum(axis=2))
    # The squared difference is expanded, so that each term is a correlation.
    costs = cv2.matchTemplate(square, weight, cv2.TM_CCORR)
    for channel in range(3):
        channel_values = np.ascontiguousarray(values[..., channel])
        product = cv2.matchTemplate(
            channel_values, channel_values[box] * weight, cv2.TM_CCORR
        )
        costs = costs - 2 * product
    costs = (costs + (square[box] * weight).sum()) / weight.sum()
    overlap = cv2.matchTemplate(blocked.astype(np.float32), weight, cv2.TM_CCORR)
    costs[overlap > 0.5] = UNUSABLE
    # The colours were halved above.
    return np.asarray(np.where(costs < UNUSABLE, 4 * costs, costs)), (top, left)
