"""Events read from samples are exact where the motion is."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from pytest import approx

from physgen.evaluate.physics.events import find_crossings, find_flights
from physgen.evaluate.physics.scorecard import Track

G = 980.0


def bouncing(e: float, height: float, rate: float, duration: float) -> Track:
    """A point dropped onto y = 0 from `height`, y down."""
    times = np.arange(int(duration * rate) + 1) / rate
    speed, land = np.sqrt(2 * G * height), np.sqrt(2 * height / G)
    y, v = -height + G * times**2 / 2, G * times
    begin = land
    for _ in range(12):
        speed *= e
        later = times >= begin
        since = times[later] - begin
        y[later], v[later] = -speed * since + G * since**2 / 2, -speed + G * since
        begin += 2 * speed / G
    zeros = np.zeros_like(times)
    return Track(
        times, np.stack([zeros, y, zeros], axis=1), np.stack([zeros, v, zeros], axis=1)
    )


def test_flights_tell_times_speeds_and_heights() -> None:
    found = find_flights(bouncing(0.7, 200, 240, 3.5), 0.0, G)
    speed = np.sqrt(2 * G * 200)
    assert len(found) >= 5
    for n, flight in enumerate(found[:5]):
        assert flight.start_speed == approx(speed * 0.7**n, rel=1e-9)
        assert flight.apex == approx(200 * 0.7 ** (2 * n), rel=1e-9)
        assert flight.end - flight.begin == approx(2 * speed * 0.7**n / G, rel=1e-9)
    for before, after in pairwise(found[:5]):
        assert after.begin == approx(before.end, rel=1e-9)


def test_crossings_are_far_finer_than_samples() -> None:
    times = np.arange(200) / 60
    found = find_crossings(times, np.cos(7 * times), -7 * np.sin(7 * times))
    exact = (np.arange(len(found)) + 0.5) * np.pi / 7
    assert np.abs(found - exact).max() < 1e-7


def test_a_sample_is_the_last_not_after_its_time() -> None:
    track = bouncing(0.5, 100, 60, 1.0)
    assert [track.sample(t) for t in (0.0, 0.5, 0.509, 1.0)] == [0, 30, 30, 60]
