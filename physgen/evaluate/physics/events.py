"""Times of events in a body's motion, from samples of it: passages through a value, and bounces."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from physgen.evaluate.physics.scorecard import Array, Track


def crossings(times: Array, values: Array, rates: Array) -> Array:
    """(C,) s: when a smooth quantity passes zero, from samples of it and of its rate of change.

    Between two samples it is the cubic that has their values and rates (Hermite); its error is of fourth order in the
    sampling interval.
    """
    found = []
    for k in np.flatnonzero(
        (values[:-1] != 0) & (np.sign(values[1:]) != np.sign(values[:-1]))
    ):
        step = times[k + 1] - times[k]
        a, b, da, db = values[k], values[k + 1], rates[k] * step, rates[k + 1] * step
        cubic = (2 * a - 2 * b + da + db, -3 * a + 3 * b - 2 * da - db, da, a)
        low, high = 0.0, 1.0
        for _ in range(60):
            part = (low + high) / 2
            value = ((cubic[0] * part + cubic[1]) * part + cubic[2]) * part + cubic[3]
            low, high = (part, high) if np.sign(value) == np.sign(a) else (low, part)
        found.append(times[k] + high * step)
    return np.array(found)


@dataclass(frozen=True)
class Flight:
    """A piece of free fall between two contacts with one floor, from one sample of it."""

    begin: float
    """s at which it left the floor; of the first drop, when it would have."""
    end: float
    """s at which it comes back."""
    leaving: float
    """px/s upwards as it leaves."""
    landing: float
    """px/s downwards as it comes back."""
    apex: float
    """px of height above the floor."""


def flights(track: Track, floor: float, gravity: float) -> list[Flight]:
    """Free falls onto the height `floor` (px, of the centre while touching) one after the other, the first drop first.

    A bounce lies where the velocity jumps from down to up. Of each flight, times and speeds at its ends follow
    exactly from one sample: the begin from an early one, the end from a late one, the height from the highest.
    Samples next to a bounce are left out, since an engine may still be pushing there.
    """
    vy, y, t = track.velocities[:, 1], track.y, track.times
    bounce = np.flatnonzero((vy[:-1] > 0) & (vy[1:] < 0)) + 1
    edges = [0, *bounce.tolist(), len(t)]
    result = []
    for k, (begin, end) in enumerate(pairwise(edges)):
        early = begin + 1 if k else begin
        late = end - 2 if end < len(t) else end - 1
        if late < early:
            break
        top = early + int(np.argmin(np.abs(vy[early : late + 1])))
        speeds = [
            np.sqrt(max(vy[s] ** 2 + 2 * gravity * (floor - y[s]), 0.0))
            for s in (early, late)
        ]
        result.append(
            Flight(
                begin=float(t[early] - (vy[early] + speeds[0]) / gravity),
                end=float(t[late] + (speeds[1] - vy[late]) / gravity),
                leaving=float(speeds[0]),
                landing=float(speeds[1]),
                apex=float(floor - y[top] + vy[top] ** 2 / (2 * gravity)),
            )
        )
    return result
