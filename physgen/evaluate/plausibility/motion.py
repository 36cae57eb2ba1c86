"""Segments of constant acceleration in each track, and the changes of velocity between them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache, cached_property
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from physgen.evaluate.plausibility.clearance import Clearance
from physgen.evaluate.plausibility.tracks import Array, Tracks, noise, runs

PRICE = 30.0
"""Of a piece, in squared noise: six numbers are fitted, and its border is chosen among many."""
LONGEST = 90
"""Frames: what is longer is cut, which harms no one."""
FEWEST = 4
"""Frames that tell a velocity: one more than an acceleration's three numbers."""


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
    jerk: Array
    """(2,) px/s³ of a cubic in its place."""
    jerk_error: float
    residual: float
    """Root mean square of what is left, over the noise; 0 where nothing can be."""

    @property
    def count(self) -> int:
        """Of its frames."""
        return self.last - self.first + 1

    @property
    def good(self) -> bool:
        """Whether it has a velocity."""
        return self.count >= FEWEST

    @property
    def acceleration(self) -> Array:
        """(2,) px/s²."""
        return np.asarray(self.terms[2])

    @property
    def acceleration_error(self) -> float:
        """px/s², standard deviation along each axis."""
        return float(np.sqrt(self.spread[2, 2]))

    def place(self, time: float) -> Array:
        """(2,) px."""
        s = time - self.middle
        return np.asarray(self.terms[0] + s * self.terms[1] + s * s / 2 * self.terms[2])

    def place_error(self, time: float) -> float:
        """px."""
        s = time - self.middle
        return _error(np.array([1.0, s, s * s / 2]), self.spread)

    def velocity(self, time: float) -> Array:
        """(2,) px/s."""
        return np.asarray(self.terms[1] + (time - self.middle) * self.terms[2])

    def velocity_error(self, time: float) -> float:
        """px/s, standard deviation along each axis."""
        return _error(np.array([0.0, 1.0, time - self.middle]), self.spread)


def segments(path: Array, times: Array, first: int, sigma: float) -> list[Segment]:
    """Of frames without a gap, `path` (n, 2) px at `times` (n,) s; `first` is the number of their first frame."""
    return [
        fitted(path[a:b], times[a:b], first + a, sigma) for a, b in _borders((path - path.mean(0)) / sigma)
    ]


def _borders(path: Array) -> list[tuple[int, int]]:
    """`path` in units of its noise."""
    n = len(path)
    costs = _costs(path)
    best = np.full(n + 1, np.inf)
    best[0] = 0.0
    back = np.zeros(n + 1, np.int64)
    for end in range(1, n + 1):
        begin = max(0, end - LONGEST)
        lengths = end - np.arange(begin, end)
        total = best[begin:end] + costs[lengths, np.arange(begin, end)] + PRICE
        k = int(np.argmin(total))
        best[end], back[end] = total[k], begin + k
    found = []
    end = n
    while end > 0:
        found.append((int(back[end]), end))
        end = int(back[end])
    return found[::-1]


def _costs(path: Array) -> Array:
    """[length, first]: squared errors of the best parabola through `length` frames from `first` on."""
    n = len(path)
    costs = np.zeros((min(n, LONGEST) + 1, n))
    for length in range(4, min(n, LONGEST) + 1):
        windows = np.lib.stride_tricks.sliding_window_view(path, length, axis=0)  # (m, 2, length)
        off = windows - windows[..., :1]
        left = (off**2).sum(axis=2) - ((off @ _basis(length)) ** 2).sum(axis=2)
        costs[length, : n - length + 1] = np.maximum(left, 0.0).sum(axis=1)
    return costs


@cache
def _basis(length: int) -> Array:
    """(length, 3): orthonormal, spans parabolas."""
    grid = np.linspace(-1.0, 1.0, length)
    return np.asarray(np.linalg.qr(np.stack([np.ones(length), grid, grid**2], axis=1))[0])


def fitted(path: Array, times: Array, first: int, sigma: float) -> Segment:
    """All frames as one stretch."""
    n = len(path)
    middle = float(times.mean())
    s = times - middle
    order = min(n, 3)
    columns = np.stack([np.ones(n), s, s * s / 2], axis=1)[:, :order]
    inverse = np.linalg.pinv(columns)
    terms, spread = np.zeros((3, 2)), np.full((3, 3), np.inf)
    terms[:order] = inverse @ path
    left = path - columns @ terms[:order]
    residual = 0.0
    if n >= FEWEST:
        residual = float(np.sqrt((left**2).sum() / (2 * (n - 3)))) / sigma
        spread = inverse @ inverse.T * (sigma * max(1.0, residual)) ** 2
    jerk, error = np.zeros(2), np.inf
    if n > FEWEST:
        cubic = np.linalg.pinv(np.concatenate([columns, (s**3 / 6)[:, None]], axis=1))
        jerk = cubic[3] @ path
        error = float(np.sqrt(cubic[3] @ cubic[3])) * sigma
    return Segment(first, first + n - 1, middle, terms, spread, jerk, error, residual)


def _error(row: Array, spread: Array) -> float:
    if not np.isfinite(spread).all():
        return np.inf
    return float(np.sqrt(max(float(row @ spread @ row), 0.0)))


PARTED = 12
"""Frames on each side of a blow that did not show, at most, that tell how much it can have been."""
WIDEST = 4
"""Frames between two stretches, at most, that still are one blow."""
SURE = 4.0
"""Standard deviations."""
SMOOTH = 3.0
"""Times what accelerations around it make in the same time: a change of velocity beyond it is sudden."""


@dataclass(frozen=True, eq=False)
class VelocityChange:
    """Between two stretches of one body: its velocity changes, suddenly or not."""

    body: int
    before: Segment
    after: Segment
    time: float
    """s: when both are nearest to each other."""
    offset: float
    """px by which they miss each other then."""
    sudden: bool
    """Far faster than any acceleration before or after, and surely."""

    @property
    def frame(self) -> int:
        """The last before it."""
        return self.before.last

    @property
    def arrives(self) -> Array:
        """(2,) px/s: just before."""
        return self.before.velocity(self.time)

    @property
    def leaves(self) -> Array:
        """(2,) px/s: just after."""
        return self.after.velocity(self.time)

    @property
    def change(self) -> Array:
        """(2,) px/s."""
        return self.leaves - self.arrives

    @property
    def error(self) -> float:
        """px/s, of the change along any direction."""
        return float(np.hypot(self.before.velocity_error(self.time), self.after.velocity_error(self.time)))


class Spin(NamedTuple):
    """How fast a body turns."""

    rate: float
    """rad/s."""
    steady: bool
    """Whether it does in all frames."""


class Motion:
    """All that is found in tracks before anything is asked."""

    def __init__(self, tracks: Tracks, sigma: float | None = None) -> None:
        self.tracks = tracks
        self.sigma = noise(tracks) if sigma is None else np.full(len(tracks.names), max(sigma, 1e-3))
        self.clearance = Clearance(tracks)

    @cached_property
    def stretches(self) -> list[list[Segment]]:
        """Of each body, by time; a gap in its track ends one."""
        tracks = self.tracks
        return [
            [
                stretch
                for first, last in runs(tracks.seen[:, k])
                for stretch in segments(
                    tracks.places[first:last, k], tracks.times[first:last], first, float(self.sigma[k])
                )
            ]
            for k in range(len(tracks.names))
        ]

    @cached_property
    def turns(self) -> list[list[VelocityChange]]:
        """Of each body, between segments that have velocities."""
        return [self._turns(k) for k in range(len(self.tracks.names))]

    @cached_property
    def steps(self) -> Array:
        """(T - 1, N, 2) px from frame to frame."""
        return np.asarray(np.diff(self.tracks.places, axis=0))

    @cached_property
    def moves(self) -> list[bool]:
        """Whether a body ever moves, N of them: one that never does may be nailed down."""
        tracks = self.tracks
        found = []
        for k in range(len(tracks.names)):
            path = tracks.places[tracks.seen[:, k], k]
            away = np.hypot(*(path - np.median(path, axis=0)).T) if len(path) else np.zeros(1)
            found.append(bool(np.quantile(away, 0.95) > max(2.0, 6 * self.sigma[k])))
        return found

    def stretch_at(self, body: int, frame: int) -> Segment | None:
        """The one that holds a frame, if it has a velocity."""
        for stretch in self.stretches[body]:
            if stretch.first <= frame <= stretch.last:
                return stretch if stretch.good else None
        return None

    def parted(self, body: int, stretch: Segment, time: float) -> tuple[Segment, Segment] | None:
        """One stretch as two that meet at a moment, with one acceleration: how much of a blow may have been overlooked.

        None where frames on either side are too few.
        """
        frames = np.arange(stretch.first, stretch.last + 1)
        s = self.tracks.times[frames] - time
        near = np.abs(s) <= PARTED * self.tracks.step
        frames, s = frames[near], s[near]
        if (s < 0).sum() < FEWEST or (s > 0).sum() < FEWEST:
            return None
        columns = np.stack([np.ones(len(s)), s, s * s / 2, np.maximum(s, 0.0)], axis=1)
        inverse = np.linalg.pinv(columns)
        place, velocity, pull, kick = inverse @ self.tracks.places[frames, body]
        errors = (inverse @ inverse.T).diagonal() * (self.sigma[body] * max(1.0, stretch.residual)) ** 2
        spread = np.diag([errors[0], errors[3] / 2, errors[2]])
        parts = (
            (stretch.first, int(frames[s < 0][-1]), velocity),
            (int(frames[s > 0][0]), stretch.last, velocity + kick),
        )
        before, after = (
            replace(
                stretch,
                first=first,
                last=last,
                middle=time,
                terms=np.stack([place, speed, pull]),
                spread=spread,
            )
            for first, last, speed in parts
        )
        return before, after

    def near(self, body: int, first: int, last: int) -> list[int]:
        """Bodies that may have touched it between two frames, however fast they were."""
        tracks = self.tracks
        lo, hi = max(first, 0), min(last, len(tracks.times) - 1)
        found = []
        for other in range(len(tracks.names)):
            if other != body:
                gap = self.clearance.least(body, other)[lo : hi + 1]
                gap = gap[np.isfinite(gap)]
                if len(gap) and gap.min() <= self.margin(body, other, lo, hi):
                    found.append(other)
        return found

    def margin(self, one: int, other: int, first: int, last: int) -> float:
        """px that two bodies may still be apart in every frame and yet touch in between."""
        gap = self.clearance.least(one, other)[max(first - 1, 0) : last + 2]
        rate = np.abs(np.diff(gap))
        rate = rate[np.isfinite(rate)]
        way = (self.steps[:, one] - self.steps[:, other])[max(first - 1, 0) : last + 1]
        speed = np.hypot(way[:, 0], way[:, 1])
        # who hits half-way between two frames is half a step away in both; after another blow, by a step unseen
        fastest = max(0.65 * rate.max(initial=0.0), 0.3 * np.nanmax(speed, initial=0.0))
        return 1.5 + float(fastest) + 3 * float(np.hypot(self.sigma[one], self.sigma[other]))

    def near_wall(self, body: int, first: int, last: int) -> bool:
        """Whether a known wall is within its reach."""
        gap = self.clearance.to_walls(body)[max(first, 0) : last + 1]
        step = np.hypot(*self.steps[max(first - 1, 0) : last + 1, body].T)
        step = step[np.isfinite(step)]
        fastest = float(step.max()) if len(step) else 0.0
        return bool(np.nanmin(gap, initial=np.inf) <= 1.5 + 0.6 * fastest + 3 * self.sigma[body])

    def was_pushed(self, body: int, start: float, end: float) -> bool:
        """Whether the caller says that it was, between two moments."""
        return any(
            who == body and start <= last + self.tracks.step and first - self.tracks.step <= end
            for who, first, last in self.tracks.given.pushed
        )

    def free(self, body: int) -> bool:
        """Whether nothing but gravity, contacts and known pushes acts on it."""
        given = self.tracks.given
        return body not in given.held and body not in given.blown

    def spin(self, body: int, first: int, last: int) -> Spin | None:
        """Over some frames, the slower of what it may be; None where its angle is not known."""
        angle = self.tracks.angles[max(first, 0) : last + 1, body]
        if len(angle) < 3 or not np.isfinite(angle).all():
            return None
        angle = np.unwrap(angle)
        ticks = np.arange(len(angle)) * self.tracks.step
        line = np.polyfit(ticks, angle, 1)
        off = float(np.abs(angle - np.polyval(line, ticks)).max())
        shake = 4 * float(self.sigma[body]) / max(self.tracks.forms[body].reach, 4.0)
        return Spin(float(line[0]), off < 0.02 + shake)

    def _turns(self, body: int) -> list[VelocityChange]:
        known = [s for s in self.stretches[body] if s.good]
        found = []
        for before, after in pairwise(known):
            gap = after.first - before.last
            if gap > WIDEST or not self.tracks.seen[before.last : after.first, body].all():
                continue
            found.append(self._turn(body, before, after))
        return found

    def _turn(self, body: int, before: Segment, after: Segment) -> VelocityChange:
        times, step = self.tracks.times, self.tracks.step
        ticks = np.linspace(times[before.last] - step / 2, times[after.first] + step / 2, 41)
        missed = [float(np.hypot(*(after.place(t) - before.place(t)))) for t in ticks]
        least = int(np.argmin(missed))
        turn = VelocityChange(body, before, after, float(ticks[least]), missed[least], False)
        change = float(np.hypot(*turn.change))
        a, b = before.acceleration, after.acceleration
        smooth = max(np.hypot(*(b - a)), np.hypot(*a) / 2, np.hypot(*b) / 2) * step
        sudden = change > max(
            SURE * turn.error, SMOOTH * smooth * (after.first - before.last), self._slow(body)
        )
        return VelocityChange(body, before, after, turn.time, turn.offset, sudden)

    def _slow(self, body: int) -> float:
        """px/s: changes below it are none."""
        return float(max(6 * self.sigma[body], 0.4) / self.tracks.step)
