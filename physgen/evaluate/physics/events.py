"""Times of events in a body's motion, from samples of it: passages through a value, and bounces."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from math import sqrt

import numpy as np

from physgen.evaluate.physics.scorecard import Array, Track

BISECTIONS = 60
"""Halvings of an interval: more than the digits of a float."""


def find_crossings(times: Array, values: Array, rates: Array) -> Array:
    """Return the times (C,) s at which a smooth quantity passes zero, from samples of it and of its rate.

    Between two samples the quantity is the cubic that has their values and rates (Hermite); its error is of fourth
    order in the sampling interval.
    """
    has_value = values[:-1] != 0
    changes_sign = np.sign(values[1:]) != np.sign(values[:-1])
    crossing_times = []
    for k in np.flatnonzero(has_value & changes_sign):
        step = times[k + 1] - times[k]
        part = _cubic_root(
            values[k], values[k + 1], rates[k] * step, rates[k + 1] * step
        )
        crossing_times.append(times[k] + part * step)
    return np.array(crossing_times)


def _cubic_root(
    first: float, last: float, first_rate: float, last_rate: float
) -> float:
    """Return the root between 0 and 1 of the cubic with these values and rates at 0 and 1."""
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
    """A piece of free fall between two contacts with one floor, from one sample of it."""

    begin: float
    """s at which the body left the floor; of the first drop, when it would have."""
    end: float
    """s at which the body comes back."""
    start_speed: float
    """px/s upwards as it leaves."""
    impact_speed: float
    """px/s downwards as it comes back."""
    apex: float
    """px of height above the floor."""


def find_flights(track: Track, floor: float, gravity: float) -> list[Flight]:
    """Return the free falls onto the height `floor` (px, of the centre at contact), in order, the first drop first.

    A bounce is at a jump of the velocity from down to up. Times and speeds at the ends of a flight follow exactly
    from one sample: the begin from an early one, the end from a late one, the height from the highest.
    """
    vy = track.velocities[:, 1]
    bounces = np.flatnonzero((vy[:-1] > 0) & (vy[1:] < 0)) + 1
    edges = [0, *bounces.tolist(), len(vy)]
    flights = []
    for k, (begin, end) in enumerate(pairwise(edges)):
        # samples next to a bounce do not count: an engine may still push the body there
        is_after_bounce = k > 0
        is_before_bounce = end < len(vy)
        early = begin + is_after_bounce
        late = end - 1 - is_before_bounce
        if late < early:
            break
        flights.append(_flight(track, early, late, floor, gravity))
    return flights


def _flight(
    track: Track, early: int, late: int, floor: float, gravity: float
) -> Flight:
    """Return the flight that contains the samples from `early` to `late`."""
    vy = track.velocities[:, 1]
    y = track.y
    times = track.times

    def floor_speed(sample: int) -> float:
        squared_speed = vy[sample] ** 2 + 2 * gravity * (floor - y[sample])
        return sqrt(max(squared_speed, 0.0))

    start_speed, impact_speed = floor_speed(early), floor_speed(late)
    top = early + int(np.argmin(np.abs(vy[early : late + 1])))
    return Flight(
        begin=float(times[early] - (vy[early] + start_speed) / gravity),
        end=float(times[late] + (impact_speed - vy[late]) / gravity),
        start_speed=start_speed,
        impact_speed=impact_speed,
        apex=float(floor - y[top] + vy[top] ** 2 / (2 * gravity)),
    )
