"""A picture with a hole -> the hole covered by pieces of its surroundings, so that lines and grain go on.

Where a pixel borrows from is a shift; few shifts are enough for a photo (He and Sun 2012, Statistics of patch offsets).
They are found from coarse to fine: every pixel takes the shift whose patch fits best what is there already, and
overlapping patches vote on the colour (Wexler et al. 2007, Space-time completion of video).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.perceive.membrane import F32, Mask, membrane

Shifts = NDArray[np.int64]
"""(n, 2) or (H, W, 2): rows down, columns right, px."""

DENSE = 1000
"""Shifts tried at the coarsest scale."""
RIM = np.float32(0.3)
"""Weight of how well the pixels around the hole, on all its sides, fit those around the place borrowed from."""
KEPT = (8, 12, 20)
"""Shifts handed down to the finest scale, to the one above, and to those above that; a piece of the hole."""


@dataclass(frozen=True)
class Level:
    """The picture at one scale."""

    picture: F32
    """(H, W, 3); what is in the hole means nothing."""
    hole: Mask
    """(H, W)."""
    sources: Mask
    """(H, W): centres of patches that are known as a whole."""
    radius: int
    """of a patch: it is 2 radius + 1 px wide."""


@dataclass(frozen=True)
class Part:
    """A box of a level that holds one piece of its hole, or all of it."""

    top: int
    left: int
    hole: Mask
    """(h, w)."""

    def of(self, array: F32) -> F32:
        """The same box of a whole picture."""
        h, w = self.hole.shape
        return array[self.top : self.top + h, self.left : self.left + w]


@dataclass(frozen=True)
class Borrowed:
    """A filled picture, and the steps of colour in it as they were where it was borrowed from."""

    picture: F32
    """(H, W, 3): seams show in it."""
    right: F32
    """(H, W, 3): from a pixel to the next in its row."""
    down: F32
    """(H, W, 3): from a pixel to the next in its column."""


def borrow(picture: F32, hole: Mask) -> Borrowed:
    """`(H, W, 3)` float32 with `hole` (H, W) filled from the rest of the picture; the rest is unchanged."""
    levels = list(_pyramid(picture, hole))
    if not hole.any() or not levels:
        filled = membrane(picture, hole)
        return Borrowed(filled, *_steps(filled))
    guess = membrane(levels[-1].picture, levels[-1].hole)
    field: Shifts | None = None
    for k in range(len(levels) - 1, -1, -1):
        level = levels[k]
        h, w = level.hole.shape
        if field is not None:
            larger = cv2.resize(guess, (w, h), interpolation=cv2.INTER_LINEAR)
            guess = np.where(level.hole[:, :, None], larger, level.picture)
        wholly = [Part(0, 0, level.hole)]
        fresh, moved = guess.copy(), np.zeros((h, w, 2), np.int64)
        rights, downs = _steps(level.picture) if k == 0 else (guess, guess)
        for part in wholly if field is None else _parts(level.hole, level.radius + 1):
            tried = _dense(h, w) if field is None else _finer(field, part, KEPT[min(k, 2)], k)
            target, shift = part.of(fresh), moved[part.top :, part.left :]
            now = part.of(guess).copy()
            for _ in range((1, 2, 3)[min(k, 2)]):
                best = _round(level, part, now, tried)
                window = 2 * level.radius + 1 if k else 5
                now = _vote(level.picture, ~level.hole, part, now, tried, best, window)
            if k == 0:
                for step, down, right in ((rights, 0, 1), (downs, 1, 0)):
                    known = ~(level.hole | np.roll(level.hole, (-down, -right), (0, 1)))
                    part.of(step)[part.hole] = _vote(step, known, part, 0 * now, tried, best, window)[
                        part.hole
                    ]
            target[part.hole] = now[part.hole]
            shift[: part.hole.shape[0], : part.hole.shape[1]][part.hole] = tried[np.maximum(best, 0)][
                part.hole
            ]
        guess, field = fresh, moved
    return Borrowed(guess, rights, downs)


def _steps(picture: F32) -> tuple[F32, F32]:
    right, down = np.zeros_like(picture), np.zeros_like(picture)
    right[:, :-1] = picture[:, 1:] - picture[:, :-1]
    down[:-1] = picture[1:] - picture[:-1]
    return right, down


def _pyramid(picture: F32, hole: Mask) -> Iterator[Level]:
    """From the finest to the coarsest scale that still knows something; the hole grows a little at each."""
    known = (~hole).astype(np.float32)
    value = picture * known[:, :, None]
    for k in range(12):
        now = known < 0.999
        radius = 3 if k == 0 else 2
        width = 2 * radius + 1
        blocked = np.pad(now, radius, constant_values=True).astype(np.uint8)
        sources = cv2.dilate(blocked, np.ones((width, width), np.uint8))[radius:-radius, radius:-radius] == 0
        if sources.sum() < 16:
            return
        yield Level((value / np.maximum(known, 1e-6)[:, :, None]).astype(np.float32), now, sources, radius)
        depth = cv2.distanceTransform(now.astype(np.uint8), cv2.DIST_L2, 3).max()
        if depth < 3.5 or min(now.shape) < 32:
            return
        size = (now.shape[1] + 1) // 2, (now.shape[0] + 1) // 2
        value = np.asarray(cv2.resize(value, size, interpolation=cv2.INTER_AREA), np.float32)
        known = np.asarray(cv2.resize(known, size, interpolation=cv2.INTER_AREA), np.float32)


def _parts(hole: Mask, margin: int) -> Iterator[Part]:
    """Pieces of the hole, those within 2 px of each other together, with a margin within the picture."""
    joined = cv2.dilate(hole.astype(np.uint8), np.ones((5, 5), np.uint8))
    count, ids, stats, _ = cv2.connectedComponentsWithStats(joined, connectivity=8)
    for k in range(1, count):
        x, y, w, h = (int(n) for n in stats[k, :4])
        top, left = max(0, y - margin), max(0, x - margin)
        piece = (slice(top, y + h + margin), slice(left, x + w + margin))
        yield Part(top, left, hole[piece] & (ids[piece] == k))


def _dense(h: int, w: int) -> Shifts:
    """Shifts of the coarsest scale: all that run level or upright, all near ones, and some of the rest."""
    down, right = np.mgrid[-h + 5 : h - 4, -w + 5 : w - 4]
    every = np.stack([down.ravel(), right.ravel()], 1)
    far = np.hypot(every[:, 0], every[:, 1])
    straight = (np.abs(every).min(1) <= 1) & (far > 0)
    rest = every[np.argsort(np.where(straight, np.inf, far), kind="stable")]
    rest = rest[1 : len(every) - int(straight.sum())]
    half = max(0, DENSE - int(straight.sum())) // 2
    if len(rest) > 2 * half:
        rest = np.concatenate([rest[:half], rest[half :: max(1, (len(rest) - half) // max(half, 1))]])
    return np.concatenate([every[straight], rest])


def _finer(field: Shifts, part: Part, most: int, k: int) -> Shifts:
    """The shifts most used by a part at the scale above, doubled, each with its neighbours."""
    h, w = part.hole.shape
    rows = np.minimum((part.top + np.arange(h)) // 2, field.shape[0] - 1)
    columns = np.minimum((part.left + np.arange(w)) // 2, field.shape[1] - 1)
    used = field[rows[:, None], columns[None, :]][part.hole]
    values, counts = np.unique(used, axis=0, return_counts=True)
    values = values[np.argsort(-counts, kind="stable")]
    values = values[np.any(values != 0, axis=1)][:most] * 2
    square = np.mgrid[-1:2, -1:2].reshape(2, -1).T
    reach = square if k > 1 else square[np.abs(square).sum(1) < 2]
    return np.unique((values[:, None] + reach).reshape(-1, 2), axis=0)


def _round(level: Level, part: Part, now: F32, tried: Shifts) -> NDArray[np.int64]:
    """One assignment of shifts: `(h, w)` indices into `tried`, -1 where none has a source."""
    h, w = part.hole.shape
    window = 2 * level.radius + 1
    far = cv2.distanceTransform(np.pad(part.hole, 1).astype(np.uint8), cv2.DIST_L2, 3)[1:-1, 1:-1]
    trust = (np.float32(1.15) ** -far).astype(np.float32)
    total = _sums(trust, window)
    across = 2 * int(far.max() + level.radius) + 1
    outside = (~part.hole).astype(np.float32)
    least = np.full((h, w), np.inf, np.float32)
    best = np.zeros((h, w), np.int64)
    size = float(np.hypot(*level.hole.shape))
    for i, (down, right) in enumerate(tried.tolist()):
        here, there = _meeting((0, h), (0, w), part, level.hole.shape, down, right)
        if here is None:
            continue
        gap = now[here] - level.picture[there]
        gap = np.einsum("ijk,ijk->ij", gap, gap)
        cost = _sums(gap * trust[here], window) / total[here]
        known = outside[here] * ~level.hole[there]
        cost += RIM * _sums(gap * known, across) / (_sums(known, across) + np.float32(1e-3))
        cost *= np.float32(1 + 0.2 * np.hypot(down, right) / size)
        better = (cost < least[here]) & level.sources[there]
        np.copyto(least[here], cost, where=better)
        np.copyto(best[here], i, where=better)
    return np.where(np.isfinite(least), best, -1)


def _sums(values: F32, window: int) -> F32:
    """Sums over squares of `window` px."""
    sums = cv2.boxFilter(values, -1, (window, window), normalize=False, borderType=cv2.BORDER_REFLECT)
    return np.asarray(sums, np.float32)


def _vote(
    values: F32, known: Mask, part: Part, now: F32, tried: Shifts, best: NDArray[np.int64], window: int
) -> F32:
    """What the patches around each pixel would put there, on average; `now` where none would."""
    h, w = part.hole.shape
    total = np.zeros((h, w, 3), np.float32)
    votes = np.zeros((h, w), np.float32)
    for i in np.unique(best[best >= 0]).tolist():
        mine = best == i
        rows, columns = np.flatnonzero(mine.any(1)), np.flatnonzero(mine.any(0))
        height = max(0, int(rows[0]) - window), min(h, int(rows[-1]) + window + 1)
        width = max(0, int(columns[0]) - window), min(w, int(columns[-1]) + window + 1)
        here, there = _meeting(height, width, part, known.shape, *tried[i].tolist())
        if here is None:
            continue
        square = (window, window)
        weight = cv2.boxFilter(
            mine[here].astype(np.float32), -1, square, normalize=False, borderType=cv2.BORDER_CONSTANT
        )
        weight *= known[there]
        total[here] += weight[:, :, None] * values[there]
        votes[here] += weight
    mean = total / np.maximum(votes, np.float32(1e-6))[:, :, None]
    return np.where((part.hole & (votes > 0))[:, :, None], mean, now)


Window = tuple[slice, slice]


def _meeting(
    height: tuple[int, int], width: tuple[int, int], part: Part, size: tuple[int, ...], down: int, right: int
) -> tuple[Window | None, Window]:
    """Rows and columns of a part whose shifted place is in the picture, and that place; None where none is."""
    H, W = size
    top, bottom = max(height[0], -part.top - down), min(height[1], H - part.top - down)
    left, end = max(width[0], -part.left - right), min(width[1], W - part.left - right)
    y, x = part.top + down, part.left + right
    there = slice(y + top, y + bottom), slice(x + left, x + end)
    if top >= bottom or left >= end:
        return None, there
    return (slice(top, bottom), slice(left, end)), there
