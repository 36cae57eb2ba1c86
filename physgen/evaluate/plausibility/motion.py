"""Segments of constant acceleration in each track, the impacts between them, and distances between bodies."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache, cached_property
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from physgen.evaluate.plausibility.tracks import Array, Tracks
from physgen.scene.scene import View


@dataclass(frozen=True)
class Tuning:
    """Chosen on the calibration in benchmarks/plausibility."""

    price: float = 30.0
    """Of a segment, in squared noise: six numbers are fitted, and its border is chosen among many."""
    longest: int = 90
    """Frames of a segment."""
    fewest: int = 4
    """Frames that give a velocity: one more than an acceleration's three numbers."""
    sure: float = 4.0
    """Standard deviations of a change of velocity."""
    smooth: float = 3.0
    """Times what accelerations around it make in the same time: a change of velocity beyond it is sudden."""
    widest: int = 4
    """Frames between two segments, at most, that still are one impact."""
    parted: int = 12
    """Frames on each side of an impact that did not show, at most, that show how much it can have been."""
    same: float = 1.0
    """Frames within which turns of two bodies are one impact."""
    late: float = 2.5
    """Frames within which they may have been one, where they are not known well."""
    missed: float = 0.12
    """Of what the change of velocity makes in a frame: by so much paths may miss each other."""
    resting: float = 0.3
    """Of the speed after an impact: what came slower was probably hit by something."""
    flight: int = 6
    """Frames of a flight, at least."""
    shortest: float = 0.18
    """s of a flight."""
    plumb: float = 0.17
    """Sine of the angle to the vertical within which what falls straight may fly; else it may slide."""
    sides: int = 64
    """Of the polygon that stands for a disc beside other shapes."""


TUNING = Tuning()


def runs(seen: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """First and last + 1 of each run of frames without a gap.

    >>> runs(np.array([True, True, False, True]))
    [(0, 2), (3, 4)]
    """
    edges = np.flatnonzero(
        np.diff(np.concatenate([[False], seen, [False]]).astype(np.int8))
    )
    return [(int(a), int(b)) for a, b in zip(edges[::2], edges[1::2], strict=True)]


# ---- noise -------------------------------------------------------------------------------------------------------


def noise(tracks: Tracks) -> Array:
    """(N,) px, standard deviation along each axis, at least `tracks.floor`.

    The median takes no notice of impacts, as long as they are few. A body at rest gives nothing: centroids of pixels
    shake only as they move. Where nothing is known, the median of the others is taken.
    """
    own = np.array([_noise(tracks, k) for k in range(len(tracks.names))])
    typical = (
        float(np.median(own[np.isfinite(own)]))
        if np.isfinite(own).any()
        else tracks.floor
    )
    own = np.where(np.isfinite(own), own, typical)
    return np.asarray(np.maximum(np.clip(own, typical / 2, None), tracks.floor))


def _noise(tracks: Tracks, body: int) -> float:
    """px, from third differences; NaN where nothing is known."""
    parts = [np.empty((0, 2))]
    for first, last in runs(tracks.seen[:, body]):
        path = tracks.places[first:last, body]
        moved = np.hypot(*(path[3:] - path[:-3]).T) > 2 * tracks.floor
        parts.append(np.abs(np.diff(path, 3, axis=0))[moved])
    values = np.concatenate(parts)
    to_sigma = 1.4826 / np.sqrt(
        20
    )  # median -> standard deviation, of a normal distribution; 1 + 9 + 9 + 1
    return (
        to_sigma * float(np.median(values)) if len(values) > TUNING.fewest else np.nan
    )


# ---- segments ----------------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Segment:
    """Frames in which a body moved with one acceleration."""

    first: int
    last: int
    """Frames, both in it."""
    middle: float
    """s."""
    terms: Array
    """(3, 2): place px, velocity px/s, acceleration px/s², at the middle."""
    spread: Array
    """(3, 3): covariance of the terms, along each axis; infinite where frames are too few."""
    residual: float = 0.0
    """Root mean square of what is left, over the noise; 0 where nothing can be."""

    @property
    def count(self) -> int:
        """Of its frames."""
        return self.last - self.first + 1

    @property
    def good(self) -> bool:
        """Whether it has a velocity."""
        return self.count >= TUNING.fewest

    def at(self, time: float, order: int = 0) -> Array:
        """(2,): place px, velocity px/s or acceleration px/s² (`order` 0, 1, 2)."""
        return np.asarray(_row(time - self.middle, order) @ self.terms)

    def error(self, time: float, order: int = 0) -> float:
        """Standard deviation of `at` along each axis."""
        if not np.isfinite(self.spread).all():
            return np.inf
        row = _row(time - self.middle, order)
        return float(np.sqrt(max(float(row @ self.spread @ row), 0.0)))


def _row(s: float, order: int) -> Array:
    return np.array(([1.0, s, s * s / 2], [0.0, 1.0, s], [0.0, 0.0, 1.0])[order])


def segments(path: Array, times: Array, first: int, sigma: float) -> list[Segment]:
    """Of frames without a gap, `path` (n, 2) px at `times` (n,) s; `first` is the number of their first frame.

    The borders with the least sum of squared errors and prices, by dynamic programming.
    """
    n, costs = len(path), _costs((path - path.mean(0)) / sigma)
    best, back = np.full(n + 1, np.inf), np.zeros(n + 1, np.int64)
    best[0] = 0.0
    for end in range(1, n + 1):
        begins = np.arange(max(0, end - TUNING.longest), end)
        total = best[begins] + costs[end - begins, begins] + TUNING.price
        k = int(np.argmin(total))
        best[end], back[end] = total[k], begins[k]
    found = []
    end = n
    while end > 0:
        begin = int(back[end])
        found.append(_fitted(path[begin:end], times[begin:end], first + begin, sigma))
        end = begin
    return found[::-1]


def _costs(path: Array) -> Array:
    """[length, first]: squared errors of the best parabola through `length` frames from `first` on."""
    n = len(path)
    costs = np.zeros((min(n, TUNING.longest) + 1, n))
    for length in range(TUNING.fewest, min(n, TUNING.longest) + 1):
        windows = np.lib.stride_tricks.sliding_window_view(
            path, length, axis=0
        )  # (m, 2, length)
        off = windows - windows[..., :1]
        left = (off**2).sum(axis=2) - ((off @ _basis(length)) ** 2).sum(axis=2)
        costs[length, : n - length + 1] = np.maximum(left, 0.0).sum(axis=1)
    return costs


@cache
def _basis(length: int) -> Array:
    """(length, 3): orthonormal, spans parabolas."""
    grid = np.linspace(-1.0, 1.0, length)
    return np.asarray(
        np.linalg.qr(np.stack([np.ones(length), grid, grid**2], axis=1))[0]
    )


def _fitted(path: Array, times: Array, first: int, sigma: float) -> Segment:
    n, middle = len(path), float(times.mean())
    s, order = times - middle, min(n, 3)
    columns = np.stack([np.ones(n), s, s * s / 2], axis=1)[:, :order]
    inverse = np.linalg.pinv(columns)
    terms, spread, residual = np.zeros((3, 2)), np.full((3, 3), np.inf), 0.0
    terms[:order] = inverse @ path
    if n >= TUNING.fewest:
        residual = (
            float(np.sqrt(((path - columns @ terms) ** 2).sum() / (2 * (n - 3))))
            / sigma
        )
        spread = inverse @ inverse.T * (sigma * max(1.0, residual)) ** 2
    return Segment(first, first + n - 1, middle, terms, spread, residual)


@dataclass(frozen=True, eq=False)
class Turn:
    """A body between two segments: its velocity changes, suddenly or not."""

    body: int
    before: Segment
    after: Segment
    time: float
    """s: when both are nearest to each other."""
    sudden: bool = False
    """Far faster than any acceleration before or after, and surely."""
    shown: bool = True
    """Whether it turned at all, as far as the tracks show."""

    @property
    def arrives(self) -> Array:
        """(2,) px/s: just before."""
        return self.before.at(self.time, 1)

    @property
    def leaves(self) -> Array:
        """(2,) px/s: just after."""
        return self.after.at(self.time, 1)

    @property
    def change(self) -> Array:
        """(2,) px/s; exactly nothing where one segment goes on."""
        return self.leaves - self.arrives

    @property
    def place(self) -> Array:
        """(2,) px."""
        return (self.before.at(self.time) + self.after.at(self.time)) / 2

    def error(self, order: int = 1) -> float:
        """Of the change, px/s, or of the place by which both miss each other (`order` 0), px."""
        if self.before is self.after:
            return self.before.error(self.time, order)
        return float(
            np.hypot(
                self.before.error(self.time, order), self.after.error(self.time, order)
            )
        )


# ---- motion ------------------------------------------------------------------------------------------------------


class Motion:
    """All that is found in tracks before anything is asked."""

    def __init__(self, tracks: Tracks) -> None:
        self.tracks = tracks
        self.sigma = noise(tracks)
        self.steps = np.asarray(np.diff(tracks.places, axis=0))
        """(T - 1, N, 2) px from frame to frame."""
        self._gaps: dict[tuple[int, int], Array] = {}

    @cached_property
    def segments(self) -> list[list[Segment]]:
        """Of each body, by time; a gap in its track ends one."""
        tracks = self.tracks
        return [
            [
                segment
                for first, last in runs(tracks.seen[:, k])
                for segment in segments(
                    tracks.places[first:last, k],
                    tracks.times[first:last],
                    first,
                    float(self.sigma[k]),
                )
            ]
            for k in range(len(tracks.names))
        ]

    @cached_property
    def turns(self) -> list[list[Turn]]:
        """Of each body, between segments that have velocities."""
        found: list[list[Turn]] = []
        for body, all_of in enumerate(self.segments):
            good = [segment for segment in all_of if segment.good]
            seen = self.tracks.seen[:, body]
            found.append(
                [
                    self._turn(body, before, after)
                    for before, after in pairwise(good)
                    if after.first - before.last <= TUNING.widest
                    and seen[before.last : after.first].all()
                ]
            )
        return found

    def _turn(self, body: int, before: Segment, after: Segment) -> Turn:
        times, step = self.tracks.times, self.tracks.step
        ticks = np.linspace(
            times[before.last] - step / 2, times[after.first] + step / 2, 41
        )
        turn = Turn(body, before, after, _nearest(ticks, [(before, after)]))
        a, b = before.terms[2], after.terms[2]
        smooth = max(np.hypot(*(b - a)), np.hypot(*a) / 2, np.hypot(*b) / 2) * step
        least = max(6 * self.sigma[body], 0.4) / step  # px/s: changes below it are none
        enough = max(
            TUNING.sure * turn.error(),
            TUNING.smooth * smooth * (after.first - before.last),
            least,
        )
        return replace(turn, sudden=bool(np.hypot(*turn.change) > enough))

    def parted(
        self, body: int, segment: Segment, time: float
    ) -> tuple[Segment, Segment] | None:
        """One segment as two that meet at a moment: how much of an impact may not have shown; None for few frames."""
        tracks = self.tracks
        frames = np.arange(segment.first, segment.last + 1)
        frames = frames[
            np.abs(tracks.times[frames] - time) <= TUNING.parted * tracks.step
        ]
        sides = [
            frames[tracks.times[frames] < time],
            frames[tracks.times[frames] > time],
        ]
        if min(map(len, sides)) < TUNING.fewest:
            return None
        before, after = (
            _fitted(
                tracks.places[side, body],
                tracks.times[side],
                int(side[0]),
                float(self.sigma[body]),
            )
            for side in sides
        )
        return before, after

    def turns_near(self, body: int, time: float, frames: float) -> bool:
        """Whether it turns suddenly within some frames of a moment."""
        return any(
            t.sudden and abs(t.time - time) <= frames * self.tracks.step
            for t in self.turns[body]
        )

    @cached_property
    def flights(self) -> list[tuple[int, Segment]]:
        """Bodies and their segments that are surely flights, seen from the side."""
        if self.tracks.view is View.TOP or self.tracks.flat:
            return []
        return [
            (k, segment)
            for k, all_of in enumerate(self.segments)
            if self.free(k) and not self._guided(k)
            for segment in all_of
            if self._flies(k, segment)
        ]

    @cached_property
    def gravity(self) -> Array | None:
        """(2,) px/s²: the median of falls' accelerations, each as heavy as it is long; None where nothing falls."""
        falls = [segment for _, segment in self.flights if segment.terms[2, 1] > 0]
        if not falls:
            return None
        weighed = np.repeat(
            [s.terms[2] for s in falls], [s.count for s in falls], axis=0
        )
        return np.asarray(np.sort(weighed, axis=0)[(len(weighed) - 1) // 2])

    def _guided(self, body: int) -> bool:
        """Whether its acceleration changes again and again without an impact, as on a rope: gravity may change once."""
        smooth = 0
        for turn in self.turns[body]:
            a, b = turn.before, turn.after
            off = float(np.hypot(*(a.terms[2] - b.terms[2])))
            error = float(np.hypot(a.error(turn.time, 2), b.error(turn.time, 2)))
            size = max(float(np.hypot(*a.terms[2])), float(np.hypot(*b.terms[2])))
            fast = (
                max(np.hypot(*turn.arrives), np.hypot(*turn.leaves)) * self.tracks.step
                > 0.5
            )
            smooth += not turn.sudden and fast and off > max(3 * error, 0.15 * size)
        return smooth >= 2

    def _flies(self, body: int, segment: Segment) -> bool:
        """Whether it is curved or plumb, touched by nothing that is known, smooth all along."""
        tracks = self.tracks
        first, last = tracks.times[segment.first], tracks.times[segment.last]
        if segment.count < TUNING.flight or last - first < TUNING.shortest:
            return False
        a, error = segment.terms[2], segment.error(first, 2)
        size = float(np.hypot(*a))
        enough = size >= 5 * error and size * (last - first) ** 2 / 8 >= max(
            5 * self.sigma[body], 1.5
        )
        if not enough or segment.residual > 2.5:
            return False
        vx, vy = segment.at(segment.middle, 1)
        speed = float(np.hypot(vx, vy))
        plumb = abs(a[0]) < TUNING.plumb * size + 2 * error
        curved = speed > 0 and abs(a[0] * vy - a[1] * vx) / speed > max(
            4 * error, 0.25 * size
        )
        return (plumb or curved) and self.alone(body, segment, 1.0)

    def alone(self, body: int, segment: Segment, margin: float) -> bool:
        """Whether other bodies are farther away, px, in all but its first and last frame."""
        inner, forms = slice(segment.first + 1, segment.last), self.tracks.forms
        gaps = [
            self.gap(body, k)[inner]
            for k in range(len(forms))
            if k != body and forms[k].reach > 0
        ]
        return all(np.nanmin(gap, initial=np.inf) > margin for gap in gaps)

    @cached_property
    def impacts(self) -> list[Impact]:
        """All that concern one or two bodies that are free, measured and not in a crowd; each once."""
        return _impacts(self)

    def moves(self, body: int) -> bool:
        """Whether it ever moves: what never does may be nailed down."""
        path = self.tracks.places[self.tracks.seen[:, body], body]
        away = (
            np.hypot(*(path - np.median(path, axis=0)).T) if len(path) else np.zeros(1)
        )
        return bool(np.quantile(away, 0.95) > max(2.0, 6 * self.sigma[body]))

    def free(self, body: int) -> bool:
        """Whether nothing but gravity and contacts acts on it."""
        return body not in self.tracks.held

    def shake(self, one: int, other: int) -> float:
        """px of noise of the distance of two bodies."""
        return float(np.hypot(self.sigma[one], self.sigma[other]))

    # distances

    def gap(self, one: int, other: int) -> Array:
        """(T,) px between two bodies: negative where they overlap, NaN where one is not seen."""
        key = (min(one, other), max(one, other))
        if key not in self._gaps:
            self._gaps[key] = self._gap(*key)
        return self._gaps[key]

    def _gap(self, one: int, other: int) -> Array:
        a, b = self.tracks.forms[one], self.tracks.forms[other]
        gap = (
            np.hypot(*(self.tracks.places[:, one] - self.tracks.places[:, other]).T)
            - a.reach
            - b.reach
        )
        if not (a.round and b.round):
            close = np.flatnonzero(gap < 0.5 * (a.reach + b.reach))
            shapes = [[piece[close] for piece in self._shapes[k]] for k in (one, other)]
            parted = [
                _separation(mine, others) for mine in shapes[0] for others in shapes[1]
            ]
            gap[close] = np.min(parted, axis=0)
        return np.asarray(gap)

    @cached_property
    def _shapes(self) -> list[list[Array]]:
        """Convex pieces (T, K, 2) of each body in the picture; of discs a polygon."""
        found = []
        turn = np.linspace(0, 2 * np.pi, TUNING.sides, endpoint=False)
        circle = np.stack([np.cos(turn), np.sin(turn)], axis=1)
        for k, form in enumerate(self.tracks.forms):
            angle = (
                np.zeros(len(self.tracks.times))
                if self.tracks.angles is None
                else self.tracks.angles[:, k]
            )
            c, s = np.cos(angle), np.sin(angle)
            turns = np.stack([np.stack([c, -s], -1), np.stack([s, c], -1)], axis=1)
            pieces = form.pieces or (form.reach * circle,)
            place = self.tracks.places[:, k, None]
            found.append(
                [np.einsum("tij,kj->tki", turns, piece) + place for piece in pieces]
            )
        return found

    def near(self, body: int, first: int, last: int) -> list[int]:
        """Bodies that may have touched it between two frames, however fast they were."""
        lo, hi = max(first, 0), min(last, len(self.tracks.times) - 1)
        return [
            other
            for other in range(len(self.tracks.names))
            if other != body
            and np.nanmin(self.gap(body, other)[lo : hi + 1], initial=np.inf)
            <= self.margin(body, other, lo, hi)
        ]

    def margin(self, one: int, other: int, first: int, last: int) -> float:
        """px that two bodies may still be apart in every frame and yet touch in between."""
        rate = np.abs(np.diff(self.gap(one, other)[max(first - 1, 0) : last + 2]))
        # what hits half-way between two frames is half a step away in both
        return (
            1.5
            + 0.65 * float(np.nanmax(rate, initial=0.0))
            + 3 * self.shake(one, other)
        )


def _separation(a: Array, b: Array) -> Array:
    """(T,): of convex pieces (T, K, 2), the widest gap along any side's normal; minus the depth where they overlap."""
    widest = np.full(len(a), -np.inf)
    for mine in (a, b):
        along = np.roll(mine, -1, axis=1) - mine
        size = np.hypot(along[..., 0], along[..., 1])
        normal = (
            np.stack([along[..., 1], -along[..., 0]], axis=1)
            / np.maximum(size, 1e-12)[:, None]
        )
        on_a, on_b = a @ normal, b @ normal  # (T, K, sides)
        gap = np.maximum(on_b.min(1) - on_a.max(1), on_a.min(1) - on_b.max(1))
        widest = np.maximum(widest, np.where(size > 1e-9, gap, -np.inf).max(axis=1))
    return widest


def _nearest(ticks: Array, parts: list[tuple[Segment, Segment]]) -> float:
    """s: the tick at which the segments before and after are nearest to each other."""
    missed = [
        sum(float(np.sum((b.at(t) - a.at(t)) ** 2)) for a, b in parts) for t in ticks
    ]
    return float(ticks[int(np.argmin(missed))])


# ---- impacts -----------------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Impact:
    """Of one body alone, or of two and no other."""

    frame: int
    parts: tuple[Turn, ...]

    @property
    def bodies(self) -> tuple[int, ...]:
        """Indices."""
        return tuple(part.body for part in self.parts)


def _impacts(motion: Motion) -> list[Impact]:
    found: list[Impact] = []
    step = motion.tracks.step
    for turn in (
        turn
        for turns in motion.turns
        for turn in turns
        if turn.sudden and motion.free(turn.body)
    ):
        impact = _impact(motion, turn)
        if impact is None or not _single(impact, step):
            continue
        if not any(
            len(one.parts) == 2
            and set(one.bodies) == set(impact.bodies)
            and abs(one.parts[0].time - impact.parts[0].time) <= TUNING.same * step
            for one in found
        ):
            found.append(impact)
    return found


def _single(impact: Impact, step: float) -> bool:
    """Whether one impact explains it: paths meet at its time; where two come in one frame, they do not."""
    change = max(float(np.hypot(*part.change)) for part in impact.parts)
    return all(
        np.hypot(*(part.after.at(part.time) - part.before.at(part.time)))
        <= TUNING.missed * change * step + 3 * part.error(0)
        for part in impact.parts
    )


def _impact(motion: Motion, turn: Turn) -> Impact | None:
    """None where it is not known which bodies have a part in it, or more than two have."""
    first, last = turn.before.last, turn.after.first
    others = []
    for body in motion.near(turn.body, first, last):
        other = _partner(motion, body, turn)
        met = None if other is None else _met(motion, turn, other)
        if met is None or (not met and motion.turns_near(body, turn.time, TUNING.late)):
            return None
        if met and other is not None:
            others.append(other)
    if not others:
        return Impact(first, (turn,))
    if len(others) > 1 or not motion.free(others[0].body):
        return None
    other = others[0]
    for body in set(motion.near(other.body, first, last)) - {turn.body}:
        gap = motion.gap(other.body, body)[first : last + 1]
        if (
            motion.turns_near(body, turn.time, TUNING.late)
            or np.nanmin(gap, initial=np.inf) < 2.0
        ):
            return None  # a third has a part in it
    ticks = turn.time + np.linspace(-motion.tracks.step / 2, motion.tracks.step / 2, 41)
    time = _nearest(ticks, [(turn.before, turn.after), (other.before, other.after)])
    return Impact(first, (replace(turn, time=time), replace(other, time=time)))


def _partner(motion: Motion, body: int, turn: Turn) -> Turn | None:
    """What it did then; None where that is not known."""
    for other in motion.turns[body]:
        if abs(other.time - turn.time) <= TUNING.same * motion.tracks.step:
            return replace(other, time=turn.time)
    for segment in motion.segments[body]:
        if (
            segment.good
            and segment.first <= turn.before.last
            and turn.after.first <= segment.last
        ):
            before, after = motion.parted(body, segment, turn.time) or (
                segment,
                segment,
            )
            return Turn(body, before, after, turn.time, shown=False)
    return None


def _met(motion: Motion, one: Turn, other: Turn) -> bool | None:
    """Whether they were near enough at the impact to touch; None where that is not known."""
    reach = motion.tracks.forms[one.body].reach + motion.tracks.forms[other.body].reach
    close = 1.0 + 3 * motion.shake(one.body, other.body) + 0.05 * reach
    gap = float(np.hypot(*(one.place - other.place))) - reach
    if gap <= close:
        return True
    changes = float(np.hypot(*one.change) + np.hypot(*other.change))
    slack = TUNING.missed / 2 * changes * motion.tracks.step
    slack += 3 * max(part.before.error(part.time) for part in (one, other))
    hit = np.hypot(*one.arrives) <= TUNING.resting * np.hypot(*one.leaves)
    sure = other.after.first - other.before.last <= 1 and not hit
    return False if sure and gap > close + slack else None
