"""Exemplar-based fill of holes: PatchMatch over an image pyramid, with grain. For every
patch that overlaps the hole, the most similar known patch is searched, and all
overlapping patches vote on the colour. Both steps are repeated from coarse to fine
(Wexler et al. 2007, Space-time completion of video). Coarse scales compare all pairs of
patches; finer ones try the neighbours' sources (Barnes et al. 2009, PatchMatch). The
coarsest scale starts from two guesses: level rows, and continued edges, which stay,
with a harmonic fill between them. For each piece of the hole, the guess with the more
similar patches and the smaller departures from continued edges and surroundings is
used. Comparisons are sums of whole numbers below 2^24, so that neither their order nor
the machine changes the result.
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
from physgen.perceive.inpaint.grain import Places, add_grain, square
from physgen.perceive.inpaint.poisson import (
    blur_known_pixels,
    harmonic_fill,
    nearest_piece,
    seams,
)
from physgen.perceive.roles import Mask


@dataclass(frozen=True)
class _Tuning:
    """Sizes and limits of the search."""

    # px: patches are 7 px wide.
    radius: int = 3
    # Largest number of pairs of patches for an exhaustive comparison.
    max_pairs: int = 4_000_000
    # The same in the first search, in which sources are then thinned out evenly.
    max_first_pairs: int = 20_000_000
    # Pairs in memory at once.
    chunk: int = 1_000_000
    # Scale at which the better of two fills is chosen; finer scales keep no continued
    # edges.
    choice_scale: int = 2
    # Levels: largest difference between equal guesses.
    equality: float = 16.0
    # Weight of departures from continued edges in the choice of a fill, per level;
    # chosen on the tuning half ...
    departure_weight: float = 0.18
    # ... and the weight of seams.
    seam_weight: float = 3.0
    # Weight of departures from rows with the same colour on both sides of the hole, per
    # level, ...
    row_weight: float = 0.2
    # ... above this many levels.
    row_tolerance: float = 12.0
    # Rounds of search and vote: at the finest searched scale, and at coarser ones.
    rounds: tuple[int, ...] = (1, 3)
    # Factor by which trust decreases per px of depth in the hole.
    trust: float = 1.3
    # Squared levels per pixel (of 128) for a source as far away as the picture is wide.
    distance_cost: float = 60.0
    # Squared levels per pixel (of 128) between a patch and its match: if no known patch
    # is similar, the guess stays.
    dissimilarity: float = 2000.0
    # px: largest depth of the hole at the coarsest scale.
    max_depth: float = 4.5
    # px: a coarsest scale with more pixels is halved again (photos over three times as
    # wide as high).
    max_pixels: int = 30_000


TUNING = _Tuning()
RADIUS = TUNING.radius
# px: standard deviation of the blur of colours beside the hole, against grain.
GRAIN_BLUR = 2.0


@dataclass(frozen=True)
class Level:
    """The picture at one scale."""

    # (H, W, 3); arbitrary in the hole.
    picture: F32
    hole: Mask  # (H, W)
    # (H, W): pixels of the hole with a continued edge.
    edge_mask: Mask


class _Fill(NamedTuple):
    """A fill at one scale."""

    guess: F32  # (H, W, 3)
    # (H, W, 2): source of the patch centred at each pixel; None before the first
    # search.
    field: NDArray[np.int64] | None
    # (H, W) 0..1: similarity of that source.
    similarity: F32
    # One value per patch over the hole.
    cost: F32

    @property
    def errors(self) -> F32:
        """Return the roots of the costs."""
        return np.asarray(np.sqrt(np.maximum(self.cost, 0)), np.float32)


class PatchFill(NamedTuple):
    """A filled picture, and the known source of each pixel of the hole."""

    picture: F32
    """(H, W, 3): unchanged outside the hole."""
    places: NDArray[np.int64] | None
    """(H, W, 2): rows and columns; None if no whole patch is known."""


def patch_match_fill(picture: F32, hole: Mask) -> PatchFill:
    """Fill `hole` (H, W) of `picture` (H, W, 3) from the rest of the picture."""
    levels = list(image_pyramid(picture, hole, *continue_edges(picture, hole)))
    if not hole.any() or not levels or not patch_centres(levels[-1].hole, RADIUS).any():
        # No complete patch is known, so there is no source.
        return PatchFill(harmonic_fill(picture, hole), None)
    top = len(levels) - 1
    last, choice_scale = levels[-1], min(TUNING.choice_scale, top)
    # Both fills share the searches of the coarse scales.
    searches = {k: _search(levels, k) for k in range(choice_scale, top + 1)}

    def refine(fill: _Fill, first: int, end: int, keep: bool) -> _Fill:
        for k in range(first, end - 1, -1):
            search = searches.get(k) or _search(levels, k)
            fill = _refine(fill, search, keep)
        return fill

    def start_fill(start: F32, keep: bool) -> _Fill:
        empty_fill = _Fill(
            start, None, np.ones(last.hole.shape, np.float32), np.zeros(0, np.float32)
        )
        return refine(empty_fill, top, choice_scale, keep)

    edges, rows = (
        harmonic_fill(last.picture, last.hole & ~last.edge_mask),
        level_fill(last.picture, last.hole),
    )
    # The first guess keeps continued edges, the second one continues rows.
    fills = [start_fill(edges, keep=True)]
    if np.abs(edges - rows).max() > TUNING.equality:
        fills.append(start_fill(rows, keep=False))
    best = refine(
        _best_pieces(fills, searches[choice_scale]), choice_scale - 1, 0, keep=False
    )
    assert best.field is not None
    picture_with_grain = add_grain(
        best.guess, levels[0].picture, levels[0].hole, best.field
    )
    return PatchFill(picture_with_grain, best.field)


def _search(levels: Sequence[Level], k: int) -> _Search:
    """Return the search at scale k; the finest scale only copies."""
    if k == 0:
        return _Search(levels[k], 2, rounds=0)
    return _Search(levels[k], RADIUS, TUNING.rounds[min(k - 1, 1)])


def _refine(fill: _Fill, search: _Search, keep: bool) -> _Fill:
    """Return `fill` at one scale after search and vote; `keep` preserves continued
    edges.

    The finest scale only copies, unless there was no choice before.
    """
    level = search.level
    guess, field, similarity, cost = fill
    h, w = level.hole.shape
    if field is not None:
        larger = cv2.resize(guess, (w, h), interpolation=cv2.INTER_LINEAR)
        guess = np.where(
            (level.hole & ~(level.edge_mask & keep))[:, :, None], larger, level.picture
        )
        field = _upscale_sources(field, (h, w))
        similarity = np.asarray(
            cv2.resize(similarity, (w, h), interpolation=cv2.INTER_LINEAR), np.float32
        )
    must_search = search.rounds > 0 or field is None
    for _ in range(max(search.rounds, 1)):
        if must_search or field is None:
            field, cost = search.nearest(guess, field)
            similarity[search.at[:, 0], search.at[:, 1]] = np.exp(
                -((cost / TUNING.dissimilarity) ** 2)
            )
        else:
            field, cost = search.snap_sources(field)
        guess = search.vote(
            level.picture,
            guess,
            field,
            (cost, similarity),
            search.radius if search.rounds else 1,
        )
        if keep:
            guess = np.where(level.edge_mask[:, :, None], level.picture, guess)
    return _Fill(guess, field, similarity, cost)


def _best_pieces(fills: list[_Fill], search: _Search) -> _Fill:
    """Return, for each piece of the hole, the fill with the patches most like known
    ones.
    """
    pieces = nearest_piece(search.level.hole)
    at_best = (
        np.argmin(_piece_costs(fills, search, pieces), axis=0)[pieces],
        *np.indices(pieces.shape),
    )
    guess, similarity, field = (
        np.stack([getattr(fill, name) for fill in fills])[at_best]
        for name in ("guess", "similarity", "field")
    )
    return _Fill(guess, field, similarity, fills[0].cost)


def _piece_costs(
    fills: list[_Fill], search: _Search, pieces: NDArray[np.int32]
) -> list[NDArray[np.float64]]:
    """Return, per fill, the costs of all pieces; `pieces` (H, W) are their numbers."""
    picture, hole = search.level.picture, search.level.hole
    patch_pieces, weight = (
        values[search.at[:, 0], search.at[:, 1]] for values in (pieces, search.trust)
    )
    count = np.maximum(np.bincount(patch_pieces, weight), 1e-9)
    area = np.maximum(np.bincount(pieces[hole], minlength=len(count)), 1)

    def average(values: F32) -> NDArray[np.float64]:
        return np.asarray(np.bincount(pieces[hole], values[hole], len(count)) / area)

    rows, row_error = _row_colours(picture, hole)
    costs = []
    for fill in fills:
        cost = np.bincount(patch_pieces, weight * fill.errors) / count
        astray = average(np.abs(fill.guess - picture).mean(2) * search.level.edge_mask)
        seam = seams(fill.guess, picture, hole, pieces)
        row_gap = average(
            np.maximum(np.abs(fill.guess - rows).mean(axis=2) - row_error, 0)
        )
        costs.append(
            cost
            + TUNING.departure_weight * astray
            + TUNING.seam_weight * seam
            + TUNING.row_weight * row_gap
        )
    return costs


def level_fill(picture: F32, hole: Mask) -> F32:
    """Return `picture` with each row of `hole` (H, W) interpolated between its ends.

    The far edge of a floor, for example, continues level.
    """
    result = harmonic_fill(picture, hole)
    for y in np.flatnonzero(hole.any(1) & ~hole.all(1)):
        inside, known_columns = np.flatnonzero(hole[y]), np.flatnonzero(~hole[y])
        for c in range(3):
            result[y, inside, c] = np.interp(
                inside, known_columns, picture[y, known_columns, c]
            )
    return np.where(hole[:, :, None], cv2.GaussianBlur(result, (0, 0), 0.7), picture)


def _row_colours(picture: F32, hole: Mask) -> tuple[F32, F32]:
    """Return colours (H, W, 3) between the ends of each row of `hole` (H, W), and their
    tolerance (H, W) in levels.

    The tolerance grows with the difference between both ends and is infinite if one end
    is unknown.
    """
    columns = np.arange(hole.shape[1])
    left = np.maximum.accumulate(np.where(hole, -1, columns), axis=1)
    last = hole.shape[1]
    right = np.minimum.accumulate(np.where(hole, last, columns)[:, ::-1], axis=1)
    right = right[:, ::-1]
    rows = np.arange(len(hole))[:, None]
    known = (~hole)[..., None].astype(np.float32)
    smooth_picture = blur_known_pixels(picture, known, GRAIN_BLUR)
    ends = [smooth_picture[rows, np.clip(end, 0, last - 1)] for end in (left, right)]
    error = TUNING.row_tolerance + np.abs(ends[0] - ends[1]).mean(axis=2)
    error[(left < 0) | (right == last)] = np.inf
    share = ((columns - left) / np.maximum(right - left, 1))[..., None]
    colours = (1 - share) * ends[0] + share * ends[1]
    return np.asarray(colours, np.float32), np.asarray(error, np.float32)


def thin_out(places: Places, most: int) -> Places:
    """Return about `most` of the places, evenly spread by steps of the golden ratio."""
    part = most / max(len(places), 1)
    if part >= 1:
        return places
    return places[np.arange(len(places)) * ((5**0.5 - 1) / 2) % 1 < part]


def _upscale_sources(
    field: NDArray[np.int64], size: tuple[int, int]
) -> NDArray[np.int64]:
    """Return sources (H, W, 2) at twice the scale."""
    rows, columns = np.arange(size[0]), np.arange(size[1])
    coarse_sources = field[
        np.minimum(rows // 2, field.shape[0] - 1)[:, None],
        np.minimum(columns // 2, field.shape[1] - 1),
    ]
    return np.asarray(
        coarse_sources * 2
        + np.stack(np.meshgrid(rows % 2, columns % 2, indexing="ij"), -1)
    )


def image_pyramid(
    picture: F32, hole: Mask, start: F32, strips: Mask
) -> Iterator[Level]:
    """Yield scales from the finest to the coarsest with whole known patches.

    At the coarsest scale the hole is shallow.
    """
    known_share = (~hole).astype(np.float32)
    value = picture * known_share[:, :, None]
    part = strips.astype(np.float32)
    strip = start * part[:, :, None]
    for k in range(12):
        level_hole = known_share < (0.999 if k == 0 else 0.5)
        if patch_centres(level_hole, RADIUS if k else 2).sum() < 64:
            return
        # Means of the known pixels, and of the strips of continued edges.
        mean, line = (
            v / np.maximum(p, 1e-6)[:, :, None]
            for v, p in ((value, known_share), (strip, part))
        )
        edge_mask = level_hole & (part > 0.35)
        yield Level(
            np.where(edge_mask[:, :, None], line, mean).astype(np.float32),
            level_hole,
            edge_mask,
        )
        depth = cv2.distanceTransform(level_hole.astype(np.uint8), cv2.DIST_L2, 3).max()
        if depth < TUNING.max_depth or min(level_hole.shape) < (
            96 if level_hole.size < TUNING.max_pixels else 48
        ):
            return
        size = (level_hole.shape[1] + 1) // 2, (level_hole.shape[0] + 1) // 2
        value, known_share, strip, part = (
            np.asarray(cv2.resize(a, size, interpolation=cv2.INTER_AREA), np.float32)
            for a in (value, known_share, strip, part)
        )


def patch_centres(hole: Mask, radius: int) -> Mask:
    """Return the centres of completely known patches."""
    incomplete = np.pad(hole, radius, constant_values=True).astype(np.uint8)
    incomplete = cv2.dilate(incomplete, square(radius)).astype(np.uint8)
    return np.asarray(incomplete[radius:-radius, radius:-radius] == 0)


def _quantize_and_pad(picture: F32, r: int) -> F32:
    """Return `picture` with a border of r px, as whole numbers from -64 to 64."""
    return np.pad(
        np.round(picture / 2) - 64, ((r, r), (r, r), (0, 0)), mode="edge"
    ).astype(np.float32)


class _Search:
    """The patches of one scale, and the search for the most similar known patch of
    each.
    """

    def __init__(self, level: Level, radius: int, rounds: int = 1) -> None:
        self.level, self.radius, self.rounds = level, radius, rounds
        self.distance_cost = np.float32(
            TUNING.distance_cost / np.hypot(*level.hole.shape)
        )
        self.sources = patch_centres(level.hole, radius)
        self.source_at: Places = np.argwhere(self.sources)
        touching = cv2.dilate(level.hole.astype(np.uint8), square(radius)) > 0
        self.at: Places = np.argwhere(touching)
        depth = cv2.distanceTransform(
            np.pad(level.hole, 1).astype(np.uint8), cv2.DIST_L2, 3
        )[1:-1, 1:-1]
        self.trust = np.asarray(TUNING.trust ** -np.minimum(depth, 20), np.float32)
        # The nearest source of every pixel: a doubled place need not be a source.
        _, labels = cv2.distanceTransformWithLabels(
            (~self.sources).astype(np.uint8),
            cv2.DIST_L2,
            5,
            labelType=cv2.DIST_LABEL_PIXEL,
        )
        nearest_places = np.zeros((labels.max() + 1, 2), np.int64)
        nearest_places[labels[self.sources]] = self.source_at
        self.nearest_source = nearest_places[labels]

    @cached_property
    def mask(self) -> F32:
        """Return the trust (n, width, width) in the pixels of the patches at `at`."""
        trust = np.maximum(np.round(7 * self.trust), 1)
        padded_trust = np.pad(trust, self.radius).astype(np.float32)
        return self._patches(padded_trust)[self.at[:, 0], self.at[:, 1]]

    @cached_property
    def half_levels(self) -> F32:
        """Return the picture (H + 2 r, W + 2 r, 3) as whole numbers for comparisons."""
        return _quantize_and_pad(self.level.picture, self.radius)

    def _patches(self, padded: F32) -> F32:
        """Return a view (H, W, width, width[, 3]) of all patches."""
        width = 2 * self.radius + 1
        view = np.lib.stride_tricks.sliding_window_view(padded, (width, width), (0, 1))
        return np.moveaxis(view, 2, -1) if padded.ndim == 3 else view

    def _field(self, places: Places) -> NDArray[np.int64]:
        """Return sources (H, W, 2): `places` at `self.at`, elsewhere each pixel's own
        place.
        """
        result = np.moveaxis(np.indices(self.level.hole.shape), 0, -1)
        result[self.at[:, 0], self.at[:, 1]] = places
        return result

    def nearest(
        self, guess: F32, field: NDArray[np.int64] | None
    ) -> tuple[NDArray[np.int64], F32]:
        """Return the centres (H, W, 2) of the most similar known patches, and costs per
        `at`.
        """
        target = self._patches(_quantize_and_pad(guess, self.radius))[
            self.at[:, 0], self.at[:, 1]
        ]
        if field is None or len(self.at) * len(self.source_at) < TUNING.max_pairs:
            best, cost = self._exhaustive(target)
        else:
            # Once the source is roughly known, one pixel in four suffices.
            subsample = np.s_[:, ::2, ::2]
            best, cost = self._propagate_sources(
                target[subsample], self.mask[subsample], field
            )
        return self._field(best), cost

    def snap_sources(self, field: NDArray[np.int64]) -> tuple[NDArray[np.int64], F32]:
        """Return the centres in `field`, or the nearest complete patches; all costs are
        0.

        The finest scale only copies grain, and large unchanged pieces keep more of it
        than small ones.
        """
        h, w = self.level.hole.shape
        place = field[self.at[:, 0], self.at[:, 1]]
        sources = self.nearest_source[
            np.clip(place[:, 0], 0, h - 1), np.clip(place[:, 1], 0, w - 1)
        ]
        return self._field(sources), np.zeros(len(place), np.float32)

    @cached_property
    def all_sources(self) -> _Sources:
        """Return all sources, thinned out evenly if there are too many."""
        places = thin_out(
            self.source_at, max(TUNING.max_first_pairs // max(len(self.at), 1), 64)
        )
        patches = self._patches(self.half_levels)[places[:, 0], places[:, 1]]
        squares = (patches**2).sum(-1)
        down, right = (
            np.subtract.outer(
                self.at[:, k].astype(np.float32), places[:, k].astype(np.float32)
            )
            for k in (0, 1)
        )
        vectors = np.concatenate(
            [patches.reshape(len(patches), -1), squares.reshape(len(patches), -1)], 1
        )
        distances = np.hypot(down, right, out=down)
        return _Sources(places, vectors, self.distance_cost * distances)

    def _exhaustive(self, target: F32) -> tuple[Places, F32]:
        """Return the best of all sources for each patch, and the costs."""
        n, total = len(self.at), self.mask.sum((1, 2))
        sources = self.all_sources
        best, cost = np.zeros(n, np.int64), np.zeros(n, np.float32)
        step = max(TUNING.chunk // max(len(sources.places), 1), 16)
        for k in range(0, n, step):
            part = slice(k, k + step)
            # The squared difference is expanded, so that a matrix product compares all
            # pairs.
            weighted_target = target[part] * self.mask[part][..., None]
            rows = len(weighted_target)
            own_squares = (weighted_target * target[part]).sum((1, 2, 3)) / total[part]
            query = np.concatenate(
                [
                    -2 * weighted_target.reshape(rows, -1),
                    self.mask[part].reshape(rows, -1),
                ],
                1,
            )
            gap = query @ sources.vectors.T
            gap /= total[part, None]
            gap += sources.distance_costs[part]
            best[part] = gap.argmin(1)
            cost[part] = gap[np.arange(rows), best[part]] + own_squares
        return sources.places[best], cost

    def _propagate_sources(
        self, target: F32, mask: F32, field: NDArray[np.int64]
    ) -> tuple[Places, F32]:
        """Return the best sources among those of the neighbours, and the costs."""
        h, w = self.level.hole.shape
        rows, columns = self.at[:, 0], self.at[:, 1]
        matches = _Matches(self, target, mask)
        matches.attempt(field[rows, columns])
        steps = (3, 1) if self.radius > 2 else (1,)
        for step in steps:
            # The source of a neighbour, shifted back, is a good candidate (Barnes et
            # al. 2009).
            for down, right in ((0, step), (step, 0), (0, -step), (-step, 0)):
                y = np.clip(rows - down, 0, h - 1)
                x = np.clip(columns - right, 0, w - 1)
                current_field = field.copy()
                current_field[rows, columns] = matches.best
                matches.attempt(current_field[y, x] + self.at - np.stack([y, x], 1))
        # Finally try the four neighbours of each source.
        for down, right in ((0, 1), (1, 0), (0, -1), (-1, 0)):
            matches.attempt(matches.best + np.array([down, right]))
        return matches.best, matches.cost

    def weights(self, cost: F32) -> F32:
        """Return the weight of each patch in the vote."""
        similarity = np.maximum(
            np.exp(-cost / (2 * max(float(np.quantile(cost, 0.75)), 1.0))), 1e-4
        )
        return np.asarray(
            similarity * self.trust[self.at[:, 0], self.at[:, 1]], np.float32
        )

    def vote(
        self,
        values: F32,
        now: F32,
        field: NDArray[np.int64],
        found: tuple[F32, F32],
        reach: int,
    ) -> F32:
        """Return the mean of the colours that overlapping patches propose for each
        pixel.

        `found` is the costs of their matches, and (H, W) 0..1 the similarity; a
        dissimilar patch votes for the current colour.
        """
        weight, share = self.weights(found[0]), found[1][self.at[:, 0], self.at[:, 1]]
        h, w = self.level.hole.shape
        targets = self.at @ np.array([w + 2 * reach, 1])
        sources = field[self.at[:, 0], self.at[:, 1]] @ np.array([w, 1])
        matches = _Votes(_add_ones(values), sources, targets, (weight * share)[:, None])
        doubtful = np.flatnonzero(share < 1)
        own_places = self.at[doubtful] @ np.array([w, 1])
        own_weights = (weight * (1 - share))[doubtful, None]
        owns = _Votes(_add_ones(now), own_places, targets[doubtful], own_weights)
        sums = _count_votes((matches, owns), (h, w), reach)
        total, count = sums[:, :, :3], sums[:, :, 3:]
        mean = total / np.maximum(count, np.float32(1e-9))
        return np.where(self.level.hole[:, :, None] & (count > 0), mean, now)


class _Sources(NamedTuple):
    """Known patches for a comparison with all patches over the hole."""

    places: Places
    # (n, k): values of the patches, then their squares.
    vectors: F32
    # (m, n): cost of the distance from each patch over the hole.
    distance_costs: F32


class _Matches:
    """The best known source of each patch so far."""

    def __init__(self, search: _Search, target: F32, mask: F32) -> None:
        """Start without sources; `target` (n, k, k, 3) are values of the patches,
        `mask` (n, k, k) the trust in them, at every second pixel.
        """
        self.search = search
        self.best = search.at.copy()
        self.cost = np.full(len(search.at), np.inf, np.float32)
        self.total = mask.sum((1, 2))
        self.target = target.reshape(len(target), -1, 3)
        self.mask = mask.reshape(len(mask), -1)
        self.row_length = search.level.hole.shape[1] + 2 * search.radius
        window_steps = np.arange(0, 2 * search.radius + 1, 2)
        self.offsets = (window_steps[:, None] * self.row_length + window_steps).ravel()

    def attempt(self, places: Places) -> None:
        """Use the known patches nearest to `places` (n, 2) where they are better."""
        h, w = self.search.level.hole.shape
        places = self.search.nearest_source[
            np.clip(places[:, 0], 0, h - 1), np.clip(places[:, 1], 0, w - 1)
        ]
        changed = np.flatnonzero((places != self.best).any(1) | ~np.isfinite(self.cost))
        places = places[changed]
        cost = self._costs(changed, places)
        better = cost < self.cost[changed]
        self.best[changed[better]] = places[better]
        self.cost[changed[better]] = cost[better]

    def _costs(self, indices: NDArray[np.int64], places: Places) -> F32:
        """Return the costs (n,) of `places` (n, 2) for the patches `indices`."""
        search = self.search
        first = places[:, 0] * self.row_length + places[:, 1]
        gap = search.half_levels.reshape(-1, 3).take(
            first[:, None] + self.offsets, axis=0
        )
        gap -= self.target.take(indices, axis=0)
        gap *= gap
        mask = self.mask.take(indices, axis=0)
        cost = np.einsum("nkc,nk->n", gap, mask, optimize=False) / self.total[indices]
        shifts = (places - search.at[indices]).astype(np.float32)
        cost += search.distance_cost * np.hypot(*shifts.T)
        return np.asarray(cost, np.float32)


class _Votes(NamedTuple):
    """Colours that patches propose for the pixels around their centres."""

    # (H W, 4): colours, and 1.
    values: F32
    # (n,): index of the proposed patches' centres in `values`.
    sources: NDArray[np.int64]
    # (n,): index of the voting patches' upper left corners among the votes.
    targets: NDArray[np.int64]
    # (n, 1).
    weights: F32

    def add(self, sums: F32, step: int, place: tuple[int, int]) -> None:
        """Add one pixel of each patch to `sums` (h, w, 4), in place.

        `step` is the pixel's index from the centre, `place` its row and column from the
        corner.
        """
        flat_sums = sums.reshape(-1, 4)
        targets = self.targets + (place[0] * sums.shape[1] + place[1])
        flat_sums[targets] += self.weights * self.values.take(
            self.sources + step, axis=0, mode="clip"
        )


def _count_votes(parts: Sequence[_Votes], size: tuple[int, int], reach: int) -> F32:
    """Return the sums (h, w, 4) of colours and weights that patches propose.

    Patches reach `reach` px from their centres.
    """
    h, w = size
    sums = np.zeros((h + 2 * reach, w + 2 * reach, 4), np.float32)
    # With so many overlapping patches, one in four suffices.
    stride = 2 if reach > 2 else 1
    for down in range(-reach, reach + 1, stride):
        for right in range(-reach, reach + 1, stride):
            for votes in parts:
                votes.add(sums, down * w + right, (down + reach, right + reach))
    return sums[reach : h + reach, reach : w + reach]


def _add_ones(picture: F32) -> F32:
    """Return colours (H W, 4) of a picture (H, W, 3), with a weight of 1."""
    ones = np.ones((*picture.shape[:2], 1), np.float32)
    return np.concatenate([picture, ones], 2).reshape(-1, 4)
