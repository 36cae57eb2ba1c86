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
from physgen.perceive.inpaint.poisson import (
    blur_known_pixels,
    harmonic_fill,
    nearest_piece,
    seams,
)
from physgen.perceive.roles import Mask

Places = NDArray[np.int64]
"""(n, 2): rows and columns."""


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
    chosen: int = 2
    # Levels: largest difference between equal guesses.
    same: float = 16.0
    # Weight of departures from continued edges in the choice of a fill, per level;
    # chosen on the tuning half ...
    astray: float = 0.18
    # ... and the weight of seams.
    seam: float = 3.0
    # Weight of departures from rows with the same colour on both sides of the hole, per
    # level, ...
    across: float = 0.2
    # ... above this many levels.
    same_row: float = 12.0
    # Rounds of search and vote: at the finest searched scale, and at coarser ones.
    rounds: tuple[int, ...] = (1, 3)
    # Factor by which trust decreases per px of depth in the hole.
    trust: float = 1.3
    # Squared levels per pixel (of 128) for a source as far away as the picture is wide.
    distance_cost: float = 60.0
    # Squared levels per pixel (of 128) between a patch and its match: if no known patch
    # is similar, the guess stays.
    unlike: float = 2000.0
    # px: largest depth of the hole at the coarsest scale.
    max_depth: float = 4.5
    # px: a coarsest scale with more pixels is halved again (photos over three times as
    # wide as high).
    wide: int = 30_000
    # px: standard deviation of the blur between grain and colour.
    grain_blur: float = 2.0
    # px: side of blocks with one source of grain.
    grain_block: int = 16
    # Largest strength of grain over that around the hole; more is an edge.
    grain_most: float = 4.0
    # px around the hole from which grain is measured.
    grain_margin: int = 10
    # Least and largest factor of the fill's grain.
    grain_gain: tuple[float, float] = (
        0.8,
        1.6,
    )


TUNING = _Tuning()
RADIUS = TUNING.radius


@dataclass(frozen=True)
class Level:
    """The picture at one scale."""

    # (H, W, 3); arbitrary in the hole.
    picture: F32
    hole: Mask  # (H, W)
    # (H, W): pixels of the hole with a continued edge.
    drawn: Mask


class _Fill(NamedTuple):
    """A fill at one scale."""

    guess: F32  # (H, W, 3)
    # (H, W, 2): source of the patch centred at each pixel; None before the first
    # search.
    field: NDArray[np.int64] | None
    # (H, W) 0..1: similarity of that source.
    alike: F32
    # One value per patch over the hole.
    cost: F32


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
    last, choice_scale = levels[-1], min(TUNING.chosen, top)
    # Both fills share the searches of the coarse scales.
    searches = {k: _search(levels, k) for k in range(choice_scale, top + 1)}

    def refined(fill: _Fill, first: int, end: int, keep: bool) -> _Fill:
        for k in range(first, end - 1, -1):
            search = searches.get(k) or _search(levels, k)
            fill = _refined(fill, search, keep)
        return fill

    def started(start: F32, keep: bool) -> _Fill:
        empty_fill = _Fill(
            start, None, np.ones(last.hole.shape, np.float32), np.zeros(0, np.float32)
        )
        return refined(empty_fill, top, choice_scale, keep)

    edges, rows = (
        harmonic_fill(last.picture, last.hole & ~last.drawn),
        level_fill(last.picture, last.hole),
    )
    # The first guess keeps continued edges, the second one continues rows.
    fills = [started(edges, keep=True)]
    if np.abs(edges - rows).max() > TUNING.same:
        fills.append(started(rows, keep=False))
    best = refined(
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


def _refined(fill: _Fill, search: _Search, keep: bool) -> _Fill:
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
            (level.hole & ~(level.drawn & keep))[:, :, None], larger, level.picture
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
                -((cost / TUNING.unlike) ** 2)
            )
        else:
            field, cost = search.snapped(field)
        guess = search.vote(
            level.picture,
            guess,
            field,
            (cost, similarity),
            search.radius if search.rounds else 1,
        )
        if keep:
            guess = np.where(level.drawn[:, :, None], level.picture, guess)
    return _Fill(guess, field, similarity, cost)


def _best_pieces(fills: list[_Fill], search: _Search) -> _Fill:
    """Return, for each piece of the hole, the fill with the patches most like known
    ones.
    """
    level = search.level
    pieces, inside = nearest_piece(level.hole), level.hole
    piece_numbers, weight = (
        pieces[search.at[:, 0], search.at[:, 1]],
        search.trust[search.at[:, 0], search.at[:, 1]],
    )
    count = np.maximum(np.bincount(piece_numbers, weight), 1e-9)
    area = np.maximum(np.bincount(pieces[inside], minlength=len(count)), 1)
    scores = []
    rows, row_error = _row_colours(level.picture, inside)
    for fill in fills:
        cost = (
            np.bincount(piece_numbers, weight * np.sqrt(np.maximum(fill.cost, 0)))
            / count
        )
        departures = np.abs(fill.guess - level.picture).mean(2) * level.drawn
        astray = np.bincount(pieces[inside], departures[inside], len(count)) / area
        seam = seams(fill.guess, level.picture, level.hole, pieces)
        excess = np.maximum(np.abs(fill.guess - rows).mean(axis=2) - row_error, 0)
        row_gap = np.bincount(pieces[inside], excess[inside], len(count)) / area
        scores.append(
            cost + TUNING.astray * astray + TUNING.seam * seam + TUNING.across * row_gap
        )
    at_best = np.argmin(scores, axis=0)[pieces], *np.indices(pieces.shape)
    guess, similarity, field = (
        np.stack([getattr(fill, name) for fill in fills])[at_best]
        for name in ("guess", "alike", "field")
    )
    return _Fill(guess, field, similarity, fills[0].cost)


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
    smooth_picture = blur_known_pixels(picture, known, TUNING.grain_blur)
    ends = [smooth_picture[rows, np.clip(end, 0, last - 1)] for end in (left, right)]
    error = TUNING.same_row + np.abs(ends[0] - ends[1]).mean(axis=2)
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
            96 if level_hole.size < TUNING.wide else 48
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
    incomplete = cv2.dilate(incomplete, _square(radius)).astype(np.uint8)
    return np.asarray(incomplete[radius:-radius, radius:-radius] == 0)


def _square(radius: int) -> NDArray[np.uint8]:
    return np.ones((2 * radius + 1, 2 * radius + 1), np.uint8)


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
        self.every: tuple[Places, F32, F32] | None = None
        self.sources = patch_centres(level.hole, radius)
        self.source_at: Places = np.argwhere(self.sources)
        touching = cv2.dilate(level.hole.astype(np.uint8), _square(radius)) > 0
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
    def halved(self) -> F32:
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

    def snapped(self, field: NDArray[np.int64]) -> tuple[NDArray[np.int64], F32]:
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

    def _exhaustive(self, target: F32) -> tuple[Places, F32]:
        """Return the best of all sources for each patch, and the costs."""
        n, total = len(self.at), self.mask.sum((1, 2))
        if self.every is None:
            places = thin_out(
                self.source_at, max(TUNING.max_first_pairs // max(n, 1), 64)
            )
            source_patches = self._patches(self.halved)[places[:, 0], places[:, 1]]
            square = (source_patches**2).sum(-1)
            down, right = (
                np.subtract.outer(
                    self.at[:, k].astype(np.float32), places[:, k].astype(np.float32)
                )
                for k in (0, 1)
            )
            flat_patches = np.concatenate(
                [
                    source_patches.reshape(len(source_patches), -1),
                    square.reshape(len(source_patches), -1),
                ],
                1,
            )
            self.every = (
                places,
                flat_patches,
                self.distance_cost * np.hypot(down, right, out=down),
            )
        places, flat_patches, distance_costs = self.every
        best, cost = np.zeros(n, np.int64), np.zeros(n, np.float32)
        step = max(TUNING.chunk // max(len(places), 1), 16)
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
            gap = query @ flat_patches.T
            gap /= total[part, None]
            gap += distance_costs[part]
            best[part] = gap.argmin(1)
            cost[part] = gap[np.arange(rows), best[part]] + own_squares
        return places[best], cost

    def _propagate_sources(
        self, target: F32, mask: F32, field: NDArray[np.int64]
    ) -> tuple[Places, F32]:
        """Return the best sources among those of the neighbours, and the costs."""
        total = mask.sum((1, 2))
        h, w = self.level.hole.shape
        rows, columns = self.at[:, 0], self.at[:, 1]
        best = self.at.copy()
        cost = np.full(len(self.at), np.inf, np.float32)
        row_length = w + 2 * self.radius
        window_steps = np.arange(0, 2 * self.radius + 1, 2)
        offsets = (window_steps[:, None] * row_length + window_steps).ravel()
        aim, part = target.reshape(len(target), -1, 3), mask.reshape(len(mask), -1)
        flat_picture = self.halved.reshape(-1, 3)

        def attempt(place: Places) -> None:
            place = np.stack(
                [np.clip(place[:, 0], 0, h - 1), np.clip(place[:, 1], 0, w - 1)], 1
            )
            place = self.nearest_source[place[:, 0], place[:, 1]]
            changed_indices = np.flatnonzero(
                (place != best).any(1) | ~np.isfinite(cost)
            )
            places = place[changed_indices]
            gap = flat_picture.take(
                (places[:, 0] * row_length + places[:, 1])[:, None] + offsets, axis=0
            )
            gap -= aim.take(changed_indices, axis=0)
            gap *= gap
            got = (
                np.einsum(
                    "nkc,nk->n", gap, part.take(changed_indices, axis=0), optimize=False
                )
                / total[changed_indices]
            )
            got += self.distance_cost * np.hypot(
                *(places - self.at[changed_indices]).astype(np.float32).T
            )
            better = got < cost[changed_indices]
            best[changed_indices[better]] = places[better]
            cost[changed_indices[better]] = got[better]

        attempt(field[rows, columns])
        steps = (3, 1) if self.radius > 2 else (1,)
        for step in steps:
            # The source of a neighbour, shifted back, is a good candidate (Barnes et
            # al. 2009).
            for down, right in ((0, step), (step, 0), (0, -step), (-step, 0)):
                y, x = (
                    np.clip(rows - down, 0, h - 1),
                    np.clip(columns - right, 0, w - 1),
                )
                current_field = field.copy()
                current_field[rows, columns] = best
                attempt(current_field[y, x] + self.at - np.stack([y, x], 1))
        # Finally try the four neighbours of each source.
        for down, right in ((0, 1), (1, 0), (0, -1), (-1, 0)):
            attempt(best + np.array([down, right]))
        return best, cost

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
        sources = field[self.at[:, 0], self.at[:, 1]]
        row_length = w + 2 * reach
        source_values, current_values = (
            np.concatenate([part, np.ones((h, w, 1), np.float32)], 2).reshape(-1, 4)
            for part in (values, now)
        )
        votes = np.zeros((h + 2 * reach, row_length, 4), np.float32)
        flat_votes, match_weights = votes.reshape(-1, 4), (weight * share)[:, None]
        doubtful_patches = np.flatnonzero(share < 1)
        own_index, own_weights = (
            self.at[doubtful_patches, 0] * w + self.at[doubtful_patches, 1],
            (weight * (1 - share))[doubtful_patches, None],
        )
        target_index, source = (
            self.at[:, 0] * row_length + self.at[:, 1],
            sources[:, 0] * w + sources[:, 1],
        )
        # With so many overlapping patches, one in four suffices.
        stride = 2 if reach > 2 else 1
        for down in range(-reach, reach + 1, stride):
            for right in range(-reach, reach + 1, stride):
                place = target_index + ((down + reach) * row_length + right + reach)
                flat_votes[place] += match_weights * source_values.take(
                    source + (down * w + right), axis=0
                )
                flat_votes[place[doubtful_patches]] += (
                    own_weights
                    * current_values.take(
                        own_index + (down * w + right), axis=0, mode="clip"
                    )
                )
        inside = (slice(reach, h + reach), slice(reach, w + reach))
        total, count = votes[inside][:, :, :3], votes[inside][:, :, 3:]
        mean = total / np.maximum(count, np.float32(1e-9))
        return np.where(self.level.hole[:, :, None] & (count > 0), mean, now)


def add_grain(guess: F32, picture: F32, hole: Mask, field: NDArray[np.int64]) -> F32:
    """Return `guess` (H, W, 3) with the grain of `picture` at the sources in `field`.

    A mean of votes is smooth, and smooth patches match smooth sources. Therefore the
    fine part of each block is copied from a single source, which keeps its spectrum,
    and scaled to the strength around the hole.
    """
    known_weights = np.where(hole, np.float32(0), np.float32(1))
    share = np.maximum(
        cv2.GaussianBlur(known_weights, (0, 0), TUNING.grain_blur), np.float32(1e-3)
    )
    smooth_picture = (
        cv2.GaussianBlur(picture * known_weights[:, :, None], (0, 0), TUNING.grain_blur)
        / share[:, :, None]
    )
    picture_grain = np.asarray(picture - smooth_picture, np.float32)
    ring = cv2.dilate(hole.astype(np.uint8), _square(TUNING.grain_margin)) > 0
    ring_strength = _grain_strength(picture_grain[ring & ~hole])
    y, x = np.nonzero(hole)
    fill_grain, block_grain = (
        picture_grain[rows, columns]
        for rows, columns in (field[y, x].T, _in_blocks(field, hole).T)
    )
    grain = (
        np.maximum(np.abs(fill_grain), np.abs(block_grain)).max(axis=1)
        < TUNING.grain_most * ring_strength
    )
    fill_grain = np.where(grain[:, None], block_grain, fill_grain)
    inside = _grain_strength(fill_grain)
    if ring_strength > 0 and inside > 0:
        fill_grain *= np.float32(np.clip(ring_strength / inside, *TUNING.grain_gain))
    has_grain = (grain | _coherent(field)[y, x])[:, None]
    result = guess.copy()
    result[y, x] = np.where(
        has_grain,
        cv2.GaussianBlur(guess, (0, 0), TUNING.grain_blur)[y, x] + fill_grain,
        guess[y, x],
    )
    return result


def _coherent(field: NDArray[np.int64]) -> Mask:
    """Return the pixels (H, W) whose neighbours have neighbouring sources.

    An edge copied from many sources is not a line.
    """
    shifts = field.astype(np.float32) - np.moveaxis(
        np.indices(field.shape[:2], np.float32), 0, -1
    )
    return np.asarray(
        (cv2.dilate(shifts, _square(2)) - cv2.erode(shifts, _square(2))).max(axis=2)
        <= 2
    )


def _in_blocks(field: NDArray[np.int64], hole: Mask) -> Places:
    """Return the sources of the hole's pixels, with one shift per block if it is known.

    A shift per pixel would show patterns.
    """
    hole_pixels, side, last = (
        np.argwhere(hole),
        TUNING.grain_block,
        np.array(hole.shape) - 1,
    )
    middle = np.minimum(hole_pixels // side * side + side // 2, last)
    block_sources = hole_pixels + field[middle[:, 0], middle[:, 1]] - middle
    clipped_sources = np.clip(block_sources, 0, last)
    valid = (clipped_sources == block_sources).all(axis=1) & ~hole[
        clipped_sources[:, 0], clipped_sources[:, 1]
    ]
    return np.where(
        valid[:, None], block_sources, field[hole_pixels[:, 0], hole_pixels[:, 1]]
    )


def _grain_strength(fine: F32) -> float:
    """Return the strength of grain (n, 3) in levels.

    It is the root of a median, so that an edge does not count as grain.
    """
    return float(np.median((fine**2).mean(axis=1)) ** 0.5) if len(fine) else 0.0
