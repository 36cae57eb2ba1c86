"""Flights and impacts in tracks: turns between segments of constant acceleration."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise

import numpy as np

from physgen.evaluate.plausibility.distances import Distances
from physgen.evaluate.plausibility.segments import TUNING as SEGMENT_TUNING
from physgen.evaluate.plausibility.segments import (
    Segment,
    find_runs,
    fit_segment,
    measure_noise,
    split_segments,
)
from physgen.evaluate.plausibility.tracks import Array, Tracks
from physgen.scene.scene import View


@dataclass(frozen=True)
class Tuning:
    """Constants from the calibration in benchmarks/plausibility."""

    certainty: float = 4.0
    """Standard deviations of a change of velocity."""
    smoothness: float = 3.0
    """Minimum sudden change of velocity, in changes by the accelerations around it in
    the same time.
    """
    max_gap: int = 4
    """Maximum number of frames between two segments of one impact."""
    split_frames: int = 12
    """Maximum number of frames on each side of an invisible impact for its
    upper bound.
    """
    same_time: float = 1.0
    """Maximum time between turns of two bodies in one impact, frames."""
    late_time: float = 2.5
    """Maximum time between uncertain turns of two bodies in one possible impact,
    frames.
    """
    path_gap: float = 0.12
    """Maximum distance of the paths, over the effect of the change of velocity in a
    frame.
    """
    rest_part: float = 0.3
    """Minimum speed before an impact over the speed after. A slower body was probably
    hit.
    """
    flight_frames: int = 6
    """Minimum number of frames in a flight."""
    flight_time: float = 0.18
    """Minimum duration of a flight, s."""
    vertical_sine: float = 0.17
    """Maximum sine of the angle to the vertical for a straight flight. Other straight
    motion may be sliding.
    """


TUNING = Tuning()
TICKS = 41
"""Number of compared moments of the paths before and after an impact."""


@dataclass(frozen=True, eq=False)
class Turn:
    """A body between two segments, with a sudden or smooth change of velocity."""

    body: int
    before: Segment
    after: Segment
    time: float
    """Time of the segments' smallest distance, s."""
    is_sudden: bool = False
    """True for a certain change, far faster than any acceleration before or after."""
    is_visible: bool = True
    """True if the tracks show a turn of the body."""

    @property
    def velocity_before(self) -> Array:
        """Return the velocity just before, (2,) px/s."""
        return self.before.value(self.time, 1)

    @property
    def velocity_after(self) -> Array:
        """Return the velocity just after, (2,) px/s."""
        return self.after.value(self.time, 1)

    @property
    def change(self) -> Array:
        """Return the change of velocity, (2,) px/s; exactly 0 within one segment."""
        return self.velocity_after - self.velocity_before

    @property
    def place(self) -> Array:
        """Return the place between both segments, (2,) px."""
        return (self.before.value(self.time) + self.after.value(self.time)) / 2

    def error(self, order: int = 1) -> float:
        """Return the error of the change, px/s, or of the distance between both
        segments (`order` 0), px.
        """
        error_before = self.before.error(self.time, order)
        # A single segment has one error, which must not count twice.
        if self.before is self.after:
            return error_before
        return float(np.hypot(error_before, self.after.error(self.time, order)))


@dataclass(frozen=True, eq=False)
class Impact:
    """An impact of one body, or of two bodies without others."""

    frame: int
    parts: tuple[Turn, ...]

    @property
    def bodies(self) -> tuple[int, ...]:
        """Return the indices of the bodies."""
        return tuple(part.body for part in self.parts)


class Motion:
    """Segments, turns, flights and impacts of tracks, for all questions."""

    def __init__(self, tracks: Tracks) -> None:
        self.tracks = tracks
        self.sigma = measure_noise(tracks)
        self.steps = np.asarray(np.diff(tracks.places, axis=0))
        """(T - 1, N, 2) px from frame to frame."""
        self._distances = Distances(tracks)

    @cached_property
    def segments(self) -> list[list[Segment]]:
        """Return the segments of each body, by time. A gap in its track ends
        a segment.
        """
        return list(map(self._segments_of, range(len(self.tracks.names))))

    def _segments_of(self, body: int) -> list[Segment]:
        tracks = self.tracks
        sigma = float(self.sigma[body])
        segments = []
        for first, last in find_runs(tracks.visible[:, body]):
            path = tracks.places[first:last, body]
            times = tracks.times[first:last]
            segments += split_segments(path, times, first, sigma)
        return segments

    # ---- turns

    @cached_property
    def turns(self) -> list[list[Turn]]:
        """Return the turns of each body, between segments with velocities."""
        return list(map(self._turns_of, range(len(self.tracks.names))))

    def _turns_of(self, body: int) -> list[Turn]:
        visible = self.tracks.visible[:, body]
        segments = []
        for segment in self.segments[body]:
            if segment.has_velocity:
                segments.append(segment)
        turns = []
        for before, after in pairwise(segments):
            # A longer gap may contain more than one impact.
            is_near = after.first - before.last <= TUNING.max_gap
            if is_near and visible[before.last : after.first].all():
                turns.append(self._turn(body, before, after))
        return turns

    def _turn(self, body: int, before: Segment, after: Segment) -> Turn:
        times = self.tracks.times
        step = self.tracks.step
        # The impact is between the last frame before and the first one after it.
        earliest = times[before.last] - step / 2
        latest = times[after.first] + step / 2
        ticks = np.linspace(earliest, latest, TICKS)
        turn = Turn(body, before, after, _nearest_time(ticks, [(before, after)]))
        return replace(turn, is_sudden=self._is_sudden(turn))

    def _is_sudden(self, turn: Turn) -> bool:
        """Return whether a velocity changes by more than noise and smooth accelerations
        explain.
        """
        step = self.tracks.step
        a = turn.before.acceleration
        b = turn.after.acceleration
        # A smooth change of acceleration between two segments changes the velocity by
        # this much per frame.
        difference = np.hypot(*(b - a))
        acceleration = max(difference, np.hypot(*a) / 2, np.hypot(*b) / 2)
        smooth_change = acceleration * step
        frames = turn.after.first - turn.before.last
        limit = max(
            TUNING.certainty * turn.error(),
            TUNING.smoothness * smooth_change * frames,
            # Smaller changes are invisible (px/s).
            max(6 * self.sigma[turn.body], 0.4) / step,
        )
        return bool(np.hypot(*turn.change) > limit)

    def split(
        self, body: int, segment: Segment, time: float
    ) -> tuple[Segment, Segment] | None:
        """Return one segment as two with a border at a time (s), or None for few
        frames.

        Their difference limits an invisible impact.
        """
        tracks = self.tracks
        frames = np.arange(segment.first, segment.last + 1)
        # Distant frames would hide a small change in their own curvature.
        is_near = np.abs(tracks.times[frames] - time) <= (
            TUNING.split_frames * tracks.step
        )
        frames = frames[is_near]
        before = frames[tracks.times[frames] < time]
        after = frames[tracks.times[frames] > time]
        if min(len(before), len(after)) < SEGMENT_TUNING.min_frames:
            return None
        return self._fit_frames(body, before), self._fit_frames(body, after)

    def _fit_frames(self, body: int, frames: np.ndarray) -> Segment:
        path = self.tracks.places[frames, body]
        times = self.tracks.times[frames]
        return fit_segment(path, times, int(frames[0]), float(self.sigma[body]))

    def has_sudden_turn(self, body: int, time: float, frames: float) -> bool:
        """Return whether a body turns suddenly within some frames of a time (s)."""
        for turn in self.turns[body]:
            is_near = abs(turn.time - time) <= frames * self.tracks.step
            if turn.is_sudden and is_near:
                return True
        return False

    # ---- flights

    @cached_property
    def flights(self) -> list[tuple[int, Segment]]:
        """Return bodies and their certain flights, seen from the side."""
        if self.tracks.view is View.TOP or self.tracks.is_weightless:
            return []
        flights = []
        for k, segments in enumerate(self.segments):
            if not self.is_free(k) or self._is_guided(k):
                continue
            for segment in segments:
                if self._is_flight(k, segment):
                    flights.append((k, segment))
        return flights

    @cached_property
    def gravity(self) -> Array | None:
        """Return the median acceleration of falls, weighted by length, (2,) px/s², or
        None without a fall.
        """
        accelerations = []
        for _, segment in self.flights:
            if segment.acceleration[1] > 0:
                accelerations += [segment.acceleration] * segment.count
        if not accelerations:
            return None
        # The median of each axis ignores flights with a hidden impact.
        ordered = np.sort(accelerations, axis=0)
        return np.asarray(ordered[(len(ordered) - 1) // 2])

    def _is_guided(self, body: int) -> bool:
        """Return whether accelerations change twice without an impact, as on a rope.
        Gravity may change once.
        """
        smooth_turns = 0
        for turn in self.turns[body]:
            if not turn.is_sudden and self._changes_acceleration(turn):
                smooth_turns += 1
        return smooth_turns >= 2

    def _changes_acceleration(self, turn: Turn) -> bool:
        """Return whether a fast body's acceleration certainly changes."""
        a, b = turn.before, turn.after
        # A change counts if it exceeds three times its own error, and a share of the
        # acceleration itself.
        change = float(np.hypot(*(a.acceleration - b.acceleration)))
        error = float(np.hypot(a.error(turn.time, 2), b.error(turn.time, 2)))
        size = max(float(np.hypot(*a.acceleration)), float(np.hypot(*b.acceleration)))
        speed = max(np.hypot(*turn.velocity_before), np.hypot(*turn.velocity_after))
        # Below half a pixel per frame, accelerations are mostly noise.
        is_fast = speed * self.tracks.step > 0.5
        return bool(is_fast and change > max(3 * error, 0.15 * size))

    def _is_flight(self, body: int, segment: Segment) -> bool:
        """Return whether a segment is curved or vertical, smooth, and without contact
        to known bodies.
        """
        times = self.tracks.times
        begin = times[segment.first]
        end = times[segment.last]
        is_short = end - begin < TUNING.flight_time
        if segment.count < TUNING.flight_frames or is_short:
            return False
        error = segment.error(begin, 2)
        size = float(np.hypot(*segment.acceleration))
        # The height of the arc over its chord: a flat one is indistinguishable from a
        # line.
        sagitta = size * (end - begin) ** 2 / 8
        has_curve = sagitta >= max(5 * self.sigma[body], 1.5)
        if size < 5 * error or not has_curve or segment.residual > 2.5:
            return False
        return _is_fall(segment, error) and self.is_alone(body, segment, 1.0)

    def is_alone(self, body: int, segment: Segment, margin: float) -> bool:
        """Return whether other bodies are farther away than a margin (px) in all frames
        but the first and last.
        """
        # At both ends, a flight may touch the body that it leaves or hits.
        inner_frames = slice(segment.first + 1, segment.last)
        for k, outline in enumerate(self.tracks.forms):
            if k == body or outline.reach <= 0 or self.passes(body, k):
                continue
            gap = self.gap(body, k)[inner_frames]
            if np.nanmin(gap, initial=np.inf) <= margin:
                return False
        return True

    # ---- bodies

    def is_movable(self, body: int) -> bool:
        """Return whether a body ever moves. A body at rest may be fixed."""
        path = self.tracks.places[self.tracks.visible[:, body], body]
        if not len(path):
            return False
        # Few wrong places must not make a resting body movable.
        distances = np.hypot(*(path - np.median(path, axis=0)).T)
        return bool(np.quantile(distances, 0.95) > max(2.0, 6 * self.sigma[body]))

    def is_free(self, body: int) -> bool:
        """Return whether only gravity and contacts act on a body."""
        return body not in self.tracks.guided_bodies

    def passes(self, first: int, second: int) -> bool:
        """Return whether two bodies are known to pass through each other."""
        pair = (min(first, second), max(first, second))
        return pair in self.tracks.passing_pairs

    # ---- distances

    def distance_noise(self, first: int, second: int) -> float:
        """Return the noise of the distance of two bodies, px."""
        return float(np.hypot(self.sigma[first], self.sigma[second]))

    def gap(self, first: int, second: int) -> Array:
        """Return the gap between two bodies, (T,) px: negative if they overlap,
        NaN if one is not visible.
        """
        return self._distances.gap(first, second)

    def neighbours(self, body: int, first: int, last: int) -> list[int]:
        """Return the bodies with a possible contact to a body between two frames, for
        any speed.
        """
        first = max(first, 0)
        last = min(last, len(self.tracks.times) - 1)
        neighbours = []
        for other in range(len(self.tracks.names)):
            if other == body or self.passes(body, other):
                continue
            gap = self.gap(body, other)[first : last + 1]
            margin = self.margin(body, other, first, last)
            if np.nanmin(gap, initial=np.inf) <= margin:
                neighbours.append(other)
        return neighbours

    def margin(self, body: int, other: int, first: int, last: int) -> float:
        """Return the maximum distance (px) in all frames of two bodies with a contact
        between frames.
        """
        gap = self.gap(body, other)[max(first - 1, 0) : last + 2]
        # After a hit half-way between two frames, bodies are half a step apart in both.
        rate = float(np.nanmax(np.abs(np.diff(gap)), initial=0.0))
        return 1.5 + 0.65 * rate + 3 * self.distance_noise(body, other)

    @cached_property
    def impacts(self) -> list[Impact]:
        """Return the measured impacts of one or two free bodies outside crowds, without
        repetitions.
        """
        impacts: list[Impact] = []
        for turn in self._sudden_turns():
            impact = _impact(self, turn)
            if impact is None or not _is_single(impact, self.tracks.step):
                continue
            if not _contains_pair(impacts, impact, self.tracks.step):
                impacts.append(impact)
        return impacts

    def _sudden_turns(self) -> Iterator[Turn]:
        for turns in self.turns:
            for turn in turns:
                if turn.is_sudden and self.is_free(turn.body):
                    yield turn


def _is_fall(segment: Segment, error: float) -> bool:
    """Return whether an acceleration (error in px/s²) is vertical, or not along
    the velocity.
    """
    x, y = segment.acceleration
    size = float(np.hypot(x, y))
    # A vertical acceleration is that of a fall.
    if abs(x) < TUNING.vertical_sine * size + 2 * error:
        return True
    vx, vy = segment.value(segment.middle, 1)
    speed = float(np.hypot(vx, vy))
    if speed <= 0:
        return False
    # A slide along a slope accelerates along its path; a flight does not.
    sideways = abs(x * vy - y * vx) / speed
    return bool(sideways > max(4 * error, 0.25 * size))


def _nearest_time(ticks: Array, parts: Sequence[tuple[Segment, Segment]]) -> float:
    """Return the tick (s) of the smallest distance between the segments before and
    after.
    """
    distances = []
    for time in ticks:
        squares = []
        for before, after in parts:
            gap = after.value(time) - before.value(time)
            squares.append(float(np.sum(gap**2)))
        distances.append(sum(squares))
    return float(ticks[int(np.argmin(distances))])


# ---- impacts


def _contains_pair(impacts: Sequence[Impact], impact: Impact, step: float) -> bool:
    """Return whether an impact of the same two bodies at the same time is known."""
    time = impact.parts[0].time
    # Both bodies of an impact have a turn, so that it is found twice.
    for known in impacts:
        has_same_bodies = set(known.bodies) == set(impact.bodies)
        delay = abs(known.parts[0].time - time)
        is_pair = len(known.parts) == 2
        if is_pair and has_same_bodies and delay <= TUNING.same_time * step:
            return True
    return False


def _is_single(impact: Impact, step: float) -> bool:
    """Return whether one impact explains the turns. After two impacts in one frame,
    paths do not meet at its time.
    """
    # One impact at one time joins both paths, up to the change within a frame.
    change = max(float(np.hypot(*part.change)) for part in impact.parts)
    for part in impact.parts:
        end = part.before.value(part.time)
        begin = part.after.value(part.time)
        gap = np.hypot(*(begin - end))
        if gap > TUNING.path_gap * change * step + 3 * part.error(0):
            return False
    return True


def _impact(motion: Motion, turn: Turn) -> Impact | None:
    """Return the impact of a turn, or None for unknown bodies or more than two."""
    first = turn.before.last
    last = turn.after.first
    partners = []
    for body in motion.neighbours(turn.body, first, last):
        # Any neighbour with an unknown motion makes the impact uncertain.
        partner = _partner(motion, body, turn)
        if partner is None:
            return None
        has_met = _have_met(motion, turn, partner)
        if has_met is None:
            return None
        if has_met:
            partners.append(partner)
        # A neighbour turns at about this time without a contact: a third body may be
        # involved.
        elif motion.has_sudden_turn(body, turn.time, TUNING.late_time):
            return None
    # No partner means a wall or the floor; two partners share the momentum in an
    # unknown way.
    if not partners:
        return Impact(first, (turn,))
    if len(partners) > 1 or not motion.is_free(partners[0].body):
        return None
    partner = partners[0]
    if _has_third_body(motion, turn, partner):
        return None
    # Both bodies turn at one time: the one at which all four paths are nearest.
    half_step = motion.tracks.step / 2
    ticks = turn.time + np.linspace(-half_step, half_step, TICKS)
    parts = [(turn.before, turn.after), (partner.before, partner.after)]
    time = _nearest_time(ticks, parts)
    return Impact(first, (replace(turn, time=time), replace(partner, time=time)))


def _has_third_body(motion: Motion, turn: Turn, partner: Turn) -> bool:
    """Return whether another body may have touched the partner at the same time."""
    first = turn.before.last
    last = turn.after.first
    for body in set(motion.neighbours(partner.body, first, last)) - {turn.body}:
        gap = motion.gap(partner.body, body)[first : last + 1]
        if motion.has_sudden_turn(body, turn.time, TUNING.late_time):
            return True
        if np.nanmin(gap, initial=np.inf) < 2.0:
            return True
    return False


def _partner(motion: Motion, body: int, turn: Turn) -> Turn | None:
    """Return the turn of another body at the same time, or None if unknown."""
    # A visible turn at the same time is the best evidence of a partner.
    for partner in motion.turns[body]:
        delay = abs(partner.time - turn.time)
        if delay <= TUNING.same_time * motion.tracks.step:
            return replace(partner, time=turn.time)
    for segment in motion.segments[body]:
        # A heavy partner may turn invisibly, within one segment.
        begins_before = segment.first <= turn.before.last
        ends_after = turn.after.first <= segment.last
        if segment.has_velocity and begins_before and ends_after:
            sides = motion.split(body, segment, turn.time)
            before, after = sides or (segment, segment)
            return Turn(body, before, after, turn.time, is_visible=False)
    return None


def _have_met(motion: Motion, turn: Turn, partner: Turn) -> bool | None:
    """Return whether two bodies were near enough at the impact for a contact, or None
    if unknown.
    """
    forms = motion.tracks.forms
    reach = forms[turn.body].reach + forms[partner.body].reach
    noise = motion.distance_noise(turn.body, partner.body)
    # Outlines, noise and the shape of the bodies limit the accuracy of a gap.
    contact_gap = 1.0 + 3 * noise + 0.05 * reach
    gap = float(np.hypot(*(turn.place - partner.place))) - reach
    if gap <= contact_gap:
        return True
    changes = float(np.hypot(*turn.change) + np.hypot(*partner.change))
    # Beyond this gap a contact is impossible; up to it, it is unknown.
    slack = TUNING.path_gap / 2 * changes * motion.tracks.step
    slack += 3 * max(part.before.error(part.time) for part in (turn, partner))
    speed_before = np.hypot(*turn.velocity_before)
    speed_after = np.hypot(*turn.velocity_after)
    # A body that was at rest before must have been hit by some body.
    was_hit = speed_before <= TUNING.rest_part * speed_after
    is_continuous = partner.after.first - partner.before.last <= 1
    if is_continuous and not was_hit and gap > contact_gap + slack:
        return False
    return None
