"""Times of events in a body's motion, from its samples: zero crossings and bounces."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from math import sqrt

import numpy as np

from physgen.evaluate.physics.scorecard import Array, Track

BISECTIONS = 60
"""Number of bisections of an interval: more than the digits of a float."""


def find_crossings(times: Array, values: Array, rates: Array) -> Array:
    """Return the times (C,) s of the zeros of a smooth quantity, from samples of it and
    of its rate.

    Between two samples, the quantity is the cubic with the samples' values and rates
    (Hermite). Its error is of fourth order in the sampling interval.
    """
    has_value = values[:-1] != 0
    changes_sign = np.sign(values[1:]) != np.sign(values[:-1])
    crossing_times = []
    for k in np.flatnonzero(has_value & changes_sign):
        step = times[k + 1] - times[k]
        first_rate = rates[k] * step
        last_rate = rates[k + 1] * step
        part = _cubic_root(values[k], values[k + 1], first_rate, last_rate)
        crossing_times.append(times[k] + part * step)
    return np.array(crossing_times)


def _cubic_root(
    first: float, last: float, first_rate: float, last_rate: float
) -> float:
    """Return the root between 0 and 1 of the cubic with these values and rates at 0 and
    1.
    """
    # Hermite's cubic in the form ((cubic t + square) t + rate) t + first.
    cubic = 2 * first - 2 * last + first_rate + last_rate
    square = -3 * first + 3 * last - 2 * first_rate - last_rate
    low, high = 0.0, 1.0
    for _ in range(BISECTIONS):
        middle = (low + high) / 2
        value = ((cubic * middle + square) * middle + first_rate) * middle + first
        if np.sign(value) == np.sign(first):
            low = middle
        else:
            high = middle
    return high


@dataclass(frozen=True)
class Flight:
    """A free fall between two contacts with one floor, from one sample."""

    begin: float
    """Time of departure from the floor, s; for the first drop, a virtual one."""
    end: float
    """Time of return, s."""
    start_speed: float
    """Upward speed at departure, px/s."""
    impact_speed: float
    """Downward speed at return, px/s."""
    apex: float
    """Greatest height above the floor, px."""


def find_flights(track: Track, floor: float, gravity: float) -> list[Flight]:
    """Return the free falls onto the height `floor` (px, of the centre at contact),
    from the first drop on.

    A jump of the velocity from down to up is a bounce. Times and speeds at the ends of
    a flight follow exactly from one sample: the beginning from an early one, the end
    from a late one, the height from the highest.
    """
    # Downwards is positive: a bounce turns the speed from positive to negative.
    vy = track.velocities[:, 1]
    is_bounce = (vy[:-1] > 0) & (vy[1:] < 0)
    bounces = np.flatnonzero(is_bounce) + 1
    edges = [0, *bounces.tolist(), len(vy)]
    flights = []
    for k, (begin, end) in enumerate(pairwise(edges)):
        # Samples next to a bounce do not count: an engine may still push the body
        # there.
        is_after_bounce = k > 0
        is_before_bounce = end < len(vy)
        early = begin + is_after_bounce
        late = end - 1 - is_before_bounce
        if late < early:
            break
        flights.append(_flight(track, early, late, floor, gravity))
    return flights


def _flight(
    track: Track, first_sample: int, last_sample: int, floor: float, gravity: float
) -> Flight:
    """Return the flight around the samples from `first_sample` to `last_sample`."""
    vy = track.velocities[:, 1]
    y = track.y
    times = track.times

    def floor_speed(sample: int) -> float:
        # Energy of free fall between the sample and the floor: v² = vy² + 2 g h.
        squared_speed = vy[sample] ** 2 + 2 * gravity * (floor - y[sample])
        return sqrt(max(squared_speed, 0.0))

    start_speed, impact_speed = floor_speed(first_sample), floor_speed(last_sample)
    # The highest sample has the smallest rest of the speed, and so the least error.
    flight_speeds = np.abs(vy[first_sample : last_sample + 1])
    top = first_sample + int(np.argmin(flight_speeds))
    # In free fall the speed changes by g per second, so that each end has a known time.
    return Flight(
        begin=float(times[first_sample] - (vy[first_sample] + start_speed) / gravity),
        end=float(times[last_sample] + (impact_speed - vy[last_sample]) / gravity),
        start_speed=start_speed,
        impact_speed=impact_speed,
        apex=float(floor - y[top] + vy[top] ** 2 / (2 * gravity)),
    )
