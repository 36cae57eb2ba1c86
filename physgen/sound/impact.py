"""Hertz contact of two bodies: duration and spectrum of an impact."""

from __future__ import annotations

from dataclasses import dataclass
from math import inf, pi

import numpy as np

from physgen.arrays import F64

HERTZ = 2.868
"""Factor of the contact time; Johnson, Contact Mechanics, equation 11.24."""
MIN_SPEED = 1e-4
"""Minimum speed in Hertz's formula, m/s. Its contact time has no limit at
slow speeds.
"""
MAX_CONTACT = 0.02
"""Maximum contact time, s. Softer contacts have no audible tone."""


@dataclass(frozen=True)
class Surface:
    """One side of a contact."""

    mass: float
    """kg; infinite for scenery."""
    radius: float
    """Radius of curvature, m; infinite for a plane."""
    young: float
    """Pa."""
    poisson: float


def contact_time(first: Surface, second: Surface, speed: float) -> float:
    """Return the time of an elastic impact (s) at a closing speed (m/s).

    Hertz: 2.87 (m² / (R E² v))^(1/5), with m, R and E of the pair.
    """
    mass = pair_mass(first, second)
    # Two planes have no curvature; the bound avoids a division by zero.
    radius = 1 / max(_inverse(first.radius) + _inverse(second.radius), 1e-9)
    # Both surfaces give way, so that their compliances add up.
    compliance = 0.0
    for side in (first, second):
        compliance += (1 - side.poisson**2) / side.young
    stiffness = 1 / compliance
    speed = max(speed, MIN_SPEED)
    time = HERTZ * (mass**2 / (radius * stiffness**2 * speed)) ** 0.2
    return float(min(time, MAX_CONTACT))


def pair_mass(first: Surface, second: Surface) -> float:
    """Return the effective mass of two surfaces in an impact (kg)."""
    return 1 / max(_inverse(first.mass) + _inverse(second.mass), 1e-12)


def _inverse(value: float) -> float:
    if value == inf:
        return 0.0
    return 1 / value


def pulse_spectrum(frequencies: F64, time: float) -> F64:
    """Return the share of an impulse at each frequency (Hz), for a half-sine of `time`
    s.

    The share is 1 for slow modes. A longer contact excites fewer high tones.
    """
    # The Fourier transform of a half-sine of duration T: cos(pi f T)/(1 - (2 f T)²).
    phase = frequencies * time
    difference = 1 - (2 * phase) ** 2
    # The formula is 0 / 0 at the frequency of the half-sine itself; its limit is pi /
    # 4.
    is_pole = np.abs(difference) < 1e-6
    share = np.cos(pi * phase) / np.where(is_pole, 1.0, difference)
    return np.asarray(np.where(is_pole, pi / 4, np.abs(share)))
