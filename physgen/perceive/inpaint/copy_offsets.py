"""Offsets by which parts of a photo repeat: candidates for copies into a hole.

Two kinds: offsets that many known patches have to the known patch most like them (He and Sun 2012, Statistics of patch
offsets for image completion), and offsets under which the surroundings of the hole, or an arc of them, match known
pixels. Both are also searched level, since what is equally high in a side view is equally far and equally sharp.
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
"""(K, 2): rows and columns from a pixel of the hole to the pixel that is copied there."""
I64 = NDArray[np.int64]


@dataclass(frozen=True)
class _Tuning:
    """Chosen on the tune half of `benchmarks/fills.py`; px are of the reduced picture."""

    patch_radius: int = 3  # px: patches are 7 px wide
    queries: int = (
        1200  # patches whose match is searched; half of them nearest the hole
    )
    chunk: int = 200  # queries that are compared at once
    least_shift: float = 0.07
    """Of the picture's longer side (He and Sun: 1/15): nearer matches are overlaps."""
    level_rows: int = 1  # px up or down that still count as level
    dominant: int = 40  # offsets that the statistics contribute
    least_use: float = 0.1  # share of the hole that an offset must be able to fill
    arcs: int = 8  # parts of the hole's surroundings that are matched separately
    ring: int = 3  # px around the hole that are matched
    per_arc: int = 2  # offsets for each arc ...
    whole_ring: int = 6  # ... and for the whole ring
    apart: int = 2  # px between two offsets of one arc
    height_weight: float = 2.0  # of a px up or down beside one to the left or right


TUNING = _Tuning()
UNUSABLE = np.float32(1e9)
"""Squared levels: more than any difference of colours."""


def offset_cost(offsets: Offsets, shape: tuple[int, ...]) -> F32:
    """(K,): length of offsets in shares of a picture of `shape`; rows count more."""
    length = np.hypot(TUNING.height_weight * offsets[..., 0], offsets[..., 1])
    return np.asarray(length / max(shape[:2]), np.float32)


def copy_offsets(picture: F32, hole: Mask, blocked: Mask, far: float) -> Offsets:
    """Candidate offsets for the `hole` (H, W) of `picture` (H, W, 3).

    `blocked` (H, W) is the hole and what else must not be copied. `far`: squared
    levels by which a match may be worse if it is nearer by the picture's longer side.
    """
    offsets = [*_dominant_offsets(picture, hole, blocked)]
    offsets += _ring_offsets(picture, hole, blocked, far)
    unique = list(dict.fromkeys(offsets))
    return np.array(unique, np.int64).reshape(-1, 2)


def _dominant_offsets(
    picture: F32, hole: Mask, blocked: Mask
) -> Iterator[tuple[int, int]]:
    """The most frequent offsets between like patches, most frequent first."""
    height, width = hole.shape
    votes = _offset_votes(picture, hole, blocked)
    if votes is None:
        return
    rows, columns = np.nonzero(
        (votes == cv2.dilate(votes, np.ones((3, 3)))) & (votes > 0)
    )
    order = np.argsort(-votes[rows, columns], kind="stable")
    inside = np.argwhere(hole)
    count = 0
    for index in order:
        offset = np.array([rows[index] - height + 1, columns[index] - width + 1])
        there = inside + offset
        legal = ((there >= 0) & (there < hole.shape)).all(axis=1)
        usable = ~blocked[there[legal, 0], there[legal, 1]]
        if usable.sum() < TUNING.least_use * len(inside):
            continue
        yield int(offset[0]), int(offset[1])
        count += 1
        if count == TUNING.dominant:
            return


def _offset_votes(picture: F32, hole: Mask, blocked: Mask) -> F32 | None:
    """(2 H - 1, 2 W - 1): patches by offset to their matches, smoothed by 1 px."""
    height, width = hole.shape
    places, features = _known_patches(picture, blocked)
    if len(places) < 2 * (2 * TUNING.patch_radius + 1) ** 2:
        return None
    votes = np.zeros((2 * height - 1, 2 * width - 1), np.float32)
    square = (features**2).sum(axis=1)
    least = max(TUNING.patch_radius, TUNING.least_shift * max(hole.shape))
    queries = _queries(places, hole)
    for start in range(0, len(queries), TUNING.chunk):
        part = queries[start : start + TUNING.chunk]
        gap = square[None, :] - 2 * (features[part] @ features.T)
        shift = places[None, :, :].astype(np.int16) - places[part, None, :].astype(
            np.int16
        )
        gap[(np.abs(shift) < least).all(axis=2)] = UNUSABLE
        _add_votes(votes, shift, gap)
        gap[np.abs(shift[..., 0]) > TUNING.level_rows] = UNUSABLE
        _add_votes(votes, shift, gap)
    return np.asarray(cv2.GaussianBlur(votes, (0, 0), 1.0), np.float32)


def _add_votes(votes: F32, shift: NDArray[np.int16], gap: F32) -> None:
    """Count the offset of the best match of each row of `gap` (n, m)."""
    rows = np.arange(len(gap))
    best = gap.argmin(axis=1)
    usable = gap[rows, best] < UNUSABLE
    chosen = shift[rows, best][usable].astype(np.int64)
    middle = np.array(votes.shape) // 2
    np.add.at(votes, tuple((chosen + middle).T), 1)


def _known_patches(picture: F32, blocked: Mask) -> tuple[I64, F32]:
    """Centres (n, 2) of known patches and their colours (n, m) in whole numbers.

    Sums of their products stay below 2^24, so their order changes nothing.
    """
    radius = TUNING.patch_radius
    size = 2 * radius + 1
    outside = np.pad(blocked, radius, constant_values=True).astype(np.uint8)
    touched = cv2.dilate(outside, np.ones((size, size), np.uint8))
    places = np.argwhere(touched[radius:-radius, radius:-radius] == 0)
    edges = ((radius, radius), (radius, radius), (0, 0))
    padded = np.pad(np.round(picture / 2) - 64, edges, mode="edge").astype(np.float32)
    steps = range(0, size, 2)
    taps = [
        padded[places[:, 0] + down, places[:, 1] + right]
        for down in steps
        for right in steps
    ]
    return places, np.concatenate(taps, axis=1)


def _queries(places: I64, hole: Mask) -> I64:
    """Indices of the patches whose matches are counted: near the hole, and evenly."""
    away = cv2.distanceTransform((~hole).astype(np.uint8), cv2.DIST_L2, 3)
    order = np.argsort(away[places[:, 0], places[:, 1]], kind="stable")
    half = TUNING.queries // 2
    near, rest = order[:half], order[half:]
    if len(rest) > half:
        rest = rest[np.linspace(0, len(rest) - 1, half).astype(np.int64)]
    return np.asarray(np.concatenate([near, rest]), np.int64)


def _ring_offsets(
    picture: F32, hole: Mask, blocked: Mask, far: float
) -> list[tuple[int, int]]:
    """Offsets under which the ring around the hole, or an arc of it, matches best."""
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
    """The `count` best offsets of the pixels in `part` (H, W), which are known."""
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
        apart = TUNING.apart
        top, left = max(0, row - apart), max(0, column - apart)
        costs[top : row + apart + 1, left : column + apart + 1] = UNUSABLE
    return result


def _match_costs(
    picture: F32, part: Mask, blocked: Mask
) -> tuple[F32, tuple[int, int]]:
    """Mean squared difference of `part` and each place of its box, and its corner."""
    values = np.where(blocked[..., None], 0, np.round(picture / 2) - 64)
    values = values.astype(np.float32)
    left, top, width, height = cv2.boundingRect(part.astype(np.uint8))
    box = np.s_[top : top + height, left : left + width]
    weight = part[box].astype(np.float32)
    square = np.ascontiguousarray((values**2).sum(axis=2))
    costs = cv2.matchTemplate(square, weight, cv2.TM_CCORR)
    for channel in range(3):
        own = np.ascontiguousarray(values[..., channel])
        both = cv2.matchTemplate(own, own[box] * weight, cv2.TM_CCORR)
        costs = costs - 2 * both
    costs = (costs + (square[box] * weight).sum()) / weight.sum()
    hidden = cv2.matchTemplate(blocked.astype(np.float32), weight, cv2.TM_CCORR)
    costs[hidden > 0.5] = UNUSABLE
    # colours were halved
    return np.asarray(np.where(costs < UNUSABLE, 4 * costs, costs)), (top, left)
