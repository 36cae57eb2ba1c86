"""Hertz's contact of two bodies: how long an impact lasts and which tones it excites."""

from __future__ import annotations

from dataclasses import dataclass
from math import inf, pi

import numpy as np

from physgen.arrays import F64

HERTZ = 2.868
"""Factor of the contact time; Johnson, Contact Mechanics, equation 11.24."""
MIN_SPEED = 1e-4
"""m/s: slower contacts are counted as this fast, since Hertz's time grows without end."""
MAX_CONTACT = 0.02
"""s: softer contacts make no tone that can be heard."""


@dataclass(frozen=True)
class Surface:
    """One side of a contact."""

    mass: float
    """kg; infinite for scenery."""
    radius: float
    """m of curvature; infinite for a plane."""
    young: float
    """Pa."""
    poisson: float


def contact_time(first: Surface, second: Surface, speed: float) -> float:
    """Return the time (s) of an elastic impact at a closing speed (m/s).

    Hertz: 2.87 (m² / (R E² v))^(1/5), with m, R and E of the pair.
    """
    mass = pair_mass(first, second)
    radius = 1 / max(_inverse(first.radius) + _inverse(second.radius), 1e-9)
    compliance = 0.0
    for side in (first, second):
        compliance += (1 - side.poisson**2) / side.young
    stiffness = 1 / compliance
    speed = max(speed, MIN_SPEED)
    time = HERTZ * (mass**2 / (radius * stiffness**2 * speed)) ** 0.2
    return float(min(time, MAX_CONTACT))


def pair_mass(first: Surface, second: Surface) -> float:
    """Return the mass (kg) that two surfaces have in an impact."""
    return 1 / max(_inverse(first.mass) + _inverse(second.mass), 1e-12)


def _inverse(value: float) -> float:
    return 0.0 if value == inf else 1 / value


def pulse_spectrum(frequencies: F64, time: float) -> F64:
    """Return the share of an impulse that excites each frequency (Hz), for a half-sine of `time` s.

    1 for slow modes; a longer contact excites fewer high tones.
    """
    phase = frequencies * time
    difference = 1 - (2 * phase) ** 2
    is_pole = np.abs(difference) < 1e-6
    share = np.cos(pi * phase) / np.where(is_pole, 1.0, difference)
    return np.asarray(np.where(is_pole, pi / 4, np.abs(share)))
