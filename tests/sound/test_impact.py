"""Hertz's contact against its equation of motion."""

from __future__ import annotations

from math import inf, sqrt

import numpy as np
import pytest

from physgen.sound.impact import Surface, contact_time, pulse_spectrum

BALL = Surface(0.17, 0.0286, 5.8e9, 0.34)
SLAB = Surface(inf, inf, 205e9, 0.29)


def integrated_contact_time(first: Surface, second: Surface, speed: float) -> float:
    """Return the time (s) of m x'' = -k x^(3/2), integrated step by step."""
    compliance = sum((1 - s.poisson**2) / s.young for s in (first, second))
    radius = 1 / (1 / first.radius + 1 / second.radius)
    mass = 1 / (1 / first.mass + 1 / second.mass)
    stiffness = 4 / 3 * sqrt(radius) / compliance
    depth, velocity, step, time = 0.0, speed, 2e-8, 0.0
    while depth >= 0:
        velocity -= stiffness * max(depth, 0.0) ** 1.5 / mass * step
        depth += velocity * step
        time += step
    return time


@pytest.mark.parametrize("second", [BALL, SLAB])
@pytest.mark.parametrize("speed", [0.3, 3.0])
def test_contact_time_equals_integrated_motion(second: Surface, speed: float) -> None:
    expected = integrated_contact_time(BALL, second, speed)
    assert contact_time(BALL, second, speed) == pytest.approx(expected, rel=0.02)


def test_pulse_spectrum_equals_fourier_integral() -> None:
    time = 3e-4
    moments = (np.arange(20000) + 0.5) / 20000 * time
    force = np.sin(np.pi * moments / time)
    force /= force.sum()
    frequencies = np.array([10.0, 1 / (2 * time), 2500.0, 4000.0])
    for frequency, share in zip(
        frequencies, pulse_spectrum(frequencies, time), strict=True
    ):
        integral = abs((force * np.exp(-2j * np.pi * frequency * moments)).sum())
        assert share == pytest.approx(integral, abs=1e-4)
