"""Exemplar-based fill of holes: PatchMatch over an image pyramid, with grain.

Every patch that reaches into the hole looks for the known patch most like it, and all that overlap vote on the colour;
both are repeated, from coarse to fine (Wexler et al. 2007, Space-time completion of video). Coarse scales compare
every patch with every other; finer ones try the neighbours' places (Barnes et al. 2009, PatchMatch). The coarsest scale
starts from two guesses: rows carried on level, and continued edges, which stay, with a harmonic fill between them. For
each piece of the hole, the one goes on that is most like known patches and departs least from continued edges and from
its surroundings. Comparisons are sums of whole numbers below 2^24: their order, and the machine, change nothing.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.maps import F32
from physgen.perceive.inpaint.edge_continuation import continue_edges
from physgen.perceive.inpaint.poisson import harmonic_fill, nearest_piece, seams
from physgen.perceive.roles import Mask

Places = NDArray[np.int64]
"""(n, 2): rows and columns."""


@dataclass(frozen=True)
class _Tuning:
    """Sizes and limits of the search."""

    radius: int = 3  # px: patches are 7 px wide
    max_pairs: int = 4_000_000  # pairs of patches that are all compared
    # the same where nothing is known yet: sources are then thinned out evenly
    max_first_pairs: int = 20_000_000
    chunk: int = 1_000_000  # pairs that are held in memory
    chosen: int = 2  # scale at which the better of two fills is chosen; finer ones keep no continued edges
    same: float = 16.0  # levels up to which two guesses are one
    # where fills are compared: weight of levels by which one departs from continued edges; chosen on the tune half
    astray: float = 0.18
    seam: float = 3.0  # ... and of seams
    # of search and vote: at the finest scale that is searched, and at coarser ones
    rounds: tuple[int, ...] = (1, 3)
    trust: float = 1.3  # a px deeper in the hole is this many times less trusted
    # squared levels a pixel (of 128) for borrowing from as far as the picture is wide
    distance_cost: float = 60.0
    # squared levels a pixel (of 128) between a patch and its match: where nothing known is like it, the guess stays
    unlike: float = 2000.0
    max_depth: float = 4.5  # px that the hole may be deep at the coarsest scale
    # px: a coarsest scale with more is halved again (photos over three times as wide as high)
    wide: int = 30_000
    grain_blur: float = (
        2.0  # px, standard deviation of the blur that separates grain from colour
    )
    grain_block: int = 16  # px a side of what is copied from one place
    grain_most: float = (
        4.0  # times as strong as around the hole: more is no grain, but an edge
    )
    grain_margin: int = 10  # px around the hole whose grain it takes on
    grain_gain: tuple[float, float] = (
        0.8,
        1.6,
    )  # by which its own grain is scaled, at least and at most


TUNING = _Tuning()
RADIUS = TUNING.radius


@dataclass(frozen=True)
class Level:
    """The picture at one scale."""

    picture: F32  # (H, W, 3); arbitrary in the hole
    hole: Mask  # (H, W)
    drawn: Mask  # (H, W): where, in the hole, the picture holds a continued edge


class _Fill(NamedTuple):
    """A fill at one scale."""

    guess: F32  # (H, W, 3)
    # (H, W, 2): where the patch comes from whose centre is the pixel; None before the first search
    field: NDArray[np.int64] | None
    alike: F32  # (H, W) 0..1: how like that patch is
    cost: F32  # one for each patch that reaches into the hole


class PatchFill(NamedTuple):
    """A filled picture, and the known place that each pixel of the hole is from."""

    picture: F32
    """(H, W, 3): unchanged outside the hole."""
    places: NDArray[np.int64] | None
    """(H, W, 2): rows and columns; None if no whole patch is known."""


def patch_match_fill(picture: F32, hole: Mask) -> PatchFill:
    """Fill `hole` (H, W) of `picture` (H, W, 3) from the rest of the picture."""
    levels = list(image_pyramid(picture, hole, *continue_edges(picture, hole)))
    if not hole.any() or not levels or not patch_centres(levels[-1].hole, RADIUS).any():
        # nowhere a whole patch is left to borrow from
        return PatchFill(harmonic_fill(picture, hole), None)
    top = len(levels) - 1
    last, chosen = levels[-1], min(TUNING.chosen, top)
    shared = {k: _search(levels, k) for k in range(chosen, top + 1)}

    def refined(fill: _Fill, first: int, end: int, keep: bool) -> _Fill:
        for k in range(first, end - 1, -1):
            search = shared.get(k) or _search(levels, k)
            fill = _refined(fill, search, keep)
        return fill

    def started(start: F32, keep: bool) -> _Fill:
        none = _Fill(
            start, None, np.ones(last.hole.shape, np.float32), np.zeros(0, np.float32)
        )
        return refined(none, top, chosen, keep)

    edges, rows = (
        harmonic_fill(last.picture, last.hole & ~last.drawn),
        level_fill(last.picture, last.hole),
    )
    fills = [started(edges, keep=True)]
    if np.abs(edges - rows).max() > TUNING.same:
        fills.append(started(rows, keep=False))
    best = refined(_best_pieces(fills, shared[chosen]), chosen - 1, 0, keep=False)
    assert best.field is not None
    filled = add_grain(best.guess, levels[0].picture, levels[0].hole, best.field)
    return PatchFill(filled, best.field)


def _search(levels: Sequence[Level], k: int) -> _Search:
    """Return the search at scale k; the finest only copies."""
    if k == 0:
        return _Search(levels[k], 2, rounds=0)
    return _Search(levels[k], RADIUS, TUNING.rounds[min(k - 1, 1)])


def _refined(fill: _Fill, search: _Search, keep: bool) -> _Fill:
    """`fill` at one scale, searched and voted on; `keep`: continued edges stay as they were drawn.

    The finest scale only copies, unless nothing was chosen before.
    """
    level = search.level
    guess, field, alike, cost = fill
    h, w = level.hole.shape
    if field is not None:
        larger = cv2.resize(guess, (w, h), interpolation=cv2.INTER_LINEAR)
        guess = np.where(
            (level.hole & ~(level.drawn & keep))[:, :, None], larger, level.picture
        )
        field = _doubled(field, (h, w))
        alike = np.asarray(
            cv2.resize(alike, (w, h), interpolation=cv2.INTER_LINEAR), np.float32
        )
    is_searched = search.rounds > 0 or field is None
    for _ in range(max(search.rounds, 1)):
        if is_searched or field is None:
            field, cost = search.nearest(guess, field)
            alike[search.at[:, 0], search.at[:, 1]] = np.exp(
                -((cost / TUNING.unlike) ** 2)
            )
        else:
            field, cost = search.snapped(field)
        guess = search.vote(
            level.picture,
            guess,
            field,
            (cost, alike),
            search.radius if search.rounds else 1,
        )
        if keep:
            guess = np.where(level.drawn[:, :, None], level.picture, guess)
    return _Fill(guess, field, alike, cost)


def _best_pieces(fills: list[_Fill], search: _Search) -> _Fill:
    """Of each piece of the hole, the fill whose patches are most like known ones; see TUNING."""
    level = search.level
    pieces, inside = nearest_piece(level.hole), level.hole
    at, weight = (
        pieces[search.at[:, 0], search.at[:, 1]],
        search.trust[search.at[:, 0], search.at[:, 1]],
    )
    count = np.maximum(np.bincount(at, weight), 1e-9)
    area = np.maximum(np.bincount(pieces[inside], minlength=len(count)), 1)
    unlike = []
    for fill in fills:
        cost = np.bincount(at, weight * np.sqrt(np.maximum(fill.cost, 0))) / count
        off = np.abs(fill.guess - level.picture).mean(2) * level.drawn
        astray = np.bincount(pieces[inside], off[inside], len(count)) / area
        seam = seams(fill.guess, level.picture, level.hole, pieces)
        unlike.append(cost + TUNING.astray * astray + TUNING.seam * seam)
    at_best = np.argmin(unlike, axis=0)[pieces], *np.indices(pieces.shape)
    guess, alike, field = (
        np.stack([getattr(fill, name) for fill in fills])[at_best]
        for name in ("guess", "alike", "field")
    )
    return _Fill(guess, field, alike, fills[0].cost)


def level_fill(picture: F32, hole: Mask) -> F32:
    """`picture` (H, W, 3), rows of `hole` (H, W) interpolated between their ends: a floor's edge goes on level."""
    filled = harmonic_fill(picture, hole)
    for y in np.flatnonzero(hole.any(1) & ~hole.all(1)):
        inside, known = np.flatnonzero(hole[y]), np.flatnonzero(~hole[y])
        for c in range(3):
            filled[y, inside, c] = np.interp(inside, known, picture[y, known, c])
    return np.where(hole[:, :, None], cv2.GaussianBlur(filled, (0, 0), 0.7), picture)


def thin_out(places: Places, most: int) -> Places:
    """About `most` of them, evenly spread by steps of the golden ratio."""
    part = most / max(len(places), 1)
    if part >= 1:
        return places
    return places[np.arange(len(places)) * ((5**0.5 - 1) / 2) % 1 < part]


def _doubled(field: NDArray[np.int64], size: tuple[int, int]) -> NDArray[np.int64]:
    """Places (H, W, 2) at twice the scale."""
    rows, columns = np.arange(size[0]), np.arange(size[1])
    near = field[
        np.minimum(rows // 2, field.shape[0] - 1)[:, None],
        np.minimum(columns // 2, field.shape[1] - 1),
    ]
    return np.asarray(
        near * 2 + np.stack(np.meshgrid(rows % 2, columns % 2, indexing="ij"), -1)
    )


def image_pyramid(
    picture: F32, hole: Mask, start: F32, strips: Mask
) -> Iterator[Level]:
    """From the finest to the coarsest scale that still has whole known patches; there the hole is shallow."""
    known = (~hole).astype(np.float32)
    value = picture * known[:, :, None]
    part = strips.astype(np.float32)
    strip = start * part[:, :, None]
    for k in range(12):
        now = known < (0.999 if k == 0 else 0.5)
        if patch_centres(now, RADIUS if k else 2).sum() < 64:
            return
        mean, line = (
            v / np.maximum(p, 1e-6)[:, :, None]
            for v, p in ((value, known), (strip, part))
        )
        drawn = now & (part > 0.35)
        yield Level(
            np.where(drawn[:, :, None], line, mean).astype(np.float32), now, drawn
        )
        depth = cv2.distanceTransform(now.astype(np.uint8), cv2.DIST_L2, 3).max()
        if depth < TUNING.max_depth or min(now.shape) < (
            96 if now.size < TUNING.wide else 48
        ):
            return
        size = (now.shape[1] + 1) // 2, (now.shape[0] + 1) // 2
        value, known, strip, part = (
            np.asarray(cv2.resize(a, size, interpolation=cv2.INTER_AREA), np.float32)
            for a in (value, known, strip, part)
        )


def patch_centres(hole: Mask, radius: int) -> Mask:
    """Centres of patches that are known as a whole."""
    blocked = np.pad(hole, radius, constant_values=True).astype(np.uint8)
    blocked = cv2.dilate(blocked, _square(radius)).astype(np.uint8)
    return np.asarray(blocked[radius:-radius, radius:-radius] == 0)


def _square(radius: int) -> NDArray[np.uint8]:
    return np.ones((2 * radius + 1, 2 * radius + 1), np.uint8)


def _halved(picture: F32, r: int) -> F32:
    """`picture` with a border of r px, in whole numbers from -64 to 64."""
    return np.pad(
        np.round(picture / 2) - 64, ((r, r), (r, r), (0, 0)), mode="edge"
    ).astype(np.float32)


class _Search:
    """Patches of one scale, and the search for the known patch most like each."""

    def __init__(self, level: Level, radius: int, rounds: int = 1) -> None:
        self.level, self.radius, self.rounds = level, radius, rounds
        self.distance_cost = np.float32(
            TUNING.distance_cost / np.hypot(*level.hole.shape)
        )
        self.every: tuple[Places, F32, F32] | None = None
        self.sources = patch_centres(level.hole, radius)
        self.source_at: Places = np.argwhere(self.sources)
        touching = cv2.dilate(level.hole.astype(np.uint8), _square(radius)) > 0
        self.at: Places = np.argwhere(touching)
        deep = cv2.distanceTransform(
            np.pad(level.hole, 1).astype(np.uint8), cv2.DIST_L2, 3
        )[1:-1, 1:-1]
        self.trust = np.asarray(TUNING.trust ** -np.minimum(deep, 20), np.float32)
        # nearest source of every pixel: a doubled place need not be one
        _, labels = cv2.distanceTransformWithLabels(
            (~self.sources).astype(np.uint8),
            cv2.DIST_L2,
            5,
            labelType=cv2.DIST_LABEL_PIXEL,
        )
        own = np.zeros((labels.max() + 1, 2), np.int64)
        own[labels[self.sources]] = self.source_at
        self.nearest_source = own[labels]

    @cached_property
    def mask(self) -> F32:
        """(n, width, width): trust in the pixels of the patches at `at`."""
        trust = np.maximum(np.round(7 * self.trust), 1)
        whole = np.pad(trust, self.radius).astype(np.float32)
        return self._patches(whole)[self.at[:, 0], self.at[:, 1]]

    @cached_property
    def halved(self) -> F32:
        """(H + 2 r, W + 2 r, 3): the picture as it is compared."""
        return _halved(self.level.picture, self.radius)

    def _patches(self, padded: F32) -> F32:
        """(H, W, width, width[, 3]) view."""
        width = 2 * self.radius + 1
        view = np.lib.stride_tricks.sliding_window_view(padded, (width, width), (0, 1))
        return np.moveaxis(view, 2, -1) if padded.ndim == 3 else view

    def _field(self, places: Places) -> NDArray[np.int64]:
        """(H, W, 2): `places` at `self.at`, elsewhere each pixel's own."""
        result = np.moveaxis(np.indices(self.level.hole.shape), 0, -1)
        result[self.at[:, 0], self.at[:, 1]] = places
        return result

    def nearest(
        self, guess: F32, field: NDArray[np.int64] | None
    ) -> tuple[NDArray[np.int64], F32]:
        """Centres of the best known patches (H, W, 2), and their costs, one for each of `at`."""
        target = self._patches(_halved(guess, self.radius))[
            self.at[:, 0], self.at[:, 1]
        ]
        if field is None or len(self.at) * len(self.source_at) < TUNING.max_pairs:
            best, cost = self._exhaustive(target)
        else:
            some = np.s_[
                :, ::2, ::2
            ]  # one pixel in four is enough, once the place is roughly known
            best, cost = self._propagated(target[some], self.mask[some], field)
        return self._field(best), cost

    def snapped(self, field: NDArray[np.int64]) -> tuple[NDArray[np.int64], F32]:
        """The centres in `field`, or the nearest that are whole patches; all cost the same.

        The finest scale only copies grain: pieces that stay as they were found keep more of it than smaller ones.
        """
        h, w = self.level.hole.shape
        place = field[self.at[:, 0], self.at[:, 1]]
        snapped = self.nearest_source[
            np.clip(place[:, 0], 0, h - 1), np.clip(place[:, 1], 0, w - 1)
        ]
        return self._field(snapped), np.zeros(len(place), np.float32)

    def _exhaustive(self, target: F32) -> tuple[Places, F32]:
        n, total = len(self.at), self.mask.sum((1, 2))
        if self.every is None:
            places = thin_out(
                self.source_at, max(TUNING.max_first_pairs // max(n, 1), 64)
            )
            there = self._patches(self.halved)[places[:, 0], places[:, 1]]
            square = (there**2).sum(-1)
            down, right = (
                np.subtract.outer(
                    self.at[:, k].astype(np.float32), places[:, k].astype(np.float32)
                )
                for k in (0, 1)
            )
            flat = np.concatenate(
                [there.reshape(len(there), -1), square.reshape(len(there), -1)], 1
            )
            self.every = (
                places,
                flat,
                self.distance_cost * np.hypot(down, right, out=down),
            )
        places, flat, far = self.every
        best, cost = np.zeros(n, np.int64), np.zeros(n, np.float32)
        step = max(TUNING.chunk // max(len(places), 1), 16)
        for k in range(0, n, step):
            part = slice(k, k + step)
            weighted = target[part] * self.mask[part][..., None]
            rows = len(weighted)
            own = (weighted * target[part]).sum((1, 2, 3)) / total[part]
            both = np.concatenate(
                [-2 * weighted.reshape(rows, -1), self.mask[part].reshape(rows, -1)], 1
            )
            gap = both @ flat.T
            gap /= total[part, None]
            gap += far[part]
            best[part] = gap.argmin(1)
            cost[part] = gap[np.arange(rows), best[part]] + own
        return places[best], cost

    def _propagated(
        self, target: F32, mask: F32, field: NDArray[np.int64]
    ) -> tuple[Places, F32]:
        total = mask.sum((1, 2))
        h, w = self.level.hole.shape
        rows, columns = self.at[:, 0], self.at[:, 1]
        best = self.at.copy()
        cost = np.full(len(self.at), np.inf, np.float32)
        wide = w + 2 * self.radius
        some = np.arange(0, 2 * self.radius + 1, 2)
        offsets = (some[:, None] * wide + some).ravel()
        aim, part = target.reshape(len(target), -1, 3), mask.reshape(len(mask), -1)
        flat = self.halved.reshape(-1, 3)

        def attempt(place: Places) -> None:
            place = np.stack(
                [np.clip(place[:, 0], 0, h - 1), np.clip(place[:, 1], 0, w - 1)], 1
            )
            place = self.nearest_source[place[:, 0], place[:, 1]]
            changed = np.flatnonzero((place != best).any(1) | ~np.isfinite(cost))
            there = place[changed]
            gap = flat.take(
                (there[:, 0] * wide + there[:, 1])[:, None] + offsets, axis=0
            )
            gap -= aim.take(changed, axis=0)
            gap *= gap
            got = (
                np.einsum("nkc,nk->n", gap, part.take(changed, axis=0), optimize=False)
                / total[changed]
            )
            got += self.distance_cost * np.hypot(
                *(there - self.at[changed]).astype(np.float32).T
            )
            better = got < cost[changed]
            best[changed[better]] = there[better]
            cost[changed[better]] = got[better]

        attempt(field[rows, columns])
        steps = (3, 1) if self.radius > 2 else (1,)
        for step in steps:
            for down, right in ((0, step), (step, 0), (0, -step), (-step, 0)):
                y, x = (
                    np.clip(rows - down, 0, h - 1),
                    np.clip(columns - right, 0, w - 1),
                )
                now = field.copy()
                now[rows, columns] = best
                attempt(now[y, x] + self.at - np.stack([y, x], 1))
        for down, right in ((0, 1), (1, 0), (0, -1), (-1, 0)):
            attempt(best + np.array([down, right]))
        return best, cost

    def weights(self, cost: F32) -> F32:
        """Weight of each patch in the vote."""
        alike = np.maximum(
            np.exp(-cost / (2 * max(float(np.quantile(cost, 0.75)), 1.0))), 1e-4
        )
        return np.asarray(alike * self.trust[self.at[:, 0], self.at[:, 1]], np.float32)

    def vote(
        self,
        values: F32,
        now: F32,
        field: NDArray[np.int64],
        found: tuple[F32, F32],
        reach: int,
    ) -> F32:
        """The mean of what the patches around each pixel of the hole would put there.

        `found`: the costs of their matches, and (H, W) 0..1 how alike these are;
        one that is not votes for what is there now.
        """
        weight, share = self.weights(found[0]), found[1][self.at[:, 0], self.at[:, 1]]
        h, w = self.level.hole.shape
        there = field[self.at[:, 0], self.at[:, 1]]
        wide = w + 2 * reach
        weighed, kept = (
            np.concatenate([part, np.ones((h, w, 1), np.float32)], 2).reshape(-1, 4)
            for part in (values, now)
        )
        votes = np.zeros((h + 2 * reach, wide, 4), np.float32)
        flat, by = votes.reshape(-1, 4), (weight * share)[:, None]
        unlike = np.flatnonzero(share < 1)
        own, rest = (
            self.at[unlike, 0] * w + self.at[unlike, 1],
            (weight * (1 - share))[unlike, None],
        )
        to, source = self.at[:, 0] * wide + self.at[:, 1], there[:, 0] * w + there[:, 1]
        stride = 2 if reach > 2 else 1  # one in four is enough, where so many overlap
        for down in range(-reach, reach + 1, stride):
            for right in range(-reach, reach + 1, stride):
                place = to + ((down + reach) * wide + right + reach)
                flat[place] += by * weighed.take(source + (down * w + right), axis=0)
                flat[place[unlike]] += rest * kept.take(
                    own + (down * w + right), axis=0, mode="clip"
                )
        inside = (slice(reach, h + reach), slice(reach, w + reach))
        total, count = votes[inside][:, :, :3], votes[inside][:, :, 3:]
        mean = total / np.maximum(count, np.float32(1e-9))
        return np.where(self.level.hole[:, :, None] & (count > 0), mean, now)


def add_grain(guess: F32, picture: F32, hole: Mask, field: NDArray[np.int64]) -> F32:
    """`guess` (H, W, 3) with the grain of `picture` at the place `field` (H, W, 2: row, column) of each pixel.

    A mean of votes is smooth, and smooth patches borrow from smooth places. So the fill's fine part is copied from one
    place alone, which keeps its spectrum, and made as strong as around the hole.
    """
    known = np.where(hole, np.float32(0), np.float32(1))
    near = np.maximum(
        cv2.GaussianBlur(known, (0, 0), TUNING.grain_blur), np.float32(1e-3)
    )
    wide = (
        cv2.GaussianBlur(picture * known[:, :, None], (0, 0), TUNING.grain_blur)
        / near[:, :, None]
    )
    own = np.asarray(picture - wide, np.float32)
    ring = cv2.dilate(hole.astype(np.uint8), _square(TUNING.grain_margin)) > 0
    around = _grain_strength(own[ring & ~hole])
    y, x = np.nonzero(hole)
    fine, even = (
        own[rows, columns]
        for rows, columns in (field[y, x].T, _in_blocks(field, hole).T)
    )
    grain = (
        np.maximum(np.abs(fine), np.abs(even)).max(axis=1) < TUNING.grain_most * around
    )
    fine = np.where(grain[:, None], even, fine)
    inside = _grain_strength(fine)
    if around > 0 and inside > 0:
        fine *= np.float32(np.clip(around / inside, *TUNING.grain_gain))
    copied = (grain | _coherent(field)[y, x])[:, None]
    result = guess.copy()
    result[y, x] = np.where(
        copied,
        cv2.GaussianBlur(guess, (0, 0), TUNING.grain_blur)[y, x] + fine,
        guess[y, x],
    )
    return result


def _coherent(field: NDArray[np.int64]) -> Mask:
    """(H, W): where neighbours are copied from neighbours: an edge from many places is no line."""
    off = field.astype(np.float32) - np.moveaxis(
        np.indices(field.shape[:2], np.float32), 0, -1
    )
    return np.asarray(
        (cv2.dilate(off, _square(2)) - cv2.erode(off, _square(2))).max(axis=2) <= 2
    )


def _in_blocks(field: NDArray[np.int64], hole: Mask) -> Places:
    """`field` at each pixel of the hole, but whole blocks as their middles, where that is known: else patterns show."""
    here, side, last = np.argwhere(hole), TUNING.grain_block, np.array(hole.shape) - 1
    middle = np.minimum(here // side * side + side // 2, last)
    moved = here + field[middle[:, 0], middle[:, 1]] - middle
    there = np.clip(moved, 0, last)
    known = (there == moved).all(axis=1) & ~hole[there[:, 0], there[:, 1]]
    return np.where(known[:, None], moved, field[here[:, 0], here[:, 1]])


def _grain_strength(fine: F32) -> float:
    """Levels, of (n, 3): the root of a median, so that an edge among them does not count as grain."""
    return float(np.median((fine**2).mean(axis=1)) ** 0.5) if len(fine) else 0.0
